"""A dimer that lies flat and lands flat leaves flat, with the restitution of a single ball."""

import numpy as np
import pytest

from dimersweep import simulate

pytestmark = pytest.mark.jit


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11, 1e-12])
def test_flat_landing(rtol):
    e = 0.54
    events = simulate(e=e, Gamma=1.28, f=16.07, A_r=4.78, beta0=0.13, periods=4, rtol=rtol).events
    first = np.flatnonzero(events["time"].values * 16.07 > 3.5)[0]  # it has rested flat, and the plate has thrown it
    last = np.flatnonzero(events["time"].values == events["time"].values[first])[-1]
    for end in ("gap_1_rate", "gap_2_rate"):
        out, into = events[f"{end}_after"].values[last], events[f"{end}_before"].values[first]
        assert out == pytest.approx(-e * into, rel=1e-6)


@pytest.mark.parametrize("xdot0", [0.0, 0.3])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11])
def test_a_flat_dimer_stays_flat(xdot0, rtol):
    """Its ends move alike to the last digit, through bounces, chatter and the slip of both."""
    run = simulate(e=0.6, Gamma=1.2, phi0=1.0, beta0=0.0, xdot0=xdot0, periods=10, rtol=rtol)
    assert run.status == "ok"
    assert not run.events["beta"].values.any()
    rates = [run.events[f"gap_{end}_rate_after"].values for end in (1, 2)]
    np.testing.assert_allclose(*rates, rtol=1e-15)
