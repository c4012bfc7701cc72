"""Coulomb friction of one time step at two contacts, as impulses, for given normal impulses.

Implicit near zero slip, so that stick is exact whatever the step, and of second order in the step where an end slips.
"""

from math import hypot
from typing import NamedTuple

import numpy as np

from .top import Array, compiled

STUCK = 1e-6  # slip speed that counts as zero at the end of a step, in units of the one without friction
SWEEPS, CLOSE = 500, 1e-13


@compiled
def solve(a, b, c, x, y):
    """Solution of the symmetric 2 x 2 system (a, b; b, c)."""
    det = a * c - b * b
    return (c * x - b * y) / det, (a * y - b * x) / det


@compiled
def sliding(a, b, c, limit, x, y):
    """Speed s and unit vector d of the slip s d = (x, y) - limit G d, G = (a, b; b, c); s = 0 where an impulse holds it.

    The equation |(s + limit G)^-1 (x, y)| = 1 has at most one root s > 0; Newton's method for the reciprocal of its left
    side gets there from below.
    """
    a, b, c, s = limit * a, limit * b, limit * c, 0.0
    dx, dy = solve(a, b, c, x, y)
    size = hypot(dx, dy)
    if size <= 1:
        return 0.0, 0.0, 0.0
    for _ in range(50):
        fx, fy = solve(a + s, b, c + s, dx, dy)
        step = (size - 1) * size * size / (dx * fx + dy * fy)
        s += step
        dx, dy = solve(a + s, b, c + s, x, y)
        size = hypot(dx, dy)
        if step <= 1e-12 * s:
            break
    return s, dx / size, dy / size


@compiled
def impulse_at(a, b, c, limit, x, y, x_0, y_0):
    """Friction impulse at one contact of compliance (a, b; b, c): slip (x, y) without it, (x_0, y_0) before the step."""
    p, q = solve(a, b, c, -x, -y)
    if hypot(p, q) <= limit:
        return p, q
    half, dx, dy = sliding(a, b, c, 0.5 * limit, 0.5 * (x + x_0), 0.5 * (y + y_0))
    if 2 * half <= x_0 * dx + y_0 * dy:  # the slip would stop or turn round: take the direction that it ends with
        _, dx, dy = sliding(a, b, c, limit, x, y)
    return -limit * dx, -limit * dy


@compiled
def sweep(G, w, before, limit, P, v):
    """Solve both contacts in turn until they agree; P are the impulses and v the slips after them, shape (2, 2)."""
    close = CLOSE * max(limit[0], limit[1])
    alone = limit[0] == 0 or limit[1] == 0
    for _ in range(SWEEPS):
        change = 0.0
        for i in range(2):
            j = 1 - i
            p, q = 0.0, 0.0
            if limit[i] > 0:
                x = w[i, 0] + G[i, 0, j, 0] * P[j, 0] + G[i, 0, j, 1] * P[j, 1]
                y = w[i, 1] + G[i, 1, j, 0] * P[j, 0] + G[i, 1, j, 1] * P[j, 1]
                a, b, c = G[i, 0, i, 0], G[i, 0, i, 1], G[i, 1, i, 1]
                p, q = impulse_at(a, b, c, limit[i], x, y, before[i, 0], before[i, 1])
            change = max(change, abs(p - P[i, 0]), abs(q - P[i, 1]))
            P[i, 0], P[i, 1] = p, q
        if alone or change <= close:
            break
    for i in range(2):
        for k in range(2):
            v[i, k] = w[i, k]
            for j in range(2):
                v[i, k] += G[i, k, j, 0] * P[j, 0] + G[i, k, j, 1] * P[j, 1]


class Workspace(NamedTuple):
    """Room for one step; indices: end, then x or y."""

    G: Array  # velocity of each end per impulse at each end, (2, n, 2, n), x, y and perhaps z, kg^-1
    w: Array  # slips at the end of the step if there were no friction, (2, 2), m/s
    before: Array  # slips before the step
    normal: Array  # normal impulses, (2,), N s
    P: Array  # friction impulses, (2, 2): of the step before, and then of this one
    v: Array  # slips after the step
    limit: Array  # largest friction impulses, (2,)
    held: Array  # which ends stick, (2,): before the step, and then after it
    tried: Array  # which ends may stick


@compiled
def clear_desk(n):
    """An empty space, its compliance for n directions."""
    return Workspace(
        np.zeros((2, n, 2, n)), np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)),
        np.zeros(2), np.zeros(2, np.bool_), np.zeros(2, np.bool_),
    )  # fmt: skip


@compiled
def friction(mu, mu_s, space):
    """Find the friction impulses of one step.

    The stick coefficient holds for an end that sticks already or whose slip passes zero.
    """
    G, w, before, normal, P, v, limit, held, tried = space
    for i in range(2):
        passes = before[i, 0] * w[i, 0] + before[i, 1] * w[i, 1] <= 0
        tried[i] = normal[i] > 0 and (held[i] or passes)
    again = True
    while again:
        again = False
        for i in range(2):
            limit[i] = (mu_s if tried[i] else mu) * normal[i]
            if limit[i] == 0:
                P[i, :] = 0.0
        sweep(G, w, before, limit, P, v)
        for i in range(2):
            speed = STUCK * max(hypot(w[i, 0], w[i, 1]), hypot(before[i, 0], before[i, 1]))
            held[i] = normal[i] > 0 and hypot(v[i, 0], v[i, 1]) <= speed
            if tried[i] and not held[i]:
                tried[i], again = False, True
