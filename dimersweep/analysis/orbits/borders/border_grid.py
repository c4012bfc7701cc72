"""Curves of borders over other parameters, and where they meet other borders."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import suppress
from functools import partial
from itertools import groupby, product, takewhile
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.borders.curve import Curve, Found, meetings, shortened
from dimersweep.analysis.orbits.borders.curves import asked
from dimersweep.analysis.orbits.continuation.steps import Between
from dimersweep.analysis.orbits.map.finding import RTOL
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.cubes.cube import Column, column, finished, fixed_coordinates, over_grid, table
from dimersweep.errors import KernelError, OrbitError, ParameterError
from dimersweep.parameters import value_of
from dimersweep.symbols import PARAMETERS

Index = tuple[int, ...]  # place of a point of a grid: its number along each axis

# a missing stretch of a line is begun anew only if it is at least this part, 1/8, of the line: where a line has no
# border, each beginning is a long search in vain
STRETCHES = 8
# greatest distance of two points of one border that were found from a neighbour and by a search, in the parameter over
# its scale
AGREED = 1e-3
MEETING = 1e-6  # accuracy of a meeting, relative to the value of the last axis (absolute below 1)
FOUND_HOW = "ok, one of several borders of the kind, or why there is no point"


def outwards(shape: tuple[int, ...]) -> list[Index]:
    """Return all points of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


