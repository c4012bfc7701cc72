"""Expand a leg of an impact at one end in powers of xi, with dP = v dxi.

The module also finds how far an expansion reaches and where it vanishes. In the clock xi the slip direction is not
stiff at small slip, and one expansion gives a leg with all its events. An array c of expansions has a row of
coefficients for each quantity.
"""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.numerics.elementary import length, multiplied, nearly_raised

# orders of the expansion of a leg with a turning slip direction
LEAST_ORDER, ORDER = 4, 15
# place up to which the expansion of a leg is to reach, over the likely end of the leg: slightly beyond, so that it has
# the end
PAST_LEG = 1.1
# ratio of the last two terms at the likely end, above which an expansion is taken to the highest order at once: the
# terms fall slowly
SLACK = 0.5
# step of Newton's rule, in units of its place, after which it is done: the next step would be the square of this
NEWTON_DONE = 1e-8
# error of a velocity, in units of the velocity, that no step improves: some units of round-off
ROUNDED_VELOCITY = 1e-15
INVERSE = tuple(1.0 / (j + 1.0) for j in range(ORDER))
# its rows: slip, axial slip, impulse, gap rates of both ends, energy
A_V, A_A, A_P, A_N, A_J, A_E, EXPANSION_ROWS = range(7)


@compiled
def begin_expansion(blow, c):
    """Write the first coefficients of the expansion of a leg into c; return the first coefficient of b^2."""
    c[A_V, 0] = length(blow.a, blow.b)
    c[A_A, 0], c[A_P, 0], c[A_N, 0], c[A_J, 0], c[A_E, 0] = blow.a, 0.0, blow.n, blow.n_j, blow.E
    return blow.b * blow.b


