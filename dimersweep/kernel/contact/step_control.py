"""One step of a contact phase, by each of three methods.

Plain: DOP853 in time. Rescaled: DOP853 in xi with dt = (v / gamma) dxi, for a slip v on its way to rest, whose direction turns
at the rate gamma / v: per xi nothing is stiff and the slip falls exponentially. Near a jam, with the force at each moment in
gamma, nothing is singular either where it goes through infinity, beyond which time runs back (`time_per_xi`). Implicit: Radau
IIA in time, for slip that is slow and stays so, or sets out from rest: its direction follows the forces at once, and the
step need not resolve how.
"""

from math import inf, sqrt
from typing import Annotated, Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import ROW, Row
from dimersweep.kernel.contact import coordinates, forces
from dimersweep.kernel.contact.coordinates import N_CLOSED, N_PATH, UPRIGHT, Y, leading, same_chart
from dimersweep.kernel.contact.forces import F1, F2, Moment, phase_rates
from dimersweep.kernel.model.body import attitude, end, extent
from dimersweep.kernel.model.layout import FREE, SLIP
from dimersweep.kernel.numerics.collocation import NEXT, NODES, RADAU_A, RADAU_C, TOP
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import DOP_STAGES, copy, explicit_step, lu_factor, lu_solve
from dimersweep.kernel.numerics.tableaux import DOP_C

PLAIN_METHOD, RESCALED, IMPLICIT = 0, 1, 2
MAX_STEP_NEWTON = 14  # Newton iterations of an implicit step
CONVERGED = 0.1  # change in a Newton iteration, over the tolerance, that ends them
RENEWED = 2  # the iteration that takes new derivatives
TIGHT = 0.5  # compliance from which the turning of the slip may lead to a jam
SLIP_CHANGE = 1e-6  # change of a slip, in units of itself, in its finite differences

# of an explicit step, and of a Newton iteration for each direction in which a slip turns and once more, in hops of one end:
# as measured
EXPLICIT_COST, NEWTON_COST = 0.8, 0.4


class StepArrays:
    """What a step of a contact phase works on."""

    K: Annotated[list[float], DOP_STAGES, ROW]  # slopes of the stages
    nodes: Annotated[list[float], NODES, ROW]  # states at the nodes of an implicit step
    J: Annotated[
        list[float], 3 * NODES, ROW
    ]  # derivatives of the slopes with respect to the slips, and the Newton matrix
    LU: Annotated[list[float], 3 * NODES, ROW]
    B: Annotated[list[float], 3 * NODES, ROW]  # directions of the turns
    start: Moment  # of the step: the state of the phase
    out: Moment  # its end
    scale: Row  # tolerances of the state
    armed: Row  # event functions that have been positive
    values: Annotated[list[float], 4, ROW]  # event functions in the course of the step
    probe: Moment
    pivots: Row
    change: Row
    kept: Annotated[list[float], 6, ROW]  # what a step was from and to, while the works in it are taken in parts
    flows: Row  # what the works since the phase began are either way


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
    cut: bool  # whether it goes no further than the phase is wanted: a longer one has passed that
    doubt: float  # what works in a step may be off, where they are wanted [J]


class Phase(NamedTuple):
    """A contact phase in one chart: what is asked of it, and what it is followed on."""

    dm: Any
    modes: Any
    phase: float  # of the plate at the start [rad]
    span: float  # that the steps are chosen for [s]
    until: float  # when to stop, at most the span: a sample takes the steps of its run [s]
    tol: float  # error per step, in units of the scales of the state
    slip_tol: float  # slip that counts as none [m/s]
    n: int  # entries of the state that are integrated
    b: Any  # what its steps work on (`StepArrays`)
    control: Any
    bracket: Any  # of an event
    meter: Any


@compiled
def begin_at(p, y):
    """Have a phase start from a contact state: its tolerances and rates, and the chart, which all states of its steps share."""
    copy(y, p.b.start.y, coordinates.N_Y)
    same_chart(y, p.b.out.y)
    same_chart(y, p.b.probe.y)
    for j in range(NODES):
        same_chart(y, p.b.nodes[j])
    set_scales(p)
    phase_rates(p, p.phase, p.b.start)


