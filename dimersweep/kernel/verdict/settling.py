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
from dimersweep.kernel.model.body import centre
from dimersweep.kernel.model.layout import THETA
from dimersweep.kernel.verdict.past import N_NORMAL, note_strobe, strobe, time_of
from dimersweep.kernel.verdict.track import Fix, follow_track

SETTLED_CHANGE = 1e-4  # change of a strobe, in g/omega^2 and g/omega, that counts as none
KEPT = 1e-3  # the same of a motion that has settled before: it is not lost at a corner of its family
# share of a shorter period's residual that is left after SETTLED_PERIODS periods, below which it is on its way to none
FADING = 0.99
SETTLED_PERIODS = 24  # periods a motion repeats before it counts as settled
FALL, FALL_STRETCH = 0.5, SETTLED_PERIODS // 3  # what is left of a fast part that falls after so many periods, at most
MAX_PERIOD = 16
SLOW_SPEED = 0.01  # speed in g/omega below which a velocity has no direction, and changes are relative to this one


@compiled
def note_period(dm, state, modes, past):
    """Strobe at a period boundary, count for how long the motion has repeated with each period, and go on with its track.

    On a level plate the heading is of no consequence, so that the centre of a circle stands: its place is not wanted.
    """
    note_strobe(dm, state, modes, past)
    settled = False
    for p in range(1, MAX_PERIOD + 1):
        past.runs[p] = past.runs[p] + 1.0 if repeats(past, p) else 0.0
        settled = settled or has_repeated(past, p)
    if settled or past.track.begun != 0.0:
        x, y = centre(dm, state) if dm.sideways != 0.0 else (0.0, 0.0)
        follow_track(past.track, Fix(time_of(dm, state), x, y, state[THETA]), SLOW_SPEED * dm.g / dm.omega)


@compiled
def has_repeated(past, p):
    """Whether the motion has repeated with period p for long enough."""
    return past.runs[p] >= SETTLED_PERIODS + p


@compiled
def repeats(past, p):
    """Whether the motion has come back to where it was p periods ago, but for the creep of its spin and its heading."""
    if past.n_strobes <= p:
        return False
    _, turned = slow_changes(past, p, 0)
    return residual(past, p, 0) <= (max(KEPT, turned) if has_repeated(past, p) else SETTLED_CHANGE)


@compiled
def residual(past, p, back):
    """How far the strobe `back` periods before the last one is from one that repeats over p periods."""
    moved = change(past, p, back)
    if past.n_strobes <= 2 * p + back or moved <= SETTLED_CHANGE:
        return moved
    spun, turned = slow_changes(past, p, back)
    if moved > max(spun, turned):
        return moved
    return min(moved, SETTLED_PERIODS * max(0.0, fast_change(past, p, back) - turned * moved))


@compiled
def slow_changes(past, p, back):
    """How far the spin and the heading came in p periods up to `back` periods before the last strobe."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    return abs(row.spin - old.spin), abs(row.heading - old.heading)


@compiled
def change(past, p, back):
    """Change of the strobe in these periods."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row.x[k] - old.x[k]))
    return apart


@compiled
def fast_change(past, p, back):
    """Second difference of the strobe: its change in these periods less that in the p periods before."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    older = past.strobes[strobe(past, back + 2 * p)]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row.x[k] - 2.0 * old.x[k] + older.x[k]))
    return apart


@compiled
def largest_residual(past, p, stretch, back):
    """Largest residual over p periods in a stretch of strobes that ends `back` periods before the last one."""
    apart = 0.0
    for k in range(stretch):
        apart = max(apart, residual(past, p, back + k))
    return apart


@compiled
def shortens(past, p):
    """Whether a motion that repeats with period p does so, or is about to, with a shorter one, a divisor of p."""
    for q in range(1, p):
        if p % q == 0 and (
            past.runs[q] >= p
            or largest_residual(past, q, p, 0) < FADING * largest_residual(past, q, p, SETTLED_PERIODS)
        ):
            return True
    return False


@compiled
def rings_down(past, p):
    """Whether the fast part falls by FALL from each FALL_STRETCH of the last periods to the next, to below SETTLED_CHANGE."""
    if past.n_strobes < SETTLED_PERIODS + 2 * p:
        return False
    older = largest_residual(past, p, FALL_STRETCH, 2 * FALL_STRETCH)
    old, last = largest_residual(past, p, FALL_STRETCH, FALL_STRETCH), largest_residual(past, p, FALL_STRETCH, 0)
    return old <= FALL * older and last <= FALL * old and last <= SETTLED_CHANGE


@compiled
def settled_period(past, rings):
    """Least number of forcing periods with which the motion has repeated long enough, 0 if with none; or, where it `rings`,
    with which the fast part falls geometrically to none.
    """
    for p in range(1, MAX_PERIOD + 1):
        if (rings_down(past, p) if rings else has_repeated(past, p)) and not shortens(past, p):
            return p
    return 0


@compiled
def whole(p, n):
    """So many periods, or as many of them as are whole periods p of the motion, at least one; all where it has none, 0."""
    return p * max(1, n // p) if p > 0 else n


@compiled
def spin_drift(past, p):
    """Change of the spin per forcing period over the last periods of a motion of period p [g/(omega r)]."""
    span = whole(p, SETTLED_PERIODS)
    return (past.strobes[strobe(past, 0)].spin - past.strobes[strobe(past, span)].spin) / span
