"""Molecular dynamics of the dimer: Hertz springs that give back e^2 of the work of compression, and Coulomb friction.

Each end has a spring of force k X^(3/2). Its elastic compression X grows by the descent of the end into the plate and
shrinks 1/e^2 times as fast as the end rises: every restitution returns e^2 of the stored energy. With dP = k X^(3/2) dt
this is the impact law (5)-(7) of the paper, in time and with a finite stiffness; the ratio of the normal forces is its
Lambda = (E_i/E_j)^(3/5). What is left of the dent when the force ends (for e < 1 the end is still below the plate's
level then) fills up as the end rises.

A spring alone would ring for ever under a resting end, and sink a little with every swing. A dashpot damps that; its
force is never more than the dimer's weight, so that in an impact it is as small as gravity.

The step is a position Verlet step, with the friction of `friction`: of second order between the switches.
"""

from collections.abc import Mapping, Sequence
from math import ceil, hypot, pi, sqrt

import numpy as np

from tests.oracle.body import Dimer, dimer

from .friction import clear_desk, friction
from .top import (
    N_STATE,
    VELOCITY,
    compiled,
    compliance,
    contact_velocity,
    coordinates_of,
    fly,
    gap,
    gravity,
    push,
    state_of,
    top_of,
)

DAMPING = 0.7  # of an end at rest, in units of the critical one
AT_REST = 1e-9  # m/s; slip speed that counts as zero at the start
LONGEST = 4_000_000_000  # steps after which an isolated impact is given up


@compiled
def compressed(X, before, after, e):
    """Elastic compression after the gap has gone from `before` to `after`."""
    down = before - after
    if down >= 0:
        return X + min(down, max(0.0, -after))
    return max(0.0, X + down / (e * e)) if e > 0 else 0.0


@compiled
def drift(top, state, X, e, gaps, h):
    """Move freely over a time h, carrying the springs along; `gaps` are those of the state before, and then after."""
    fly(top, state, h)
    for i in range(2):
        after = gap(top, state, i)
        X[i] = compressed(X[i], gaps[i], after, e[i])
        gaps[i] = after


@compiled
def kick(top, state, X, k, dashpot, weight, h, space):
    """Change the velocities by the forces of a time h: springs, dashpots, gravity (`weight`), and friction."""
    _, w, before, normal, P, _, _, held, _ = space
    for i in range(2):
        v = contact_velocity(top, state, i)
        before[i, 0], before[i, 1] = v[0], v[1]
        damped = min(max(dashpot * v[2], -weight), weight)
        normal[i] = h * max(0.0, k * X[i] * sqrt(X[i]) - damped) if X[i] > 0 else 0.0
        held[i] = held[i] and normal[i] > 0
    state[VELOCITY + 2] -= h * weight / top.m
    if normal[0] == 0 and normal[1] == 0:
        return
    for i in range(2):
        push(top, state, i, (0.0, 0.0, normal[i]))
    if top.mu == 0 and top.mu_s == 0:
        return
    for i in range(2):
        v = contact_velocity(top, state, i)
        w[i, 0], w[i, 1] = v[0], v[1]
    compliance(top, state, space.G)
    friction(top.mu, top.mu_s, space)
    for i in range(2):
        push(top, state, i, (P[i, 0], P[i, 1], 0.0))


@compiled
def begin(top, state, gaps, space):
    """Note the gaps, and which ends stick to begin with."""
    for i in range(2):
        v = contact_velocity(top, state, i)
        gaps[i] = gap(top, state, i)
        space.held[i] = hypot(v[0], v[1]) <= AT_REST


@compiled
def note_landings(was, gaps, now, length, landings, n):
    """Add the times when an end came down beside the other in the last `length` of time; return how many there are now."""
    for i in range(2):
        if was[i] > 0 and gaps[i] <= 0 and gaps[1 - i] <= 0:
            if n < len(landings):
                landings[n] = now - length * gaps[i] / (gaps[i] - was[i])
            n += 1
    return n


