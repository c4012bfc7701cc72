"""Where Newton's method begins: the ball's orbit in closed form, a transient from it, the end of a run."""

from collections.abc import Iterator
from dataclasses import replace
from math import acos, cos, sin

import numpy as np

from dimersweep.kernel.model.body import dip_of
from dimersweep.kernel.model.layout import (
    CB,
    D2,
    DIP,
    FREE,
    N2,
    N_STATE,
    PERIOD,
    PHASE,
    ROW_PHI0,
    SPIN,
    STICK,
    WB,
    Dimer,
)
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.orbits.manifold import multipliers_of, slow_direction
from dimersweep.orbits.newton import Fixed
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import SPIN_COORDINATE, OrbitLost, ReturnMap, Tape
from dimersweep.orbits.specials import JOINED
from dimersweep.parameters import dimer_from, value_of
from dimersweep.runs.run import Run

Start = tuple[ReturnMap, np.ndarray]

RUN_IN = 40  # periods in which the fast part of a stable motion settles
SECTION = 0.75 * TURN  # of the guess: well before the double impact, which lies in the first quadrant


def rolled_up(parameters: dict[str, float]) -> float:
    """Axial spin [rad/s] of a lateral start with `xdot0` once friction has set its end rolling.

    The angular momentum about the contact point is kept: m v + J_a s/r = m xdot0, v = r s.
    """
    dm = dimer_from(parameters)
    return parameters["xdot0"] / dm.p1.r / (1 + dm.J_a / (dm.m * dm.p1.r**2))


def pivot_share(dm: Dimer) -> float:
    """Acceleration of p2 over gravity while p1 stays down: m |h_1| l/(J_t + m h_1^2)."""
    return -dm.m * dm.p1.h * dm.l / (dm.J_t + dm.m * dm.p1.h**2)


def ball_state(parameters: dict[str, float], spin: float) -> tuple[np.ndarray, np.ndarray]:
    """Kernel state and friction modes at `SECTION` if p2 were a ball that bounces once a period, and p1 stayed down."""
    e, Gamma = value_of("e_2", parameters), parameters["Gamma"]
    least = np.pi * (1 - e) / (1 + e)
    phase = acos(min(1.0, least / Gamma)) if Gamma > 0 else 0.0
    dm = dimer_from(parameters)
    kappa = pivot_share(dm)
    tau = SECTION - phase
    rate = kappa * (2 * np.pi * e / (1 + e) - tau - Gamma * (cos(phase + tau) - cos(phase)))
    gap = kappa * (
        2 * np.pi * e / (1 + e) * tau - tau**2 / 2 - Gamma * (sin(phase + tau) - sin(phase) - tau * cos(phase))
    )
    v = dm.g / dm.omega
    state = np.zeros(N_STATE)
    state[D2], state[N2], state[SPIN] = max(gap, 0.1) * v / dm.omega, rate * v, spin
    state[DIP] = dip_of(dm, state[D2])
    state[WB] = state[N2] / (dm.l * max(0.1, np.cos(dm.beta_0 + state[DIP])))
    state[CB] = dm.p1.r * spin
    return state, np.array([STICK, FREE], dtype=float)


def settled_on(m: ReturnMap, state: np.ndarray, periods: int) -> tuple[ReturnMap, np.ndarray]:
    """The map at a section of its own, and the point there, after some periods from a state at the section of `m`.

    Raises
    ------
    OrbitLost
        If the kernel cannot go on, or both ends have come to rest on the plate.
    """
    for _ in range(periods // m.periods):
        state[[PHASE, PERIOD]] = 0.0
        state, _, passage = m.tape.run(m.row, state, m.periods, m.rtol)
    if (passage.segments[:, SEGMENT_MODES : SEGMENT_MODES + 2] != FREE).all():
        raise OrbitLost("the motion dies: both ends stay on the plate")
    return m.moved(passage)


def settled_near(at: Fixed, m: ReturnMap, spin: float, most: float = JOINED) -> Iterator[Start]:
    """The motion that a run from a stable orbit settles on at other parameters or another spin, in each of its sections.

    The fast part settles while the spin is put back once a period, whatever the contacts it comes to.

    Parameters
    ----------
    at : Fixed
        The orbit.
    m : ReturnMap
        Of the other parameters, in the section of the orbit.
    spin : float
        After the last impact of a period [rad/s].
    most : float
        How far the motion may be from where the orbit leads, in units of the section.

    Raises
    ------
    OrbitLost
        If the orbit is not stable, or the motion is further off.
    """
    if not (np.abs(multipliers_of(at)[0]) < 1).all():
        raise OrbitLost("the orbit is unstable: no run stays near it")
    along, _ = slow_direction(at)
    state = begin = m.state(at.z + along * (spin - at.image.spin) / m.unit)
    for _ in range(RUN_IN):
        state[PHASE] = 0.0
        state, modes, passage = m.tape.run(m.row, state, m.periods, m.rtol)
        struck = passage.last_impact(passage.bouncer)
        if struck is None:
            raise OrbitLost("the motion dies: nothing strikes the plate")
        there = replace(m, modes=modes)
        z = there.section.point(state)[there.free]
        z[there.slow] += (spin - struck[SPIN]) / there.unit
        state = there.state(z)
    leap = np.delete(np.abs(m.section.point(state) - m.section.point(begin)), SPIN_COORDINATE)
    if leap.max() > most:
        raise OrbitLost("the run leaves for another motion")
    yield from m.sections(passage)


def of_run(
    run: Run, parameters: dict[str, float], periods: int, rtol: float, tape: Tape
) -> tuple[ReturnMap, np.ndarray]:
    """The map and the point that a recorded run has come to; `parameters` may differ from those of the run."""
    record = run.record("guess")
    last = record.segments[-1]
    m = ReturnMap(parameters, record.row[ROW_PHI0], last[SEGMENT_MODES:SEGMENT_HOP_TIME].copy(), periods, rtol, tape)
    return settled_on(m, last[:N_STATE].copy(), periods)


def of_ball(
    parameters: dict[str, float], spin: float, transient: int, periods: int, rtol: float, tape: Tape
) -> tuple[ReturnMap, np.ndarray]:
    """The map and the point of the ball's orbit, after a transient."""
    state, modes = ball_state(parameters, spin)
    m = ReturnMap(parameters, SECTION, modes, periods, rtol, tape)
    state = m.section.held(state, modes)
    return settled_on(m, state, max(transient, 1) * periods)
