"""One step of a contact phase, by each of three methods.

Plain: DOP853 in time. Rescaled: DOP853 in xi with dt = (v / gamma) dxi, for a slip v on its way to rest, whose direction turns
at the rate gamma / v: per xi nothing is stiff and the slip falls exponentially. Near a jam, with the force at each moment in
gamma, nothing is singular either where it goes through infinity, beyond which time runs back (``time_per_xi``). Implicit: Radau
IIA in time, for slip that is slow and stays so, or sets out from rest: its direction follows the forces at once, and the
step need not resolve how.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    N_CLOSED,
    N_PATH,
    N_WORKED,
    UPRIGHT,
    YCHART,
    YDIP,
    YGAMMA,
    YS,
    YTHETA,
    YTIME,
    YUA,
    YUB,
    YWB,
    YWORK,
    YWP,
    YX,
    YY,
    leading,
    same_chart,
    slip_of,
)
from dimersweep.kernel.contact.events import slip_speed
from dimersweep.kernel.contact.forces import A1, COMPLIANCE, F1, F2, L1, N_F, path_rates, single_rates
from dimersweep.kernel.contact.powers import phase_rates, work_rates
from dimersweep.kernel.model.body import attitude, end, extent
from dimersweep.kernel.model.layout import FREE, SLIP
from dimersweep.kernel.model.plate import acceleration_along, effective_gravity
from dimersweep.kernel.numerics.collocation import NEXT, NODES, RADAU_A, RADAU_C, TOP
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import (
    copy,
    explicit_step,
    lu_factor,
    lu_solve,
)
from dimersweep.kernel.numerics.tableaux import DOP_C

PLAIN_METHOD, RESCALED, IMPLICIT = 0, 1, 2
MAX_STEP_NEWTON = 14  # Newton iterations of an implicit step
CONVERGED = 0.1  # change in a Newton iteration, over the tolerance, that ends them
RENEWED = 2  # the iteration that takes new derivatives
TIGHT = 0.5  # compliance from which the turning of the slip may lead to a jam
SLIP_CHANGE = 1e-6  # change of a slip, in units of itself, in its finite differences

STEP_ROWS = 86
# of an explicit step, and of a Newton iteration for each direction in which a slip turns and once more, in hops of one end:
# as measured
EXPLICIT_COST, NEWTON_COST = 0.8, 0.4


class StepArrays(NamedTuple):
    """Rows of the work array, by what they hold during a step of a contact phase."""

    K: Any  # slopes of the stages
    Y: Any  # states at the nodes of an implicit step
    J: Any  # derivatives of the slopes with respect to the slips, and the Newton matrix
    LU: Any
    B: Any  # directions of the turns
    start: Any  # state, rates and forces at the start of the step, and at its end
    dy: Any
    F: Any
    out: Any
    dy_out: Any
    F_out: Any
    scale: Any  # tolerances of the state
    armed: Any  # event functions that have been positive
    values: Any  # event functions in the course of the step
    probe: Any
    dy_probe: Any
    F_probe: Any
    pivots: Any
    change: Any
    kept: Any  # what a step was from and to, while the works in it are taken in parts
    flows: Any  # what the works since the phase began are either way
    bracket: Any  # of an event
    control: Any
    meter: Any


class Control:
    """What one step of a contact phase leaves to the next."""

    time: float  # since the start of the phase [s]
    now: float  # plate phase at the start of the step [rad]
    h: float  # size of the next step: in time [s], and in xi
    xi: float
    natural: float  # tolerance to the power of 1/8
    stiffness: float  # gamma of the step, and the slip that it turns with its rate
    speed: float
    speed_rate: float
    method: int  # of the step
    size: float  # of the step, in the unit of its method
    last: bool  # whether the step ends the span
    doubt: float  # what works in a step may be off, where they are wanted [J]


class Phase(NamedTuple):
    """A contact phase in one chart, and what is asked of it."""

    modes: Any
    y: Any  # the contact state, modified in place
    phase: float  # of the plate at the start [rad]
    span: float  # [s]
    tol: float
    slip_tol: float  # slip that counts as none [m/s]
    n: int  # entries of y that are integrated
    locate: bool  # whether events are looked for


@compiled
def step_arrays(work):
    """The arrays of a step on scratch of at least STEP_ROWS rows."""
    rows = work.rows
    return StepArrays(
        rows[0:12],
        rows[12:17],
        rows[17:32],
        rows[32:47],
        rows[47:62],
        rows[62],
        rows[63],
        rows[64],
        rows[65],
        rows[66],
        rows[67],
        rows[68],
        rows[69],
        rows[70:74],
        rows[74],
        rows[75],
        rows[76],
        rows[77],
        rows[78],
        rows[79:85],
        rows[85],
        work.bracket,
        work.control,
        work.meter,
    )


@compiled
def set_chart(y, b):
    """Mark the states of a step as ones in the chart of y."""
    same_chart(y, b.start)
    same_chart(y, b.out)
    same_chart(y, b.probe)
    for j in range(NODES):
        same_chart(y, b.Y[j])


@compiled
def set_scales(dm, tol, scale):
    """Tolerances of the contact state: angles, rates, slips and lengths in the scales of the scene."""
    scale[YDIP] = scale[YTHETA] = tol
    scale[YWB] = scale[YWP] = tol * dm.w_scale
    scale[YS] = 10.0 * tol * dm.w_scale
    scale[YUA] = scale[YUB] = tol * dm.v_scale
    scale[YTIME] = tol * dm.period
    scale[YX] = scale[YY] = tol * extent(dm)[0]
    scale[YGAMMA] = 10.0 * tol


@compiled
def stiffness(dm, modes, y, force):
    """gamma: a bound on the rate at which friction under a normal force turns a slip, times its speed [m s-2]."""
    tilt, gamma = 1.0 if y[YCHART] == UPRIGHT else min(1.0, abs(dm.beta_0 + y[YDIP])), 0.0
    for i in range(2):
        if modes[i] != FREE:
            p = end(dm, i)
            arm = abs(p.h) + p.r * tilt
            gamma = max(gamma, p.mu * (dm.im + arm * arm * dm.it + p.r * p.r * dm.ia) * force)
    return gamma


@compiled
def ruling_slip(dm, modes, y):
    """Slip speed of the rescaled method: that of the one slipping end, or half the harmonic mean of both."""
    inverse = 0.0
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            inverse += 1.0 / sqrt(a * a + b * b)
    return 1.0 / inverse


@compiled
def time_per_xi(F, start):
    """Time per xi under the forces F, in units of that at the start of the step.

    It goes with 1 / F, and stays finite where the force vanishes: to F is added its product with the compliance, which is
    about what it would be without friction.
    """
    more = start[COMPLIANCE]
    return (1.0 + more) / ((F[F1] + F[F2]) / (start[F1] + start[F2]) + more)


class ExplicitStep(NamedTuple):
    """An explicit step of a contact phase, of h seconds or, by the rescaled method, h units of xi."""

    dm: Any
    modes: Any
    phase: float  # of the plate at its start [rad]
    h: float
    n: int  # entries of the state that are integrated
    method: int
    gamma: float
    b: Any


@compiled
def slopes_of_any(step, i, dip, w_b, w_p, spin, u_a, u_b, theta, t):
    """Slopes of a stage of any contact, in either chart."""
    b = step.b
    y, k = b.out, b.K[i]
    y[YDIP], y[YWB], y[YWP], y[YS], y[YUA], y[YUB], y[YTHETA], y[YTIME] = dip, w_b, w_p, spin, u_a, u_b, theta, t
    phase_rates(step.dm, step.modes, step.phase + step.dm.omega * t, y, step.n, k, b.F_out)
    rescale(step, y, b.F_out, k)
    return k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]


@compiled(inline=True)
def rescale(step, y, F, k):
    """By the rescaled method, the slopes k per xi in place of those per time."""
    if step.method == RESCALED:
        share = ruling_slip(step.dm, step.modes, y) / step.gamma
        if step.b.F[COMPLIANCE] < TIGHT:
            share *= time_per_xi(F, step.b.F)
        for j in range(step.n):
            k[j] *= share


@compiled
def works_of_single(step, i, now, slip, rates, share):
    """Slopes of the works of a stage of the contact of one end with the slip (axial, lateral) at a heading."""
    b, k = step.b, 3 * leading(step.modes)
    y, F, dy = b.out, b.F_out, b.K[i]
    y[YUA], y[YUB], y[YTHETA] = slip
    for j in range(N_F):
        F[j] = 0.0
    F[F1 + k], F[A1 + k], F[L1 + k] = rates.F, rates.A, rates.L
    work_rates(step.dm, step.modes, now, y, F, dy)
    for j in range(YWORK, N_WORKED):
        dy[j] *= share


@compiled(fuse=True, inline=True)
def slopes_of_single(step, i, dip, w_b, w_p, spin, u_a, u_b, theta, xi_time):
    """Slopes of a stage of the contact of one end in the chart by heading."""
    dm, b, rescaled = step.dm, step.b, step.method == RESCALED
    end_number = leading(step.modes)
    p, mode = end(dm, end_number), step.modes[end_number]
    t = xi_time if rescaled else step.h * DOP_C[i]
    now, A_a, A_b = step.phase + dm.omega * t, 0.0, 0.0
    if dm.sideways != 0.0:
        A_a, A_b = acceleration_along(dm, now, theta)
    g_e = effective_gravity(dm, now)
    sin_b, cos_b = attitude(dm, dip)
    rates = single_rates(dm, mode, p, g_e, A_a, A_b, sin_b, cos_b, w_b, w_p, spin, u_a, u_b)
    share = 1.0
    if rescaled:
        share, more = length(u_a, u_b) / step.gamma, b.F[COMPLIANCE]
        if more < TIGHT:
            share *= (1.0 + more) / (rates.F / (b.F[F1] + b.F[F2]) + more)
    if step.n > N_CLOSED:
        x, y_1, spun = path_rates(dm, p, sin_b, cos_b, w_b, w_p, spin, u_a, u_b, theta)
        k = b.K[i]
        k[YX], k[YY], k[YGAMMA] = share * x, share * y_1, share * spun
    if step.n > N_PATH:
        works_of_single(step, i, now, (u_a, u_b, theta), rates, share)
    return (
        share * w_b,
        share * rates.w_b,
        share * rates.w_p,
        share * rates.spin,
        share * rates.a,
        share * rates.b,
        share * rates.turn,
        share,
    )


@compiled
def explicit_contact_step(dm, modes, phase, h, n, method, gamma, b):
    """One DOP853 step from b.start into b.out; returns the error over the tolerance."""
    step = ExplicitStep(dm, modes, phase, h, n, method, gamma, b)
    copy(b.dy, b.K[0], n)
    rescale(step, b.start, b.F, b.K[0])
    if b.start[YCHART] == UPRIGHT or (modes[0] != FREE and modes[1] != FREE):
        return explicit_step(slopes_of_any, step, h, b.start, b.K, n, b.scale, b.out)
    return explicit_step(slopes_of_single, step, h, b.start, b.K, n, b.scale, b.out)


@compiled
def set_turns(modes, j, y, b):
    """Directions of change of the slips (YUA, YUB, YWP) that turn them, into rows of b.B; returns how many.

    A single slip only turns across itself; of two slips, which share their axial part, every change turns one.
    """
    if modes[0] != FREE and modes[1] != FREE:
        for i in range(3):
            row = b.B[3 * j + i]
            row[0], row[1], row[2] = 0.0, 0.0, 0.0
            row[i] = 1.0
        return 3
    v = length(y[YUA], y[YUB])
    row = b.B[j]
    row[0], row[1], row[2] = -y[YUB] / v, y[YUA] / v, 0.0
    return 1


@compiled
def turn_slopes(dm, modes, phase, h, n, j, b):
    """Derivatives of the slopes at node j with respect to the turns, by forward differences, into b.J; returns how many."""
    y, f = b.Y[j], b.K[j]
    v, _ = slip_speed(dm, modes, y, y)
    m = set_turns(modes, j, y, b)
    for i in range(m):
        turn = b.B[j * m + i]
        size = SLIP_CHANGE * v * (1.0 - turn[2] + turn[2] / dm.l)
        for k in range(N_CLOSED):
            b.probe[k] = y[k]
        b.probe[YUA] += size * turn[0]
        b.probe[YUB] += size * turn[1]
        b.probe[YWP] += size * turn[2]
        phase_rates(dm, modes, phase + dm.omega * h * RADAU_C[j], b.probe, n, b.dy_probe, b.F_probe)
        row = b.J[j * m + i]
        for k in range(n):
            row[k] = (b.dy_probe[k] - f[k]) / size
    return m


@compiled(fuse=True)
def newton_matrix(h, m, b):
    """1 - h A dq'/dq over the turns q at all nodes, factored, in b.LU; returns whether it could be."""
    for j in range(NODES):
        for i in range(m):
            p = j * m + i
            turn = b.B[p]
            for k in range(NODES):
                a = h * RADAU_A[j, k]
                for q in range(k * m, k * m + m):
                    slope = b.J[q]
                    b.LU[p, q] = -a * (turn[0] * slope[YUA] + turn[1] * slope[YUB] + turn[2] * slope[YWP])
            b.LU[p, p] += 1.0
    return lu_factor(b.LU, NODES * m, b.pivots)


