"""Cases in which event-driven codes fail, each with the reason why, at three accuracies.

Most are compared with a closed form; all must end, sink nowhere and gain no energy from nothing (``examine``).
"""

import os
from math import asin, cos, pi, sin, sqrt

import numpy as np
import pytest
from launch import launch
from mpmath import mp, mpf
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from verbs import as_dimer, collide_double, desk, dimer, kinetic_energy, row_of

from examine import examine, lies
from dimersweep import simulate
from dimersweep.kernel.layout import (
    BETA, C_IMPACT, C_LIFT_OFF, C_SLIP, C_STICK, CA, CB, CONTACT_STATES, D1, D2, FREE, N1, N2, N_STATE, OK, PERIOD, PHASE,
    SLIP, SPIN, STICK, THETA, WB, WP,
)  # fmt: skip

RTOLS = (1e-6, 1e-8, 1e-11)
accuracies = pytest.mark.parametrize("rtol", RTOLS)


def honest(rtol, periods, **parameters):
    """Examination of a run that must be ok and show nothing wrong."""
    look = examine(row_of(**parameters), periods, rtol)
    assert (look["status"], lies(look)) == ("ok", []), look
    return look


def lifted(dm, beta, height, **rates):
    """A free state: p1 at a height above the plate, the rod at an angle; `rates` by the names of the slots."""
    state = np.zeros(N_STATE)
    state[BETA], state[D1], state[D2] = beta, height, height + 2 * dm.h * sin(beta)
    slots = {"wb": WB, "wp": WP, "spin": SPIN, "ca": CA, "cb": CB, "theta": THETA}
    for name, value in rates.items():
        if name != "c_n":
            state[slots[name]] = value
    spread = dm.h * cos(beta) * state[WB]
    state[N1], state[N2] = rates.get("c_n", 0.0) - spread, rates.get("c_n", 0.0) + spread
    return state


def standing(dm, beta, **rates):
    """A state in which p1 stands on the plate, its gap and gap rate zero."""
    return lifted(dm, beta, 0.0, c_n=dm.h * cos(beta) * rates.get("wb", 0.0), **rates)


def launched(dm_row, state, periods, rtol):
    """A launch that must be ok and show nothing wrong."""
    run = launch(dm_row, state, periods, rtol)
    assert (run.status, lies(run.look())) == ("ok", []), run.look()
    return run


def causes(run):
    return run.column("cause")


# --- the intensity at which the plate just carries no weight ------------------------------------------------------------


@accuracies
@pytest.mark.parametrize("phi0", [0.0, 0.5 * pi, 4.0])
def test_at_gamma_1_a_plastic_dimer_never_leaves_the_plate(rtol, phi0):
    """The normal force touches zero once a period and is positive on either side: a lift-off there would be a lie."""
    run = simulate(Gamma=1.0, beta0=0.0, e=0.0, phi0=phi0, xdot0=0.0, periods=5, rtol=rtol)
    assert run.status == "ok"
    assert not (run.events["cause"] == "lift_off").any()
    states = run.states(np.linspace(0, 5 / 15, 301))
    assert not states["gap_1"].values.any()
    assert not states["gap_2"].values.any()


def hop_phases(excess):
    """Plate phases at which a body at rest leaves a plate of intensity 1 + excess, and lands again (50 digits)."""
    mp.dps = 50
    Gamma = 1 + mpf(excess)
    off = mp.asin(1 / Gamma)
    gap = lambda s: Gamma * (mp.sin(off) - mp.sin(off + s)) + Gamma * mp.cos(off) * s - s * s / 2  # noqa: E731
    guess = 6 * mp.cot(off) / 2  # the cubic and the quartic term of the gap balance about here
    return off, off + mp.findroot(gap, (guess, 2 * guess), solver="secant", tol=1e-60)


@accuracies
@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6, 1e-9])
def test_just_above_gamma_1_it_hops_as_high_as_the_plate_throws_it(rtol, excess):
    """The hop is of third order in time: 1e-9 above, it lasts 1e-4 of a period and is 1e-18 periods^2 g high."""
    row = row_of(Gamma=1.0 + excess, beta0=0.0, e=0.0, xdot0=0.0)
    run = launched(row, standing(as_dimer(row), 0.0), 1, rtol)
    off, on = hop_phases(excess)
    phases = run.column("phase")
    assert phases[causes(run) == C_LIFT_OFF][0] == pytest.approx(float(off), abs=2e-8)
    assert phases[causes(run) == C_IMPACT][0] == pytest.approx(float(on), abs=1e-7)
