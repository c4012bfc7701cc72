"""When a motion has settled, and with which period: when its fast part has.

A dimer turns and rolls on while its spin creeps, by some 1e-6 to 1e-3 of itself in a period. All else
follows at once: a motion goes through a family of orbits, one for each spin, and its strobe moves along it. So there are
two measures of how far a strobe x (gaps and gap rates, in g/omega^2 and g/omega) is from one that repeats over p periods:

* its change; or, where the spin (r s in g/omega) has changed by more, so that the motion goes along the family,
* SETTLED_PERIODS times its second difference: x less where it was bound for at the pace of the p periods before. There the
  creep cancels but for its own slow change, and what is left is the fast part.

On a plate that is tilted or moves sideways the family has an orbit for each heading, too. There a change of the heading
[rad] counts as one of the spin does, and a second difference only by what exceeds the change times that of the heading:
so much comes of a strobe that goes smoothly with it.

A strobe has repeated if the less of the two is below SETTLED_CHANGE, or below KEPT where the motion has settled before: on
its way along the family it passes corners, where the number of its small hops or the order of stick and slip changes. A
heading that turns passes them again and again: there a change below that of the heading will do, too. The motion has
settled when it has repeated for SETTLED_PERIODS periods: what then is left of the fast part would change x by
SETTLED_CHANGE in as many again, or less. A run that ends before has settled, too, where the fast part is seen to fall
geometrically, over SETTLED_PERIODS periods, to below SETTLED_CHANGE.
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import extent
from dimersweep.kernel.verdict.past import (
    N_NORMAL,
    P_HEADING,
    P_SPIN,
    RING,
    RUNS,
    S_STROBES,
    SCALARS,
    STROBES,
    TRACK_ROW,
    note_strobe,
)
from dimersweep.kernel.verdict.track import T_BEGUN, note_track

SETTLED_CHANGE = 1e-4  # change of a strobe, in g/omega^2 and g/omega, that counts as none
KEPT = 1e-3  # the same of a motion that has settled before: it is not lost at a corner of its family
# share of a shorter period's residual that is left after SETTLED_PERIODS periods, below which it is on its way to none
FADING = 0.99
SETTLED_PERIODS = 24  # periods a motion repeats before it counts as settled
FALL, FALL_STRETCH = 0.5, SETTLED_PERIODS // 3  # what is left of a fast part that falls after so many periods, at most
MAX_PERIOD = 16


@compiled
def note_period(dm, state, modes, past):
    """Strobe at a period boundary, count for how long the motion has repeated with each period, and go on with its track."""
    note_strobe(dm, state, modes, past)
    settled = False
    for p in range(1, MAX_PERIOD + 1):
        past[RUNS, p] = past[RUNS, p] + 1.0 if repeats(past, p) else 0.0
        settled = settled or past[RUNS, p] >= SETTLED_PERIODS + p
    if settled or past[TRACK_ROW, T_BEGUN] != 0.0:
        note_track(dm, state, past)


@compiled
def repeats(past, p):
    """Whether the motion has come back to where it was p periods ago, but for the creep of its spin and its heading."""
    if past[SCALARS, S_STROBES] <= p:
        return False
    line = max(KEPT, slow_change(past, P_HEADING, p, 0)) if past[RUNS, p] >= SETTLED_PERIODS + p else SETTLED_CHANGE
    return residual(past, p, 0) <= line


@compiled
def residual(past, p, back):
    """How far the strobe `back` periods before the last one is from one that repeats over p periods."""
    moved = change(past, p, back)
    if past[SCALARS, S_STROBES] <= 2 * p + back or moved <= SETTLED_CHANGE:
        return moved
    turned = slow_change(past, P_HEADING, p, back)
    if moved > max(slow_change(past, P_SPIN, p, back), turned):
        return moved
    return min(moved, SETTLED_PERIODS * max(0.0, fast_change(past, p, back) - turned * moved))


@compiled
def slow_change(past, which, p, back):
    """How far the spin (P_SPIN) or the heading (P_HEADING) came in p periods, in its unit."""
    last = int(past[SCALARS, S_STROBES]) - 1 - back
    return abs(past[STROBES + last % RING, which] - past[STROBES + (last - p) % RING, which])


@compiled
def fast_change(past, p, back):
    """Second difference of the strobe over p periods: its change less that of the p periods before."""
    last = int(past[SCALARS, S_STROBES]) - 1 - back
    row, old = past[STROBES + last % RING], past[STROBES + (last - p) % RING]
    older = past[STROBES + (last - 2 * p) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - 2.0 * old[k] + older[k]))
    return apart


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
def shortens(past, p):
    """Whether a motion that repeats with period p does so, or is about to, with a shorter one, a divisor of p."""
    for q in range(1, p):
        if p % q == 0 and (
            past[RUNS, q] >= p
            or largest_residual(past, q, p, 0) < FADING * largest_residual(past, q, p, SETTLED_PERIODS)
        ):
            return True
    return False


@compiled
def settled_period(past):
    """Least number of forcing periods with which the motion has repeated long enough, 0 if with none."""
    for p in range(1, MAX_PERIOD + 1):
        if past[RUNS, p] >= SETTLED_PERIODS + p and not shortens(past, p):
            return p
    return 0


@compiled
def ringing_period(past):
    """Least number of forcing periods with which the fast part falls geometrically to none, 0 if with none."""
    for p in range(1, MAX_PERIOD + 1):
        if rings_down(past, p) and not shortens(past, p):
            return p
    return 0


@compiled
def rings_down(past, p):
    """Whether the fast part falls by FALL from each FALL_STRETCH of the last periods to the next, to below SETTLED_CHANGE."""
    if past[SCALARS, S_STROBES] < SETTLED_PERIODS + 2 * p:
        return False
    older = largest_residual(past, p, FALL_STRETCH, 2 * FALL_STRETCH)
    old, last = largest_residual(past, p, FALL_STRETCH, FALL_STRETCH), largest_residual(past, p, FALL_STRETCH, 0)
    return old <= FALL * older and last <= FALL * old and last <= SETTLED_CHANGE


@compiled
def largest_residual(past, p, stretch, back):
    """Largest residual over p periods in a stretch of strobes that ends `back` periods before the last one."""
    apart = 0.0
    for k in range(stretch):
        apart = max(apart, residual(past, p, back + k))
    return apart


@compiled
def spin_drift(dm, past, p):
    """Change of the spin per forcing period over the last periods of a motion of period p [rad/s]."""
    last, span = int(past[SCALARS, S_STROBES]) - 1, p * (SETTLED_PERIODS // p)
    change = past[STROBES + last % RING, P_SPIN] - past[STROBES + (last - span) % RING, P_SPIN]
    return change / span * dm.g / (dm.omega * extent(dm)[0])