@compiled(fuse=True)
def newton_iteration(h, n, m, b):
    """One Newton iteration of the states at the nodes; returns the largest change over the tolerance.

    Only the turning of the slips is stiff: the other derivatives are left out, and what the turns change is carried over.
    """
    for j in range(NODES):
        u_a, u_b, w_p = b.start[YUA] - b.Y[j, YUA], b.start[YUB] - b.Y[j, YUB], b.start[YWP] - b.Y[j, YWP]
        for k in range(NODES):
            a, slope = h * RADAU_A[j, k], b.K[k]
            u_a += a * slope[YUA]
            u_b += a * slope[YUB]
            w_p += a * slope[YWP]
        for i in range(j * m, j * m + m):
            b.change[i] = b.B[i, 0] * u_a + b.B[i, 1] * u_b + b.B[i, 2] * w_p
    lu_solve(b.LU, NODES * m, b.pivots, b.change)
    for j in range(NODES):
        for i in range(j * m, j * m + m):
            for k in range(n):
                b.K[j, k] += b.J[i, k] * b.change[i]
    largest = 0.0
    for j in range(NODES):
        copy(b.start, b.probe, n)
        for i in range(NODES):
            a = h * RADAU_A[j, i]
            for k in range(n):
                b.probe[k] += a * b.K[i, k]
        for k in range(N_CLOSED):
            largest = max(largest, abs(b.probe[k] - b.Y[j, k]) / b.scale[k])
        copy(b.probe, b.Y[j], n)
    return largest