class GridWalk:
    """The points of a curve over a grid: begun in the middle of each line, followed from point to point, and confirmed.

    The grid is taken line by line, along the axis of the shortest steps. The middle of each line is looked for on a
    branch of orbits; from there the border is followed from point to neighbouring point. A long stretch of a line that
    is not reached is begun again. Points that are still missing are looked for from neighbouring lines. With a given
    start, the border is followed from the first point that is found, across lines as well.

    A motion may have many such borders (`Curve.many`). Then every point that is not reached is looked for by itself. So
    is the last point of each stretch that was followed. If this search gives another border, the half of the stretch
    before the point is given up, and followed from the point instead.
    """

    def __init__(self, curve: Curve, start: PeriodicOrbit | None) -> None:
        self.curve, self.axes, self.start = curve, curve.over, start
        self.found: dict[Index, Found] = {}
        # for each point that is found: the point, found by itself, at which the following began that led to it
        self.begun_at: dict[Index, Index] = {}
        self.status: dict[Index, str] = {}
        self.shape = tuple(column.size for column in self.axes.values())
        # points to be looked for from a neighbour, along the lines and across them: point, axis, side of it
        self.along: deque[tuple[Index, int, int]] = deque()
        self.across: deque[tuple[Index, int, int]] = deque()
        steps = (np.abs(np.diff(column)) / np.abs(column).max() for column in self.axes.values())
        self.fine = int(np.argmin([each.min(initial=np.inf) for each in steps]))
        if curve.alone:
            for index in outwards(self.shape):
                self._try(index, [])
            return
        for first in outwards(tuple(1 if k == self.fine else n for k, n in enumerate(self.shape))):
            self._line([_moved(first, self.fine, n) for n in range(self.shape[self.fine])])
        self._follow(across=True)

    def _line(self, line: list[Index]) -> None:
        """Find the points of a line: begin in the middle, follow, begin again where much is missing, and confirm."""
        begun: set[Index] = set()
        least = 1 if self.curve.many else len(line) / STRETCHES
        while (index := _to_begin(line, self.found.keys() | begun, least)) is not None:
            begun.add(index)
            self._try(index, [])
            self._follow(across=self.start is not None)
        if self.curve.many and self.start is None:
            while (end := self._unconfirmed(line, begun)) is not None:
                begun.add(end)
                self._confirm(end, line)
                self._follow(across=False)

    def _follow(self, across: bool) -> None:
        """Look for the neighbours of all points found, along the lines and then, if `across`, across the lines, too."""
        while self.along or (across and self.across):
            point, axis, side = (self.along or self.across).popleft()
            if point not in self.found:
                beside = (_moved(point, axis, by * side) for by in (1, 2, 3))
                self._try(point, list(takewhile(self.found.__contains__, beside)))

    def _try(self, index: Index, near: list[Index]) -> None:
        """Look for a point from its neighbours; look by itself without neighbours, or if it is not sure."""
        source = self.begun_at[near[0]] if near else index
        try:
            found = self._point(index, near)
            if near and not self.curve.is_sure(found):
                with suppress(OrbitError, ParameterError):
                    found, source = self._point(index), index
        except (OrbitError, ParameterError) as reason:
            self.status.setdefault(index, shortened(str(reason)))
        except KernelError as fault:
            self.status[index] = shortened(f"fault of the kernel: {fault}")
        else:
            self._enter(index, found, source)

    def _enter(self, index: Index, found: Found, source: Index) -> None:
        """Record a point that was found, and queue its neighbours.

        `source` is the point, found by itself, at which the following began that led to this one (`begun_at`).
        """
        self.found[index], self.begun_at[index] = found, source
        for k, side in product(range(len(index)), (-1, 1)):
            other = _moved(index, k, -side)
            if 0 <= other[k] < self.shape[k]:
                (self.along if k == self.fine else self.across).append((other, k, side))

    def _point(self, index: Index, near: Sequence[Index] = ()) -> Found:
        return self.curve.point(self._values(index), [self.found[at] for at in near], self.start)

    def _values(self, index: Index) -> dict[str, float]:
        return {name: float(column[k]) for (name, column), k in zip(self.axes.items(), index, strict=True)}

    # --- whether a point that was followed is also found by itself ---------------------------------------------------

    def _unconfirmed(self, line: list[Index], begun: Set[Index]) -> Index | None:
        """Return an end of a followed stretch of a line that has not been looked for by itself, or None.

        A stretch has the neighbouring points that were followed from one beginning.
        """
        stretches = (
            list(each) for _, each in groupby(filter(self.found.__contains__, line), self.begun_at.__getitem__)
        )
        return next((end for each in stretches for end in (each[0], each[-1]) if end not in begun), None)

    def _confirm(self, end: Index, line: list[Index]) -> None:
        """Look for the end of a stretch by itself; if this gives another point, give up half of the stretch."""
        try:
            alone = self._point(end)
        except (OrbitError, ParameterError):
            return  # no orbit leads to the border here: the point that was followed stays
        followed, source = self.found[end], self.begun_at[end]
        agree = abs(alone.value - followed.value) < AGREED * self.curve.axis.scale
        if agree and self.curve.status(alone) == self.curve.status(followed):
            return
        far = abs(end[self.fine] - source[self.fine])
        for at in line:
            if self.begun_at.get(at) == source and 2 * abs(at[self.fine] - end[self.fine]) < far:
                del self.found[at], self.begun_at[at]
        self._enter(end, alone, end)

    def meetings(self) -> Iterator[tuple[Found, str]]:
        """Yield the points where the curve meets other borders along the last axis, with the names of both borders."""
        *_, last = self.axes.values()
        for index in self.found:
            if (beside := _moved(index, len(index) - 1, 1)) in self.found:
                low, high = last[index[-1]], last[beside[-1]]
                known = MEETING * max(1.0, abs(high)) / (abs(high - low) or 1.0)
                tests = partial(Curve.tests, self.curve)
                yield from meetings(self.curve, self._between(index, beside), tests, self.curve.state, known)

    def _between(self, index: Index, beside: Index) -> Between[Found]:
        """Return the points between two neighbours, each found from the last known one before it."""
        begin, end = (np.array([*self._values(at).values()]) for at in (index, beside))

        def found(before: Found, after: Found, part: float, share: float) -> Found:
            values = dict(zip(self.axes, (begin + share * (end - begin)).tolist(), strict=True))
            return self.curve.point(values, [self.curve.between(before, after, part)], None)

        return Between(self.found[index], self.found[beside], found)

    def told(self) -> dict[Index, str]:
        """Return the status of each point: for a missing point, why it was not found."""
        lacking = {index: self.status.get(index, "no neighbour was found") for index in outwards(self.shape)}
        return lacking | {index: self.curve.status(one) for index, one in self.found.items()}


