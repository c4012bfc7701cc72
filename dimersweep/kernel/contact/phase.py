"""A phase of sustained contact from its start to its first event: its steps, and what ends it."""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    N_CLOSED,
    N_PATH,
    N_WORKED,
    UPRIGHT,
    YCHART,
    YDIP,
    YS,
    YTIME,
    YWB,
    change_chart,
    leading,
    set_slip,
    slip_of,
)
from dimersweep.kernel.contact.events import (
    GOES_ON,
    JAM,
    LANDING,
    LEAVES_CHART,
    LIFT_OFF,
    N_CONTACT_EVENTS,
    NO_EVENT,
    OUT_OF_STEPS,
    SLIP_END,
    arm_events,
    end_of,
    is_slip_end,
    least_value,
    motion_rate,
    run_to_slip_end,
    slip_about_to_end,
    slip_limit,
    slip_speed,
)
from dimersweep.kernel.contact.forces import COMPLIANCE, F1, F2, N_F, contact_rates
from dimersweep.kernel.contact.location import first_crossing, hidden_dip, low_between
from dimersweep.kernel.contact.powers import phase_rates
from dimersweep.kernel.contact.step_control import (
    IMPLICIT,
    PLAIN_METHOD,
    RESCALED,
    TIGHT,
    Phase,
    set_chart,
    set_scales,
    step_arrays,
    step_to,
    stiffness,
)
from dimersweep.kernel.contact.works import settle_works, works_to_slip_end
from dimersweep.kernel.model.body import TWO_PI, end
from dimersweep.kernel.model.layout import FREE, SLIP
from dimersweep.kernel.numerics.elementary import eighth_root, length
from dimersweep.kernel.numerics.meter import is_over
from dimersweep.kernel.numerics.root_bracket import UNSOUND
from dimersweep.kernel.numerics.steps import copy, step_factor

MAX_PHASE_STEPS = 200000
MAX_CHARTS = 20000
# first step of a phase that begins without force, in turns of its motion: after it the end presses, or lifts off
FIRST_WITHOUT_FORCE = 1e-5
LEAST_STEP = 1e-14  # step, in forcing periods, below which the contact force grows beyond all bounds
PLAIN_LEAST_TURN = 0.02  # time in which the slip turns, in forcing periods, below which the plain method is left
FALLING = 0.15  # rate of slip, in units of -gamma, from which the rescaled method takes it
# rate at which the compliance falls, in units of itself and of gamma / v, that calls for the rescaled method
SOON = 0.1
BRAKED = 1e3  # braking of the turn of a spinning dimer, per forcing period, from which it is stiff
PHASE_TURNS = 7.0  # of a slip, that an explicit step may span: what the method bears
SLIGHT = 1e-6  # turn of the slip over which that rate is taken [rad]
LONGEST_STEP = 0.25  # longest step, in forcing periods
# first steps, in forcing periods and in xi, over the tolerance to the power of 1/8
FIRST_PHASE_STEP, FIRST_RESCALED = 1.6, 15.0
HALTING = 1.4  # step over the time to rest of a slip that turns, over the tolerance to the power of 1/16: as measured
SLIDING = 0.65  # the same of an implicit step: as measured
RISE = 3.0  # of the step from one to the next, at most, by the rescaled and the implicit method
SHORTEST = 1e-12  # step, in forcing periods, that is not shortened for an event that may hide in it
PAST_LANDING = 1.02  # how far past a landing in sight a step goes


@compiled
def sustain_contact(dm, modes, y, phase, span, path, tol, slip_tol, locate, work):
    """Integrate a phase of sustained contact, y in place, to its first event, or over `span` seconds.

    Parameters
    ----------
    phase : float
        Plate phase at the start [rad].
    path : bool
        Whether x1, y1 and gamma are wanted; they are where works are.
    tol : float
        Error per step, in units of the scales of the state.
    slip_tol : float
        Slip that counts as none [m/s].
    locate : bool
        Whether to look for events (a phase that is sampled again has none inside).

    Returns
    -------
    t : float
        Time integrated [s].
    event : int
        NO_EVENT (the span is over), the number of the event (JAM also where no step is short enough), or
        OUT_OF_STEPS, also where the meter of the work array is over.
    """
    t, n = 0.0, N_PATH if path else N_CLOSED
    if work.course[0].tally.wanted:
        n = N_WORKED
    for _ in range(MAX_CHARTS):
        p = Phase(modes, y, phase + dm.omega * t, span - t, tol, slip_tol, n, locate)
        part, event = sustain_in_chart(dm, p, work)
        t += part
        if event != LEAVES_CHART:
            return t, event
        change_chart(dm, end(dm, leading(modes)).s, y)
    return t, OUT_OF_STEPS


