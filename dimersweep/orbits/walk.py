"""The points of a border over a grid: begun in the middle of each line, followed from point to point, and confirmed."""

from collections.abc import Iterator, Set
from contextlib import suppress
from heapq import heappop, heappush
from itertools import groupby, product, takewhile
from typing import NamedTuple

import numpy as np

from dimersweep.errors import KernelError, OrbitError, ParameterError
from dimersweep.orbits.curve import Curve, Found, shortened
from dimersweep.orbits.orbit import PeriodicOrbit
from dimersweep.orbits.poincare import OrbitLost

Index = tuple[int, ...]  # of a point of a grid: its number along each axis

STRETCHES = 8  # in a line of points: shorter ones are not begun anew
AGREED = 1e-3  # distance of two points of one border, found in two ways, in the parameter over its scale


def outwards(shape: tuple[int, ...]) -> list[Index]:
    """Every point of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


class Try(NamedTuple):
    """A point to be looked for from a neighbour: its distance, its place in the order of the walk, and where it lies."""

    step: float
    order: int
    point: Index
    axis: int
    side: int


class Walk:
    """The points of a curve over a grid.

    The grid is taken line by line, along the axis of the shortest steps. Each line is begun in its middle, from a branch of
    orbits, and followed from point to neighbouring point. A long stretch of a line that is not reached is begun again. Points
    that are still missing are looked for from neighbouring lines. With a given start all is followed from the first point
    that is found, across lines as well.

    Where a motion may have many such borders, every point that is not reached is begun by itself, and so is the last one of
    each stretch that was followed: if that gives another one, the half of the stretch before it is given up and followed from
    there.

    Parameters
    ----------
    curve : Curve
    axes : dict of str to ndarray
    start : PeriodicOrbit, optional
    """

    def __init__(self, curve: Curve, axes: dict[str, np.ndarray], start: PeriodicOrbit | None) -> None:
        self.curve, self.axes, self.start = curve, axes, start
        self.found: dict[Index, Found] = {}
        self.begun_at: dict[Index, Index] = {}  # for each point that is found, the one from which it was followed
        self.status: dict[Index, str] = {}
        self.columns = list(axes.values())
        lengths = [column.size for column in self.columns]
        self.order = {index: n for n, index in enumerate(outwards(tuple(lengths)))}
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

    def _line(self, line: list[Index]) -> None:
        begun: set[Index] = set()
        least = 1 if self.curve.many else len(line) / STRETCHES
        while (index := _to_begin(line, self.found.keys() | begun, least)) is not None:
            begun.add(index)
            self._try(index, [])
            self._follow(across=self.start is not None)
        while (
            self.curve.many and self.start is None and (end := next(self._unconfirmed(line, begun), None)) is not None
        ):
            begun.add(end)
            self._confirm(end, line)
            self._follow(across=False)

    def _follow(self, across: bool) -> None:
        """Look for the neighbours of what has been found, the nearest first, along the lines only or also across them."""
        later = []
        while self.waiting:
            one = heappop(self.waiting)
            if one.point in self.found:
                continue
            if across or one.axis == self.fine:
                beside = (_moved(one.point, one.axis, by * one.side) for by in (1, 2, 3))
                self._try(one.point, list(takewhile(self.found.__contains__, beside)))
            else:
                later.append(one)
        self.waiting = sorted(later)

    def _try(self, index: Index, near: list[Index]) -> None:
        try:
            self.found[index], alone = self._point(index, near)
        except (OrbitLost, OrbitError, ParameterError) as reason:
            self.status.setdefault(index, shortened(str(reason)))
            return
        except KernelError as fault:
            self.status[index] = shortened(f"fault of the kernel: {fault}")
            return
        self.begun_at[index] = index if alone else self.begun_at[near[0]]
        self._wait_beside(index)

    def _wait_beside(self, index: Index) -> None:
        """Have the neighbours of a point that is found looked for."""
        for k, column in enumerate(self.columns):
            for side in (-1, 1):
                other = _moved(index, k, -side)
                if other in self.order and other not in self.found:
                    step = _steps(column)[min(other[k], index[k])]
                    heappush(self.waiting, Try(round(step, 9), self.order[other], other, k, side))

    def _point(self, index: Index, near: list[Index]) -> tuple[Found, bool]:
        """A point found from its neighbours, or by itself where that may be another one; whether it is the latter."""
        if not near:
            return self._alone(index), True
        found = self.curve.point(self._values(index), [self.found[at] for at in near], self.start)
        if not self.curve.is_sure(found):
            with suppress(OrbitLost, OrbitError, ParameterError):
                return self._alone(index), True
        return found, False

    def _alone(self, index: Index) -> Found:
        return self.curve.point(self._values(index), [], self.start)

    def _values(self, index: Index) -> dict[str, float]:
        return {name: float(column[k]) for (name, column), k in zip(self.axes.items(), index, strict=True)}

    # --- whether points that were followed are those that are found by themselves --------------------------------------

    def _unconfirmed(self, line: list[Index], begun: Set[Index]) -> Iterator[Index]:
        """Ends of the stretches of a line that were followed from one point, if they were not looked for by themselves."""
        for _, stretch in groupby((at for at in line if at in self.found), self.begun_at.__getitem__):
            points = list(stretch)
            yield from (end for end in (points[0], points[-1]) if end not in begun)

    def _confirm(self, end: Index, line: list[Index]) -> None:
        """Look for the end of a stretch by itself; if that is another point, give up the half of the stretch before it."""
        try:
            alone = self._alone(end)
        except (OrbitLost, OrbitError, ParameterError):
            return  # there is no orbit from which it could be found: what was followed is all that is known
        followed, source = self.found[end], self.begun_at[end]
        agree = abs(alone.value - followed.value) < AGREED * self.curve.axis.scale
        if agree and self.curve.status(alone) == self.curve.status(followed):
            return
        far = abs(end[self.fine] - source[self.fine])
        for at in line:
            if self.begun_at.get(at) == source and 2 * abs(at[self.fine] - end[self.fine]) < far:
                del self.found[at], self.begun_at[at]
        self.found[end], self.begun_at[end] = alone, end
        self._wait_beside(end)

    def failed(self) -> dict[Index, str]:
        """Why the other points are not found."""
        return {
            index: self.status.get(index, "no neighbour was found") for index in self.order if index not in self.found
        }


def _to_begin(line: list[Index], tried: Set[Index], least: float) -> Index | None:
    """The middle of the longest stretch of a line in which no point has been tried or found; none if it is short."""
    stretches = [list(stretch) for was, stretch in groupby(range(len(line)), lambda n: line[n] in tried) if not was]
    longest = max(stretches, key=len, default=[])
    if not longest or len(longest) < least:
        return None
    halfway = longest[(len(longest) - 1) // 2], longest[len(longest) // 2]
    return line[min(halfway, key=lambda n: abs(2 * n - len(line) + 1))]


def _steps(column: np.ndarray) -> np.ndarray:
    """Steps between the values of an axis, over the largest of them."""
    return np.abs(np.diff(column)) / np.abs(column).max()


def _moved(index: Index, axis: int, by: int) -> Index:
    return tuple(n + by * (k == axis) for k, n in enumerate(index))
