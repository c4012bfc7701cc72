"""Special points of a branch: folds, flips, tori, changes of word, and among these where an end grazes.

There an end comes down, turns in the air and just misses the plate. Where the gap at which it turns is zero an impact begins,
and the map has a square root (Nordmark, doi 10.1016/0022-460X(91)90592-8): on the side of the impact no derivative is of use.
On the other side the map is smooth, and so is that gap. A branch may turn back there, so that both orbits exist on one side of
the parameter.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from scipy.optimize import brentq

from dimersweep.kernel.model.layout import D1, FREE, N1
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.orbits.branch import Axis, Equations, Point, lent, one_sided, slope_of, with_derivatives
from dimersweep.orbits.continuation import LOCATED, Between, zero
from dimersweep.orbits.kinds import BORDER_KINDS, Kind, change_of
from dimersweep.orbits.newton import fixed_at
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import Image, OrbitLost, ReturnMap

GAP_SAMPLES = 64  # in a forcing period, of an end in the air
TURN_KNOWN = 1e-7  # how well the time is known at which an end turns [rad]: the gap does not change to first order
WIDE, NO_GAP = 0.05, 1e-9  # gap beyond which no impact is near; gap that counts as none, in units of the section
CLOSER, LEAST_CLOSER = 0.02, 0.7  # gap that is aimed at, over the one before: a step must not lead across
ACROSS = 1e-6  # distance to which a point across is taken, in units of the section


def least_gap(m: ReturnMap, image: Image) -> float:
    """The least gap at which an end turns in the air, in units of the section; infinite where none does."""
    passage = image.passage
    lengths, segments = np.diff(passage.times), passage.segments
    least = np.inf
    for end in (0, 1):
        free = (segments[:-1, SEGMENT_MODES + end] == FREE) & (segments[:-1, SEGMENT_HOP_TIME] == 0)
        for k in np.flatnonzero(free & (lengths > TURN / GAP_SAMPLES)).tolist():

            def of_end(phases: np.ndarray, k: int = k, end: int = end) -> tuple[np.ndarray, np.ndarray]:
                states, _ = m.states(passage, k, phases)
                return states[:, D1 + end], states[:, N1 + end]

            phases = np.linspace(passage.times[k], passage.times[k + 1], int(GAP_SAMPLES * lengths[k] / TURN) + 2)
            rates = of_end(phases)[1]
            for j in np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0)):
                try:
                    turns = brentq(lambda at: of_end(np.array([at]))[1][0], phases[j], phases[j + 1], xtol=TURN_KNOWN)
                except ValueError as error:  # a rate by the rounding of which one end has the other's sign
                    raise OrbitLost(f"no time is found at which an end turns ({error})") from error
                least = min(least, float(of_end(np.array([turns]))[0][0] / m.section.units[0]))
    return least


def graze(axis: Axis, near: Point) -> tuple[Point, str]:
    """The orbit near one at which an end just misses the plate, and the word beyond, where it strikes.

    Parameters
    ----------
    axis : Axis
    near : Point
        At which an end turns near the plate.

    Raises
    ------
    OrbitLost
        If no end does, or none is found.
    """
    aim = gap = least_gap(near.map, near.fixed.image)
    if not NO_GAP < gap < WIDE:
        raise OrbitLost("no end turns near the plate")

    equations = Equations(axis, near, lambda _, m, image: least_gap(m, image) - aim)
    first = equations.derivative(near.y(axis), min(near.fixed.map.step, 0.1 * gap))
    if not np.isfinite(first).all():
        raise OrbitLost("the end strikes beside the orbit already")
    at, known, closer = near, first, CLOSER
    while gap > NO_GAP:
        aim = max(closer * gap, NO_GAP)
        try:
            at, latest = equations.solved(at.y(axis), known=known)
        except OrbitLost:  # the step led across, or too far
            closer **= 0.5
            if closer > LEAST_CLOSER:
                raise
            continue
        gap, known, closer = aim, first if latest is None else latest, CLOSER
    opens = first[-1]
    at = one_sided(axis, at, np.where(opens >= 0, 1.0, -1.0), opens)
    return at._replace(mark_slope=opens, grazes=True), _word_beyond(axis, at, opens)


def _word_beyond(axis: Axis, at: Point, gap_slope: np.ndarray) -> str:
    beyond = at.y(axis) - ACROSS * gap_slope / np.abs(gap_slope).max()
    m = axis.map_at(at.fixed.map, beyond[-1] * axis.scale)
    return m.image(beyond[:-1]).passage.word


MOST_CHANGES = 12  # word changes within one step; places at which an orbit is lost and found again
JOINED = 0.1  # distance of points on both sides of a change of word that belong to one branch, in units of the section
SHORTEST_SHARE = 1e-10  # share of a step to which a change of word is located where the parameter hardly changes
NEAR_FOLD = 0.05  # part of the parameter in a tangent below which a fold is near
FURTHER = 30.0  # from one place beyond a bracket at which an orbit is looked for to the next
GRAZING = 1e-3  # width of a bracket, in the parameter over its scale, from which on an end is looked for that grazes
BORN = 2e-3  # distance from a flip at which the doubled branch is taken up, in units of the section


class Special(NamedTuple):
    """A special point of a branch.

    Attributes
    ----------
    kind : Kind
        Of border that the branch crosses there.
    point : Point
    share : float
        Of the step at which it lies.
    jump : float
        Of the orbit at a change of word, in units of the section.
    words : tuple of str
        On both sides of it.
    beyond : Point, optional
        The first orbit beyond it.
    """

    kind: Kind
    point: Point
    share: float
    jump: float = 0.0
    words: tuple[str, str] = ("", "")
    beyond: Point | None = None


def specials(axis: Axis, a: Point, b: Point, words: bool = True) -> tuple[list[Special], Special | None]:
    """Special points of a step of a branch, in their order, and the change of word at which it leaps to another branch."""
    changes, leap = word_changes(axis, a, b) if words else ([], None)
    if leap is not None:
        return changes, leap
    at = Between(axis, a, b)
    found = [special for kind in BORDER_KINDS.values() if (special := located(kind, at)) is not None]
    return sorted([*found, *changes], key=lambda special: special.share), None


def located(kind: Kind, at: Between[Point]) -> Special | None:
    """The zero of a kind's test function in a step; none if the function does not change its sign, or leaps over zero."""
    length = abs(at.problem.y(at.a)[-1] - at.problem.y(at.b)[-1]) or at.length
    share = zero(at, kind.test, max(LOCATED / length, 1e-14))
    return None if share is None else Special(kind, at[share], share)


