"""Curves along which the word of an orbit changes.

Where an end grazes, or a hop lasts half a period, the border is the zero of a function of the orbit (a mark), and Newton's
method finds it from where the tangent of the curve leads. Elsewhere the orbit may leap, and the border is enclosed between two
orbits.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import cast

import numpy as np

from dimersweep.orbits.branch import Equations, Mark, Point, in_own_section, lent, with_mark
from dimersweep.orbits.curve import FollowedCurve, Found
from dimersweep.orbits.grazing import graze, least_gap
from dimersweep.orbits.kinds.changes import WORD
from dimersweep.orbits.kinds.kind import Change
from dimersweep.orbits.newton import defect
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost
from dimersweep.orbits.specials import Special, last_with
from dimersweep.orbits.stability_end import WALK_POINTS, is_stable, last_that, stays_stable, walked
from dimersweep.orbits.word import Sides, far_ends, rests, sides_of, word_of

SAME_CHANGE = 1e-7  # distance of two changes of word that are one, in the parameter over its scale
POINT_REACH = 0.2  # of a point of a curve from where it is looked for, in units of the section
WIDEST, NARROWEST, WIDER = 0.05, 2e-5, 4.0  # bracket of a change of word, in the parameter over its scale
DOUBT, LESS = 4e-3, 0.08  # of a point with one neighbour; of one on the line through two, in the step between them
OPENED = (1e-2, 1e-1)  # ways along the branch, in units of the section, from which a grazing orbit is looked for
MOST_DERIVATIVES = 3  # new derivatives at a point: where Newton's method asks for more, the motion is another one
TANGENT_SHARE = 1e-3  # of the way to the next point, over which a derivative is taken


def comes_to_rest(point: Point) -> bool:
    """Whether an end stays on the plate for a part of the period."""
    return rests(word_of(point.fixed.image.passage))


class WordCurve(FollowedCurve):
    """A curve along which the word changes: see `Curve`."""

    kind: Change
    words = True

    def status(self, found: Found) -> str:
        if found.sides is None:
            return "several beyond, of motions that come to no rest"
        if self.kind.once and rests(found.orbit.word):
            return "ok"
        return f"one of {len(found.several)}" if found.several else "one of several"

    def _is_met(self, special: Special, like: Sides | None) -> bool:
        if not isinstance(special.kind, Change) or self.kind not in (WORD, special.kind):
            return False
        return like is None or like.between(*special.words)

    def taken_up(self, special: Special) -> Found:
        at = special.point
        return self._found(at, sides_of(*special.words, self.kind.begins), float(np.sign(at.tangent[-1])))

    def _from(self, orbit: PeriodicOrbit, like: Sides | None) -> Found:
        try:
            found = super()._from(orbit, like)
        except OrbitLost:
            if not orbit.stable or far_ends(orbit.word) != 1:
                raise
            return self._to_pieces(orbit)
        if self.kind.once or not orbit.stable:
            return found
        values = [value for way in self.senses for value in self._while_stable(self._begun(orbit), way)]
        if all(abs(value - found.value) > SAME_CHANGE * self.axis.scale for value in values):
            values.append(found.value)
        return found._replace(several=tuple(sorted(values)))

    def _while_stable(self, begin: Point, sense: float) -> Iterator[float]:
        """Values of the parameter at which the word changes so, along a branch while its orbit is stable."""
        with suppress(OrbitLost):
            for a, b in walked(self.axis, begin._replace(tangent=sense * begin.tangent)):
                yield from (special.point.value for special in self._specials(a, b) if self._is_met(special, None))
                if not is_stable(b):
                    return

    def _met(self, point: Point, like: Sides | None) -> Special:
        """On a motion of which an end comes to rest; beyond, steps lead from one piece of the branch to any other."""
        came_to_rest = comes_to_rest(point)
        for a, b in walked(self.axis, point):
            for special in self._specials(a, b):
                if came_to_rest and not comes_to_rest(special.point):
                    break
                if self._is_met(special, like):
                    return special
            if came_to_rest and not comes_to_rest(b):
                raise OrbitLost(f"no end comes to rest beyond {self.parameter} = {a.value:.3g}")
        raise OrbitLost(f"none within {WALK_POINTS} points of the branch")

    def _to_pieces(self, orbit: PeriodicOrbit) -> Found:
        """The last orbit of which an end comes to rest: beyond it is a border for each number of bounces.

        Raises
        ------
        OrbitLost
            If the branch does not go to pieces.
        """
        begin = self._begun(orbit)
        for sense in self.senses:
            with suppress(OrbitLost):
                last = last_that(comes_to_rest, self.axis, begin._replace(tangent=sense * begin.tangent))
                return Found(orbit_of(last.fixed), last.value, in_own_section(self.axis, last))
        raise OrbitLost(f"no {self.kind.name} is met")

    def is_sure(self, found: Found) -> bool:
        """Where there is one such change only."""
        return self.status(found) == "ok"

    def _found(self, at: Point, sides: Sides, sense: float) -> Found:
        """A point of the curve, in a section that suits the next one.

        Beyond it the parameter changes in the `sense` (1 or -1); 0 where the map is smooth, and nothing but the word changes.
        """
        if at.grazes:
            sense = -float(np.sign(cast(np.ndarray, at.mark_slope)[-1]))  # the end strikes there
        leaps = sense != 0.0 and (self.kind.zero is None or at.grazes)
        loses = leaps and is_stable(at) and not stays_stable(self.axis, at, sense)
        return Found(orbit_of(at.fixed), at.value, in_own_section(self.axis, at), sides, loses)

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        last, sides = near[0].begin, near[0].sides
        if sides is None:
            raise OrbitLost("the branch of the neighbour goes to pieces")
        if last.grazes:
            with suppress(OrbitLost):
                return self._graze(given, last, sides)
        elif self.kind.zero and (mark := self.kind.zero(sides)):
            with suppress(OrbitLost):
                return self._zero(given, last, sides, mark)
        reason = OrbitLost("")
        for y, doubt in self._guesses([one for one in near if one.begin.grazes == last.grazes]):
            try:
                return self._between(given, last, sides, y, doubt)
            except OrbitLost as error:
                reason = error
        raise reason

    # --- between two orbits ----------------------------------------------------------------------------------------

    def _guesses(self, near: list[Found]) -> Iterator[tuple[np.ndarray, float]]:
        """Where a change is looked for, and how well its parameter over its scale is known there."""
        if len(near) == 1:
            yield self.extrapolated(near), DOUBT
            return
        y = self.extrapolated(near)
        yield y, abs(y[-1] - self.extrapolated(near[:-1])[-1])
        yield self.extrapolated(near[:2]), LESS * abs(near[0].value - near[1].value) / self.axis.scale

    def _between(self, given: dict[str, float], near: Point, sides: Sides, y: np.ndarray, doubt: float) -> Found:
        """The last orbit on this side of a change: between two orbits on both sides of the guess `y`.

        The guess has the parameter, over its scale, as its last entry, known to about `doubt`.
        """
        width = min(WIDEST, max(NARROWEST, doubt))
        while width <= WIDEST:
            ends = [self._at(given, near, np.append(y[:-1], y[-1] + by)) for by in (-width, width)]
            words = [word_of(end.fixed.image.passage) for end in ends]
            if sides.between(*words):
                this, other = ends if sides.here(words[0]) else ends[::-1]
                change = last_with(self.axis, sides.here, 0.0, this, other)
                if not sides.beyond(change.word):
                    raise OrbitLost(f"another change is nearer at {self.parameter} = {change.at.value:.6g}")
                return self._found(change.at, sides, float(np.sign(other.value - this.value)))
            width *= WIDER
        at = y[-1] * self.axis.scale
        raise OrbitLost(f"no change of word within {WIDEST * self.axis.scale:.2g} of {self.parameter} = {at:.6g}")

    # --- the zero of a mark ----------------------------------------------------------------------------------------

    def _graze(self, given: dict[str, float], near: Point, sides: Sides) -> Found:
        """The orbit at which an end just misses the plate, and beyond which it strikes: found from where its gap is wider."""
        y, _ = self._ahead(given, near, least_gap)
        for opened in OPENED:
            with suppress(OrbitLost):
                wider = in_own_section(self.axis, self._at(given, near, y + opened * near.tangent))
                at, struck = graze(self.axis, wider)
                near_by = np.abs(at.value / self.axis.scale - y[-1]) <= WIDEST
                if near_by and sides.between(word_of(at.fixed.image.passage), struck):
                    return self._found(at, sides, 0.0)
        raise OrbitLost(f"no end grazes where the word changes near {self.parameter} = {y[-1] * self.axis.scale:.6g}")

    def _zero(self, given: dict[str, float], near: Point, sides: Sides, mark: Mark) -> Found:
        """The orbit at which the function of the kind is zero."""
        y, known = self._ahead(given, near, mark)
        beside = self._beside(given, near, y)
        equations = Equations(self.axis, beside, lambda _, m, image: mark(m, image))
        at, _ = equations.solved(y, equations.derivative, known, MOST_DERIVATIVES)
        away = np.abs(at.y(self.axis) - y)
        if away.max() > POINT_REACH or away[-1] > WIDEST or not sides.here(word_of(at.fixed.image.passage)):
            raise OrbitLost(f"no {self.kind.name} near {self.parameter} = {beside.value:.6g}")
        return self._found(with_mark(self.axis, at, mark), sides, 0.0)

    def _ahead(self, given: dict[str, float], near: Point, mark: Mark) -> tuple[np.ndarray, np.ndarray]:
        """Where the curve leads from a neighbour along its tangent, and the derivative there of all equations.

        The tangent follows from the image of the neighbour's point a little way towards the new parameters, or away from
        them where an end begins to strike.
        """
        y, old = near.y(self.axis), near.map.parameters
        if near.mark_slope is None:
            near = with_mark(self.axis, near, mark)
        known = np.vstack([near.matrix(), cast(np.ndarray, near.mark_slope)])
        for part in (TANGENT_SHARE, -TANGENT_SHARE):
            aside = {name: old[name] + part * (value - old[name]) for name, value in given.items() if name in old}
            with suppress(OrbitLost):
                m = replace(near.map, parameters=aside | {self.parameter: near.value})
                image = m.image(y[:-1])
                moved = mark(m, image) - mark(near.map, near.fixed.image)
                fails = np.append(defect(m, y[:-1], image, self.spin), moved)
                if np.abs(fails).max() < POINT_REACH:
                    return y - np.linalg.solve(known, fails / part), known
        return y, known

    # --- from a neighbour ------------------------------------------------------------------------------------------

    def _at(self, given: dict[str, float], near: Point, y: np.ndarray) -> Point:
        """The orbit at the parameter's value in `y`, in the section of a point nearby."""
        return lent(self.axis, self._beside(given, near, y), y, np.append(np.zeros(y.size - 1), 1.0), MOST_DERIVATIVES)

    def _beside(self, given: dict[str, float], near: Point, y: np.ndarray) -> Point:
        """A point of a neighbour, to begin with at other values of the parameters."""
        value = float(y[-1] * self.axis.scale)
        m = replace(near.map, parameters=given | {self.parameter: value})
        return near._replace(fixed=near.fixed._replace(map=m), value=value)