@compiled
def implicit_error(h, first, last, b):
    """Error of an implicit step over the tolerance, from how fast the slopes' expansion in Chebyshev polynomials falls off;
    of the entries from `first` up to `last`.
    """
    total = 0.0
    for k in range(first, last):
        top, near = TOP[0] * b.dy[k], 0.0
        for j in range(NODES):
            top += TOP[j + 1] * b.K[j, k]
            near += NEXT[j] * b.K[j, k]
        ratio = min(1.0, abs(top / near)) if near != 0.0 else 1.0
        total += (h * top * ratio / b.scale[k]) ** 2
    return sqrt(total / (last - first))


@compiled
def implicit_step(dm, modes, phase, h, n, b):
    """One Radau IIA step of h seconds from b.start into b.out; returns the error over the tolerance, inf if it fails."""
    m = 1
    for j in range(NODES):
        for k in range(n):
            b.Y[j, k] = b.start[k] + h * RADAU_C[j] * b.dy[k]
    before = inf
    for turn in range(MAX_STEP_NEWTON):
        charge(b.meter, NEWTON_COST * (1 + m))
        for j in range(NODES):
            at = phase + dm.omega * h * RADAU_C[j]
            phase_rates(dm, modes, at, b.Y[j], n, b.K[j], b.F_out)
        if turn == 0 or turn == RENEWED:
            for j in range(NODES):
                m = turn_slopes(dm, modes, phase, h, n, j, b)
            if not newton_matrix(h, m, b):
                return inf
        change = newton_iteration(h, n, m, b)
        if change <= CONVERGED:
            copy(b.Y[NODES - 1], b.out, n)
            b.out[YTIME] = h
            return implicit_error(h, 0, N_CLOSED, b)
        if not change < inf or (turn > RENEWED and change > before):
            return inf
        before = change
    return inf


@compiled(inline=True)
def step_to(dm, modes, phase, h, n, method, gamma, b):
    """One step; the rates (per time) and forces at its end are left in b.dy_out, b.F_out. Returns the error."""
    if method == IMPLICIT:
        error = implicit_step(dm, modes, phase, h, n, b)
    else:
        charge(b.meter, EXPLICIT_COST)
        error = explicit_contact_step(dm, modes, phase, h, n, method, gamma, b)
    phase_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, n, b.dy_out, b.F_out)
    return error
