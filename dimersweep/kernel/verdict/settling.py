"""Find whether a motion has settled, and its period: it has settled when its fast part has.

A dimer turns and rolls on while its spin creeps, by some 1e-6 to 1e-3 of itself in a period. All else is fast and
follows at once: a motion goes through a family of orbits, one for each spin, and its strobe moves along the family. The
fast part of a motion is its distance from that family. Let x be a strobe (gaps and gap rates, in g/omega^2 and
g/omega). There are two measures of how far x is from a strobe that repeats over p periods:

* its change; or, where the spin (r s in g/omega) has changed by more, so that the motion goes along the family,
* SETTLED_PERIODS times its second difference: the distance of x from where the pace of the p periods before would lead.
  There the creep cancels but for its own slow change, and the fast part is left.

On a plate that is tilted or moves sideways the family has an orbit for each heading, too. There a change of the heading
[rad] counts as one of the spin does. A second difference counts only by what exceeds the change times that of the
heading: so much comes of a strobe that goes smoothly with the heading.

A strobe has repeated if the smaller of the two is below SETTLED_CHANGE, or below KEPT where the motion has settled
before. On its way along the family the motion passes corners, where the number of its small hops or the order of stick
and slip changes. A heading that turns passes them again and again: there a change below that of the heading is enough,
too.

The motion has settled when it has repeated for SETTLED_PERIODS periods: the rest of the fast part would then change x
by SETTLED_CHANGE in as many again, or less. A run that ends before has settled, too, where the fast part is seen to
fall geometrically, over SETTLED_PERIODS periods, to below SETTLED_CHANGE.
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import centre
from dimersweep.kernel.model.layout import THETA
from dimersweep.kernel.verdict.past import N_NORMAL, note_strobe, strobe, time_of
from dimersweep.kernel.verdict.track import Fix, follow_track

SETTLED_CHANGE = 1e-4  # change of a strobe, in g/omega^2 and g/omega, that counts as none
# the same for a motion that has settled before: it stays settled at a corner of its family
KEPT = 1e-3
# share of the residual of a shorter period that is left after SETTLED_PERIODS periods, below which it is on its way to
# none
FADING = 0.99
SETTLED_PERIODS = 24  # periods for which a motion repeats before it counts as settled
# share of a fast part that is left, at most, after FALL_STRETCH periods if it falls geometrically
FALL, FALL_STRETCH = 0.5, SETTLED_PERIODS // 3
# longest period of a motion in forcing periods: with it the strobes that are compared, at most 55 back, are still in
# the ring
MAX_PERIOD = 16
# speed in g/omega below which a velocity has no direction; changes of a lower speed are relative to this one
SLOW_SPEED = 0.01


@compiled
def note_period(dm, state, modes, past):
    """Note the strobe at a period boundary, and continue the track of the motion.

    Count for how many periods the motion has repeated with each period p. On a level plate the heading is of no
    consequence, so that the centre of a circle stands: its place is not computed.
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
    """Return True if the motion has repeated with period p for long enough."""
    return past.runs[p] >= SETTLED_PERIODS + p


@compiled
def repeats(past, p):
    """Return True if the motion is where it was p periods ago, but for the creep of its spin and its heading."""
    if past.n_strobes <= p:
        return False
    _, turned = slow_changes(past, p, 0)
    return residual(past, p, 0) <= (max(KEPT, turned) if has_repeated(past, p) else SETTLED_CHANGE)


@compiled
def residual(past, p, back):
    """Return how far the strobe `back` periods before the last one is from a strobe that repeats over p periods."""
    moved = change(past, p, back)
    if past.n_strobes <= 2 * p + back or moved <= SETTLED_CHANGE:
        return moved
    spun, turned = slow_changes(past, p, back)
    if moved > max(spun, turned):
        return moved
    return min(moved, SETTLED_PERIODS * max(0.0, fast_change(past, p, back) - turned * moved))


@compiled
def slow_changes(past, p, back):
    """Return the changes of the spin and of the heading in p periods up to `back` periods before the last strobe."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    return abs(row.spin - old.spin), abs(row.heading - old.heading)


@compiled
def change(past, p, back):
    """Return the change of the strobe in p periods up to `back` periods before the last strobe."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row.x[k] - old.x[k]))
    return apart


@compiled
def fast_change(past, p, back):
    """Return the second difference of the strobe: its change in p periods less that in the p periods before."""
    row, old = past.strobes[strobe(past, back)], past.strobes[strobe(past, back + p)]
    older = past.strobes[strobe(past, back + 2 * p)]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row.x[k] - 2.0 * old.x[k] + older.x[k]))
    return apart


@compiled
def largest_residual(past, p, stretch, back):
    """Return the largest residual over p periods in a stretch of strobes, `back` periods before the last one."""
    apart = 0.0
    for k in range(stretch):
        apart = max(apart, residual(past, p, back + k))
    return apart


@compiled
def shortens(past, p):
    """Return True if a motion that repeats with period p does so, or is about to, with a divisor of p."""
    for q in range(1, p):
        if p % q == 0 and (
            past.runs[q] >= p
            or largest_residual(past, q, p, 0) < FADING * largest_residual(past, q, p, SETTLED_PERIODS)
        ):
            return True
    return False


@compiled
def rings_down(past, p):
    """Return True if the fast part falls geometrically to below SETTLED_CHANGE.

    It falls by FALL from each FALL_STRETCH of the last periods to the next.
    """
    if past.n_strobes < SETTLED_PERIODS + 2 * p:
        return False
    older = largest_residual(past, p, FALL_STRETCH, 2 * FALL_STRETCH)
    old, last = largest_residual(past, p, FALL_STRETCH, FALL_STRETCH), largest_residual(past, p, FALL_STRETCH, 0)
    return old <= FALL * older and last <= FALL * old and last <= SETTLED_CHANGE


@compiled
def settled_period(past, rings):
    """Return the least period, in forcing periods, with which the motion has settled; 0 if there is none.

    It has settled by repetition for long enough. If `rings` is True, it has settled where the fast part falls
    geometrically to none.
    """
    for p in range(1, MAX_PERIOD + 1):
        if (rings_down(past, p) if rings else has_repeated(past, p)) and not shortens(past, p):
            return p
    return 0


@compiled
def whole(p, n):
    """Return the greatest number of periods up to n that is a multiple of the period p of the motion, at least p.

    It is n where the motion has no period (p is 0).
    """
    return p * max(1, n // p) if p > 0 else n


@compiled
def spin_drift(past, p):
    """Return the change of the spin per forcing period over the last periods of a motion of period p [g/(omega r)]."""
    span = whole(p, SETTLED_PERIODS)
    return (past.strobes[strobe(past, 0)].spin - past.strobes[strobe(past, span)].spin) / span
