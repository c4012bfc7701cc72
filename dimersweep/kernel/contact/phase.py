"""A phase of sustained contact from its start to its first event: integration, and the location of the event."""

from math import hypot, inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    N_CLOSED,
    N_PATH,
    UPRIGHT,
    YB,
    YCHART,
    YS,
    YTIME,
    YWB,
    change_chart,
    leading_sign,
    slip_of,
)
from dimersweep.kernel.contact.events import (
    JAMS,
    LANDS,
    LIFTS,
    N_EVENTS,
    SLIP_ZERO,
    TIPS,
    arm,
    glide_value,
    least_value,
    nearly_stopped,
    quickness,
    run_out,
    slip_limit,
    slip_speed,
    stop_slip,
)
from dimersweep.kernel.contact.forces import (
    COMPLIANCE,
    F1,
    F2,
    N_F,
    contact_rates,
)
from dimersweep.kernel.contact.step_control import (
    BENCH_ROWS,
    PLAIN,
    SLIDE,
    SLOW,
    TIGHT,
    lay_out,
    set_chart,
    set_scales,
    step_to,
    stiffness,
)
from dimersweep.kernel.model.body import TWO_PI
from dimersweep.kernel.model.layout import FREE, SLIP
from dimersweep.kernel.numerics.root_bracket import (
    CARRIED,
    S_AT,
    S_HIGH,
    UNSOUND,
    begin_search,
    is_closed,
    next_probe,
    note_probe,
)
from dimersweep.kernel.numerics.steps import copy, on_cubic, step_factor

NO_EVENT, OUT_OF_STEPS = -1, -2
MAX_STEPS = 200000
MAX_CHARTS = 20000
FAINT = 1e-5  # first step of a phase that begins without force, in turns of its motion: after it the end presses, or lifts off
LEAST = 1e-14  # step, in forcing periods, below which the contact force grows beyond all bounds
STIFF = 0.02  # time in which the slip turns, in forcing periods, below which the plain pace is left
FALLING = 0.15  # rate of slip, in units of -gamma, from which the slow pace takes it
SOON = 0.1  # rate at which the compliance falls, in units of itself and of gamma / v, that is a jam for the slow pace
BRAKED = 1e3  # braking of the turn of a spinning dimer, per forcing period, from which it is stiff
TURNS = 7.0  # of a slip, that an explicit step may span: what the method bears
SLIGHT = 1e-6  # turn of the slip over which that rate is taken [rad]
LONGEST = 0.25  # longest step, in forcing periods
FIRST, FIRST_SLOW = 1.6, 15.0  # first steps, in forcing periods and in xi, over the tolerance to the power of 1/8
HALTING = 1.4  # step over the time to rest of a slip that turns, over the tolerance to the power of 1/16: as measured
SLIDING = 0.65  # the same of a slide: as measured
RISE = 3.0  # of the step from one to the next, at most, at the slow pace and of slides
NARROW = 0.02  # share of a step in which the bottom of a dip may hide at either end
LOW = 0.5  # force or hold which may dip to zero, in weights and per square of the angle that the motion turns in a step
BEYOND = 1.02  # how far past a landing in sight a step goes
EXACT = 1e-3  # what an event function may be past its zero, in units of the tolerance and of its change in the step
CLOSE = 100.0  # in units of that, what may be left of a dip when the open end lands: it is then set to zero
GLIDE_ROWS = BENCH_ROWS


@compiled
def value_on_cubic(dm, modes, phase, s, h, n, event, slip_tol, b):
    """Event function `event` on the cubic through the ends of a step, at share s."""
    on_cubic(b.start, b.dy, b.out, b.dy_out, s, h, n, b.probe)
    if not SLIP_ZERO <= event <= TIPS:  # only these depend on the forces
        contact_rates(dm, modes, phase + dm.omega * h * s, b.probe, False, b.dy_probe, b.F_probe)
    return glide_value(dm, modes, event, b.start, b.probe, b.F_probe, slip_tol)


