"""What a sweep, a search or a map would cost, estimated from a timed sample of it; nothing is written."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from itertools import islice
from math import ceil, inf, prod, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import signed
from dimersweep.cubes.grid import Grid, legal_points
from dimersweep.cubes.points import check_fits
from dimersweep.cubes.results import Finished, Tile, blank_results
from dimersweep.errors import UnfinishedError
from dimersweep.storage.memorystore import MemoryStore
from dimersweep.storage.provenance import as_text
from dimersweep.storage.store import looked_at
from dimersweep.storage.tilestore import modes_of, tiles_of
from dimersweep.studies import search, sweep
from dimersweep.studies.deciding import SearchSpec, Wave, spread_order
from dimersweep.studies.making import Study
from dimersweep.studies.refine import RefineSpec, cut_cells
from dimersweep.studies.sweep_spec import Spec
from dimersweep.work.computing import crew
from dimersweep.work.options import Options
from dimersweep.work.proving import prove
from dimersweep.work.scheduling import TILES_PER_WORKER
from dimersweep.work.stopping import stoppable
from dimersweep.work.tiles import TILE_SECONDS, Work, attempt

SAMPLE = 200  # points or cells timed at most
MOST_OF_LINE = 20  # values of a line that are timed
POINT_SECONDS, CELL_SECONDS = 10.0, 30.0  # a sample ends after this time, though not before its first one
_SEED = 20100


@dataclass(frozen=True)
class Plan:
    """The cost of a sweep, a search or a map.

    Parameters
    ----------
    grid_points, done, workers : int
        Points of the cube, those among them that are finished already, and threads to be.
    bytes_per_point : int
        Of a cube, not compressed.
    units : int
        Of what was sampled: points, or cells of the coarse grid of a map.
    unit : str
        What it is called.
    points : ndarray, shape (n,), float64
        Points to run for each unit of the sample; a share of those that others need too.
    times : ndarray, shape (n,), float64
        Their times [s].
    line : int
        Points that are run in one piece, see `Grid.line`.
    """

    grid_points: int
    done: int
    workers: int
    bytes_per_point: int
    units: int
    unit: str
    points: np.ndarray
    times: np.ndarray
    line: int = 1

    def _total(self, values: np.ndarray) -> tuple[float, float]:
        """What the sample says of the sum of `values` over all units, and its standard error."""
        n = values.size
        spread = inf if n < 2 < self.units else float(values.std(ddof=min(1, n - 1)))
        return self.units * float(values.mean()), self.units * spread * sqrt((1 - n / self.units) / n)

    @property
    def to_run(self) -> int:
        """Points to be run in all."""
        return max(1, self.done, round(self._total(self.points)[0]))

    @property
    def tile_points(self) -> int:
        """Points in a tile."""
        longest = ceil(self.to_run / (TILES_PER_WORKER * self.workers))
        return self.line * max(1, min(longest, int(TILE_SECONDS * self.points.sum() / self.times.sum())) // self.line)

    @property
    def seconds(self) -> tuple[float, float]:
        """Estimate of the time left, and its standard error from the spread of the sample [s]."""
        share = (1 - self.done / self.to_run) / self.workers
        time, error = self._total(self.times)
        return share * time, share * error

    def lines(self) -> list[str]:
        """The plan in words."""
        left, (seconds, error) = self.to_run - self.done, self.seconds
        points = f"{self.to_run}"
        if (self.points != self.line).any():  # of a map
            spread = self._total(self.points)[1]
            points = (
                f"about {points} (standard error {spread:.0f}), or a third more, of a fine grid of {self.grid_points}"
            )
        done = f", {self.done} of them done" if self.done else ""
        low, middle, high = (_time(float(value)) for value in np.quantile(self.times, (0, 0.5, 1)))
        return [
            f"points: {points}{done}",
            f"tiles: {ceil(left / self.tile_points)} of {self.tile_points} points",
            f"cube: {_bytes(self.grid_points * self.bytes_per_point)} before compression",
            f"time: {_time(seconds)} on {self.workers} threads, give or take {_time(error)} (standard error)",
            f"sample: {self.times.size} {self.unit}, {_time(float(self.times.mean()))} each on average "
            f"(shortest {low}, median {middle}, longest {high})",
        ]


def plan(study: Study, workers: int, out: Path | None = None) -> Plan:
    """Time a random sample of a sweep, a search or a map, on one thread.

    Parameters
    ----------
    study : Spec, SearchSpec or RefineSpec
        The grid of a sweep may be of any size: only the sampled points are laid out.
    workers : int
        Threads that it would have.
    out : Path, optional
        The cube to be; points that are finished for it need not be run again.

    Returns
    -------
    Plan
    """
    stoppable(lambda stop: prove())  # and compile
    rng = np.random.default_rng(_SEED)
    seconds = POINT_SECONDS
    if isinstance(study, Spec):
        units, unit = study.grid.size // study.line, "random points" if study.line == 1 else "random lines"
        costs = _of_lines(study, rng.choice(units, min(SAMPLE, units), replace=False))
    elif isinstance(study, RefineSpec):
        check_fits(study.grid, by_blocks=False)
        units, unit, seconds = (
            prod(n - 1 for n in study.coarse.grid.shape),
            "cells spread over the coarse grid",
            CELL_SECONDS,
        )
        costs = _of_cells(study, spread_order(units))
    else:
        assert isinstance(study, SearchSpec)
        check_fits(study.grid, by_blocks=False)
        legal = legal_points(study.grid)
        units, unit = int(legal.sum()), "random points"
        costs = _of_searches(study, legal, rng.permutation(np.flatnonzero(legal)))
    sample = np.array(list(_for_some_time(costs, seconds)))
    bytes_per_point = sum(variable.nbytes for variable in _of_one_point(study).data_vars.values())
    return Plan(
        study.grid.size,
        _done(study, out),
        workers,
        bytes_per_point,
        units,
        unit,
        sample[:, 0],
        sample[:, 1],
        study.grid.line,
    )


Cost = tuple[float, float]  # points to run, and their time [s]


def _for_some_time(costs: Iterator[Cost], seconds: float) -> Iterator[Cost]:
    """At least one of `costs`, and no more than `SAMPLE` or than come within that time."""
    started = perf_counter()
    for cost in islice(costs, SAMPLE):
        yield cost
        if perf_counter() - started > seconds:
            break


def _made(work: Work, point: int) -> Finished:
    made = stoppable(lambda stop: attempt(work, (Tile(point, point + work.line),), stop))
    if made.broken:
        raise UnfinishedError(f"{work.grid.point(point)} could not be run: {made.broken.reason}")
    return made.finished[0]


def _of_lines(spec: Spec, numbers: np.ndarray) -> Iterator[Cost]:
    """Costs of lines of a sweep: of its points, unless a state is carried along them; of a long line by some of its values."""
    short = spec
    if spec.line > MOST_OF_LINE:
        *_, (axis, values) = spec.grid.axes.items()
        some = values[np.linspace(0, spec.line - 1, MOST_OF_LINE).round().astype(int)]
        short = replace(spec, grid=Grid(spec.grid.axes | {axis: some}, spec.grid.fixed))
    for number in numbers.tolist():
        yield spec.line, _made(short, number * short.line).seconds * spec.line / short.line


def _of_searches(spec: SearchSpec, legal: np.ndarray, numbers: np.ndarray) -> Iterator[Cost]:
    """Costs of points of a search, each begun with what decides at a point beside it, as most of them are."""
    for point in numbers.tolist():
        beside = point - 1 if point else min(1, legal.size - 1)
        decider = 0
        if spec.question.led and legal[beside]:
            decider = int(_made(Wave(spec, {beside: []}), beside).results["decider"][0])
        yield 1, _made(Wave(spec, {point: [decider - 1] if decider else []}), point).seconds


def _of_cells(spec: RefineSpec, numbers: np.ndarray) -> Iterator[Cost]:
    """Costs of cells of the coarse grid of a map, each refined as if it were alone, points that are shared counting in part.

    What a border asks for beyond the cell is left out: of borders near the edges of cells, up to a third of the points.
    """
    axes, cells = spec.coarse.grid.axes, tuple(n - 1 for n in spec.coarse.grid.shape)
    for number in numbers.tolist():
        place = np.unravel_index(number, cells)
        own = {name: values[k : k + 2] for (name, values), k in zip(axes.items(), place, strict=True)}
        cell = replace(spec, coarse=replace(spec.coarse, grid=Grid(own, spec.coarse.grid.fixed)))
        store = MemoryStore(cell.grid.size, cell.kind)
        with crew(store, Options(workers=1, progress=False)) as hands:
            cut_cells(cell, search.Findings(cell.fine.question, store.read(0, cell.grid.size)), hands)
        ends = zip(place, cells, cell.grid.shape, strict=True)
        share = reduce(np.multiply.outer, [_shares(n, k == 0, k == last - 1) for k, last, n in ends]).ravel()
        made = store.results["counts"].sum(axis=1)
        yield float(share[made > 0].sum()), store.seconds * float(share @ made) / float(made.sum())


def _shares(n: int, first: bool, last: bool) -> np.ndarray:
    """What of `n` points along an axis belongs to a cell: those at its ends are its neighbours' too, if it has any."""
    shares = np.ones(n)
    shares[0], shares[-1] = 1 if first else 0.5, 1 if last else 0.5
    return shares


def _of_one_point(study: Study) -> xr.Dataset:
    """The cube of the first point of a study, without results."""
    blank, told = blank_results(1, study.kind), study.configuration()
    if isinstance(study, Spec):
        return signed(sweep.as_cube(replace(study, grid=study.grid.first()), blank, {}), told)
    spec = study.fine if isinstance(study, RefineSpec) else study
    assert isinstance(spec, SearchSpec)
    return signed(search.as_cube(replace(spec, grid=spec.grid.first()), blank, {}), told)


def _done(study: Study, out: Path | None) -> int:
    if out is None or not tiles_of(out).exists():
        return 0
    with looked_at(tiles_of(out)) as store:
        same = as_text(store.configuration) == as_text(study.configuration())
        return modes_of(store.told()).total() if same else 0


def _bytes(number: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if number < 1000:
            return f"{number:.3g} {unit}"
        number /= 1000
    return f"{number:.3g} TB"


def _time(seconds: float) -> str:
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
