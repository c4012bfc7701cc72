"""Curves along which the sequence of an orbit changes.

Where an end grazes, or a hop lasts half a period, the border is the zero of a function of the orbit (a mark). Newton's
method finds it, from a guess along the tangent of the curve. At other changes the orbit may leap, and the border is
enclosed between two orbits.
"""

from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import partial
from itertools import takewhile
from typing import ClassVar, cast

import numpy as np

from dimersweep.analysis.orbits.borders.curve import REACH, Curve, Found
from dimersweep.analysis.orbits.continuation.branch import Equations, grazes, least_gap, lent, with_derivatives
from dimersweep.analysis.orbits.continuation.events import MOST_CHANGES, Event, events_in, graze, last_with
from dimersweep.analysis.orbits.continuation.kinds import ANY_CHANGE, COMPLEX, FLIP, FOLD, change_of
from dimersweep.analysis.orbits.continuation.stability_end import across, beyond_gap, is_stable, last_that
from dimersweep.analysis.orbits.continuation.steps import SEARCHING, on_line, steps
from dimersweep.analysis.orbits.map.lost import OrbitLost, all_found, attempt, first_found, require, singular_lost
from dimersweep.analysis.orbits.map.manifold import lag
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.passage import Passage, Sides, far_ends, rests, sides_of
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import Mark, Solution, defect, multipliers_of, system
from dimersweep.cubes.cube import Column

# half widths of the bracket of a change of sequence, in the parameter over its scale: the greatest and the least one,
# and the factor from one try to the next; rounding decides below the least one, for a bracket must hold the change
WIDEST, NARROWEST, WIDER = 0.05, 2e-5, 4.0
SAME_CHANGE = 1e-7  # distance below which two changes of sequence are one, in the parameter over its scale
# difference of the sizes of multipliers by one-sided and by central differences, above which the map has a kink there
BENT = 1e-2
NO_JUMP = 1e-8  # jump of an orbit at a change of sequence that counts as zero, in units of the section
# distance of a point from its guess, in the parameter over its scale and beyond the length of the step, above which
# the curve has a corner
CORNER = 2e-3
PARTS = 5  # times that a step of a branch is halved where a hop comes near half a period
# uncertainty of the parameter of a guess: with one neighbour, over its scale; on the line through two, as a part of
# the step between them
DOUBT, LESS = 4e-3, 0.08
# distances along the branch, in units of the section, at which the search for a grazing orbit begins; the second is
# tried where the first leads to none
OPENED = (1e-2, 1e-1)
MOST_DERIVATIVES = 3  # new derivatives at a point: where Newton's method needs more, it comes to another motion
TANGENT_SHARE = 1e-3  # part of the way to the next point, over which the derivative along it is taken


def comes_to_rest(point: Solution) -> bool:
    """Return True if an end stays on the plate for a part of the period."""
    return rests(point.sequence)


def crept(at: Solution, mark: Mark) -> float:
    """Return the parameter at which a mark of the slowly drifting motion is zero, near a fixed point with a zero mark.

    The fixed point depends on the section, the drifting motion does not (see `manifold`).
    """
    along = cast(np.ndarray, at.mark_slope) @ at.tangent / at.tangent[-1]
    of_motion = mark(at.map, at.map.passage(at.z + lag(at)))
    return float(at.value - at.axis.scale * (of_motion - mark(at.map, at.passage)) / along)


def _has_turned(orbit: PeriodicOrbit) -> bool:
    """Return True if a branch has turned round between a stable orbit and this one.

    Then an odd number of real multipliers are greater than 1: one passes 1 at each turn.
    """
    real = orbit.multipliers[np.abs(orbit.multipliers.imag) < COMPLEX].real
    return bool((real > 1).sum() % 2)


