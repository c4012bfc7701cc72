"""One step of an impact at both ends, by DOP853 or, where a slip stays slow, by Rodas5P."""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import (
    N_RUBBED,
    N_Z,
    PLAIN_CLOCK,
    ZA,
    ZB1,
    ZS1,
    ZX1,
    force_in_clock,
    impact_jacobian,
    impact_rates,
    rates_in_clock,
)
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.friction import direction, slip_force
from dimersweep.kernel.model.layout import SLIP
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import (
    ROS_STAGES,
    WIDTH,
    copy,
    explicit_step,
    implicit_load,
    implicit_stage,
    lu_factor,
    lu_solve,
    on_cubic,
)
from dimersweep.kernel.numerics.tableaux import ROS_GAMMA

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
    n: int  # entries of the state that an explicit step integrates


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
        N_RUBBED if work.course[0].tally.wanted else WIDTH,
    )


class Leg(NamedTuple):
    """What the rates of a leg depend on besides its state."""

    dm: Any
    modes: Any
    gains: Any
    clock: Any
    K: Any  # of all rows no more than a stage needs: each is handed on by its parts
    n: int


@compiled
def rub_rates(leg, X_1, X_2, a, b_1, b_2, out):
    """What slip takes per clock at both ends, into its places in out."""
    dm, clock = leg.dm, leg.clock
    pace = 1.0 if clock == PLAIN_CLOCK else (X_2 if clock == 1 else X_1)
    for i in range(2):
        out[ZS1 + i] = 0.0
        if leg.modes[i] == SLIP:
            X, b = (X_1, b_1) if i == 0 else (X_2, b_2)
            A, L = slip_force(end(dm, i).mu, pace * force_in_clock(dm, clock, i, X), *direction(a, b))
            out[ZS1 + i] = A * a + L * b


@compiled
def rub_rates_at(leg, z, out):
    """What slip takes per clock in the state z."""
    rub_rates(leg, z[ZX1], z[ZX1 + 1], z[ZA], z[ZB1], z[ZB1 + 1], out)


@compiled
def pass_rubs_on(source, target, n):
    """Copy what slip has taken, where it is wanted."""
    for k in range(ZS1, n):
        target[k] = source[k]


@compiled(inline=True)
def leg_slopes(leg, i, n_1, n_2, X_1, X_2, a, b_1, b_2, _):
    """Slopes of a stage of an explicit step; the last entry that it controls is not used."""
    if leg.n > WIDTH:
        rub_rates(leg, X_1, X_2, a, b_1, b_2, leg.K[i])
    rates = rates_in_clock(leg.dm, leg.modes, leg.gains, leg.clock, n_1, n_2, X_1, X_2, a, b_1, b_2)
    return rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6], 0.0


@compiled
def explicit_leg_step(dm, modes, clock, h, tol, b):
    """One DOP853 step of size h in a clock, from b.start into b.out; returns the error over the tolerance."""
    leg = Leg(dm, modes, b.gains, clock, b.K, b.n)
    copy(b.rates, b.K[0], WIDTH)
    if b.n > WIDTH:
        rub_rates_at(leg, b.start, b.K[0])
    for j in range(WIDTH):
        b.scale[j] = tol
    return explicit_step(leg_slopes, leg, h, b.start, b.K, b.n, b.scale, b.out)


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
    if b.n > WIDTH:
        rub_over_step(Leg(dm, modes, b.gains, PLAIN_CLOCK, b.K, b.n), h, b)
    return sqrt(total / N_Z) / tol


@compiled
def rub_over_step(leg, h, b):
    """What slip takes over an implicit step, by Simpson's rule on the cubic through its ends."""
    impact_rates(leg.dm, leg.modes, b.gains, PLAIN_CLOCK, b.out, b.rates_out)
    on_cubic(b.start, b.rates, b.out, b.rates_out, 0.5, h, N_Z, b.probe)
    pass_rubs_on(b.start, b.out, b.n)
    for share, z in ((1.0, b.start), (4.0, b.probe), (1.0, b.out)):
        rub_rates_at(leg, z, b.rates_probe)
        for k in range(ZS1, N_RUBBED):
            b.out[k] += share * h / 6.0 * b.rates_probe[k]


@compiled(inline=True)
def leg_step(dm, modes, clock, h, tol, slip_unit, stiff, b):
    """One step of size h from b.start into b.out, by the method that suits; returns the error over the tolerance."""
    charge(b.meter, IMPLICIT_LEG_COST if stiff else EXPLICIT_LEG_COST)
    if stiff:
        return implicit_step(dm, modes, h, tol, slip_unit, b)
    return explicit_leg_step(dm, modes, clock, h, tol, b)
