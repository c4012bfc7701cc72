"""Refined maps: cells of a coarse grid are halved only where the answers of a search disagree."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from typing import Any, NamedTuple, Self, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import variable
from dimersweep.cubes.grid import Grid, finer
from dimersweep.cubes.results import not_run
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count
from dimersweep.parameters import check
from dimersweep.studies import search
from dimersweep.studies.deciding import spread_order
from dimersweep.studies.making import make_cube
from dimersweep.studies.observing import OwnObserver
from dimersweep.studies.search import MIXED, REGIONS, Search
from dimersweep.studies.study import Batch, Sample
from dimersweep.work.options import OptionKeywords

MAX_HALVINGS = 12  # 4096 intervals of the fine grid in each of the coarse one
# variables that a point that was not computed takes from a corner of the cell around it
FILLED = ("answer", "region", "mode")


class Cell(NamedTuple):
    """A box of the fine grid: its lowest corner, and its extent along each axis in intervals."""

    origin: tuple[int, ...]
    size: tuple[int, ...]

    def spans(self) -> Iterator[tuple[int, int]]:
        """Return the lowest place and the extent of the cell along each axis."""
        return zip(self.origin, self.size, strict=True)

    def corners(self) -> list[tuple[int, ...]]:
        """Return the places of the corners."""
        return list(product(*((o, o + s) for o, s in self.spans())))

    def faces(self) -> list[tuple[slice, ...]]:
        """Return the boxes of points, borders included, that are filled from one corner each.

        Along an axis on which the cell is longer than 1 the box spans the cell. Along others each of the two places is
        a box of its own.
        """
        ends = ([slice(o, o + s + 1)] if s > 1 else [slice(o, o + 1), slice(o + 1, o + 2)] for o, s in self.spans())
        return list(product(*ends))

    def halves(self, along: set[int]) -> list["Cell"]:
        """Return the cells into which this one is cut, in two along each axis in `along`."""
        cut = ([(o, s // 2), (o + s // 2, s // 2)] if k in along else [(o, s)] for k, (o, s) in enumerate(self.spans()))
        return [Cell(*zip(*part, strict=True)) for part in product(*cut)]

    def torn(self, labels: np.ndarray) -> set[int]:
        """Return the axes along which known labels (not -1) of the points of the cell disagree.

        All axes are returned if labels disagree, but not on any line along an axis.
        """
        part = labels[tuple(slice(o, o + s + 1) for o, s in self.spans())]
        if not _differ(part).any():
            return set()
        axes = set(range(part.ndim))
        return {k for k in axes if _differ(part, k).any()} or axes

    def inside(self, axis: int = 0, margin: int = 0) -> tuple[slice, ...]:
        """Return the intervals of the cell, `margin` more at both ends along `axis`, as slices of the fine grid."""
        more = [margin * (k == axis) for k in range(len(self.origin))]
        return tuple(slice(max(0, o - m), o + s + m) for (o, s), m in zip(self.spans(), more, strict=True))


def _differ(labels: np.ndarray, axis: int | None = None) -> Any:
    """Return True where known labels (not -1) differ: among all labels, or on each line along `axis`."""
    # unknown labels (-1) must not count as the least
    lowest = np.where(labels < 0, np.iinfo(labels.dtype).max, labels).min(axis=axis)
    return lowest < labels.max(axis=axis)


def cuts(cells: Sequence[Cell], labels: np.ndarray) -> dict[Cell, set[int]]:
    """Return the cells that have to be cut, each with the axes to cut it along.

    A cell in which known labels disagree is halved while it is longer than 1. A cell that touches it at an end is
    brought to its size. So a border has cells of the finest size on both sides, and what lies near the border is seen.

    Parameters
    ----------
    cells : sequence of Cell
        All cells of the grid.
    labels : ndarray, int
        Labels of the points of the fine grid, -1 where not known.
    """
    shape = tuple(n - 1 for n in labels.shape)
    # greatest extent that a cell over each interval may have along each axis
    longest = np.full((labels.ndim, *shape), np.iinfo(np.int64).max)
    for cell in cells:
        for axis in cell.torn(labels):
            size = cell.size[axis]
            # neighbours at the ends may be as long as this cell, and the cell itself half as long
            for part, limit in ((cell.inside(axis, 1), size), (cell.inside(), max(1, size // 2))):
                np.minimum(longest[axis][part], limit, out=longest[axis][part])
    chosen = {}
    for cell in cells:
        axes = {k for k, size in enumerate(cell.size) if size > longest[k][cell.inside()].min()}
        if axes:
            chosen[cell] = axes
    return chosen


@dataclass(frozen=True, kw_only=True)
class RefinedMap(Search):
    """A search on a fine grid that computes only the points that the borders of regions need; see `Search`.

    Parameters
    ----------
    grid : Grid
        The fine grid.
    halvings : dict of str to int
        Number of halvings of the intervals of each axis.
    between : list of int
        Codes of the regions whose borders are refined.
    cells : sequence of Cell
        Cells into which the grid is cut. They are set anew for each batch and are no part of the configuration.
    """

    halvings: dict[str, int]
    between: list[int]
    cells: Sequence[Cell] = ()

    @property
    def summary(self) -> str:
        """Title of the cube, unless a user gives another one."""
        return "map refined at the borders of its regions, for a 3D dimer on a vibrating plate"

    @property
    def coarse(self) -> Grid:
        """Coarse grid, which is computed as a whole."""
        return Grid({name: axis[:: 1 << self.halvings[name]] for name, axis in self.grid.axes.items()}, self.grid.fixed)

    @property
    def labels(self) -> np.ndarray:
        """Label of each region, codes: its own code if it is in `between`, else MIXED, so that others count as one."""
        labels = np.full(MIXED + 1, MIXED)
        labels[self.between] = self.between
        return labels

    def configuration(self) -> dict[str, Any]:
        """Return the settings of the search on the coarse grid, with the halvings and the regions."""
        regions = [REGIONS[code] for code in self.between]
        halvings = {name: n for name, n in self.halvings.items() if n}
        refined = {"refine": {"halvings": halvings, "between": regions}}
        return super().configuration() | self.coarse.configuration() | refined

    def batches(self, results: Callable[[], np.ndarray]) -> Iterator[Batch]:
        """Yield the corners of the cells that are new, until no cell has to be cut (see `cuts`).

        Results that are known from a map that was stopped are used only in the batch that asks for them. So a resumed
        map is cut as one that was never stopped.
        """
        extent = tuple(1 << count for count in self.halvings.values())
        starts = (range(0, n - 1, part) for n, part in zip(self.grid.shape, extent, strict=True))
        cells = [Cell(origin, extent) for origin in product(*starts)]
        cut, reached = [(cell, cell) for cell in cells], np.zeros(self.grid.size, dtype=bool)
        while cut:
            near: dict[int, set[int]] = {}  # new corners, each with the corners of the cell that was cut
            for cell, parent in cut:
                around = self._corners(parent)
                for point in self._corners(cell):
                    if not reached[point]:
                        near.setdefault(point, set()).update(around)
            known = results()
            needed = ~not_run(known["codes"])
            needed[list(near)] = True
            ordered = {point: sorted(near[point]) for point in sorted(near)}
            yield replace(self, cells=cells).led(ordered, known, reached, int(needed.sum()))
            regions = np.where(reached, self.labels[self.regions(results())], -1)
            chosen = cuts(cells, regions.reshape(self.grid.shape))
            cut = [(half, cell) for cell, axes in chosen.items() for half in cell.halves(axes)]
            cells = [cell for cell in cells if cell not in chosen] + [half for half, _ in cut]

    def sample(self, rng: np.random.Generator) -> Sample:
        """Return cells spread over the coarse grid, each refined as if it were alone.

        Points that a border needs beyond its cell are left out: up to a third of all points, where borders run near
        edges of cells.
        """
        self.check_fits()
        cells = tuple(n - 1 for n in self.coarse.shape)
        units = prod(cells)
        parts = (self._cell(np.unravel_index(k, cells), cells) for k in spread_order(units).tolist())
        # a longer sample than for other studies: costs differ much, as only few cells are crossed by a border
        return Sample(units, "cells spread over the coarse grid", parts, seconds=30.0)

    def _cell(self, place: Sequence[int], cells: Sequence[int]) -> tuple[Self, np.ndarray]:
        """Return the map of one cell of the coarse grid, and the weights of its points [1], shape (n,)."""
        axes, shares = {}, np.ones(1)
        for (name, values), k, n in zip(self.grid.axes.items(), place, cells, strict=True):
            length = 1 << self.halvings[name]
            axes[name] = values[k * length : (k + 1) * length + 1]
            share = np.ones(length + 1)
            # a point at an end belongs to the neighbour, too, but for ends of the grid
            share[0], share[-1] = 1 if k == 0 else 0.5, 1 if k == n - 1 else 0.5
            shares = np.multiply.outer(shares, share).ravel()
        return replace(self, grid=Grid(axes, self.grid.fixed)), shares

    def _corners(self, cell: Cell) -> list[int]:
        """Return the numbers of the points at the corners of a cell."""
        return [int(np.ravel_multi_index(place, self.grid.shape)) for place in cell.corners()]

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """Return the results as a cube; `computed` says which points were run.

        The variables `FILLED` of other points are those of a corner of the cell around them.
        """
        cube = super().as_cube(results)
        computed = ~not_run(results["codes"]).reshape(self.grid.shape)
        filled = [cube[name].values for name in FILLED]
        for face in (face for cell in self.cells for face in cell.faces()):
            missing = ~computed[face]
            for values in filled:
                values[face][missing] = values[tuple(span.start for span in face)]
        cube["computed"] = variable("computed", tuple(self.grid.axes), computed)
        return cube


def study_of(coarse: Search, halvings: Mapping[str, int], between: Sequence[str] | None) -> RefinedMap:
    """Check a refined map that begins with a search on a coarse grid, and return it as a study; see `refine`.

    Raises
    ------
    ParameterError
        If halvings, regions or the search are not allowed in a map.
    """
    axes = coarse.grid.axes
    check(axes)  # all points must be allowed: a map has no gaps
    if not all(isinstance(each, OwnObserver) for each in coarse.observers):
        raise ParameterError("refine: goes with neither paths nor search.orbit_periods")
    if not isinstance(halvings, Mapping):
        raise ParameterError(f"halvings = {halvings!r}: must be a mapping of axes and whole numbers")
    for name, count in halvings.items():
        if name not in axes:
            raise ParameterError(f"refine.{name}: is no axis of the map ({', '.join(axes)})")
        if check_count(f"refine.{name}", count) > MAX_HALVINGS:
            raise ParameterError(f"refine.{name} = {count}: must be <= {MAX_HALVINGS}")
    for name, values in axes.items():
        if values.size < 2:
            raise ParameterError(
                f"{name} = {as_number(name, values[0])}: a map to refine needs two values of each axis"
            )
    for region in between or ():
        if region not in REGIONS:
            raise ParameterError(f"between = {region!r}: must be some of {', '.join(REGIONS)}")
    counts = {name: int(halvings.get(name, 0)) for name in axes}
    return RefinedMap(
        grid=Grid({name: finer(values, counts[name]) for name, values in axes.items()}, coarse.grid.fixed),
        how=coarse.how,
        observers=coarse.observers,
        question=coarse.question,
        halvings=counts,
        between=[REGIONS.index(region) for region in (REGIONS if between is None else between)],
    )


def refine(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    halvings: Mapping[str, int],
    between: Sequence[str] | None = None,
    over: str,
    ask: str = "any",
    mode: str = "drift",
    periods: int,
    max_periods: int | None = None,
    rtol: float = 1e-8,
    observe: Any = None,
    **options: Unpack[OptionKeywords],
) -> xr.Dataset:
    """Refine a map of regions where its borders are: a search at every point of a fine grid that the borders need.

    The search is made at the points of `grid` first. A cell of this grid is halved if its computed points lie in
    different regions: its corners, and points that finer neighbours have added on its border. It is halved along the
    axes on which they differ, down to the fine grid. Cells that it touches at its ends are brought to its size. A
    region that lies wholly inside of one cell of `grid`, away from every border, is not seen.

    Parameters
    ----------
    grid, fixed, over, ask, mode, periods, max_periods, rtol, observe
        As in `search`; the axes other than `over` are the coarse grid.
    halvings : mapping of str to int
        Greatest number of halvings of the intervals of each axis.
    between : sequence of str, optional
        Regions whose borders are refined; all other regions count as one. All by default.
    out, workers, progress, force, attrs, client, extend, retry, fail_fast, keep_tiles
        As in `search`.

    Returns
    -------
    xarray.Dataset
        Cube as of `search`, on the fine grid. Where ``computed`` is no, `answer`, `region` and `mode` are those of the
        cell around the point, and other variables are missing.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError, KernelError, PointError, UnfinishedError, Stopped
        As by `sweep`.

    Examples
    --------
    From which intensity between 0.5 and 0.9 does some of nine dip angles drift?

    >>> from dimersweep import names, refine
    >>> angles = {"start": 10, "stop": 50, "step": 5, "unit": "deg"}
    >>> grid = {"Gamma": [0.5, 0.9], "beta0": angles}
    >>> found = refine(grid, over="beta0", halvings={"Gamma": 3}, periods=100, progress=False)
    >>> names(found["region"]).values.tolist()
    ['rest', 'rest', 'rest', 'rest', 'rest', 'rest', 'rest', 'rest', 'drift']
    >>> int(found["computed"].sum()), found["computed"].size
    (5, 9)
    """
    settings: dict[str, Any] = {"periods": periods, "max_periods": max_periods, "rtol": rtol}
    coarse = search.study_of(grid, fixed, over=over, ask=ask, mode=mode, observe=observe, **settings)
    return make_cube(study_of(coarse, halvings, between), **options)
