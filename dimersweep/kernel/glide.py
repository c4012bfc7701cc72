"""A phase of sustained contact from its start to its first event: integration, and the location of the event.

Three clocks drive it. Plain: DOP853 in time. Slow: DOP853 in xi with dt = (v / gamma) dxi, for a slip v on its way to or
from zero, whose direction turns at the rate gamma / v: per xi nothing is stiff and the slip changes exponentially.
Implicit: Rodas5P in time, for slip that stays slow.
"""

from math import hypot, inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.contact import (
    F1,
    F2,
    N_CLOSED,
    N_PATH,
    YB,
    YGAMMA,
    YS,
    YTHETA,
    YTIME,
    YUA,
    YUB,
    YWB,
    YWP,
    YX,
    YY,
    contact_rates,
    slip_of,
)
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import FREE, SLIP
from dimersweep.kernel.steps import (
    DOP_STAGES,
    ROS_STAGES,
    copy,
    error_norm,
    explicit_method,
    implicit_load,
    implicit_stage,
    inside,
    lu_factor,
    lu_solve,
    shrink,
    step_factor,
)
from dimersweep.kernel.tableaux import ROS_C, ROS_D, ROS_GAMMA
from dimersweep.kernel.watch import (
    LANDS,
    N_EVENTS,
    SLIP_ZERO,
    arm,
    glide_value,
    least_value,
    nearly_stopped,
    run_in,
    run_out,
    slip_limit,
    slip_speed,
    stop_slip,
)

NO_EVENT, OUT_OF_STEPS = -1, -2
PLAIN, SLOW, IMPLICIT = 0, 1, 2
MAX_STEPS = 20000
MAX_PROBES = 80
STIFF = 0.02  # time in which the slip turns, in forcing periods, below which the plain clock is left
FALLING, RISING = 0.15, 0.5  # rate of slip, in units of gamma, from which the slow clock takes it
CARE = 30.0  # with it the base orbit is as accurate as its tolerance; 1 costs a third of the speed for no digit more
LONGEST = 0.125  # longest step, in forcing periods
GLIDE_ROWS = 48

glide_stage, glide_finish = explicit_method(N_CLOSED)


class Bench(NamedTuple):
    """Rows of the work array, by what they hold during a step."""

    K: Any  # stages
    J: Any  # Jacobian and its LU factors
    LU: Any
    out: Any  # the end of the step
    F: Any  # forces at the last evaluation
    dy: Any  # rates at the start of the step, and at its end
    dy_end: Any
    scale: Any  # tolerances of the state
    armed: Any  # event functions that have been positive
    dt: Any  # time derivative of the rates
    pivots: Any
    up: Any
    down: Any
    probe: Any
    start: Any  # the start of the step


@compiled
def lay_out(work):
    """The bench on a work array of at least GLIDE_ROWS rows."""
    return Bench(
        work[0:12],
        work[12:23],
        work[23:34],
        work[34],
        work[35],
        work[36],
        work[37],
        work[38],
        work[39],
        work[40],
        work[41],
        work[42],
        work[43],
        work[44],
        work[45],
    )


@compiled
def set_scales(dm, tol, scale):
    """Tolerances of the contact state: angles, rates, slips and lengths in the scales of the scene."""
    scale[YB] = scale[YTHETA] = tol
    scale[YWB] = scale[YWP] = tol * dm.w_scale
    scale[YS] = 10.0 * tol * dm.w_scale
    scale[YUA] = scale[YUB] = tol * dm.v_scale
    scale[YTIME] = tol * dm.T
    scale[YX] = scale[YY] = tol * dm.r
    scale[YGAMMA] = 10.0 * tol


@compiled
def stiffness(dm, F):
    """gamma: the rate at which friction turns a slip, times its speed [m s-2]."""
    return dm.mu * (1.0 / dm.m + dm.h * dm.h / dm.J_t + dm.r * dm.r / dm.J_a) * max(F[F1], F[F2])


@compiled
def slowness(dm, modes, y):
    """Slip speed of the slow clock: that of the one slipping end, or half the harmonic mean of both."""
    inverse = 0.0
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            inverse += 1.0 / hypot(a, b)
    return 1.0 / inverse


