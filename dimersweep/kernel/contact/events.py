"""What ends a phase of sustained contact: event functions that are positive while it goes on.

A closed end leaves where its normal force would break (3), and begins to slip where its friction would break the bound of (4)
for stick. An open end lands where its gap in (3) is zero. A slip ends where it is zero: then (4) has its other case.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import N_PATH, UPRIGHT, Y, slip_of, to_border
from dimersweep.kernel.contact.forces import COMPLIANCE, F1, F2, hold_reserve
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.model.plate import tempo
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.root_bracket import arm, least_armed

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
def event_function(p, k, y, F):
    """Event function k, positive while the phase goes on; inf where it has no meaning; in units in which all compare.

    Normal force of an end, times the compliance (at a jam the force is infinite, and only at a lift-off the product is
    zero); reserve of the friction that holds it; its slip along the direction it had at the start of the step; the other
    end's height (the dip, which opens its gap); what is left to the border of the chart; the compliance.
    """
    dm, modes = p.dm, p.modes
    if k == JAM:
        return F[COMPLIANCE]
    if k == LANDING or k == LEAVES_CHART:
        if (modes[0] != FREE and modes[1] != FREE) or (k == LANDING and y[Y.chart] == UPRIGHT):
            return inf
        return to_border(dm, y) if k == LEAVES_CHART else (y[Y.dip] if modes[0] != FREE else -y[Y.dip])
    i = end_of(k)
    if modes[i] == FREE:
        return inf
    if is_lift_off(k):
        return F[COMPLIANCE] * (F[F1] if i == 0 else F[F2]) / (dm.m * dm.g)
    if is_hold_lost(k):
        return hold_reserve(dm, modes, i, F) / (dm.m * dm.g) if modes[i] == STICK else inf
    if modes[i] != SLIP:
        return inf
    a0, b0 = slip_of(dm, modes, p.b.start.y, i)
    a, b = slip_of(dm, modes, y, i)
    return ((a * a0 + b * b0) / length(a0, b0) - p.slip_tol) / dm.v_scale


class ContactEvents(NamedTuple):
    """A contact state in which the event functions are asked for."""

    p: Any  # the phase
    y: Any
    F: Any
    values: Any  # what they are is written there


@compiled(inline=True)
def noted_value(at, k):
    """Event function k, which is noted."""
    at.values[k] = event_function(at.p, k, at.y, at.F)
    return at.values[k]


@compiled
def least_value(p, at, values):
    """Least of the armed event functions at a moment and its number (inf, -1 if none is armed); all of them into `values`."""
    return least_armed(noted_value, ContactEvents(p, at.y, at.F, values), p.b.armed, N_CONTACT_EVENTS)


@compiled
def arm_events(p, values):
    """Arm the event functions of the ends that have become positive at the start of a step; they are written into `values`."""
    arm(noted_value, ContactEvents(p, p.b.start.y, p.b.start.F, values), p.b.armed, LANDING + 1)


@compiled(inline=True)
def change_of_slip(dm, modes, y, dy, i):
    """Speed of the slip of end i; its rate along itself and across, both times that speed."""
    a, b = slip_of(dm, modes, y, i)
    d_a, d_b = slip_of(dm, modes, dy, i)
    return length(a, b), a * d_a + b * d_b, a * d_b - b * d_a


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
            v, along, _ = change_of_slip(dm, modes, y, dy, i)
            if v < least:
                least, rate = v, along / v
    return least, rate


@compiled
def slip_limit(dm, modes, y, dy):
    """Time over which no slip comes to rest at its present rate."""
    h = inf
    for i in range(2):
        if modes[i] == SLIP:
            v, along, _ = change_of_slip(dm, modes, y, dy, i)
            if along < 0.0:
                h = min(h, -v / (along / v))
    return h


@compiled
def motion_rate(dm, y):
    """Rate at which the motion changes [rad/s]: that of the plate, or of the falling and turning rod."""
    return max(tempo(dm), dm.w_scale + abs(y[Y.w_b]) + abs(y[Y.w_p]) + dm.J_a * dm.it * abs(y[Y.spin]))


@compiled
def slip_about_to_end(p, span):
    """Number of a slipping end that comes to rest along a straight line within a brief time, at most `span`; -1 if none does.

    Its slip and the change of its slip must be parallel to the tolerance; within a tolerance of rest slowing down will do.
    Brief is a time over which a straight line is as good as the tolerance: its error is quadratic.
    """
    dm, y = p.dm, p.b.start.y
    for i in range(2):
        if p.modes[i] == SLIP:
            v, along, turning = change_of_slip(dm, p.modes, y, p.b.start.dy, i)
            if along < 0.0:
                across = abs(turning) * v / -along
                time = v * v / -along
                straight = time <= 0.6 * sqrt(p.tol) / motion_rate(dm, y) and across <= 0.5 * p.tol * dm.v_scale
                if time <= span and (v <= UNSURE_SLIP * p.slip_tol or straight):
                    return i
    return -1


@compiled
def time_to_slip_end(p, i):
    """Time in which end i comes to rest along a straight line; none for a slip that counts as none."""
    a, b = slip_of(p.dm, p.modes, p.b.start.y, i)
    d_a, d_b = slip_of(p.dm, p.modes, p.b.start.dy, i)
    v2 = a * a + b * b
    return -v2 / (a * d_a + b * d_b) if v2 > p.slip_tol * p.slip_tol else 0.0


@compiled
def carry(p, t):
    """Carry the state on at its present rates; the dip at its present acceleration, or the smallest hops would gain energy."""
    y, dy = p.b.start.y, p.b.start.dy
    y[Y.dip] += 0.5 * t * t * dy[Y.w_b]
    for k in range(min(p.n, N_PATH)):
        y[k] += t * dy[k]