@compiled(inline=True)
def values_on_cubic(dm, modes, phase, s, h, n, slip_tol, b, values):
    """Armed event functions on the cubic through the ends of a step, at share s, into `values`; returns the least."""
    on_cubic(b.start, b.dy, b.out, b.dy_out, s, h, n, b.probe)
    contact_rates(dm, modes, phase + dm.omega * h * s, b.probe, False, b.dy_probe, b.F_probe)
    least, _ = least_value(dm, modes, b.armed, b.start, b.probe, b.F_probe, slip_tol, values)
    return least


@compiled
def crossing_on_cubic(dm, modes, phase, h, n, event, g_start, g_end, slip_tol, b):
    """First guess of the time in a step at which an event function vanishes, and the slope of the function there."""
    s, mid = b.search, 0.5
    begin_search(s, 1.0, g_start, g_end, 0.0, 0.0)
    for _ in range(8):
        mid = next_probe(s)
        g = value_on_cubic(dm, modes, phase, mid, h, n, event, slip_tol, b)
        if abs(g) <= 1e-5 * (g_start - g_end):
            break
        note_probe(s, mid, g, 0.0, False)
    g = value_on_cubic(dm, modes, phase, mid, h, n, event, slip_tol, b)
    g_on = value_on_cubic(dm, modes, phase, mid + 1e-3, h, n, event, slip_tol, b)
    slope = (g_on - g) / (1e-3 * h)
    return (mid * h - g / slope if slope < 0.0 else mid * h), slope


@compiled
def nearby(dm, y, tol):
    """Time over which the midpoint rule is as good as the tolerance [s]: its error is cubic."""
    return 0.6 * tol ** (1.0 / 3.0) / quickness(dm, y)


@compiled
def carry_on(dm, modes, phase, t, n, b):
    """Carry the end of a step on (or back) by t seconds, by the midpoint rule."""
    path = n > N_CLOSED
    for k in range(n):
        b.probe[k] = b.out[k] + 0.5 * t * b.dy_out[k]
    contact_rates(dm, modes, phase + dm.omega * b.probe[YTIME], b.probe, path, b.dy_probe, b.F_probe)
    for k in range(n):
        b.out[k] += t * b.dy_probe[k]
    contact_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, path, b.dy_out, b.F_out)


@compiled
def first_crossing(dm, modes, phase, h, n, pace, gamma, event, least, tol, slip_tol, b):
    """Locate the first zero of the armed event functions in a step over which the least of them fell to `least` <= 0.

    Each probe is a step of its own from b.start, or carries the last one on where it is near: the first at the zero on the
    cubic through the step, the next ones by Newton's rule, then by bracketed regula falsi. The state returned is past the
    zero by a hair, so that what changes there has changed clearly.

    Returns
    -------
    int
        The event, b.out being the state there; or UNSOUND.
    """
    g_low, _ = least_value(dm, modes, b.armed, b.start, b.start, b.F, slip_tol, b.values[1])
    past = EXACT * tol * (abs(g_low) + abs(least))
    close = CLOSE * past if b.start[YB] != 0.0 else 0.0  # an end that has just left is not taken for one that lands
    smooth, s = pace == PLAIN and not SLIP_ZERO <= event < LANDS, b.search
    near = nearby(dm, b.start, tol) if smooth else 0.0
    guess, slope = 0.0, 0.0
    if pace != SLOW:
        guess, slope = crossing_on_cubic(dm, modes, phase, h, n, event, b.values[1, event], least, slip_tol, b)
    begin_search(s, h, g_low, least, guess, slope)
    while not is_closed(s, h):
        mid = next_probe(s)
        way = mid - s[S_AT]
        if abs(way) <= min(near, CARRIED * mid):
            carry_on(dm, modes, phase, way, n, b)
        elif not step_to(dm, modes, phase, mid, n, pace, gamma, b) <= 1.0:
            return UNSOUND
        g, which = least_value(dm, modes, b.armed, b.start, b.out, b.F_out, slip_tol, b.values[1])
        at_rest = SLIP_ZERO <= which < LANDS and abs(g) <= slip_tol / dm.v_scale
        if -past <= g <= 0.0 or at_rest or (which == LANDS and abs(g) <= close and b.out[YB] * b.out[YWB] < 0.0):
            return which
        event = which if g <= 0.0 else event
        note_probe(s, mid, g, -0.5 * past, True)
    step_to(dm, modes, phase, s[S_HIGH], n, pace, gamma, b)
    return event