@compiled
def explicit_step(dm, modes, phase, h, n, clock, gamma, b):
    """One DOP853 step from b.start into b.out, of h seconds or, on the slow clock, h units of xi; returns the error."""
    for i in range(DOP_STAGES):
        glide_stage(i, h, b.start, b.K, n, b.out)
        contact_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, n > N_CLOSED, b.K[i], b.F)
        if clock == SLOW:
            pace = slowness(dm, modes, b.out) / gamma
            for k in range(n):
                b.K[i, k] *= pace
    return glide_finish(h, b.start, b.K, n, b.scale, b.out)


@compiled
def perturbation(dm, k, y, v, double):
    """Size of a change of entry k of the state that is small against the slip v."""
    if k == YWB or k == YS:
        return dm.w_scale
    if k == YWP:
        return min(dm.w_scale, max(0.5 * v / dm.h, 1e-6 * abs(y[k]))) if double else dm.w_scale
    return v if k == YUA or k == YUB else 1.0


@compiled
def glide_jacobian(dm, modes, phase, n, v, b):
    """Jacobian of ``contact_rates`` at b.start and its time derivative, by central differences."""
    step = 3e-6
    double = modes[0] != FREE and modes[1] != FREE
    path = n > N_CLOSED
    copy(b.start, b.probe, n)
    for k in range(n):
        for j in range(n):
            b.J[j, k] = 0.0
        if k >= YTIME or (k == YTHETA and not path):
            continue
        d = step * perturbation(dm, k, b.start, v, double)
        b.probe[k] = b.start[k] + d
        above = b.probe[k]
        contact_rates(dm, modes, phase, b.probe, path, b.up, b.F)
        b.probe[k] = b.start[k] - d
        contact_rates(dm, modes, phase, b.probe, path, b.down, b.F)
        width = above - b.probe[k]
        b.probe[k] = b.start[k]
        for j in range(n):
            b.J[j, k] = (b.up[j] - b.down[j]) / width
    contact_rates(dm, modes, phase + step, b.start, path, b.up, b.F)
    contact_rates(dm, modes, phase - step, b.start, path, b.down, b.F)
    for j in range(n):
        b.dt[j] = (b.up[j] - b.down[j]) / (2.0 * step) * dm.omega


@compiled
def implicit_step(dm, modes, phase, h, n, b):
    """One Rodas5P step from b.start into b.out, with the Jacobian in b.J; returns the error over the tolerance."""
    for i in range(n):
        for j in range(n):
            b.LU[i, j] = -b.J[i, j]
        b.LU[i, i] += 1.0 / (ROS_GAMMA * h)
    if not lu_factor(b.LU, n, b.pivots):
        return inf
    for i in range(ROS_STAGES):
        implicit_stage(i, b.start, b.K, n, b.out)
        contact_rates(dm, modes, phase + dm.omega * h * ROS_C[i], b.out, n > N_CLOSED, b.K[i], b.F)
        implicit_load(i, h, b.K, n, b.K[i])
        for k in range(n):
            b.K[i, k] += h * ROS_D[i] * b.dt[k]
        lu_solve(b.LU, n, b.pivots, b.K[i])
    for k in range(n):
        b.out[k] += b.K[ROS_STAGES - 1, k]
    return error_norm(b.K, ROS_STAGES - 1, N_CLOSED, b.scale)


@compiled
def step_to(dm, modes, phase, h, n, clock, gamma, b):
    """One step; the rates (per time) and forces at its end are left in b.dy_end, b.F. Returns the error."""
    if clock == IMPLICIT:
        error = implicit_step(dm, modes, phase, h, n, b)
        b.out[YTIME] = h
    else:
        error = explicit_step(dm, modes, phase, h, n, clock, gamma, b)
    contact_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, n > N_CLOSED, b.dy_end, b.F)
    return error


@compiled
def hermite(b, s, h, n, out):
    """Cubic through the ends of a step (of the clocks in time) at share s, into `out`."""
    u = 1.0 - s
    for k in range(n):
        rise = b.out[k] - b.start[k]
        out[k] = b.start[k] + s * rise + s * u * ((2.0 * s - 1.0) * rise + h * (u * b.dy[k] - s * b.dy_end[k]))


@compiled
def value_on_cubic(dm, modes, phase, s, h, n, slip_tol, b):
    """Least armed event function on the cubic through the ends of a step, at share s."""
    hermite(b, s, h, n, b.probe)
    contact_rates(dm, modes, phase + dm.omega * h * s, b.probe, False, b.down, b.F)
    least, _ = least_value(dm, modes, b.armed, b.start, b.probe, b.F, slip_tol)
    return least


