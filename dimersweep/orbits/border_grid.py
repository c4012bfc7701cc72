"""Curves of borders over other parameters, and where they meet other borders."""

from collections.abc import Mapping, Set
from contextlib import suppress
from heapq import heappop, heappush
from itertools import groupby, product, takewhile
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import as_numbers, check_rtol, number
from dimersweep.orbits.bifurcation_curve import BifurcationCurve
from dimersweep.orbits.curve import Curve, FollowedCurve, Found, shortened
from dimersweep.orbits.finding import RTOL, checked, checked_spin
from dimersweep.orbits.kinds import BORDER_KINDS, Kind
from dimersweep.orbits.kinds.changes import change_of
from dimersweep.orbits.kinds.kind import COMPLEX, Bifurcation, Change, RealMultiplier
from dimersweep.orbits.kinds.stability import StabilityEnd
from dimersweep.orbits.labelling import dataset
from dimersweep.orbits.orbit import PeriodicOrbit
from dimersweep.orbits.poincare import OrbitLost
from dimersweep.orbits.stability_curve import StabilityCurve
from dimersweep.orbits.word import Sides
from dimersweep.orbits.word_curve import WordCurve
from dimersweep.parameters import check_effect, check_name
from dimersweep.symbols import PARAMETERS

STRETCHES = 8  # in a line of points: shorter ones are not begun anew
MEETING = 1e-6  # how well a meeting is known, in the step of the curve


def border(
    kind: str,
    parameter: str,
    over: Mapping[str, Any],
    *,
    spin: float | None = None,
    start: PeriodicOrbit | None = None,
    rtol: float = RTOL,
    **fixed: float,
) -> xr.Dataset:
    """A border of an orbit in one parameter, as a curve over the values of other ones.

    Parameters
    ----------
    kind : str
        fold, flip (period doubling), torus (Neimark-Sacker), or a change of word: any of them (word), or stick_slip,
        lift_off, double_impact, chatter, hop. The first one met from the start is the one that is followed; of folds, flips
        and tori the one at which the stable orbit that runs come to loses its stability, if it does so there. stable_from
        and stable_to are the ends of that orbit's stability, whatever their kind; each point is found by itself.
    parameter : str
        The one that is solved for.
    over : mapping of str to sequence of float
        Values of one or more others; each point begins with what its neighbour has come to. Each line of points along the axis
        of the shortest steps is begun by itself, and so is a long stretch of it that is not reached.
    spin : float, optional
        Axial spin [rad s-1]; by default what a lateral start with `xdot0` rolls up to. Of a fold, a flip and a torus it is
        that to which the spin is put back at the start of each forcing period; of a change of word that after the double
        impact.
    start : PeriodicOrbit, optional
        From which the first point is looked for; by default one found between the ball's fold and flip.
    rtol : float
        Accuracy of the map [1].
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along the names in `over`: `parameter`, the attributes of the border's `PeriodicOrbit`, `status` and `cost`, the
        forcing periods of the map that a point took. The status is "ok", or says why there is no point, or that there are
        more. The word, and the order of sticking, slipping and lifting off, change at many values of the parameter: the row
        has the first one met along the branch of the stable orbit, `several` has all of that branch, and the status is "one
        of 10". Beyond where an end no longer comes to rest the branch is in pieces: the row is the last orbit of which an end
        does, and the status says that there are several beyond. `loses_stability` says whether a stable orbit loses its
        stability there: the multipliers are inside the unit circle on one side, and beyond the orbit has one outside, or there
        is none. Of stable_from and stable_to also `ends_by`, the kind of border there. Of a change of word also `change`, the
        symbols that go and come: it may differ from line to line of points.
        Along `meeting`: where the curve meets another border, with its `meets`.

    Raises
    ------
    ParameterError
        For an unknown kind or parameter, or a value that is not allowed.
    OrbitError
        If no point of the border is found.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> fold = orbits.border("fold", "Gamma", over={"e": [0.58, 0.6]}, spin=100.0)
    >>> fold["Gamma"].values.round(3).tolist()
    [0.837, 0.787]
    """
    given, axes = _checked(kind, parameter, over, fixed)
    rtol = check_rtol(rtol)
    spin = checked_spin(spin, given)
    curve = _curve(BORDER_KINDS[kind], parameter, given, spin, rtol)
    walk = Walk(curve, axes, start)
    if not walk.found:
        raise OrbitError(f"no {kind} found in {parameter}: {next(iter(walk.failed().values()))}")
    return _dataset(curve, axes, walk.found, walk.failed())


