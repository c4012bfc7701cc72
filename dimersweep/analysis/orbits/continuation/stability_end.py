"""Where a stable orbit ceases to be stable, or to be, along its branch.

That is a fold, a flip or a torus, or a change of sequence over which multipliers leap, or beyond which there is no such orbit.
"""

from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from typing import cast

import numpy as np

from dimersweep.analysis.orbits.continuation.branch import Point, point_of
from dimersweep.analysis.orbits.continuation.kinds import ANY_CHANGE, FLIP, FOLD, TORUS, Kind, change_of
from dimersweep.analysis.orbits.continuation.specials import (
    MOST_CHANGES,
    Special,
    located,
    on_own_side,
    pitchfork_in,
    sequence_changes,
)
from dimersweep.analysis.orbits.continuation.steps import SEARCHING, Between, halved, steps
from dimersweep.analysis.orbits.map.finding import settled_on
from dimersweep.analysis.orbits.map.newton import solve
from dimersweep.analysis.orbits.map.poincare import JOINED, TURN, OrbitLost

NARROW_STRETCH = 1e-4  # length of a step in which stability is lost, from which on changes of sequence are looked for
GAP = 1e-2  # part of the parameter over which an orbit may be missing or leap
GAPS = (0.1 * GAP, GAP)  # beyond which it is taken up
FIRST_PUSH, LAST_PUSH, PUSH_GROWTH = 1e-5, 1e-9, 3.0  # steps of the parameter to the last stable orbit

Holds = Callable[[Point], bool]  # a property of an orbit


def is_stable(point: Point) -> bool:
    """Whether the multipliers at a point of a branch are below 1 in size."""
    return bool((np.abs(point.multipliers) < 1).all())


def stability_end(begin: Point) -> Special:
    """The end of the stability of an orbit, along its branch in the sense of the tangent; lost if none is met.

    Its point is that of the bifurcation, or the last stable orbit before a change of sequence. Where the branch does not go on
    but a stable orbit exists nearby at a parameter a little further, up to `GAP`, that one is taken up.
    """
    point, sense = begin, float(np.sign(begin.tangent[-1]))

    def same_side(other: Point) -> bool:
        """Whether an orbit is stable, and no mirror image of those before, to which sustained spins lead over a plane."""
        mirrored = begin.axis.spin is None and begin.fixed.image.spin * other.fixed.image.spin < 0
        return is_stable(other) and not mirrored

    for _ in range(MOST_CHANGES):
        if not is_stable(point):
            raise OrbitLost("the orbit is unstable")
        last, beyond = _followed(same_side, point)
        special = Special(kind_beyond(last), last, 1.0) if beyond is None else _in_step(last, beyond)
        if not special.kind.of_sequence:
            return special
        last, goes_on = furthest(is_stable, special.point, sense)
        if not goes_on:
            axis = last.axis
            try:  # the end of what the parameter may be is no end of stability
                axis.map_at(last.map, last.y[-1] + sense * 10 * LAST_PUSH)
            except OrbitLost as reason:
                raise OrbitLost(
                    f"the orbit is stable up to {axis.name} = {last.value:.6g}, the end of its range"
                ) from reason
            return special if last is special.point else special._replace(kind=kind_beyond(last), point=last)
        point = last
    raise OrbitLost("no end of stability is met")


def last_that(holds: Holds, begin: Point) -> Point:
    """The last orbit with a property, in the sense of the tangent of the first, where it is lost by a change of sequence.

    It is lost if the first orbit does not have the property, or all that are met have it.
    """
    point, goes_on = begin, holds(begin)
    if not goes_on:
        raise OrbitLost("the first orbit is another one")
    for _ in range(MOST_CHANGES):
        point, goes_on = furthest(holds, _followed(holds, point)[0], float(np.sign(begin.tangent[-1])))
        if not goes_on:
            return point
    raise OrbitLost("no end is met")


def _followed(holds: Holds, begin: Point) -> tuple[Point, Point | None]:
    """The last orbit of a branch with a property, and the one a step further without it, in its section, if there is one.

    It is lost if no step is possible, or all steps lead to such orbits.
    """
    last = None
    try:
        for a, b, _ in steps(begin, SEARCHING):
            if not holds(b):
                return a, b
            last = b
    except OrbitLost:
        if last is None:
            raise
        return last, None
    raise OrbitLost(f"the orbit is stable over {SEARCHING.tries} points of its branch")