@compiled
def low_between(b, turn):
    """Whether a force or a hold is so low at an end of a step over which the motion turns so far that it may dip to zero."""
    for k in range(SLIP_ZERO):
        first, last = b.values[0, k], b.values[3, k]
        if b.armed[k] > 0.0 and last > 0.0 and min(first, last) < LOW * turn * turn:
            return True
    return False


@compiled(inline=True)
def hidden_dip(dm, modes, phase, h, n, slip_tol, b):
    """Share of an accepted step at which an event function may dip below zero between positive ends; 1.0 if none does.

    (A step that ends with an event of one function may hide the dip of another one.)

    It is only looked for where a force or a hold is low, or a dip that falls at the start rises at the end, or a jam is near.
    The functions are evaluated on the cubic through the step's ends; the parabola through the lowest of them and its
    neighbours, less the errors of that cubic and of that parabola for a function that changes as quickly as the motion,
    bounds what lies between. It may put a bottom that lies just within the step just outside.
    """
    values, turn = b.values, quickness(dm, b.start) * h
    returns = b.armed[LANDS] > 0.0 and leading_sign(modes) * b.start[YWB] > 0.0 > leading_sign(modes) * b.out[YWB]
    if not (returns or b.armed[JAMS] > 0.0 or low_between(b, turn)):
        return 1.0
    doubt = turn**4 / 384.0 + turn / 24.0
    values_on_cubic(dm, modes, phase, 1.0 / 3.0, h, n, slip_tol, b, values[1])
    values_on_cubic(dm, modes, phase, 2.0 / 3.0, h, n, slip_tol, b, values[2])
    share = 1.0
    for k in range(N_EVENTS):
        if b.armed[k] == 0.0 or SLIP_ZERO <= k < LANDS or k == TIPS or values[3, k] <= 0.0:
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


@compiled
def landing_in_sight(dm, modes, y, dy):
    """Time after which the open end has landed at its present acceleration, and a little more; inf if it does not."""
    sign = 1.0 if modes[0] != FREE else -1.0
    gap, rate, fall = sign * y[YB], sign * y[YWB], sign * dy[YWB]
    if (modes[0] != FREE and modes[1] != FREE) or y[YCHART] == UPRIGHT or gap < 0.0:
        return inf
    if gap == 0.0:  # it has just left: a step within its hop
        return -rate / fall if rate > 0.0 and fall < 0.0 else inf
    disc = rate * rate - 2.0 * fall * gap
    if disc < 0.0 or (rate >= 0.0 and fall >= 0.0):
        return inf
    return BEYOND * (2.0 * gap / (sqrt(disc) - rate) if rate < 0.0 else (rate + sqrt(disc)) / -fall)


@compiled
def without_force(modes, F):
    """Number of a closed end whose force does not press, -1 if there is none."""
    for i in range(2):
        if modes[i] != FREE and F[F1 + 3 * i] <= 0.0:
            return i
    return -1


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
def pace_for(dm, modes, y, v, rate, gamma, tight):
    """The pace that suits a slip v that changes at a rate, and may jam soon.

    A fast spin loads one of two slipping ends by J_a spin theta' / 2h, and what it rubs then brakes theta' at the rate
    mu spin J_a / J_t, which may be stiff.
    """
    braked = dm.mu * abs(y[YS]) * dm.J_a * dm.it if modes[0] == SLIP and modes[1] == SLIP else 0.0
    if v >= STIFF * dm.T * gamma:
        return SLIDE if braked * dm.T > BRAKED else PLAIN
    return SLOW if tight or (rate < -FALLING * gamma and braked * v < gamma) else SLIDE


