"""A phase of sustained contact from its start to its first event: integration, and the location of the event."""

from math import hypot, inf
from typing import Any, NamedTuple

from dimersweep.kernel.contact import (
    F1,
    F2,
    N_PATH,
    N_THETA,
    YB,
    YS,
    YUA,
    YUB,
    YWB,
    YWP,
    contact_rates,
    hold_reserve,
    slip_of,
)
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import FREE, SLIP, STICK
from dimersweep.kernel.steps import (
    DOP_STAGES,
    ROS_STAGES,
    error_norm,
    explicit_finish,
    explicit_stage,
    implicit_load,
    implicit_stage,
    lu_factor,
    inside,
    lu_solve,
    shrink,
    step_factor,
)
from dimersweep.kernel.tableaux import DOP_C, ROS_C, ROS_D, ROS_GAMMA

# events of a contact phase; even numbers are p1's, odd ones p2's
LIFTS, HOLD_LOST, SLIP_ZERO, LANDS = 0, 2, 4, 6
N_EVENTS = 7
NO_EVENT, OUT_OF_STEPS = -1, -2
MAX_STEPS = 20000
MAX_BISECT = 80
STIFF = 0.02  # relaxation of the slip direction, in forcing periods, below which the implicit method takes over
LONGEST = 0.125  # longest step, in forcing periods
GLIDE_ROWS = 48


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
        work[12:22],
        work[22:32],
        work[32],
        work[33],
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
    )


@compiled
def glide_value(dm, modes, k, base, y, F, slip_tol):
    """Event function k, positive while the phase goes on; inf where it has no meaning.

    Normal force of an end; reserve of the friction that holds it; its slip along the direction it had at `base`; the
    other end's height (the dip, which opens its gap).
    """
    i = k % 2
    if k == LANDS:
        if modes[0] != FREE and modes[1] != FREE:
            return inf
        return y[YB] if modes[0] != FREE else -y[YB]
    if modes[i] == FREE:
        return inf
    if k < HOLD_LOST:
        return F[F1] if i == 0 else F[F2]
    if k < SLIP_ZERO:
        return hold_reserve(dm, modes, i, F) if modes[i] == STICK else inf
    if modes[i] != SLIP:
        return inf
    a0, b0 = slip_of(dm, modes, base, i)
    a, b = slip_of(dm, modes, y, i)
    return (a * a0 + b * b0) / hypot(a0, b0) - slip_tol


@compiled
def least_value(dm, modes, armed, base, y, F, slip_tol):
    """Least of the armed event functions and its number."""
    least, which = inf, NO_EVENT
    for k in range(N_EVENTS):
        if armed[k] > 0.0:
            value = glide_value(dm, modes, k, base, y, F, slip_tol)
            if value < least:
                least, which = value, k
    return least, which


@compiled
def explicit_step(dm, modes, phase, h, n, b):
    """One DOP853 step from b.start into b.out; returns the error over the tolerance."""
    for i in range(DOP_STAGES):
        explicit_stage(i, h, b.start, b.K, n, b.out)
        contact_rates(dm, modes, phase + dm.omega * h * DOP_C[i], b.out, b.K[i], b.F)
    return explicit_finish(h, b.start, b.K, n, b.scale, b.out)


@compiled
def perturbation(dm, k, y, v, double):
    """Size of a change of entry k of the state that is small against the slip v."""
    if k in (YWB, YS):
        return dm.w_scale
    if k == YWP:
        return min(dm.w_scale, max(0.5 * v / dm.h, 1e-6 * abs(y[k]))) if double else dm.w_scale
    return v if k in (YUA, YUB) else 1.0


@compiled
def glide_jacobian(dm, modes, phase, n, v, b):
    """Jacobian of ``contact_rates`` at b.start and its time derivative, by central differences."""
    step = 3e-6
    y, probe, J = b.start, b.probe, b.J
    double = modes[0] != FREE and modes[1] != FREE
    probe[:N_PATH] = y[:N_PATH]
    J[:n, :n] = 0.0
    for k in range(N_THETA):
        d = step * perturbation(dm, k, y, v, double)
        probe[k] = y[k] + d
        contact_rates(dm, modes, phase, probe, b.up, b.F)
        above = probe[k]
        probe[k] = y[k] - d
        contact_rates(dm, modes, phase, probe, b.down, b.F)
        width = above - probe[k]
        probe[k] = y[k]
        for j in range(n):
            J[j, k] = (b.up[j] - b.down[j]) / width
    contact_rates(dm, modes, phase + step, y, b.up, b.F)
    contact_rates(dm, modes, phase - step, y, b.down, b.F)
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
        contact_rates(dm, modes, phase + dm.omega * h * ROS_C[i], b.out, b.K[i], b.F)
        implicit_load(i, h, b.K, n, b.K[i])
        for k in range(n):
            b.K[i, k] += h * ROS_D[i] * b.dt[k]
        lu_solve(b.LU, n, b.pivots, b.K[i])
    for k in range(n):
        b.out[k] += b.K[ROS_STAGES - 1, k]
    return error_norm(b.K, ROS_STAGES - 1, n, b.scale)


