"""Curves of borders over other parameters, and where they meet other borders."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import replace
from itertools import groupby, product, takewhile
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.borders.curve import Curve, Found, Place, shortened
from dimersweep.analysis.orbits.borders.curves import asked
from dimersweep.analysis.orbits.map.finding import RTOL
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.cubes.cube import column, finished, fixed_coordinates
from dimersweep.errors import KernelError, OrbitError, ParameterError
from dimersweep.inputs import check_switch
from dimersweep.symbols import PARAMETERS

Index = tuple[int, ...]  # of a point of a grid: its number along each axis

STRETCHES = 8  # in a line of points: shorter ones are not begun anew
AGREED = 1e-3  # distance of two points of one border, found in two ways, in the parameter over its scale
MEETING = 1e-6  # how well a meeting is known, in the step of the curve
EMPTY = {"U": "", "b": False, "i": 0}  # what a table has where there is no point, by the kind of its numbers; else NaN
FOUND_HOW = "ok, one of several borders of the kind, or why there is no point"


def outwards(shape: tuple[int, ...]) -> list[Index]:
    """Every point of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


class GridWalk:
    """The points of a curve over a grid: begun in the middle of each line, followed from point to point, and confirmed.

    The grid is taken line by line, along the axis of the shortest steps. Each line is begun in its middle, from a branch of
    orbits, and followed from point to neighbouring point. A long stretch of a line that is not reached is begun again. Points
    that are still missing are looked for from neighbouring lines. With a given start all is followed from the first point
    that is found, across lines as well.

    Where a motion may have many such borders, every point that is not reached is begun by itself, and so is the last one of
    each stretch that was followed: if that gives another one, the half of the stretch before it is given up and followed from
    there.
    """

    def __init__(self, curve: Curve, start: PeriodicOrbit | None) -> None:
        self.curve, self.axes, self.start = curve, curve.over, start
        self.found: dict[Index, Found] = {}
        self.begun_at: dict[Index, Index] = {}  # for each point that is found, the one from which it was followed
        self.status: dict[Index, str] = {}
        self.shape = tuple(column.size for column in self.axes.values())
        # what is to be looked for from a neighbour, along the lines and across them: point, axis and side
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
        """Look for the neighbours of what has been found, along the lines only or, after these, across them, too."""
        while self.along or (across and self.across):
            point, axis, side = (self.along or self.across).popleft()
            if point not in self.found:
                beside = (_moved(point, axis, by * side) for by in (1, 2, 3))
                self._try(point, list(takewhile(self.found.__contains__, beside)))

    def _try(self, index: Index, near: list[Index]) -> None:
        """Look for a point from its neighbours, or by itself without any, and where that may be another one."""
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
        """Enter a point that is found, and have its neighbours looked for."""
        self.found[index], self.begun_at[index] = found, source
        for k, side in product(range(len(index)), (-1, 1)):
            other = _moved(index, k, -side)
            if 0 <= other[k] < self.shape[k]:
                (self.along if k == self.fine else self.across).append((other, k, side))

    def _point(self, index: Index, near: Sequence[Index] = ()) -> Found:
        return self.curve.point(self._values(index), [self.found[at] for at in near], self.start)

    def _values(self, index: Index) -> dict[str, float]:
        return {name: float(column[k]) for (name, column), k in zip(self.axes.items(), index, strict=True)}

    # --- whether points that were followed are those that are found by themselves --------------------------------------

    def _unconfirmed(self, line: list[Index], begun: Set[Index]) -> Index | None:
        """An end of a stretch of a line that was followed from one point, if one was not looked for by itself."""
        stretches = (
            list(each) for _, each in groupby(filter(self.found.__contains__, line), self.begun_at.__getitem__)
        )
        return next((end for each in stretches for end in (each[0], each[-1]) if end not in begun), None)

    def _confirm(self, end: Index, line: list[Index]) -> None:
        """Look for the end of a stretch by itself; if that is another point, give up the half of the stretch before it."""
        try:
            alone = self._point(end)
        except (OrbitError, ParameterError):
            return  # there is no orbit from which it could be found: what was followed is all that is known
        followed, source = self.found[end], self.begun_at[end]
        agree = abs(alone.value - followed.value) < AGREED * self.curve.axis.scale
        if agree and self.curve.status(alone) == self.curve.status(followed):
            return
        far = abs(end[self.fine] - source[self.fine])
        for at in line:
            if self.begun_at.get(at) == source and 2 * abs(at[self.fine] - end[self.fine]) < far:
                del self.found[at], self.begun_at[at]
        self._enter(end, alone, end)

    def meetings(self) -> Iterator[tuple[Place, str]]:
        """Where the curve meets other borders along the last axis."""
        places = {at: Place(self.curve, one, np.array([*self._values(at).values()])) for at, one in self.found.items()}
        for at, a in places.items():
            if b := places.get(_moved(at, len(at) - 1, 1)):
                known = MEETING * max(1.0, abs(b.y[-1])) / (abs(b.y[-1] - a.y[-1]) or 1.0)
                yield from a.special(b, known)

    def told(self) -> dict[Index, str]:
        """The status of each point: of those that are found, and why the others are not."""
        lacking = {index: self.status.get(index, "no neighbour was found") for index in outwards(self.shape)}
        return lacking | {index: self.curve.status(one) for index, one in self.found.items()}


