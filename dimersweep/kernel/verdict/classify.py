"""The classification of a motion: what a run keeps of its past, when it has settled, its mode, and its orbit.

Kept are the last strobes (normal state at the period boundaries), double events (landings of one ball while the other one
is down, with the state after the last impact of each burst) and long landings. Lines drawn here, in forcing periods: a
ball is down while it is closed or in hops shorter than HOP_LINE; impacts of one double event lie within BURST.
"""

from math import acos, hypot, nan, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.impact import contact_velocity
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DI_SK_SK,
    DI_SK_SP,
    DI_SP_SK,
    DI_SP_SP,
    FREE,
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    M_REST,
    M_UNRESOLVED,
    N1,
    N2,
    N_ORBIT,
    N_OUT,
    OUT_BETA_RATE_AFTER,
    OUT_DOWN_SHARE_1,
    OUT_DOWN_SHARE_2,
    OUT_IMPACT_PHASE,
    OUT_PRECESSION_RATE,
    OUT_RADIUS,
    OUT_SETTLED_AFTER,
    OUT_SPEED,
    OUT_SPIN_RATE,
    OUT_ZETA,
    PERIOD,
    PHASE,
    SPIN,
    STICK,
    THETA,
    WB,
)
from dimersweep.kernel.model.plate import lightest
from dimersweep.kernel.numerics.steps import clear
from dimersweep.kernel.verdict.rest import slides_to_rest

HOP_LINE = 0.5
NOTED = 0.4  # hops from which on landings are kept: one just below the line may go with one just above it
BURST = 0.05
SLIP_LINE = 1e-7  # slip, in g/omega, from which an end slips at the end of a double impact
DOWN_LINE = 0.9  # share of the time one ball is down in the drift mode
TOGETHER = 0.15  # landings of a jump lie closer than this
SETTLED = 1e-4  # change of a strobe, in g/omega^2 and g/omega, that counts as none
KEPT = 1e-3  # the same of a motion that has settled before: one that creeps is not lost at the line
# share of a shorter period's change that is left after PATIENCE periods, below which it is on its way to none
FADING = 0.99
PATIENCE = 24  # periods a motion repeats before it counts as settled
MAX_PERIOD = 16
FIT = 20  # double events in the fit of an orbit's drift

RING = 64
# rows of the past: scalars, strobes, double events, long landings
SCALARS, STROBES, DOUBLES, LANDINGS = 0, 2, 2 + RING, 2 + 2 * RING
PAST_ROWS, PAST_COLUMNS = 2 + 3 * RING, 24
# scalars
S_OFF_1, S_OFF_2, S_DOWN_1, S_DOWN_2, S_DOUBLES, S_LANDINGS, S_STROBES, S_CLOSED = range(8)
S_FASTEST = 8  # greatest speed in the plate's frame so far [m/s], by which an impact is slow
RUNS = 1  # this row holds, in column p, for how many periods the motion has repeated with period p
# columns of a strobe
P_D1, P_D2, P_N1, P_N2, P_DOWN_1, P_DOWN_2, P_DOUBLES, P_TIME, P_OFF_1, P_OFF_2 = range(10)
N_NORMAL = P_N2 + 1  # those up to here are the normal state, which a motion repeats
# columns of a double event
E_TIME, E_PHASE, E_SPEED, E_ZETA, E_THETA, E_SPIN, E_WB, E_END, E_BOUNCER = range(9)
# columns of a landing
G_TIME, G_END, G_LONG = range(3)


@compiled
def time_of(dm, state):
    """Time since the start [s]."""
    return state[PERIOD] * dm.T + state[PHASE] / dm.omega


@compiled
def begin_past(past):
    """An empty past; both balls down."""
    clear(past, STROBES, PAST_COLUMNS)  # the other rows are read no further than they are counted here
    past[SCALARS, S_OFF_1] = past[SCALARS, S_OFF_2] = -1.0


@compiled
def note_take_offs(dm, past, state, modes):
    """Note the ends that are off the plate from now on."""
    for i in range(2):
        if modes[i] == FREE:
            past[SCALARS, S_CLOSED] = -1.0
            if past[SCALARS, S_OFF_1 + i] < 0.0:
                past[SCALARS, S_OFF_1 + i] = time_of(dm, state)


