"""Where in a step of a contact phase its event lies, and whether a step may hide one."""

from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import YDIP, YWB, leading
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

    dm: Any
    p: Any
    event: Any  # number of the event function that is least at its end
    past: Any  # what it may be past its zero
    dip_left: Any  # what may be left of a dip when the open end lands
    b: Any


@compiled(inline=True)
def value_on_cubic(at, share):
    """The event function on the cubic through the ends of the step, at a share of it."""
    dm, p, b, c = at.dm, at.p, at.b, at.b.control[0]
    on_cubic(b.start, b.dy, b.out, b.dy_out, share, c.size, p.n, b.probe)
    if needs_forces(at.event):
        contact_rates(dm, p.modes, c.now + dm.omega * c.size * share, b.probe, False, b.dy_probe, b.F_probe)
    return event_function(dm, p.modes, at.event, b.start, b.probe, b.F_probe, p.slip_tol)


@compiled(inline=True)
def probe_step(at, t):
    """Take the step up to t: the least event function there, its event, and PROBE_FOUND, PROBE_LOOK_ON or PROBE_REFUSED."""
    dm, p, b, c = at.dm, at.p, at.b, at.b.control[0]
    if not step_to(dm, p.modes, c.now, t, p.n, c.method, c.stiffness, b) <= 1.0:
        return 0.0, UNSOUND, PROBE_REFUSED
    g, which = least_value(dm, p.modes, b.armed, b.start, b.out, b.F_out, p.slip_tol, b.values[1])
    at_rest = is_slip_end(which) and abs(g) <= p.slip_tol / dm.v_scale
    landed = which == LANDING and abs(g) <= at.dip_left and b.out[YDIP] * b.out[YWB] < 0.0
    return g, which, PROBE_FOUND if -at.past <= g <= 0.0 or at_rest or landed else PROBE_LOOK_ON


@compiled(inline=True)
def values_on_cubic(dm, modes, phase, s, h, n, slip_tol, b, values):
    """Armed event functions on the cubic through the ends of a step, at share s, into `values`; returns the least."""
    on_cubic(b.start, b.dy, b.out, b.dy_out, s, h, n, b.probe)
    contact_rates(dm, modes, phase + dm.omega * h * s, b.probe, False, b.dy_probe, b.F_probe)
    least, _ = least_value(dm, modes, b.armed, b.start, b.probe, b.F_probe, slip_tol, values)
    return least


@compiled
def first_crossing(dm, p, event, least, b):
    """Locate the first zero of the armed event functions in a step over which the least of them fell to `least` <= 0.

    Each probe is a step of its own from b.start. The state is past the zero by a hair, so that what changes there has changed
    clearly.

    Returns
    -------
    int
        The event, b.out being the state there; or UNSOUND.
    """
    s, h, method = b.bracket[0], b.control[0].size, b.control[0].method
    g_low, _ = least_value(dm, p.modes, b.armed, b.start, b.start, b.F, p.slip_tol, b.values[1])
    past = ZERO_PASSED * p.tol * (abs(g_low) + abs(least))
    dip_left = DIP_LEFT * past if b.start[YDIP] != 0.0 else 0.0  # an end that has just left does not land
    at, guess, slope = PhaseCrossing(dm, p, event, past, dip_left, b), 0.0, 0.0
    if method != RESCALED:
        guess, slope = zero_on_cubic(value_on_cubic, at, s, h, b.values[1, event], least)
    set_bracket(s, h, g_low, least, guess, slope)
    return locate(probe_step, at, s, h, -0.5 * past, True)


@compiled
def low_between(b, turn):
    """Whether a force or a hold is so low at an end of a step over which the motion turns so far that it may dip to zero."""
    for k in range(N_FORCE_EVENTS):
        first, last = b.values[0, k], b.values[3, k]
        if b.armed[k] > 0.0 and last > 0.0 and min(first, last) < LOW_FORCE * turn * turn:
            return True
    return False


@compiled(inline=True)
def hidden_dip(dm, modes, phase, h, n, slip_tol, b):
    """Share of an accepted step at which an event function may dip below zero between positive ends; 1.0 if none does.

    (A step that ends with an event of one function may hide the dip of another one.)

    It is only looked for where a force or a hold is low, or a dip that falls at the start rises at the end, or a jam is near.
    The functions are evaluated on the cubic through the step's ends; the parabola through the lowest of them and its
    neighbours, less the errors of that cubic and of that parabola for a function that changes as quickly as the motion,
    bounds what lies between. The bottom of that parabola may lie just outside the step though that of the dip is just inside.
    """
    values, turn = b.values, motion_rate(dm, b.start) * h
    sign = end(dm, leading(modes)).s
    returns = b.armed[LANDING] > 0.0 and sign * b.start[YWB] > 0.0 > sign * b.out[YWB]
    if not (returns or b.armed[JAM] > 0.0 or low_between(b, turn)):
        return 1.0
    doubt = turn**4 / 384.0 + turn / 24.0
    values_on_cubic(dm, modes, phase, 1.0 / 3.0, h, n, slip_tol, b, values[1])
    values_on_cubic(dm, modes, phase, 2.0 / 3.0, h, n, slip_tol, b, values[2])
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