@compiled(fuse=True, inline=True)
def expand(law, gain, fading, first, order, c):
    """Write the Taylor coefficients of a leg in xi beyond xi**first up to xi**order into the rows of c.

    With dP = v dxi both slips have linear laws, a' = W_na v - mu W_aa a and b' = -mu W_bb b. So b is an exponential,
    and v = sqrt(a^2 + b^2) is the only function to expand. `fading` is the coefficient of b^2 at xi**first; return the
    one at xi**order.
    """
    inverse = 1.0 / c[A_V, 0]
    for j in range(first, order):
        # the newest coefficients are added last: the processor need not wait for them with the others
        if j > 0:
            rest, middle = 0.5 * fading, j // 2
            if j % 2 == 0:
                rest += 0.5 * (c[A_A, middle] * c[A_A, middle] - c[A_V, middle] * c[A_V, middle])
            for i in range((j - 1) // 2, 0, -1):
                rest += c[A_A, i] * c[A_A, j - i] - c[A_V, i] * c[A_V, j - i]
            c[A_V, j] = (rest + c[A_A, 0] * c[A_A, j]) * inverse
        work = 0.0
        for i in range(j, -1, -1):
            work += c[A_N, i] * c[A_V, j - i]
        k = INVERSE[j]
        fading *= -2.0 * law.mu * law.bb * k
        dP, dA = c[A_V, j] * k, -law.mu * c[A_A, j] * k
        c[A_A, j + 1] = law.na * dP + law.aa * dA
        c[A_P, j + 1] = dP
        c[A_N, j + 1] = law.nn * dP + law.na * dA
        c[A_J, j + 1] = law.nn_j * dP + law.na_j * dA
        c[A_E, j + 1] = -gain * work * k
    return fading


@compiled(fuse=True)
def at(c, row, order, xi):
    """Return the value and the slope of an expansion at xi."""
    value, slope = c[row, order], 0.0
    for j in range(order - 1, -1, -1):
        slope = slope * xi + value
        value = value * xi + c[row, j]
    return value, slope


@compiled
def square_integral(c, row, order, xi):
    """Return the integral of the square of an expansion up to xi, from its coefficients below xi**order."""
    total = 0.0
    for j in range(order - 1, -1, -1):
        square = 0.0
        for i in range(j + 1):
            square += c[row, i] * c[row, j - i]
        total = total * xi + square * INVERSE[j]
    return total * xi


@compiled
def unseen(c, v, tol):
    """Return the size below which a term of the expansions counts as none, for a slip v and a tolerance tol."""
    return max(0.1 * min(tol, 0.01 * v), ROUNDED_VELOCITY * max(v, abs(c[A_N, 0])))


@compiled
def term(c, j):
    """Return the largest coefficient of xi**j among the expansions; an energy counts by the rate that it gives."""
    energy = abs(c[A_E, j]) / max(1.0, sqrt(c[A_E, 0]))
    return max(abs(c[A_A, j]), max(abs(c[A_P, j]), max(abs(c[A_N, j]), energy)))


@compiled
def step_reach(c, order, small):
    """Return the step over which the last terms of the expansions stay below `small`, well inside their convergence."""
    last, before = term(c, order), term(c, order - 1)
    h = nearly_raised(small / last, 1.0 / order) if last > 0.0 else inf
    # the last term may vanish by chance, so the one before counts, too; 1e9 keeps its power finite
    if before * multiplied(min(h, 1e9), order - 1) > small:
        h = nearly_raised(small / before, 1.0 / (order - 1))
    return h


@compiled
def likely_end(c, compressing):
    """Return PAST_LEG times the place at which a leg ends by the first three terms of its expansion; or inf."""
    if compressing:
        return PAST_LEG * parabola_zero(-c[A_N, 0], -c[A_N, 1], -c[A_N, 2])
    return PAST_LEG * parabola_zero(c[A_E, 0], c[A_E, 1], c[A_E, 2])


@compiled
def expand_to_end(law, gain, compressing, fading, small, c):
    """Expand a leg to the order that reaches its end, or to the highest order.

    Return the order and the step over which the expansion is good.
    """
    order = LEAST_ORDER
    fading = expand(law, gain, fading, 0, order, c)
    end = likely_end(c, compressing)
    if 0.0 < end < inf and term(c, order) * end <= SLACK * term(c, order - 1):
        while order < ORDER:
            power = multiplied(end, order - 1)
            if term(c, order - 1) * power <= small and term(c, order) * power * end <= small:
                return order, end
            more = min(order + 2, ORDER)
            fading = expand(law, gain, fading, order, more, c)
            order = more
    expand(law, gain, fading, order, ORDER, c)
    return ORDER, step_reach(c, ORDER, small)


@compiled
def parabola_zero(c0, c1, c2):
    """Return the first zero of c0 + c1 x + c2 x^2 at x > 0, for c0 > 0; inf if there is none."""
    disc = c1 * c1 - 4.0 * c0 * c2
    if disc < 0.0:
        return inf
    below = sqrt(disc) - c1
    return 2.0 * c0 / below if below > 0.0 else inf


@compiled(fuse=True)
def first_zero(c, row, order, sign, h):
    """Return the first zero in (0, h] of an expansion, which has the given sign before it; inf if there is none.

    The slope of the expansion must change its sign at most once. The zero is looked for from the zero of the first
    three terms: a fast slip has its events at a tiny part of the interval. A dip below zero between positive ends is
    looked for at its bottom.
    """
    low, high = 0.0, h
    end, slope_end = at(c, row, order, h)
    if sign * end > 0.0:
        if sign * c[row, 1] >= 0.0 or sign * slope_end <= 0.0:
            return inf
        # 60 halvings: down to round-off
        for _ in range(60):
            mid = 0.5 * (low + high)
            value, slope = at(c, row, order, mid)
            if sign * value <= 0.0:
                high = mid
                break
            low, high = (mid, high) if sign * slope < 0.0 else (low, mid)
        else:
            return inf
        low = 0.0
    return zero_between(
        c, row, order, sign, low, high, parabola_zero(sign * c[row, 0], sign * c[row, 1], sign * c[row, 2])
    )


@compiled(fuse=True)
def zero_between(c, row, order, sign, low, high, x):
    """Return the zero of an expansion between `low` and `high`, with the given sign at `low` only.

    It is found by bracketed Newton steps from x.
    """
    if not low < x < high:
        x = high
    # 100 is a bound: halvings alone end long before
    for _ in range(100):
        value, slope = at(c, row, order, x)
        low, high = (x, high) if sign * value > 0.0 else (low, x)
        new = x - value / slope if slope != 0.0 else high
        if not low <= new <= high:
            new = 0.5 * (low + high)
        x, step = new, new - x
        # the next step of Newton's rule would be below round-off
        if abs(step) <= NEWTON_DONE * x:
            break
    return x
