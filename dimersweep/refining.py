"""Boundaries at the cost of their length: cells of a coarse grid are halved only where the answers of a search disagree."""

import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT

from dimersweep.cube import label_variable
from dimersweep.deciding import Spec
from dimersweep.errors import ParameterError
from dimersweep.grid import Grid
from dimersweep.parameters import as_number, check, check_count
from dimersweep.progress import tell_of_compiling, watch
from dimersweep.searching import MIXED, REGIONS, Findings, as_cube, hints_from, make_spec, search_points
from dimersweep.store import check_writable, write_cube

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
        """Axes along which it has to be cut: those on which known labels (not -1) of a face disagree."""
        axes: set[int] = set()
        for face in self.faces():
            part = labels[face]
            free = {k for k, n in enumerate(part.shape) if n > 1}
            if not _differ(part).any():
                continue
            axes |= {k for k in free if _differ(part, k).any()} or free
        return axes


def _differ(labels: np.ndarray, axis: int | None = None) -> Any:
    """Whether the known labels are several, all of them or those on each line along `axis`."""
    lowest = np.where(labels < 0, np.iinfo(labels.dtype).max, labels).min(axis=axis)
    return lowest < labels.max(axis=axis)


def finer(values: np.ndarray, halvings: int) -> np.ndarray:
    """`values` with each of their intervals halved so many times; the given values are kept as they are."""
    parts = 1 << halvings
    steps = np.arange(parts) / parts
    inner = values[:-1, None] + np.diff(values)[:, None] * steps
    return np.append(inner.ravel(), values[-1])


def _coarse_cells(shape: Sequence[int], parts: Sequence[int]) -> list[Cell]:
    starts = (range(0, n - 1, part) for n, part in zip(shape, parts, strict=True))
    return [Cell(origin, tuple(parts)) for origin in product(*starts)]


class Map:
    """The fine grid of a refinement, of which only the points that are needed are computed."""

    def __init__(self, spec: Spec, between: Iterable[int], workers: int) -> None:
        self.spec, self.workers = spec, workers
        self.findings = Findings(spec.grid.size)
        self.computed = np.zeros(spec.grid.shape, dtype=bool)
        # regions that are not to be told apart count as one, MIXED
        self.lumped = np.full(MIXED + 1, MIXED)
        self.lumped[list(between)] = list(between)

    def labels(self) -> np.ndarray:
        """Region of each point as far as it matters, -1 where nothing was computed."""
        regions = self.lumped[self.findings.regions(self.spec.question)].reshape(self.computed.shape)
        return np.where(self.computed, regions, -1)

    def compute(self, cells: Sequence[Cell], parents: Sequence[Cell], progress: bool) -> None:
        """Search at the corners of `cells` that are still missing, with hints from the corners of their `parents`."""
        shape = self.spec.grid.shape
        near: dict[int, list[int]] = {}
        for cell, parent in zip(cells, parents, strict=True):
            around = [int(np.ravel_multi_index(place, shape)) for place in parent.corners()]
            for place in cell.corners():
                if not self.computed[place]:
                    near.setdefault(int(np.ravel_multi_index(place, shape)), []).extend(around)
        points = np.sort(np.fromiter(near, dtype=np.int64))
        hints = hints_from(self.findings, [sorted(set(near[point])) for point in points.tolist()])
        with watch(points.size, show=progress) as shown:
            search_points(self.spec, points, hints, self.findings, self.workers, shown)
        self.computed.ravel()[points] = True

    def refine(self, cells: list[Cell], progress: bool) -> list[Cell]:
        """Cut cells until no two known points on a face of one disagree; returns them all."""
        self.compute(cells, cells, progress)
        while True:
            labels = self.labels()
            cuts = {cell: axes for cell in cells if (axes := cell.torn(labels))}
            if not cuts:
                return cells
            pairs = [(half, cell) for cell, axes in cuts.items() for half in cell.halves(axes)]
            self.compute([half for half, _ in pairs], [cell for _, cell in pairs], progress)
            cells = [cell for cell in cells if cell not in cuts] + [half for half, _ in pairs]


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
    spec: Spec, halvings: Mapping[str, int], between: Sequence[str] | None
) -> tuple[dict[str, int], list[int]]:
    """Halvings of each axis of the coarse grid of `spec`, and the codes of the regions to be told apart.

    Raises
    ------
    ParameterError
        If they are not allowed.
    """
    axes = spec.grid.axes
    check(axes)  # a map has no gaps
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
    rtol: float = 1e-8,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    force: bool = False,
    attrs: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """A map of regions on a fine grid, at the cost of their boundaries: a search at every point where it is needed.

    The search is made at the points of `grid` first. A cell whose computed points (its corners, and what finer
    neighbours have added on its border) lie in different regions is halved along the axes on which they differ, down to
    the fine grid. A region that lies wholly inside of one cell of `grid`, touching no border of it, is not seen.

    Parameters
    ----------
    grid, fixed, over, ask, mode, periods, rtol, out, workers, progress, force, attrs
        As in `search`; the axes other than `over` are the coarse grid.
    halvings : mapping of str to int
        How often the intervals of each axis are halved at most.
    between : sequence of str, optional
        Regions to be told apart, all others counting as one; all by default.

    Returns
    -------
    xarray.Dataset
        As of `search`, on the fine grid; where ``computed`` is no, `answer`, `region` and `mode` are those of the
        cell around the point, and the rest is missing.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError
        For an `out` that cannot be written, before any work.
    """
    coarse = make_spec(grid, fixed, over=over, ask=ask, mode=mode, periods=periods, rtol=rtol, orbit_periods=0)
    counts, told_apart = check_refinement(coarse, halvings, between)
    workers = CPU_COUNT if workers is None else check_count("workers", workers)
    if out is not None:
        check_writable(out, force=force)
    if progress:
        tell_of_compiling()
    started = perf_counter()
    fine = {name: finer(values, counts[name]) for name, values in coarse.grid.axes.items()}
    spec = Spec(Grid(fine, coarse.grid.fixed), coarse.question, coarse.periods, coarse.rtol)
    made = Map(spec, told_apart, workers)
    cells = made.refine(_coarse_cells(spec.grid.shape, [1 << counts[name] for name in fine]), progress)
    configuration = coarse.configuration() | {
        "refine": {
            "halvings": {name: n for name, n in counts.items() if n},
            "between": [REGIONS[code] for code in told_apart],
        }
    }
    cube = _fill(as_cube(spec, made.findings, configuration, perf_counter() - started, attrs), cells, made.computed)
    if out is not None:
        write_cube(cube, out, force=force)
    return cube