def word_changes(axis: Axis, a: Point, b: Point) -> tuple[list[Special], Special | None]:
    """Where the word changes between two points of a branch, and the change beyond which the next orbit is another branch's."""
    found: list[Special] = []
    low, left = 0.0, a
    while left.word != b.word:
        change = last_with(axis, left.word.__eq__, low, left, b)
        if change.jump > JOINED or len(found) == MOST_CHANGES:
            return found, change
        found.append(change)
        low, left = change.share, cast(Point, change.beyond)
    return found, None


def last_with(axis: Axis, holds: Callable[[str], bool], low: float, left: Point, b: Point) -> Special:
    """Where words cease to satisfy `holds`, between `left`, at which they do, and the end of the step, `b`.

    Where an end that sticks begins to slip, friction falls from mu_s to mu at once, and the map leaps: for a little way there
    may be no orbit, which counts as beyond the change. Where an end begins to strike, the change is where it grazes. The
    derivatives at the point are those on its own side.
    """
    bracket = Bracket(axis, holds, low, left, b)
    bracket.narrow(GRAZING)
    with suppress(OrbitLost):
        return bracket.grazing()
    bracket.narrow(LOCATED)
    at = one_sided(axis, bracket.left, senses_of(axis, bracket.left, holds), bracket.left.tangent)
    jump = float(np.abs(at.y(axis) - bracket.right.y(axis)).max())
    return _change(at, bracket.low, jump, (at.word, bracket.right.word), bracket.right)


def _change(at: Point, share: float, jump: float, words: tuple[str, str], beyond: Point) -> Special:
    return Special(change_of(*words), at, share, jump, words, beyond)


def senses_of(axis: Axis, at: Point, holds: Callable[[str], bool]) -> np.ndarray:
    """The side (1 or -1) to which each coordinate and the parameter may move so that the word still satisfies `holds`."""
    m, y = at.map, at.y(axis)

    def kept(d: np.ndarray) -> bool:
        with suppress(OrbitLost):
            there = y + d
            return holds(axis.map_at(m, there[-1] * axis.scale).image(there[:-1]).passage.word)
        return False

    return np.array([1.0 if kept(d) else -1.0 for d in m.one_sided * np.eye(y.size)])


