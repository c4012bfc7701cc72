"""The time of every verb of the kernel, and of its start: ``pytest benchmarks/speed/verbs_bench.py``.

``--benchmark-compare=benchmarks/speed/baseline.json`` sets it against the stored baseline, which
``python benchmarks/speed/verbs_bench.py`` writes anew: its times are those of the machine that it names. Two revisions are
compared by ``compare.py``, in turn on one machine.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from speed import FIRST_RUN, IMPORT, fresh
from verbs_loops import VERBS, Harvest, tuned

BASELINE = Path(__file__).resolve().parent / "baseline.json"
SECONDS, ROUNDS = 0.01, 30  # length of one timing, and how many there are


@pytest.fixture(scope="module")
def found():
    """Inputs of the verbs."""
    return Harvest(random=8, periods=6)


@pytest.mark.benchmark(timer=time.thread_time)  # on the processor: other programs count less
@pytest.mark.parametrize("name", VERBS)
def test_verb(benchmark, found, name):
    """One call of a verb, on average over its inputs."""
    verb = VERBS[name](found)
    turns = tuned(verb, SECONDS)
    assert verb.calls(turns) > 0
    answers = benchmark.pedantic(verb.run, (turns,), rounds=ROUNDS, warmup_rounds=1)
    assert not np.isnan(answers).any()  # inf is a step that the engine would take shorter
    if benchmark.stats:
        timings = benchmark.stats.stats.data  # of many calls each: told per call
        timings[:] = [seconds / verb.calls(turns) for seconds in timings]


def in_fresh_processes(benchmark, code, cache, rounds):
    """Time `code` as it tells itself, in new processes with one cache."""
    told = []
    benchmark.pedantic(lambda: told.append(fresh(code, cache).told), rounds=rounds)
    if benchmark.stats:
        benchmark.stats.stats.data[:] = told


def test_import(benchmark, tmp_path):
    """``import dimersweep``."""
    in_fresh_processes(benchmark, IMPORT, tmp_path, 9)


def test_cold_start(benchmark, tmp_path_factory):
    """A first run that compiles."""
    in_fresh_processes(benchmark, FIRST_RUN, tmp_path_factory.mktemp("empty"), 1)


def test_cached_start(benchmark, tmp_path):
    """A first run from the cache."""
    fresh(FIRST_RUN, tmp_path)
    in_fresh_processes(benchmark, FIRST_RUN, tmp_path, 5)


def write_baseline():
    """Measure anew, and keep the summary of each time but not every timing."""
    answer = pytest.main([__file__, "-q", f"--benchmark-json={BASELINE}"])
    kept = json.loads(BASELINE.read_text())
    for one in kept["benchmarks"]:
        one["stats"].pop("data", None)
    BASELINE.write_text(json.dumps(kept, indent=1) + "\n")
    return answer


if __name__ == "__main__":
    sys.exit(write_baseline())
