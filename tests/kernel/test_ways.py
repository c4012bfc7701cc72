"""The kernel gives the same bits whichever way it is compiled, and on every version of the packages that it may have."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from dimersweep.kernel.compiler.pipelines import FAST, PLAIN, first_pipeline

HERE = Path(__file__).parent


def environment_of(way):
    """The environment of a process that compiles in one way."""
    return os.environ | {"DIMERSWEEP_COMPILER": way, "PYTHONPATH": str(HERE.parents[1])}


def answers_of(way, folder):
    """The answers of the kernel compiled in one way, from a process of its own, and its time on the processor [s]."""
    file = folder / f"{way}.npz"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, str(HERE / "ways.py"), str(file)], env=environment_of(way), check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = np.load(file)
    assert found["way"] == way
    return found["codes"], found["states"], after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The answers of both ways; whatever is not compiled yet is compiled here."""
    return {way: answers_of(way, tmp_path_factory.mktemp(way)) for way in (FAST, PLAIN)}


@pytest.mark.jit
@pytest.mark.slow
@pytest.mark.release
def test_fast_and_plain_answer_alike(both):
    (codes, states, _), (other_codes, other_states, _) = both.values()
    np.testing.assert_array_equal(other_codes, codes)
    np.testing.assert_array_equal(other_states, states)


@pytest.mark.jit
@pytest.mark.slow
@pytest.mark.release
@pytest.mark.parametrize("way", [FAST, PLAIN])
def test_a_second_start_is_quick_in_both_ways(both, tmp_path, way):
    *_, seconds = answers_of(way, tmp_path)
    assert seconds < 5.0, "the code was not kept"


@pytest.mark.jit
@pytest.mark.slow
@pytest.mark.release
def test_the_plain_way_runs_about_as_fast(both):
    """In pairs on one core: other processes take the same from both."""
    times = np.array(paired_times(turns=15))
    assert np.median(times[:, 1] / times[:, 0]) < 1.3


def paired_times(turns):
    """Times of a forcing period, compiled fast and plain, in processes that take turns, shape (turns, 2) [s]."""
    workers = [
        subprocess.Popen(
            [sys.executable, str(HERE / "ways.py")],
            env=environment_of(way),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for way in (FAST, PLAIN)
    ]
    if hasattr(os, "sched_setaffinity"):
        for worker in workers:
            os.sched_setaffinity(worker.pid, {min(os.sched_getaffinity(0))})

    def asked(worker):
        print(file=worker.stdin, flush=True)
        return float(worker.stdout.readline())

    found = [[asked(worker) for worker in workers] for _ in range(turns)]
    for worker in workers:
        worker.communicate()
    return found


def told(kind):
    """What ``vanishing.py`` prints, as a list."""
    environment = {name: value for name, value in os.environ.items() if name != "DIMERSWEEP_COMPILER"}
    environment["PYTHONPATH"] = str(HERE.parents[1])
    command = [sys.executable, str(HERE / "vanishing.py"), kind]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def took_over(found):
    """Whether the plain way has taken over, with its results and one line."""
    (line,) = found["told"]
    return (
        found["values"] == [3.0, 15.0, 3.0]
        and found["way"] == PLAIN
        and "\n" not in line
        and line.startswith(f"numba {numba.__version__}: the fast way of compiling fails (")
    )


@pytest.mark.jit
@pytest.mark.slow
def test_the_plain_way_takes_over_where_a_private_part_is_gone():
    whole, *lacking = told("gone")
    assert (whole["way"], whole["told"], whole["values"]) == (FAST, [], [3.0, 15.0, 3.0])
    assert len({tuple(found["hidden"]) for found in lacking}) > 5
    for found in lacking:
        assert took_over(found), found
        assert found["after"] != whole["after"], found


@pytest.mark.jit
def test_the_plain_way_takes_over_midway_and_later_processes_know():
    *failing, refused, lacking, plain, wrong = told("midway")
    assert len(failing) == 10
    for here, later in zip(failing[::2], failing[1::2], strict=True):
        assert took_over(here) and took_over(later)
        assert here["before"] == wrong["after"]  # of the fast way
        assert here["after"] == later["before"] == later["after"] == plain["after"] != here["before"]
        assert len(here["code"]) == 2 and later["code"] == here["code"]  # nothing was compiled again
    assert refused["error"] == "AttributeError: made to fail"
    assert lacking["error"].startswith("ImportError: cannot import name 'CompilerBase' from ")
    assert plain["told"] == []
    # the fault of who calls, or of the sources, changes nothing
    assert wrong["refused"] == ["TypingError", "TypingError", "TypeError", "TypeError"]
    assert (wrong["way"], wrong["told"], wrong["values"]) == (FAST, [], [3.0, 15.0, 3.0])


def told_way(monkeypatch, number, asked=None):
    monkeypatch.setattr(numba, "__version__", number)
    if asked is not None:
        monkeypatch.setenv("DIMERSWEEP_COMPILER", asked)
    else:
        monkeypatch.delenv("DIMERSWEEP_COMPILER", raising=False)
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)
    return first_pipeline()


@pytest.mark.parametrize(
    ("number", "asked", "expected"),
    [
        ("0.61.2", None, "fast"),
        ("0.62.1", None, "fast"),
        ("0.68.1", None, "fast"),
        ("0.69.0rc1", None, "fast"),
        ("1.0.0", None, "fast"),
        ("0.68.1", "plain", "plain"),
        ("0.69.0", "fast", "fast"),
        ("0.68.1", "", "fast"),
    ],
)
def test_no_number_of_a_version_decides(monkeypatch, number, asked, expected):
    assert told_way(monkeypatch, number, asked) == expected


@pytest.mark.parametrize(
    ("number", "asked", "message"),
    [
        ("0.68.1", "quick", "DIMERSWEEP_COMPILER = quick: must be fast or plain"),
    ],
)
def test_what_cannot_be_is_refused(monkeypatch, number, asked, message):
    with pytest.raises(ImportError, match=f"^{message}$"):
        told_way(monkeypatch, number, asked)
