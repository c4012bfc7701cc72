"""Follow a phase of sustained contact from its start to its first event, step by step."""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact import coordinates, events, step_control
from dimersweep.kernel.contact.contact_mode import MOMENT
from dimersweep.kernel.contact.coordinates import N_CLOSED, N_PATH, Y, set_slip, slip_of
from dimersweep.kernel.contact.events import GOES_ON, JAM, LANDING, OUT_OF_STEPS, least_value, motion_rate
from dimersweep.kernel.contact.forces import COMPLIANCE, F1, F2, N_F, contact_rates
from dimersweep.kernel.contact.step_control import (
    IMPLICIT,
    PLAIN_METHOD,
    RESCALED,
    SLIP_CHANGE,
    TIGHT,
    Phase,
    stiffness,
)
from dimersweep.kernel.contact.works import settle_works, works_to_slip_end
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.layout import FREE, SLIP
from dimersweep.kernel.numerics.elementary import eighth_root, length
from dimersweep.kernel.numerics.meter import is_over
from dimersweep.kernel.numerics.root_bracket import UNSOUND
from dimersweep.kernel.numerics.steps import copy, step_factor

# steps of a phase in one chart: the bound on the work of a run comes first, as a rule
MAX_PHASE_STEPS = 200000
MAX_CHARTS = 20000  # changes of the chart in a phase
# step, in forcing periods, below which the contact force counts as growing beyond all bounds, and in which no event
# hides: some tens of units of round-off of the plate's phase
LEAST_STEP = 1e-14
# time in which the slip turns, in forcing periods, below which the plain method is left: its steps would be short
PLAIN_LEAST_TURN = 0.02
# rate at which a slip decreases, in units of gamma, from which on the rescaled method follows it
FALLING = 0.15
# rate at which the compliance falls, in units of itself times gamma / v, from which on the rescaled method is taken
SOON = 0.1
# rate at which friction brakes the turn of a spinning dimer, per forcing period, from which on this is stiff
BRAKED = 1e3
# turns of a slip (gamma / v times the step) that an explicit step may span: DOP853 is stable up to 6.4 on the negative
# real axis, and gamma is a bound on the rate of the turning
PHASE_TURNS = 7.0
LONGEST_STEP = 0.25  # longest step, in forcing periods
# first steps, in forcing periods and in xi, over the tolerance to the power of 1/8 (errors go with the eighth power of
# a step)
FIRST_PHASE_STEP, FIRST_RESCALED = 1.6, 15.0
# slip, in units of the slip that counts as none, below which its direction is not known: with `SLIP_SCALE` it is the
# tolerance of a slip
UNSURE_SLIP = 10.0
# explicit step over the time in which a turning slip comes to rest, over the tolerance to the power of 1/16: as
# measured
HALTING = 1.4
# implicit step over the time in which a slip comes to rest: as measured
SLIDING = 0.65
# factor from a step to the next, at most, by the rescaled and the implicit method
RISE = 3.0
# step over the time of a landing in sight: slightly past the landing, so that the step brackets it
PAST_LANDING = 1.02


@compiled
def sustain_contact(dm, c, span, until, path, tol, work):
    """Integrate a phase of sustained contact to its first event, or until a time [s]; c.y is modified in place.

    `span` is the time that the steps are chosen for, `until` the time to stop at (see `Phase`). `path` is True if x1,
    y1 and gamma are wanted; they are integrated where works are wanted, too. Return the time integrated [s] and the
    number of the event. It is JAM also where no step is short enough, NO_EVENT if the time is over, and OUT_OF_STEPS
    where steps or meter are at their bound.
    """
    b, control, bracket = work.step[0], work.control[0], work.bracket[0]
    t, n = 0.0, N_PATH if path else N_CLOSED
    if work.course[0].tally.wanted:
        n = coordinates.N_WORKED
    for _ in range(MAX_CHARTS):
        phase = c.phase + dm.omega * t
        p = Phase(dm, c.modes, phase, span - t, until - t, tol, c.slip_tol, n, b, control, bracket, work.meter)
        event = sustain_in_chart(p, c.y)
        copy(p.b.start.y, c.y, coordinates.N_Y)
        t += p.control.time
        if event != events.LEAVES_CHART:
            return t, event
        coordinates.change_chart(dm, end(dm, coordinates.leading(c.modes)).s, c.y)
    return t, OUT_OF_STEPS