@compiled
def sustain_in_chart(dm, p, work):
    """The contact phase to its first event, LEAVES_CHART among them; returns its time and the event."""
    b = step_arrays(work)
    begin_phase(dm, p, b)
    if b.F[COMPLIANCE] <= 0.0:
        return 0.0, JAM
    for _ in range(MAX_PHASE_STEPS):
        if is_over(b.meter):
            break
        event = step_on(dm, p, b)
        if event != GOES_ON:
            return b.control[0].time, event
    return b.control[0].time, OUT_OF_STEPS


@compiled(inline=True)
def begin_phase(dm, p, b):
    """The rates at the start, the event functions that are positive there, and first guesses of the steps."""
    modes, y, c = p.modes, p.y, b.control[0]
    set_scales(dm, p.tol, b.scale)
    for k in range(N_PATH, p.n):
        b.scale[k] = c.doubt
    set_chart(y, b)
    phase_rates(dm, modes, p.phase, y, p.n, b.dy, b.F)
    for k in range(N_CONTACT_EVENTS):
        b.armed[k] = 0.0
    if modes[0] == FREE or modes[1] == FREE:
        b.armed[LANDING], b.armed[LEAVES_CHART] = 1.0 if p.locate else 0.0, 1.0
    if p.locate:
        arm_events(dm, modes, b.armed, y, b.F, p.slip_tol, b.values[0])
    least_value(dm, modes, b.armed, y, y, b.F, p.slip_tol, b.values[0])
    natural = eighth_root(p.tol)
    c.time, c.natural, c.h, c.xi = 0.0, natural, FIRST_PHASE_STEP * natural * dm.period, FIRST_RESCALED * natural
    if without_force(modes, b.F) >= 0:
        c.h = FIRST_WITHOUT_FORCE * TWO_PI / motion_rate(dm, y)


@compiled(inline=True)
def step_on(dm, p, b):
    """Take one step, or find that it has to be shorter; returns the event that ends the phase, or GOES_ON."""
    c = b.control[0]
    if c.time >= p.span:
        return NO_EVENT
    begin_step(dm, p, b)
    event = end_slip_on_line(dm, p, b)
    if event != GOES_ON:
        return event
    choose_step(dm, p, b)
    error = step_to(dm, p.modes, c.now, c.size, p.n, c.method, c.stiffness, b)
    factor = step_factor(error, 8.0)
    if not error <= 1.0 or (c.method == RESCALED and b.out[YTIME] > p.span - c.time):
        return shorten(dm, 0.3 if error == inf else min(factor, 0.8), b)
    least, event = least_after_step(dm, p, b)
    if may_hide_event(dm, p, least, event, b):
        return GOES_ON
    if least <= 0.0:
        return stop_at_event(dm, p, least, event, b)
    return accept_step(dm, p, factor, b)


@compiled(inline=True)
def begin_step(dm, p, b):
    """What a step starts from, and how stiff its slip is."""
    y, c = p.y, b.control[0]
    y[YTIME] = 0.0
    copy(y, b.start, p.n)
    c.stiffness = stiffness(dm, p.modes, y, max(b.F[F1], b.F[F2]))
    c.now = p.phase + dm.omega * c.time
    c.speed, c.speed_rate = slip_speed(dm, p.modes, y, b.dy)


@compiled(inline=True)
def end_slip_on_line(dm, p, b):
    """Carry a slip that is about to end along a straight line to its end; returns that event, or GOES_ON."""
    modes, y, c = p.modes, p.y, b.control[0]
    sets_out = c.time == 0.0 and c.speed <= p.slip_tol  # its mode was chosen: rounding has no say in its rate
    if p.locate and not sets_out and c.speed < PLAIN_LEAST_TURN * dm.period * c.stiffness:
        lands = landing_in_sight(modes, y, b.dy) / PAST_LANDING
        i = slip_about_to_end(dm, modes, y, b.dy, min(lands, p.span - c.time), p.tol, p.slip_tol)
        if i >= 0:
            t = run_to_slip_end(dm, modes, y, b.dy, i, p.slip_tol, p.n)
            if p.n > N_PATH:
                works_to_slip_end(dm, p, t, b)
            c.time += t
            return SLIP_END + i
    return GOES_ON