@compiled
def note_landing(dm, past, i, now):
    """End i is back on the plate; returns whether its flight was a long one."""
    off = past[SCALARS, S_OFF_1 + i]
    if off < 0.0:
        return False
    past[SCALARS, S_OFF_1 + i] = -1.0
    hop = now - off
    if hop < HOP_LINE * dm.T:  # it counts as down after all, and crosses the last period boundary at most
        strobe = STROBES + (int(past[SCALARS, S_STROBES]) + RING - 1) % RING
        if past[strobe, P_OFF_1 + i] == off:
            past[strobe, P_OFF_1 + i] = -1.0
    if hop < NOTED * dm.T:
        return False
    is_long = hop >= HOP_LINE * dm.T
    row = LANDINGS + int(past[SCALARS, S_LANDINGS]) % RING
    past[row, G_TIME], past[row, G_END], past[row, G_LONG] = now, i, 1.0 if is_long else 0.0
    past[SCALARS, S_LANDINGS] += 1.0
    if is_long:
        past[SCALARS, S_DOWN_1 + i] -= hop
    return is_long


@compiled
def note_landings(dm, past, state):
    """Note the ends that are back on the plate before their impact.

    Returns
    -------
    end, begins : int, bool
        The end that has landed, the one from a long flight if there is one; and whether a double event begins with it: it
        comes from a long flight, and the other ball is down.
    """
    now = time_of(dm, state)
    long_flight, end = False, 0
    for i in range(2):
        if state[D1 + i] == 0.0:
            if note_landing(dm, past, i, now):
                long_flight, end = True, i
            elif state[N1 + i] < 0.0 and not long_flight:
                end = i
    other_off = past[SCALARS, S_OFF_1 + 1 - end]
    return end, long_flight and (other_off < 0.0 or now - other_off < HOP_LINE * dm.T)


@compiled
def holds(dm, state, i):
    """Whether end i ends a double impact sticking: slip below the line drawn here is creep of no consequence."""
    _, a, b = contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
    return hypot(a, b) <= SLIP_LINE * dm.g / dm.omega


@compiled
def note_impact(dm, state, past, double, i, begins):
    """Keep the state after an impact that is, begins or continues a double event.

    Parameters
    ----------
    double : bool
        The impact began with both ends closed.
    i, begins : int, bool
        See `note_landings`.
    """
    now = time_of(dm, state)
    count = int(past[SCALARS, S_DOUBLES])
    row = DOUBLES + (count - 1) % RING if count > 0 else DOUBLES
    burst = count > 0 and now - past[row, E_TIME] < BURST * dm.T
    if burst:
        if not double and past[row, E_BOUNCER] != i:
            return
        i = int(past[row, E_BOUNCER])
    elif double or begins:
        row = DOUBLES + count % RING
        past[SCALARS, S_DOUBLES] += 1.0
        past[row, E_BOUNCER] = i
    else:
        return
    v = hypot(state[CA], state[CB])
    forward = state[CA] if i == 1 else -state[CA]
    past[row, E_TIME] = now
    past[row, E_PHASE] = (state[PHASE] + dm.phi0) / (2.0 * pi) % 1.0
    past[row, E_SPEED] = v
    past[row, E_ZETA] = acos(max(-1.0, min(1.0, forward / v))) if v > 0.0 else nan
    past[row, E_THETA] = state[THETA]
    past[row, E_SPIN] = state[SPIN]
    past[row, E_WB] = state[WB]
    held, bounced = holds(dm, state, 1 - i), holds(dm, state, i)
    past[row, E_END] = (DI_SK_SK if bounced else DI_SK_SP) if held else (DI_SP_SK if bounced else DI_SP_SP)