@compiled
def sustain_in_chart(p, y):
    """Follow the contact phase from y to its first event, and return the event; LEAVES_CHART is one of them.

    The phase begins with the rates at y, the event functions that are positive there, and first guesses of the steps.
    """
    b, c = p.b, p.control
    step_control.begin_at(p, y)
    for k in range(events.N_CONTACT_EVENTS):
        b.armed[k] = 0.0
    if p.modes[0] == FREE or p.modes[1] == FREE:
        # armed at once: an end that has just left has a dip of zero, and would not be armed by it
        b.armed[LANDING], b.armed[events.LEAVES_CHART] = 1.0, 1.0
    events.arm_events(p, b.values[0])
    least_value(p, b.start, b.values[0])
    natural = eighth_root(p.tol)
    c.cut, c.time, c.natural = False, 0.0, natural
    c.h, c.xi = FIRST_PHASE_STEP * natural * p.dm.period, FIRST_RESCALED * natural
    if without_force(p) >= 0:
        # the time after which the force was found to press: the first step is to see the force rise
        c.h = MOMENT / motion_rate(p.dm, b.start.y)
    if b.start.F[COMPLIANCE] <= 0.0:
        return JAM
    for _ in range(MAX_PHASE_STEPS):
        if is_over(p.meter):
            break
        event = step_on(p)
        if event != GOES_ON:
            return event
    return OUT_OF_STEPS


@compiled
def step_on(p):
    """Take one step, or shorten it; return the event that ends the phase, or GOES_ON."""
    b, c, start, out = p.b, p.control, p.b.start, p.b.out
    if c.time >= p.until:
        return events.NO_EVENT
    start.y[Y.time] = 0.0
    c.stiffness = stiffness(p, max(start.F[F1], start.F[F2]))
    c.now = p.phase + p.dm.omega * c.time
    c.speed, c.speed_rate = coordinates.slip_speed(p.dm, p.modes, start.y, start.dy)
    event = end_slip_on_line(p)
    if event != GOES_ON:
        return event
    choose_step(p)
    # no event comes so early: a sample asks for a time before the event of its run. A step in xi could not end at a
    # time
    if c.cut:
        c.method, c.size = PLAIN_METHOD if c.method == PLAIN_METHOD else IMPLICIT, p.until - c.time
    error = step_control.step_to(p, c.now, c.size)
    factor = step_factor(error)
    if c.cut:
        return end_cut_step(p, error)
    # not <= 1: a step whose error is nan fails, too. A step in xi must not lead past the span: its length in time is
    # known only now
    if not error <= 1.0 or (c.method == RESCALED and out.y[Y.time] > p.span - c.time):
        # at most 0.8: else the next try might fail as well by a hair; an infinite error says nothing of the step that
        # will do
        return shorten(p, 0.3 if error == inf else min(factor, 0.8))
    # a jam is looked for only where it may be near: its function costs nothing, but the search for its dips does
    b.armed[JAM] = 1.0 if min(start.F[COMPLIANCE], out.F[COMPLIANCE]) < TIGHT else 0.0
    b.values[0, JAM] = start.F[COMPLIANCE]
    least, event = least_value(p, out, b.values[3])
    # first, because a hidden event would be earlier than the one at hand
    if may_hide_event(p, least, event):
        return GOES_ON
    if p.until < p.span and c.time + out.y[Y.time] > p.until:
        c.cut = True
        return GOES_ON
    if least <= 0.0:
        return stop_at_event(p, least, event)
    return accept_step(p, factor)


