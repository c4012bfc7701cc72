"""A dimer that lies flat and lands flat leaves flat, with the restitution of a single ball."""

import numpy as np
import pytest

from dimersweep import simulate

pytestmark = pytest.mark.jit


@pytest.mark.parametrize(
    "rtol",
    [
        1e-8,
        pytest.param(
            1e-12,
            marks=pytest.mark.xfail(
                strict=True,
                reason="both gap rates vanish in the same rounding, and one end is not turned to restitution",
            ),
        ),
    ],
)
def test_flat_landing(rtol):
    e = 0.54
    events = simulate(e=e, Gamma=1.28, f=16.07, A_r=4.78, beta0=0.13, periods=4, rtol=rtol).events
    first = np.flatnonzero(events["time"].values * 16.07 > 3.5)[0]  # it has rested flat, and the plate has thrown it
    last = np.flatnonzero(events["time"].values == events["time"].values[first])[-1]
    for end in ("gap_1_rate", "gap_2_rate"):
        out, into = events[f"{end}_after"].values[last], events[f"{end}_before"].values[first]
        assert out == pytest.approx(-e * into, rel=1e-6)
