"""Times whole runs on demand, for ``compare.py``: a line with a scene and a length goes in, the time of a period comes out.

It takes nothing from the package but its parameters and `run_many`, so it serves revisions of any layout.
"""

import json
import sys
from time import thread_time

import numpy as np

from dimersweep.kernel.batch import run_many
from dimersweep.parameters import Parameters

RTOL = 1e-8
ROOM = 32  # columns of the outcome: more than any revision fills


def seconds_of(row, periods):
    """Time on the processor of a run of so many forcing periods [s]."""
    out, codes = np.zeros((1, ROOM)), np.zeros((1, ROOM), np.int64)
    begun = thread_time()
    run_many(row, periods, RTOL, False, out, codes)
    return thread_time() - begun


def tuned(row, seconds):
    """How many periods take about so long."""
    seconds_of(row, 1)  # loads the compiled code
    periods = 4
    while (taken := seconds_of(row, periods)) < 0.3 * seconds:
        periods *= 4
    return max(1, round(periods * seconds / taken))


def answer_all(lines, tell, repeats=3):
    """Answer each line ``[scene, seconds]`` by the least time of a period."""
    ready = {}
    for line in lines:
        scene, seconds = json.loads(line)
        row = Parameters(**scene).row()[None]
        key = json.dumps(scene)
        if key not in ready:
            ready[key] = tuned(row, seconds)
        tell(json.dumps(min(seconds_of(row, ready[key]) for _ in range(repeats)) / ready[key]))


if __name__ == "__main__":
    answer_all(sys.stdin, lambda text: print(text, flush=True))
