"""What ends a phase of sustained contact: event functions that are positive while it goes on."""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    UPRIGHT,
    YB,
    YCHART,
    YS,
    YUA,
    YUB,
    YWB,
    YWP,
    slip_of,
    to_border,
)
from dimersweep.kernel.contact.forces import (
    COMPLIANCE,
    F1,
    F2,
    hold_reserve,
)
from dimersweep.kernel.model.friction import length
from dimersweep.kernel.model.layout import FREE, SLIP, STICK

# events of a contact phase; even numbers are p1's, odd ones p2's
LIFTS, HOLD_LOST, SLIP_ZERO, LANDS = 0, 2, 4, 6
TIPS = 7  # not an event of the dimer: the state leaves its chart
JAMS = 8  # the force of a slip grows beyond all bounds (a dynamic jam)
N_EVENTS = 9
NEAR = 10.0  # slip, in units of the one that counts as none, whose direction is only known as well as the tolerance


@compiled
def glide_value(dm, modes, k, base, y, F, slip_tol):
    """Event function k, positive while the phase goes on; inf where it has no meaning; in units in which all compare.

    Normal force of an end, times the compliance (at a jam the force is infinite, and only at a lift-off the product is
    zero); reserve of the friction that holds it; its slip along the direction it had at `base`; the other end's
    height (the dip, which opens its gap); what is left to the border of the chart; the compliance.
    """
    if k == JAMS:
        return F[COMPLIANCE]
    i = k % 2
    if k >= LANDS:
        if modes[0] != FREE and modes[1] != FREE:
            return inf
        if k == TIPS:
            return to_border(y)
        if y[YCHART] == UPRIGHT:
            return inf
        return y[YB] if modes[0] != FREE else -y[YB]
    if modes[i] == FREE:
        return inf
    if k < HOLD_LOST:
        return F[COMPLIANCE] * (F[F1] if i == 0 else F[F2]) / (dm.m * dm.g)
    if k < SLIP_ZERO:
        return hold_reserve(dm, modes, i, F) / (dm.m * dm.g) if modes[i] == STICK else inf
    if modes[i] != SLIP:
        return inf
    a0, b0 = slip_of(dm, modes, base, i)
    a, b = slip_of(dm, modes, y, i)
    return ((a * a0 + b * b0) / length(a0, b0) - slip_tol) / dm.v_scale


@compiled
def least_value(dm, modes, armed, base, y, F, slip_tol, values):
    """Least of the armed event functions and its number (inf and -1 if none is armed); all of them into `values`."""
    least, which = inf, -1
    for k in range(N_EVENTS):
        if armed[k] > 0.0:
            values[k] = glide_value(dm, modes, k, base, y, F, slip_tol)
            if values[k] < least:
                least, which = values[k], k
    return least, which


@compiled
def arm(dm, modes, armed, y, F, slip_tol, values):
    """Arm the event functions of the ends that have become positive; they are written into `values`."""
    for k in range(TIPS):
        if armed[k] == 0.0:
            value = glide_value(dm, modes, k, y, y, F, slip_tol)
            if 0.0 < value < inf:
                armed[k], values[k] = 1.0, value


@compiled
def slip_speed(dm, modes, y, dy):
    """Speed of the end that slips most slowly, and its rate; inf, 0.0 if none has a slip that turns.

    Beside an end that sticks the other one slips along a fixed line.
    """
    least, rate = inf, 0.0
    if modes[0] == STICK or modes[1] == STICK:
        return least, rate
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            d_a, d_b = slip_of(dm, modes, dy, i)
            v = length(a, b)
            if v < least:
                least, rate = v, (a * d_a + b * d_b) / v
    return least, rate


@compiled
def slip_limit(dm, modes, y, dy):
    """Time over which no slip comes to rest at its present rate."""
    h = inf
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            d_a, d_b = slip_of(dm, modes, dy, i)
            v = length(a, b)
            rate = (a * d_a + b * d_b) / v
            if rate < 0.0:
                h = min(h, -v / rate)
    return h


@compiled
def quickness(dm, y):
    """Rate at which the motion changes [rad/s]: that of the plate, or of the falling and turning rod."""
    return max(dm.omega, dm.w_scale + abs(y[YWB]) + abs(y[YWP]) + dm.J_a * dm.it * abs(y[YS]))


@compiled
def brief(dm, y, tol):
    """Time over which a straight line is as good as the tolerance [s]: its error is quadratic."""
    return 0.6 * sqrt(tol) / quickness(dm, y)


@compiled
def nearly_stopped(dm, modes, y, dy, span, tol, slip_tol):
    """Number of a slipping end that comes to rest along a straight line within a brief time, at most `span`; -1 if none does.

    Its slip and the change of its slip must be parallel to the tolerance; within a tolerance of rest slowing down will do.
    """
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            d_a, d_b = slip_of(dm, modes, dy, i)
            v, along = length(a, b), a * d_a + b * d_b
            if along < 0.0:
                across = abs(a * d_b - b * d_a) * v / -along
                time = v * v / -along
                straight = time <= brief(dm, y, tol) and across <= 0.5 * tol * dm.v_scale
                if time <= span and (v <= NEAR * slip_tol or straight):
                    return i
    return -1


@compiled
def carry(y, dy, t, n):
    """Carry a state on at its present rates; the dip at its present acceleration, or the smallest hops would gain energy."""
    y[YB] += 0.5 * t * t * dy[YWB]
    for k in range(n):
        y[k] += t * dy[k]


@compiled
def run_out(dm, modes, y, dy, i, slip_tol, n):
    """Carry the state along a straight line to where end i is at rest; returns the time it takes."""
    a, b = slip_of(dm, modes, y, i)
    d_a, d_b = slip_of(dm, modes, dy, i)
    v2 = a * a + b * b
    t = -v2 / (a * d_a + b * d_b) if v2 > slip_tol * slip_tol else 0.0
    carry(y, dy, t, n)
    stop_slip(dm, modes, y, i)
    return t


@compiled
def stop_slip(dm, modes, y, i):
    """Set the slip of end i, which has come down to its tolerance, to zero."""
    y[YUA] = 0.0
    if i == 0 or modes[0] == FREE:
        y[YUB] = 0.0
    else:
        y[YWP] = y[YUB] / (2.0 * dm.h)
