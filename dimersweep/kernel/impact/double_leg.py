"""Integrate one leg of an impact at both ends, from its start to its first event.

DOP853 integrates it. The direction of a slow slip is stiff, and steps stay within what the method bears: most slips are
slow for a moment only. A slip that stays slow, because its drive and friction balance, is soon taken for stick.
"""

from math import inf, sqrt
from typing import Annotated, Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import ROW, Row
from dimersweep.kernel.impact.double_equations import (
    BOTH_CLOCK,
    N_RUBBED,
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
    rates_in_clock,
    rub_rates,
    stick_reserve,
    to_clock,
)
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.layout import SLIP, STICK
from dimersweep.kernel.numerics.elementary import eighth_root, length, nearly_raised
from dimersweep.kernel.numerics.meter import charge, is_over
from dimersweep.kernel.numerics.root_bracket import (
    CARRIED,
    PROBE_FOUND,
    PROBE_LOOK_ON,
    PROBE_REFUSED,
    UNSOUND,
    arm,
    least_armed,
    locate,
    set_bracket,
    zero_on_cubic,
)
from dimersweep.kernel.numerics.steps import DOP_STAGES, WIDTH, copy, explicit_step, on_cubic, step_factor

# a slip that hardly sets out takes thousands of steps, the smaller the tolerance the more
MAX_LEG_STEPS = 1_000_000
N_LEG_EVENTS = 8  # four kinds, each of p1 (even) and of p2 (odd); see `event_value`
LEG_COST = 0.5  # work of a step, in hops of one end: as measured
OUT_OF_LEG_STEPS, GOES_ON = -1, -2  # in place of an event
# first step, over the tolerance to the power of 1/8 (errors go with the eighth power of a step)
FIRST_LEG_STEP = 4.0
# turns of a slip that a step may span: DOP853 is stable up to 6.4 on the negative real axis
LEG_TURNS = 5.5
# steps in a row with a slip that counts as none, after which the end sticks where friction can hold it
LASTS = 30
# distance over which a probe is carried on by one midpoint step, over the cubic root of the tolerance: the error of
# that step goes with its third power
NEAR_PROBE = 0.3
ZERO_ERROR = 1e-3  # distance of an event function from its zero, in units of the tolerance, at which it is found
# slip, in units of the slip that counts as none, at which a slip ends: it sets out with 0.5
# (`double_equations.hold_or_slip`)
SLIP_ENDS_AT = 0.25
# error over the tolerance below which the error of the last step does not show how errors change
UNFORESEEN = 1e-3
# second step of a leg that sets out uncompressed, over the first step: the error of the first does not show how large
# the next errors are
SECOND_STEP = 0.95


class Stride:
    """Numbers that one step of a leg leaves to the next step."""

    clock: int
    pace: float  # dtau/dsigma of that clock at the start of the step
    h: float  # size of the step, or of the next one
    longest: float
    turning: float  # time in which friction turns the slip that it turns fastest
    slow: int  # number of steps in a row after which a slip is so slow that friction might hold it
    near: float  # distance over which the last probe may be carried on
    faint: float  # compression whose energy is about the tolerance: added to both before they are compared
    uncompressed: bool  # True if the leg begins with both ends uncompressed
    clock_before: int  # clock, size and error (over the tolerance) of the last step that was taken, if any
    h_before: float
    error_before: float


class LegArrays:
    """Arrays that a step of a leg works on."""

    K: Annotated[list[float], DOP_STAGES, ROW]  # slopes of the stages, the first of them at the start of the step
    start: Row  # state at the start of the step; `out`, `rates_out`: state and rates at its end
    out: Row
    rates_out: Row
    scale: Row
    gains: Row
    armed: Row  # event functions that have been positive
    probe: Row
    rates_probe: Row


class Leg(NamedTuple):
    """Leg of an impact at both ends: its dimer, modes, tolerances and arrays."""

    dm: Any
    modes: Any
    compressing: Any
    tol: float
    slip_tol: float
    n: int  # entries of the state that are integrated
    stride: Any
    meter: Any
    bracket: Any
    b: Any  # arrays of its steps (`LegArrays`)


@compiled(inline=True)
def stage_slopes(leg, i, n_1, n_2, X_1, X_2, a, b_1, b_2, _):
    """Return the slopes of stage i of an explicit step; the last of its eight entries is not used."""
    z, clock = (n_1, n_2, X_1, X_2, a, b_1, b_2), leg.stride.clock
    if leg.n > WIDTH:
        rub_rates(leg.dm, leg.modes, clock, z, leg.b.K[i])
    rates = rates_in_clock(leg.dm, leg.modes, leg.b.gains, clock, z)
    return rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6], 0.0


