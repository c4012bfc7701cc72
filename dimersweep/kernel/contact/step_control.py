"""Take one step of a contact phase, by one of three methods.

Plain: DOP853 in time.

Rescaled: DOP853 in xi with dt = (v / gamma) dxi, for a slip v on its way to rest, whose direction turns at the rate
gamma / v. Per xi nothing is stiff, and the slip falls exponentially. Near a jam gamma takes the force at each moment.
Then nothing is singular where the force goes through infinity, either; beyond that time runs back (`time_per_xi`).

Implicit: Radau IIA in time, for slip that is slow and stays so, or sets out from rest. Its direction follows the forces
at once, and the step need not resolve how.
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
CONVERGED = 0.1  # change in a Newton iteration, over the tolerance, that ends the iterations
# number of the iteration that takes new derivatives: the first ones are those of a guess of the nodes
RENEWED = 2
# compliance (1 for an end that sticks, 0 at a jam) below which the turning of the slip may lead to a jam
TIGHT = 0.5
SLIP_CHANGE = 1e-6  # change of a slip, in units of itself, in its finite differences

# work of an explicit step, and of a Newton iteration per direction in which a slip turns and once more, in hops of one
# end: as measured
EXPLICIT_COST, NEWTON_COST = 0.8, 0.4


class StepArrays:
    """Arrays that a step of a contact phase works on."""

    K: Annotated[list[float], DOP_STAGES, ROW]  # slopes of the stages
    nodes: Annotated[list[float], NODES, ROW]  # states at the nodes of an implicit step
    # derivatives of the slopes with respect to the slips, and the Newton matrix
    J: Annotated[list[float], 3 * NODES, ROW]
    LU: Annotated[list[float], 3 * NODES, ROW]
    B: Annotated[list[float], 3 * NODES, ROW]  # directions of the turns
    start: Moment  # start of the step: the state of the phase
    out: Moment  # end of the step
    scale: Row  # tolerances of the state
    armed: Row  # event functions that have been positive
    values: Annotated[list[float], 4, ROW]  # event functions in the course of the step
    probe: Moment
    pivots: Row
    change: Row
    kept: Annotated[list[float], 6, ROW]  # start and end of a step, while its works are taken in parts
    flows: Row  # works since the phase began, their sizes in each step summed up


class Control:
    """Numbers that a step of a contact phase leaves to the next step."""

    time: float  # time since the start of the phase [s]
    now: float  # plate phase at the start of the step [rad]
    h: float  # size of the next step: h in time [s], xi in xi
    xi: float
    natural: float  # tolerance to the power of 1/8
    stiffness: float  # gamma of the step, the slowest turning slip [m/s], and the rate of that speed
    speed: float
    speed_rate: float
    method: int  # PLAIN_METHOD, RESCALED or IMPLICIT
    size: float  # size of the step, in the unit of its method
    last: bool  # True if the step ends the span
    cut: bool  # True if the step is cut to end at `until`, because a full step passed it
    doubt: float  # tolerance of the works in a step, where they are wanted [J]


class Phase(NamedTuple):
    """Contact phase in one chart: its dimer, bounds, tolerances and arrays."""

    dm: Any
    modes: Any
    phase: float  # phase of the plate at the start of the contact phase [rad]
    span: float  # time that the steps are chosen for [s]
    until: float  # time to stop at, at most the span: a sample takes the steps of its run, and stops earlier [s]
    tol: float  # error per step, in units of the scales of the state
    slip_tol: float  # slip that counts as none [m/s]
    n: int  # entries of the state that are integrated
    b: Any  # arrays of its steps (`StepArrays`)
    control: Any
    bracket: Any  # bracket of an event
    meter: Any


@compiled
def begin_at(p, y):
    """Begin a phase at a contact state y: set its tolerances and rates, and the chart of all states of its steps."""
    copy(y, p.b.start.y, coordinates.N_Y)
    same_chart(y, p.b.out.y)
    same_chart(y, p.b.probe.y)
    for j in range(NODES):
        same_chart(y, p.b.nodes[j])
    set_scales(p)
    phase_rates(p, p.phase, p.b.start)


@compiled
def set_scales(p):
    """Set the tolerances of the contact state.

    Angles, rates, slips and lengths have tolerances in the scales of the scene. Works have the tolerance
    `control.doubt`.
    """
    dm, tol, scale = p.dm, p.tol, p.b.scale
    scale[Y.dip] = scale[Y.theta] = tol
    scale[Y.w_b] = scale[Y.w_p] = tol * dm.w_scale
    # a slip v comes with a spin v / r and a turn v / l: l / r is 10 at the base case, and so it is of gamma
    scale[Y.spin] = 10.0 * tol * dm.w_scale
    scale[Y.u_a] = scale[Y.u_b] = tol * dm.v_scale
    scale[Y.time] = tol * dm.period
    scale[Y.x] = scale[Y.y] = tol * extent(dm)[0]
    scale[Y.gamma] = 10.0 * tol
    for k in range(N_PATH, p.n):
        scale[k] = p.control.doubt


@compiled(inline=True)
def stiffness(p, force):
    """Return gamma, a bound on the rate at which friction turns a slip, times the slip [m s-2]; `force` is normal."""
    dm, y = p.dm, p.b.start.y
    tilt, gamma = 1.0 if y[Y.chart] == UPRIGHT else min(1.0, abs(dm.beta_0 + y[Y.dip])), 0.0
    for i in range(2):
        if p.modes[i] != FREE:
            q = end(dm, i)
            arm = abs(q.h) + q.r * tilt
            gamma = max(gamma, q.mu * (dm.im + arm * arm * dm.it + q.r * q.r * dm.ia) * force)
    return gamma


class Step(NamedTuple):
    """Step of a contact phase, of h seconds or, by the rescaled method, h units of xi."""

    p: Phase
    phase: float  # phase of the plate at the start of the step [rad]
    h: float
    method: int
    gamma: float


# --- explicit steps -----------------------------------------------------------------------------------------------------


@compiled
def ruling_slip(dm, modes, y):
    """Return the slip speed of the rescaled method [m/s]: half the harmonic mean, if both ends slip."""
    inverse = 0.0
    for i in range(2):
        if modes[i] == SLIP:
            inverse += 1.0 / length(*coordinates.slip_of(dm, modes, y, i))
    return 1.0 / inverse


@compiled(inline=True)
def time_per_xi(step, v, force):
    """Return the time per xi at a slip speed v [s]; `force` is the sum F of the normal forces.

    It is v / gamma. Near a jam, with a compliance c below TIGHT at the start of the step, it is multiplied by (1 + c) /
    (F / F_0 + c), with F_0 the force at the start. So it goes with 1 / F where the force grows. Where the force
    vanishes it stays finite, by c: c F_0 is about the force without friction.
    """
    share, start = v / step.gamma, step.p.b.start.F
    more = start[forces.COMPLIANCE]
    if more < TIGHT:
        share *= (1.0 + more) / (force / (start[F1] + start[F2]) + more)
    return share


@compiled(inline=True)
def rescale(step, y, F, k):
    """Multiply the slopes k by the time per xi, if the method is the rescaled one."""
    if step.method == RESCALED:
        share = time_per_xi(step, ruling_slip(step.p.dm, step.p.modes, y), F[F1] + F[F2])
        for j in range(step.p.n):
            k[j] *= share


@compiled
def slopes_of_any(step, i, *state):
    """Return the slopes of stage i of any contact, in either chart."""
    p, y, F, k = step.p, step.p.b.out.y, step.p.b.out.F, step.p.b.K[i]
    y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7] = state
    phase_rates(p, step.phase + p.dm.omega * y[Y.time], Moment(y, k, F))
    rescale(step, y, F, k)
    return k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]


@compiled
def works_of_single(step, i, now, rod, rates, share):
    """Write the slopes of the works of stage i of the contact of one end."""
    p, y, F, dy = step.p, step.p.b.out.y, step.p.b.out.F, step.p.b.K[i]
    y[Y.u_a], y[Y.u_b], y[Y.theta] = rod.u_a, rod.u_b, rod.theta
    forces.put_forces(leading(p.modes), rates.F, rates.A, rates.L, rates.compliance, F)
    forces.work_rates(p.dm, p.modes, now, y, F, dy)
    for j in range(N_PATH, coordinates.N_WORKED):
        dy[j] *= share


@compiled(fuse=True, inline=True)
def slopes_of_single(step, i, *state):
    """Return the slopes of stage i of the contact of one end in the chart by heading."""
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
    """Take one DOP853 step from the start into `out`; return the error over the tolerance."""
    p, b, y = step.p, step.p.b, step.p.b.start.y
    charge(p.meter, EXPLICIT_COST)
    # all entries, not p.n of them: with a constant number the copy compiles without a call
    copy(b.start.dy, b.K[0], coordinates.N_WORKED)
    rescale(step, y, b.start.F, b.K[0])
    if y[Y.chart] == UPRIGHT or (p.modes[0] != FREE and p.modes[1] != FREE):
        return explicit_step(slopes_of_any, step, step.h, y, b.K, p.n, b.scale, b.out.y)
    return explicit_step(slopes_of_single, step, step.h, y, b.K, p.n, b.scale, b.out.y)


# --- implicit steps -----------------------------------------------------------------------------------------------------


@compiled
def set_turns(p, j):
    """Write the directions of change that turn the slips at node j into rows of b.B; return their number.

    A direction is a change of (u_a, u_b, w_p). A single slip turns only across itself. Two slips share their axial
    part: every change turns one of them.
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
    """Compute the derivatives of the slopes at node j by the turns of the slips; return the number of turns.

    They are forward differences, and are written into rows of b.J, one row for each turn.
    """
    p, b, probe = step.p, step.p.b, step.p.b.probe
    y, f = b.nodes[j], b.K[j]
    v, _ = coordinates.slip_speed(p.dm, p.modes, y, y)
    m = set_turns(p, j)
    for i in range(m):
        turn = b.B[j * m + i]
        # a change of w_p by v / l changes the slip of one end against the other by v
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
    """Factor the matrix of Newton's rule for an implicit step of size h; return False if the matrix is singular.

    Its unknowns q are the turns of the slips at all nodes, m at each (`set_turns`); the other entries of the state are
    not stiff, and left out. The matrix is 1 - h A dq'/dq, with the table A of Radau IIA and the differences dq'/dq of
    `turn_slopes`. The factors are written into b.LU, the exchanged rows into b.pivots.
    """
    for j in range(NODES):
        for p in range(j * m, (j + 1) * m):
            turn = b.B[p]
            for k in range(NODES):
                a = h * RADAU_A[j, k]
                for q in range(k * m, (k + 1) * m):
                    slope = b.J[q]
                    b.LU[p, q] = -a * (turn[0] * slope[Y.u_a] + turn[1] * slope[Y.u_b] + turn[2] * slope[Y.w_p])
            b.LU[p, p] += 1.0
    return lu_factor(b.LU, NODES * m, b.pivots)


