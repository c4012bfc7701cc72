"""A border of one kind: how its first point is found, and each one from its neighbours."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from math import hypot, pi
from typing import Any, NamedTuple

import numpy as np

from dimersweep.errors import OrbitError
from dimersweep.orbits.branch import Axis, Equations, Point, corrected, in_own_section, lent, point_of, with_derivatives
from dimersweep.orbits.finding import orbit_at
from dimersweep.orbits.grazing import graze
from dimersweep.orbits.on_border import OnBorder, held, next_on_border, on_border
from dimersweep.orbits.orbit import Orbit, orbit_of
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.return_map import Image, OrbitLost, ReturnMap, Tape
from dimersweep.orbits.solving import fixed_at
from dimersweep.orbits.specials import Leap, last_with, specials
from dimersweep.orbits.word import HOP_LINE, longest_hop, word_of

CURVES = ("fold", "flip", "torus")
WORDS = ("word", "stick_slip", "lift_off", "double_impact", "chatter", "hop")
KINDS = CURVES + WORDS
SEED_POINTS, SEED_STEP = 120, 0.1  # of the branch on which the first point is looked for
FARTHEST = 0.2  # of a point of a curve from where it is looked for, in units of the section
WIDEST, NARROWEST, WIDER = 0.05, 2e-5, 4.0  # bracket of a change of word, in the parameter over its scale
DOUBT, LESS = 4e-3, 0.08  # of a point with one neighbour; of one on the line through two, in the step between them
OPENED = (2e-3, 7e-3, 2e-2)  # gaps from which a grazing orbit is looked for, in units of the section
BESIDE = 1e-9  # of a change of word, how far on this side its point lies, in forcing periods of the hop
HALVINGS = 4  # of a step from one point of a curve to the next


class Found(NamedTuple):
    """A point of a curve: its orbit, the parameter, the cost in periods; what the next point begins with."""

    orbit: Orbit
    value: float
    cost: float
    begin: Any

    def alike(self, other: "Found") -> bool:
        """Whether both obey the same equations, in one section."""
        m, n = self.begin.map, other.begin.map
        return m.phase == n.phase and m.free.size == n.free.size and self.begin.grazes == other.begin.grazes


def ball_fold(e: float) -> float:
    """Least Gamma at which a ball can bounce once a period: pi (1 - e)/(1 + e)."""
    return pi * (1 - e) / (1 + e)


def ball_flip(e: float) -> float:
    """Gamma at which that motion doubles its period."""
    return hypot(ball_fold(e), 2 * (1 + e**2) / (1 + e) ** 2)


class Curve:
    """A border of one kind: how its points are found, one from the other."""

    def __init__(self, kind: str, parameter: str, given: dict[str, float], spin: float, rtol: float) -> None:
        self.kind, self.parameter, self.given, self.spin, self.rtol = kind, parameter, given, spin, rtol
        scale = abs(given.get(parameter, given["e"])) or 1.0
        self.axis = Axis(parameter, scale, spin)
        self.tape = Tape()
        self.present: frozenset[str] = frozenset()
        self.symbols: frozenset[str] = frozenset()  # whose presence tells the sides of a change of word apart

    def point(self, values: dict[str, float], near: list[Found], start: Orbit | None) -> Found:
        """The point of the border at values of the other parameters.

        Raises
        ------
        OrbitLost, OrbitError
            If none is found.
        """
        spent = self.tape.spent.periods
        given = self.given | values
        told = self._beginning(given, start) if not near else self._stepped(given, near)
        orbit, value, begin = told
        return Found(orbit, value, self.tape.spent.periods - spent, begin)

    def _beginning(self, given: dict[str, float], start: Orbit | None) -> tuple[Orbit, float, Any]:
        """The first point; where it is looked for from an orbit, at that orbit's parameters first."""
        told = self._first(given, start)
        found = told[0].parameters
        if all(found[name] == value for name, value in given.items() if name != self.parameter and name in found):
            return told
        return self._stepped(given, [Found(told[0], told[1], 0.0, told[2])])

    def _stepped(self, given: dict[str, float], near: list[Found]) -> tuple[Orbit, float, Any]:
        try:
            return self._next(given, near)
        except OrbitLost:
            return self._by_halves(given, near[0], HALVINGS)

    def _by_halves(self, given: dict[str, float], near: Found, depth: int) -> tuple[Orbit, float, Any]:
        """The point reached over one halfway, and so on, where the step from its neighbour is too wide."""
        known = near.orbit.parameters
        middle = {name: 0.5 * (value + known.get(name, value)) for name, value in given.items()}
        for target in (middle, given):
            try:
                told = self._next(target, [near])
            except OrbitLost:
                if depth == 0:
                    raise
                told = self._by_halves(target, near, depth - 1)
            near = Found(told[0], told[1], 0.0, told[2])
        return told

    def _next(self, given: dict[str, float], near: list[Found]) -> tuple[Orbit, float, Any]:
        near = list(takewhile(near[0].alike, near))
        if self.kind in CURVES:
            old: OnBorder = near[0].begin
            m = held(old.map, given, self.spin, self.tape)
            try:
                return self._told(next_on_border(self.kind, self.axis, m, old, self._extrapolated(near)))
            except OrbitLost:
                return self._told(next_on_border(self.kind, self.axis, m, old, old.u))
        if near[0].begin.grazes:
            with suppress(OrbitLost):
                return self._graze(given, near)
        elif self.kind == "hop" and len(self.symbols) == 1:
            with suppress(OrbitLost):
                return self._hop(given, near)
        try:
            y = self._extrapolated(near)
            doubt = abs(y[-1] - self._extrapolated(near[:-1])[-1]) if len(near) > 1 else DOUBT
            return self._word(given, near[0].begin, y, doubt)
        except OrbitLost:
            if len(near) < 2:
                raise
        doubt = LESS * abs(near[0].value - near[1].value) / self.axis.scale
        return self._word(given, near[0].begin, self._extrapolated(near[:2]), doubt)

    def _extrapolated(self, near: list[Found]) -> np.ndarray:
        """The point beyond neighbours at equal distances."""
        ys = [one.begin.y(self.axis) for one in near]
        weights = ((1.0,), (2.0, -1.0), (3.0, -3.0, 1.0))[len(ys) - 1]
        return sum(weight * y for weight, y in zip(weights, ys, strict=True))

    def _map(self, old: ReturnMap, given: dict[str, float]) -> ReturnMap:
        return type(old)(given, old.phase, old.modes, old.periods, old.rtol, self.tape)

    def _told(self, at: OnBorder) -> tuple[Orbit, float, Any]:
        """The orbit of a point of the border, in a section that suits the next one."""

        def make(own: ReturnMap, z: np.ndarray) -> OnBorder:
            there = held(own, own.parameters, self.spin, self.tape)
            return on_border(self.kind, self.axis, there, np.append(z, at.u[-1]))

        plain = self._plain(at)
        image = plain.image(at.z)
        moved = plain.in_own_section(at, image.passage, make)
        if moved is not at:
            at, plain = moved, self._plain(moved)
            image = plain.image(at.z)
        matrix, _ = at.map.jacobian(at.z)
        fast = np.linalg.eigvals(matrix).astype(complex)
        fast = fast[np.argsort(-np.abs(fast), kind="stable")][:-1]  # without that of the spin, which is put back
        orbit = orbit_of(fixed_at(plain, at.z, image, at.residual), 0.0)
        orbit = replace(orbit, multipliers=fast, stable=bool((np.abs(fast) < 1).all()))
        return orbit, float(at.u[-1] * self.axis.scale), at

    def _plain(self, at: OnBorder) -> ReturnMap:
        """The map with the spin let go, which tells the whole passage of a period."""
        m = at.map
        return ReturnMap(m.parameters, m.phase, m.modes, m.periods, m.rtol, self.tape)

    # --- the first point: on a branch ------------------------------------------------------------------------------

    def _first(self, given: dict[str, float], start: Orbit | None) -> tuple[Orbit, float, Any]:
        reasons: list[str] = []
        for orbit in [start] if start is not None else self._starts(given, reasons):
            try:
                special = self._along(orbit)
            except (OrbitError, OrbitLost) as reason:
                reasons.append(str(reason))
                continue
            if self.kind in CURVES:
                m = held(special.fixed.map, special.fixed.map.parameters, self.spin, self.tape)
                return self._told(on_border(self.kind, self.axis, m, special.y(self.axis)))
            return self._begun(special)
        raise OrbitError(f"no {self.kind} was met; {'; '.join(reasons)}")

    def _starts(self, given: dict[str, float], reasons: list[str]) -> Iterator[Orbit]:
        """Orbits from which the border is looked for; those in which both ends fly, perhaps another motion, come last."""
        flying = []
        for at in self._places(given):
            try:
                orbit = orbit_at(given | at, self.spin, rtol=self.rtol)
            except OrbitError as reason:
                reasons.append(str(reason))
                continue
            if orbit.word.endswith("far.1 far.2"):
                flying.append(orbit)
            else:
                yield orbit
        yield from flying

    def _places(self, given: dict[str, float]) -> Iterator[dict[str, float]]:
        """Where an orbit is looked for: between the ball's fold and flip."""
        if self.parameter not in ("Gamma", "e"):
            yield {}
            return
        for share in (0.05, 0.3, 0.6) if self.kind == "fold" else (0.3, 0.1, 0.6, 0.8):
            if self.parameter == "Gamma":
                e = given.get("e_2", given["e"])
                yield {"Gamma": ball_fold(e) + share * (ball_flip(e) - ball_fold(e))}
            else:
                least = (pi - given["Gamma"]) / (pi + given["Gamma"])  # the ball's fold
                yield {"e": max(0.0, least) + share * (1 - max(0.0, least)) * 0.5}

    def _along(self, orbit: Orbit) -> Point:
        """The first point of the kind on the branch through an orbit, to either side.

        Raises
        ------
        OrbitLost
            If there is none.
        """
        reasons = []
        value = orbit.parameters.get(self.parameter, orbit.parameters["e"])
        begin = point_of(self.axis, orbit.fixed._replace(map=orbit.fixed.map.on(self.tape)), value, None)
        for sense in (-1.0, 1.0) if self.kind == "fold" else (1.0, -1.0):
            try:
                return self._met(begin._replace(tangent=sense * begin.tangent))
            except OrbitLost as reason:
                reasons.append(str(reason))
        raise OrbitLost(f"along {self.parameter}: {'; '.join(reasons)}")

    def _met(self, point: Point) -> Point:
        step = SEED_STEP
        for _ in range(SEED_POINTS):
            try:
                nxt = corrected(self.axis, point, point.y(self.axis) + step * point.tangent, point.tangent)
            except OrbitLost:
                step *= 0.5
                if step < 1e-5:
                    raise
                continue
            for special in self._specials(point, nxt):
                if special.kind == self.kind or (special.kind == "word" and self.kind in ("word", special.change)):
                    if special.kind == "word":
                        self._note_sides(*special.words)
                    return special.point
            point, step = in_own_section(self.axis, nxt), min(1.5 * step, SEED_STEP)
        raise OrbitLost(f"none within {SEED_POINTS} points of the branch")

    def _specials(self, a: Point, b: Point) -> list[Any]:
        try:
            return specials(self.axis, a, b, self.kind in WORDS)
        except Leap as leap:
            raise OrbitLost(str(leap)) from leap

    # --- changes of word -------------------------------------------------------------------------------------------

    def _note_sides(self, here: str, beyond: str) -> None:
        """Which symbols tell the sides apart, from the words on both."""
        old, new = set(here.split()), set(beyond.split())
        self.symbols = frozenset(symbol for symbol in old ^ new if self.kind != "hop" or symbol.startswith("far"))
        self.present = frozenset(self.symbols & old)

    def _this_side(self, word: str) -> bool:
        return self.symbols & set(word.split()) == self.present

    def _same_side(self, a: str, b: str) -> bool:
        return self._this_side(a) == self._this_side(b)

    def _word(self, given: dict[str, float], near: Point, y: np.ndarray, doubt: float) -> tuple[Orbit, float, Any]:
        """The last orbit on this side of a change of word: between two orbits on both sides of the guess `y`.

        The guess has the parameter, over its scale, as its last entry, known to about `doubt`.
        """
        width = min(WIDEST, max(NARROWEST, doubt))
        while width <= WIDEST:
            ends = [self._at(given, near, np.append(y[:-1], y[-1] + by)) for by in (-width, width)]
            sides = [self._this_side(word_of(end.fixed.image.passage)) for end in ends]
            if sides[0] != sides[1]:
                at = last_with(self.axis, self._this_side, 0.0, *(ends if sides[0] else ends[::-1])).at
                return self._begun(at if at.grazes else with_derivatives(self.axis, at, near.tangent))
            width *= WIDER
        at = y[-1] * self.axis.scale
        raise OrbitLost(f"no change of word within {WIDEST * self.axis.scale:.2g} of {self.parameter} = {at:.6g}")

    def _hop(self, given: dict[str, float], near: list[Found]) -> tuple[Orbit, float, Any]:
        """The orbit whose longest hop has the length of the line, solved for like a fold; a little way on this side."""
        y = self._extrapolated(near)
        beside = self._beside(given, near[0].begin, y)
        end = int(next(iter(self.symbols))[-1]) - 1
        line = HOP_LINE + (BESIDE if self.present else -BESIDE)

        def over_line(_: np.ndarray, m: ReturnMap, image: Image) -> float:
            return longest_hop(image.passage.events, end, image.passage.times[-1]) / TURN - line

        equations = Equations(self.axis, beside, over_line)
        at, _ = equations.solved(y, equations.derivative)
        away = np.abs(at.y(self.axis) - y)
        if away.max() > FARTHEST or away[-1] > WIDEST or not self._this_side(word_of(at.fixed.image.passage)):
            raise OrbitLost(f"no hop of half a period near {self.parameter} = {beside.value:.6g}")
        return self._begun(with_derivatives(self.axis, at, at.tangent))

    def _graze(self, given: dict[str, float], near: list[Found]) -> tuple[Orbit, float, Any]:
        """The orbit at which an end just misses the plate, and beyond which it strikes: found from where its gap is wider."""
        last: Point = near[0].begin
        y = self._extrapolated(near)
        along = last.tangent / (last.tangent @ last.gap_slope)
        for gap in OPENED:
            with suppress(OrbitLost):
                at, struck = graze(self.axis, in_own_section(self.axis, self._at(given, last, y + gap * along)))
                near_by = np.abs(at.value / self.axis.scale - y[-1]) <= WIDEST
                if near_by and not self._same_side(word_of(at.fixed.image.passage), struck):
                    return self._begun(at)
        raise OrbitLost(f"no end grazes where the word changes near {self.parameter} = {y[-1] * self.axis.scale:.6g}")

    def _begun(self, at: Point) -> tuple[Orbit, float, Any]:
        """The orbit of a point of a branch, in a section that suits the next point of the curve."""
        return orbit_of(at.fixed, 0.0), at.value, in_own_section(self.axis, at)

    def _at(self, given: dict[str, float], near: Point, y: np.ndarray) -> Point:
        """The orbit at the parameter's value in `y`, in the section of a point nearby."""
        return lent(self.axis, self._beside(given, near, y), y, np.append(np.zeros(y.size - 1), 1.0))

    def _beside(self, given: dict[str, float], near: Point, y: np.ndarray) -> Point:
        """A point of a neighbour, to begin with at other values of the parameters."""
        value = float(y[-1] * self.axis.scale)
        m = self._map(near.fixed.map, given | {self.parameter: value})
        return near._replace(fixed=near.fixed._replace(map=m), value=value)
