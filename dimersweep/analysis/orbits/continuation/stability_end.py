"""The end of the stability, or of the existence, of a stable orbit along its branch.

It is a fold, a flip or a torus, or a change of sequence over which multipliers leap, or beyond which there is no such
orbit.
"""

from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import cast

import numpy as np

from dimersweep.analysis.orbits.continuation.branch import point_of
from dimersweep.analysis.orbits.continuation.events import (
    MOST_CHANGES,
    Event,
    located,
    on_own_side,
    pitchfork_in,
    sequence_changes,
)
from dimersweep.analysis.orbits.continuation.kinds import ANY_CHANGE, FLIP, FOLD, TORUS, Kind, change_of
from dimersweep.analysis.orbits.continuation.steps import SEARCHING, halved, on_line, steps
from dimersweep.analysis.orbits.map.finding import settled_on
from dimersweep.analysis.orbits.map.lost import OrbitLost, all_found, attempt, require
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import JOINED
from dimersweep.analysis.orbits.map.solution import Solution, solve

# length to which a step in which stability ends is halved before changes of sequence are looked for in it
NARROW_STRETCH = 1e-4
GAP = 1e-2  # greatest change of the parameter, over its scale, over which an orbit may be missing or leap
GAPS = (0.1 * GAP, GAP)  # such changes beyond which the orbit is looked for, in the order of trial
# first and last step of the parameter, over its scale, to the last stable orbit, and growth of a step that succeeds
FIRST_PUSH, LAST_PUSH, PUSH_GROWTH = 1e-5, 1e-9, 3.0

Holds = Callable[[Solution], bool]  # property of an orbit


def is_stable(point: Solution) -> bool:
    """Return True if all multipliers at a point of a branch are below 1 in size."""
    return bool((np.abs(point.multipliers) < 1).all())


def stability_end(begin: Solution) -> Event:
    """Find the end of the stability of an orbit along its branch, in the sense of the tangent.

    Its point is the bifurcation, or the last stable orbit before a change of sequence. Where the branch does not go on,
    but a stable orbit exists nearby at a parameter a little further, up to `GAP`, that orbit is followed instead. The
    end of the range of the parameter is no such end.
    """
    point, sense = begin, float(np.sign(begin.tangent[-1]))

    def same_side(other: Solution) -> bool:
        """Return True if an orbit is stable, and its spin, if that is free, has the sign of the first one."""
        mirrored = begin.axis.spin is None and begin.passage.spin * other.passage.spin < 0
        return is_stable(other) and not mirrored

    for _ in range(MOST_CHANGES):
        require(is_stable(point), "the orbit is unstable")
        last, beyond = _followed(same_side, point)
        event = Event(kind_beyond(last), last, 1.0) if beyond is None else _in_step(last, beyond)
        if not event.kind.of_sequence:
            return event
        last, goes_on = furthest(is_stable, event.solution, sense)
        if not goes_on:
            axis = last.axis
            bounded = f"the orbit is stable up to {axis.name} = {last.value:.6g}, the end of its range"
            require(attempt(axis.map_at, last.map, last.y[-1] + sense * 10 * LAST_PUSH), bounded)
            return event if last is event.solution else event._replace(kind=kind_beyond(last), solution=last)
        point = last
    raise OrbitLost("no end of stability is met")


def last_that(holds: Holds, begin: Solution) -> Solution:
    """Find the last orbit with a property along a branch, which ends at a change of sequence.

    The branch is followed in the sense of its first tangent.
    """
    require(holds(begin), "the first orbit is another one")
    point = begin
    for _ in range(MOST_CHANGES):
        point, goes_on = furthest(holds, _followed(holds, point)[0], float(np.sign(begin.tangent[-1])))
        if not goes_on:
            return point
    raise OrbitLost("no end is met")