@compiled(fuse=True)
def newton_iteration(h, n, m, b):
    """Improve the states at the nodes by one Newton iteration; return the largest change over the tolerance.

    Only the turning of the slips is stiff. The other derivatives are left out, and the effect of the turns is carried
    over.
    """
    y, probe, nodes, K, B, change, scale = b.start.y, b.probe.y, b.nodes, b.K, b.B, b.change, b.scale
    for j in range(NODES):
        u_a, u_b, w_p = y[Y.u_a] - nodes[j, Y.u_a], y[Y.u_b] - nodes[j, Y.u_b], y[Y.w_p] - nodes[j, Y.w_p]
        for k in range(NODES):
            a, slope = h * RADAU_A[j, k], K[k]
            u_a += a * slope[Y.u_a]
            u_b += a * slope[Y.u_b]
            w_p += a * slope[Y.w_p]
        for i in range(j * m, (j + 1) * m):
            change[i] = B[i, 0] * u_a + B[i, 1] * u_b + B[i, 2] * w_p
    lu_solve(b.LU, NODES * m, b.pivots, change)
    for j in range(NODES):
        for i in range(j * m, (j + 1) * m):
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
    """Return the error of an implicit step over the tolerance, of the entries from `first` up to `last`.

    It is estimated from how fast the expansion of the slopes in Chebyshev polynomials falls off.
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
    """Take one Radau IIA step from the start into `out`; return the error over the tolerance, inf if it fails."""
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
        # before the derivatives are renewed the changes may grow; afterwards growth means that Newton's rule diverges
        if not change < inf or (turn > RENEWED and change > before):
            return inf
        before = change
    return inf


@compiled(inline=True)
def step_to(p, phase, h):
    """Take one step of size h by the chosen method, from a phase of the plate; return its error over the tolerance.

    The rates (per time) and the forces at its end are left in `out`.
    """
    step = Step(p, phase, h, p.control.method, p.control.stiffness)
    error = implicit_step(step) if step.method == IMPLICIT else explicit_contact_step(step)
    phase_rates(p, phase + p.dm.omega * p.b.out.y[Y.time], p.b.out)
    return error
