"""Events on a branch: folds, flips, tori, pitchforks, changes of sequence, and among these grazes.

At a graze an end comes down, turns in the air and just misses the plate. Where the gap at which it turns reaches zero,
an impact begins, and the map has a square root (Nordmark, doi 10.1016/0022-460X(91)90592-8). On the side of the impact
no derivative is of use. On the other side the map is smooth, and so is the gap. A branch may turn back at a graze: then
both orbits exist on one side of the parameter.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from dimersweep.analysis.orbits.continuation.branch import (
    NEAR_TURN,
    Equations,
    least_gap,
    lent,
    point_of,
    with_derivatives,
)
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS, FOLD, PITCHFORK, Kind, change_of
from dimersweep.analysis.orbits.continuation.steps import LEAP, LOCATED, SLOW_LEAP, Between, on_line, zero
from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, require
from dimersweep.analysis.orbits.map.manifold import eigenvector
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.passage import Passage
from dimersweep.analysis.orbits.map.poincare import JOINED, ReturnMap
from dimersweep.analysis.orbits.map.solution import Solution, fixed_at, solve

# largest number of changes of sequence in one step, and of gaps over which an orbit is found again on its way along a
# branch
MOST_CHANGES = 12
FURTHER = 30.0  # growth of the distance from a bracket at which the next orbit beyond it is looked for
# width of a bracket, in the parameter over its scale, at which a graze is looked for in it
GRAZING = 1e-3
BORN = 2e-3  # distance from a flip at which the doubled branch begins, in units of the section
# distances from a meeting of a branch with the plane within which its pitchfork is looked for, in the parameter over
# its scale
NEAR_FORK = (1e-3, 1e-2)
WIDE, NO_GAP = 0.05, 1e-9  # gap above which no impact is near, and gap that counts as zero, in units of the section
# ratio of the gap that is aimed at to the gap before, at first and at most; it rises where a step leads across, to the
# side of the impact
CLOSER, LEAST_CLOSER = 0.02, 0.7


def graze(near: Solution) -> tuple[Solution, str]:
    """Find the orbit near another one at which an end just misses the plate, and the sequence where the end strikes."""
    aim = gap = least_gap(near.map, near.passage)
    require(NO_GAP < gap < WIDE, "no end turns near the plate")

    equations = Equations(near, lambda _, m, passage: least_gap(m, passage) - aim)
    first = equations.derivative(near.y, min(near.map.step, 0.1 * gap))
    require(np.isfinite(first).all(), "the end strikes beside the orbit already")
    at, known, closer = near, first, CLOSER
    while gap > NO_GAP:
        aim = max(closer * gap, NO_GAP)
        try:
            at, latest = equations.solved(at.y, known=known)
        except OrbitLost:  # the step led across, to the side of the impact, or too far
            closer **= 0.5
            if closer > LEAST_CLOSER:
                raise
            continue
        gap, known, closer = aim, first if latest is None else latest, CLOSER
    opens = first[-1]
    at = with_derivatives(at._replace(tangent=opens), np.where(opens >= 0, 1.0, -1.0))
    beyond = at.axis.passage(at.map, at.y - at.map.one_sided * opens / np.abs(opens).max())
    marked = at.problem._replace(mark=least_gap)
    rows, slope = np.vstack([at.rows, opens[:-1]]), np.append(at.slope, opens[-1])
    return at._replace(problem=marked, rows=rows, slope=slope), beyond.sequence


def on_its_border(kind: Kind, orbit: PeriodicOrbit, free: bool) -> PeriodicOrbit:
    """Return the orbit of a point of a border, marked as not stable if a multiplier of its fast part has size 1 there.

    If the spin is `free`, the multiplier that is 1 at a fold is the slow one, and the orbit stays as it is.
    """
    return replace(orbit, stable=False) if kind.rows and not (free and kind is FOLD) else orbit


class Event(NamedTuple):
    """A point of a branch, with what happens there."""

    kind: Any  # `Kind` of border that the branch crosses there; None where it crosses none
    solution: Solution
    share: float = 1.0  # share of the step at which the point lies
    jump: float = 0.0  # jump of the orbit at a change of sequence, in units of the section
    sequences: tuple[str, str] = ("", "")  # sequences on both sides of a change of sequence
    beyond: Solution | None = None  # first orbit beyond a change of sequence


def events_in(a: Solution, b: Solution, sequences: bool = True) -> tuple[list[Event], Event | None]:
    """Return the events of a step of a branch in their order, and the change at which the branch leaps away.

    The second is the change of sequence beyond which lies another branch, or None.
    """
    changes: list[Event] = []
    for change in sequence_changes(a, b) if sequences else ():
        if change.jump > JOINED or len(changes) == MOST_CHANGES:
            return changes, change
        changes.append(change)
    at = on_line(a, b)
    found = [event for kind in BORDER_KINDS.values() if (event := located(kind, at)) is not None]
    return sorted([*found, *changes], key=lambda event: event.share), None


def located(kind: Kind, at: Between[Solution]) -> Event | None:
    """Return the zero of a kind's test function in a step, if the kind holds there.

    Return None if it does not, or if the function does not change its sign, or leaps over zero.
    """
    leap = SLOW_LEAP if at[0.0].axis.spin is None else LEAP
    way = at[1.0].y - at[0.0].y
    share = zero(at, kind.test, max(LOCATED / (abs(way[-1]) or float(np.linalg.norm(way))), 1e-14), leap)
    return None if share is None or not kind.holds(at[share]) else Event(kind, at[share], share)


def pitchfork_in(a: Solution, b: Solution) -> Event | None:
    """Return the pitchfork at which a branch of sustained spins parts from the motions in a plane.

    The step from `a` to `b` leads over the plane, to the mirror image of the branch. None is returned where the drift
    is not smooth about the plane: the spin falls exponentially there, and does not come to 0.
    """
    spins = [point.passage.spin for point in (a, b)]
    y = a.y + spins[0] / (spins[0] - spins[1]) * (b.y - a.y)
    value, along = float(y[-1] * a.axis.scale), np.eye(y.size)[-1]

    def beside_plane() -> Event | None:
        plane = point_of(a.axis._replace(spin=0.0), solve(a.axis.map_at(a.map, y[-1]), y[:-1], 0.0), value)
        for near in NEAR_FORK:
            sides = (plane.on_plane(plane.y + by * along, along) for by in (-near, near))
            if found := located(PITCHFORK, on_line(*sides)):
                return found
        return None

    return attempt(beside_plane)


def sequence_changes(a: Solution, b: Solution) -> Iterator[Event]:
    """Yield the changes of sequence between two points of a branch, one after the other."""
    low, left = 0.0, a
    while left.sequence != b.sequence:
        change = last_with(left.sequence.__eq__, low, left, b)
        yield change
        low, left = change.share, cast(Solution, change.beyond)


def last_with(holds: Callable[[str], bool], low: float, left: Solution, b: Solution) -> Event:
    """Return the change at which sequences cease to satisfy `holds`, between `left`, which satisfies it, and `b`.

    `low` is the share of the step at `left`; the step ends at `b`. Where an end that sticks begins to slip, friction
    falls from mu_s to mu at once, and the map leaps. For a little way there may be no orbit, which counts as beyond the
    change. Where an end begins to strike, the change is the graze. The derivatives at the point are those on its own
    side.
    """
    bracket = Bracket(holds, low, left, b)
    bracket.narrow(GRAZING)
    if grazing := attempt(bracket.grazing):
        return grazing
    bracket.narrow(LOCATED)
    at = on_own_side(bracket.left, holds)
    jump = float(np.abs(at.y - bracket.right.y).max())
    return _change(at, bracket.low, jump, (at.sequence, bracket.right.sequence), bracket.right)


def _change(at: Solution, share: float, jump: float, sequences: tuple[str, str], beyond: Solution) -> Event:
    """Return the change of sequence at a point, with the kind that leads from one sequence to the other."""
    return Event(change_of(*sequences), at, share, jump, sequences, beyond)


def on_own_side(at: Solution, holds: Callable[[str], bool]) -> Solution:
    """Return a point with derivatives that are taken, for each entry of y, to the side where `holds` is satisfied."""

    def kept(d: np.ndarray) -> bool:
        passage = attempt(at.axis.passage, at.map, at.y + d)
        return passage is not None and holds(passage.sequence)

    return with_derivatives(at, np.array([1.0 if kept(d) else -1.0 for d in at.map.one_sided * np.eye(at.y.size)]))


class Bracket:
    """A part of a step in which the sequence ceases to satisfy `holds`.

    The points are `left`, at the share `low` of the step, which satisfies it, and `right`, at the share `at_right`,
    which does not.
    """

    def __init__(self, holds: Callable[[str], bool], low: float, left: Solution, right: Solution) -> None:
        self.holds = holds
        self.low, self.left, self.right, self.at_right = low, left, right, 1.0
        # share of the nearest place beyond the change, where the sequence does not satisfy `holds`, or there is no
        # orbit
        self.high = 1.0
        self.begin, self.first, self.way = left.y, low, right.y - left.y
        self.length = max(abs(self.way[-1] / (1 - low)), LOCATED)
        self.steep = min(abs(left.tangent[-1]), abs(right.tangent[-1])) < NEAR_TURN
        # derivative of y by the parameter over its scale; near a fold it is not used
        self.slope = left.tangent if self.steep else left.tangent / left.tangent[-1]

    def narrow(self, width: float) -> None:
        """Halve the bracket down to a width, in the parameter over its scale; set `right` to the first orbit beyond.

        If the middle has no orbit, or an orbit whose sequence does not satisfy `holds`, it lies beyond the change.
        """
        for _ in range(MOST_CHANGES):
            while (self.high - self.low) * self.length > width:
                middle = 0.5 * (self.low + self.high)
                if not self._takes(middle):
                    self.high = middle
            # if no orbit beyond lies right at the end, the branch may go on there: Newton's method may have failed by
            # old derivatives
            if self._look_beyond() or not self._takes(2 * self.high - self.low, renewed=True):
                return
            self.high = self.at_right

    def _look_beyond(self) -> bool:
        """Set `right` to the next orbit that does not satisfy `holds`; return True if it lies right at `high`."""
        share, step = self.high, self.high - self.low
        while share < self.at_right:
            point = attempt(lambda share=share: lent(self.right, *self._plane(share), most=0))
            if point and not self.holds(point.sequence):
                self.right, self.at_right = point, share
                break
            share, step = share + step, FURTHER * step
        return self.at_right == self.high

    def _takes(self, share: float, renewed: bool = False) -> bool:
        """Move `left` to the orbit at a share of the step, found with its derivatives, which may be `renewed` before.

        Return False if there is none whose sequence satisfies `holds`.
        """
        y, normal = self._plane(share)

        def off_plane(there: np.ndarray, _: ReturnMap, passage: Passage) -> float:
            require(self.holds(passage.sequence), "the sequence changes")
            return float(normal @ (there - y))

        def found() -> Solution:
            near = with_derivatives(self.left) if renewed else self.left
            return Equations(near, off_plane).solved(y, known=np.vstack([near.derivative(), normal]))[0]

        if not (point := attempt(found)):
            return False
        way = point.y - self.left.y
        self.low, self.left = share, point
        if not self.steep:
            self.slope = way / way[-1]
        return True

    def _plane(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a point and a normal: the plane on which the orbit at a share of the step is looked for.

        The normal is the direction of the parameter, since the orbit may leap between the ends. Near a fold, where the
        parameter hardly changes, it is the direction from end to end.
        """
        start, part = self.left.y, (share - self.low) / (self.at_right - self.low)
        way = self.right.y - start
        if self.steep:
            return start + part * way, way / np.linalg.norm(way)
        return start + part * way[-1] * self.slope, np.eye(way.size)[-1]

    def grazing(self) -> Event:
        """Return the graze in the bracket over which `holds` changes."""
        near = min(self.left, self.right, key=lambda point: least_gap(point.map, point.passage))
        at, struck = graze(near)
        missed = at.sequence
        low, high = sorted((self.left.value, self.right.value))
        aside = GRAZING * at.axis.scale  # where the branch turns back at the graze, both ends lie on one side of it
        within = low - aside <= at.value <= high + aside
        require(within and self.holds(missed) != self.holds(struck), "no end grazes where the sequence changes")
        share = self.first + (1 - self.first) * ((at.y - self.begin) @ self.way) / (self.way @ self.way)
        if near is self.right:
            return _change(at, share, 0.0, (self.left.sequence, missed), at)
        return _change(at, share, 0.0, (self.left.sequence, struck), self.right)


def doubled(flip: Solution) -> Solution:
    """Return a point of the branch of twice the period, near the flip it leaves."""
    direction = eigenvector(flip.matrix, -1)
    tangent = np.append(direction / np.linalg.norm(direction), 0.0)
    y = flip.y + BORN * tangent
    m = replace(flip.map, periods=2 * flip.map.periods)
    try:
        return point_of(flip.axis, fixed_at(m, y[:-1]), flip.value)._replace(tangent=tangent).on_plane(y, tangent)
    except OrbitLost as reason:
        raise OrbitLost(f"no branch of twice the period was found ({reason})") from reason