@compiled
def run(top, state, e, k, dashpot, times, dt, samples, landings):
    """March to each of `times`; fill `samples`, and `landings` with the times when an end comes down beside the other.

    Returns how many landings there were (more than fit are counted only).
    """
    X, gaps, space = np.zeros(2), np.zeros(2), clear_desk(2)
    was = np.zeros(2)
    begin(top, state, gaps, space)
    t, n_landings = 0.0, 0
    for row in range(len(times)):
        steps = max(1, ceil((times[row] - t) / dt))
        start, h = t, (times[row] - t) / steps
        for step in range(steps + 1):
            length = 0.5 * h if step == 0 or step == steps else h
            was[:] = gaps
            drift(top, state, X, e, gaps, length)
            now = start + min(step + 0.5, steps + 0.0) * h
            n_landings = note_landings(was, gaps, now, length, landings, n_landings)
            if step < steps:
                weight = top.m * gravity(top, start + (step + 0.5) * h)
                kick(top, state, X, k, dashpot, weight, h, space)
        t = times[row]
        samples[row] = state
    return n_landings


@compiled
def collide(top, state, e, k, dt):
    """March through an isolated impact without gravity; return how many steps it took."""
    X, gaps, space = np.zeros(2), np.zeros(2), clear_desk(2)
    begin(top, state, gaps, space)
    for step in range(LONGEST):
        acting = X[0] > 0 or X[1] > 0
        for i in range(2):
            acting = acting or (gaps[i] <= 0 and contact_velocity(top, state, i)[2] < 0)
        if not acting:
            return step
        drift(top, state, X, e, gaps, 0.5 * dt)
        kick(top, state, X, k, 0.0, 0.0, dt, space)
        drift(top, state, X, e, gaps, 0.5 * dt)
    return LONGEST


def contact_time(d: Dimer, stiffness: float, speed: float) -> float:
    """Time scale (m^2/(k^2 V))^(1/5) of an impact with approach speed V, s; the impact takes about twice as long."""
    return (d.m**2 / (stiffness**2 * speed)) ** 0.2


def dashpot_of(d: Dimer, stiffness: float) -> float:
    """Dashpot that damps one end at rest under half of the weight by `DAMPING`, N s/m."""
    rest = (0.5 * d.m * d.g / stiffness) ** (2 / 3)
    return DAMPING * 2 * sqrt(0.5 * d.m * 1.5 * stiffness * sqrt(rest))


def march(
    parameters: Mapping[str, float], times: Sequence[float], stiffness: float, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate one dimer on its plate from its release, with springs.

    Parameters
    ----------
    parameters : mapping
        Names as in `oracle.body.DEFAULTS`, and e_1, e_2 where the two ends differ.
    times : sequence of float, shape (n,)
        Ascending times, s.
    stiffness : float
        k of the force k X^(3/2), N/m^1.5; about 1e10 for a steel ball of 5 mm.
    dt : float
        Longest time step, s; at most a tenth of `contact_time` at the highest approach speed.

    Returns
    -------
    states : (n, 12) array
        x1, y1, delta1, theta, beta, gamma and the six rates, SI, delta1 relative to the plate.
    double_impacts : (m,) array
        Times when one end lands while the other is on the plate, s.
    """
    d = dimer(parameters)
    q, qdot = np.zeros(6), np.zeros(6)
    q[4], qdot[0] = parameters.get("beta0", 4 * pi / 45), parameters.get("xdot0", 1.0)
    qdot[2] = -d.A[0, 2] * d.omega * np.cos(d.phi[0, 2])  # at rest in space, on the moving plate
    samples, landings = np.zeros((len(times), N_STATE)), np.zeros(10_000)
    n = run(
        top_of(d), state_of(d, q, qdot), np.array(d.e), stiffness, dashpot_of(d, stiffness),
        np.asarray(times, dtype=float), dt, samples, landings,
    )  # fmt: skip
    return np.array([coordinates_of(d, state) for state in samples]), landings[:n]


def impact(
    parameters: Mapping[str, float], q: Sequence[float], qdot: Sequence[float], stiffness: float, dt: float
) -> np.ndarray:
    """Velocities after an isolated impact, without gravity.

    Parameters
    ----------
    parameters : mapping
        As for `march`.
    q, qdot : (6,) sequences
        x1, y1, delta1, theta, beta, gamma and their rates before. An end takes part if its gap is zero.
    stiffness, dt : float
        As for `march`.

    Returns
    -------
    (6,) array
        The rates after.
    """
    d = dimer(parameters)
    state = state_of(d, np.asarray(q, dtype=float), np.asarray(qdot, dtype=float))
    if collide(top_of(d), state, np.array(d.e), stiffness, dt) == LONGEST:
        raise RuntimeError("the impact does not end")
    return coordinates_of(d, state)[6:]
