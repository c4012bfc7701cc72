"""Where a stable orbit ceases to be stable, or to be, along its branch.

That is a fold, a flip or a torus, or a change of word over which the multipliers leap, or beyond which there is no such orbit.
"""

from collections.abc import Callable, Collection
from contextlib import suppress
from itertools import takewhile
from typing import cast

import numpy as np

from dimersweep.errors import OrbitError
from dimersweep.orbits.branch import Axis, Point, one_sided, point_of
from dimersweep.orbits.continuation import SEARCHING, Between, halved, steps
from dimersweep.orbits.curve import Curve, Found
from dimersweep.orbits.finding import orbit_at, settled_on
from dimersweep.orbits.kinds import BORDER_KINDS, WORD, Kind, StabilityEnd, change_of
from dimersweep.orbits.labelling import Column
from dimersweep.orbits.manifold import multipliers_of
from dimersweep.orbits.newton import solve
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import OrbitLost
from dimersweep.orbits.specials import JOINED, MOST_CHANGES, Special, last_with, located, senses_of

NARROW_STRETCH = 1e-4  # length of a step in which stability is lost, from which on changes of word are looked for
GAP = 1e-2  # part of the parameter over which an orbit may be missing or leap
GAPS = (0.1 * GAP, GAP)  # beyond which it is taken up
FIRST_PUSH, LAST_PUSH, PUSH_GROWTH = 1e-5, 1e-9, 3.0  # steps of the parameter to the last stable orbit
AHEAD = (1e-5, 1e-4, 1e-3, 1e-2)  # how far beyond the last orbit of a branch the word is looked at

Holds = Callable[[Point], bool]  # a property of an orbit


def is_stable(point: Point) -> bool:
    """Whether all multipliers of the fast part at a point of a branch are below 1 in size."""
    return bool((np.abs(multipliers_of(point.fixed)[0]) < 1).all())


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
        if special.kind.rows:
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
        for a, b, _ in steps(axis, begin, SEARCHING):
            if not is_stable(b):
                return _in_step(axis, a, b)
            last = b
    except OrbitLost:
        if last is begin:
            raise
    else:
        raise OrbitLost(f"the orbit is stable over {SEARCHING.tries} points of its branch")
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
            for _, b, _ in takewhile(lambda step: holds(step[1]), steps(axis, point, SEARCHING)):
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
    point = axis.settled(point)
    while step > LAST_PUSH:
        try:
            point = axis.settled(_pushed(holds, axis, point, sense * step))
            step *= PUSH_GROWTH
        except OrbitLost:
            step /= PUSH_GROWTH**2
        if abs(point.value - start.value) > GAP * axis.scale:
            return point, True
    beyond = _beyond(holds, axis, point, sense)
    return (point, False) if beyond is None else (beyond, True)


def across(holds: Holds, axis: Axis, point: Point, sense: float) -> tuple[Point, Point]:
    """The last orbit with the word of a point where its branch is lost, and the next one nearby with a property beyond it.

    Both are the same one where an orbit with that word goes on.

    Raises
    ------
    OrbitLost
        If there is none beyond.
    """
    word = point.word
    last, goes_on = _furthest(lambda orbit: orbit.word == word, axis, point, sense)
    if goes_on:
        return last, last
    beyond = _beyond(holds, axis, last, sense)
    if beyond is None:
        raise OrbitLost("the branch does not go on")
    return one_sided(axis, last, senses_of(axis, last, word.__eq__), last.tangent), beyond


def stays_stable(axis: Axis, point: Point, sense: float) -> bool:
    """Whether there is a stable orbit nearby where the parameter is a little further in a sense (1 or -1)."""
    return _beyond(is_stable, axis, point, sense) is not None


def _beyond(holds: Holds, axis: Axis, point: Point, sense: float) -> Point | None:
    """The orbit with a property nearby where the parameter is a little further in a sense (1 or -1), if there is one."""
    for gap in GAPS:
        with suppress(OrbitLost):
            return _come_to(holds, axis, point, sense * gap)
    return None


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


