"""Give the verdict on a run: its mode of motion, the numbers that go with it, and the orbit of a drift.

A mode is known long before the numbers stand: the spin creeps on, and a path that bends less and less takes hundreds of
periods to its radius. A run stops where its numbers would change by no more than STILL in the periods that are left, at
their pace over the last periods. So they are those at the end of the periods asked for, to 1e-3.
"""

from math import copysign, nan, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import extent
from dimersweep.kernel.model.layout import (
    DI_NONE,
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    M_REST,
    M_ROLLS,
    M_SLIDES,
    M_UNRESOLVED,
    N_ORBIT,
    THETA,
    TRACK,
    V_PHASE,
    V_RADIUS,
    V_RATE,
    V_SPEED,
    V_ZETA,
    WP,
)
from dimersweep.kernel.model.plate import keeps_speed
from dimersweep.kernel.verdict.past import RING, double, strobe
from dimersweep.kernel.verdict.settling import SETTLED_PERIODS, SLOW_SPEED, settled_period, spin_drift, whole
from dimersweep.kernel.verdict.track import track_of

# least share of the time that one ball is down in the drift mode: it chatters, and for Gamma > 1 the plate throws it
# off
DOWN_LINE = 0.9
TOGETHER = 0.15  # the two landings of a jump lie closer than this, in forcing periods
FIT = 20  # double events in the fit of the slopes of an orbit
# last periods, over which the shares of contact and the longest hops are taken: whole for a motion of 1, 2, 3, 4, 6 or
# 12 periods, and made whole for others (`whole`)
SPAN = 12
STAYS = 3.0  # periods for which both ends have been down, from which on they stay down
# change of the numbers (relative, or in radians, cycles or periods) that a stopped run leaves out at most: somewhat
# less than the 1e-3 that is promised
STILL = 8e-4
V_SPIN = N_ORBIT  # place of the spin, after the values of an orbit
STRAIGHT = 1e-9  # precession rate, in omega: changes of a lesser rate are relative to this one


@compiled
def down_until(row, i, off):
    """Return the time that end i has been down by a strobe [s], up to a constant.

    A flight that goes on since the time `off` counts as a long one; a negative `off` means none.
    """
    return row.time + row.long[i] - (row.time - off if off >= 0.0 else 0.0)


@compiled
def share(past, span, p, i):
    """Return the share of the last `span` periods that end i is down, in [0, 1].

    The part of a long flight within these periods counts as not down. A flight under way at their end counts as long if
    a flight was under way a period p of the motion before, too. Without a period, p = 0, it always counts as long.
    """
    row, old = past.strobes[strobe(past, 0)], past.strobes[strobe(past, span)]
    goes_on = past.strobes[strobe(past, p)].off[i] >= 0.0
    down = down_until(row, i, row.off[i] if goes_on else -1.0) - down_until(old, i, old.off[i])
    # but for rounding the share lies in [0, 1]
    return max(0.0, min(1.0, down / (row.time - old.time)))


@compiled
def longest_landed(dm, past, span, back, i):
    """Return the longest hop of end i that ended in a stretch of strobes [periods].

    The stretch has `span` periods and ends `back` periods before the last strobe.
    """
    longest = 0.0
    for k in range(span):
        longest = max(longest, past.strobes[strobe(past, back + k)].hop[i])
    return longest / dm.period


@compiled
def down_and_hop(dm, past, span, rest, p, i):
    """Return the share of the last `span` periods that end i is down, and its longest hop in them [periods].

    The hop is the longest time that the end was off the plate, of the hops that ended or went on in these periods. For
    the `rest` of them the end lies still.
    """
    if span <= 0:
        return nan, nan
    moved = max(0, span - rest)
    if moved == 0:
        return 1.0, 0.0
    row = past.strobes[strobe(past, 0)]
    under_way = row.time - row.off[i] if row.off[i] >= 0.0 else 0.0
    hop = max(under_way / dm.period, longest_landed(dm, past, moved, 0, i))
    return (moved * share(past, moved, p, i) + (span - moved)) / span, hop


@compiled
def stays_down(past):
    """Return True if both ends have been on the plate for STAYS periods."""
    return past.closed >= STAYS


@compiled
def mode_on_the_plate(dm, state, past, at_rest):
    """Return the mode of a motion whose ends both stay down."""
    if at_rest:
        return M_REST
    if past.stuck < STAYS:
        return M_SLIDES
    return M_REST if keeps_speed(dm, state[THETA], state[WP]) else M_ROLLS


