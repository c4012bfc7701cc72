"""Whole runs against the slow oracle: its stored runs always, live ones where DIMERSWEEP_SLOW is set."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests import oracle
from tests.checks.scenes import difference, engine_states, random_scene, sample_times, wider_scene

pytestmark = pytest.mark.jit

SMALL = json.loads((Path(__file__).parents[1] / "reference" / "small.json").read_text())
CASES = {case["name"]: case for case in SMALL["cases"]}
# accuracies of the engine, and what the states must then keep in the scales of the reference
PROMISES = [(1e-10, 1e-6), (1e-8, 1e-4)]


@pytest.mark.parametrize("name", CASES)
def test_stored_runs(name):
    case = CASES[name]
    samples = np.array(case["samples"])
    for rtol, promise in PROMISES:
        states, _ = engine_states(case["params"], samples[:, 0], rtol)
        assert difference(states, samples[:, 1:]) < promise
    _, double = engine_states(case["params"], samples[:, 0], 1e-10)
    expected = case["t_double"]
    np.testing.assert_allclose(double[: len(expected)], expected, rtol=0, atol=1e-7)


def test_stored_runs_are_the_scenes_that_matter():
    """A stored run whose own uncertainty is near the promise, or without a double impact, would show nothing."""
    assert max(case["spread"] for case in CASES.values()) < 0.1 * PROMISES[0][1]
    assert sum(len(case["t_double"]) > 0 for case in CASES.values()) >= 10


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("DIMERSWEEP_SLOW"), reason="an hour: set DIMERSWEEP_SLOW=1")
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("drawn", [random_scene, wider_scene])
def test_random_scenes(drawn, seed):
    scene = drawn(seed)
    times = sample_times(scene)
    expected = oracle.simulate(scene, times, rtol=1e-10, v_rest=1e-10)
    assert expected["status"] == "done"
    for rtol, promise in PROMISES:
        states, _ = engine_states(scene, times, rtol)
        assert difference(states, expected["samples"][:, 1:]) < promise