@compiled
def shortened(pace, h, xi, factor, v, gamma):
    """The steps in time and in xi with that of the pace shortened, and how long it is in time."""
    if pace == SLOW:
        return h, factor * xi, factor * xi * v / gamma
    return factor * h, xi, factor * h


@compiled
def glide_in_chart(dm, modes, y, phase, span, path, tol, slip_tol, watch, work):
    """The same until the state leaves its chart, which is the event TIPS, too."""
    n = N_PATH if path else N_CLOSED
    b = lay_out(work)
    set_scales(dm, tol, b.scale)
    set_chart(y, b)
    contact_rates(dm, modes, phase, y, path, b.dy, b.F)
    for k in range(N_EVENTS):
        b.armed[k] = 0.0
    if modes[0] == FREE or modes[1] == FREE:
        b.armed[LANDS], b.armed[TIPS] = 1.0 if watch else 0.0, 1.0
    if watch:
        arm(dm, modes, b.armed, y, b.F, slip_tol, b.values[0])
    least_value(dm, modes, b.armed, y, y, b.F, slip_tol, b.values[0])
    if b.F[COMPLIANCE] <= 0.0:
        return 0.0, JAMS
    natural = tol**0.125
    h, xi, t = FIRST * natural * dm.T, FIRST_SLOW * natural, 0.0
    if without_force(modes, b.F) >= 0:
        h = FAINT * TWO_PI / quickness(dm, y)
    for _ in range(MAX_STEPS):
        if t >= span:
            return t, NO_EVENT
        y[YTIME] = 0.0
        copy(y, b.start, N_PATH)
        gamma = stiffness(dm, y, max(b.F[F1], b.F[F2]))
        now = phase + dm.omega * t
        v, rate = slip_speed(dm, modes, y, b.dy)
        sets_out = t == 0.0 and v <= slip_tol  # its mode was chosen: what rounding says of its rate counts less
        if watch and not sets_out and v < STIFF * dm.T * gamma:
            lands = landing_in_sight(dm, modes, y, b.dy) / BEYOND
            stopping = nearly_stopped(dm, modes, y, b.dy, min(lands, span - t), tol, slip_tol)
            if stopping >= 0:
                t += run_out(dm, modes, y, b.dy, stopping, slip_tol, n)
                return t, SLIP_ZERO + stopping
        tight = jams_soon(dm, modes, now, v, gamma, b)
        pace = pace_for(dm, modes, y, v, rate, gamma, tight)
        if pace == SLOW and 2.0 * xi * v / gamma > span - t:
            pace = SLIDE
        h = min(h, LONGEST * dm.T)
        if t == 0.0 and pace == SLIDE:
            h = min(h, 0.5 * FIRST * natural * dm.T)
        if pace != SLOW:
            slowing = SLIDING if pace == SLIDE else (0.9 if v == inf else min(0.9, HALTING * sqrt(natural)))
            h = min(h, min(slowing * slip_limit(dm, modes, y, b.dy), landing_in_sight(dm, modes, y, b.dy)))
        if pace == PLAIN and gamma > 0.0:
            h = min(h, TURNS * v / max(gamma, stiffness(dm, y, 0.5 * dm.m * dm.g)))
        last = pace != SLOW and h >= (span - t) * (1.0 - 1e-12)
        if last:
            h = span - t
        size = xi if pace == SLOW else h
        error = step_to(dm, modes, now, size, n, pace, gamma, b)
        dt = b.out[YTIME]
        factor = step_factor(error, 8.0)
        if not error <= 1.0 or (pace == SLOW and dt > span - t):
            h, xi, left = shortened(pace, h, xi, 0.3 if error == inf else min(factor, 0.8), v, gamma)
            if left < LEAST * dm.T:
                return t, JAMS
            continue
        b.armed[JAMS] = 1.0 if min(b.F[COMPLIANCE], b.F_out[COMPLIANCE]) < TIGHT else 0.0
        b.values[0, JAMS] = b.F[COMPLIANCE]
        least, event = least_value(dm, modes, b.armed, b.start, b.out, b.F_out, slip_tol, b.values[3])
        part = 1.0
        if watch and least > 0.0 and pace != SLOW:
            part = hidden_dip(dm, modes, now, h, n, slip_tol, b)
        if part < 1.0 or (least <= 0.0 and event == LANDS and y[YB] == 0.0 and pace != SLOW):
            h *= min(part, 0.5)
            if h > 1e-12 * dm.T:
                continue
        if least <= 0.0:
            event = first_crossing(dm, modes, now, size, n, pace, gamma, event, least, tol, slip_tol, b)
            if event == UNSOUND:
                h, xi, left = shortened(pace, h, xi, 0.5, v, gamma)
                if left < LEAST * dm.T:
                    return t, JAMS
                continue
            if watch and pace != SLOW:
                least_value(dm, modes, b.armed, b.start, b.out, b.F_out, slip_tol, b.values[3])
                dt = b.out[YTIME]
                low = low_between(b, quickness(dm, b.start) * dt)
                part = hidden_dip(dm, modes, now, dt, n, slip_tol, b) if low else 1.0
                if part < 1.0 and dt > 1e-12 * dm.T:
                    h = part * dt
                    continue
            copy(b.out, y, n)
            t += max(0.0, b.out[YTIME])
            if not SLIP_ZERO <= event < LANDS:
                return t, event
            s_a, s_b = slip_of(dm, modes, y, event % 2)
            if hypot(s_a, s_b) <= 4.0 * slip_tol:
                stop_slip(dm, modes, y, event % 2)
                return t, event
            h, xi, last = 0.5 * h, 0.5 * xi, False  # the slip has only turned by a right angle
            copy(b.dy_out, b.dy, n)
            copy(b.F_out, b.F, N_F)
            least_value(dm, modes, b.armed, y, y, b.F, slip_tol, b.values[0])
            continue
        copy(b.out, y, n)
        copy(b.dy_out, b.dy, n)
        copy(b.F_out, b.F, N_F)
        t = span if last else t + dt
        pulled = without_force(modes, b.F)
        if watch and pulled >= 0 and b.armed[LIFTS + pulled] == 0.0:
            return t, LIFTS + pulled
        copy(b.values[3], b.values[0], N_EVENTS)
        if watch:
            arm(dm, modes, b.armed, y, b.F, slip_tol, b.values[0])
        if pace == SLOW:
            xi, h = min(TURNS, min(factor, RISE) * xi), 2.0 * dt
        else:
            h *= min(factor, RISE) if pace == SLIDE else factor
    return t, OUT_OF_STEPS


@compiled
def glide(dm, modes, y, phase, span, path, tol, slip_tol, watch, work):
    """Integrate a contact phase, y in place, over at most `span` seconds.

    Parameters
    ----------
    phase : float
        Plate phase at the start [rad].
    path : bool
        Whether x1, y1 and gamma are wanted.
    tol : float
        Error per step, in units of the scales of the state.
    slip_tol : float
        Slip that counts as none [m/s].
    watch : bool
        Whether to look for events (a phase that is sampled again has none inside).

    Returns
    -------
    t : float
        Time integrated [s].
    event : int
        NO_EVENT (the span is over), the number of the event (JAMS also where no step is short enough), or OUT_OF_STEPS.
    """
    t = 0.0
    for _ in range(MAX_CHARTS):
        part, event = glide_in_chart(dm, modes, y, phase + dm.omega * t, span - t, path, tol, slip_tol, watch, work)
        t += part
        if event != TIPS:
            return t, event
        change_chart(leading_sign(modes), y)
    return t, OUT_OF_STEPS
