"""The verdict on a run: its mode of motion, the numbers that go with it, and the orbit of a drift.

A mode is known long before the numbers stand: the spin creeps on, and a path that bends less and less takes hundreds of
periods to its radius. A run stops where its numbers would come no further than STILL in the periods that are left, at
their pace over the last ones: so they are those at the end of the periods asked for, to 1e-3.
"""

from math import copysign, nan, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import (
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    M_REST,
    M_ROLLS,
    M_SLIDES,
    M_UNRESOLVED,
    N_ORBIT,
    N_OUT,
    OUT_BETA_RATE_AFTER,
    OUT_CENTRE_VELOCITY_X,
    OUT_CENTRE_VELOCITY_Y,
    OUT_CHANGE_AHEAD,
    OUT_DOWN_SHARE_1,
    OUT_IMPACT_PHASE,
    OUT_LONGEST_HOP_1,
    OUT_PRECESSION_RATE,
    OUT_RADIUS,
    OUT_SETTLED_AFTER,
    OUT_SPEED,
    OUT_SPIN,
    OUT_SPIN_DRIFT,
    OUT_ZETA,
    THETA,
    TR_NONE,
    WP,
)
from dimersweep.kernel.model.plate import keeps_speed
from dimersweep.kernel.verdict.past import (
    DE_END,
    DE_PHASE,
    DE_SPEED,
    DE_SPIN,
    DE_THETA,
    DE_TIME,
    DE_WB,
    DE_ZETA,
    DOUBLES,
    G_END,
    G_LONG,
    G_TIME,
    LANDINGS,
    P_DOUBLES,
    P_DOWN_1,
    P_HOP_1,
    P_OFF_1,
    P_SPIN,
    P_THETA,
    P_TIME,
    RING,
    RUNS,
    S_CLOSED,
    S_DOUBLES,
    S_HELD,
    S_LANDINGS,
    S_STROBES,
    SCALARS,
    STROBES,
    TRACK_ROW,
)
from dimersweep.kernel.verdict.settling import SETTLED_PERIODS, ringing_period, settled_period, spin_drift
from dimersweep.kernel.verdict.track import track_of

DOWN_LINE = 0.9  # share of the time one ball is down in the drift mode
TOGETHER = 0.15  # landings of a jump lie closer than this
FIT = 20  # double events in the fit of an orbit's drift
SPAN = 12  # last periods, over which the shares of contact and the longest hops are taken
STAYS = 3.0  # periods for which both ends have been down where they stay down
STILL = 8e-4  # change of its numbers, relative, in radians, cycles or periods, that a stopped run leaves out at most
SLOW_SPEED, STRAIGHT = 1e-2, 1e-9  # speed in g/omega, precession in omega: changes of lesser ones are relative to these


@compiled
def down_until(strobe, i, off):
    """Time that end i has been down by a strobe [s], up to a constant; a flight that goes on since `off` (or not: < 0) is
    a long one.
    """
    return strobe[P_TIME] + strobe[P_DOWN_1 + i] - (strobe[P_TIME] - off if off >= 0.0 else 0.0)


@compiled
def share(past, span, p, i):
    """Share of the last periods that end i is down, in [0, 1]: of a flight, the part within them is not.

    One that goes on at their end is as long as that which went on a period p of the motion before; a long one if p is 0.
    """
    last = int(past[SCALARS, S_STROBES]) - 1
    row, old = past[STROBES + last % RING], past[STROBES + (last - span) % RING]
    off, goes_on = row[P_OFF_1 + i], past[STROBES + (last - p) % RING, P_OFF_1 + i] >= 0.0
    down = down_until(row, i, off if goes_on else -1.0) - down_until(old, i, old[P_OFF_1 + i])
    return max(0.0, min(1.0, down / (row[P_TIME] - old[P_TIME])))  # but for rounding it is