@compiled
def set_scales(p):
    """Tolerances of the contact state: angles, rates, slips and lengths in the scales of the scene; works as they are told."""
    dm, tol, scale = p.dm, p.tol, p.b.scale
    scale[Y.dip] = scale[Y.theta] = tol
    scale[Y.w_b] = scale[Y.w_p] = tol * dm.w_scale
    scale[Y.spin] = 10.0 * tol * dm.w_scale
    scale[Y.u_a] = scale[Y.u_b] = tol * dm.v_scale
    scale[Y.time] = tol * dm.period
    scale[Y.x] = scale[Y.y] = tol * extent(dm)[0]
    scale[Y.gamma] = 10.0 * tol
    for k in range(N_PATH, p.n):
        scale[k] = p.control.doubt


@compiled(inline=True)
def stiffness(p, force):
    """gamma: a bound on the rate at which friction under a normal force turns a slip, times its speed [m s-2]."""
    dm, y = p.dm, p.b.start.y
    tilt, gamma = 1.0 if y[Y.chart] == UPRIGHT else min(1.0, abs(dm.beta_0 + y[Y.dip])), 0.0
    for i in range(2):
        if p.modes[i] != FREE:
            q = end(dm, i)
            arm = abs(q.h) + q.r * tilt
            gamma = max(gamma, q.mu * (dm.im + arm * arm * dm.it + q.r * q.r * dm.ia) * force)
    return gamma


class Step(NamedTuple):
    """A step of a contact phase, of h seconds or, by the rescaled method, h units of xi."""

    p: Phase
    phase: float  # of the plate at its start [rad]
    h: float
    method: int
    gamma: float


# --- explicit steps -----------------------------------------------------------------------------------------------------


@compiled
def ruling_slip(dm, modes, y):
    """Slip speed of the rescaled method: that of the one slipping end, or half the harmonic mean of both."""
    inverse = 0.0
    for i in range(2):
        if modes[i] == SLIP:
            inverse += 1.0 / length(*coordinates.slip_of(dm, modes, y, i))
    return 1.0 / inverse


@compiled(inline=True)
def time_per_xi(step, v, force):
    """Time per xi at a slip speed, under normal forces with this sum.

    Near a jam it goes with 1 / F, and stays finite where the force vanishes: to F, in units of that at the start, is added its
    product with the compliance, which is about what it would be without friction.
    """
    share, start = v / step.gamma, step.p.b.start.F
    more = start[forces.COMPLIANCE]
    if more < TIGHT:
        share *= (1.0 + more) / (force / (start[F1] + start[F2]) + more)
    return share


@compiled(inline=True)
def rescale(step, y, F, k):
    """By the rescaled method, the slopes k per xi in place of those per time."""
    if step.method == RESCALED:
        share = time_per_xi(step, ruling_slip(step.p.dm, step.p.modes, y), F[F1] + F[F2])
        for j in range(step.p.n):
            k[j] *= share


@compiled
def slopes_of_any(step, i, *state):
    """Slopes of a stage of any contact, in either chart."""
    p, y, F, k = step.p, step.p.b.out.y, step.p.b.out.F, step.p.b.K[i]
    y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7] = state
    phase_rates(p, step.phase + p.dm.omega * y[Y.time], Moment(y, k, F))
    rescale(step, y, F, k)
    return k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]


@compiled
def works_of_single(step, i, now, rod, rates, share):
    """Slopes of the works of a stage of the contact of one end."""
    p, y, F, dy = step.p, step.p.b.out.y, step.p.b.out.F, step.p.b.K[i]
    y[Y.u_a], y[Y.u_b], y[Y.theta] = rod.u_a, rod.u_b, rod.theta
    forces.put_forces(leading(p.modes), rates.F, rates.A, rates.L, rates.compliance, F)
    forces.work_rates(p.dm, p.modes, now, y, F, dy)
    for j in range(N_PATH, coordinates.N_WORKED):
        dy[j] *= share