def furthest(holds: Holds, point: Point, sense: float) -> tuple[Point, bool]:
    """The last orbit with a property in steps of the parameter, and whether such an orbit goes on beyond.

    Each step is taken in a section that suits the orbit: an event that comes to the section is not the end of the orbit.
    """
    start, step = point, FIRST_PUSH
    point = point.settled()
    while step > LAST_PUSH:
        try:
            point = _pushed(holds, point, sense * step).settled()
            step *= PUSH_GROWTH
        except OrbitLost:
            step /= PUSH_GROWTH**2
        if abs(point.value - start.value) > GAP * point.axis.scale:
            return point, True
    beyond = beyond_gap(holds, point, sense)
    return (point, False) if beyond is None else (beyond, True)


def across(holds: Holds, point: Point, sense: float) -> tuple[Point, Point]:
    """The last orbit with the sequence of a point where its branch is lost, and the next one nearby with a property beyond it.

    Both are the same one where an orbit with that sequence goes on. It is lost if there is none beyond.
    """
    sequence = point.sequence
    last, goes_on = furthest(lambda orbit: orbit.sequence == sequence, point, sense)
    if goes_on:
        return last, last
    beyond = beyond_gap(holds, last, sense)
    if beyond is None:
        raise OrbitLost("the branch does not go on")
    return on_own_side(last, sequence.__eq__), beyond


def beyond_gap(holds: Holds, point: Point, sense: float) -> Point | None:
    """The orbit with a property nearby where the parameter is a little further in a sense (1 or -1), if there is one."""
    for gap in GAPS:
        with suppress(OrbitLost):
            return _come_to(holds, point, sense * gap)
    return None


def _come_to(holds: Holds, point: Point, by: float) -> Point:
    """The orbit with a property nearby where the parameter over its scale is greater by so much; its tangent points there.

    Its contact at the section of the point may be another one: it has a section of its own, that of the motion which the point
    comes to in a period. It is lost if there is none.
    """
    axis, value = point.axis, point.value + by * point.axis.scale
    m = axis.map_at(point.map, value / axis.scale)
    own, z = settled_on(m, m.state(point.fixed.z), m.periods)
    fixed = solve(own, z, axis.spin_at(value))
    before, _ = point.map.sampled(point.fixed.image.passage, (own.phase - point.map.phase) % TURN)
    leap = own.section.point(own.state(fixed.z)) - own.section.point(before)
    return _accepted(holds, point_of(axis, fixed, value, by), leap)


def _pushed(holds: Holds, point: Point, by: float) -> Point:
    """The orbit with a property nearby where the parameter over its scale is greater by so much; its tangent points there."""
    along = by * np.eye(point.y.size)[-1]
    nxt = point.on_plane(point.y + along, along)
    return _accepted(holds, nxt.towards(by), nxt.fixed.z - point.fixed.z)


def _accepted(holds: Holds, nxt: Point, leap: np.ndarray) -> Point:
    """An orbit found nearby; lost if it is far off, or does not have a property."""
    if np.abs(leap).max() > JOINED:
        raise OrbitLost("another orbit is found")
    if not holds(nxt):
        raise OrbitLost("the orbit nearby is another one")
    return nxt


def _in_step(a: Point, b: Point) -> Special:
    """Where stability is lost in a step."""
    if is_stable(b):
        if fork := pitchfork_in(a, b):
            return fork
        raise OrbitLost("the spin falls like an exponential, and does not come to 0")
    at = Between(a, b)
    bifurcations: tuple[Kind, ...] = (FOLD, FLIP, TORUS)
    for kind in bifurcations:
        special = located(kind, at)
        if special is not None and kind.is_all(special.point.multipliers):
            return special
    shares = halved(lambda share: is_stable(at[share]), 0.0, 1.0, NARROW_STRETCH / at.length)
    low, high = (at[share] for share in shares)
    with suppress(OrbitLost):
        for change in islice(sequence_changes(low, high), MOST_CHANGES):
            if change.jump > JOINED or not _is_stable_on_own_side(cast(Point, change.beyond)):
                return change
    whole = [point.fixed.image.passage.whole_sequence for point in (low, high)]
    change_there = change_of(*whole) if whole[0] != whole[1] else ANY_CHANGE
    return Special(change_there, low, 0.0, 0.0, (low.sequence, high.sequence))


def _is_stable_on_own_side(beyond: Point) -> bool:
    """Whether the first orbit beyond a change of sequence is stable, by derivatives to its own side."""
    with suppress(OrbitLost):
        return is_stable(on_own_side(beyond, beyond.sequence.__eq__))
    return False


def kind_beyond(last: Point) -> Kind:
    """The kind of change where a branch does not go on, from images of points beyond, which are no orbits."""
    sequence = last.fixed.image.passage.whole_sequence
    for by in np.geomspace(FIRST_PUSH, GAP, 4):
        with suppress(OrbitLost):
            other = last.axis.image(last.map, last.y + by * last.tangent).passage.whole_sequence
            if other != sequence:
                return change_of(sequence, other)
    return ANY_CHANGE
