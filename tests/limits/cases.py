"""Impacts and stretches of sustained contact in which the engine is compared with its limits, and the errors there."""

from collections.abc import Iterable, Mapping
from math import pi
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.model.layout import N1, N2, OK
from tests.checks.data import data
from tests.checks.scenes import difference, engine_states
from tests.checks.verbs import collide_double, collide_single, oracle_state, scratch, state_of
from tests.checks.verbs import dimer as kernel_dimer
from tests.oracle.body import dimer

from . import hertz, moreau
from .top import Array

TOL = 1e-11  # of the engine's impacts and runs


class Impact(NamedTuple):
    """Parameters, and the velocities of the contact points before: gap rates, axial slips, lateral slips; the axial spin.

    With beta = 0 both ends are closed (and their axial slips the same); else end 1 is.
    """

    parameters: Mapping[str, float]
    n: tuple[float, float]
    a: float
    b: tuple[float, float]
    spin: float
    beta: float = 0.0


class Stretch(NamedTuple):
    """A run, and the times between which both limits and engine follow it."""

    parameters: Mapping[str, float]
    start: float
    end: float


IMPACTS = {name: Impact(**case) for name, case in data("scenes")["impacts"].items()}
STRETCHES = {name: Stretch(**case) for name, case in data("scenes")["stretches"].items()}


def coordinates(impact: Impact) -> tuple[Array, Array]:
    """The coordinates of the paper and their rates before an impact; theta = 0, where the heading is y."""
    d = dimer(impact.parameters)
    q, qdot = np.zeros(6), np.zeros(6)
    q[4] = impact.beta
    sin_b, cos_b = np.sin(impact.beta), np.cos(impact.beta)
    beta_rate = (impact.n[1] - impact.n[0]) / (d.l * cos_b)
    # b_2 - b_1 = -l cos(beta) theta', by the sixth and fourth rows of N
    theta_rate = (impact.b[0] - impact.b[1]) / (d.l * cos_b)
    gamma_rate = impact.spin - theta_rate * sin_b
    qdot[:] = (
        impact.b[0] + d.r[0] * cos_b * gamma_rate, impact.a - d.r[0] * beta_rate, impact.n[0], theta_rate, beta_rate, gamma_rate
    )  # fmt: skip
    return q, qdot


def engine_impact(parameters: Mapping[str, float], q: Array, qdot: Array, tol: float = TOL) -> Array:
    """Rates after an impact by the engine's own verbs."""
    dm = kernel_dimer(**parameters)
    state, (work, log) = state_of(dm, q, qdot), scratch()
    speed = -float(min(state[N1], state[N2] if q[4] == 0 else 0.0))
    if q[4] == 0:
        status, _ = collide_double(dm, state, speed, tol, np.zeros(2), work, log)
    else:
        status = collide_single(dm, state, -1.0, speed, tol, work, log)[0]
    assert status == OK
    return oracle_state(dm, state)[1]


def apart(parameters: Mapping[str, float], q: Array, qdot: Array, after: Array, expected: Array) -> float:
    """Largest difference of two sets of rates, as speeds of points of the body, in units of the approach speed."""
    d = dimer(parameters)
    second = qdot[2] + d.l * qdot[4] if q[4] == 0 else 0.0
    return float(np.abs((after - expected) * [1, 1, 1, d.l, d.l, d.r[0]]).max() / -min(qdot[2], second))


def impact_errors(impact: Impact, stiffnesses: Iterable[float], steps: int) -> Array:
    """Differences of the springs to the engine, in units of the approach speed, with `steps` time steps a contact time."""
    q, qdot = coordinates(impact)
    expected = engine_impact(impact.parameters, q, qdot)
    d, speed = dimer(impact.parameters), -min(impact.n)
    errors = []
    for k in stiffnesses:
        after = hertz.impact(impact.parameters, q, qdot, k, hertz.contact_time(d, k, speed) / steps)
        errors.append(apart(impact.parameters, q, qdot, after, expected))
    return np.array(errors)


def stretch_errors(stretch: Stretch, steps: Iterable[float]) -> Array:
    """Largest differences of Moreau's time stepping to the engine, in the scales of the state, over time steps [s]."""
    times = np.linspace(stretch.start, stretch.end, 6)
    expected, _ = engine_states({"f": 15.0, **stretch.parameters}, times, TOL)
    marched = [moreau.march(stretch.parameters, stretch.start, expected[0], times[1:], dt) for dt in steps]
    return np.array([difference(states, expected[1:]) for states in marched])


def run_errors(parameters: Mapping[str, float], times: Array, stiffnesses: Iterable[float], steps: int) -> Array:
    """Differences of whole runs with springs to the engine, one row a stiffness: at each time, and of the first double impact.

    States in their scales; the time of the impact in forcing periods.
    """
    d = dimer(parameters)
    expected, first = engine_states({"f": 15.0, **parameters}, times, TOL)
    errors = []
    for k in stiffnesses:
        states, double = hertz.march(parameters, times, k, hertz.contact_time(d, k, 0.5) / steps)
        late = abs(double[0] - first[0]) * d.omega / (2 * pi)
        errors.append([*(difference(s[None], x[None]) for s, x in zip(states, expected, strict=True)), late])
    return np.array(errors)


def order(x: Array, errors: Array) -> float:
    """Exponent of the power law fitted to errors over x."""
    return float(np.polyfit(np.log(x), np.log(errors), 1)[0])