@compiled
def slip_about_to_end(p, span):
    """Return the number of a slipping end that comes to rest along a straight line soon, -1 if none does.

    The time is brief, and at most `span`. The slip and the change of the slip must be parallel to within the tolerance;
    within a tolerance of rest it is enough that the slip decreases. Brief is a time over which a straight line is as
    good as the tolerance: the error of the line is quadratic. A slip that takes longer is followed by steps, however
    slow it is: the steps look for what else happens meanwhile, such as a lift-off.
    """
    dm, y = p.dm, p.b.start.y
    # the error of a straight line over an angle x of the motion is x^2 / 2: a fifth of the tolerance for x = 0.6
    # tol^(1/2)
    brief = min(span, 0.6 * sqrt(p.tol) / motion_rate(dm, y))
    for i in range(2):
        if p.modes[i] == SLIP:
            v, along, turning = coordinates.change_of_slip(dm, p.modes, y, p.b.start.dy, i)
            if along < 0.0 and v * v <= -along * brief:
                across = abs(turning) * v / -along
                if v <= UNSURE_SLIP * p.slip_tol or across <= 0.5 * p.tol * dm.v_scale:
                    return i
    return -1


@compiled
def end_slip_on_line(p):
    """Follow a slip that is about to end along a straight line to its end; return that event, or GOES_ON."""
    c, y, dy = p.control, p.b.start.y, p.b.start.dy
    # a slip that sets out had its mode chosen: the sign of its rate, which may be rounding, does not end it at once
    sets_out = c.time == 0.0 and c.speed <= p.slip_tol
    if sets_out or not c.speed < PLAIN_LEAST_TURN * p.dm.period * c.stiffness:
        return GOES_ON
    i = slip_about_to_end(p, min(landing_in_sight(p) / PAST_LANDING, p.span - c.time))
    if i < 0:
        return GOES_ON
    (a, b), (d_a, d_b) = slip_of(p.dm, p.modes, y, i), slip_of(p.dm, p.modes, dy, i)
    v2 = a * a + b * b
    # the slip v falls at the rate u . u' / v, and so for the time v^2 / -(u . u'); a slip that counts as none ends at
    # once
    t = -v2 / (a * d_a + b * d_b) if v2 > p.slip_tol * p.slip_tol else 0.0
    ends = p.until == p.span or c.time + t <= p.until
    if not ends:
        t = p.until - c.time
    if p.n > N_PATH:
        works_to_slip_end(p, t)
    # the dip goes on at its present acceleration: to first order alone the smallest hops would gain energy
    y[Y.dip] += 0.5 * t * t * dy[Y.w_b]
    for k in range(min(p.n, N_PATH)):
        y[k] += t * dy[k]
    c.time += t
    if not ends:
        return events.NO_EVENT
    set_slip(p.dm, p.modes, y, i, 0.0, 0.0)
    return events.SLIP_END + i


@compiled
def choose_step(p):
    """Choose the method of the next step and its size."""
    dm, start, c = p.dm, p.b.start, p.control
    v, gamma, left = c.speed, c.stiffness, p.span - c.time
    method = method_for(p)
    # the first step from no force is to be brief: c.h is (see `sustain_in_chart`), c.xi is not
    unsure = c.time == 0.0 and without_force(p) >= 0
    if method == RESCALED and (unsure or 2.0 * c.xi * v / gamma > left):
        method = IMPLICIT
    h = min(c.h, LONGEST_STEP * dm.period)
    # a slip that sets out has to find its direction: half of the usual first step
    if c.time == 0.0 and method == IMPLICIT:
        h = min(h, 0.5 * FIRST_PHASE_STEP * c.natural * dm.period)
    # a step ends before a slip comes to rest at its present rate, whose direction is lost there: 0.9 of the time at
    # most
    if method != RESCALED:
        slowing = SLIDING if method == IMPLICIT else (0.9 if v == inf else min(0.9, HALTING * sqrt(c.natural)))
        h = min(h, min(slowing * coordinates.slip_limit(dm, p.modes, start.y, start.dy), landing_in_sight(p)))
    # within the step the force may rise: at least half the weight counts
    if method == PLAIN_METHOD and gamma > 0.0:
        h = min(h, PHASE_TURNS * v / max(gamma, stiffness(p, 0.5 * dm.m * dm.g)))
    # no last step of a length of mere rounding is left over
    last = method != RESCALED and h >= left * (1.0 - 1e-12)
    if last:
        h = left
    c.method, c.last, c.h, c.size = method, last, h, c.xi if method == RESCALED else h


