"""Accuracy of impacts in a run: that of its fastest motion so far."""

import numpy as np
import pytest

from dimersweep import simulate
from dimersweep.kernel.model.body import dimer_of
from dimersweep.parameters import Parameters

ENDS = {"e_1": 0.5, "e_2": 0.8, "r_1": 5e-3, "r_2": 5.2e-3, "mu": 0.2, "mu_s": 0.2, "Gamma": 0.0}
LEVEL = float(dimer_of(Parameters(**ENDS).row()).beta_0)
AFTER = ("gap_1_rate_after", "gap_2_rate_after", "slip_1_a", "slip_1_b", "slip_2_b")


def first_impact(gap0, beta0, rtol):
    """Velocities after the first impact of a drop from `gap0`, with a slip that goes with it, over that of the landing."""
    v = np.sqrt(2 * 9.81 * gap0)
    events = simulate(**ENDS, gap0=gap0, beta0=beta0, xdot0=1.3 * v, ydot0=-0.4 * v, periods=1, rtol=rtol).events
    impacts = np.flatnonzero(events["cause"].values == "impact")
    times = events["time"].values[impacts]
    last = impacts[times == times[0]][-1]
    return np.array([events[name].values[last] for name in AFTER]) / v


@pytest.mark.jit
@pytest.mark.parametrize("beta0", [LEVEL, 0.4], ids=["both ends", "one end"])
@pytest.mark.parametrize("gap0", [1e-6, 1e-10, 1e-14])
def test_an_impact_of_a_motion_that_was_always_slow_is_as_exact_as_any(gap0, beta0):
    """The law of impact knows no speed: all velocities after it grow in proportion to those before."""
    exact = first_impact(1e-6, beta0, 1e-12)
    np.testing.assert_allclose(first_impact(gap0, beta0, 1e-9), exact, rtol=0, atol=2e-10)
