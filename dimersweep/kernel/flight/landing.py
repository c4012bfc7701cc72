"""Find the next landing: the first zero of a gap in (3), approached from the left by steps that certainly hold no root.

From a probe (gap and three derivatives) the gap is bounded below by a quartic, because its fourth derivative is
bounded. The first root of that quartic is a step over which nothing can land, however short the hop: no double crossing
and no graze is missed. As soon as the gap certainly falls all the way to a zero, that zero is the landing. The zero of
the cubic is off by no more than the fourth derivative allows, and is taken where this is rounding.
"""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.flight.free_motion import gap_series
from dimersweep.kernel.model.plate import heaviest
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.sincos import sincos

MAX_LANDING_PROBES = 10000  # probes of a flight, for one end
# rate of the axis, in units of the rate of the plate, from which on whole turns of the axis are stepped over
SWIFT = 10.0
EPS = 2.3e-16  # round-off of a number, in units of itself
# first try of a safe step, over the time in which the parabola falls to zero: shorter, since the quartic may fall
# sooner
SHORT = 0.9
SHRINK, MAX_TRIES = 0.65, 100  # the next try of a safe step over the last one, and the number of tries at most
# how far past the zero of a cubic the gap must certainly fall, in units of the step to that zero
PAST_CUBIC = 1.2
NEWTON = 8  # steps of Newton's rule to that zero
ROUNDED_HEIGHT = 1e-13  # error of a height, in units of the numbers that it is the difference of


@compiled(fuse=True, inline=True)
def safe_step(c0, c1, c2, c3, bound4, span):
    """Return a step of at most `span` on which a lower bound of the gap does not fall below zero.

    The bound is c0 + c1 s + c2 s^2/2 + c3 s^3/6 - bound4 s^4/24. None of its Bernstein coefficients on the step is
    negative. The first try ends short of the zero of the parabola.
    """
    a2, a3, a4 = 0.5 * c2, c3 / 6.0, -bound4 / 24.0
    # lift-off at zero rate: s^2 is factored out, and half of the first root of the rest is safe
    if c0 == 0.0 and c1 == 0.0:
        if a2 <= 0.0 and a3 <= 0.0:
            return 0.0
        most = min(a4, -1e-300)
        return min(span, 0.5 * (a3 + sqrt(a3 * a3 - 4.0 * most * max(a2, 0.0))) / (-2.0 * most))
    disc = c1 * c1 - 4.0 * a2 * c0
    s = span
    if c2 < 0.0:
        s = min(span, SHORT * (c1 + sqrt(disc)) / -c2)
    elif c1 < 0.0 and disc > 0.0:
        s = min(span, SHORT * 2.0 * c0 / (sqrt(disc) - c1))
    for _ in range(MAX_TRIES):
        x1, x2, x3 = c1 * s, a2 * s * s, a3 * s * s * s
        early = min(c0 + 0.25 * x1, c0 + 0.5 * x1 + x2 / 6.0)
        late = min(c0 + 0.75 * x1 + 0.5 * x2 + 0.25 * x3, c0 + x1 + x2 + x3 + a4 * s * s * s * s)
        if min(early, late) >= 0.0:
            return s
        s *= SHRINK
    return 0.0


@compiled
def out_of_reach(dm, fl, i, t, gap, rate):
    """Return a time [s] within which end i is too high to land, however the axis swings; 0.0 if it is within reach.

    The swing of the axis lowers the end by its amplitude h |c| at most. The gap less the swing falls with the greatest
    weight (`heaviest`) at most.
    """
    sx, cx = sincos(fl.Omega * t)
    h = fl.h_1 if i == 0 else fl.h_2
    swing = h * (fl.c1 * cx + fl.c2 * sx)
    rise = rate - h * fl.Omega * (fl.c2 * cx - fl.c1 * sx)
    reach = abs(h) * length(fl.c1, fl.c2)
    height = gap - swing - reach - ROUNDED_HEIGHT * (abs(gap) + reach)
    if height <= 0.0:
        return 0.0
    curve = heaviest(dm)
    root = sqrt(rise * rise + 2.0 * curve * height)
    return (rise + root) / curve if rise > 0.0 else 2.0 * height / (root - rise)


@compiled(fuse=True, inline=True)
def fall(c0, c1, c2, c3, bound4):
    """Return the step to the next zero of a cubic from a probe at which the gap falls, and the error of that zero.

    The cubic is c0 + c1 s + c2 s^2/2 + c3 s^3/6. The step is negative if c0 < 0.

    Returns
    -------
    step, off : float
        The step, inf where the gap may cease to fall before; the largest distance of the gap's zero from the cubic's.
    """
    disc = c1 * c1 - 2.0 * c2 * c0
    if disc <= 0.0:
        return inf, inf
    step = 2.0 * c0 / (sqrt(disc) - c1)
    for _ in range(NEWTON):
        slope = c1 + step * (c2 + 0.5 * step * c3)
        if slope >= 0.0:
            return inf, inf
        change = (c0 + step * (c1 + step * (0.5 * c2 + step * (c3 / 6.0)))) / slope
        step -= change
        if abs(change) <= 1e-8 * abs(step):
            break
    size = abs(step)
    reach = PAST_CUBIC * size
    ahead = 1.0 if step > 0.0 else -1.0
    rate = c1 + reach * (max(0.0, ahead * c2) + reach * (0.5 * max(0.0, c3) + reach * (bound4 / 6.0)))
    if rate >= 0.0:
        return inf, inf
    off = bound4 * (size * size * size * size) / (-24.0 * rate)
    return (step, off) if off <= (PAST_CUBIC - 1.0) * size else (inf, inf)


@compiled
def first_landing(dm, fl, i, until):
    """Find the first time in (0, until] at which the gap of end i is zero.

    Returns
    -------
    t : float
        Time of the landing [s], or inf if there is certainly none.
    probes : int
        Evaluations of the gap, MAX_LANDING_PROBES if these were not enough.
    """
    t, falls = 0.0, False
    for probe in range(1, MAX_LANDING_PROBES):
        gap, rate, second, third = gap_series(dm, fl, i, t)
        if rate < 0.0 and (gap > 0.0 or falls):
            step, off = fall(gap, rate, second, third, fl.bound4)
            if step < inf:
                falls = True
                t += step
                if off > EPS * t:
                    continue
                return (t if t < until else inf), probe
        if probe > 1 and gap <= 0.0:
            return t, probe
        step = safe_step(max(gap, 0.0), rate, second, third, fl.bound4, until - t)
        if fl.Omega > SWIFT * fl.sway.omega:
            step = max(step, min(out_of_reach(dm, fl, i, t, gap, rate), until - t))
        if t + step >= until:
            return inf, probe
        if probe > 1 and step <= 4.0 * EPS * t:
            return t, probe
        # neither a positive gap nor one that opens: it is closed now
        if step == 0.0:
            return t, probe
        t += step
    return t, MAX_LANDING_PROBES


@compiled
def next_landing(dm, fl, until):
    """Return the end that lands first (-1 for neither), the time, and the number of probes of both ends.

    The end nearer to the plate is tried first: the other one then counts only until that landing.
    """
    near = 0 if fl.d_1 <= fl.d_2 else 1
    t, probes = first_landing(dm, fl, near, until)
    other, more = first_landing(dm, fl, 1 - near, min(t, until))
    if probes == MAX_LANDING_PROBES or more == MAX_LANDING_PROBES:
        return -1, t, MAX_LANDING_PROBES
    if other < t:
        return 1 - near, other, probes + more
    return (near if t < inf else -1), t, probes + more