@compiled
def crossing_on_cubic(dm, modes, phase, h, n, g_start, g_end, slip_tol, b):
    """First guess of the share of a step at which an event function vanishes, and the slope of the function there."""
    low, high, g_low, g_high, side = 0.0, 1.0, g_start, g_end, 0
    mid = 0.5
    for _ in range(8):
        mid = inside(low, high, g_low, g_high)
        g = value_on_cubic(dm, modes, phase, mid, h, n, slip_tol, b)
        if abs(g) <= 1e-5 * (g_start - g_end):
            break
        low, high, g_low, g_high, side = shrink(low, high, g_low, g_high, mid, g, side)
    g = value_on_cubic(dm, modes, phase, mid, h, n, slip_tol, b)
    g_on = value_on_cubic(dm, modes, phase, mid + 1e-3, h, n, slip_tol, b)
    return mid, (g_on - g) / 1e-3


@compiled
def first_crossing(dm, modes, phase, h, n, clock, gamma, event, least, slip_tol, b):
    """Locate the first zero of the armed event functions in a step over which the least of them fell to `least` <= 0.

    Each probe is a step of its own from b.start: the first at the zero on the cubic through the step, the next ones by
    Newton's rule with the slope there, then by bracketed regula falsi.

    Returns
    -------
    int
        The event; b.out is the state there.
    """
    contact_rates(dm, modes, phase, b.start, False, b.down, b.F)
    low, high, g_high, side = 0.0, h, least, 0
    g_low, _ = least_value(dm, modes, b.armed, b.start, b.start, b.F, slip_tol)
    floor = 1e-14 * (abs(g_low) + abs(g_high))
    guess, slope = 0.0, 0.0
    if clock != SLOW:
        share, per_share = crossing_on_cubic(dm, modes, phase, h, n, g_low, g_high, slip_tol, b)
        guess, slope = share * h, per_share / h
    for probe in range(MAX_PROBES):
        if high - low <= 1e-15 * h:
            break
        mid = guess if probe < 4 and low < guess < high else inside(low, high, g_low, g_high)
        step_to(dm, modes, phase, mid, n, clock, gamma, b)
        g, which = least_value(dm, modes, b.armed, b.start, b.out, b.F, slip_tol)
        if abs(g) <= floor:
            return which
        event = which if g <= 0.0 else event
        low, high, g_low, g_high, side = shrink(low, high, g_low, g_high, mid, g, side)
        guess = mid - g / slope if slope < 0.0 else 0.0
    step_to(dm, modes, phase, high, n, clock, gamma, b)
    return event


@compiled
def hidden_dip(dm, modes, phase, h, n, slip_tol, b):
    """Share of an accepted step at which an event function may dip below zero between positive ends; 1.0 if none does.

    The functions are evaluated on the cubic through the step's ends; the parabola through the lowest of them bounds what
    lies between.
    """
    values = b.LU
    for q in range(5):
        hermite(b, 0.25 * q, h, n, b.probe)
        contact_rates(dm, modes, phase + 0.25 * q * dm.omega * h, b.probe, False, b.down, b.F)
        for k in range(SLIP_ZERO + 1):
            m = LANDS if k == SLIP_ZERO else k
            values[k, q] = glide_value(dm, modes, m, b.start, b.probe, b.F, slip_tol) if b.armed[m] > 0.0 else inf
    share = 1.0
    for k in range(SLIP_ZERO + 1):
        low_at = 0
        for q in range(1, 5):
            if values[k, q] < values[k, low_at]:
                low_at = q
        if low_at == 0 or low_at == 4:
            continue
        low = values[k, low_at]
        left, right = values[k, low_at - 1] - low, values[k, low_at + 1] - low
        shift = 0.5 * (left - right) / (left + right) if left + right > 0.0 else 0.0
        if low - 0.25 * (left - right) * shift <= 0.0:
            share = min(share, 0.25 * (low_at + shift))
    return share


@compiled
def first_step(dm, modes, y, dy):
    """Step to begin with: well inside the hop of the other end, if that has just left the plate."""
    h = 0.05 * dm.T
    rise, fall = y[YWB], dy[YWB]
    if modes[0] == FREE:
        rise, fall = -rise, -fall
    if y[YB] == 0.0 and rise > 0.0 and fall < 0.0:
        h = min(h, -rise / fall)
    return h