@compiled(inline=True)
def choose_step(dm, p, b):
    """Choose the method of the next step and its size."""
    modes, y, c = p.modes, p.y, b.control[0]
    v, gamma, left = c.speed, c.stiffness, p.span - c.time
    tight = jams_soon(dm, modes, c.now, v, gamma, b)
    method = method_for(dm, modes, y, v, c.speed_rate, gamma, tight)
    unended = not p.locate and v <= p.slip_tol  # no event ends it, and rescaled steps would never take it to zero
    unsure = c.time == 0.0 and without_force(modes, b.F) >= 0  # that step is brief, as c.h says and c.xi does not
    if method == RESCALED and (unended or unsure or 2.0 * c.xi * v / gamma > left):
        method = IMPLICIT
    h = min(c.h, LONGEST_STEP * dm.period)
    if c.time == 0.0 and method == IMPLICIT:
        h = min(h, 0.5 * FIRST_PHASE_STEP * c.natural * dm.period)
    if method != RESCALED:
        slowing = SLIDING if method == IMPLICIT else (0.9 if v == inf else min(0.9, HALTING * sqrt(c.natural)))
        h = min(h, min(slowing * slip_limit(dm, modes, y, b.dy), landing_in_sight(modes, y, b.dy)))
    if method == PLAIN_METHOD and gamma > 0.0:
        h = min(h, PHASE_TURNS * v / max(gamma, stiffness(dm, modes, y, 0.5 * dm.m * dm.g)))
    last = method != RESCALED and h >= left * (1.0 - 1e-12)
    if last:
        h = left
    c.method, c.last, c.h, c.size = method, last, h, c.xi if method == RESCALED else h


@compiled
def method_for(dm, modes, y, v, rate, gamma, tight):
    """The method that suits a slip v that changes at a rate, and may jam soon.

    A fast spin loads one of two slipping ends by J_a spin theta' / l, and what it rubs then brakes theta' at the rate
    mu spin J_a / J_t, which may be stiff.
    """
    braked = max(dm.p1.mu, dm.p2.mu) * abs(y[YS]) * dm.J_a * dm.it if modes[0] == SLIP and modes[1] == SLIP else 0.0
    if v >= PLAIN_LEAST_TURN * dm.period * gamma:
        return IMPLICIT if braked * dm.period > BRAKED else PLAIN_METHOD
    return RESCALED if tight or (rate < -FALLING * gamma and braked * v < gamma) else IMPLICIT


@compiled(inline=True)
def jams_soon(dm, modes, phase, v, gamma, b):
    """Whether the compliance falls to zero as fast as the slip v turns."""
    if b.F[COMPLIANCE] > TIGHT or not 0.0 < v < inf:
        return False
    t = SLIGHT * v / gamma
    for k in range(N_CLOSED):
        b.probe[k] = b.start[k] + t * b.dy[k]
    contact_rates(dm, modes, phase + dm.omega * t, b.probe, False, b.dy_probe, b.F_probe)
    return b.F[COMPLIANCE] - b.F_probe[COMPLIANCE] > SOON * SLIGHT * b.F[COMPLIANCE]


@compiled
def landing_in_sight(modes, y, dy):
    """Time after which the open end has landed at its present acceleration, and a little more; inf if it does not."""
    sign = 1.0 if modes[0] != FREE else -1.0
    gap, rate, fall = sign * y[YDIP], sign * y[YWB], sign * dy[YWB]
    if (modes[0] != FREE and modes[1] != FREE) or y[YCHART] == UPRIGHT or gap < 0.0:
        return inf
    if gap == 0.0:  # it has just left: a step within its hop
        return -rate / fall if rate > 0.0 and fall < 0.0 else inf
    disc = rate * rate - 2.0 * fall * gap
    if disc < 0.0 or (rate >= 0.0 and fall >= 0.0):
        return inf
    return PAST_LANDING * (2.0 * gap / (sqrt(disc) - rate) if rate < 0.0 else (rate + sqrt(disc)) / -fall)


