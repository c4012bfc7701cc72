"""One step of an impact at both ends, by DOP853 or, where a slip stays slow, by Rodas5P."""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import (
    N_Z,
    PLAIN_CLOCK,
    ZA,
    impact_jacobian,
    impact_rates,
    rates_in_clock,
)
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import (
    DOP_STAGES,
    ROS_STAGES,
    WIDTH,
    explicit_finish,
    implicit_load,
    implicit_stage,
    lu_factor,
    lu_solve,
    stage_sums,
)
from dimersweep.kernel.numerics.tableaux import DOP_A, ROS_GAMMA

LEG_ROWS = 40
EXPLICIT_LEG_COST, IMPLICIT_LEG_COST = 0.5, 1.0  # of a step, in hops of one end: as measured


class LegRows(NamedTuple):
    """Rows of the work array, by what they hold during a step."""

    K: Any  # slopes of the stages
    J: Any  # Jacobian, and the matrix of the implicit stages
    LU: Any
    F: Any  # derivatives of the frictions
    start: Any  # state and rates at the start of the step, and the state at its end
    rates: Any
    out: Any
    rates_out: Any
    scale: Any
    gains: Any
    armed: Any  # event functions that have been positive
    pivots: Any
    probe: Any
    rates_probe: Any
    bracket: Any
    e: Any  # restitution of both ends
    meter: Any


@compiled
def leg_rows(work):
    """The rows of a leg on scratch of at least LEG_ROWS rows."""
    rows = work.rows
    return LegRows(
        rows[0:12],
        rows[12:19],
        rows[19:26],
        rows[26:29],
        rows[29],
        rows[30],
        rows[31],
        rows[32],
        rows[33],
        rows[34],
        rows[35],
        rows[36],
        rows[37],
        rows[38],
        work.bracket,
        rows[39],
        work.meter,
    )


@compiled(fuse=True, inline=True)
def stage_value(y, h, total, a, k):
    """An entry of the state at a stage, from the sum over the older slopes and the newest one k."""
    return y + h * (total + a * k)


@compiled
def explicit_step(dm, modes, clock, h, tol, b):
    """One DOP853 step of size h in a clock, from b.start into b.out; returns the error over the tolerance.

    The newest slopes stay in registers: to write them to K and to read them at once takes a tenth of the step.
    """
    y, k = b.start, b.rates
    k0, k1, k2, k3, k4, k5, k6 = k[0], k[1], k[2], k[3], k[4], k[5], k[6]
    for i in range(DOP_STAGES):
        k = b.K[i]
        k[0], k[1], k[2], k[3], k[4], k[5], k[6] = k0, k1, k2, k3, k4, k5, k6
        if i < DOP_STAGES - 1:
            t0, t1, t2, t3, t4, t5, t6, _ = stage_sums(i + 1, i, b.K)
            a = DOP_A[i + 1, i]
            k0, k1, k2, k3, k4, k5, k6 = rates_in_clock(
                dm,
                modes,
                b.gains,
                clock,
                stage_value(y[0], h, t0, a, k0),
                stage_value(y[1], h, t1, a, k1),
                stage_value(y[2], h, t2, a, k2),
                stage_value(y[3], h, t3, a, k3),
                stage_value(y[4], h, t4, a, k4),
                stage_value(y[5], h, t5, a, k5),
                stage_value(y[6], h, t6, a, k6),
            )
    for j in range(WIDTH):
        b.scale[j] = tol
    return explicit_finish(h, b.start, b.K, WIDTH, b.scale, b.out)


@compiled
def implicit_step(dm, modes, h, tol, slip_unit, b):
    """One Rodas5P step of size h from b.start into b.out; returns the error over the tolerance.

    Errors of the slips are measured in `slip_unit`.
    """
    impact_jacobian(dm, modes, b.gains, b.start, b.F, b.J)
    for i in range(N_Z):
        for j in range(N_Z):
            b.LU[i, j] = -b.J[i, j]
        b.LU[i, i] += 1.0 / (ROS_GAMMA * h)
    if not lu_factor(b.LU, N_Z, b.pivots):
        return inf
    for i in range(ROS_STAGES):
        implicit_stage(i, b.start, b.K, N_Z, b.out)
        impact_rates(dm, modes, b.gains, PLAIN_CLOCK, b.out, b.K[i])
        implicit_load(i, h, b.K, N_Z, b.K[i])
        lu_solve(b.LU, N_Z, b.pivots, b.K[i])
    total = 0.0
    for k in range(N_Z):
        b.out[k] += b.K[ROS_STAGES - 1, k]
        unit = slip_unit if k >= ZA else 1.0
        total += (b.K[ROS_STAGES - 1, k] / unit) ** 2
    return sqrt(total / N_Z) / tol


@compiled(inline=True)
def leg_step(dm, modes, clock, h, tol, slip_unit, stiff, b):
    """One step of size h from b.start into b.out, by the method that suits; returns the error over the tolerance."""
    charge(b.meter, IMPLICIT_LEG_COST if stiff else EXPLICIT_LEG_COST)
    if stiff:
        return implicit_step(dm, modes, h, tol, slip_unit, b)
    return explicit_step(dm, modes, clock, h, tol, b)