@compiled
def clock_for(dm, v, rate, gamma):
    """The clock that suits a slip v that changes at a rate."""
    if v >= STIFF * dm.T * gamma:
        return PLAIN
    return SLOW if rate < -FALLING * gamma or rate > RISING * gamma else IMPLICIT


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
        NO_EVENT (the span is over), the number of the event, or OUT_OF_STEPS.
    """
    n = N_PATH if path else N_CLOSED
    b = lay_out(work)
    set_scales(dm, tol, b.scale)
    contact_rates(dm, modes, phase, y, path, b.dy, b.F)
    for k in range(N_EVENTS):
        b.armed[k] = 0.0
    arm(dm, modes, b.armed, y, b.F, slip_tol)
    if modes[0] == FREE or modes[1] == FREE:
        b.armed[LANDS] = 1.0
    t = run_in(dm, modes, y, b.dy, span, tol, slip_tol, n)
    if t > 0.0:
        contact_rates(dm, modes, phase + dm.omega * t, y, path, b.dy, b.F)
        arm(dm, modes, b.armed, y, b.F, slip_tol)
    h, xi = first_step(dm, modes, y, b.dy), 10.0
    fresh = True  # b.start is new: the Jacobian has to be formed
    gamma = stiffness(dm, b.F)
    for _ in range(MAX_STEPS):
        if t >= span:
            return t, NO_EVENT
        if fresh:
            y[YTIME] = 0.0
            copy(y, b.start, N_PATH)
            gamma = stiffness(dm, b.F)
        now = phase + dm.omega * t
        v, rate = slip_speed(dm, modes, y, b.dy)
        if v < STIFF * dm.T * gamma:
            stopping = nearly_stopped(dm, modes, y, b.dy, span - t, tol, slip_tol) if watch else -1
            if stopping >= 0:
                t += run_out(dm, modes, y, b.dy, stopping, slip_tol, n)
                return t, SLIP_ZERO + stopping
        # a slip that sets out remembers its first direction: its errors then count against its own smallness
        unit = min(dm.v_scale, CARE * sqrt(v * dm.v_scale)) if rate > 0.0 else dm.v_scale
        b.scale[YUA] = b.scale[YUB] = tol * unit
        clock = clock_for(dm, v, rate, gamma)
        if clock == SLOW and 2.0 * xi * v / gamma > span - t:
            clock = IMPLICIT
        h = min(h, LONGEST * dm.T)
        if clock != SLOW:
            h = min(h, slip_limit(dm, modes, y, b.dy))
        last = clock != SLOW and h >= (span - t) * (1.0 - 1e-12)
        if last:
            h = span - t
        if clock == IMPLICIT and fresh:
            glide_jacobian(dm, modes, now, n, v, b)
        fresh = clock == SLOW or clock == PLAIN
        size = xi if clock == SLOW else h
        error = step_to(dm, modes, now, size, n, clock, gamma, b)
        dt = b.out[YTIME]
        factor = step_factor(error, 5.0 if clock == IMPLICIT else 8.0)
        if not error <= 1.0 or (clock == SLOW and dt > span - t):
            factor = min(factor, 0.5)
            h, xi = (h, factor * xi) if clock == SLOW else (factor * h, xi)
            continue
        if watch:
            least, event = least_value(dm, modes, b.armed, b.start, b.out, b.F, slip_tol)
            part = 1.0
            if least > 0.0 and clock != SLOW:
                part = hidden_dip(dm, modes, now, h, n, slip_tol, b)
            if part < 1.0 or (least <= 0.0 and event == LANDS and y[YB] == 0.0 and clock != SLOW):
                h *= min(part, 0.5)
                if h > 1e-12 * dm.T:
                    continue
            if least <= 0.0:
                event = first_crossing(dm, modes, now, size, n, clock, gamma, event, least, slip_tol, b)
                copy(b.out, y, n)
                t += b.out[YTIME]
                if not SLIP_ZERO <= event < LANDS:
                    return t, event
                s_a, s_b = slip_of(dm, modes, y, event % 2)
                if hypot(s_a, s_b) <= 4.0 * slip_tol:
                    stop_slip(dm, modes, y, event % 2)
                    return t, event
                h, xi, fresh = 0.5 * h, 0.5 * xi, True  # the slip has only turned by a right angle
                copy(b.dy_end, b.dy, n)
                continue
        contact_rates(dm, modes, now + dm.omega * dt, b.out, path, b.dy, b.F)
        copy(b.out, y, n)
        t = span if last else t + dt
        fresh = True
        arm(dm, modes, b.armed, y, b.F, slip_tol)
        if clock == SLOW:
            xi, h = factor * xi, 2.0 * dt
        else:
            h *= factor
    return t, OUT_OF_STEPS