@compiled(inline=True)
def leg_rates(leg, z, out):
    """Write the rates of a state in the clock of a leg into `out`, and the works of slip where they are wanted."""
    clock = leg.stride.clock
    impact_rates(leg.dm, leg.modes, leg.b.gains, clock, z, out)
    if leg.n > WIDTH:
        rub_rates(leg.dm, leg.modes, clock, z, out)


@compiled
def leg_step(leg, h):
    """Take one step of size h from the start of the step into `out`; return the error over the tolerance."""
    charge(leg.meter, LEG_COST)
    return explicit_step(stage_slopes, leg, h, leg.b.start, leg.b.K, leg.n, leg.b.scale, leg.b.out)


@compiled
def ruling_clock(dm, z, gains, faint):
    """Return the clock in which the motion is most regular: that of the end whose Y changes fastest.

    Compressions below `faint` count alike. An end that has gone, with nothing to press any more, has no clock: it would
    stand still. Ends that move alike have a common clock, so that they stay alike to the last digit. With axial slip,
    which parts them, they have the plain clock.
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
    # dY_i / dtau goes with u_i over the root of X_i: squared, and without a division
    return 0 if u_1 * u_1 * (z[ZX2] + faint) > u_2 * u_2 * (z[ZX1] + faint) else 1


@compiled
def clock_rate(clock, z):
    """Return dtau/dsigma of a clock in a state z of the plain clock."""
    return 1.0 if clock == PLAIN_CLOCK else sqrt(max(0.0, z[ZX2] if clock == 1 else z[ZX1]))


@compiled
def turning_time(dm, modes, z):
    """Return the time in tau in which friction turns the slip that it turns fastest; inf if no slip turns."""
    least = inf
    if modes[0] == STICK or modes[1] == STICK:
        return least
    for i in range(2):
        pace = end(dm, i).mu_hit * lateral_of(dm, i) * force(dm, i, z[ZX1 + i])
        if pace > 0.0:
            least = min(least, length(z[ZA], z[ZB1 + i]) / pace)
    return least


class LegEvents(NamedTuple):
    """State of a leg in which the event functions are evaluated."""

    dm: Any
    modes: Any
    compressing: Any
    clock: int
    base: Any  # the state at the start of the step
    z: Any
    tol: float


@compiled(inline=True)
def event_value(at, k):
    """Return event function k of a leg, positive while the leg goes on; inf where it has no meaning.

    Of p1 and p2, 0 and 1 are the gap rates against compression or restitution; 2 and 3 are the compressions left in
    restitution; 4 and 5 are the reserves of the friction that holds; 6 and 7 are the slips along their directions at
    `base`, the start of the step (so that a passage through zero changes the sign).
    """
    dm, z, base, i = at.dm, at.z, at.base, k % 2
    if k < 2:
        return -z[ZN1 + i] if at.compressing[i] > 0.0 else z[ZN1 + i]
    if k < 4:
        return inf if at.compressing[i] > 0.0 else z[ZX1 + i]
    if k < 6:
        # all forces vanish where an impact ends: only their ratios decide
        f_1, f_2 = forces(dm, z, at.clock)
        # without any force there is nothing to hold: 1.0 is a reserve
        return stick_reserve(dm, at.modes, i, z, f_1, f_2) / (f_1 + f_2) if f_1 + f_2 > 0.0 else 1.0
    if at.modes[i] == STICK or end(dm, i).mu_hit == 0.0:
        return inf
    v = length(base[ZA], base[ZB1 + i])
    return (z[ZA] * base[ZA] + z[ZB1 + i] * base[ZB1 + i]) / v - SLIP_ENDS_AT * at.tol if v > 0.0 else inf


@compiled
def least_event(at, armed):
    """Return the least armed event function and its number (inf and -1 if none is armed)."""
    return least_armed(event_value, at, armed, N_LEG_EVENTS)


@compiled(inline=True)
def least_value(leg, z):
    """Return the least armed event function and its number in the state z in a step; see `least_event`."""
    at = LegEvents(leg.dm, leg.modes, leg.compressing, leg.stride.clock, leg.b.start, z, leg.slip_tol)
    return least_event(at, leg.b.armed)


@compiled(inline=True)
def arm_events(leg, z):
    """Arm the event functions that are positive in the state z."""
    at = LegEvents(leg.dm, leg.modes, leg.compressing, leg.stride.clock, z, z, leg.slip_tol)
    arm(event_value, at, leg.b.armed, N_LEG_EVENTS)


@compiled(inline=True)
def heed_slips(leg, z):
    """Shorten the step so that a slip that friction decreases keeps about a tenth of itself at the end."""
    rates = leg.b.K[0]
    for i in range(2):
        v = length(z[ZA], z[ZB1 + i])
        if leg.modes[i] == SLIP and v > 0.0 and end(leg.dm, i).mu_hit > 0.0:
            rate = (z[ZA] * rates[ZA] + z[ZB1 + i] * rates[ZB1 + i]) / v
            if rate < 0.0:
                # 0.9 of the way to rest at the present rate: at rest the direction of the slip is lost
                leg.stride.h = min(leg.stride.h, -0.9 * v / rate)


@compiled
def might_stick(dm, modes, z, slip_tol):
    """Return the number of an end whose slip counts as none and that friction can hold, -1 if there is none.

    Where drive and friction balance, a slip goes on at a speed below all that counts.
    """
    for i in range(2):
        if modes[i] == SLIP and length(z[ZA], z[ZB1 + i]) <= slip_tol and end(dm, i).mu_hit > 0.0:
            modes[i] = STICK
            room = stick_reserve(dm, modes, i, z, force(dm, 0, z[ZX1]), force(dm, 1, z[ZX2]))
            modes[i] = SLIP
            if room > 0.0:
                return i
    return -1


@compiled
def foreseen(h, error, h_before, error_before):
    """Return the factor for the next step, if errors go on to change as from the step before to this one.

    This is Gustafsson's controller.
    """
    root = sqrt(sqrt(sqrt(max(error_before, UNFORESEEN) / max(error * error, 1e-30))))
    # an eighth root: the errors go with the eighth power of the step. 0.9 leaves room; 1e-30 keeps the quotient finite
    return max(0.3, 0.9 * h / h_before * root)


@compiled(inline=True)
def begin_leg(leg, z, e):
    """Set the gains of the compressions, arm the event functions that are positive, and choose the first step."""
    s = leg.stride
    for i in range(2):
        leg.b.gains[i] = 1.0 if leg.compressing[i] > 0.0 else 1.0 / (e[i] * e[i])
    for k in range(N_LEG_EVENTS):
        leg.b.armed[k] = 0.0
    s.clock = PLAIN_CLOCK
    arm_events(leg, z)
    for k in range(N_Z, leg.n):  # the unused entry and the works
        z[k], leg.b.K[0, k], leg.b.rates_probe[k] = 0.0, 0.0, 0.0
    for k in range(WIDTH):
        leg.b.scale[k] = leg.tol
    # 0.4 is 1 / (5/2): for Hertz's law the energy of that compression is about the tolerance
    s.faint = nearly_raised(leg.tol, 0.4)
    # the compression swings with the root of the gain as its rate: a restitution is faster than a compression by 1 / e
    s.clock, s.longest = ruling_clock(leg.dm, z, leg.b.gains, s.faint), 1.0 / sqrt(max(leg.b.gains[0], leg.b.gains[1]))
    s.h = FIRST_LEG_STEP * eighth_root(leg.tol) * s.longest
    s.uncompressed, s.h_before, s.slow = z[ZX1] <= 0.0 and z[ZX2] <= 0.0, 0.0, 0


@compiled(inline=True)
def begin_step(leg, z):
    """Set the state and the rates at the start of a step, in the clock that suits, and bound the size of the step."""
    dm, modes, s = leg.dm, leg.modes, leg.stride
    s.turning = turning_time(dm, modes, z)
    last, s.clock = s.clock, ruling_clock(dm, z, leg.b.gains, s.faint)
    s.pace = clock_rate(s.clock, z)
    if s.clock != last:
        s.h = min(s.h * clock_rate(last, z) / s.pace, s.longest)
    copy(z, leg.b.start, leg.n)
    to_clock(s.clock, leg.b.start)
    leg_rates(leg, leg.b.start, leg.b.K[0])
    if s.h * s.pace > LEG_TURNS * s.turning:
        s.h = LEG_TURNS * s.turning / s.pace
    heed_slips(leg, z)


@compiled(inline=True)
def step_on(leg, z):
    """Take one step, or shorten it; return the event that ends the leg, or GOES_ON."""
    s = leg.stride
    begin_step(leg, z)
    error = leg_step(leg, s.h)
    factor = step_factor(error)
    if not error <= 1.0:
        s.h *= factor
        return GOES_ON
    # sizes and errors of steps in different clocks cannot be compared
    if s.h_before > 0.0 and s.clock == s.clock_before:
        factor = min(factor, foreseen(s.h, error, s.h_before, s.error_before))
    elif s.uncompressed:
        factor = min(factor, SECOND_STEP)
    s.h_before, s.error_before, s.clock_before = s.h, error, s.clock
    least, event = least_value(leg, leg.b.out)
    if least > 0.0:
        arm_events(leg, leg.b.out)
    else:
        event = first_crossing(leg, event, least)
        if event == UNSOUND:
            s.h *= 0.5
            return GOES_ON
    copy(leg.b.out, z, leg.n)
    from_clock(s.clock, z)
    # events 6 and 7 are ends of slip: one that still is some times the slip that counts as none has only turned, and
    # goes on
    if least <= 0.0 and (event < 6 or length(z[ZA], z[ZB1 + event - 6]) <= 4.0 * leg.slip_tol):
        return event
    still = might_stick(leg.dm, leg.modes, z, leg.slip_tol)
    s.slow = s.slow + 1 if still >= 0 else 0
    if s.slow > LASTS:
        return 6 + still
    s.h *= factor
    return GOES_ON


@compiled
def double_leg(d, tol, work):
    """Integrate an impact from its state z, in place, to the first event of the leg; return the number of the event.

    Return OUT_OF_LEG_STEPS at the bound on steps, and also where the meter is over.
    """
    n, stride = N_RUBBED if work.course[0].tally.wanted else WIDTH, work.course[0].stride
    leg = Leg(d.dm, d.modes, d.compressing, tol, d.slip_tol, n, stride, work.meter, work.bracket, work.impact[0].leg)
    begin_leg(leg, d.z, d.e)
    for _ in range(MAX_LEG_STEPS):
        if is_over(leg.meter):
            break
        event = step_on(leg, d.z)
        if event != GOES_ON:
            return event
    return OUT_OF_LEG_STEPS


# --- the place of an event in a step ------------------------------------------------------------------------------------


@compiled(inline=True)
def value_on_cubic(leg, share):
    """Return the least event function on the cubic through the ends of the step, at a share of it."""
    on_cubic(leg.b.start, leg.b.K[0], leg.b.out, leg.b.rates_out, share, leg.stride.h, N_Z, leg.b.probe)
    return least_value(leg, leg.b.probe)[0]


@compiled(inline=True)
def probe_step(leg, t):
    """Compute the state at t within a step, in the clock of the leg, and judge the event functions there.

    `out` becomes the state at t. A step from the start up to t leads there. Where t is near the last probe, one step of
    the midpoint rule leads there from that probe instead, forward or back.

    Returns
    -------
    g, event, verdict : float, int, int
        The least event function at t, and its number. PROBE_FOUND if it is zero to the tolerance, else PROBE_LOOK_ON;
        PROBE_REFUSED if the error of the step exceeds the tolerance.
    """
    out, distance = leg.b.out, t - leg.bracket[0].at
    if abs(distance) <= min(leg.stride.near, CARRIED * t):
        leg_rates(leg, out, leg.b.rates_out)
        for k in range(N_Z):
            leg.b.probe[k] = out[k] + 0.5 * distance * leg.b.rates_out[k]
        leg_rates(leg, leg.b.probe, leg.b.rates_probe)
        for k in range(leg.n):
            out[k] += distance * leg.b.rates_probe[k]
    elif not leg_step(leg, t) <= 1.0:
        return 0.0, UNSOUND, PROBE_REFUSED
    g, event = least_value(leg, out)
    return g, event, PROBE_FOUND if abs(g) <= ZERO_ERROR * leg.tol else PROBE_LOOK_ON


@compiled(inline=True)
def first_crossing(leg, event, least):
    """Locate the first event in a step over which the least event function fell to `least`; `out` becomes its state.

    Return its number, or UNSOUND where a probe is refused. A probe at a time t is a step up to t. The last probe is
    carried on to t instead, where t differs from its time by a small part of the time in which the motion changes.
    """
    s, bracket, smooth = leg.stride, leg.bracket[0], event < 6
    g_low, _ = least_value(leg, leg.b.start)
    s.near, guess, slope = 0.0, 0.0, 0.0
    # the ends of slips (6 and 7) are not smooth: a slow slip turns faster than the cubic through a step can show
    if smooth:
        brisk = s.turning / s.pace if s.longest * s.pace > s.turning else s.longest
        s.near = NEAR_PROBE * nearly_raised(leg.tol, 1.0 / 3.0) * brisk
        leg_rates(leg, leg.b.out, leg.b.rates_out)
        guess, slope = zero_on_cubic(value_on_cubic, leg, bracket, s.h, g_low, least)
    set_bracket(bracket, s.h, g_low, least, guess, slope)
    return locate(probe_step, leg, bracket, s.h, 0.0, smooth)
