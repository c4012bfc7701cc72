"""Define the events that end a phase of sustained contact, and locate them in a step.

Each event has a function that is positive while the phase goes on. A closed end leaves where its normal force would
break (3). It begins to slip where its friction would break the bound of (4) for stick. An open end lands where its gap
in (3) is zero. A slip ends where it is zero: then (4) has its other case.
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

# Events of a contact phase. A kind of event that an end has takes two numbers: the even one is p1's, the odd one p2's.
# A phase evaluates one event function for each number.
LIFT_OFF, HOLD_END, SLIP_END = 0, 2, 4
LANDING = 6  # the open end lands
LEAVES_CHART = 7  # no event of the dimer: the state leaves its chart
JAM = 8  # the force of a slip grows beyond all bounds (a dynamic jam)
N_CONTACT_EVENTS = 9
N_FORCE_EVENTS = SLIP_END  # events below this number are lift-offs and losses of a hold
# in place of an event: the time is over; a bound on steps, or on probes for a landing, was reached; the phase goes on
# (-3 is `root_bracket.UNSOUND`)
NO_EVENT, OUT_OF_STEPS, OUT_OF_PROBES, GOES_ON = -1, -2, -4, -5

# share of a step at either end into which no dip is placed: the next step is to be clearly shorter, and not next to
# none
NARROW = 0.02
# force or hold below which it may dip to zero within a step, in weights and per square of the angle that the motion
# turns in the step: a force of one weight that swings with the motion falls by half the square of that angle
LOW_FORCE = 0.5
# how far past its zero an event function may be, in units of the tolerance and of the change of the function in the
# step
ZERO_PASSED = 1e-3
# dip angle that may be left when the open end lands, in units of the distance by ZERO_PASSED: it is then set to zero
DIP_LEFT = 100.0


@compiled
def end_of(event):
    """Return the number of the end, 0 or 1, at which a lift-off, the loss of a hold or the end of a slip happens."""
    return event % 2


@compiled
def is_lift_off(event):
    """Return True if the event is that a closed end leaves the plate."""
    return LIFT_OFF <= event < HOLD_END


@compiled
def is_hold_end(event):
    """Return True if the event is that friction can no longer hold a sticking end."""
    return HOLD_END <= event < SLIP_END


@compiled
def is_slip_end(event):
    """Return True if the event is that the slip of an end comes to rest."""
    return SLIP_END <= event < LANDING


@compiled
def is_failure(event):
    """Return True if a bound was reached in place of an event."""
    return event == OUT_OF_STEPS or event == OUT_OF_PROBES


class ContactEvents(NamedTuple):
    """Moment of a phase at which event functions are evaluated; with no more than they need, as it is passed often."""

    dm: Any
    modes: Any
    slip_tol: float
    base: Any  # state at the start of the step
    y: Any
    F: Any
    values: Any  # the values of the functions, filled in


@compiled(inline=True)
def event_function(at, k):
    """Return event function k, positive while the phase goes on; inf where it has no meaning. All share a common scale.

    For a lift-off it is the normal force of an end, times the compliance: at a jam the force is infinite, and the
    product is zero only at a lift-off. For the loss of a hold it is the reserve of the friction that holds. For the end
    of a slip it is the slip along its direction at the start of the step. For a landing it is the dip, which opens the
    gap of the other end. For the chart it is the distance to its border, and for a jam the compliance.
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
    if is_hold_end(k):
        return hold_reserve(dm, modes, i, F) / (dm.m * dm.g) if modes[i] == STICK else inf
    if modes[i] != SLIP:
        return inf
    a0, b0 = slip_of(dm, modes, at.base, i)
    a, b = slip_of(dm, modes, y, i)
    return ((a * a0 + b * b0) / length(a0, b0) - at.slip_tol) / dm.v_scale


@compiled(inline=True)
def noted_value(at, k):
    """Return event function k, and write it into `at.values`."""
    at.values[k] = event_function(at, k)
    return at.values[k]


@compiled
def least_noted(at, armed):
    """Return the least of the armed event functions and its number, and write all armed ones; see `least_value`."""
    return root_bracket.least_armed(noted_value, at, armed, N_CONTACT_EVENTS)


@compiled(inline=True)
def least_value(p, at, values):
    """Return the least armed event function at a moment and its number (inf, -1 if none is armed); fill `values`."""
    return least_noted(ContactEvents(p.dm, p.modes, p.slip_tol, p.b.start.y, at.y, at.F, values), p.b.armed)


@compiled(inline=True)
def arm_events(p, values):
    """Arm event functions of the ends that have become positive at the start of a step; fill `values` with them."""
    y, F = p.b.start.y, p.b.start.F
    # the border of the chart and a jam are armed by the phase itself
    root_bracket.arm(noted_value, ContactEvents(p.dm, p.modes, p.slip_tol, y, y, F, values), p.b.armed, LANDING + 1)


@compiled
def motion_rate(dm, y):
    """Return the rate at which the motion changes [rad/s]: that of the plate, or of the falling and turning rod."""
    return max(dm.tempo, dm.w_scale + abs(y[Y.w_b]) + abs(y[Y.w_p]) + dm.J_a * dm.it * abs(y[Y.spin]))