def _to_begin(line: list[Index], tried: Set[Index], least: float) -> Index | None:
    """The middle of the longest stretch of a line in which no point has been tried or found; none if it is short."""
    stretches = [list(stretch) for was, stretch in groupby(range(len(line)), lambda n: line[n] in tried) if not was]
    longest = max(stretches, key=len, default=[])
    if not longest or len(longest) < least:
        return None
    halfway = longest[(len(longest) - 1) // 2], longest[len(longest) // 2]
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
    """A border of an orbit in one parameter, as a curve over the values of other ones.

    Parameters
    ----------
    kind : str
        fold, flip (period doubling), torus (Neimark-Sacker), or a change of sequence: any of them (word), or stick_slip,
        lift_off, double_impact, chatter, hop. The first one met from the start is the one that is followed; of folds, flips
        and tori the one at which the stable orbit that runs come to loses its stability, if it does so there. stable_from
        and stable_to are the ends of that orbit's stability, whatever their kind; each point is found by itself. A pitchfork
        is one of motions in a plane, without spin.
    parameter : str
        The one that is solved for.
    over : mapping of str to sequence of float
        Values of one or more others. Each line of points along the axis of the shortest steps is begun in its middle, and
        each point begins with what its neighbour has come to. A long stretch that is not reached is begun by itself. Of
        changes of sequence every such point is, and the last point of each stretch, too: where that gives another border, the
        stretch before it is looked for again.
    spin : float, optional
        Axial spin [rad s-1]; by default what a lateral start with `xdot0` rolls up to. Of a fold, a flip and a torus it is
        that to which the spin is put back at the start of each forcing period; of a change of sequence that after the double
        impact.
    start : PeriodicOrbit, optional
        From which the first point is looked for; by default one found between the ball's fold and flip.
    rtol : float
        Accuracy of the map [1].
    sustained : bool
        Whether the spin is free, and everywhere one at which nothing drifts, looked for near `spin`. A fold is then where two
        such spins appear, an end of stability where one ceases to attract or to be.
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along the names in `over`: `parameter`, the attributes of the border's `PeriodicOrbit`, `status` and `cost`, the
        forcing periods of the map that a point took. The status is "ok", or says why there is no point, or that there are
        more. A sequence may change alike at many values of the parameter, between where the branch turns round and
        where no end comes to rest any more: the row has the first one met, upwards before downwards, `several` has all of
        them, and the status is "one of 10". Beyond where no end comes to rest the branch is in pieces: if there is no such
        change before, the row is the last orbit of which an end does, and the status says that there are several beyond.
        `loses_stability` says whether a stable orbit loses its stability there: the multipliers are inside the unit circle on
        one side, and beyond the orbit has one outside, or there is none. Of a flip also `doubling`, the coefficient of its
        normal form: where it is positive a stable orbit of twice the period begins, where it is negative an unstable one ends.
        Of stable_from and stable_to also `ends_by`, the kind of border there. Of a change of sequence also `change`, the
        symbols that go and come: it may differ from point to point.
        Along `meeting`: where the curve meets another border along its last axis, with its `meets`; located to 1e-6.

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
    curve = replace(asked(kind, parameter, over, spin, rtol, fixed), sustained=check_switch("sustained", sustained))
    walk = GridWalk(curve, start)
    if not walk.found:
        raise OrbitError(f"no {kind} found in {parameter}: {next(iter(walk.told().values()))}")
    return _dataset(walk)


def _dataset(walk: GridWalk) -> xr.Dataset:
    curve, axes, rows = walk.curve, walk.axes, list(walk.found.values())
    cost = {"cost": ([one.cost for one in rows], "forcing periods of the map that the point took")}
    met = list(walk.meetings())
    table = curve.table(rows, "found", cost | curve.columns(rows))
    at = tuple(np.array(list(walk.found)).T)
    result = xr.Dataset(coords={name: (name, values, PARAMETERS[name].attributes()) for name, values in axes.items()})
    for name, each in table.data_vars.items():
        values = np.full(walk.shape + each.shape[1:], EMPTY.get(each.dtype.kind, np.nan), dtype=each.dtype)
        values[at] = each.values
        result[name] = ((*axes, *each.dims[1:]), values, each.attrs, each.encoding)
    told = walk.told()
    said = [told[index] for index in np.ndindex(walk.shape)]
    result["status"] = column(tuple(axes), np.reshape(said, walk.shape), FOUND_HOW)
    where = np.array([[*place.y, place.found.value] for place, _ in met]).reshape(-1, len(axes) + 1)
    for name, places in zip((*axes, curve.parameter), where.T, strict=True):
        units = PARAMETERS[name]._replace(long_name=f"{PARAMETERS[name].long_name} where two borders meet").attributes()
        result[f"{name}_at_meeting"] = ("meeting", places, units)
    names = np.array([name for _, name in met], dtype=str)
    result["meets"] = column("meeting", names, "the two borders that meet")
    fixed = {name: value for name, value in curve.given.items() if name not in (*axes, curve.parameter)}
    about = {name: table.attrs[name] for name in ("kind", "parameter", "spin", "cost")}
    result = result.assign_coords(fixed_coordinates(fixed)).assign_attrs(about | {"rtol": curve.rtol})
    return finished(result, f"Border of periodic orbits: {curve.kind.name} in {curve.parameter}")