def _followed(holds: Holds, begin: Solution) -> tuple[Solution, Solution | None]:
    """Return the last orbit of a branch with a property, and the orbit a step further without it, in one section.

    The second is None where the branch does not go on after a first step.
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


def furthest(holds: Holds, point: Solution, sense: float) -> tuple[Solution, bool]:
    """Return the last orbit with a property in steps of the parameter, and True if such orbits go on.

    The steps have the sense 1 or -1. If the orbits go on, by more than `GAP` or beyond a gap, the orbit returned is
    only the furthest one so far. Each step is taken in a section that suits the orbit, since an event that comes to the
    section is not the end of the orbit.
    """
    start, step = point, FIRST_PUSH
    point = point.settled()
    while step > LAST_PUSH:
        pushed = attempt(_pushed, holds, point, sense * step)
        step = step * PUSH_GROWTH if pushed else step / PUSH_GROWTH**2
        point = pushed or point
        if abs(point.value - start.value) > GAP * point.axis.scale:
            return point, True
    beyond = beyond_gap(holds, point, sense)
    return (point, False) if beyond is None else (beyond, True)


def across(holds: Holds, point: Solution, sense: float) -> tuple[Solution, Solution]:
    """Return the last orbit with the sequence of a point, and the next orbit beyond it with a property.

    Both are the same orbit where orbits with that sequence go on.
    """
    sequence = point.sequence
    last, goes_on = furthest(lambda orbit: orbit.sequence == sequence, point, sense)
    if goes_on:
        return last, last
    beyond = beyond_gap(holds, last, sense)
    require(beyond, "the branch does not go on")
    return on_own_side(last, sequence.__eq__), cast(Solution, beyond)


def beyond_gap(holds: Holds, point: Solution, sense: float) -> Solution | None:
    """Return the orbit with a property beyond a gap of the parameter, in the sense 1 or -1; None without one."""
    return next(all_found(partial(_come_to, holds, point, sense * gap) for gap in GAPS), None)


def _come_to(holds: Holds, point: Solution, by: float) -> Solution:
    """Find the orbit nearby with a property where the parameter over its scale is greater by `by`, in its own section.

    It has the best section of the motion that the point comes to in a period, since its contact at the section of the
    point may be another one. Its tangent has the sense of `by`.
    """
    axis, value = point.axis, point.value + by * point.axis.scale
    m = axis.map_at(point.map, value / axis.scale)
    own, z = settled_on(m, m.state(point.z), m.periods)
    fixed = solve(own, z, axis.spin_at(value))
    before, _ = point.map.sampled(point.passage, (own.phase - point.map.phase) % TURN)
    leap = own.section.point(own.state(fixed.z)) - own.section.point(before)
    return _accepted(holds, point_of(axis, fixed, value, by), leap)


def _pushed(holds: Holds, point: Solution, by: float) -> Solution:
    """Find the orbit nearby with a property where the parameter over its scale is greater by `by`, in the same section.

    Its tangent has the sense of `by`. It is returned in a section that suits it.
    """
    along = by * np.eye(point.y.size)[-1]
    nxt = point.on_plane(point.y + along, along)
    return _accepted(holds, nxt.towards(by), nxt.z - point.z).settled()


def _accepted(holds: Holds, nxt: Solution, leap: np.ndarray) -> Solution:
    """Return an orbit found nearby, whose leap is at most `JOINED`, and for which `holds` is true."""
    require(np.abs(leap).max() <= JOINED, "another orbit is found")
    require(holds(nxt), "the orbit nearby is another one")
    return nxt


def _in_step(a: Solution, b: Solution) -> Event:
    """Return the event at which stability ends in a step from `a`, which is stable, to `b`."""
    if is_stable(b):
        fork = pitchfork_in(a, b)
        require(fork, "the spin falls like an exponential, and does not come to 0")
        return cast(Event, fork)
    at = on_line(a, b)
    for kind in (FOLD, FLIP, TORUS):
        event = located(kind, at)
        if event is not None and kind.is_all(event.solution.multipliers):
            return event
    shares = halved(lambda share: is_stable(at[share]), 0.0, 1.0, NARROW_STRETCH / float(np.linalg.norm(b.y - a.y)))
    low, high = (at[share] for share in shares)
    ends = (
        change
        for change in islice(sequence_changes(low, high), MOST_CHANGES)
        if change.jump > JOINED or not _is_stable_on_own_side(cast(Solution, change.beyond))
    )
    if change := attempt(next, ends, None):
        return change
    whole = [point.passage.whole_sequence for point in (low, high)]
    change_there = change_of(*whole) if whole[0] != whole[1] else ANY_CHANGE
    return Event(change_there, low, 0.0, 0.0, (low.sequence, high.sequence))


def _is_stable_on_own_side(beyond: Solution) -> bool:
    """Return True if the first orbit beyond a change of sequence is stable, by derivatives to its own side."""
    return bool(attempt(lambda: is_stable(on_own_side(beyond, beyond.sequence.__eq__))))


def kind_beyond(last: Solution) -> Kind:
    """Return the kind of change at which a branch ends, from the sequences of points beyond, which are no orbits."""
    sequence = last.passage.whole_sequence
    ahead = (
        partial(last.axis.passage, last.map, last.y + by * last.tangent) for by in np.geomspace(FIRST_PUSH, GAP, 4)
    )
    others = (passage.whole_sequence for passage in all_found(ahead))
    return next((change_of(sequence, other) for other in others if other != sequence), ANY_CHANGE)
