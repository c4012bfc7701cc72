"""Locate the first zero of event functions in a step: a bracket, its next probe, and the verdict on a probe.

Contact phases and impacts march alike. They take a step (`steps.explicit_step`), arm event functions, and locate the
zero where the least of the armed functions has fallen to zero. Each passes its own rates, event functions and probe.
"""

from math import inf

from dimersweep.kernel.compiler.jit import compiled

MAX_ROOT_PROBES = 160  # probes of a zero: halvings end it long before
MAX_NEWTON = 30  # iterations of Newton's rule, which ends by itself long before, or finds nothing
# distance over which the last probe may be carried on, in units of the place of the probe: the error goes with the
# distance
CARRIED = 0.1
# in place of an event: a probe within the step has a larger error than the step itself, which has passed over a
# singularity
UNSOUND = -3
PROBE_LOOK_ON, PROBE_FOUND, PROBE_REFUSED = range(3)  # the verdict of a probe
# first guess on a cubic: evaluations; share of the change of the function that may be left; distance to which its slope
# is taken
ON_CUBIC, CLOSE_ON_CUBIC, SLOPE_SHARE = 12, 1e-6, 1e-3
GUESSES = 6  # probes by Newton's rule, after which the bracket alone decides


@compiled(inline=True)
def arm(value, problem, armed, n):
    """Arm each of n event functions that has become positive; ``value(problem, k)`` is function k."""
    for k in range(n):
        if armed[k] == 0.0 and value(problem, k) > 0.0:
            armed[k] = 1.0


@compiled(inline=True)
def least_armed(value, problem, armed, n):
    """Return the least of the armed of n event functions, and its number (inf and -1 if none is armed)."""
    least, which = inf, -1
    for k in range(n):
        if armed[k] > 0.0:
            g = value(problem, k)
            if g < least:
                least, which = g, k
    return least, which


class RootBracket:
    """Bracket around a zero, its last probe, and the guess where to probe next."""

    low: float
    high: float
    g_low: float  # values at both ends
    g_high: float
    side: int  # end that was replaced last: -1 the lower, 1 the upper, 0 neither
    probes: int  # number of probes; at, g: place and value of the last one
    at: float
    g: float
    guess: float  # place of the next probe by Newton's rule, and the slope there
    slope: float


@compiled
def set_bracket(s, h, g_low, g_high, guess, slope):
    """Begin a bracket (0, h] from the values at its ends and a first guess with the slope there."""
    s.low, s.high, s.g_low, s.g_high, s.side = 0.0, h, g_low, g_high, 0
    s.probes, s.at, s.g = 0, h, g_high
    s.guess, s.slope = guess, slope


@compiled
def next_probe(s):
    """Return the place of the next probe.

    It is that of Newton's rule, else the secant point. It is the middle if that point is not inside, and in every third
    probe: the least of several functions may have a bend, to which regula falsi creeps.
    """
    low, high, g_low, g_high = s.low, s.high, s.g_low, s.g_high
    if s.probes < GUESSES and low < s.guess < high:
        return s.guess
    mid = (low * g_high - high * g_low) / (g_high - g_low)
    return mid if low < mid < high and s.probes % 3 < 2 else 0.5 * (low + high)


@compiled
def note_probe(s, mid, g, aim, steep):
    """Narrow the bracket by the value g at mid, by Anderson and Bjorck's regula falsi.

    The value at an end that stays twice is scaled down, so that both ends close in. Newton's rule aims at the value
    `aim`. `steep` is True if the last two probes give the slope better than the guess.
    """
    if g > 0.0:
        if s.side < 0:
            # Anderson and Bjorck's factor, or a half (Illinois) where that is none
            factor = 1.0 - g / s.g_low
            s.g_high *= factor if factor > 0.0 else 0.5
        s.low, s.g_low, s.side = mid, g, -1
    else:
        if s.side > 0:
            factor = 1.0 - g / s.g_high
            s.g_low *= factor if factor > 0.0 else 0.5
        s.high, s.g_high, s.side = mid, g, 1
    if steep and s.probes > 0:
        s.slope = (g - s.g) / (mid - s.at)
    s.guess = mid - (g - aim) / s.slope if s.slope < 0.0 else 0.0
    s.at, s.g, s.probes = mid, g, s.probes + 1


@compiled(inline=True)
def zero_on_cubic(value, problem, s, h, g_start, g_end):
    """Return a first guess of where in a step h a function vanishes, and its slope there.

    ``value(problem, share)`` is the function on the cubic through the step, at a share of it.
    """
    mid, g = 0.5, 0.0
    set_bracket(s, 1.0, g_start, g_end, 0.0, 0.0)
    for _ in range(ON_CUBIC):
        mid = next_probe(s)
        g = value(problem, mid)
        if abs(g) <= CLOSE_ON_CUBIC * (g_start - g_end):
            break
        note_probe(s, mid, g, 0.0, False)
    slope = (value(problem, mid + SLOPE_SHARE) - g) / (SLOPE_SHARE * h)
    return (mid * h - g / slope if slope < 0.0 else mid * h), slope


@compiled(inline=True)
def locate(probe, problem, s, h, aim, steep):
    """Close the bracket of a step h around its first event, and return the event; UNSOUND where a probe is refused.

    ``probe(problem, at)`` takes the step up to `at`. It returns the least event function there, its event, and
    PROBE_LOOK_ON, PROBE_FOUND or PROBE_REFUSED. The last probe is at the event. `aim` and `steep` are those of
    `note_probe`.
    """
    # 1e-15: some units of round-off, below which a bracket cannot be halved
    while s.high - s.low > 1e-15 * h and s.probes < MAX_ROOT_PROBES:
        mid = next_probe(s)
        g, event, verdict = probe(problem, mid)
        if verdict != PROBE_LOOK_ON:
            return event if verdict == PROBE_FOUND else UNSOUND
        note_probe(s, mid, g, aim, steep)
    _, event, _ = probe(problem, s.high)
    return event
