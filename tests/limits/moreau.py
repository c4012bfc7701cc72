"""Moreau's time stepping of the dimer: contact at the level of velocities and impulses, no events, no forces.

A step moves freely for half of its length, finds the impulses of the closed contacts that leave no approach and obey
Coulomb's law with the velocities at its end, and moves on with those. It is of first order. Impacts are plastic; it
is meant for stretches of sustained contact, where the law of impact does not matter.
"""

from collections.abc import Mapping, Sequence
from math import hypot

import numpy as np

from tests.oracle.body import dimer

from .friction import clear_desk, friction
from .top import (
    N_STATE,
    VELOCITY,
    Array,
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

AT_REST = 1e-9  # m/s; slip speed that counts as zero at the start
CLOSED = 1e-9  # m; an end no higher than this at the start is on the plate
ROUNDS, CLOSE = 1000, 1e-12


@compiled
def normal_impulses(G, rates, closed, P, normal):
    """Normal impulses, for given friction P, that leave no closed end approaching (a complementarity problem of two)."""
    drive = np.zeros(2)
    for i in range(2):
        drive[i] = rates[i]
        for j in range(2):
            drive[i] += G[i, 2, j, 0] * P[j, 0] + G[i, 2, j, 1] * P[j, 1]
    w_11, w_12, w_22 = G[0, 2, 0, 2], G[0, 2, 1, 2], G[1, 2, 1, 2]
    for i in range(2):
        normal[i] = max(0.0, -drive[i] / G[i, 2, i, 2]) if closed[i] else 0.0
    if closed[0] and closed[1]:
        det = w_11 * w_22 - w_12 * w_12
        n_1, n_2 = (w_12 * drive[1] - w_22 * drive[0]) / det, (w_12 * drive[0] - w_11 * drive[1]) / det
        if n_1 > 0 and n_2 > 0:
            normal[0], normal[1] = n_1, n_2
        elif drive[1] + w_12 * normal[0] >= 0:
            normal[1] = 0.0
        else:
            normal[0] = 0.0


@compiled
def contact(top, state, closed, before, held, space):
    """Find normal and friction impulses in turn until they agree, and apply them; `held` are the ends that stuck before."""
    rates, last, slips = np.zeros(2), np.zeros(2), np.zeros((2, 2))
    compliance(top, state, space.G)
    for i in range(2):
        v = contact_velocity(top, state, i)
        slips[i, 0], slips[i, 1], rates[i] = v[0], v[1], v[2]
    for _ in range(ROUNDS):
        last[:] = space.normal
        normal_impulses(space.G, rates, closed, space.P, space.normal)
        for i in range(2):
            space.before[i] = before[i]
            space.held[i] = held[i] and closed[i]
            for k in range(2):
                space.w[i, k] = (
                    slips[i, k] + space.G[i, k, 0, 2] * space.normal[0] + space.G[i, k, 1, 2] * space.normal[1]
                )
        friction(top.mu, top.mu_s, space)
        if np.abs(space.normal - last).max() <= CLOSE * space.normal.max():
            break
    for i in range(2):
        push(top, state, i, (space.P[i, 0], space.P[i, 1], space.normal[i]))


@compiled
def run(top, state, t, times, dt, samples):
    """March from t to each of `times`, filling `samples`."""
    space, before, closed, held = clear_desk(3), np.zeros((2, 2)), np.zeros(2, np.bool_), np.zeros(2, np.bool_)
    for i in range(2):
        v = contact_velocity(top, state, i)
        closed[i] = gap(top, state, i) <= CLOSED
        held[i] = closed[i] and hypot(v[0], v[1]) <= AT_REST
    for row in range(len(times)):
        steps = max(1, np.ceil((times[row] - t) / dt))
        h = (times[row] - t) / steps
        for step in range(steps):
            for i in range(2):
                v = contact_velocity(top, state, i)
                before[i, 0], before[i, 1] = v[0], v[1]
            fly(top, state, 0.5 * h)
            state[VELOCITY + 2] -= h * gravity(top, t + (step + 0.5) * h)
            for i in range(2):
                closed[i] = closed[i] or gap(top, state, i) <= 0
            contact(top, state, closed, before, held, space)
            for i in range(2):
                held[i] = space.held[i]
                closed[i] = space.normal[i] > 0
            fly(top, state, 0.5 * h)
        t = times[row]
        samples[row] = state


def march(
    parameters: Mapping[str, float], start: float, begin: Sequence[float], times: Sequence[float], dt: float
) -> Array:
    """Simulate one dimer on its plate from a given state.

    Parameters
    ----------
    parameters : mapping
        Names as in `oracle.body.DEFAULTS`.
    start : float
        Time at the start, s.
    begin : (12,) sequence
        State at the start: x1, y1, delta1, theta, beta, gamma and the six rates, SI, delta1 relative to the plate.
    times : sequence of float, shape (n,)
        Ascending times after the start, s.
    dt : float
        Longest time step, s.

    Returns
    -------
    (n, 12) array
        The states.
    """
    d, begin = dimer(parameters), np.asarray(begin, dtype=float)
    samples = np.zeros((len(times), N_STATE))
    run(top_of(d), state_of(d, begin[:6], begin[6:]), start, np.asarray(times, dtype=float), dt, samples)
    return np.array([coordinates_of(d, state) for state in samples])