@compiled
def step_to(dm, modes, phase, h, n, implicit, b):
    """One step of either method; the rates and forces at its end are left in b.dy_end, b.F. Returns the error."""
    if implicit:
        error = implicit_step(dm, modes, phase, h, n, b)
    else:
        error = explicit_step(dm, modes, phase, h, n, b)
    contact_rates(dm, modes, phase + dm.omega * h, b.out, b.dy_end, b.F)
    return error


@compiled
def slip_speed(dm, modes, y):
    """Least speed of the slipping ends, inf if none slips."""
    v = inf
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            v = min(v, hypot(a, b))
    return v


@compiled
def slip_limit(dm, modes, y, dy):
    """Step over which no slip falls below about a tenth of itself at its present rate."""
    h = inf
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            d_a, d_b = slip_of(dm, modes, dy, i)
            v = hypot(a, b)
            rate = (a * d_a + b * d_b) / v
            if rate < 0.0:
                h = min(h, -0.9 * v / rate)
    return h


@compiled
def stalled_slip(dm, modes, y, dy, slip_tol):
    """Number of a slipping end that is within the tolerance of rest and slows down, -1 if there is none."""
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            d_a, d_b = slip_of(dm, modes, dy, i)
            if hypot(a, b) <= slip_tol and a * d_a + b * d_b < 0.0:
                return i
    return -1


@compiled
def arm(dm, modes, armed, y, F, slip_tol):
    """Arm the event functions that are positive."""
    for k in range(N_EVENTS):
        if glide_value(dm, modes, k, y, y, F, slip_tol) > 0.0:
            armed[k] = 1.0


@compiled
def first_crossing(dm, modes, phase, h, n, implicit, event, least, slip_tol, b):
    """Locate the first zero of the armed event functions in a step over which the least of them fell to `least` <= 0.

    Regula falsi (Illinois), each probe a step of its own from b.start.

    Returns
    -------
    t : float
        Length of the step to the event; b.out is the state there.
    event : int
    """
    contact_rates(dm, modes, phase, b.start, b.dy_end, b.F)
    low, high = 0.0, h
    g_low, _ = least_value(dm, modes, b.armed, b.start, b.start, b.F, slip_tol)
    g_high = least
    floor = 1e-14 * (abs(g_low) + abs(g_high))
    side = 0
    for _ in range(MAX_BISECT):
        if high - low <= 1e-15 * dm.T:
            break
        mid = inside(low, high, g_low, g_high)
        step_to(dm, modes, phase, mid, n, implicit, b)
        g, which = least_value(dm, modes, b.armed, b.start, b.out, b.F, slip_tol)
        low, high, g_low, g_high, side = shrink(low, high, g_low, g_high, mid, g, side)
        event = which if g <= 0.0 else event
        if abs(g) <= floor:
            return mid, which
    step_to(dm, modes, phase, high, n, implicit, b)
    return high, event


