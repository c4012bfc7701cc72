"""What ends a phase of sustained contact: event functions that are positive while it goes on.

A closed end leaves where its normal force would break (3), and begins to slip where its friction would break the bound of (4)
for stick. An open end lands where its gap in (3) is zero. A slip ends where it is zero: then (4) has its other case.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    UPRIGHT,
    YCHART,
    YDIP,
    YS,
    YWB,
    YWP,
    set_slip,
    slip_of,
    to_border,
)
from dimersweep.kernel.contact.forces import COMPLIANCE, F1, F2, hold_reserve
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.model.plate import tempo
from dimersweep.kernel.numerics.armed_events import arm, least_armed
from dimersweep.kernel.numerics.elementary import length

# Events of a contact phase, two numbers of each kind that an end has: the even one is p1's, the odd one p2's. A phase
# evaluates one event function for each number.
LIFT_OFF, HOLD_LOST, SLIP_END = 0, 2, 4
LANDING = 6  # of the end that is open
LEAVES_CHART = 7  # not an event of the dimer: the state leaves its chart
JAM = 8  # the force of a slip grows beyond all bounds (a dynamic jam)
N_CONTACT_EVENTS = 9
N_FORCE_EVENTS = SLIP_END  # those below this number are lift-offs and lost holds
# in place of an event: the time is over; a bound on steps, or on probes for a landing, was reached; the phase goes on
NO_EVENT, OUT_OF_STEPS, OUT_OF_PROBES, GOES_ON = -1, -2, -4, -5
# slip, in units of the one that counts as none, whose direction is only known as well as the tolerance
UNSURE_SLIP = 10.0


@compiled
def end_of(event):
    """Number of the end, 0 or 1, at which a lift-off, the loss of a hold or the end of a slip happens."""
    return event % 2


@compiled
def is_lift_off(event):
    """Whether a closed end leaves the plate."""
    return LIFT_OFF <= event < HOLD_LOST


@compiled
def is_hold_lost(event):
    """Whether the friction can no longer hold a sticking end."""
    return HOLD_LOST <= event < SLIP_END


@compiled
def is_slip_end(event):
    """Whether the slip of an end comes to rest."""
    return SLIP_END <= event < LANDING


@compiled
def is_failure(event):
    """Whether a bound was reached in place of an event."""
    return event == OUT_OF_STEPS or event == OUT_OF_PROBES


@compiled
def needs_forces(event):
    """Whether the event function depends on the contact forces: else on the contact state alone."""
    return event < SLIP_END or event == JAM


@compiled(inline=True)
def event_function(dm, modes, k, base, y, F, slip_tol):
    """Event function k, positive while the phase goes on; inf where it has no meaning; in units in which all compare.

    Normal force of an end, times the compliance (at a jam the force is infinite, and only at a lift-off the product is
    zero); reserve of the friction that holds it; its slip along the direction it had at `base`; the other end's
    height (the dip, which opens its gap); what is left to the border of the chart; the compliance.
    """
    if k == JAM:
        return F[COMPLIANCE]
    if k == LANDING or k == LEAVES_CHART:
        if modes[0] != FREE and modes[1] != FREE:
            return inf
        return to_border(dm, y) if k == LEAVES_CHART else height_of_open_end(modes, y)
    i = end_of(k)
    if modes[i] == FREE:
        return inf
    if is_lift_off(k):
        return F[COMPLIANCE] * (F[F1] if i == 0 else F[F2]) / (dm.m * dm.g)
    if is_hold_lost(k):
        return hold_reserve(dm, modes, i, F) / (dm.m * dm.g) if modes[i] == STICK else inf
    if modes[i] != SLIP:
        return inf
    a0, b0 = slip_of(dm, modes, base, i)
    a, b = slip_of(dm, modes, y, i)
    return ((a * a0 + b * b0) / length(a0, b0) - slip_tol) / dm.v_scale


@compiled(inline=True)
def height_of_open_end(modes, y):
    """The dip, positive where it opens the gap of the end that is not closed; inf in the upright chart."""
    if y[YCHART] == UPRIGHT:
        return inf
    return y[YDIP] if modes[0] != FREE else -y[YDIP]


class ContactEvents(NamedTuple):
    """A contact state in which the event functions are asked for."""

    dm: Any
    modes: Any
    base: Any  # the state at the start of the step
    y: Any
    F: Any
    slip_tol: float
    values: Any  # what they are is written there


@compiled(inline=True)
def noted_value(at, k):
    """Event function k, which is noted."""
    at.values[k] = event_function(at.dm, at.modes, k, at.base, at.y, at.F, at.slip_tol)
    return at.values[k]


@compiled(inline=True)
def value_with_meaning(at, k):
    """Event function k, which is noted; 0.0 where it has no meaning."""
    value = noted_value(at, k)
    return value if value < inf else 0.0


@compiled
def least_value(dm, modes, armed, base, y, F, slip_tol, values):
    """Least of the armed event functions and its number (inf and -1 if none is armed); all of them into `values`."""
    return least_armed(noted_value, ContactEvents(dm, modes, base, y, F, slip_tol, values), armed, N_CONTACT_EVENTS)


@compiled
def arm_events(dm, modes, armed, y, F, slip_tol, values):
    """Arm the event functions of the ends that have become positive; they are written into `values`."""
    arm(value_with_meaning, ContactEvents(dm, modes, y, y, F, slip_tol, values), armed, LANDING + 1)


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
            v, along = length(a, b), a * d_a + b * d_b
            if along < 0.0:
                h = min(h, -v / (along / v))
    return h


@compiled
def motion_rate(dm, y):
    """Rate at which the motion changes [rad/s]: that of the plate, or of the falling and turning rod."""
    return max(tempo(dm), dm.w_scale + abs(y[YWB]) + abs(y[YWP]) + dm.J_a * dm.it * abs(y[YS]))


@compiled
def brief(dm, y, tol):
    """Time over which a straight line is as good as the tolerance [s]: its error is quadratic."""
    return 0.6 * sqrt(tol) / motion_rate(dm, y)


@compiled
def slip_about_to_end(dm, modes, y, dy, span, tol, slip_tol):
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
                if time <= span and (v <= UNSURE_SLIP * slip_tol or straight):
                    return i
    return -1


@compiled
def carry(y, dy, t, n):
    """Carry a state on at its present rates; the dip at its present acceleration, or the smallest hops would gain energy."""
    y[YDIP] += 0.5 * t * t * dy[YWB]
    for k in range(n):
        y[k] += t * dy[k]


@compiled
def run_to_slip_end(dm, modes, y, dy, i, slip_tol, n):
    """Carry the state along a straight line to where end i is at rest; returns the time it takes."""
    a, b = slip_of(dm, modes, y, i)
    d_a, d_b = slip_of(dm, modes, dy, i)
    v2 = a * a + b * b
    t = -v2 / (a * d_a + b * d_b) if v2 > slip_tol * slip_tol else 0.0
    carry(y, dy, t, n)
    set_slip(dm, modes, y, i, 0.0, 0.0)
    return t
