"""Curves of borders over other parameters, and where they meet other borders."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import product, takewhile
from math import hypot, pi
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.border import OnBorder, held, on_border
from dimersweep.orbits.branch import (
    Axis,
    Leap,
    Point,
    corrected,
    in_own_section,
    last_with,
    point_of,
    specials,
)
from dimersweep.orbits.finding import RTOL, checked, orbit_at, rolled_up
from dimersweep.orbits.orbit import Orbit, orbit_of
from dimersweep.orbits.return_map import OrbitLost, ReturnMap, Tape
from dimersweep.orbits.solving import fixed_at
from dimersweep.orbits.tables import dataset
from dimersweep.orbits.word import change_of, word_of
from dimersweep.parameters import as_number, check_name, check_rtol
from dimersweep.symbols import PARAMETERS

CURVES = ("fold", "flip", "torus")
WORDS = ("word", "stick_slip", "lift_off", "double_impact", "chatter", "hop")
KINDS = CURVES + WORDS
SEED_POINTS, SEED_STEP = 120, 0.1  # of the branch on which the first point is looked for
WIDEST, NARROWEST, MARGIN = 0.05, 2e-5, 4.0  # bracket of a change of word, in the parameter over its scale
HALVINGS = 4  # of a step from one point of a curve to the next
MEETING = 1e-6  # how well a meeting is known, in the step of the curve


class Found(NamedTuple):
    """A point of a curve: its orbit, the parameter, the cost in periods; what the next point begins with."""

    orbit: Orbit
    value: float
    cost: float
    begin: Any


def ball_fold(e: float) -> float:
    """Least Gamma at which a ball can bounce once a period: pi (1 - e)/(1 + e)."""
    return pi * (1 - e) / (1 + e)


def ball_flip(e: float) -> float:
    """Gamma at which that motion doubles its period."""
    return hypot(ball_fold(e), 2 * (1 + e**2) / (1 + e) ** 2)


def border(
    kind: str,
    parameter: str,
    over: Mapping[str, Any],
    *,
    spin: float | None = None,
    start: Orbit | None = None,
    rtol: float = RTOL,
    **fixed: float,
) -> xr.Dataset:
    """A border of an orbit in one parameter, as a curve over the values of other ones.

    Parameters
    ----------
    kind : str
        fold, flip (period doubling), torus (Neimark-Sacker), or a change of word: any (word), or stick_slip, lift_off,
        double_impact, chatter, hop. The first one met from the start is the one that is followed.
    parameter : str
        The one that is solved for.
    over : mapping of str to sequence of float
        Values of one or more others; each point begins with what its neighbour has come to.
    spin : float, optional
        Axial spin [rad s-1]; by default what a lateral start with `xdot0` rolls up to. Of a fold, a flip and a torus it is
        that to which the spin is put back at the start of each forcing period; of a change of word that after the double
        impact.
    start : Orbit, optional
        From which the first point is looked for; by default one found between the ball's fold and flip.
    rtol : float
        Accuracy of the map [1].
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along the names in `over`: `parameter`, what an `Orbit` tells of the border's orbit, `status` ("ok", or why there is no
        point) and `cost`, the forcing periods of the map that a point took. Along `meeting`: where the curve meets another
        border, with its `meets`.

    Raises
    ------
    ParameterError
        For an unknown kind or parameter, or a value that is not allowed.
    OrbitError
        If no point of the border is found.
    """
    given, axes = _checked(kind, parameter, over, fixed)
    rtol = check_rtol(rtol)
    spin = rolled_up(given) if spin is None else as_number("spin", spin)
    curve = Curve(kind, parameter, given, spin, rtol)
    found, status = _walked(curve, axes, start)
    if not found:
        raise OrbitError(f"no {kind} found in {parameter}: {next(iter(status.values()))}")
    return _dataset(curve, axes, found, status)


def _checked(
    kind: str, parameter: str, over: Mapping[str, Any], fixed: dict[str, float]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """All parameters, and the axes.

    Raises
    ------
    ParameterError
        For what is not allowed.
    """
    if kind not in KINDS:
        raise ParameterError(f"kind = {kind!r}: unknown border (allowed: {', '.join(KINDS)})")
    check_name(parameter)
    if not isinstance(over, Mapping) or not over:
        raise ParameterError(f"over = {over!r}: must name at least one parameter with its values")
    axes = {}
    for name, values in over.items():
        check_name(name)
        if name == parameter or name in fixed:
            raise ParameterError(f"over: {name} is given twice")
        axes[name] = np.array([as_number(name, value) for value in np.atleast_1d(np.asarray(values))])
        if not axes[name].size:
            raise ParameterError(f"over: {name} has no values")
    for name, column in axes.items():
        for value in column:
            checked(fixed | {name: float(value)})
    return checked(fixed | {name: float(values[0]) for name, values in axes.items()}), axes


def outwards(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Every point of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


def _walked(
    curve: "Curve", axes: dict[str, np.ndarray], start: Orbit | None
) -> tuple[dict[tuple[int, ...], Found], dict[tuple[int, ...], str]]:
    """The points that are found, and why the others are not: from the middle outwards, each from a neighbour.

    A point that is not found is tried again when another neighbour of it has been found since.
    """
    found: dict[tuple[int, ...], Found] = {}
    status: dict[tuple[int, ...], str] = {}
    tried: dict[tuple[int, ...], int] = {}
    order = outwards(tuple(len(values) for values in axes.values()))
    going_on = True
    while going_on:
        going_on = False
        for index in order:
            sides = len(_beside(found, index))
            if index in found or (found and sides == 0) or tried.get(index) == sides:
                continue
            tried[index] = sides
            values = {name: float(axes[name][k]) for name, k in zip(axes, index, strict=True)}
            try:
                found[index] = curve.point(values, _near(found, index), start)
                going_on = True
            except (OrbitLost, OrbitError, ParameterError) as reason:
                status[index] = str(reason)
    return found, {index: status.get(index, "no neighbour was found") for index in order if index not in found}


def _beside(found: dict[tuple[int, ...], Found], index: tuple[int, ...]) -> list[tuple[int, ...]]:
    """The neighbours of a point that are found."""
    moves = product(range(len(index)), (-1, 1))
    around = [tuple(n + side * (j == k) for j, n in enumerate(index)) for k, side in moves]
    return [other for other in around if other in found]


def _near(found: dict[tuple[int, ...], Found], index: tuple[int, ...]) -> list[Found]:
    """The found neighbours of a point along one axis, the nearest first, for a curve through them."""
    for k in range(len(index)):
        for side in (-1, 1):
            line = [tuple(n + by * side * (j == k) for j, n in enumerate(index)) for by in (1, 2, 3)]
            if line[0] in found:
                return [found[at] for at in takewhile(found.__contains__, line)]
    return []


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
        if not near:
            told = self._first(given, start)
        else:
            try:
                told = self._next(given, near)
            except OrbitLost:
                told = self._by_halves(given, near[0], HALVINGS)
        orbit, value, begin = told
        return Found(orbit, value, self.tape.spent.periods - spent, begin)

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
        if self.kind in CURVES:
            old: OnBorder = near[0].begin
            m = held(old.fixed.map, given, self.spin, self.tape)
            try:
                return self._told(on_border(self.kind, self.axis, m, self._extrapolated(near), old.frame))
            except OrbitLost:
                return self._told(on_border(self.kind, self.axis, m, old.y(self.axis)))
        guess = 2 * near[0].value - near[1].value if len(near) > 1 else near[0].value
        doubt = abs(near[0].value - near[1].value) if len(near) > 1 else WIDEST * self.axis.scale
        return self._word(given, near[0].begin, guess, doubt)

    def _extrapolated(self, near: list[Found]) -> np.ndarray:
        """The point beyond neighbours at equal distances, as far as they are in one section."""
        m = near[0].begin.fixed.map
        same = takewhile(
            lambda one: one.begin.fixed.map.phase == m.phase and one.begin.fixed.map.free.size == m.free.size, near
        )
        ys = [one.begin.y(self.axis) for one in same]
        weights = ((1.0,), (2.0, -1.0), (3.0, -3.0, 1.0))[len(ys) - 1]
        return sum(weight * y for weight, y in zip(weights, ys, strict=True))

    def _map(self, old: ReturnMap, given: dict[str, float]) -> ReturnMap:
        return type(old)(given, old.phase, old.modes, old.periods, old.rtol, self.tape)

    def _told(self, at: OnBorder) -> tuple[Orbit, float, Any]:
        """The orbit of a point of the border, in a section that suits the next one."""
        m = at.fixed.map
        plain = ReturnMap(m.parameters, m.phase, m.modes, m.periods, m.rtol, self.tape)
        fixed = fixed_at(plain, at.fixed.z, residual=at.fixed.residual)
        fast = np.linalg.eigvals(at.fixed.matrix).astype(complex)
        fast = fast[np.argsort(-np.abs(fast), kind="stable")][:-1]  # without that of the spin, which is put back
        orbit = replace(orbit_of(fixed, 0.0), multipliers=fast, stable=bool((np.abs(fast) < 1).all()))
        if not plain.well_placed(fixed.image.passage):
            with suppress(OrbitLost):
                moved, z = plain.moved(fixed.image.passage)
                there = held(moved, m.parameters, self.spin, self.tape)
                at = on_border(self.kind, self.axis, there, np.append(z, at.value / self.axis.scale))
        return orbit, at.value, at

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
            return orbit_of(special.fixed, 0.0), special.value, in_own_section(self.axis, special)
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
                        self._note_sides(special.point, point, nxt)
                    return special.point
            point, step = in_own_section(self.axis, nxt), min(1.5 * step, SEED_STEP)
        raise OrbitLost(f"none within {SEED_POINTS} points of the branch")

    def _specials(self, a: Point, b: Point) -> list[Any]:
        try:
            return specials(self.axis, a, b, self.kind in WORDS)
        except Leap as leap:
            raise OrbitLost(str(leap)) from leap

    # --- changes of word -------------------------------------------------------------------------------------------

    def _note_sides(self, at: Point, a: Point, b: Point) -> None:
        """Which symbols tell the sides apart, from the last point on this side and the first on the other."""
        old = set(word_of(at.fixed.image.passage).split())
        _, _, right = last_with(self.axis, word_of(at.fixed.image.passage).__eq__, 0.0, at, b)
        new = set(word_of(right.fixed.image.passage).split())
        self.symbols = frozenset(old ^ new)
        self.present = frozenset(self.symbols & old)

    def _this_side(self, word: str) -> bool:
        return self.symbols & set(word.split()) == self.present

    def _word(self, given: dict[str, float], near: Point, guess: float, doubt: float) -> tuple[Orbit, float, Any]:
        """The last orbit on this side of a change of word: between two orbits on both sides of the guess."""
        width = min(WIDEST, max(NARROWEST, MARGIN * 0.02 * doubt / self.axis.scale))
        while width <= WIDEST:
            ends = [self._at(given, near, guess + side * width * self.axis.scale) for side in (-1, 1)]
            sides = [self._this_side(word_of(end.fixed.image.passage)) for end in ends]
            if sides[0] != sides[1]:
                a, b = ends if sides[0] else ends[::-1]
                _, left, _ = last_with(self.axis, self._this_side, 0.0, a, b)
                return orbit_of(left.fixed, 0.0), left.value, in_own_section(self.axis, left)
            width *= 4
        raise OrbitLost(f"no change of word within {WIDEST * self.axis.scale:.2g} of {self.parameter} = {guess:.6g}")

    def _at(self, given: dict[str, float], near: Point, value: float) -> Point:
        """The orbit at a value of the parameter, in the section of a point nearby."""
        m = self._map(near.fixed.map, given | {self.parameter: value})
        lent = near._replace(fixed=near.fixed._replace(map=m), value=value)
        normal = np.append(np.zeros(near.fixed.z.size), 1.0)
        return corrected(self.axis, lent, lent.y(self.axis), normal)


# --- where borders meet -------------------------------------------------------------------------------------------


def marks(kind: str, orbit: Orbit) -> dict[str, float]:
    """Test functions along a curve, by the name of what it meets where one changes its sign."""
    values = orbit.multipliers
    rest = np.delete(values, int(np.argmin(np.abs(values - {"fold": 1.0, "flip": -1.0}.get(kind, 0.0)))))
    real = rest[np.abs(rest.imag) < 1e-7].real
    told = {}
    if kind in ("fold", "flip", *WORDS):
        told[f"{kind}-fold" if kind != "fold" else "fold-fold"] = float(np.prod(1 - real)) if real.size else 1.0
        told[f"{kind}-flip"] = float(np.prod(1 + real)) if real.size else 1.0
    return told


def meetings(kind: str, a: Orbit, b: Orbit) -> list[str]:
    """Names of the borders that a curve meets between two of its points."""
    first, second = marks(kind, a), marks(kind, b)
    names = [name for name in first if first[name] * second[name] < 0]
    if a.word != b.word and kind in CURVES:
        names.append(f"{kind}-{change_of(a.word, b.word)}")
    return names


def _meetings(curve: Curve, axes: dict[str, np.ndarray], found: dict[tuple[int, ...], Found]) -> list[dict[str, Any]]:
    """Where the curve meets other borders along its last axis, each located between two points by halving."""
    names, rows = list(axes), []
    name = names[-1]
    for index, one in found.items():
        after = (*index[:-1], index[-1] + 1)
        if after not in found:
            continue
        two = found[after]
        for meets in meetings(curve.kind, one.orbit, two.orbit):
            values = {n: float(axes[n][k]) for n, k in zip(names, index, strict=True)}
            low, high = values[name], float(axes[name][after[-1]])
            a, b = one, two
            try:
                while abs(high - low) > MEETING * max(1.0, abs(high)):
                    middle = 0.5 * (low + high)
                    point = curve.point(values | {name: middle}, [a], None)
                    if meets in meetings(curve.kind, a.orbit, point.orbit):
                        high, b = middle, point
                    else:
                        low, a = middle, point
            except (OrbitLost, OrbitError):
                pass  # the bracket as far as it was narrowed
            values[name] = 0.5 * (low + high)
            rows.append(values | {curve.parameter: 0.5 * (a.value + b.value), "meets": meets})
    return rows


def _dataset(
    curve: Curve, axes: dict[str, np.ndarray], found: dict[tuple[int, ...], Found], status: dict[tuple[int, ...], str]
) -> xr.Dataset:
    shape = tuple(len(values) for values in axes.values())
    orbits = [one.orbit for one in found.values()]
    table = dataset(orbits, "found").drop_vars("cost")
    at = tuple(np.array(list(found)).T)
    result = xr.Dataset(coords={n: (n, v, PARAMETERS[n]._asdict()) for n, v in axes.items()})
    for name, column in table.data_vars.items():
        values = np.full(shape + column.shape[1:], _empty(column.dtype), dtype=column.dtype)
        values[at] = column.values
        result[name] = ((*axes, *column.dims[1:]), values, column.attrs)
    rows = {"cost": [one.cost for one in found.values()], curve.parameter: [one.value for one in found.values()]}
    for name, numbers in rows.items():
        values = np.full(shape, np.nan)
        values[at] = numbers
        result[name] = (tuple(axes), values)
    result[curve.parameter].attrs = PARAMETERS[curve.parameter]._asdict()
    result["cost"].attrs = {"units": "1", "long_name": "forcing periods of the map that the point took"}
    told = np.full(shape, "ok", dtype=object)
    for index, reason in status.items():
        told[index] = reason
    result["status"] = (tuple(axes), told.astype(str))
    met = _meetings(curve, axes, found)
    for name in (*axes, curve.parameter):
        result[f"{name}_at_meeting"] = ("meeting", np.array([row[name] for row in met], dtype=float))
    result["meets"] = ("meeting", np.array([row["meets"] for row in met], dtype=str))
    fixed = {name: value for name, value in curve.given.items() if name not in (*axes, curve.parameter)}
    result.attrs = fixed | {
        "kind": curve.kind, "parameter": curve.parameter, "spin": curve.spin, "rtol": curve.rtol,
        "cost": curve.tape.spent.periods,
    }  # fmt: skip
    return result


def _empty(dtype: np.dtype) -> Any:
    return {"U": "", "b": False, "i": 0}.get(dtype.kind, np.nan)
