"""One step of an impact at both ends, by DOP853 or, where a slip stays slow, by Rodas5P."""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import (
    N_RUBBED,
    N_Z,
    ZA,
    ZS1,
    impact_jacobian,
    impact_rates,
    rates_in_clock,
    rub_rates,
)
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import (
    ROS_STAGES,
    WIDTH,
    explicit_step,
    implicit_load,
    implicit_stage,
    lu_factor,
    lu_solve,
    on_cubic,
)
from dimersweep.kernel.numerics.tableaux import ROS_GAMMA

LEG_ROWS = 31
EXPLICIT_LEG_COST, IMPLICIT_LEG_COST = 0.5, 1.0  # of a step, in hops of one end: as measured


class Stride:
    """What one step of a leg leaves to the next."""

    clock: int
    pace: float  # dtau/dsigma of that clock at the start of the step
    h: float  # size of the step, or of the next one
    longest: float
    turning: float  # time in which friction turns the slip that it turns fastest
    slow: int  # steps in a row in which that is short
    stiff: bool  # whether the step is implicit, and the unit of the slips' errors in it
    unit: float
    near: float  # way over which a probe may carry the last one on
    faint: float  # compression that is worth a gap rate of the tolerance
    uncompressed: bool  # whether the leg sets out so
    clock_before: (
        int  # of the last explicit step that was taken, if any, with its size, and its error over the tolerance
    )
    h_before: float
    error_before: float


class Leg(NamedTuple):
    """A leg of an impact at both ends, and rows of scratch by what they hold during a step of it."""

    dm: Any
    modes: Any
    compressing: Any
    tol: float
    slip_tol: float
    n: int  # entries of the state that are integrated
    stride: Any
    meter: Any
    bracket: Any
    K: Any  # slopes of the stages, the first of them at the start of the step
    implicit: Any  # of an implicit step: its matrix, derivatives of the frictions, pivots
    start: Any  # state at the start of the step, and state and rates at its end
    out: Any
    rates_out: Any
    scale: Any
    gains: Any
    armed: Any  # event functions that have been positive
    probe: Any
    rates_probe: Any


@compiled(inline=True)
def leg_rows(rows):
    """The rows of a leg, in the order in which it has them, on scratch of at least LEG_ROWS."""
    return rows[0:12], rows[12:23], rows[23], rows[24], rows[25], rows[26], rows[27], rows[28], rows[29], rows[30]


@compiled(inline=True)
def stage_slopes(leg, i, n_1, n_2, X_1, X_2, a, b_1, b_2, _):
    """Slopes of a stage of an explicit step; the last entry that it controls is not used."""
    z, clock = (n_1, n_2, X_1, X_2, a, b_1, b_2), leg.stride.clock
    if leg.n > WIDTH:
        rub_rates(leg.dm, leg.modes, clock, z, leg.K[i])
    rates = rates_in_clock(leg.dm, leg.modes, leg.gains, clock, z)
    return rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6], 0.0


@compiled(inline=True)
def leg_rates(leg, z, out):
    """Rates of a state in the clock of a leg, and of what slip takes, where it is wanted."""
    clock = leg.stride.clock
    impact_rates(leg.dm, leg.modes, leg.gains, clock, z, out)
    if leg.n > WIDTH:
        rub_rates(leg.dm, leg.modes, clock, z, out)


@compiled
def leg_step(leg, h):
    """One step of size h from its start into `out`, by the method that suits; returns the error over the tolerance."""
    if leg.stride.stiff:
        charge(leg.meter, IMPLICIT_LEG_COST)
        return implicit_step(leg, h)
    charge(leg.meter, EXPLICIT_LEG_COST)
    return explicit_step(stage_slopes, leg, h, leg.start, leg.K, leg.n, leg.scale, leg.out)


@compiled
def implicit_step(leg, h):
    """One Rodas5P step of size h from its start into `out`, in the plain clock; returns the error over the tolerance.

    Errors of the slips are measured in their unit.
    """
    LU, pivots, out, K = leg.implicit[0:7], leg.implicit[10], leg.out, leg.K[1:]
    impact_jacobian(leg.dm, leg.modes, leg.gains, leg.start, leg.implicit[7:10], LU)
    for i in range(N_Z):
        for j in range(N_Z):
            LU[i, j] = -LU[i, j]
        LU[i, i] += 1.0 / (ROS_GAMMA * h)
    if not lu_factor(LU, N_Z, pivots):
        return inf
    for i in range(ROS_STAGES):
        implicit_stage(i, leg.start, K, N_Z, out)
        impact_rates(leg.dm, leg.modes, leg.gains, leg.stride.clock, out, K[i])
        implicit_load(i, h, K, N_Z, K[i])
        lu_solve(LU, N_Z, pivots, K[i])
    total = 0.0
    for k in range(N_Z):
        out[k] += K[ROS_STAGES - 1, k]
        unit = leg.stride.unit if k >= ZA else 1.0
        total += (K[ROS_STAGES - 1, k] / unit) ** 2
    if leg.n > WIDTH:
        rub_over_step(leg, h)
    return sqrt(total / N_Z) / leg.tol


@compiled
def rub_over_step(leg, h):
    """What slip takes over an implicit step, by Simpson's rule on the cubic through its ends."""
    leg_rates(leg, leg.out, leg.rates_out)
    on_cubic(leg.start, leg.K[0], leg.out, leg.rates_out, 0.5, h, N_Z, leg.probe)
    leg_rates(leg, leg.probe, leg.rates_probe)
    for k in range(ZS1, N_RUBBED):
        leg.out[k] = leg.start[k] + h / 6.0 * (leg.K[0, k] + 4.0 * leg.rates_probe[k] + leg.rates_out[k])