@compiled
def method_for(p):
    """Return the method that suits the slip as it changes, and as it may jam soon.

    A fast spin loads one of two slipping ends by J_a spin theta' / l. The friction under this load then brakes theta'
    at the rate mu spin J_a / J_t, which may be stiff.
    """
    dm, v, gamma, braked = p.dm, p.control.speed, p.control.stiffness, 0.0
    if p.modes[0] == SLIP and p.modes[1] == SLIP:
        braked = max(dm.p1.mu, dm.p2.mu) * abs(p.b.start.y[Y.spin]) * dm.J_a * dm.it
    # the slip turns slowly, or has no direction to turn (v is inf)
    if v >= PLAIN_LEAST_TURN * dm.period * gamma:
        return IMPLICIT if braked * dm.period > BRAKED else PLAIN_METHOD
    return RESCALED if jams_soon(p) or (p.control.speed_rate < -FALLING * gamma and braked * v < gamma) else IMPLICIT


@compiled
def jams_soon(p):
    """Return True if the compliance falls to zero as fast as the slip turns."""
    start, probe, v = p.b.start, p.b.probe, p.control.speed
    if start.F[COMPLIANCE] > TIGHT or not 0.0 < v < inf:
        return False
    t = SLIP_CHANGE * v / p.control.stiffness
    for k in range(N_CLOSED):
        probe.y[k] = start.y[k] + t * start.dy[k]
    contact_rates(p.dm, p.modes, p.control.now + p.dm.omega * t, probe.y, False, probe.dy, probe.F)
    return start.F[COMPLIANCE] - probe.F[COMPLIANCE] > SOON * SLIP_CHANGE * start.F[COMPLIANCE]


@compiled
def landing_in_sight(p):
    """Return the time [s] in which the open end lands at its present acceleration, times PAST_LANDING; inf if never."""
    modes, y = p.modes, p.b.start.y
    sign = 1.0 if modes[0] != FREE else -1.0
    gap, rate, fall = sign * y[Y.dip], sign * y[Y.w_b], sign * p.b.start.dy[Y.w_b]
    if (modes[0] != FREE and modes[1] != FREE) or y[Y.chart] == coordinates.UPRIGHT or gap < 0.0:
        return inf
    # an end that has just left: the step is half of its hop at constant acceleration, 2 rate / -fall
    if gap == 0.0:
        return -rate / fall if rate > 0.0 and fall < 0.0 else inf
    # gap + rate t + fall t^2 / 2 = 0, below with the root that needs no difference of numbers of like size
    disc = rate * rate - 2.0 * fall * gap
    if disc < 0.0 or (rate >= 0.0 and fall >= 0.0):
        return inf
    return PAST_LANDING * (2.0 * gap / (sqrt(disc) - rate) if rate < 0.0 else (rate + sqrt(disc)) / -fall)


@compiled
def shorten(p, factor):
    """Shorten the next step by a factor; return JAM if no step is short enough, else GOES_ON."""
    c = p.control
    if c.method == RESCALED:
        c.xi *= factor
        length = c.xi * c.speed / c.stiffness
    else:
        c.h *= factor
        length = c.h
    return JAM if length < LEAST_STEP * p.dm.period else GOES_ON