@compiled(fuse=True, inline=True)
def slopes_of_single(step, i, *state):
    """Slopes of a stage of the contact of one end in the chart by heading."""
    dip, w_b, w_p, spin, u_a, u_b, theta, xi_time = state
    dm, n, rescaled, number = step.p.dm, step.p.n, step.method == RESCALED, leading(step.p.modes)
    p = end(dm, number)
    t = xi_time if rescaled else step.h * DOP_C[i]
    now = step.phase + dm.omega * t
    sin_b, cos_b = attitude(dm, dip)
    rod = forces.Rod(sin_b, cos_b, w_b, w_p, spin, u_a, u_b, theta)
    rates = forces.single_rates(dm, step.p.modes[number], p, rod, forces.pull_at(dm, now, theta))
    share = time_per_xi(step, length(u_a, u_b), rates.F) if rescaled else 1.0
    if n > N_CLOSED:
        x, y_1, spun = forces.path_rates(dm, p, rod)
        k = step.p.b.K[i]
        k[Y.x], k[Y.y], k[Y.gamma] = share * x, share * y_1, share * spun
    if n > N_PATH:
        works_of_single(step, i, now, rod, rates, share)
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
def explicit_contact_step(step):
    """One DOP853 step from the start into `out`; returns the error over the tolerance."""
    p, b, y = step.p, step.p.b, step.p.b.start.y
    charge(p.meter, EXPLICIT_COST)
    copy(b.start.dy, b.K[0], coordinates.N_WORKED)  # a number that is known compiles to no call
    rescale(step, y, b.start.F, b.K[0])
    if y[Y.chart] == UPRIGHT or (p.modes[0] != FREE and p.modes[1] != FREE):
        return explicit_step(slopes_of_any, step, step.h, y, b.K, p.n, b.scale, b.out.y)
    return explicit_step(slopes_of_single, step, step.h, y, b.K, p.n, b.scale, b.out.y)


# --- implicit steps -----------------------------------------------------------------------------------------------------


@compiled
def set_turns(p, j):
    """Directions of change of the slips (u_a, u_b, w_p) at node j that turn them, into rows of b.B; returns how many.

    A single slip only turns across itself; of two slips, which share their axial part, every change turns one.
    """
    b, y = p.b, p.b.nodes[j]
    if p.modes[0] != FREE and p.modes[1] != FREE:
        for i in range(3):
            row = b.B[3 * j + i]
            row[0], row[1], row[2] = 0.0, 0.0, 0.0
            row[i] = 1.0
        return 3
    v = length(y[Y.u_a], y[Y.u_b])
    row = b.B[j]
    row[0], row[1], row[2] = -y[Y.u_b] / v, y[Y.u_a] / v, 0.0
    return 1


@compiled
def turn_slopes(step, j):
    """Derivatives of the slopes at node j with respect to the turns, by forward differences, into b.J; returns how many."""
    p, b, probe = step.p, step.p.b, step.p.b.probe
    y, f = b.nodes[j], b.K[j]
    v, _ = coordinates.slip_speed(p.dm, p.modes, y, y)
    m = set_turns(p, j)
    for i in range(m):
        turn = b.B[j * m + i]
        size = SLIP_CHANGE * v * (1.0 - turn[2] + turn[2] / p.dm.l)
        copy(y, probe.y, N_CLOSED)
        probe.y[Y.u_a] += size * turn[0]
        probe.y[Y.u_b] += size * turn[1]
        probe.y[Y.w_p] += size * turn[2]
        phase_rates(p, step.phase + p.dm.omega * step.h * RADAU_C[j], probe)
        row = b.J[j * m + i]
        for k in range(p.n):
            row[k] = (probe.dy[k] - f[k]) / size
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
                    b.LU[p, q] = -a * (turn[0] * slope[Y.u_a] + turn[1] * slope[Y.u_b] + turn[2] * slope[Y.w_p])
            b.LU[p, p] += 1.0
    return lu_factor(b.LU, NODES * m, b.pivots)