@compiled
def whole(p):
    """The last periods whose shares and hops are told: SPAN, or as many as are whole periods p of the motion, at least one."""
    return p * max(1, SPAN // p) if p > 0 else SPAN


@compiled
def longest_hop(dm, past, span, i):
    """Longest time that end i was off the plate, of the hops that ended or went on in the last `span` periods [periods]."""
    count = int(past[SCALARS, S_STROBES])
    last = past[STROBES + (count - 1) % RING]
    on_its_way = last[P_TIME] - last[P_OFF_1 + i] if last[P_OFF_1 + i] >= 0.0 else 0.0
    return max(on_its_way / dm.period, longest_landed(dm, past, span, 0, i))


@compiled
def longest_landed(dm, past, span, back, i):
    """Longest hop of end i that ended in the `span` periods up to `back` periods before the last strobe [periods]."""
    last, longest = int(past[SCALARS, S_STROBES]) - 1 - back, 0.0
    for k in range(span):
        longest = max(longest, past[STROBES + (last - k) % RING, P_HOP_1 + i])
    return longest / dm.period


@compiled
def stays_down(past):
    """Whether both ends have been on the plate for some periods."""
    return past[SCALARS, S_CLOSED] >= STAYS


@compiled
def mode_on_the_plate(dm, state, past, at_rest):
    """Mode of a motion whose ends both stay down."""
    if at_rest:
        return M_REST
    if past[SCALARS, S_HELD] < STAYS:
        return M_SLIDES
    return M_REST if keeps_speed(dm, state[THETA], state[WP]) else M_ROLLS


@compiled
def mode_of(dm, past):
    """Mode of a motion whose ends do not both stay down, and its period in forcing periods (0 where it has none)."""
    count = int(past[SCALARS, S_STROBES])
    p = settled_period(past)
    if p == 0:
        p = ringing_period(past)
    if p == 0:
        return M_UNRESOLVED, 0
    span = whole(p)
    down_1, down_2 = share(past, span, p, 0), share(past, span, p, 1)
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
    begin = (past[SCALARS, S_STROBES] - span) * dm.period
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
    return row[G_END] != landing[G_END] and abs(row[G_TIME] - landing[G_TIME]) < TOGETHER * dm.period


@compiled
def orbit_value(past, k, back):
    """Value k of the orbit (OUT_RADIUS to OUT_IMPACT_PHASE, or OUT_SPIN) at the double event `back` before the last."""
    count = int(past[SCALARS, S_DOUBLES])
    row = past[DOUBLES + (count - 1 - back) % RING]
    old = past[DOUBLES + (count - 2 - back) % RING]
    if k == OUT_ZETA:
        return row[DE_ZETA]
    if k == OUT_SPEED:
        return row[DE_SPEED]
    if k == OUT_IMPACT_PHASE:
        return row[DE_PHASE]
    if k == OUT_SPIN:
        return row[DE_SPIN]
    rate = (row[DE_THETA] - old[DE_THETA]) / (row[DE_TIME] - old[DE_TIME])
    if k == OUT_PRECESSION_RATE:
        return rate
    if rate == 0.0:
        return nan  # a straight path: there is no circle
    return row[DE_SPEED] / abs(rate) if k == OUT_RADIUS else 2.0 * pi / abs(rate)


@compiled
def orbit_slope(past, k, n):
    """Slope of value k of the orbit over the last n double events, by least squares."""
    mean_x, mean_y = 0.5 * (n - 1), 0.0
    for back in range(n):
        mean_y += orbit_value(past, k, back) / n
    xy, xx = 0.0, 0.0
    for back in range(n):
        x = (n - 1 - back) - mean_x
        xy += x * (orbit_value(past, k, back) - mean_y)
        xx += x * x
    return xy / xx if n > 1 else nan


@compiled
def fitted(past):
    """Number of double events in the fit of an orbit's drift."""
    return min(FIT, int(past[SCALARS, S_DOUBLES]) - 1, RING - 1)


@compiled
def orbit_of(past, out):
    """Orbit of a drift from its double events into the outcome row: last values, and their slopes over the last FIT.

    Returns
    -------
    int
        How the last double impact ended.
    """
    count = int(past[SCALARS, S_DOUBLES])
    if count < 2:
        return 0
    n = fitted(past)
    for k in range(N_ORBIT):
        out[k] = orbit_value(past, k, 0)
        out[N_ORBIT + k] = orbit_slope(past, k, n)
    last = past[DOUBLES + (count - 1) % RING]
    out[OUT_SPIN], out[OUT_BETA_RATE_AFTER] = last[DE_SPIN], last[DE_WB]
    out[OUT_SPIN_DRIFT] = orbit_slope(past, OUT_SPIN, n)
    return int(last[DE_END])


@compiled
def stays_as_it_is(dm, past, left):
    """Whether the motion has settled, and its numbers stand as they are for the periods that are left of a run.

    Where they go with the heading, their pace of now says nothing of the turn to come. Where both ends stay down, and do not
    rest, the speed changes.
    """
    if dm.sideways != 0.0 or stays_down(past):
        return False
    return settled_period(past) > 0 and change_ahead(dm, past, left) <= STILL


@compiled
def change_ahead(dm, past, left):
    """Largest change of a settled motion's numbers in the periods that are left, at their pace over the last ones.

    Relative of the radius, period, speed and precession rate of a drift; absolute of its angle [rad] and phase [cycles]; of
    any motion relative of its spin, absolute of its longest hops [periods] and of the angle that its heading turns by [rad],
    or relative to that where it is more than one.
    """
    mode, p = mode_of(dm, past)
    if p == 0 or left == 0:
        return 0.0
    pace = max(hop_pace(dm, past, p, 0), hop_pace(dm, past, p, 1))
    pace = max(pace, spin_pace(past, p))
    turn, bend = heading_pace(past, p)
    pace = max(pace, 0.5 * left * abs(bend) / max(1.0, left * abs(turn)))
    if mode == M_DRIFT:
        n, unit = fitted(past), dm.g / dm.omega
        turning = relative_pace(past, OUT_PRECESSION_RATE, n, STRAIGHT * dm.omega)
        moving = relative_pace(past, OUT_SPEED, n, SLOW_SPEED * unit)
        pace = max(pace, abs(turning), abs(moving), abs(moving - turning))  # of the period, the speed and the radius
        pace = max(pace, abs(orbit_slope(past, OUT_IMPACT_PHASE, n)))
        angle = abs(orbit_slope(past, OUT_ZETA, n))
        if angle > pace:  # a dimer that stands has none
            pace = angle
    return left * pace


@compiled
def relative_pace(past, k, n, least):
    """Slope of value k of the orbit over the last n double events, relative to the value, or to the least that counts."""
    value = orbit_value(past, k, 0)
    return orbit_slope(past, k, n) / copysign(max(abs(value), least), value)


@compiled
def spin_pace(past, p):
    """Change of the spin per forcing period over the last periods of a motion of period p, relative to it or to g/(omega r)."""
    last, span = int(past[SCALARS, S_STROBES]) - 1, p * (SETTLED_PERIODS // p)
    spin, old = past[STROBES + last % RING, P_SPIN], past[STROBES + (last - span) % RING, P_SPIN]
    return abs(spin - old) / span / max(abs(spin), 1.0)


@compiled
def heading_pace(past, p):
    """Turning of the heading per forcing period over the last periods of a motion of period p, and its change [rad]."""
    last, span = int(past[SCALARS, S_STROBES]) - 1, whole(p)
    now, old = past[STROBES + last % RING, P_THETA], past[STROBES + (last - span) % RING, P_THETA]
    turn, turn_before = now - old, old - past[STROBES + (last - 2 * span) % RING, P_THETA]
    return turn / span, (turn - turn_before) / (span * span)


@compiled
def hop_pace(dm, past, p, i):
    """Change of the longest hop of end i per forcing period over the last periods of a motion of period p [periods]."""
    span = p * (SETTLED_PERIODS // p)
    return abs(longest_landed(dm, past, p, 0, i) - longest_landed(dm, past, p, span, i)) / span


@compiled
def verdict(dm, state, past, at_rest, left, out):
    """Mode, its period, the end of the double impact, and the track; fills the outcome row (nan where a number has no meaning).

    A run that rests does so for the periods that are left of it, too: both ends are down in them.
    """
    for k in range(N_OUT):
        out[k] = nan
    mode, p = M_UNRESOLVED, 0
    if at_rest or stays_down(past):
        mode = mode_on_the_plate(dm, state, past, at_rest)
    else:
        mode, p = mode_of(dm, past)
    rest = left if at_rest else 0
    span = min(int(past[SCALARS, S_STROBES]) + rest - 1, whole(p))
    moved = max(0, span - rest)
    for i in range(2):
        if moved > 0:
            out[OUT_DOWN_SHARE_1 + i] = (moved * share(past, moved, p, i) + (span - moved)) / span
            out[OUT_LONGEST_HOP_1 + i] = longest_hop(dm, past, moved, i)
        elif span > 0:
            out[OUT_DOWN_SHARE_1 + i], out[OUT_LONGEST_HOP_1 + i] = 1.0, 0.0
    out[OUT_CHANGE_AHEAD] = change_ahead(dm, past, left) if p > 0 else 0.0
    track = TR_NONE
    if p > 0:
        turn, _ = heading_pace(past, p)
        track, out[OUT_CENTRE_VELOCITY_X], out[OUT_CENTRE_VELOCITY_Y] = track_of(past[TRACK_ROW], left * turn)
        out[OUT_SETTLED_AFTER] = past[SCALARS, S_STROBES] - past[RUNS, p]
        out[OUT_SPIN_DRIFT] = spin_drift(dm, past, p)
    end = orbit_of(past, out) if mode == M_DRIFT else 0
    return mode, p, end, track
