"""The verdict on a run: its mode of motion, the numbers that go with it, and the orbit of a drift."""

from math import nan, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import (
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    M_REST,
    M_UNRESOLVED,
    N_ORBIT,
    N_OUT,
    OUT_BETA_RATE_AFTER,
    OUT_DOWN_SHARE_1,
    OUT_DOWN_SHARE_2,
    OUT_IMPACT_PHASE,
    OUT_LONGEST_HOP_1,
    OUT_LONGEST_HOP_2,
    OUT_PRECESSION_RATE,
    OUT_RADIUS,
    OUT_SETTLED_AFTER,
    OUT_SPEED,
    OUT_SPIN_DRIFT,
    OUT_SPIN_RATE,
    OUT_ZETA,
)
from dimersweep.kernel.verdict.past import (
    DOUBLES,
    E_END,
    E_PHASE,
    E_SPEED,
    E_SPIN,
    E_THETA,
    E_TIME,
    E_WB,
    E_ZETA,
    G_END,
    G_LONG,
    G_TIME,
    LANDINGS,
    P_DOUBLES,
    P_DOWN_1,
    P_HOP_1,
    P_OFF_1,
    P_TIME,
    RING,
    RUNS,
    S_CLOSED,
    S_DOUBLES,
    S_LANDINGS,
    S_STROBES,
    SCALARS,
    STROBES,
)
from dimersweep.kernel.verdict.settling import ringing_period, settled_period, spin_drift

DOWN_LINE = 0.9  # share of the time one ball is down in the drift mode
TOGETHER = 0.15  # landings of a jump lie closer than this
FIT = 20  # double events in the fit of an orbit's drift
SPAN = 12.0  # periods of which shares and hops are told


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
def longest_hop(dm, past, span, i):
    """Longest time that end i was off the plate, of the hops that ended or went on in the last `span` periods [periods]."""
    count = int(past[SCALARS, S_STROBES])
    last = past[STROBES + (count - 1) % RING]
    longest = last[P_TIME] - last[P_OFF_1 + i] if last[P_OFF_1 + i] >= 0.0 else 0.0
    for back in range(span):
        longest = max(longest, past[STROBES + (count - 1 - back) % RING, P_HOP_1 + i])
    return longest / dm.T


@compiled
def mode_of(dm, past, at_rest):
    """Mode of the motion and its period in forcing periods (0 where it has none)."""
    count = int(past[SCALARS, S_STROBES])
    if at_rest or past[SCALARS, S_CLOSED] >= 3.0:
        return M_REST, 0
    p = settled_period(past)
    if p == 0:
        p = ringing_period(past)
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
    """Value k of the orbit (OUT_RADIUS to OUT_IMPACT_PHASE, or OUT_SPIN_RATE) at the double event `back` before the last."""
    count = int(past[SCALARS, S_DOUBLES])
    row = past[DOUBLES + (count - 1 - back) % RING]
    old = past[DOUBLES + (count - 2 - back) % RING]
    if k == OUT_ZETA:
        return row[E_ZETA]
    if k == OUT_SPEED:
        return row[E_SPEED]
    if k == OUT_IMPACT_PHASE:
        return row[E_PHASE]
    if k == OUT_SPIN_RATE:
        return row[E_SPIN]
    rate = (row[E_THETA] - old[E_THETA]) / (row[E_TIME] - old[E_TIME])
    if k == OUT_PRECESSION_RATE:
        return rate
    if rate == 0.0:
        return nan  # a straight path: there is no circle
    return row[E_SPEED] / abs(rate) if k == OUT_RADIUS else 2.0 * pi / abs(rate)


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
    n = min(FIT, count - 1, RING - 1)
    for k in range(N_ORBIT):
        out[k] = orbit_value(past, k, 0)
        out[N_ORBIT + k] = orbit_slope(past, k, n)
    last = past[DOUBLES + (count - 1) % RING]
    out[OUT_SPIN_RATE], out[OUT_BETA_RATE_AFTER] = last[E_SPIN], last[E_WB]
    out[OUT_SPIN_DRIFT] = orbit_slope(past, OUT_SPIN_RATE, n)
    return int(last[E_END])


@compiled
def verdict(dm, past, at_rest, out):
    """Mode, its period and the end of the double impact; fills the outcome row (nan where a number has no meaning)."""
    for k in range(N_OUT):
        out[k] = nan
    mode, p = mode_of(dm, past, at_rest)
    if past[SCALARS, S_STROBES] > 1.0:
        span = int(min(past[SCALARS, S_STROBES] - 1.0, SPAN))
        out[OUT_DOWN_SHARE_1], out[OUT_DOWN_SHARE_2] = share(past, span, 0), share(past, span, 1)
        out[OUT_LONGEST_HOP_1], out[OUT_LONGEST_HOP_2] = longest_hop(dm, past, span, 0), longest_hop(dm, past, span, 1)
    if p > 0:
        out[OUT_SETTLED_AFTER] = past[SCALARS, S_STROBES] - past[RUNS, p]
        out[OUT_SPIN_DRIFT] = spin_drift(dm, past, p)
    end = orbit_of(past, out) if mode == M_DRIFT else 0
    return mode, p, end