# --- where an event lies in a step, and whether a step may hide one ------------------------------------------------------


class PhaseCrossing(NamedTuple):
    """Step of a contact phase with an event in it."""

    p: Any
    event: int  # number of the event function that is least at its end
    past: float  # how far past its zero the function may be
    dip_left: float  # dip angle that may be left when the open end lands


@compiled
def look_on_cubic(p, share, h, forces):
    """Go to a share of a step of h seconds, on the cubic through its ends.

    The state is written into the probe; its rates and forces too, if `forces` is True.
    """
    start, out, at = p.b.start, p.b.out, p.b.probe
    on_cubic(start.y, start.dy, out.y, out.dy, share, h, p.n, at.y)
    if forces:
        contact_rates(p.dm, p.modes, p.control.now + p.dm.omega * h * share, at.y, False, at.dy, at.F)


@compiled(inline=True)
def value_on_cubic(at, share):
    """Return the event function on the cubic through the ends of the step, at a share of it."""
    p, probe = at.p, at.p.b.probe
    look_on_cubic(p, share, p.control.size, at.event < SLIP_END or at.event == JAM)
    asked = ContactEvents(p.dm, p.modes, p.slip_tol, p.b.start.y, probe.y, probe.F, p.b.values[1])
    return event_function(asked, at.event)


@compiled(inline=True)
def probe_step(at, t):
    """Take a step of size t from the start of the step that has the event, and judge the event functions at its end.

    `t` is in the unit of the method of the step: seconds, or xi. Return the least event function there, its number, and
    the verdict: PROBE_FOUND if the event is located, else PROBE_LOOK_ON; PROBE_REFUSED if the error of the step exceeds
    the tolerance.
    """
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

    Each probe is a step of its own. The located state is past the zero by a hair, so that the function that changes
    sign there has clearly changed. Return the event, at which the step now ends; or UNSOUND.
    """
    h, values = p.control.size, p.b.values[1]
    g_low, _ = least_value(p, p.b.start, values)
    past = ZERO_PASSED * p.tol * (abs(g_low) + abs(least))
    # an end that has just left does not land at once
    dip_left = DIP_LEFT * past if p.b.start.y[Y.dip] != 0.0 else 0.0
    at, guess, slope = PhaseCrossing(p, event, past, dip_left), 0.0, 0.0
    if p.control.method != RESCALED:
        guess, slope = root_bracket.zero_on_cubic(value_on_cubic, at, p.bracket, h, values[event], least)
    root_bracket.set_bracket(p.bracket, h, g_low, least, guess, slope)
    # the aim is the middle of what is accepted, from -past to 0
    return root_bracket.locate(probe_step, at, p.bracket, h, -0.5 * past, True)


@compiled
def low_between(p, turn):
    """Return True if a force or a hold may dip to zero within the step: it is low at one of the ends of the step.

    `turn` is the angle by which the motion turns in the step [rad].
    """
    for k in range(N_FORCE_EVENTS):
        first, last = p.b.values[0, k], p.b.values[3, k]
        if p.b.armed[k] > 0.0 and last > 0.0 and min(first, last) < LOW_FORCE * turn * turn:
            return True
    return False


@compiled
def hidden_dip(p, h):
    """Return the share of an accepted step at which an event function may dip below zero, 1.0 if none may.

    Such a function is positive at both ends of the step. (A step that ends with an event of one function may hide the
    dip of another function.)

    A dip is looked for only in three cases: a force or a hold is low; a dip angle falls at the start of the step and
    rises at its end; or a jam is near. The functions are evaluated on the cubic through the ends of the step of h
    seconds. What lies between is bounded by the parabola through the lowest value and its neighbours, less the errors
    of cubic and parabola. These errors are those of a function that changes as quickly as the motion. The bottom of
    that parabola may lie just outside the step though the bottom of the dip is just inside.
    """
    b, values, turn = p.b, p.b.values, motion_rate(p.dm, p.b.start.y) * h
    sign = end(p.dm, leading(p.modes)).s
    returns = b.armed[LANDING] > 0.0 and sign * b.start.y[Y.w_b] > 0.0 > sign * b.out.y[Y.w_b]
    if not (returns or b.armed[JAM] > 0.0 or low_between(p, turn)):
        return 1.0
    # errors of a cubic by Hermite (h^4 / 384), and of a parabola through thirds of the step (their cubic term: h / 24)
    doubt = turn * turn * turn * turn / 384.0 + turn / 24.0
    # values[0] and values[3] have the functions at the ends of the step: these are its thirds
    for k in range(1, 3):
        look_on_cubic(p, k / 3.0, h, True)
        least_value(p, b.probe, values[k])
    share = 1.0
    for k in range(N_CONTACT_EVENTS):
        if b.armed[k] == 0.0 or is_slip_end(k) or k == LEAVES_CHART or values[3, k] <= 0.0:
            continue
        # the lower of the inner points: the parabola through it and its neighbours has its bottom `shift` thirds further
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
