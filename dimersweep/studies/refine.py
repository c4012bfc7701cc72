"""Boundaries at the cost of their length: cells of a coarse grid are halved only where the answers of a search disagree."""

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
from dimersweep.work.options import Given, with_options

MAX_HALVINGS = 12
FILLED = ("answer", "region", "mode")  # what a point that was not computed takes from the cell around it


class Cell(NamedTuple):
    """A box of the fine grid: its lowest corner and its extent, in points."""

    origin: tuple[int, ...]
    size: tuple[int, ...]

    def spans(self) -> Iterator[tuple[int, int]]:
        """Its lowest place and its extent along each axis."""
        return zip(self.origin, self.size, strict=True)

    def corners(self) -> list[tuple[int, ...]]:
        """Places of the corners."""
        return list(product(*((o, o + s) for o, s in self.spans())))

    def faces(self) -> list[tuple[slice, ...]]:
        """Boxes, borders included, that the cell falls into along the axes on which it cannot be cut any more."""
        ends = ([slice(o, o + s + 1)] if s > 1 else [slice(o, o + 1), slice(o + 1, o + 2)] for o, s in self.spans())
        return list(product(*ends))

    def halves(self, along: set[int]) -> list["Cell"]:
        """The cell cut in two along each axis in `along`."""
        cut = ([(o, s // 2), (o + s // 2, s // 2)] if k in along else [(o, s)] for k, (o, s) in enumerate(self.spans()))
        return [Cell(*zip(*part, strict=True)) for part in product(*cut)]

    def torn(self, labels: np.ndarray) -> set[int]:
        """Axes along which known labels (not -1) of its points disagree."""
        part = labels[tuple(slice(o, o + s + 1) for o, s in self.spans())]
        if not _differ(part).any():
            return set()
        axes = set(range(part.ndim))
        return {k for k in axes if _differ(part, k).any()} or axes

    def inside(self, axis: int = 0, margin: int = 0) -> tuple[slice, ...]:
        """The cells of the fine grid that it covers, and as many as `margin` more at both its ends along `axis`."""
        more = [margin * (k == axis) for k in range(len(self.origin))]
        return tuple(slice(max(0, o - m), o + s + m) for (o, s), m in zip(self.spans(), more, strict=True))


def _differ(labels: np.ndarray, axis: int | None = None) -> Any:
    """Whether the known labels are several, all of them or those on each line along `axis`."""
    lowest = np.where(labels < 0, np.iinfo(labels.dtype).max, labels).min(axis=axis)
    return lowest < labels.max(axis=axis)


def cuts(cells: Sequence[Cell], labels: np.ndarray) -> dict[Cell, set[int]]:
    """Cells that have to be cut, each with the axes.

    A cell on which known labels disagree is halved as long as there is something to halve, and one that touches it at an
    end is brought to its size: so a border has cells of the finest size on either side, and what lies near it is seen.

    Parameters
    ----------
    cells : sequence of Cell
        Of the whole grid.
    labels : ndarray, int
        Of the points of the fine grid, -1 where not known.
    """
    shape = tuple(n - 1 for n in labels.shape)
    longest = np.full((labels.ndim, *shape), np.iinfo(np.int64).max)  # that a cell may be along each axis
    for cell in cells:
        for axis in cell.torn(labels):
            size = cell.size[axis]
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
    """A search on a fine grid, of which only the points that are needed are computed; see `Search`.

    Parameters
    ----------
    grid : Grid
        The fine grid.
    halvings : dict of str to int
        Of each axis.
    between : list of int
        Regions to be told apart, codes.
    cells : sequence of Cell
        Into which it is cut. Given from batch to batch, and no part of the configuration.
    """

    halvings: dict[str, int]
    between: list[int]
    cells: Sequence[Cell] = ()

    @property
    def summary(self) -> str:
        """See `Study`."""
        return "map refined at the borders of its regions, for a 3D dimer on a vibrating plate"

    @property
    def coarse(self) -> Grid:
        """The grid to begin with."""
        return Grid({name: axis[:: 1 << self.halvings[name]] for name, axis in self.grid.axes.items()}, self.grid.fixed)

    @property
    def labels(self) -> np.ndarray:
        """What each region counts as, codes: those that are not to be told apart count as one, MIXED."""
        labels = np.full(MIXED + 1, MIXED)
        labels[self.between] = self.between
        return labels

    def configuration(self) -> dict[str, Any]:
        """See `Study`."""
        told_apart = [REGIONS[code] for code in self.between]
        halvings = {name: n for name, n in self.halvings.items() if n}
        refined = {"refine": {"halvings": halvings, "between": told_apart}}
        return super().configuration() | self.coarse.configuration() | refined

    def batches(self, results: Callable[[], np.ndarray]) -> Iterator[Batch]:
        """See `Study`: cells are cut until there is none to be cut (see `cuts`).

        What was known before is used when its turn comes, so that a map that goes on is cut as an undisturbed one.
        """
        extent = tuple(1 << count for count in self.halvings.values())
        starts = (range(0, n - 1, part) for n, part in zip(self.grid.shape, extent, strict=True))
        cells = [Cell(origin, extent) for origin in product(*starts)]
        cut, reached = [(cell, cell) for cell in cells], np.zeros(self.grid.size, dtype=bool)
        while cut:
            near: dict[int, set[int]] = {}  # of the corners that are new: those of the cell that was cut
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
        """See `Study`: cells spread over the coarse grid, each refined as if it were alone.

        What a border asks for beyond the cell is left out: of borders near the edges of cells, up to a third of the points.
        """
        self.check_fits()
        cells = tuple(n - 1 for n in self.coarse.shape)
        units = prod(cells)
        parts = (self._cell(np.unravel_index(k, cells), cells) for k in spread_order(units).tolist())
        return Sample(units, "cells spread over the coarse grid", parts, seconds=30.0)

    def _cell(self, place: Sequence[int], cells: Sequence[int]) -> tuple[Self, np.ndarray]:
        """The map of one cell of the coarse grid, and the shares of its points that belong to the cell."""
        axes, shares = {}, np.ones(1)
        for (name, values), k, n in zip(self.grid.axes.items(), place, cells, strict=True):
            length = 1 << self.halvings[name]
            axes[name] = values[k * length : (k + 1) * length + 1]
            share = np.ones(length + 1)
            share[0], share[-1] = 1 if k == 0 else 0.5, 1 if k == n - 1 else 0.5  # ends are of neighbours, too
            shares = np.multiply.outer(shares, share).ravel()
        return replace(self, grid=Grid(axes, self.grid.fixed)), shares

    def _corners(self, cell: Cell) -> list[int]:
        """Numbers of the points at the corners of a cell."""
        return [int(np.ravel_multi_index(place, self.grid.shape)) for place in cell.corners()]

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """See `Study`; points that were not computed are set to what the corners of cells around are, and told apart."""
        cube = super().as_cube(results)
        computed = ~not_run(results["codes"]).reshape(self.grid.shape)
        for face in (face for cell in self.cells for face in cell.faces()):
            missing = ~computed[face]
            for name in FILLED:
                values = cube[name].values
                values[face][missing] = values[tuple(span.start for span in face)]
        cube["computed"] = variable("computed", tuple(self.grid.axes), computed)
        return cube


def study_of(coarse: Search, halvings: Mapping[str, int], between: Sequence[str] | None) -> RefinedMap:
    """The refined map that begins with a search on a coarse grid, checked; see `refine`.

    Raises
    ------
    ParameterError
        If something is not allowed.
    """
    axes = coarse.grid.axes
    check(axes)  # a map has no gaps
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
    **options: Unpack[Given],
) -> xr.Dataset:
    """A map of regions on a fine grid, at the cost of their boundaries: a search at every point where it is needed.

    The search is made at the points of `grid` first. A cell whose computed points (its corners, and what finer
    neighbours have added on its border) lie in different regions is halved along the axes on which they differ, down to
    the fine grid, and the cells that it touches at its ends are brought to its size. A region that lies wholly inside of
    one cell of `grid`, away from every border, is not seen.

    Parameters
    ----------
    grid, fixed, over, ask, mode, periods, max_periods, rtol, observe
        As in `search`; the axes other than `over` are the coarse grid.
    halvings : mapping of str to int
        How often the intervals of each axis are halved at most.
    between : sequence of str, optional
        Regions to be told apart, all others counting as one; all by default.
    out, workers, progress, force, attrs, client, extend, retry, fail_fast, keep_tiles
        As in `search`.

    Returns
    -------
    xarray.Dataset
        As of `search`, on the fine grid; where ``computed`` is no, `answer`, `region` and `mode` are those of the
        cell around the point, and the rest is missing.

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


refine.__signature__ = with_options(refine)  # type: ignore[attr-defined]