@compiled(fuse=True)
def newton_iteration(h, n, m, b):
    """One Newton iteration of the states at the nodes; returns the largest change over the tolerance.

    Only the turning of the slips is stiff: the other derivatives are left out, and what the turns change is carried over.
    """
    y, probe, nodes, K, B, change, scale = b.start.y, b.probe.y, b.nodes, b.K, b.B, b.change, b.scale
    for j in range(NODES):
        u_a, u_b, w_p = y[Y.u_a] - nodes[j, Y.u_a], y[Y.u_b] - nodes[j, Y.u_b], y[Y.w_p] - nodes[j, Y.w_p]
        for k in range(NODES):
            a, slope = h * RADAU_A[j, k], K[k]
            u_a += a * slope[Y.u_a]
            u_b += a * slope[Y.u_b]
            w_p += a * slope[Y.w_p]
        for i in range(j * m, j * m + m):
            change[i] = B[i, 0] * u_a + B[i, 1] * u_b + B[i, 2] * w_p
    lu_solve(b.LU, NODES * m, b.pivots, change)
    for j in range(NODES):
        for i in range(j * m, j * m + m):
            for k in range(n):
                K[j, k] += b.J[i, k] * change[i]
    largest = 0.0
    for j in range(NODES):
        copy(y, probe, n)
        for i in range(NODES):
            a = h * RADAU_A[j, i]
            for k in range(n):
                probe[k] += a * K[i, k]
        for k in range(N_CLOSED):
            largest = max(largest, abs(probe[k] - nodes[j, k]) / scale[k])
        copy(probe, nodes[j], n)
    return largest


@compiled
def implicit_error(h, first, last, b):
    """Error of an implicit step over the tolerance, from how fast the slopes' expansion in Chebyshev polynomials falls off;
    of the entries from `first` up to `last`.
    """
    total = 0.0
    for k in range(first, last):
        top, near = TOP[0] * b.start.dy[k], 0.0
        for j in range(NODES):
            top += TOP[j + 1] * b.K[j, k]
            near += NEXT[j] * b.K[j, k]
        ratio = min(1.0, abs(top / near)) if near != 0.0 else 1.0
        error = h * top * ratio / b.scale[k]
        total += error * error
    return sqrt(total / (last - first))


@compiled
def implicit_step(step):
    """One Radau IIA step from the start into `out`; returns the error over the tolerance, inf if it fails."""
    p, h, n, b, m = step.p, step.h, step.p.n, step.p.b, 1
    for j in range(NODES):
        for k in range(n):
            b.nodes[j, k] = b.start.y[k] + h * RADAU_C[j] * b.start.dy[k]
    before = inf
    for turn in range(MAX_STEP_NEWTON):
        charge(p.meter, NEWTON_COST * (1 + m))
        for j in range(NODES):
            phase_rates(p, step.phase + p.dm.omega * h * RADAU_C[j], Moment(b.nodes[j], b.K[j], b.out.F))
        if turn == 0 or turn == RENEWED:
            for j in range(NODES):
                m = turn_slopes(step, j)
            if not newton_matrix(h, m, b):
                return inf
        change = newton_iteration(h, n, m, b)
        if change <= CONVERGED:
            copy(b.nodes[NODES - 1], b.out.y, n)
            b.out.y[Y.time] = h
            return implicit_error(h, 0, N_CLOSED, b)
        if not change < inf or (turn > RENEWED and change > before):
            return inf
        before = change
    return inf


@compiled(inline=True)
def step_to(p, phase, h):
    """One step by the method that is chosen, from a phase of the plate; returns its error over the tolerance.

    The rates (per time) and the forces at its end are left in `out`.
    """
    step = Step(p, phase, h, p.control.method, p.control.stiffness)
    error = implicit_step(step) if step.method == IMPLICIT else explicit_contact_step(step)
    phase_rates(p, phase + p.dm.omega * p.b.out.y[Y.time], p.b.out)
    return error
