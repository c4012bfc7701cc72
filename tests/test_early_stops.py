"""What a run tells does not depend on whether it was stopped: every word and every number, over random scenes.

The same of 10,000 scenes: ``benchmarks/evidence/early_stops.py``.
"""

import numpy as np
import pytest

from dimersweep.kernel.model.layout import M_DRIFT, M_REST, MODES
from tests.checks.early_stops import NUMBERS, WITHIN, WORDS, apart, both_ways, scenes

pytestmark = pytest.mark.jit
PERIODS = 150
CORNERS = 1  # runs of some hundred whose word may differ


@pytest.fixture(scope="module", params=[200, pytest.param(1100, marks=pytest.mark.release)])
def both(request):
    rows, _ = scenes(request.param, 7)
    return both_ways(rows, PERIODS)


@pytest.fixture(scope="module")
def far(both):
    return apart(both)


def test_many_runs_of_each_mode_stop_early(both):
    counts = np.bincount(both.stopped["mode"], minlength=len(MODES))
    least = {"rest": 0.18, "drift": 0.036, "jump": 0.09, "flutter": 0.0027, "period_n": 0.018}  # shares of all
    shares = counts / counts.sum()
    assert {mode: shares[MODES.index(mode)] >= few for mode, few in least.items()} == dict.fromkeys(least, True)
    assert counts.sum() == sum(counts[MODES.index(mode)] for mode in least)
    assert both.left.mean() > 0.5 * PERIODS


@pytest.mark.parametrize("name", WORDS)
def test_a_stopped_run_has_the_word_of_the_whole_one(both, far, name):
    """But where a run meets a corner of its family after its stop: the page tells the share."""
    differ = np.flatnonzero(far[name])
    assert differ.size <= CORNERS, [(both.which[k], both.stopped[name][k], both.whole[name][k]) for k in differ]


@pytest.mark.parametrize("name", NUMBERS)
def test_a_stopped_run_has_the_number_of_the_whole_one(both, far, name):
    differ = np.flatnonzero(far[name] > WITHIN)
    assert not differ.size, [(both.which[k], both.stopped[name][k], both.whole[name][k]) for k in differ]


def test_what_a_stopped_run_leaves_out_is_told(both, far):
    told = both.stopped["change_ahead"]
    assert (told < WITHIN).all()
    assert (told[both.stopped["mode"] == M_REST] == 0).all()
    assert (both.whole["change_ahead"] == 0).all()
    assert (both.every["change_ahead"][both.every["n_periods"] == PERIODS] == 0).all()
    drifts = both.stopped["mode"] == M_DRIFT
    for name in ("radius", "period", "speed", "spin"):
        assert (far[name][drifts] <= 1.2 * told[drifts] + 1e-6).all(), name