def _pushed(holds: Holds, axis: Axis, point: Point, by: float) -> Point:
    """The orbit with a property nearby where the parameter over its scale is greater by so much; its tangent points there.

    Raises
    ------
    OrbitLost
        If there is none.
    """
    along = np.append(np.zeros(point.fixed.z.size), by)
    nxt = axis.on_plane(point, point.y(axis) + along, along)
    if np.abs(nxt.fixed.z - point.fixed.z).max() > JOINED:
        raise OrbitLost("another orbit is found")
    if not holds(nxt):
        raise OrbitLost("the orbit nearby is another one")
    return nxt._replace(tangent=nxt.tangent if nxt.tangent[-1] * by > 0 else -nxt.tangent)


def _in_step(axis: Axis, a: Point, b: Point) -> Special:
    """Where stability is lost in a step."""
    at = Between(axis, a, b)
    for kind in BORDER_KINDS.values():
        special = located(kind, at)
        if special is not None and kind.is_all(multipliers_of(special.point.fixed)[0]):
            return special
    low, high = (
        at[share] for share in halved(lambda share: is_stable(at[share]), 0.0, 1.0, NARROW_STRETCH / at.length)
    )
    word, last = low.word, high.word
    left, share = low, 0.0
    for _ in range(MOST_CHANGES):
        if word == last:
            break
        try:
            change = last_with(axis, word.__eq__, share, left, high)
        except OrbitLost:
            break
        left, share, word = cast(Point, change.beyond), change.share, change.words[1]
        if change.jump > JOINED or not _is_stable_beyond(axis, left, word):
            return change
    return Special(_kind_between(low, high), low, 0.0, 0.0, (word, last))


def _is_stable_beyond(axis: Axis, beyond: Point, word: str) -> bool:
    """Whether the first orbit beyond a change of word is stable, by derivatives to its own side."""
    try:
        return is_stable(one_sided(axis, beyond, senses_of(axis, beyond, word.__eq__), beyond.tangent))
    except OrbitLost:
        return False


def _kind_between(a: Point, b: Point) -> Kind:
    """The kind of change from one point to another one with all bounces counted."""
    words = [point.fixed.image.passage.whole_word for point in (a, b)]
    return change_of(*words) if words[0] != words[1] else WORD


def _kind_beyond(axis: Axis, last: Point) -> Kind:
    """The kind of change where a branch does not go on, from images of points beyond, which are no orbits."""
    word = last.fixed.image.passage.whole_word
    for by in AHEAD:
        y = last.y(axis) + by * last.tangent
        with suppress(OrbitLost):
            other = axis.map_at(last.map, y[-1] * axis.scale).image(y[:-1]).passage.whole_word
            if other != word:
                return change_of(word, other)
    return WORD


class StabilityCurve(Curve, of=StabilityEnd):
    """An end of the stretch of the parameter over which an orbit is stable: see `Curve`."""

    kind: StabilityEnd
    alone = True

    def point(self, values: dict[str, float], near: list[Found], start: PeriodicOrbit | None) -> Found:
        spent, reasons = self.tape.periods, list[str]()
        given = self.given | values
        starts = self._starts(given, reasons)
        if start is not None:
            starts = iter([orbit_at(given, self.spin, guess=start, rtol=self.rtol)])
        lacking = "no stable orbit"
        for orbit in starts:
            begin = self._begun(orbit)
            if orbit.stable:
                lacking = "no end of stability"
            try:
                special = stability_end(self.axis, begin._replace(tangent=self.kind.senses[0] * begin.tangent))
            except OrbitLost as reason:
                reasons.append(str(reason))
                continue
            found = self._found(special)
            return found._replace(loses=True, by=special.kind, cost=self.tape.periods - spent)
        raise OrbitError(f"{lacking} was found; {'; '.join(reasons)}")

    def _found(self, special: Special) -> Found:
        """The point of the end, with the spin put back where it is a bifurcation, as on curves of those."""
        if special.kind.rows:
            own = special.kind.curve(special.kind, self.parameter, special.point.map.parameters, self.spin, self.rtol)
            own.tape = self.tape
            with suppress(OrbitLost):
                return own.taken_up(special)
        return Found(orbit_of(special.point.fixed), special.point.value, special.point)

    def columns(self, found: Collection[Found]) -> dict[str, Column]:
        kinds = [one.by.name if one.by else "" for one in found]
        return {"ends_by": (kinds, "kind of border by which the stability ends")}
