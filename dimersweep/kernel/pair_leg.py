"""One leg of an impact at both ends, from its start to its first event.

DOP853 integrates it. The direction of a slow slip is stiff; most slips are slow for a moment only, in which steps within what
the method bears are the cheapest. Where a slip stays slow Rodas5P takes over.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.jit import compiled
from dimersweep.kernel.law import length
from dimersweep.kernel.layout import SLIP, STICK
from dimersweep.kernel.pair_law import (
    N_Z,
    ZA,
    ZB1,
    ZN1,
    ZX1,
    impact_jacobian,
    impact_rates,
    pressure,
    stick_reserve,
)
from dimersweep.kernel.steps import (
    DOP_STAGES,
    ROS_STAGES,
    WIDTH,
    copy,
    explicit_finish,
    explicit_stage,
    implicit_load,
    implicit_stage,
    inside,
    lu_factor,
    lu_solve,
    shrink,
    step_factor,
)
from dimersweep.kernel.tableaux import ROS_GAMMA

MAX_STEPS = 20000
MAX_PROBES = 160
N_EVENTS = 8
PAIR_ROWS = 36
FIRST = 0.05  # first step
TURNS = 4.0  # of a slip, that an explicit step may span: what the method bears
STIFF = 0.01  # explicit step below which a slip is slow
LASTS = 100  # such steps in a row, after which the implicit method takes over
EXACT = 1e-3  # what an event function may be off its zero, in units of the tolerance
STOPPED = 0.25  # slip, in units of the one that counts as none, at which a slip ends: it sets out with more
RUB = 0.02  # friction, in units of a slip's own rate, from which it steers the slip


class PairBench(NamedTuple):
    """Rows of the work array, by what they hold during a step."""

    K: Any  # slopes of the stages
    J: Any  # Jacobian, and the matrix of the implicit stages
    LU: Any
    F: Any  # derivatives of the frictions
    start: Any  # state and rates at the start of the step, and the state at its end
    rates: Any
    out: Any
    scale: Any
    gains: Any
    armed: Any  # event functions that have been positive
    pivots: Any


@compiled
def lay_out_pair(work):
    """The bench on a work array of at least PAIR_ROWS rows."""
    return PairBench(
        work[0:12],
        work[12:19],
        work[19:26],
        work[26:29],
        work[29],
        work[30],
        work[31],
        work[32],
        work[33],
        work[34],
        work[35],
    )


@compiled
def explicit_step(law, modes, h, tol, b):
    """One DOP853 step of size h from b.start into b.out; returns the error over the tolerance."""
    for k in range(WIDTH):
        b.scale[k] = tol
    copy(b.rates, b.K[0], WIDTH)
    for i in range(1, DOP_STAGES):
        explicit_stage(i, h, b.start, b.K, WIDTH, b.out)
        impact_rates(law, modes, b.gains, b.out, b.K[i])
    return explicit_finish(h, b.start, b.K, WIDTH, b.scale, b.out)


@compiled
def implicit_step(law, modes, h, tol, slip_unit, b):
    """One Rodas5P step of size h from b.start into b.out; returns the error over the tolerance.

    Errors of the slips are measured in `slip_unit`.
    """
    impact_jacobian(law, modes, b.gains, b.start, b.F, b.J)
    for i in range(N_Z):
        for j in range(N_Z):
            b.LU[i, j] = -b.J[i, j]
        b.LU[i, i] += 1.0 / (ROS_GAMMA * h)
    if not lu_factor(b.LU, N_Z, b.pivots):
        return inf
    for i in range(ROS_STAGES):
        implicit_stage(i, b.start, b.K, N_Z, b.out)
        impact_rates(law, modes, b.gains, b.out, b.K[i])
        implicit_load(i, h, b.K, N_Z, b.K[i])
        lu_solve(b.LU, N_Z, b.pivots, b.K[i])
    total = 0.0
    for k in range(N_Z):
        b.out[k] += b.K[ROS_STAGES - 1, k]
        unit = slip_unit if k >= ZA else 1.0
        total += (b.K[ROS_STAGES - 1, k] / unit) ** 2
    return sqrt(total / N_Z) / tol


@compiled
def pair_step(law, modes, h, tol, slip_unit, stiff, b):
    """One step of size h from b.start into b.out, by the method that suits; returns the error over the tolerance."""
    if stiff:
        return implicit_step(law, modes, h, tol, slip_unit, b)
    return explicit_step(law, modes, h, tol, b)


@compiled
def turning_time(law, modes, z):
    """Time in which friction turns the slip that it turns fastest; inf if none turns."""
    least = inf
    if modes[0] == STICK or modes[1] == STICK:
        return least
    for i in range(2):
        pace = law.mu * law.bb * pressure(z[ZX1 + i])
        if pace > 0.0:
            least = min(least, length(z[ZA], z[ZB1 + i]) / pace)
    return least


@compiled
def event_value(law, k, modes, compressing, base, z, tol):
    """Event function k of a phase, positive while the phase goes on; inf where it has no meaning.

    0, 1: gap rate of p1, p2 against the phase; 2, 3: compression left; 4, 5: reserve of the friction that holds;
    6, 7: slip along its direction at `base`, the start of the step (so that a passage through zero changes sign).
    """
    i = k % 2
    if k < 2:
        return -z[ZN1 + i] if compressing[i] > 0.0 else z[ZN1 + i]
    if k < 4:
        return inf if compressing[i] > 0.0 else z[ZX1 + i]
    if k < 6:
        # all force vanishes where an impact ends: only its ratios decide
        total = pressure(z[ZX1]) + pressure(z[ZX1 + 1])
        return stick_reserve(law, modes, i, z) / total if total > 0.0 else 1.0
    if modes[i] == STICK or law.mu == 0.0:
        return inf
    v = length(base[ZA], base[ZB1 + i])
    return (z[ZA] * base[ZA] + z[ZB1 + i] * base[ZB1 + i]) / v - STOPPED * tol if v > 0.0 else inf


@compiled
def slip_bound(z, rates, modes, h):
    """Step that leaves a slip about a tenth of itself where it decreases, at most h."""
    for i in range(2):
        v = length(z[ZA], z[ZB1 + i])
        if modes[i] == SLIP and v > 0.0:
            rate = (z[ZA] * rates[ZA] + z[ZB1 + i] * rates[ZB1 + i]) / v
            if rate < 0.0:
                h = min(h, -0.9 * v / rate)
    return h


@compiled
def slip_unit(law, modes, z, rates):
    """Unit of the slips' errors: a slip that sets out of rest against friction remembers its first direction, so that its
    errors count relative to itself; else the approach speed is the unit.
    """
    unit = 1.0
    for i in range(2):
        v = length(z[ZA], z[ZB1 + i])
        if modes[i] == SLIP and v > 0.0:
            rate = (z[ZA] * rates[ZA] + z[ZB1 + i] * rates[ZB1 + i]) / v
            if rate > 0.0 and law.mu * pressure(z[ZX1 + i]) * law.aa > RUB * rate:
                unit = min(unit, v)
    return unit


@compiled
def pair_leg(law, z, modes, compressing, tol, slip_tol, work):
    """Integrate from z, in place, to the first event of the phase; returns its number, or -1 when steps ran out."""
    b = lay_out_pair(work)
    for i in range(2):
        e = law.e_1 if i == 0 else law.e_2
        b.gains[i] = 1.0 if compressing[i] > 0.0 else 1.0 / (e * e)
    for k in range(N_EVENTS):
        b.armed[k] = 1.0 if event_value(law, k, modes, compressing, z, z, slip_tol) > 0.0 else 0.0
    for k in range(N_Z, WIDTH):
        b.start[k], b.rates[k] = 0.0, 0.0
        for i in range(DOP_STAGES):
            b.K[i, k] = 0.0
    h, slow = FIRST, 0
    for _ in range(MAX_STEPS):
        copy(z, b.start, N_Z)
        impact_rates(law, modes, b.gains, z, b.rates)
        turns = TURNS * turning_time(law, modes, z)
        slow = slow + 1 if turns < STIFF else 0
        stiff = slow > LASTS
        h = slip_bound(z, b.rates, modes, h if stiff else min(h, turns))
        unit = slip_unit(law, modes, z, b.rates) if stiff else 1.0
        error = pair_step(law, modes, h, tol, unit, stiff, b)
        factor = step_factor(error, 5.0 if stiff else 8.0)
        if not error <= 1.0:
            h *= factor
            continue
        least, _ = least_value(law, modes, compressing, b.armed, b.start, b.out, slip_tol)
        if least > 0.0:
            copy(b.out, z, N_Z)
            for k in range(N_EVENTS):
                if event_value(law, k, modes, compressing, z, z, slip_tol) > 0.0:
                    b.armed[k] = 1.0
            h *= factor
            continue
        event = first_crossing(law, modes, compressing, h, least, tol, slip_tol, stiff, b)
        copy(b.out, z, N_Z)
        if event < 6 or length(z[ZA], z[ZB1 + event - 6]) <= 4.0 * slip_tol:
            return event
        h *= factor  # the slip has only turned by a right angle, and goes on
    return -1


@compiled
def first_crossing(law, modes, compressing, h, least, tol, slip_tol, stiff, b):
    """Number of the first event in a step h over which the least event function fell to `least`; b.out becomes its state.

    Bracketed search, each probe a step of its own.
    """
    low, high, g_high, side = 0.0, h, least, 0
    g_low, _ = least_value(law, modes, compressing, b.armed, b.start, b.start, slip_tol)
    for probe in range(MAX_PROBES):
        if high - low <= 1e-15 * h:
            break
        mid = inside(low, high, g_low, g_high, probe)
        pair_step(law, modes, mid, tol, 1.0, stiff, b)
        g, _ = least_value(law, modes, compressing, b.armed, b.start, b.out, slip_tol)
        low, high, g_low, g_high, side = shrink(low, high, g_low, g_high, mid, g, side)
        if abs(g) <= EXACT * tol:
            high = mid
            break
    else:
        pair_step(law, modes, high, tol, 1.0, stiff, b)
    _, which = least_value(law, modes, compressing, b.armed, b.start, b.out, slip_tol)
    return which


@compiled
def least_value(law, modes, compressing, armed, base, z, tol):
    """Least of the armed event functions at z, and its number (inf and -1 if none is armed)."""
    least, which = inf, -1
    for k in range(N_EVENTS):
        if armed[k] > 0.0:
            value = event_value(law, k, modes, compressing, base, z, tol)
            if value < least:
                least, which = value, k
    return least, which
