"""Times verbs on demand, for ``compare.py``: a line with a verb and a length goes in, its time per call comes out."""

import json
import pickle
import sys
from pathlib import Path
from time import thread_time

from verbs_loops import VERBS, tuned


def seconds_per_call(timed, turns, repeats=3):
    """Least time of one call of a verb, of so many timings, on the processor: other programs count less [s]."""
    taken = []
    for _ in range(repeats):
        begun = thread_time()
        timed.run(turns)
        taken.append(thread_time() - begun)
    return min(taken) / timed.calls(turns)


def answer_all(found, lines, tell):
    """Answer each line ``[verb, seconds]`` by the time of a call, and a verb that is not known by null."""
    ready = {}
    for line in lines:
        name, seconds = json.loads(line)
        if name in VERBS and name not in ready:
            timed = VERBS[name](found)
            ready[name] = timed, tuned(timed, seconds)
        tell(json.dumps(seconds_per_call(*ready[name]) if name in ready else None))


if __name__ == "__main__":
    answer_all(pickle.loads(Path(sys.argv[1]).read_bytes()), sys.stdin, lambda text: print(text, flush=True))
