"""Coulomb friction of one time step at two contacts, as impulses, for given normal impulses.

Implicit near zero slip, so that stick is exact whatever the step, and of second order in the step where an end slips.
"""

from math import hypot

import numpy as np

from .top import compiled

AT_REST = 1e-9  # m/s; slip speed that counts as zero when an end comes down
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

    The equation |(s + limit G)^-1 (x, y)| = 1 has at most one root s > 0; Newton's method for its reciprocal gets
    there from below.
    """
    a, b, c, s = limit * a, limit * b, limit * c, 0.0
    for _ in range(50):
        dx, dy = solve(a + s, b, c + s, x, y)
        size = hypot(dx, dy)
        if s == 0 and size <= 1:
            return 0.0, 0.0, 0.0
        fx, fy = solve(a + s, b, c + s, dx, dy)
        step = (size - 1) * size * size / (dx * fx + dy * fy)
        s += step
        if step <= 1e-14 * s:
            break
    return s, dx / size, dy / size


@compiled
def impulse_at(a, b, c, limit, x, y, x_0, y_0):
    """Friction impulse at one contact of compliance (a, b; b, c) with slip (x, y) without it, and (x_0, y_0) before the step."""
    s, dx, dy = sliding(a, b, c, limit, x, y)
    if s == 0:
        return solve(a, b, c, -x, -y)
    half, mx, my = sliding(a, b, c, 0.5 * limit, 0.5 * (x + x_0), 0.5 * (y + y_0))
    if half > 0 and 2 * half > x_0 * mx + y_0 * my:  # the slip keeps its sense: take its direction from the midpoint
        dx, dy = mx, my
    return -limit * dx, -limit * dy


@compiled
def sweep(G, w, before, limit, P, v):
    """Solve both contacts in turn until they agree; P are the impulses and v the slips after them, shape (2, 2)."""
    size = max(limit[0], limit[1])
    for _ in range(SWEEPS):
        change = 0.0
        for i in range(2):
            j = 1 - i
            x = w[i, 0] + G[i, 0, j, 0] * P[j, 0] + G[i, 0, j, 1] * P[j, 1]
            y = w[i, 1] + G[i, 1, j, 0] * P[j, 0] + G[i, 1, j, 1] * P[j, 1]
            p, q = 0.0, 0.0
            if limit[i] > 0:
                a, b, c = G[i, 0, i, 0], G[i, 0, i, 1], G[i, 1, i, 1]
                p, q = impulse_at(a, b, c, limit[i], x, y, before[i, 0], before[i, 1])
            change = max(change, abs(p - P[i, 0]), abs(q - P[i, 1]))
            P[i, 0], P[i, 1] = p, q
        if change <= CLOSE * size:
            break
    for i in range(2):
        for k in range(2):
            v[i, k] = w[i, k]
            for j in range(2):
                v[i, k] += G[i, k, j, 0] * P[j, 0] + G[i, k, j, 1] * P[j, 1]


@compiled
def friction(mu, mu_s, G, w, before, normal, held, P):
    """Friction impulses of one step.

    Parameters
    ----------
    mu, mu_s : float
        Slip and stick coefficients.
    G : (2, 3, 2, 3) array
        Compliance of the contacts (x, y, z).
    w, before : (2, 2) arrays
        Slips at the end of the step without friction, and before the step.
    normal : (2,) array
        Normal impulses.
    held : (2,) array of bool
        Which ends stick, before the step and, when it returns, after it. The stick coefficient holds for an end that
        sticks already, or whose slip passes zero.
    P : (2, 2) array
        Guess of the impulses; when it returns, the impulses.
    """
    try_hold, limit, v = np.zeros(2, np.bool_), np.zeros(2), np.zeros((2, 2))
    for i in range(2):
        passes = before[i, 0] * w[i, 0] + before[i, 1] * w[i, 1] <= 0
        try_hold[i] = normal[i] > 0 and (held[i] or passes or hypot(before[i, 0], before[i, 1]) <= AT_REST)
    again = True
    while again:
        again = False
        for i in range(2):
            limit[i] = (mu_s if try_hold[i] else mu) * normal[i]
        sweep(G, w, before, limit, P, v)
        for i in range(2):
            speed = STUCK * max(hypot(w[i, 0], w[i, 1]), hypot(before[i, 0], before[i, 1]))
            held[i] = normal[i] > 0 and hypot(v[i, 0], v[i, 1]) <= speed
            if try_hold[i] and not held[i]:
                try_hold[i], again = False, True