@compiled
def hidden_dip(dm, modes, phase, h, n, slip_tol, b):
    """Share of an accepted step at which an event function may dip below zero between positive ends; 1.0 if none does.

    The functions are evaluated on the cubic through the step's ends; the parabola through the lowest of them bounds what
    lies between.
    """
    values = b.LU
    for q in range(5):
        s = 0.25 * q
        hermite(b, s, h, n, b.probe)
        contact_rates(dm, modes, phase + dm.omega * h * s, b.probe, b.down, b.F)
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
def hermite(b, s, h, n, out):
    """Cubic through the ends of a step at share s, into `out`."""
    u = 1.0 - s
    for k in range(n):
        rise = b.out[k] - b.start[k]
        out[k] = b.start[k] + s * rise + s * u * ((1.0 - 2.0 * s) * -rise + h * (u * b.dy[k] - s * b.dy_end[k]))


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
    n = N_PATH if path else N_THETA
    b = lay_out(work)
    set_scales(dm, tol, b.scale)
    b.out[:N_PATH] = y[:N_PATH]
    b.armed[:N_EVENTS] = 0.0
    contact_rates(dm, modes, phase, y, b.dy, b.F)
    arm(dm, modes, b.armed, y, b.F, slip_tol)
    if modes[0] == FREE or modes[1] == FREE:
        b.armed[LANDS] = 1.0
    t, h = 0.0, first_step(dm, modes, y, b.dy)
    fresh = True  # the Jacobian has to be formed at b.start
    for _ in range(MAX_STEPS):
        if t >= span:
            return t, NO_EVENT
        b.start[:N_PATH] = y[:N_PATH]
        now = phase + dm.omega * t
        v = slip_speed(dm, modes, y)
        stalled = stalled_slip(dm, modes, y, b.dy, slip_tol) if v <= slip_tol else -1
        if stalled >= 0:
            stop_slip(dm, modes, y, stalled)
            return t, SLIP_ZERO + stalled
        h = min(h, LONGEST * dm.T, slip_limit(dm, modes, y, b.dy))
        implicit = v < STIFF * dm.T * stiffness(dm, b.F)
        last = h >= (span - t) * (1.0 - 1e-12)
        if last:
            h = span - t
        if implicit and fresh:
            glide_jacobian(dm, modes, now, n, v, b)
        fresh = not implicit
        error = step_to(dm, modes, now, h, n, implicit, b)
        factor = step_factor(error, 5.0 if implicit else 8.0)
        if not error <= 1.0:
            h *= min(factor, 0.5)
            contact_rates(dm, modes, now, y, b.dy, b.F)
            continue
        if watch:
            least, event = least_value(dm, modes, b.armed, b.start, b.out, b.F, slip_tol)
            part = hidden_dip(dm, modes, now, h, n, slip_tol, b) if least > 0.0 else 1.0
            if part < 1.0 or (least <= 0.0 and event == LANDS and y[YB] == 0.0):
                h *= min(part, 0.5)
                contact_rates(dm, modes, now, y, b.dy, b.F)
                if h > 1e-12 * dm.T:
                    continue
            if least <= 0.0:
                dt, event = first_crossing(dm, modes, now, h, n, implicit, event, least, slip_tol, b)
                y[:n] = b.out[:n]
                fresh = True
                t += dt
                if not SLIP_ZERO <= event < LANDS:
                    return t, event
                s_a, s_b = slip_of(dm, modes, y, event % 2)
                if hypot(s_a, s_b) <= 4.0 * slip_tol:
                    stop_slip(dm, modes, y, event % 2)
                    return t, event
                h *= 0.5  # the slip has only turned by a right angle
                contact_rates(dm, modes, phase + dm.omega * t, y, b.dy, b.F)
                continue
        contact_rates(dm, modes, now + dm.omega * h, b.out, b.dy, b.F)
        y[:n] = b.out[:n]
        fresh = True
        t = span if last else t + h
        arm(dm, modes, b.armed, y, b.F, slip_tol)
        h *= factor
    return t, OUT_OF_STEPS


@compiled
def stiffness(dm, F):
    """Rate at which friction turns a slip, times its speed [m s-2]."""
    return dm.mu * (1.0 / dm.m + dm.h * dm.h / dm.J_t + dm.r * dm.r / dm.J_a) * max(F[F1], F[F2])


@compiled
def stop_slip(dm, modes, y, i):
    """Set the slip of end i, which has come down to its tolerance, to zero."""
    y[YUA] = 0.0
    if i == 0 or modes[0] == FREE:
        y[YUB] = 0.0
    else:
        y[YWP] = y[YUB] / (2.0 * dm.h)


@compiled
def set_scales(dm, tol, scale):
    """Tolerances of the contact state: angles, rates and slips in the scales of the scene."""
    scale[:N_PATH] = tol
    scale[1] *= dm.w_scale
    scale[2] *= dm.w_scale
    scale[3] *= 10.0 * dm.w_scale
    scale[4] *= dm.v_scale
    scale[5] *= dm.v_scale
    scale[7] *= dm.r
    scale[8] *= dm.r
    scale[9] *= 10.0