@compiled
def note_period(dm, state, modes, past):
    """Strobe at a period boundary, and count for how long the motion has repeated with each period."""
    count = int(past[SCALARS, S_STROBES])
    row = past[STROBES + count % RING]
    speed = dm.g / dm.omega
    length = speed / dm.omega
    row[P_D1], row[P_D2] = state[D1] / length, state[D2] / length
    row[P_N1], row[P_N2] = state[N1] / speed, state[N2] / speed
    row[P_DOWN_1], row[P_DOWN_2] = past[SCALARS, S_DOWN_1], past[SCALARS, S_DOWN_2]
    row[P_DOUBLES] = past[SCALARS, S_DOUBLES]
    row[P_TIME] = time_of(dm, state)
    row[P_OFF_1], row[P_OFF_2] = past[SCALARS, S_OFF_1], past[SCALARS, S_OFF_2]
    past[SCALARS, S_STROBES] += 1.0
    past[SCALARS, S_CLOSED] = past[SCALARS, S_CLOSED] + 1.0 if modes[0] != FREE and modes[1] != FREE else 0.0
    for p in range(1, MAX_PERIOD + 1):
        same = count >= p
        line = KEPT if past[RUNS, p] >= PATIENCE + p else SETTLED
        if same:
            old = past[STROBES + (count - p) % RING]
            for k in range(N_NORMAL):
                if not abs(row[k] - old[k]) <= line:
                    same = False
        past[RUNS, p] = past[RUNS, p] + 1.0 if same else 0.0


@compiled
def last_strobe(past, strobe):
    """Copy the normal state of the last strobe into `strobe`; returns the largest change of an entry of it."""
    row = past[STROBES + (int(past[SCALARS, S_STROBES]) - 1) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - strobe[k]))
        strobe[k] = row[k]
    return apart


@compiled
def change(past, p, back):
    """Change of the strobe over p periods, `back` periods before the last one."""
    last = int(past[SCALARS, S_STROBES]) - 1 - back
    row, old = past[STROBES + last % RING], past[STROBES + (last - p) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - old[k]))
    return apart


@compiled
def largest_change(past, q, p, back):
    """Largest change over q periods in a stretch of p strobes, which ends `back` periods before the last one."""
    apart = 0.0
    for k in range(p):
        apart = max(apart, change(past, q, back + k))
    return apart


@compiled
def fades(past, p):
    """Whether a motion that repeats with period p rings down to a shorter one, a divisor of p."""
    shorter = False
    for q in range(1, p):
        shorter = shorter or (
            p % q == 0 and largest_change(past, q, p, 0) < FADING * largest_change(past, q, p, PATIENCE)
        )
    return shorter


@compiled
def settled_period(past):
    """Least number of forcing periods with which the motion has repeated long enough, 0 if with none."""
    for p in range(1, MAX_PERIOD + 1):
        if past[RUNS, p] >= PATIENCE + p and not fades(past, p):
            return p
    return 0


@compiled
def rests_for_good(dm, state, modes):
    """Whether both ends are closed and stay so whatever comes."""
    if modes[0] == FREE or modes[1] == FREE or lightest(dm) < 0.0:
        return False
    return (modes[0] == STICK and modes[1] == STICK) or slides_to_rest(dm, state)


@compiled
def down_until(strobe, i):
    """Time that end i has been down by a strobe [s], up to a constant; a flight that goes on then counts as a long one."""
    off = strobe[P_OFF_1 + i]
    return strobe[P_TIME] + strobe[P_DOWN_1 + i] - (strobe[P_TIME] - off if off >= 0.0 else 0.0)


@compiled
def share(past, p, i):
    """Share of the last p periods that end i is down, in [0, 1]: of a flight, the part within them is not."""
    count = int(past[SCALARS, S_STROBES])
    last = past[STROBES + (count - 1) % RING]
    first = past[STROBES + (count - 1 - p) % RING]
    down = (down_until(last, i) - down_until(first, i)) / (last[P_TIME] - first[P_TIME])
    return max(0.0, min(1.0, down))  # but for rounding it is