@compiled
def shorten(dm, factor, b):
    """Shorten the next step; returns JAM if no step is short enough, else GOES_ON."""
    c = b.control[0]
    if c.method == RESCALED:
        c.xi *= factor
        length = c.xi * c.speed / c.stiffness
    else:
        c.h *= factor
        length = c.h
    return JAM if length < LEAST_STEP * dm.period else GOES_ON


@compiled(inline=True)
def least_after_step(dm, p, b):
    """Least of the event functions after the step, and its number."""
    b.armed[JAM] = 1.0 if min(b.F[COMPLIANCE], b.F_out[COMPLIANCE]) < TIGHT else 0.0
    b.values[0, JAM] = b.F[COMPLIANCE]
    return least_value(dm, p.modes, b.armed, b.start, b.out, b.F_out, p.slip_tol, b.values[3])


@compiled(inline=True)
def may_hide_event(dm, p, least, event, b):
    """Whether the step is to be taken again, shorter, because an event may hide in it."""
    c = b.control[0]
    if c.method == RESCALED:
        return False
    part = 1.0
    if p.locate and least > 0.0:
        part = hidden_dip(dm, p.modes, c.now, c.h, p.n, p.slip_tol, b)
    if part < 1.0 or (least <= 0.0 and event == LANDING and p.y[YDIP] == 0.0):
        c.h *= min(part, 0.5)
        return c.h > SHORTEST * dm.period
    return False


@compiled(inline=True)
def stop_at_event(dm, p, least, event, b):
    """Go to the first event in the step, and return it; GOES_ON if the step is to be taken again, or a slip only turns."""
    modes, y, c = p.modes, p.y, b.control[0]
    event = first_crossing(dm, p, event, least, b)
    if event == UNSOUND:
        return shorten(dm, 0.5, b)
    if p.locate and c.method != RESCALED:
        least_value(dm, modes, b.armed, b.start, b.out, b.F_out, p.slip_tol, b.values[3])
        dt = b.out[YTIME]
        low = low_between(b, motion_rate(dm, b.start) * dt)
        part = hidden_dip(dm, modes, c.now, dt, p.n, p.slip_tol, b) if low else 1.0
        if part < 1.0 and dt > SHORTEST * dm.period:
            c.h = part * dt
            return GOES_ON
    if p.n > N_PATH:
        settle_works(dm, p, b)
    copy(b.out, y, p.n)
    c.time += max(0.0, b.out[YTIME])
    if not is_slip_end(event):
        return event
    a_slip, b_slip = slip_of(dm, modes, y, end_of(event))
    if length(a_slip, b_slip) <= 4.0 * p.slip_tol:
        set_slip(dm, modes, y, end_of(event), 0.0, 0.0)
        return event
    c.h, c.xi = 0.5 * c.h, 0.5 * c.xi  # the slip has only turned by a right angle
    copy(b.dy_out, b.dy, p.n)
    copy(b.F_out, b.F, N_F)
    least_value(dm, modes, b.armed, y, y, b.F, p.slip_tol, b.values[0])
    return GOES_ON


@compiled(inline=True)
def accept_step(dm, p, factor, b):
    """Go to the end of the step, and guess the size of the next one; returns a lift-off there, or GOES_ON."""
    modes, y, c, dt = p.modes, p.y, b.control[0], b.out[YTIME]
    if p.n > N_PATH:
        settle_works(dm, p, b)
    copy(b.out, y, p.n)
    copy(b.dy_out, b.dy, p.n)
    copy(b.F_out, b.F, N_F)
    c.time = p.span if c.last else c.time + dt
    pulled = without_force(modes, b.F)
    if p.locate and pulled >= 0 and b.armed[LIFT_OFF + pulled] == 0.0:
        return LIFT_OFF + pulled
    copy(b.values[3], b.values[0], N_CONTACT_EVENTS)
    if p.locate:
        arm_events(dm, modes, b.armed, y, b.F, p.slip_tol, b.values[0])
    if c.method == RESCALED:
        c.xi, c.h = min(PHASE_TURNS, min(factor, RISE) * c.xi), 2.0 * dt
    else:
        c.h *= min(factor, RISE) if c.method == IMPLICIT else factor
    return GOES_ON


@compiled
def without_force(modes, F):
    """Number of a closed end whose force does not press, -1 if there is none."""
    for i in range(2):
        if modes[i] != FREE and F[F1 + 3 * i] <= 0.0:
            return i
    return -1
