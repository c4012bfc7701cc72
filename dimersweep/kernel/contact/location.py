"""Where in a step of a contact phase its event lies, and whether a step may hide one."""

from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import Y, leading
from dimersweep.kernel.contact.events import (
    JAM,
    LANDING,
    LEAVES_CHART,
    N_CONTACT_EVENTS,
    N_FORCE_EVENTS,
    event_function,
    is_slip_end,
    least_value,
    motion_rate,
    needs_forces,
)
from dimersweep.kernel.contact.forces import contact_rates
from dimersweep.kernel.contact.step_control import RESCALED, step_to
from dimersweep.kernel.model.body import end
from dimersweep.kernel.numerics.root_bracket import (
    PROBE_FOUND,
    PROBE_LOOK_ON,
    PROBE_REFUSED,
    UNSOUND,
    locate,
    set_bracket,
    zero_on_cubic,
)
from dimersweep.kernel.numerics.steps import on_cubic

NARROW = 0.02  # share of a step in which the bottom of a dip may hide at either end
# force or hold which may dip to zero, in weights and per square of the angle that the motion turns in a step
LOW_FORCE = 0.5
# what an event function may be past its zero, in units of the tolerance and of its change in the step
ZERO_PASSED = 1e-3
DIP_LEFT = 100.0  # in units of that, what may be left of a dip when the open end lands: it is then set to zero


class PhaseCrossing(NamedTuple):
    """A step of a contact phase with an event in it."""

    p: Any
    event: int  # number of the event function that is least at its end
    past: float  # what it may be past its zero
    dip_left: float  # what may be left of a dip when the open end lands


@compiled(inline=True)
def look_on_cubic(p, share, h, forces):
    """Go to a share of a step of h seconds, on the cubic through its ends."""
    start, out, at = p.b.start, p.b.out, p.b.probe
    on_cubic(start.y, start.dy, out.y, out.dy, share, h, p.n, at.y)
    if forces:
        contact_rates(p.dm, p.modes, p.control.now + p.dm.omega * h * share, at.y, False, at.dy, at.F)


@compiled(inline=True)
def value_on_cubic(at, share):
    """The event function on the cubic through the ends of the step, at a share of it."""
    look_on_cubic(at.p, share, at.p.control.size, needs_forces(at.event))
    return event_function(at.p, at.event, at.p.b.probe.y, at.p.b.probe.F)


@compiled(inline=True)
def probe_step(at, t):
    """Take the step up to t: the least event function there, its event, and PROBE_FOUND, PROBE_LOOK_ON or PROBE_REFUSED."""
    p, y = at.p, at.p.b.out.y
    if not step_to(p, p.control.now, t) <= 1.0:
        return 0.0, UNSOUND, PROBE_REFUSED
    g, which = least_value(p, p.b.out, p.b.values[1])
    at_rest = is_slip_end(which) and abs(g) <= p.slip_tol / p.dm.v_scale
    landed = which == LANDING and abs(g) <= at.dip_left and y[Y.dip] * y[Y.w_b] < 0.0
    return g, which, PROBE_FOUND if -at.past <= g <= 0.0 or at_rest or landed else PROBE_LOOK_ON


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
        guess, slope = zero_on_cubic(value_on_cubic, at, p.bracket, h, values[event], least)
    set_bracket(p.bracket, h, g_low, least, guess, slope)
    return locate(probe_step, at, p.bracket, h, -0.5 * past, True)


@compiled
def low_between(p, turn):
    """Whether a force or a hold is so low at an end of a step over which the motion turns so far that it may dip to zero."""
    for k in range(N_FORCE_EVENTS):
        first, last = p.b.values[0, k], p.b.values[3, k]
        if p.b.armed[k] > 0.0 and last > 0.0 and min(first, last) < LOW_FORCE * turn * turn:
            return True
    return False


@compiled(inline=True)
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
    doubt = turn**4 / 384.0 + turn / 24.0
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