def _to_begin(line: list[Index], tried: Set[Index], least: float) -> Index | None:
    """Return the middle of the longest stretch of a line without a tried or found point; None if below `least`."""
    stretches = [list(stretch) for was, stretch in groupby(range(len(line)), lambda n: line[n] in tried) if not was]
    longest = max(stretches, key=len, default=[])
    if not longest or len(longest) < least:
        return None
    halfway = longest[(len(longest) - 1) // 2], longest[len(longest) // 2]
    # of an even number of points, the middle one that lies nearer to the middle of the line
    return line[min(halfway, key=lambda n: abs(2 * n - len(line) + 1))]


def _moved(index: Index, axis: int, by: int) -> Index:
    return tuple(n + by * (k == axis) for k, n in enumerate(index))


def border(
    kind: str,
    parameter: str,
    over: Mapping[str, Any],
    *,
    spin: float | None = None,
    start: PeriodicOrbit | None = None,
    rtol: float = RTOL,
    sustained: bool = False,
    **fixed: float,
) -> xr.Dataset:
    """Find a border of an orbit in one parameter, as a curve over the values of other parameters.

    Parameters
    ----------
    kind : str
        fold, flip (period doubling), torus (Neimark-Sacker), or a change of sequence: any change (word), or stick_slip,
        lift_off, double_impact, chatter, hop. The first border met from the start is followed. Of folds, flips and
        tori, the border is preferred at which the stable orbit that runs come to loses its stability. stable_from and
        stable_to are the ends of that orbit's stability, whatever their kind; each point is found by itself. A
        pitchfork is a border of motions in a plane, without spin.
    parameter : str
        Parameter that is solved for.
    over : mapping of str to sequence of float
        Values of one or more other parameters. Each line of points along the axis of the shortest steps is begun in its
        middle, and followed from point to point. A long stretch that is not reached is begun by itself. For a change of
        sequence, every point that is not reached is begun by itself, and the last point of each stretch is confirmed
        so. Where this search gives another border, the stretch before the point is looked for again.
    spin : float, optional
        Axial spin [rad s-1]; by default the spin that a lateral start with `xdot0` rolls up to. For a fold, a flip or a
        torus the spin is put back to it at the start of each forcing period. For a change of sequence it is the spin
        after the double impact.
    start : PeriodicOrbit, optional
        Orbit from which the first point is looked for; by default one found between the ball's fold and flip.
    rtol : float
        Accuracy of the map [1].
    sustained : bool
        Whether the spin is free: each orbit then has a spin at which nothing drifts, looked for near `spin`. At a fold
        two such spins appear; at an end of stability one ceases to attract or to exist.
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along the names in `over`: `parameter`, the attributes of the border's `PeriodicOrbit`, `status`, and `cost`,
        the forcing periods of the map that a point took. The status is "ok", or says why there is no point, or that
        there are more.

        `loses_stability` says whether a stable orbit loses its stability there. Then all multipliers are inside the
        unit circle on one side; beyond, one multiplier is outside, or there is no orbit. A flip has `doubling`, the
        coefficient of its normal form. Where it is positive a stable orbit of twice the period begins, where it is
        negative an unstable one ends. stable_from and stable_to have `ends_by`, the kind of border there. A change of
        sequence has `change`, the symbols that go and come, which may differ from point to point.

        A sequence may change alike at many values of the parameter, between the turn of the branch and the last orbit
        in which an end comes to rest. Then the row has the first change met, upwards before downwards, `several` has
        all of them, and the status is "one of 10". Beyond the last orbit in which an end comes to rest, the branch is
        in pieces. If there is no such change before, the row is this last orbit, and the status says that there are
        several beyond.

        Along `meeting`: the places where the curve meets another border along its last axis, located to 1e-6, and
        `meets`, the names of both borders.

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
    curve = asked(kind, parameter, over, spin, rtol, fixed, sustained)
    walk = GridWalk(curve, start)
    if not walk.found:
        raise OrbitError(f"no {kind} found in {parameter}: {next(iter(walk.told().values()))}")
    return _dataset(walk)


def _dataset(walk: GridWalk) -> xr.Dataset:
    """Return the points of a curve over its grid, and its meetings, as labelled data."""
    curve, axes, rows = walk.curve, walk.axes, list(walk.found.values())
    cost = Column("cost", "forcing periods of the map that the point took", [float(one.cost) for one in rows])
    met = list(walk.meetings())
    found = curve.table(rows, "found", (cost, *curve.columns(rows)))
    result = xr.Dataset(coords={name: column(name, values, PARAMETERS[name]) for name, values in axes.items()})
    result = result.assign(over_grid(found, list(walk.found), tuple(axes), walk.shape))
    told = walk.told()
    said = [told[index] for index in np.ndindex(walk.shape)]
    result["status"] = column(tuple(axes), np.reshape(said, walk.shape), FOUND_HOW)
    places_met = [[*(value_of(name, one.orbit.parameters) for name in axes), one.value] for one, _ in met]
    where = np.array(places_met).reshape(-1, len(axes) + 1)
    columns = []
    for name, places in zip((*axes, curve.parameter), where.T, strict=True):
        quantity = PARAMETERS[name]._replace(long_name=f"{PARAMETERS[name].long_name} where two borders meet")
        columns.append(Column(f"{name}_at_meeting", quantity, places))
    names = np.array([name for _, name in met], dtype=str)
    columns.append(Column("meets", "the two borders that meet", names))
    result = result.assign(table((), columns, "meeting").data_vars)
    fixed = {name: value for name, value in curve.given.items() if name not in (*axes, curve.parameter)}
    about = {name: found.attrs[name] for name in ("kind", "parameter", "spin", "cost")}
    result = result.assign_coords(fixed_coordinates(fixed)).assign_attrs(about | {"rtol": curve.rtol})
    return finished(result, f"Border of periodic orbits: {curve.kind.name} in {curve.parameter}")