@compiled
def mode_of(dm, past):
    """Return the mode of a motion whose ends do not both stay down, and its period.

    The period is in forcing periods, 0 where there is none.
    """
    # a period by repetition is sure; a fast part that rings down only foretells one
    p = settled_period(past, False)
    if p == 0:
        p = settled_period(past, True)
    if p == 0:
        return M_UNRESOLVED, 0
    span = whole(p, SPAN)
    down_1, down_2 = share(past, span, p, 0), share(past, span, p, 1)
    doubles = past.strobes[strobe(past, 0)].doubles - past.strobes[strobe(past, span)].doubles
    # drift: one double event in each period, one ball down nearly all the time, the other one in the air for half of it
    # or more
    if p == 1 and doubles == span and max(down_1, down_2) >= DOWN_LINE and min(down_1, down_2) <= 0.5:
        return M_DRIFT, 1
    together, turns, total = landing_pattern(dm, past, span)
    # jump: all long landings are paired; or all hops are short, and each period of the motion has a double event
    if (total > 0 and together == total) or (total == 0 and doubles >= span / p):
        return M_JUMP, p
    # the ends land in turn: each landing but the first is a change of end
    if p > 1 and total >= 2 and turns == total - 1:
        return M_FLUTTER, p
    return M_PERIOD_N, p


@compiled
def landing_pattern(dm, past, span):
    """Count the long landings of the last `span` periods; return three numbers.

    These are the landings paired with a landing of the other end, the changes of end from landing to landing, and all
    landings.
    """
    last, kept = int(past.n_landings) - 1, min(int(past.n_landings), RING)
    begin = (past.n_strobes - span) * dm.period
    together, turns, total, later_end = 0, 0, 0, -1.0
    for back in range(kept):
        row = past.landings[(last - back) % RING]
        if row.time < begin:
            break
        if row.long == 0.0:
            continue
        total += 1
        # -1.0: no landing has been counted yet
        turns += 1 if later_end >= 0.0 and row.end != later_end else 0
        later_end = row.end
        # a landing of the other end at nearly the same time: it can only be the landing before this one, or after it
        paired = False
        for k in range(max(back - 1, 0), min(back + 2, kept)):
            other = past.landings[(last - k) % RING]
            paired = paired or (other.end != row.end and abs(other.time - row.time) < TOGETHER * dm.period)
        together += 1 if paired else 0
    return together, turns, total


@compiled
def orbit_value(past, k, back):
    """Return value k of the orbit (V_RADIUS and so on, or V_SPIN) at the double event `back` before the last."""
    row, old = past.doubles[double(past, back)], past.doubles[double(past, back + 1)]
    if k == V_ZETA:
        return row.zeta
    if k == V_SPEED:
        return row.speed
    if k == V_PHASE:
        return row.phase
    if k == V_SPIN:
        return row.spin
    rate = (row.theta - old.theta) / (row.time - old.time)
    if k == V_RATE:
        return rate
    if rate == 0.0:
        return nan  # a straight path: there is no circle
    return row.speed / abs(rate) if k == V_RADIUS else 2.0 * pi / abs(rate)


@compiled
def orbit_slope(past, k, n):
    """Return the slope of value k of the orbit over the last n double events, by least squares."""
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
    """Return the number of double events in the fit of the slopes of an orbit."""
    return min(min(FIT, RING - 1), int(past.n_doubles) - 1)


@compiled
def orbit_of(past, out):
    """Write the orbit of a drift from its double events into the outcome: last values, and slopes over the last FIT.

    Returns
    -------
    int
        End state of the last double impact: a code in ``layout.DI_ENDS``.
    """
    if past.n_doubles < 2.0:
        return 0
    n, last = fitted(past), past.doubles[double(past, 0)]
    for k in range(N_ORBIT):
        out.orbit[k], out.drift[k] = orbit_value(past, k, 0), orbit_slope(past, k, n)
    out.spin, out.beta_rate_after = last.spin, last.beta_rate
    out.run.spin_drift = orbit_slope(past, V_SPIN, n)
    return int(last.end)


@compiled
def stays_as_it_is(dm, past, left):
    """Return True if the motion has settled, and its numbers stay as they are for the periods `left` of a run.

    Where the numbers depend on the heading, their present pace says nothing of the turn to come. Where both ends stay
    down and do not rest, the speed changes.
    """
    if dm.sideways != 0.0 or stays_down(past) or settled_period(past, False) == 0:
        return False
    return change_ahead(dm, past, left) <= STILL


