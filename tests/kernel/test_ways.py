"""The kernel answers alike whichever way it is compiled, and on every version of the packages that it may have."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from dimersweep.kernel.compiler import versions
from tests.kernel import ways

HERE = Path(__file__).parent


def answers_of(way, folder):
    """The answers of the kernel compiled in one way, from a process of its own."""
    file = folder / f"{way}.npz"
    environment = os.environ | {"DIMERSWEEP_COMPILER": way, "PYTHONPATH": str(HERE.parents[1])}
    subprocess.run([sys.executable, str(HERE / "ways.py"), str(file)], env=environment, check=True)
    found = np.load(file)
    assert found["way"] == way
    return found["codes"], found["states"]


@pytest.mark.jit
@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("DIMERSWEEP_SLOW"), reason="a minute each: set DIMERSWEEP_SLOW=1")
def test_fast_and_plain_answer_alike(tmp_path):
    (codes, states), (other_codes, other_states) = (
        answers_of(way, tmp_path) for way in (versions.FAST, versions.PLAIN)
    )
    np.testing.assert_array_equal(other_codes, codes)
    np.testing.assert_allclose(other_states, states, rtol=0, atol=10 * ways.RTOL)


def told_way(monkeypatch, number, asked=None):
    monkeypatch.setattr(numba, "__version__", number)
    if asked is not None:
        monkeypatch.setenv("DIMERSWEEP_COMPILER", asked)
    else:
        monkeypatch.delenv("DIMERSWEEP_COMPILER", raising=False)
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)
    return versions.way.__wrapped__()


@pytest.mark.parametrize(
    ("number", "asked", "expected"),
    [
        ("0.62.1", None, "fast"),
        ("0.68.1", None, "fast"),
        ("0.69.0rc1", None, "plain"),
        ("1.0.0", None, "plain"),
        ("0.68.1", "plain", "plain"),
        ("0.69.0", "fast", "fast"),
        ("0.68.1", "", "fast"),
    ],
)
def test_the_fast_way_is_for_versions_it_was_tested_with(monkeypatch, number, asked, expected):
    assert told_way(monkeypatch, number, asked) == expected


@pytest.mark.parametrize(
    ("number", "asked", "message"),
    [
        ("0.61.2", None, "numba = 0.61.2: must be >= 0.62.1"),
        ("0.62.0", None, "numba = 0.62.0: must be >= 0.62.1"),
        ("0.68.1", "quick", "DIMERSWEEP_COMPILER = quick: must be fast or plain"),
    ],
)
def test_what_cannot_be_is_refused(monkeypatch, number, asked, message):
    with pytest.raises(ImportError, match=f"^{message}$"):
        told_way(monkeypatch, number, asked)