class Bracket:
    """A part of a step: at its start the word satisfies a condition, at its end it does not.

    Parameters
    ----------
    axis : Axis
    holds : callable
        The condition on a word: that of `left` satisfies it, that of `right` does not.
    low : float
        Share of the step at `left`; `right` is its end.
    left, right : Point
    """

    def __init__(self, axis: Axis, holds: Callable[[str], bool], low: float, left: Point, right: Point) -> None:
        self.axis, self.holds = axis, holds
        self.low, self.left, self.right, self.at_right = low, left, right, 1.0
        self.high = 1.0  # from here on the word does not satisfy it, or there was no orbit
        self.begin, self.first, self.way = left.y(axis), low, right.y(axis) - left.y(axis)
        self.length = max(abs(self.way[-1] / (1 - low)), LOCATED)
        self.steep = min(abs(left.tangent[-1]), abs(right.tangent[-1])) < NEAR_FOLD
        self.slope = left.tangent if self.steep else left.tangent / left.tangent[-1]  # by the parameter over its scale

    def narrow(self, width: float) -> None:
        """Halve the bracket until it is so wide, in the parameter over its scale."""
        for _ in range(MOST_CHANGES):
            self._halve(width)
            if self._look_beyond() or not self._goes_on():
                return

    def _halve(self, width: float) -> None:
        """Halve the bracket until it is so wide, with the derivatives at its end.

        Where the image of the middle has another word, the middle lies beyond, whether there is an orbit or not.
        """
        while (self.high - self.low) * self.length > width and self.high - self.low > SHORTEST_SHARE:
            middle = 0.5 * (self.low + self.high)
            try:
                self._take(middle, self._obeys(middle, self.left))
            except OrbitLost:
                self.high = middle

    def _look_beyond(self) -> bool:
        """Find the next orbit beyond with another word; whether it lies right at the end of the bracket."""
        share, step = self.high, self.high - self.low
        while share < self.at_right:
            with suppress(OrbitLost):
                point = lent(self.axis, self.right, *self._plane(share), most=0)
                if not self.holds(point.word):
                    self.right, self.at_right = point, share
                    break
            share, step = share + step, FURTHER * step
        return self.at_right == self.high

    def _goes_on(self) -> bool:
        """Whether the orbit is found further on with derivatives taken anew; the bracket is then moved there."""
        with suppress(OrbitLost):
            share = 2 * self.high - self.low
            self._take(share, self._obeys(share, with_derivatives(self.axis, self.left, self.left.tangent)))
            self.high = self.at_right
            return True
        return False

    def _obeys(self, share: float, near: Point) -> Point:
        """The orbit at a share of the step, with the derivatives of a point nearby.

        Raises
        ------
        OrbitLost
            If there is none, or its word does not satisfy the condition.
        """
        y, normal = self._plane(share)

        def off_plane(there: np.ndarray, _: ReturnMap, image: Image) -> float:
            if not self.holds(image.passage.word):
                raise OrbitLost("the word changes")
            return float(normal @ (there - y))

        known = np.vstack([near.matrix(), normal])
        return Equations(self.axis, near, off_plane).solved(y, known=known)[0]

    def _plane(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Where the branch may be at a share of the step, and the direction across which it is looked for there.

        That is the parameter: from end to end the orbit may leap. Near a fold, where the parameter hardly changes, it is the
        line from end to end.
        """
        start, part = self.left.y(self.axis), (share - self.low) / (self.at_right - self.low)
        way = self.right.y(self.axis) - start
        if self.steep:
            return start + part * way, way / np.linalg.norm(way)
        return start + part * way[-1] * self.slope, np.append(np.zeros(way.size - 1), 1.0)

    def _take(self, share: float, point: Point) -> None:
        way = point.y(self.axis) - self.left.y(self.axis)
        self.low, self.left = share, point
        if not self.steep:
            self.slope = way / way[-1]

    def grazing(self) -> Special:
        """Where an end grazes in the bracket.

        Raises
        ------
        OrbitLost
            If none does, or the words on both sides of the graze satisfy the condition alike.
        """
        axis = self.axis
        near = min(self.left, self.right, key=lambda point: least_gap(point.map, point.fixed.image))
        at, struck = graze(axis, near)
        missed = at.word
        low, high = sorted((self.left.value, self.right.value))
        aside = GRAZING * axis.scale  # the branch may turn back at the graze
        if not low - aside <= at.value <= high + aside or self.holds(missed) == self.holds(struck):
            raise OrbitLost("no end grazes where the word changes")
        share = self.first + (1 - self.first) * ((at.y(axis) - self.begin) @ self.way) / (self.way @ self.way)
        if near is self.right:
            return _change(at, share, 0.0, (self.left.word, missed), at)
        return _change(at, share, 0.0, (self.left.word, struck), self.right)


def doubled(axis: Axis, flip: Point) -> Point:
    """The branch of twice the period that leaves a flip, a little way along it.

    Raises
    ------
    OrbitLost
        If none is found.
    """
    old = flip.fixed.map
    values, vectors = np.linalg.eig(flip.fixed.matrix)
    direction = vectors[:, int(np.argmin(np.abs(values + 1)))].real
    tangent = np.append(direction / np.linalg.norm(direction), 0.0)
    m = replace(old, periods=2 * old.periods)
    y = flip.y(axis) + BORN * tangent
    z = y[:-1]
    near = Point(fixed_at(m, z), flip.value, slope_of(axis, m, z, flip.value), tangent)
    return axis.on_plane(near, y, tangent)
