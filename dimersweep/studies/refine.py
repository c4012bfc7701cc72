"""Boundaries at the cost of their length: cells of a coarse grid are halved only where the answers of a search disagree."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import Any, NamedTuple, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import label_variable
from dimersweep.cubes.grid import Grid, finer
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count
from dimersweep.parameters import check
from dimersweep.studies.deciding import SearchSpec
from dimersweep.studies.making import complete_cube, unfinished_cube
from dimersweep.studies.search import (
    MIXED,
    REGIONS,
    Findings,
    as_cube,
    begin,
    make_spec,
    to_search_again,
)
from dimersweep.work.computing import Crew
from dimersweep.work.options import Given, Options, make_options

MAX_HALVINGS = 12
FILLED = ("answer", "region", "mode")  # what a point that was not computed takes from the cell around it


class Cell(NamedTuple):
    """A box of the fine grid: its lowest corner and its extent, in points."""

    origin: tuple[int, ...]
    size: tuple[int, ...]

    def corners(self) -> list[tuple[int, ...]]:
        """Places of the corners."""
        return list(product(*((o, o + s) for o, s in zip(self.origin, self.size, strict=True))))

    def faces(self) -> list[tuple[slice, ...]]:
        """Boxes, borders included, that the cell falls into along the axes on which it cannot be cut any more."""
        spans = [
            [slice(o, o + s + 1)] if s > 1 else [slice(o, o + 1), slice(o + 1, o + 2)]
            for o, s in zip(self.origin, self.size, strict=True)
        ]
        return list(product(*spans))

    def halves(self, along: set[int]) -> list["Cell"]:
        """The cell cut in two along each axis in `along`."""
        cuts = [
            [(o, s // 2), (o + s // 2, s // 2)] if k in along else [(o, s)]
            for k, (o, s) in enumerate(zip(self.origin, self.size, strict=True))
        ]
        return [Cell(*map(tuple, zip(*part, strict=True))) for part in product(*cuts)]

    def torn(self, labels: np.ndarray) -> set[int]:
        """Axes along which known labels (not -1) of its points disagree."""
        part = labels[tuple(slice(o, o + s + 1) for o, s in zip(self.origin, self.size, strict=True))]
        if not _differ(part).any():
            return set()
        axes = set(range(part.ndim))
        return {k for k in axes if _differ(part, k).any()} or axes

    def inside(self, axis: int = 0, margin: int = 0) -> tuple[slice, ...]:
        """The cells of the fine grid that it covers, and as many as `margin` more at both its ends along `axis`."""
        return tuple(
            slice(max(0, o - margin), o + s + margin) if k == axis else slice(o, o + s)
            for k, (o, s) in enumerate(zip(self.origin, self.size, strict=True))
        )


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


def _coarse_cells(shape: Sequence[int], parts: Sequence[int]) -> list[Cell]:
    starts = (range(0, n - 1, part) for n, part in zip(shape, parts, strict=True))
    return [Cell(origin, tuple(parts)) for origin in product(*starts)]


@dataclass(frozen=True)
class RefineSpec:
    """All that decides the numbers of a refined map.

    Parameters
    ----------
    coarse : SearchSpec
        The search on the grid to begin with.
    halvings : dict of str to int
        Of each axis.
    between : list of int
        Regions to be told apart, codes.
    """

    coarse: SearchSpec
    halvings: dict[str, int]
    between: list[int]

    summary = "map refined at the borders of its regions, for a 3D dimer on a vibrating plate"
    by_blocks = False

    @cached_property
    def fine(self) -> SearchSpec:
        """The search on the fine grid, of which only the points that are needed are computed."""
        axes = self.coarse.grid.axes.items()
        fine = {name: finer(values, self.halvings[name]) for name, values in axes}
        return replace(self.coarse, grid=Grid(fine, self.coarse.grid.fixed))

    @property
    def grid(self) -> Grid:
        """The fine grid."""
        return self.fine.grid

    @property
    def kind(self) -> np.dtype:
        """Of the result of one point."""
        return self.fine.kind

    @property
    def labels(self) -> np.ndarray:
        """What each region counts as, codes: those that are not to be told apart count as one, MIXED."""
        labels = np.full(MIXED + 1, MIXED)
        labels[self.between] = self.between
        return labels

    def configuration(self) -> dict[str, Any]:
        """All that decides its numbers, as JSON can hold it."""
        told_apart = [REGIONS[code] for code in self.between]
        halvings = {name: n for name, n in self.halvings.items() if n}
        return self.coarse.configuration() | {"refine": {"halvings": halvings, "between": told_apart}}


def run_refine(spec: RefineSpec, options: Options) -> xr.Dataset:
    """The cube of a refined map: what is there already, then what is missing, cell by cell.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `refine`.
    """
    former = complete_cube(spec, options)
    if former is not None:
        return former
    with unfinished_cube(spec, options, partial(to_search_again, spec.fine)) as cube:
        findings, origin = begin(spec.fine, options, cube.results())
        cells = cut_cells(spec, findings, cube.crew)
        results = cube.results()
        computed = Findings(spec.fine.question, results).known.reshape(spec.grid.shape)
        return cube.write(_fill(as_cube(spec.fine, results, cube.attributes(origin)), cells, computed))


def cut_cells(spec: RefineSpec, findings: Findings, crew: Crew) -> list[Cell]:
    """Cut cells until there is none to be cut (see `cuts`), with searches at the corners that are not known; returns them.

    What was known before is used when its turn comes, so that a map that goes on is cut as an undisturbed one.
    """
    cells = _coarse_cells(spec.grid.shape, [1 << count for count in spec.halvings.values()])
    _search_corners(spec, findings, cells, cells, crew)
    while True:
        labels = np.where(findings.reached, spec.labels[findings.regions()], -1).reshape(spec.grid.shape)
        chosen = cuts(cells, labels)
        if not chosen:
            return cells
        pairs = [(half, cell) for cell, axes in chosen.items() for half in cell.halves(axes)]
        _search_corners(spec, findings, [half for half, _ in pairs], [cell for _, cell in pairs], crew)
        cells = [cell for cell in cells if cell not in chosen] + [half for half, _ in pairs]


def _search_corners(
    spec: RefineSpec, findings: Findings, cells: Sequence[Cell], parents: Sequence[Cell], crew: Crew
) -> None:
    """Search at the corners of `cells` that are new, with hints from the corners of their `parents`."""
    near: dict[int, set[int]] = {}
    for cell, parent in zip(cells, parents, strict=True):
        around = _corners(spec.grid, parent)
        for point in _corners(spec.grid, cell):
            if not findings.reached[point]:
                near.setdefault(point, set()).update(around)
    points = np.sort(np.fromiter(near, dtype=np.int64))
    needed = findings.known | findings.reached
    needed[points] = True
    crew.expect(int(needed.sum()))
    findings.search(spec.fine, points, [sorted(near[point]) for point in points.tolist()], crew)


def _corners(grid: Grid, cell: Cell) -> list[int]:
    """Numbers of the points at the corners of a cell."""
    return [int(np.ravel_multi_index(place, grid.shape)) for place in cell.corners()]


def _fill(cube: xr.Dataset, cells: Iterable[Cell], computed: np.ndarray) -> xr.Dataset:
    """`cube` with the points that were not computed set to what the corners around are, and a flag that tells them apart."""
    for face in (face for cell in cells for face in cell.faces()):
        missing = ~computed[face]
        for name in FILLED:
            values = cube[name].values
            values[face][missing] = values[tuple(span.start for span in face)]
    cube["computed"] = label_variable("computed", tuple(map(str, cube["mode"].dims)), computed)
    return cube


def check_refinement(
    spec: SearchSpec, halvings: Mapping[str, int], between: Sequence[str] | None
) -> tuple[dict[str, int], list[int]]:
    """Halvings of each axis of the coarse grid of `spec`, and the codes of the regions to be told apart.

    Raises
    ------
    ParameterError
        If they are not allowed.
    """
    axes = spec.grid.axes
    check(axes)  # a map has no gaps
    if spec.paths or spec.orbit_periods:
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
    told_apart = [REGIONS.index(region) for region in (REGIONS if between is None else between)]
    return {name: int(halvings.get(name, 0)) for name in axes}, told_apart


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
    **options: Unpack[Given],
) -> xr.Dataset:
    """A map of regions on a fine grid, at the cost of their boundaries: a search at every point where it is needed.

    The search is made at the points of `grid` first. A cell whose computed points (its corners, and what finer
    neighbours have added on its border) lie in different regions is halved along the axes on which they differ, down to
    the fine grid, and the cells that it touches at its ends are brought to its size. A region that lies wholly inside of
    one cell of `grid`, away from every border, is not seen.

    Parameters
    ----------
    grid, fixed, over, ask, mode, periods, max_periods, rtol
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
    coarse = make_spec(grid, fixed, over=over, ask=ask, mode=mode, periods=periods, max_periods=max_periods, rtol=rtol)
    return run_refine(RefineSpec(coarse, *check_refinement(coarse, halvings, between)), make_options(**options))