@compiled
def change_ahead(dm, past, left):
    """Return the largest change of the numbers of a settled motion in the periods `left`.

    The numbers change at their pace over the last periods. Of a drift count the relative changes of radius, period,
    speed and precession rate, and the absolute changes of angle [rad] and phase [cycles]. Of any motion count the
    relative change of the spin and the absolute change of the longest hops [periods]. The angle by which the heading
    turns counts, too: its change [rad], relative to the angle where that is more than one.
    """
    mode, p = mode_of(dm, past)
    if p == 0 or left == 0:
        return 0.0
    # relative to the spin, or to g/omega where the spin is below that: a spin near zero has no relative change
    pace = abs(spin_drift(past, p)) / max(abs(past.strobes[strobe(past, 0)].spin), 1.0)
    span = whole(p, SETTLED_PERIODS)
    for i in range(2):
        pace = max(pace, abs(longest_landed(dm, past, p, 0, i) - longest_landed(dm, past, p, span, i)) / span)
    turn, bend = heading_pace(past, p)
    # at a constant change of the turning, `bend`, the angle differs by left^2 bend / 2; `left` comes as a factor below
    pace = max(pace, 0.5 * left * abs(bend) / max(1.0, left * abs(turn)))
    if mode == M_DRIFT:
        n, unit = fitted(past), dm.g / dm.omega
        turning = relative_pace(past, V_RATE, n, STRAIGHT * dm.omega)
        moving = relative_pace(past, V_SPEED, n, SLOW_SPEED * unit)
        # the pace of the period is that of the rate, reversed; then of the speed and of the radius, speed over rate
        pace = max(max(pace, abs(turning)), max(abs(moving), abs(moving - turning)))
        pace = max(pace, abs(orbit_slope(past, V_PHASE, n)))
        angle = abs(orbit_slope(past, V_ZETA, n))
        # a dimer that stands has no angle: nan is not greater
        if angle > pace:
            pace = angle
    return left * pace


@compiled
def relative_pace(past, k, n, least):
    """Return the slope of value k of the orbit over the last n double events, relative to the value.

    It is relative to the value `least`, with its sign, where the value is smaller.
    """
    value = orbit_value(past, k, 0)
    return orbit_slope(past, k, n) / copysign(max(abs(value), least), value)


@compiled
def heading_pace(past, p):
    """Return the turning of the heading per forcing period [rad], and its change per period.

    They are those over the last periods of a motion of period p.
    """
    span = whole(p, SPAN)
    now, old = past.strobes[strobe(past, 0)].theta, past.strobes[strobe(past, span)].theta
    turn, turn_before = now - old, old - past.strobes[strobe(past, 2 * span)].theta
    return turn / span, (turn - turn_before) / (span * span)


@compiled
def clear_outcome(codes, out):
    """Set an outcome without a verdict: no number has a meaning."""
    codes.mode, codes.mode_period, codes.di_end, codes.track = M_UNRESOLVED, 0, DI_NONE, TRACK.none
    for k in range(N_ORBIT):
        out.orbit[k] = out.drift[k] = nan
    out.spin = out.beta_rate_after = out.path_radius = out.path_speed = nan
    run = out.run
    run.down_share_1 = run.down_share_2 = run.longest_hop_1 = run.longest_hop_2 = run.settled_after = nan
    run.spin_drift = run.change_ahead = run.centre_velocity_x = run.centre_velocity_y = nan


@compiled
def verdict(dm, state, past, at_rest, left, codes, out):
    """Write the verdict on a run into its outcome.

    It has the mode, its period, the end of the double impact, the track, and the numbers that go with them. A run that
    rests does so for the periods `left` of it, too: both ends are down in them.
    """
    clear_outcome(codes, out)
    p, run, rest = 0, out.run, left if at_rest else 0
    if at_rest or stays_down(past):
        codes.mode = mode_on_the_plate(dm, state, past, at_rest)
    else:
        codes.mode, p = mode_of(dm, past)
    span = min(int(past.n_strobes) + rest - 1, whole(p, SPAN))
    run.down_share_1, run.longest_hop_1 = down_and_hop(dm, past, span, rest, p, 0)
    run.down_share_2, run.longest_hop_2 = down_and_hop(dm, past, span, rest, p, 1)
    run.change_ahead = 0.0
    if p > 0:
        run.change_ahead = change_ahead(dm, past, left)
        turn, _ = heading_pace(past, p)
        codes.track, run.centre_velocity_x, run.centre_velocity_y = track_of(past.track, left * turn)
        run.settled_after = past.n_strobes - past.runs[p]
        run.spin_drift = spin_drift(past, p) * dm.g / (dm.omega * extent(dm)[0])
        codes.mode_period = p
    if codes.mode == M_DRIFT:
        codes.di_end = orbit_of(past, out)