def _curve(kind: Kind, parameter: str, given: dict[str, float], spin: float, rtol: float) -> Curve:
    """The curve that is followed for a kind."""
    if isinstance(kind, Bifurcation):
        return BifurcationCurve(kind, parameter, given, spin, rtol)
    if isinstance(kind, StabilityEnd):
        return StabilityCurve(kind, parameter, given, spin, rtol)
    assert isinstance(kind, Change)
    return WordCurve(kind, parameter, given, spin, rtol)


def _checked(
    kind: str, parameter: str, over: Mapping[str, Any], fixed: dict[str, float]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """All parameters, and the axes.

    Raises
    ------
    ParameterError
        For what is not allowed.
    """
    if kind not in BORDER_KINDS:
        raise ParameterError(f"kind = {kind!r}: unknown border (allowed: {', '.join(BORDER_KINDS)})")
    check_name(parameter)
    if not isinstance(over, Mapping) or not over:
        raise ParameterError(f"over = {over!r}: must name at least one parameter with its values")
    axes = {}
    for name, values in over.items():
        check_name(name)
        if name == parameter or name in fixed:
            raise ParameterError(f"over: {name} is given twice")
        axes[name] = as_numbers(name, values, number, PARAMETERS[name].units)
        if not axes[name].size:
            raise ParameterError(f"over: {name} has no values")
    check_effect({parameter, *axes, *fixed})
    for name, column in axes.items():
        for value in column:
            checked(fixed | {name: float(value)})
    return checked(fixed | {name: float(values[0]) for name, values in axes.items()}), axes


def outwards(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Every point of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


class Try(NamedTuple):
    """A point to be looked for from a neighbour: its distance, its place in the order of the walk, and where it lies."""

    step: float
    place: int
    point: tuple[int, ...]
    axis: int
    side: int


class Walk:
    """The points of a curve over a grid.

    The grid is taken line by line, along the axis of the shortest steps. Each line is begun in its middle, from a branch of
    orbits, and followed from point to neighbouring point. A long stretch of a line that is not reached is begun again. Points
    that are still missing are looked for from neighbouring lines; with a given start, so are all points from the beginning.

    Parameters
    ----------
    curve : Curve
    axes : dict of str to ndarray
    start : PeriodicOrbit, optional
    """

    def __init__(self, curve: Curve, axes: dict[str, np.ndarray], start: PeriodicOrbit | None) -> None:
        self.curve, self.axes, self.start = curve, axes, start
        self.found: dict[tuple[int, ...], Found] = {}
        self.status: dict[tuple[int, ...], str] = {}
        self.columns = list(axes.values())
        lengths = [column.size for column in self.columns]
        self.order = outwards(tuple(lengths))
        self.places = {index: place for place, index in enumerate(self.order)}
        self.waiting: list[Try] = []
        steps = [_steps(column).min(initial=np.inf) for column in self.columns]
        self.fine = int(np.argmin(steps))
        if curve.alone:
            for index in self.order:
                self._try(index, [])
            return
        for first in outwards(tuple(1 if k == self.fine else n for k, n in enumerate(lengths))):
            self._line([_moved(first, self.fine, n) for n in range(lengths[self.fine])])
        self._follow(across=True)

    def _line(self, line: list[tuple[int, ...]]) -> None:
        begun: set[tuple[int, ...]] = set()
        while (index := _to_begin(line, self.found.keys() | begun)) is not None:
            begun.add(index)
            self._try(index, [], next((self.found[at].sides for at in line if at in self.found), None))
            self._follow(across=self.start is not None)

    def _follow(self, across: bool) -> None:
        """Look for the neighbours of what has been found, the nearest first, along the lines only or also across them."""
        later = []
        while self.waiting:
            one = heappop(self.waiting)
            if one.point in self.found:
                continue
            if across or one.axis == self.fine:
                beside = (_moved(one.point, one.axis, by * one.side) for by in (1, 2, 3))
                self._try(one.point, [self.found[at] for at in takewhile(self.found.__contains__, beside)])
            else:
                later.append(one)
        self.waiting = sorted(later)

    def _try(self, index: tuple[int, ...], near: list[Found], like: Sides | None = None) -> None:
        values = {name: float(column[k]) for (name, column), k in zip(self.axes.items(), index, strict=True)}
        try:
            self.found[index] = self._point(values, near, like)
        except (OrbitLost, OrbitError, ParameterError) as reason:
            self.status.setdefault(index, shortened(str(reason)))
            return
        for k, column in enumerate(self.columns):
            for side in (-1, 1):
                other = _moved(index, k, -side)
                if other in self.places and other not in self.found:
                    step = _steps(column)[min(other[k], index[k])]
                    heappush(self.waiting, Try(round(step, 9), self.places[other], other, k, side))

    def _point(self, values: dict[str, float], near: list[Found], like: Sides | None) -> Found:
        """A point found from its neighbours, or by itself where that may be another one."""
        found = self.curve.point(values, near, self.start, like)
        if near and isinstance(self.curve, FollowedCurve) and not self.curve.is_sure(found):
            with suppress(OrbitLost, OrbitError, ParameterError):
                return self.curve.point(values, [], self.start)
        return found

    def failed(self) -> dict[tuple[int, ...], str]:
        """Why the other points are not found."""
        return {
            index: self.status.get(index, "no neighbour was found") for index in self.order if index not in self.found
        }


def _to_begin(line: list[tuple[int, ...]], tried: Set[tuple[int, ...]]) -> tuple[int, ...] | None:
    """The middle of the longest stretch of a line in which no point has been tried or found; none if it is short."""
    stretches = [list(stretch) for was, stretch in groupby(range(len(line)), lambda n: line[n] in tried) if not was]
    longest = max(stretches, key=len, default=[])
    if not longest or STRETCHES * len(longest) < len(line):
        return None
    halfway = longest[(len(longest) - 1) // 2], longest[len(longest) // 2]
    return line[min(halfway, key=lambda n: abs(2 * n - len(line) + 1))]


def _steps(column: np.ndarray) -> np.ndarray:
    """Steps between the values of an axis, over the largest of them."""
    return np.abs(np.diff(column)) / np.abs(column).max()


def _moved(index: tuple[int, ...], axis: int, by: int) -> tuple[int, ...]:
    return tuple(n + by * (k == axis) for k, n in enumerate(index))


# --- where borders meet -------------------------------------------------------------------------------------------


def marks(kind: Kind, orbit: PeriodicOrbit) -> dict[str, float]:
    """Test functions along a curve, by the names of the two borders that meet where one changes its sign."""
    values = orbit.multipliers
    if isinstance(kind, RealMultiplier):
        values = np.delete(values, int(np.argmin(np.abs(values - kind.at))))
    real = values[np.abs(values.imag) < COMPLEX].real
    others = [other for other in BORDER_KINDS.values() if isinstance(other, RealMultiplier)]
    return {f"{kind.name}-{other.name}": float(np.prod(1 - other.at * real)) for other in others}


def meetings(kind: Kind, a: Found, b: Found) -> list[str]:
    """Names of the borders that a curve meets between two of its points."""
    if a.by is not None and b.by is not None:
        return [f"{a.by.name}-{b.by.name}"] if a.by is not b.by else []
    first, second = marks(kind, a.orbit), marks(kind, b.orbit)
    names = [name for name in first if first[name] * second[name] < 0]
    words = a.orbit.word, b.orbit.word
    if words[0] != words[1] and isinstance(kind, Bifurcation):
        names.append(f"{kind.name}-{change_of(*words).name}")
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
        for meets in meetings(curve.kind, one, two):
            values = {n: float(axes[n][k]) for n, k in zip(names, index, strict=True)}
            low, high = values[name], float(axes[name][after[-1]])
            a, b = one, two
            try:
                while abs(high - low) > MEETING * max(1.0, abs(high)):
                    middle = 0.5 * (low + high)
                    point = curve.point(values | {name: middle}, [a], None)
                    if meets in meetings(curve.kind, a, point):
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
    table = dataset(orbits, "found")
    periods = {"units": "1", "long_name": "forcing periods of the map that the point took"}
    table["cost"] = ("found", [one.cost for one in found.values()], periods)
    words = "whether a stable orbit loses its stability there"
    table["loses_stability"] = ("found", [one.loses for one in found.values()], {"units": "1", "long_name": words})
    if isinstance(curve.kind, StabilityEnd):
        kinds = [one.by.name if one.by else "" for one in found.values()]
        table["ends_by"] = ("found", kinds, {"long_name": "kind of border by which the stability ends"})
    table[curve.parameter] = ("found", [one.value for one in found.values()], PARAMETERS[curve.parameter]._asdict())
    if curve.words:
        words = "what goes (-) and comes (+) in the word beyond: symbols, or pairs of them (a/b)"
        changes = [one.sides.described(one.orbit.word) if one.sides else "" for one in found.values()]
        table["change"] = ("found", changes, {"long_name": words})
        if most := max(len(one.several) for one in found.values()):
            values = np.array([[*one.several, *[np.nan] * (most - len(one.several))] for one in found.values()])
            words = f"{curve.parameter} of all such changes along the branch of the stable orbit"
            table["several"] = (("found", "number"), values, {"units": "1", "long_name": words})
    at = tuple(np.array(list(found)).T)
    result = xr.Dataset(coords={n: (n, v, PARAMETERS[n]._asdict()) for n, v in axes.items()})
    for name, column in table.data_vars.items():
        values = np.full(shape + column.shape[1:], _empty(column.dtype), dtype=column.dtype)
        values[at] = column.values
        result[name] = ((*axes, *column.dims[1:]), values, column.attrs)
    said = np.full(shape, "", dtype=object)
    for index, reason in [*status.items(), *((index, curve.status(one)) for index, one in found.items())]:
        said[index] = reason
    words = "ok, one of several borders of the kind, or why there is no point"
    result["status"] = (tuple(axes), said.astype(str), {"long_name": words})
    met = _meetings(curve, axes, found)
    for name in (*axes, curve.parameter):
        units = PARAMETERS[name]._replace(long_name=f"{PARAMETERS[name].long_name} where two borders meet")._asdict()
        result[f"{name}_at_meeting"] = ("meeting", np.array([row[name] for row in met], dtype=float), units)
    names = np.array([row["meets"] for row in met], dtype=str)
    result["meets"] = ("meeting", names, {"long_name": "the two borders that meet"})
    fixed = {name: value for name, value in curve.given.items() if name not in (*axes, curve.parameter)}
    result.attrs = fixed | {
        "kind": curve.kind.name, "parameter": curve.parameter, "spin": curve.spin, "rtol": curve.rtol,
        "cost": curve.tape.periods,
    }  # fmt: skip
    return result


def _empty(dtype: np.dtype) -> Any:
    return {"U": "", "b": False, "i": 0}.get(dtype.kind, np.nan)
