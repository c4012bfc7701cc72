"""What ends a phase of sustained contact: event functions that are positive while it goes on, and where in a step they vanish.

A closed end leaves where its normal force would break (3), and begins to slip where its friction would break the bound of (4)
for stick. An open end lands where its gap in (3) is zero. A slip ends where it is zero: then (4) has its other case.
"""

from math import inf
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import UPRIGHT, Y, leading, slip_of, to_border
from dimersweep.kernel.contact.forces import COMPLIANCE, F1, F2, contact_rates, hold_reserve
from dimersweep.kernel.contact.step_control import RESCALED, step_to
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.numerics import root_bracket
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.steps import on_cubic

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

NARROW = 0.02  # share of a step in which the bottom of a dip may hide at either end
# force or hold which may dip to zero, in weights and per square of the angle that the motion turns in a step
LOW_FORCE = 0.5
# what an event function may be past its zero, in units of the tolerance and of its change in the step
ZERO_PASSED = 1e-3
DIP_LEFT = 100.0  # in units of that, what may be left of a dip when the open end lands: it is then set to zero


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


class ContactEvents(NamedTuple):
    """A moment of a phase in which the event functions are asked for: no more than they need, they are asked for often."""

    dm: Any
    modes: Any
    slip_tol: float
    base: Any  # state at the start of the step
    y: Any
    F: Any
    values: Any  # what they are is written there


@compiled(inline=True)
def event_function(at, k):
    """Event function k, positive while the phase goes on; inf where it has no meaning; in units in which all compare.

    Normal force of an end, times the compliance (at a jam the force is infinite, and only at a lift-off the product is
    zero); reserve of the friction that holds it; its slip along the direction it had at the start of the step; the other
    end's height (the dip, which opens its gap); what is left to the border of the chart; the compliance.
    """
    dm, modes, y, F = at.dm, at.modes, at.y, at.F
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
    a0, b0 = slip_of(dm, modes, at.base, i)
    a, b = slip_of(dm, modes, y, i)
    return ((a * a0 + b * b0) / length(a0, b0) - at.slip_tol) / dm.v_scale


@compiled(inline=True)
def noted_value(at, k):
    """Event function k, which is noted."""
    at.values[k] = event_function(at, k)
    return at.values[k]


@compiled
def least_noted(at, armed):
    """Least of the armed event functions, and its number; see `least_value`."""
    return root_bracket.least_armed(noted_value, at, armed, N_CONTACT_EVENTS)


@compiled(inline=True)
def least_value(p, at, values):
    """Least of the armed event functions at a moment and its number (inf, -1 if none is armed); all of them into `values`."""
    return least_noted(ContactEvents(p.dm, p.modes, p.slip_tol, p.b.start.y, at.y, at.F, values), p.b.armed)


@compiled(inline=True)
def arm_events(p, values):
    """Arm the event functions of the ends that have become positive at the start of a step; they are written into `values`."""
    y, F = p.b.start.y, p.b.start.F
    root_bracket.arm(noted_value, ContactEvents(p.dm, p.modes, p.slip_tol, y, y, F, values), p.b.armed, LANDING + 1)


@compiled
def motion_rate(dm, y):
    """Rate at which the motion changes [rad/s]: that of the plate, or of the falling and turning rod."""
    return max(dm.tempo, dm.w_scale + abs(y[Y.w_b]) + abs(y[Y.w_p]) + dm.J_a * dm.it * abs(y[Y.spin]))


# --- where an event lies in a step, and whether a step may hide one ------------------------------------------------------


class PhaseCrossing(NamedTuple):
    """A step of a contact phase with an event in it."""

    p: Any
    event: int  # number of the event function that is least at its end
    past: float  # what it may be past its zero
    dip_left: float  # what may be left of a dip when the open end lands


@compiled
def look_on_cubic(p, share, h, forces):
    """Go to a share of a step of h seconds, on the cubic through its ends; `forces` says whether those there are wanted."""
    start, out, at = p.b.start, p.b.out, p.b.probe
    on_cubic(start.y, start.dy, out.y, out.dy, share, h, p.n, at.y)
    if forces:
        contact_rates(p.dm, p.modes, p.control.now + p.dm.omega * h * share, at.y, False, at.dy, at.F)


@compiled(inline=True)
def value_on_cubic(at, share):
    """The event function on the cubic through the ends of the step, at a share of it."""
    p, probe = at.p, at.p.b.probe
    look_on_cubic(p, share, p.control.size, at.event < SLIP_END or at.event == JAM)
    asked = ContactEvents(p.dm, p.modes, p.slip_tol, p.b.start.y, probe.y, probe.F, p.b.values[1])
    return event_function(asked, at.event)


