"""One leg of an impact at both ends, from its start to its first event.

DOP853 integrates it. The direction of a slow slip is stiff; most slips are slow for a moment only, in which steps within what
the method bears are the cheapest. Where a slip stays slow Rodas5P takes over.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import (
    BOTH_CLOCK,
    N_Z,
    PLAIN_CLOCK,
    ZA,
    ZB1,
    ZN1,
    ZN2,
    ZX1,
    ZX2,
    force,
    forces,
    from_clock,
    impact_rates,
    lateral_of,
    stick_reserve,
    to_clock,
)
from dimersweep.kernel.impact.double_step import Leg, leg_rows, leg_step, pass_rubs_on, rub_rates_at
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.layout import SLIP, STICK
from dimersweep.kernel.numerics.armed_events import arm, least_armed
from dimersweep.kernel.numerics.elementary import eighth_root, length, nearly_raised
from dimersweep.kernel.numerics.meter import is_over
from dimersweep.kernel.numerics.root_bracket import (
    CARRIED,
    PROBE_FOUND,
    PROBE_LOOK_ON,
    PROBE_REFUSED,
    UNSOUND,
    locate,
    set_bracket,
    zero_on_cubic,
)
from dimersweep.kernel.numerics.steps import (
    DOP_STAGES,
    WIDTH,
    copy,
    on_cubic,
    step_factor,
)

MAX_LEG_STEPS = 20000
N_LEG_EVENTS = 8
FIRST_LEG_STEP = 4.0  # first step, over the tolerance to the power of 1/8
LEG_TURNS = 5.5  # of a slip, that an explicit step may span: what the method bears
SLOW_SLIP_STEP = 0.01  # explicit step below which a slip is slow
LASTS = 30  # such steps in a row, after which the implicit method takes over
NEAR_PROBE = 0.3  # distance that one evaluation crosses as well as the tolerance, over its cubic root
ZERO_ERROR = 1e-3  # what an event function may be off its zero, in units of the tolerance
SLIP_ENDS_AT = 0.25  # slip, in units of the one that counts as none, at which a slip ends: it sets out with more
UNFORESEEN = 1e-3  # error over the tolerance below which the last step does not show how errors change
# second step of a leg that sets out uncompressed, over the first: its error does not show how large the next ones are
SECOND_STEP = 0.95
RUB = 0.02  # friction, in units of a slip's own rate, from which it steers the slip


@compiled
def ruling_clock(dm, z, gains, faint):
    """The clock in which the motion is most regular: of the end whose Y changes fastest (X below `faint` count alike).

    The clock of an end that has gone, with nothing to press any more, would stand still.
    Ends that move alike go on so to the last digit: without axial slip, which parts them, they have a clock in common.
    """
    gone_1, gone_2 = z[ZX1] <= 0.0 and z[ZN1] >= 0.0, z[ZX2] <= 0.0 and z[ZN2] >= 0.0
    if gone_1 and gone_2:
        return PLAIN_CLOCK
    if gone_1 or gone_2:
        return 1 if gone_1 else 0
    alike = (
        dm.pair.nn_1 == dm.pair.nn_2 and dm.pair.na_1 == -dm.pair.na_2 and dm.p1.k == dm.p2.k and gains[0] == gains[1]
    )
    if alike and z[ZN1] == z[ZN2] and z[ZX1] == z[ZX2]:
        return BOTH_CLOCK if z[ZA] == 0.0 else PLAIN_CLOCK
    u_1, u_2 = gains[0] * z[ZN1], gains[1] * z[ZN2]
    return 0 if u_1 * u_1 * (z[ZX2] + faint) > u_2 * u_2 * (z[ZX1] + faint) else 1


@compiled
def clock_rate(clock, z):
    """dtau/dsigma of a clock in a state of the plain one."""
    return 1.0 if clock == PLAIN_CLOCK else sqrt(max(0.0, z[ZX2] if clock == 1 else z[ZX1]))


@compiled
def turning_time(dm, modes, z):
    """Time in which friction turns the slip that it turns fastest; inf if none turns."""
    least = inf
    if modes[0] == STICK or modes[1] == STICK:
        return least
    for i in range(2):
        pace = end(dm, i).mu * lateral_of(dm, i) * force(dm, i, z[ZX1 + i])
        if pace > 0.0:
            least = min(least, length(z[ZA], z[ZB1 + i]) / pace)
    return least


class LegEvents(NamedTuple):
    """A state of a leg in which the event functions are asked for."""

    dm: Any
    modes: Any
    compressing: Any
    clock: int
    base: Any  # the state at the start of the step
    z: Any
    tol: float


@compiled(inline=True)
def event_value(at, k):
    """Event function k of a phase, positive while the phase goes on; inf where it has no meaning.

    0, 1: gap rate of p1, p2 against the phase; 2, 3: compression left; 4, 5: reserve of the friction that holds;
    6, 7: slip along its direction at `base`, the start of the step (so that a passage through zero changes sign).
    """
    dm, z, base, i = at.dm, at.z, at.base, k % 2
    if k < 2:
        return -z[ZN1 + i] if at.compressing[i] > 0.0 else z[ZN1 + i]
    if k < 4:
        return inf if at.compressing[i] > 0.0 else z[ZX1 + i]
    if k < 6:
        # all force vanishes where an impact ends: only its ratios decide
        f_1, f_2 = forces(dm, z, at.clock)
        return stick_reserve(dm, at.modes, i, z, f_1, f_2) / (f_1 + f_2) if f_1 + f_2 > 0.0 else 1.0
    if at.modes[i] == STICK or end(dm, i).mu == 0.0:
        return inf
    v = length(base[ZA], base[ZB1 + i])
    return (z[ZA] * base[ZA] + z[ZB1 + i] * base[ZB1 + i]) / v - SLIP_ENDS_AT * at.tol if v > 0.0 else inf


@compiled
def least_value(dm, modes, compressing, clock, armed, base, z, tol):
    """Least of the armed event functions at z, and its number (inf and -1 if none is armed)."""
    return least_armed(event_value, LegEvents(dm, modes, compressing, clock, base, z, tol), armed, N_LEG_EVENTS)


@compiled
def slip_bound(dm, z, rates, modes, h):
    """Step that leaves a slip about a tenth of itself where friction has it decrease, at most h."""
    for i in range(2):
        v = length(z[ZA], z[ZB1 + i])
        if modes[i] == SLIP and v > 0.0 and end(dm, i).mu > 0.0:
            rate = (z[ZA] * rates[ZA] + z[ZB1 + i] * rates[ZB1 + i]) / v
            if rate < 0.0:
                h = min(h, -0.9 * v / rate)
    return h


@compiled
def slip_unit(dm, modes, z, rates):
    """Unit of the slips' errors: a slip that sets out of rest against friction remembers its first direction, so that its
    errors count relative to itself; else the approach speed is the unit.
    """
    unit = 1.0
    for i in range(2):
        v = length(z[ZA], z[ZB1 + i])
        if modes[i] == SLIP and v > 0.0:
            rate = (z[ZA] * rates[ZA] + z[ZB1 + i] * rates[ZB1 + i]) / v
            if rate > 0.0 and end(dm, i).mu * force(dm, i, z[ZX1 + i]) * dm.pair.aa > RUB * rate:
                unit = min(unit, v)
    return unit


@compiled
def stays_slow(dm, modes, z, slip_tol):
    """Number of an end whose slip counts as none and that friction can hold, -1 if there is none.

    Where drive and friction balance, a slip goes on at a speed below all that counts.
    """
    f_1, f_2 = force(dm, 0, z[ZX1]), force(dm, 1, z[ZX2])
    for i in range(2):
        if modes[i] == SLIP and end(dm, i).mu > 0.0 and length(z[ZA], z[ZB1 + i]) <= slip_tol:
            modes[i] = STICK
            room = stick_reserve(dm, modes, i, z, f_1, f_2)
            modes[i] = SLIP
            if room > 0.0:
                return i
    return -1


@compiled
def foreseen(h, error, h_before, error_before):
    """By what to multiply a step, if errors go on to change as from the step before to this one (Gustafsson's controller)."""
    root = sqrt(sqrt(sqrt(max(error_before, UNFORESEEN) / max(error * error, 1e-30))))
    return max(0.3, 0.9 * h / h_before * root)


@compiled
def begin_leg(dm, z, modes, compressing, slip_tol, b):
    """Gains of the compressions, event functions that are positive already, and zeros where a step reads beyond the state."""
    for i in range(2):
        b.gains[i] = 1.0 if compressing[i] > 0.0 else 1.0 / (b.e[i] * b.e[i])
    for k in range(N_LEG_EVENTS):
        b.armed[k] = 0.0
    arm(event_value, LegEvents(dm, modes, compressing, PLAIN_CLOCK, z, z, slip_tol), b.armed, N_LEG_EVENTS)
    for k in range(N_Z, WIDTH):
        b.start[k], b.rates[k] = 0.0, 0.0
        for i in range(DOP_STAGES):
            b.K[i, k] = 0.0


@compiled
def double_leg(dm, z, modes, compressing, tol, slip_tol, work):
    """Integrate from z, in place, to the first event of the phase; returns its number, or -1 when steps or work ran out."""
    b = leg_rows(work)
    begin_leg(dm, z, modes, compressing, slip_tol, b)
    faint = nearly_raised(tol, 0.4)  # a compression that is worth a gap rate of the tolerance
    clock, slow = ruling_clock(dm, z, b.gains, faint), 0
    longest = 1.0 / sqrt(max(b.gains[0], b.gains[1]))
    h = FIRST_LEG_STEP * eighth_root(tol) * longest
    turning, turns, pace, unit, stiff, fresh = inf, inf, 1.0, 1.0, False, True
    uncompressed, h_before, error_before, clock_before = z[ZX1] <= 0.0 and z[ZX2] <= 0.0, 0.0, 1.0, PLAIN_CLOCK
    for _ in range(MAX_LEG_STEPS):
        if is_over(b.meter):
            break
        if fresh:
            turning = turning_time(dm, modes, z)
            turns = LEG_TURNS * turning
        slow = slow + 1 if turns < SLOW_SLIP_STEP else 0
        fresh, stiff = fresh or stiff != (slow > LASTS), slow > LASTS
        if fresh:  # else the last step was refused, and only its size is another one
            last, clock = clock, PLAIN_CLOCK if stiff else ruling_clock(dm, z, b.gains, faint)
            pace = clock_rate(clock, z)
            if clock != last:
                h = min(h * clock_rate(last, z) / pace, longest)
            copy(z, b.start, N_Z)
            pass_rubs_on(z, b.start, b.n)
            to_clock(clock, b.start)
            impact_rates(dm, modes, b.gains, clock, b.start, b.rates)
            if not stiff and h * pace > turns:
                h = turns / pace
            h = slip_bound(dm, z, b.rates, modes, h)
            unit = slip_unit(dm, modes, z, b.rates) if stiff else 1.0
        error = leg_step(dm, modes, clock, h, tol, unit, stiff, b)
        factor = step_factor(error, 5.0 if stiff else 8.0)
        if not error <= 1.0:
            h, fresh = factor * h, False
            continue
        if not stiff:
            if h_before > 0.0 and clock == clock_before:
                factor = min(factor, foreseen(h, error, h_before, error_before))
            elif uncompressed:
                factor = min(factor, SECOND_STEP)
            h_before, error_before, clock_before = h, error, clock
        fresh = True
        least, event = least_value(dm, modes, compressing, clock, b.armed, b.start, b.out, slip_tol)
        if least > 0.0:
            arm(event_value, LegEvents(dm, modes, compressing, clock, b.out, b.out, slip_tol), b.armed, N_LEG_EVENTS)
        else:
            brisk = turning / pace if longest * pace > turning else longest
            event = first_crossing(dm, modes, compressing, clock, h, event, least, tol, slip_tol, stiff, brisk, b)
            if event == UNSOUND:
                h, fresh = 0.5 * h, False
                continue
        copy(b.out, z, N_Z)
        pass_rubs_on(b.out, z, b.n)
        from_clock(clock, z)
        # a slip that has only turned by a right angle goes on
        if least <= 0.0 and (event < 6 or length(z[ZA], z[ZB1 + event - 6]) <= 4.0 * slip_tol):
            return event
        if stiff:
            still = stays_slow(dm, modes, z, slip_tol)
            if still >= 0:
                return 6 + still
        h *= factor
    return -1


class LegCrossing(NamedTuple):
    """A step of a leg with an event in it."""

    dm: Any
    modes: Any
    compressing: Any
    clock: Any
    h: Any
    tol: Any
    slip_tol: Any
    stiff: Any
    near: Any  # way over which a probe may carry the last one on
    b: Any


@compiled(inline=True)
def value_on_cubic(at, share):
    """The least event function on the cubic through the ends of the step, at a share of it."""
    b = at.b
    on_cubic(b.start, b.rates, b.out, b.rates_out, share, at.h, N_Z, b.probe)
    g, _ = least_value(at.dm, at.modes, at.compressing, at.clock, b.armed, b.start, b.probe, at.slip_tol)
    return g


@compiled
def carry_on(dm, modes, clock, t, b):
    """Carry the end of a step on (or back) by t, by the midpoint rule."""
    for k in range(N_Z):
        b.probe[k] = b.out[k] + 0.5 * t * b.rates_out[k]
    impact_rates(dm, modes, b.gains, clock, b.probe, b.rates_probe)
    if b.n > WIDTH:
        rub_rates_at(Leg(dm, modes, b.gains, clock, b.K, b.n), b.probe, b.rates_probe)
        for k in range(WIDTH, b.n):
            b.out[k] += t * b.rates_probe[k]
    for k in range(N_Z):
        b.out[k] += t * b.rates_probe[k]


@compiled(inline=True)
def probe_step(at, t):
    """Take the step up to t, or carry the last probe on to t where that is near.

    Returns
    -------
    g, event, verdict : float, int, int
        The least event function at t and its event; PROBE_FOUND, PROBE_LOOK_ON or PROBE_REFUSED.
    """
    b, way = at.b, t - at.b.bracket[0].at
    if abs(way) <= min(at.near, CARRIED * t):
        impact_rates(at.dm, at.modes, b.gains, at.clock, b.out, b.rates_out)
        carry_on(at.dm, at.modes, at.clock, way, b)
    elif not leg_step(at.dm, at.modes, at.clock, t, at.tol, 1.0, at.stiff, b) <= 1.0:
        return 0.0, UNSOUND, PROBE_REFUSED
    g, event = least_value(at.dm, at.modes, at.compressing, at.clock, b.armed, b.start, b.out, at.slip_tol)
    return g, event, PROBE_FOUND if abs(g) <= ZERO_ERROR * at.tol else PROBE_LOOK_ON


@compiled
def first_crossing(dm, modes, compressing, clock, h, event, least, tol, slip_tol, stiff, brisk, b):
    """Number of the first event in a step h over which the least event function fell to `least`; b.out becomes its state.

    UNSOUND where a probe is refused. A probe at a time t is a step from b.start to t. Where t differs from the time of the last
    probe by a small part of `brisk`, the time in which the motion changes, the last probe is carried on to t instead.
    """
    g_low, _ = least_value(dm, modes, compressing, clock, b.armed, b.start, b.start, slip_tol)
    smooth, s = event < 6, b.bracket[0]
    near = NEAR_PROBE * nearly_raised(tol, 1.0 / 3.0) * brisk if smooth else 0.0
    at, guess, slope = LegCrossing(dm, modes, compressing, clock, h, tol, slip_tol, stiff, near, b), 0.0, 0.0
    if smooth:
        impact_rates(dm, modes, b.gains, clock, b.out, b.rates_out)
        guess, slope = zero_on_cubic(value_on_cubic, at, s, h, g_low, least)
    set_bracket(s, h, g_low, least, guess, slope)
    return locate(probe_step, at, s, h, 0.0, smooth)