class SequenceCurve(Curve):
    """A curve along which the sequence of the orbit changes: see `Curve`."""

    many: ClassVar = True

    def status(self, found: Found) -> str:
        if found.sides is None:
            return "several beyond, of motions that come to no rest"
        if not rests(found.orbit.sequence):
            return "one of several"
        return f"one of {len(found.several)}" if found.several else "ok"

    def columns(self, found: Collection[Found]) -> list[Column]:
        sequences = "what goes (-) and comes (+) in the sequence beyond: symbols, or pairs of them (a/b)"
        changes = [one.sides.described(one.orbit.sequence) if one.sides else "" for one in found]
        columns = [*super().columns(found), Column("change", sequences, changes)]
        if most := max(len(one.several) for one in found):
            values = np.array([[*one.several, *[np.nan] * (most - len(one.several))] for one in found])
            several = f"{self.parameter} of all such changes along the branch of the stable orbit"
            columns.append(Column("several", several, values, along="number"))
        return columns

    def _from(self, orbit: PeriodicOrbit) -> Found:
        """Return the first change met along the branch through an orbit, with all others in `others`.

        Others are only known of a motion in which an end comes to rest: without a rest, steps lead from one piece of
        the branch to any other.
        """
        ways = self._ways(orbit)
        if not comes_to_rest(ways[0]):
            return self._taken_up(first_found(partial(self._met, way) for way in ways))
        changes = [event for way in ways for event in self._changes(way)]
        if not changes and orbit.stable and far_ends(orbit.sequence) == 1:
            return self._to_pieces(ways)
        require(changes, f"no {self.kind.name} is met")
        kept: list[Found] = []
        for found in map(self._taken_up, changes):
            if all(abs(found.value - other.value) > SAME_CHANGE * self.axis.scale for other in kept):
                kept.append(found)
        return kept[0]._replace(others=tuple(kept[1:]))

    def _taken_up(self, event: Event) -> Found:
        """Return the point of the border at a special point of a branch."""
        at, sides = event.solution, sides_of(*event.sequences, self.kind.begins)
        smooth = event.jump < NO_JUMP and not grazes(at)
        if smooth and (mark := self.kind.mark(sides)):

            def at_zero() -> Found:
                found = self._zero(at.map.parameters, at, sides, mark)
                own, fast = multipliers_of(at)[0], found.orbit.multipliers
                # without a kink of the map there, central derivatives are those of one map
                same = own.size != fast.size or np.abs(np.abs(own) - np.abs(fast)).max() < BENT
                require(same, "the map has a kink there")
                return found

            if found := attempt(at_zero):
                return found
        return self._found(at, sides, float(np.sign(at.tangent[-1])))

    def _is_met(self, event: Event) -> bool:
        return event.kind.of_sequence and self.kind in (ANY_CHANGE, event.kind)

    def _changes(self, begin: Solution) -> Iterator[Event]:
        """Yield the changes of this kind along a branch, until it turns round, falls to pieces or does not go on."""
        point, sense = begin, float(np.sign(begin.tangent[-1]))
        for _ in range(MOST_CHANGES):
            last = point
            try:
                for first, end, _ in steps(point, SEARCHING):
                    for a, b in self._parts(first, end, PARTS):
                        found, goes_on = self._events(a, b)
                        for event in found:
                            if event.kind is FOLD or not comes_to_rest(event.solution):
                                return
                            if self._is_met(event):
                                yield event
                        if not goes_on or b.tangent[-1] * sense < 0:
                            return
                        last = b
                return
            except OrbitLost:
                beyond = attempt(across, comes_to_rest, last, sense)
                if beyond is None:
                    return
                last, point = beyond
            sequences = last.sequence, point.sequence
            if sequences[0] != sequences[1]:
                event = Event(change_of(*sequences), last, 1.0, np.nan, sequences)
                if self._is_met(event):
                    yield event

    def _parts(self, a: Solution, b: Solution, halvings: int) -> Iterator[tuple[Solution, Solution]]:
        """Divide a step of a branch into parts so short that no hop passes half a period twice within one part.

        Yield both ends of each part.
        """
        if self.kind.lines is not None and halvings:
            first, last = (self.kind.lines(point.passage) for point in (a, b))
            passes = (np.minimum(np.abs(first), np.abs(last)) < np.abs(last - first)).any()
            if passes and (middle := attempt(on_line(a, b).__getitem__, 0.5)):
                yield from self._parts(a, middle, halvings - 1)
                yield from self._parts(middle, b, halvings - 1)
                return
        yield a, b

    def _events(self, a: Solution, b: Solution) -> tuple[list[Event], bool]:
        """Return the special points of a step with its leaps, and True if in the orbits beyond an end comes to rest."""
        found, leap = events_in(a, b)
        if leap is None:
            return found, comes_to_rest(b)
        further, goes_on = self._events(cast(Solution, leap.beyond), b) if rests(leap.sequences[1]) else ([], False)
        return [*found, leap, *further], goes_on

    def _to_pieces(self, ways: list[Solution]) -> Found:
        """Return the last orbit in which an end still comes to rest.

        Beyond it the branch falls into pieces, one for each number of bounces.
        """
        last = first_found((partial(last_that, comes_to_rest, way) for way in ways), f"no {self.kind.name} is met")
        return Found(orbit_of(last), last.value, last.settled())

    def _found(self, at: Solution, sides: Sides, sense: float) -> Found:
        """Return a point of the curve in a section that suits the next point.

        Beyond the change the parameter goes on in the `sense` (1 or -1). The sense is 0 where the map is smooth and
        only the sequence changes.
        """
        if grazes(at):
            sense = -float(np.sign(cast(np.ndarray, at.mark_slope)[-1]))  # the end strikes where its gap falls
        leaps = sense != 0.0 and (self.kind.zero is None or grazes(at))
        loses = leaps and is_stable(at) and beyond_gap(is_stable, at, sense) is None
        return Found(orbit_of(at), at.value, at.settled(), sides, loses)

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        """Find the point one step from neighbours, with the other changes of its motion, all in other points."""
        resting = near[0].sides is not None and rests(near[0].orbit.sequence)
        require(resting, "the neighbour's motion comes to no rest")
        others = []
        for k in range(len(near[0].others)):
            with_it = takewhile(lambda one, k=k: len(one.others) > k, near)  # type: ignore[misc]
            beside = [one.others[k] for one in with_it]
            others.append(self._one(given, list(takewhile(beside[0].alike, beside))))
        found = self._one(given, near)._replace(others=tuple(others))
        apart = not others or np.diff(found.several).min() >= SAME_CHANGE * self.axis.scale
        require(apart, "two changes come to one point")
        return found

    def _one(self, given: dict[str, float], near: list[Found]) -> Found:
        """Find one change of the same motion a step from neighbours."""
        found = self._near(given, near)
        same = rests(found.orbit.sequence) and _has_turned(found.orbit) == _has_turned(near[0].orbit)
        require(same, "the point found is one of another motion")
        return found

    def _near(self, given: dict[str, float], near: list[Found]) -> Found:
        """Find one change a step from neighbours: a graze, a zero of a mark, or enclosed between two orbits."""
        last, sides = near[0].begin, near[0].sides
        assert sides is not None
        if grazes(last):
            return self._graze(given, last, sides)
        if mark := self.kind.mark(sides):
            return self._zero(given, last, sides, mark)

        def between(y: np.ndarray, doubt: float) -> tuple[Found, float]:
            return self._between(given, last, sides, y, doubt), y[-1]

        guesses = self._guesses([one for one in near if not grazes(one.begin)])
        found, aim = first_found(partial(between, *guess) for guess in guesses)
        if len(near) > 1:
            self._smooth(found.begin, last, aim)
        return found

    def _smooth(self, at: Solution, last: Solution, expected: float) -> None:
        """Require that a point is near its guess: beyond a corner of the curve lie points of another border."""
        near = abs(at.y[-1] - expected) <= CORNER + abs(expected - last.y[-1])
        require(near, f"the curve has a corner near {self.parameter} = {at.value:.6g}")

    # --- between two orbits ----------------------------------------------------------------------------------------

    def _guesses(self, near: list[Found]) -> Iterator[tuple[np.ndarray, float]]:
        """Yield guesses of a change (its unknowns), each with the uncertainty of its parameter over its scale."""
        y = self.extrapolated(near)
        if len(near) == 1:
            yield y, DOUBT
            return
        yield y, abs(y[-1] - self.extrapolated(near[:-1])[-1])
        yield self.extrapolated(near[:2]), LESS * abs(near[0].value - near[1].value) / self.axis.scale

    def _between(self, given: dict[str, float], near: Solution, sides: Sides, y: np.ndarray, doubt: float) -> Found:
        """Return the last orbit on this side of a change, enclosed between two orbits on both sides of the guess `y`.

        The last entry of the guess is the parameter over its scale, known to about `doubt`. No other change may lie
        nearer.
        """
        width = min(WIDEST, max(NARROWEST, doubt))
        while width <= WIDEST:
            ends = [self._at(given, near, np.append(y[:-1], y[-1] + by)) for by in (-width, width)]
            sequences = [end.sequence for end in ends]
            if sides.between(*sequences):
                this, other = ends if sides.here(sequences[0]) else ends[::-1]
                change = last_with(sides.here, 0.0, this, other)
                nearer = f"another change is nearer at {self.parameter} = {change.solution.value:.6g}"
                require(sides.beyond(change.sequences[1]), nearer)
                return self._found(change.solution, sides, float(np.sign(other.value - this.value)))
            width *= WIDER
        at = y[-1] * self.axis.scale
        raise OrbitLost(f"no change of sequence within {WIDEST * self.axis.scale:.2g} of {self.parameter} = {at:.6g}")

    # --- the zero of a mark ----------------------------------------------------------------------------------------

    def _graze(self, given: dict[str, float], near: Solution, sides: Sides) -> Found:
        """Return the orbit at which an end just misses the plate; the search begins at an orbit whose gap is wider."""
        y, _ = self._ahead(given, near, least_gap)
        why = f"no end grazes where the sequence changes near {self.parameter} = {y[-1] * self.axis.scale:.6g}"

        def found(opened: float) -> Found:
            at, struck = graze(self._at(given, near, y + opened * near.tangent).settled())
            require(sides.between(at.sequence, struck), why)
            self._smooth(at, near, y[-1])
            return self._found(at, sides, 0.0)

        return first_found((partial(found, opened) for opened in OPENED), why)

    def _zero(self, given: dict[str, float], near: Solution, sides: Sides, mark: Mark) -> Found:
        """Return the orbit at which a mark is zero, if it is near and not beyond the change."""
        y, known = self._ahead(given, near, mark)
        equations = _equations(self._beside(given, near, y), mark)
        at, _ = equations.solved(y, equations.derivative, known, MOST_DERIVATIVES)
        here = np.abs(at.y - y).max() <= REACH and sides.here(at.sequence)
        require(here, f"no {self.kind.name} near {self.parameter} = {equations.near.value:.6g}")
        self._smooth(at, near, y[-1])
        return self._at_zero(at, sides, mark)

    def _at_zero(self, at: Solution, sides: Sides, mark: Mark) -> Found:
        """Return the point of the curve at an orbit whose mark is zero, with derivatives taken anew."""
        at = with_derivatives(at, mark=mark)
        return self._found(at, sides, 0.0)._replace(value=crept(at, mark))

    @singular_lost()
    def _ahead(self, given: dict[str, float], near: Solution, mark: Mark) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolate the curve from a neighbour along its tangent: return the unknowns and the equations' derivative.

        The tangent follows from the image of the neighbour's point at parameters a little nearer to the new ones. Where
        an end begins to strike there, parameters a little further away are taken.
        """
        y, old = near.y, near.map.parameters
        if near.mark_slope is None:
            near = with_derivatives(near, mark=mark)
        known = np.vstack([near.derivative(), cast(np.ndarray, near.mark_slope)])

        def ahead(part: float) -> np.ndarray:
            aside = {name: old[name] + part * (value - old[name]) for name, value in given.items() if name in old}
            m = replace(near.map, parameters=aside | {self.parameter: near.value})
            passage = m.passage(y[:-1])
            moved = mark(m, passage) - mark(near.map, near.passage)
            fails = np.append(defect(m, y[:-1], passage, self.axis.spin), moved)
            require(np.abs(fails).max() < REACH, "another motion is there")
            return y - np.linalg.solve(known, fails / part)

        return next(all_found(partial(ahead, part) for part in (TANGENT_SHARE, -TANGENT_SHARE)), y), known

    # --- in the plane of two parameters ------------------------------------------------------------------------------

    def _mark(self, near: Found) -> Mark:
        """Return the function of the orbit that is zero on the border near a point, where it has an equation."""
        mark = self.kind.mark(near.sides) if near.sides else None
        require(mark and not grazes(near.begin), "the border has no equation there")
        return cast(Mark, mark)

    def system(self, m: ReturnMap, near: Found) -> Equations:
        return _equations(near.begin.on_map(m), self._mark(near))

    def made(self, u: np.ndarray, extra: tuple[ReturnMap, Passage], near: Found) -> Found:
        at = self.system(extra[0], near).point(u, extra)
        return self._at_zero(at, cast(Sides, near.sides), self._mark(near))

    @singular_lost()
    def tests(self, found: Found) -> dict[str, float]:
        fixed, name = found.begin, self.kind.name
        fold = float(np.linalg.det(system(fixed.map, fixed.matrix, fixed.gradient, self.sustained)))
        return {f"{name}-fold": fold, f"{name}-flip": FLIP.test(found.begin)}

    # --- from a neighbour ------------------------------------------------------------------------------------------

    def _at(self, given: dict[str, float], near: Solution, y: np.ndarray) -> Solution:
        """Return the orbit at the parameter of `y`, in the section of the point `near`."""
        return lent(self._beside(given, near, y), y, np.eye(y.size)[-1], MOST_DERIVATIVES)

    def _beside(self, given: dict[str, float], near: Solution, y: np.ndarray) -> Solution:
        """Return the point of a neighbour with its map at other values of the parameters; it is no orbit there yet."""
        value = float(y[-1] * self.axis.scale)
        m = replace(near.map, parameters=given | {self.parameter: value})
        return near.on_map(m)._replace(value=value)


def _equations(near: Solution, mark: Mark) -> Equations:
    """Return the equations of an orbit at which a mark is zero."""
    return Equations(near, lambda _, m, passage: mark(m, passage))