@compiled(inline=True)
def probe_step(at, t):
    """Take the step up to t: the least event function there, its event, and PROBE_FOUND, PROBE_LOOK_ON or PROBE_REFUSED."""
    p, y = at.p, at.p.b.out.y
    if not step_to(p, p.control.now, t) <= 1.0:
        return 0.0, root_bracket.UNSOUND, root_bracket.PROBE_REFUSED
    g, which = least_value(p, p.b.out, p.b.values[1])
    at_rest = is_slip_end(which) and abs(g) <= p.slip_tol / p.dm.v_scale
    landed = which == LANDING and abs(g) <= at.dip_left and y[Y.dip] * y[Y.w_b] < 0.0
    found = -at.past <= g <= 0.0 or at_rest or landed
    return g, which, root_bracket.PROBE_FOUND if found else root_bracket.PROBE_LOOK_ON


@compiled
def first_crossing(p, event, least):
    """Locate the first zero of the armed event functions in a step over which the least of them fell to `least` <= 0.

    Each probe is a step of its own. The state is past the zero by a hair, so that what changes there has changed clearly.
    Returns the event, at which the step ends now; or UNSOUND.
    """
    h, values = p.control.size, p.b.values[1]
    g_low, _ = least_value(p, p.b.start, values)
    past = ZERO_PASSED * p.tol * (abs(g_low) + abs(least))
    dip_left = DIP_LEFT * past if p.b.start.y[Y.dip] != 0.0 else 0.0  # an end that has just left does not land
    at, guess, slope = PhaseCrossing(p, event, past, dip_left), 0.0, 0.0
    if p.control.method != RESCALED:
        guess, slope = root_bracket.zero_on_cubic(value_on_cubic, at, p.bracket, h, values[event], least)
    root_bracket.set_bracket(p.bracket, h, g_low, least, guess, slope)
    return root_bracket.locate(probe_step, at, p.bracket, h, -0.5 * past, True)


@compiled
def low_between(p, turn):
    """Whether a force or a hold is so low at an end of a step over which the motion turns so far that it may dip to zero."""
    for k in range(N_FORCE_EVENTS):
        first, last = p.b.values[0, k], p.b.values[3, k]
        if p.b.armed[k] > 0.0 and last > 0.0 and min(first, last) < LOW_FORCE * turn * turn:
            return True
    return False


@compiled
def hidden_dip(p, h):
    """Share of an accepted step of h seconds at which an event function may dip below zero between positive ends, 1.0 if none.

    (A step that ends with an event of one function may hide the dip of another one.)

    It is only looked for where a force or a hold is low, or a dip that falls at the start rises at the end, or a jam is near.
    The functions are evaluated on the cubic through the step's ends; the parabola through the lowest of them and its
    neighbours, less the errors of that cubic and of that parabola for a function that changes as quickly as the motion,
    bounds what lies between. The bottom of that parabola may lie just outside the step though that of the dip is just inside.
    """
    b, values, turn = p.b, p.b.values, motion_rate(p.dm, p.b.start.y) * h
    sign = end(p.dm, leading(p.modes)).s
    returns = b.armed[LANDING] > 0.0 and sign * b.start.y[Y.w_b] > 0.0 > sign * b.out.y[Y.w_b]
    if not (returns or b.armed[JAM] > 0.0 or low_between(p, turn)):
        return 1.0
    # errors of a cubic by Hermite, and of a parabola through thirds of the step
    doubt = turn * turn * turn * turn / 384.0 + turn / 24.0
    for k in range(1, 3):
        look_on_cubic(p, k / 3.0, h, True)
        least_value(p, b.probe, values[k])
    share = 1.0
    for k in range(N_CONTACT_EVENTS):
        if b.armed[k] == 0.0 or is_slip_end(k) or k == LEAVES_CHART or values[3, k] <= 0.0:
            continue
        q = 1 if values[1, k] <= values[2, k] else 2
        low = values[q, k]
        left, right = values[q - 1, k] - low, values[q + 1, k] - low
        if not left + right > 0.0:
            continue
        shift = 0.5 * (left - right) / (left + right)
        bottom = low - 0.25 * (left - right) * shift
        if -2.0 * doubt < q + shift < 3.0 + 2.0 * doubt and bottom <= doubt * max(left, right):
            share = min(share, min(max(NARROW, (q + shift) / 3.0), 1.0 - NARROW))
    return share