@compiled
def may_hide_event(p, least, event):
    """Return True if the step is to be taken again, shorter, because an event may hide in it."""
    c, part = p.control, 1.0
    if c.method == RESCALED:
        return False
    if least > 0.0:
        part = events.hidden_dip(p, c.h)
    # an end that left at the start of the step and has landed at its end: a bracket of the landing has to begin in the
    # air, so that the step is halved until it ends there
    if part < 1.0 or (least <= 0.0 and event == LANDING and p.b.start.y[Y.dip] == 0.0):
        # at most half: a step that is hardly shorter might hide the event as before
        c.h *= min(part, 0.5)
        return c.h > LEAST_STEP * p.dm.period
    return False


@compiled
def stop_at_event(p, least, event):
    """Go to the first event in the step, and return it.

    Return GOES_ON if the step is to be taken again, or if a slip only turns by a right angle.
    """
    b, c, y = p.b, p.control, p.b.start.y
    event = events.first_crossing(p, event, least)
    if event == UNSOUND:
        return shorten(p, 0.5)
    if c.method != RESCALED:
        least_value(p, b.out, b.values[3])
        dt = b.out.y[Y.time]
        part = events.hidden_dip(p, dt) if events.low_between(p, motion_rate(p.dm, y) * dt) else 1.0
        if part < 1.0 and dt > LEAST_STEP * p.dm.period:
            c.h = part * dt
            return GOES_ON
    go_to_end(p)
    c.time += max(0.0, y[Y.time])
    if not events.is_slip_end(event):
        return event
    # a slip that still is some times the one that counts as none has not ended: only its part along the old direction
    # has
    if length(*slip_of(p.dm, p.modes, y, events.end_of(event))) <= 4.0 * p.slip_tol:
        set_slip(p.dm, p.modes, y, events.end_of(event), 0.0, 0.0)
        return event
    # the slip has only turned by a right angle within the step: shorter steps follow its turn
    c.h, c.xi = 0.5 * c.h, 0.5 * c.xi
    least_value(p, b.start, b.values[0])
    return GOES_ON


@compiled
def end_cut_step(p, error):
    """End the phase with a step to the time `until`; return GOES_ON if that takes more than one step."""
    c = p.control
    if error <= 1.0:
        go_to_end(p)
        c.time = p.until
        return events.NO_EVENT
    c.cut, c.h, c.xi = False, 0.5 * c.size, 0.5 * c.xi
    return GOES_ON


@compiled
def go_to_end(p):
    """Make the end of the step the state of the phase."""
    start, out = p.b.start, p.b.out
    if p.n > N_PATH:
        settle_works(p)
    copy(out.y, start.y, p.n)
    copy(out.dy, start.dy, p.n)
    copy(out.F, start.F, N_F)


@compiled
def accept_step(p, factor):
    """Go to the end of the step, and guess the size of the next one; return a lift-off there, or GOES_ON."""
    b, c, dt = p.b, p.control, p.b.out.y[Y.time]
    go_to_end(p)
    c.time = p.span if c.last else c.time + dt
    pulled = without_force(p)
    # a force that was never positive is not armed, so that no zero of it can be located: the end leaves here
    if pulled >= 0 and b.armed[events.LIFT_OFF + pulled] == 0.0:
        return events.LIFT_OFF + pulled
    copy(b.values[3], b.values[0], events.N_CONTACT_EVENTS)
    events.arm_events(p, b.values[0])
    if c.method == RESCALED:
        # xi counts the turns of the slip, so that PHASE_TURNS bounds it
        c.xi, c.h = min(PHASE_TURNS, min(factor, RISE) * c.xi), 2.0 * dt
    else:
        c.h *= min(factor, RISE) if c.method == IMPLICIT else factor
    return GOES_ON


@compiled
def without_force(p):
    """Return the number of a closed end whose normal force does not press, -1 if there is none."""
    for i in range(2):
        if p.modes[i] != FREE and p.b.start.F[F1 + 3 * i] <= 0.0:
            return i
    return -1
