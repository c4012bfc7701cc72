"""An explicit integrator with switches for impacts: DOP853 with the coefficients of scipy, compiled with Numba.

Equations `rates(law, switches, z, out)` are followed until one of the `gauges(law, switches, z, out)` that has been positive
falls to zero. All arrays are rows of one space.
"""

from math import inf, sqrt

import numpy as np
from mechanics import compiled
from scipy.integrate import DOP853

A, B, E3, E5 = (np.ascontiguousarray(each) for each in (DOP853.A, DOP853.B, DOP853.E3, DOP853.E5))
STAGES = B.size  # slopes of a step; the next row has that of the new state
STATE, ARG, OUT, VALUES, AHEAD, ARMED, SWITCHES = range(STAGES + 1, STAGES + 8)  # rows of the space, after the slopes
SPACE = SWITCHES + 1, 8
MAX_STEPS, MAX_PROBES = 20_000, 60
NEAR, NEAREST = 1e-3, 1e-15  # how near to zero a switch is located: in tolerances, and at best
SLIGHT = 1e-7  # part of a step over which the slope of a gauge is taken


@compiled
def step(rates, law, h, n, space):
    """Make one step from the state, whose slopes are row 0, to the row OUT; return its error over the tolerance."""
    state, arg, out, switches = space[STATE], space[ARG], space[OUT], space[SWITCHES]
    for i in range(1, STAGES):
        for k in range(n):
            arg[k] = state[k]
        for j in range(i):
            share = h * A[i, j]
            if share != 0.0:
                for k in range(n):
                    arg[k] += share * space[j, k]
        rates(law, switches, arg, space[i])
    sum5 = sum3 = 0.0
    for k in range(n):
        total = e5 = e3 = 0.0
        for j in range(STAGES):
            total += B[j] * space[j, k]
            e5 += E5[j] * space[j, k]
            e3 += E3[j] * space[j, k]
        out[k] = state[k] + h * total
        sum5 += e5 * e5
        sum3 += e3 * e3
    if sum5 == 0.0:
        return 0.0
    return h * sum5 / sqrt((sum5 + 0.01 * sum3) * n) / law.tol


@compiled
def least(gauges, law, n_g, space):
    """Return the least of the gauges that were positive at the start of the step, now after it, and its number."""
    gauges(law, space[SWITCHES], space[OUT], space[VALUES])
    lowest, which = inf, 0
    for k in range(n_g):
        if space[ARMED, k] > 0.0 and space[VALUES, k] < lowest:
            lowest, which = space[VALUES, k], k
    return lowest, which


@compiled
def near(tol):
    """Return what is zero for a gauge."""
    return max(NEAREST, NEAR * tol)


@compiled
def gauge_at(rates, gauges, law, row, which, h, n, space):
    """Return a gauge and its slope there where `row` has the state; the slope is a difference over a slight part of h."""
    values, switches = space[AHEAD], space[SWITCHES]
    gauges(law, switches, space[row], values)
    value = values[which]
    rates(law, switches, space[row], space[STAGES])
    for k in range(n):
        space[ARG, k] = space[row, k] + SLIGHT * h * space[STAGES, k]
    gauges(law, switches, space[ARG], values)
    return value, (values[which] - value) / (SLIGHT * h)


@compiled
def zero_of(x_0, g_0, s_0, x_1, g_1, s_1):
    """Return where a falling gauge is zero, by the inverse cubic through two values and slopes; if one is level, by Newton."""
    if s_0 >= 0.0 or s_1 >= 0.0:
        return x_1 - g_1 / s_1
    rise = g_1 - g_0
    u = -g_0 / rise
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * x_0 + u * rise / s_0) + u * u * ((3.0 - 2.0 * u) * x_1 - v * rise / s_1)


@compiled
def locate(rates, gauges, law, h, n, n_g, space):
    """Repeat the step of length h with other lengths until the first gauge falls just to zero."""
    low, high, x, last = 0.0, h, h, -1
    for probe in range(MAX_PROBES):
        g, which = least(gauges, law, n_g, space)
        if abs(g) <= near(law.tol) or high - low <= NEAREST * high:
            return
        low, high = (x, high) if g > 0.0 else (low, x)
        if which != last:
            last, x_0 = which, 0.0
            g_0, s_0 = gauge_at(rates, gauges, law, STATE, which, h, n, space)
        g, s = gauge_at(rates, gauges, law, OUT, which, h, n, space)
        guess = zero_of(x_0, g_0, s_0, x, g, s)
        x_0, g_0, s_0 = x, g, s
        x = guess if low < guess < high and probe % 4 < 3 else 0.5 * (low + high)
        step(rates, law, x, n, space)


@compiled
def march(rates, gauges, law, h, n, n_g, space):
    """Follow the state, with a first step h, until a gauge that has been positive falls to zero; return whether one did."""
    for _ in range(MAX_STEPS):
        rates(law, space[SWITCHES], space[STATE], space[0])
        error = step(rates, law, h, n, space)
        factor = 0.9 * error ** (-1.0 / 8.0) if error > 0.0 else 5.0
        if not error <= 1.0:
            h *= max(0.1, factor) if error < inf else 0.1
            continue
        gauges(law, space[SWITCHES], space[STATE], space[VALUES])
        for k in range(n_g):
            space[ARMED, k] = space[VALUES, k] > 0.0
        fell = least(gauges, law, n_g, space)[0] <= 0.0
        if fell:
            locate(rates, gauges, law, h, n, n_g, space)
        for k in range(n):
            space[STATE, k] = space[OUT, k]
        if fell:
            return True
        h *= min(5.0, factor)
    return False


@compiled
def fired(k, law, space):
    """Return whether gauge k has fallen to zero at the end of a march."""
    return space[ARMED, k] > 0.0 and space[VALUES, k] <= near(law.tol)
