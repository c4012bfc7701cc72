"""Where a stable orbit ceases to be stable, or to be, along its branch.

That is a fold, a flip or a torus, or a change of word over which the multipliers leap, or beyond which there is no such orbit.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import takewhile

import numpy as np

from dimersweep.orbits.branch import Axis, Point, corrected, in_each_section, in_own_section, one_sided, point_of
from dimersweep.orbits.guesses import settled_on
from dimersweep.orbits.kinds import BORDER_KINDS
from dimersweep.orbits.kinds.changes import WORD, change_of
from dimersweep.orbits.kinds.kind import Bifurcation, Kind
from dimersweep.orbits.manifold import multipliers_of
from dimersweep.orbits.newton import solve
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import OrbitLost
from dimersweep.orbits.specials import JOINED, MOST_CHANGES, Special, between, last_with, located, senses_of
from dimersweep.orbits.word import word_of

WALK_STEP, SHORTEST_STEP, WALK_POINTS = 0.1, 1e-5, 120  # of a branch, in units of the section and of the parameter
STRAIGHT_LINE = 0.7  # product of the tangents at both ends of a step, below which it is too long
NARROW_STRETCH = 1e-4  # length of a step in which stability is lost, from which on changes of word are looked for
GAP = 1e-2  # part of the parameter over which an orbit may be missing or leap
GAPS = (0.1 * GAP, GAP)  # beyond which it is taken up
FIRST_PUSH, LAST_PUSH, PUSH_GROWTH = 1e-5, 1e-9, 3.0  # steps of the parameter to the last stable orbit
AHEAD = (1e-5, 1e-4, 1e-3, 1e-2)  # how far beyond the last orbit of a branch the word is looked at

Holds = Callable[[Point], bool]  # a property of an orbit


def is_stable(point: Point) -> bool:
    """Whether all multipliers of the fast part at a point of a branch are below 1 in size."""
    return bool((np.abs(multipliers_of(point.fixed)[0]) < 1).all())


def walked(axis: Axis, point: Point) -> Iterator[tuple[Point, Point]]:
    """Steps of a branch, in the sense of the tangent of the point that it begins with: the points at both ends of each.

    Raises
    ------
    OrbitLost
        Where the branch does not go on.
    """
    step = WALK_STEP
    others: list[Point] | None = None  # the point in other sections, where the branch is lost
    for _ in range(WALK_POINTS):
        try:
            nxt = _straight_on(axis, point, step)
        except OrbitLost:
            step *= 0.5
            if step < SHORTEST_STEP:
                others = list(in_each_section(axis, point)) if others is None else others
                if not others:
                    raise
                point, step = others.pop(0), WALK_STEP
            continue
        yield point, nxt
        point = in_own_section(axis, nxt, simplest=others is None)
        step = min(1.5 * step, WALK_STEP)
        others = [] if others else None


def _straight_on(axis: Axis, point: Point, step: float) -> Point:
    nxt = corrected(axis, point, point.y(axis) + step * point.tangent, point.tangent)
    if nxt.tangent @ point.tangent < STRAIGHT_LINE:
        raise OrbitLost("the branch turns too sharply")
    return nxt


def stability_end(axis: Axis, begin: Point) -> Special:
    """The end of the stability of an orbit, along its branch in the sense of the tangent.

    Its point is that of the bifurcation, or the last stable orbit before a change of word. Where the branch does not go on but
    a stable orbit exists nearby at a parameter a little further, up to `GAP`, that one is taken up.

    Raises
    ------
    OrbitLost
        If the orbit is not stable, or no end is met.
    """
    point, sense = begin, float(np.sign(begin.tangent[-1]))
    for _ in range(MOST_CHANGES):
        special = _first_end(axis, point)
        if isinstance(special.kind, Bifurcation):
            return special
        last, goes_on = _furthest(is_stable, axis, special.point, sense)
        if not goes_on:
            _check_allowed(axis, last, sense)
            kind = special.kind if last is special.point else _kind_beyond(axis, last)
            return special._replace(kind=kind, point=last)
        point = last
    raise OrbitLost("no end of stability is met")


def _check_allowed(axis: Axis, last: Point, sense: float) -> None:
    """Refuse the end of what the parameter may be as an end of stability.

    Raises
    ------
    OrbitLost
        If the parameter is not allowed just beyond the last stable orbit.
    """
    try:
        axis.map_at(last.map, last.value + sense * 10 * LAST_PUSH * axis.scale)
    except OrbitLost as reason:
        raise OrbitLost(f"the orbit is stable up to {axis.name} = {last.value:.6g}, the end of its range") from reason


def _first_end(axis: Axis, begin: Point) -> Special:
    """The first place on the branch of a stable orbit beyond which a step leads to an unstable one, or to none."""
    if not is_stable(begin):
        raise OrbitLost("the orbit is unstable")
    last = begin
    try:
        for a, b in walked(axis, begin):
            if not is_stable(b):
                return _in_step(axis, a, b)
            last = b
    except OrbitLost:
        if last is begin:
            raise
    else:
        raise OrbitLost(f"the orbit is stable over {WALK_POINTS} points of its branch")
    return Special(_kind_beyond(axis, last), last, 1.0)


def last_that(holds: Holds, axis: Axis, begin: Point) -> Point:
    """The last orbit with a property, in the sense of the tangent of the first, where it is lost by a change of word.

    Raises
    ------
    OrbitLost
        If the first orbit does not have it, or it is not lost.
    """
    point = begin
    if not holds(begin):
        raise OrbitLost("the first orbit is another one")
    for _ in range(MOST_CHANGES):
        last = point
        try:
            for _, b in takewhile(lambda step: holds(step[1]), walked(axis, point)):
                last = b
        except OrbitLost:
            if last is begin:
                raise
        point, goes_on = _furthest(holds, axis, last, float(np.sign(begin.tangent[-1])))
        if not goes_on:
            return point
    raise OrbitLost("no end is met")


def _furthest(holds: Holds, axis: Axis, point: Point, sense: float) -> tuple[Point, bool]:
    """The last orbit with a property in steps of the parameter, and whether such an orbit goes on beyond.

    Each step is taken in a section that suits the orbit: an event that comes to the section is not the end of the orbit.
    """
    start, step = point, FIRST_PUSH
    point = in_own_section(axis, point)
    while step > LAST_PUSH:
        try:
            point = in_own_section(axis, _pushed(holds, axis, point, sense * step))
            step *= PUSH_GROWTH
        except OrbitLost:
            step /= PUSH_GROWTH**2
        if abs(point.value - start.value) > GAP * axis.scale:
            return point, True
    for gap in GAPS:
        with suppress(OrbitLost):
            return _come_to(holds, axis, point, sense * gap), True
    return point, False


def across(holds: Holds, axis: Axis, point: Point, sense: float) -> tuple[Point, Point]:
    """The last orbit with the word of a point where its branch is lost, and the next one nearby with a property beyond it.

    Both are the same one where an orbit with that word goes on.

    Raises
    ------
    OrbitLost
        If there is none beyond.
    """
    word = word_of(point.fixed.image.passage)
    last, goes_on = _furthest(lambda orbit: word_of(orbit.fixed.image.passage) == word, axis, point, sense)
    if goes_on:
        return last, last
    for gap in GAPS:
        with suppress(OrbitLost):
            beyond = _come_to(holds, axis, last, sense * gap)
            return one_sided(axis, last, senses_of(axis, last, word.__eq__), last.tangent), beyond
    raise OrbitLost("the branch does not go on")


def _come_to(holds: Holds, axis: Axis, point: Point, by: float) -> Point:
    """The orbit with a property nearby where the parameter over its scale is greater by so much; its tangent points there.

    Its contact at the section of the point may be another one: it has a section of its own, that of the motion which the point
    comes to in a period.

    Raises
    ------
    OrbitLost
        If there is none.
    """
    value = point.value + by * axis.scale
    m = axis.map_at(point.map, value)
    own, z = settled_on(m, m.state(point.fixed.z), m.periods)
    fixed = solve(own, z, axis.spin_at(value))
    before, _ = point.map.sampled(point.fixed.image.passage, (own.phase - point.map.phase) % TURN)
    leap = own.section.point(own.state(fixed.z)) - own.section.point(before)
    if np.abs(leap).max() > JOINED:
        raise OrbitLost("another orbit is found")
    nxt = point_of(axis, fixed, value, None)
    if not holds(nxt):
        raise OrbitLost("the orbit nearby is another one")
    return nxt if by > 0 else nxt._replace(tangent=-nxt.tangent)


def stays_stable(axis: Axis, point: Point, sense: float) -> bool:
    """Whether there is a stable orbit nearby where the parameter is a little further in a sense (1 or -1)."""
    for by in GAPS:
        with suppress(OrbitLost):
            _come_to(is_stable, axis, point, sense * by)
            return True
    return False


def _pushed(holds: Holds, axis: Axis, point: Point, by: float) -> Point:
    """The orbit with a property nearby where the parameter over its scale is greater by so much; its tangent points there.

    Raises
    ------
    OrbitLost
        If there is none.
    """
    along = np.append(np.zeros(point.fixed.z.size), by)
    nxt = corrected(axis, point, point.y(axis) + along, along)
    if np.abs(nxt.fixed.z - point.fixed.z).max() > JOINED:
        raise OrbitLost("another orbit is found")
    if not holds(nxt):
        raise OrbitLost("the orbit nearby is another one")
    return nxt._replace(tangent=nxt.tangent if nxt.tangent[-1] * by > 0 else -nxt.tangent)


def _in_step(axis: Axis, a: Point, b: Point) -> Special:
    """Where stability is lost in a step."""
    for kind in BORDER_KINDS.values():
        if isinstance(kind, Bifurcation) and kind.test(a) * kind.test(b) < 0:
            special = located(axis, kind, a, b)
            if special is not None and kind.is_all(multipliers_of(special.point.fixed)[0]):
                return special
    low, high = _narrowed(axis, a, b)
    word, last = word_of(low.fixed.image.passage), word_of(high.fixed.image.passage)
    left, share = low, 0.0
    for _ in range(MOST_CHANGES):
        if word == last:
            break
        try:
            change = last_with(axis, word.__eq__, share, left, high)
        except OrbitLost:
            break
        if change.jump > JOINED or not _is_stable_beyond(axis, change.beyond, change.word):
            return Special(change_of(word, change.word), change.at, 0.0, change.jump, (word, change.word))
        left, share, word = change.beyond, change.share, change.word
    return Special(_kind_between(low, high), low, 0.0, 0.0, (word, last))


def _narrowed(axis: Axis, a: Point, b: Point) -> tuple[Point, Point]:
    """A stable and an unstable point of a short step, by halving."""
    low, high = 0.0, 1.0
    left, right = a, b
    length = float(np.linalg.norm(b.y(axis) - a.y(axis)))
    while (high - low) * length > NARROW_STRETCH:
        middle = 0.5 * (low + high)
        try:
            point = between(axis, a, b, middle)
        except OrbitLost:
            break
        if is_stable(point):
            low, left = middle, point
        else:
            high, right = middle, point
    return left, right


def _is_stable_beyond(axis: Axis, beyond: Point, word: str) -> bool:
    """Whether the first orbit beyond a change of word is stable, by derivatives to its own side."""
    try:
        return is_stable(one_sided(axis, beyond, senses_of(axis, beyond, word.__eq__), beyond.tangent))
    except OrbitLost:
        return False


def _kind_between(a: Point, b: Point) -> Kind:
    """The kind of change from one point to another one with all bounces counted."""
    words = [word_of(point.fixed.image.passage, whole=True) for point in (a, b)]
    return change_of(*words) if words[0] != words[1] else WORD


def _kind_beyond(axis: Axis, last: Point) -> Kind:
    """The kind of change where a branch does not go on, from images of points beyond, which are no orbits."""
    word = word_of(last.fixed.image.passage, whole=True)
    for by in AHEAD:
        y = last.y(axis) + by * last.tangent
        with suppress(OrbitLost):
            other = word_of(axis.map_at(last.map, y[-1] * axis.scale).image(y[:-1]).passage, whole=True)
            if other != word:
                return change_of(word, other)
    return WORD