@compiled
def mode_of(dm, past, at_rest):
    """Mode of the motion and its period in forcing periods (0 where it has none)."""
    count = int(past[SCALARS, S_STROBES])
    if at_rest or past[SCALARS, S_CLOSED] >= 3.0:
        return M_REST, 0
    p = settled_period(past)
    if p == 0:
        return M_UNRESOLVED, 0
    span = p * max(1, 12 // p)
    down_1, down_2 = share(past, span, 0), share(past, span, 1)
    doubles = past[STROBES + (count - 1) % RING, P_DOUBLES] - past[STROBES + (count - 1 - span) % RING, P_DOUBLES]
    if p == 1 and doubles == span and max(down_1, down_2) >= DOWN_LINE and min(down_1, down_2) <= 0.5:
        return M_DRIFT, 1
    together, turns, total = landing_pattern(dm, past, span)
    if (total > 0 and together == total) or (total == 0 and doubles >= span / p):
        return M_JUMP, p
    if p > 1 and total >= 2 and turns == total - 1:
        return M_FLUTTER, p
    return M_PERIOD_N, p


@compiled
def landing_pattern(dm, past, span):
    """Of the long landings of the last `span` periods: those with one of the other end beside them, changes of end, all."""
    count = int(past[SCALARS, S_LANDINGS])
    begin = (past[SCALARS, S_STROBES] - span) * dm.T
    together, turns, total, later_end = 0, 0, 0, -1.0
    for back in range(min(count, RING)):
        row = past[LANDINGS + (count - 1 - back) % RING]
        if row[G_TIME] < begin:
            break
        if row[G_LONG] == 0.0:
            continue
        total += 1
        turns += 1 if later_end >= 0.0 and row[G_END] != later_end else 0
        later_end = row[G_END]
        before, after = back + 1 < min(count, RING), back > 0
        if (before and beside(dm, past, row, count - 2 - back)) or (after and beside(dm, past, row, count - back)):
            together += 1
    return together, turns, total


@compiled
def beside(dm, past, landing, k):
    """Whether the k-th landing is one of the other end at nearly the same time."""
    row = past[LANDINGS + k % RING]
    return row[G_END] != landing[G_END] and abs(row[G_TIME] - landing[G_TIME]) < TOGETHER * dm.T


@compiled
def orbit_value(past, k, back):
    """Value k of the orbit (OUT_RADIUS to OUT_IMPACT_PHASE) at the double event `back` before the last."""
    count = int(past[SCALARS, S_DOUBLES])
    row = past[DOUBLES + (count - 1 - back) % RING]
    old = past[DOUBLES + (count - 2 - back) % RING]
    if k == OUT_ZETA:
        return row[E_ZETA]
    if k == OUT_SPEED:
        return row[E_SPEED]
    if k == OUT_IMPACT_PHASE:
        return row[E_PHASE]
    rate = (row[E_THETA] - old[E_THETA]) / (row[E_TIME] - old[E_TIME])
    if k == OUT_PRECESSION_RATE:
        return rate
    if rate == 0.0:
        return nan  # a straight path: there is no circle
    return row[E_SPEED] / abs(rate) if k == OUT_RADIUS else 2.0 * pi / abs(rate)


@compiled
def orbit_of(dm, past, out):
    """Orbit of a drift from its double events into the outcome row: last values, and their slopes over the last FIT.

    Returns
    -------
    int
        How the last double impact ended.
    """
    count = int(past[SCALARS, S_DOUBLES])
    if count < 2:
        return 0
    n = min(FIT, count - 1, RING - 1)
    for k in range(N_ORBIT):
        out[k] = orbit_value(past, k, 0)
        mean_x, mean_y = 0.5 * (n - 1), 0.0
        for back in range(n):
            mean_y += orbit_value(past, k, back) / n
        xy, xx = 0.0, 0.0
        for back in range(n):
            x = (n - 1 - back) - mean_x
            xy += x * (orbit_value(past, k, back) - mean_y)
            xx += x * x
        out[N_ORBIT + k] = xy / xx if n > 1 else nan
    last = past[DOUBLES + (count - 1) % RING]
    out[OUT_SPIN_RATE], out[OUT_BETA_RATE_AFTER] = last[E_SPIN], last[E_WB]
    return int(last[E_END])


@compiled
def verdict(dm, past, at_rest, out):
    """Mode, its period and the end of the double impact; fills the outcome row (nan where a number has no meaning)."""
    for k in range(N_OUT):
        out[k] = nan
    mode, p = mode_of(dm, past, at_rest)
    end = 0
    if mode == M_DRIFT:
        end = orbit_of(dm, past, out)
    if past[SCALARS, S_STROBES] > 1.0:
        span = int(min(past[SCALARS, S_STROBES] - 1.0, 12.0))
        out[OUT_DOWN_SHARE_1], out[OUT_DOWN_SHARE_2] = share(past, span, 0), share(past, span, 1)
    if p > 0:
        out[OUT_SETTLED_AFTER] = past[SCALARS, S_STROBES] - past[RUNS, p]
    return mode, p, end
