"""A study: points, how each of them is run, what is observed there, and how the results become a cube and back."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import blank, build, results_in, with_fields
from dimersweep.cubes.grid import Grid, check_fits
from dimersweep.cubes.results import Field, Tile, blank_results, kind_with, not_ok
from dimersweep.errors import ParameterError
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.runs.carrying import carried
from dimersweep.runs.solving import SLOW_MODES, RunSettings, run_patiently
from dimersweep.storage.provenance import PART
from dimersweep.studies.observers import Observer, Ran, needs_of
from dimersweep.work.parts import SweepPart

MOST_PARTS = 200  # that are timed
MOST_OF_LINE = 20  # values of a line that are timed


class Batch(NamedTuple):
    """Points that are run together.

    Attributes
    ----------
    study : Study
        What is done at them; with the state of a search that goes on.
    ranges : sequence of Tile
        They, in order; what is known of them already is not run again.
    wanted : int
        How many points are to be run in all, as far as that is known.
    """

    study: "Study"
    ranges: Sequence[Tile]
    wanted: int


class Sample(NamedTuple):
    """Parts of a study that are run to see what all of it costs.

    Attributes
    ----------
    units : int
        How many such parts make up the study.
    unit : str
        What they are called.
    parts : iterator
        Some of them, as studies, each with the share to which each of its points counts: in part, if others need it too.
    seconds : float
        Time after which no further part is run [s].
    """

    units: int
    unit: str
    parts: Iterator[tuple["Study", np.ndarray]]
    seconds: float = 10.0


@dataclass(frozen=True, kw_only=True)
class Study:
    """All that decides the numbers of a cube; this one runs every point once. See `Work`, too.

    Parameters
    ----------
    grid : Grid
        The points. Where it has the axis `direction`, the state is carried along the last axis, see `with_directions`.
    how : RunSettings
        How long each point is run, and how accurately.
    observers : tuple of Observer
        What is known of each point besides the numbers of its run.
    part : SweepPart, optional
        The points that are run, where that is not all of them; the others stay without a result.
    """

    grid: Grid
    how: RunSettings
    observers: tuple[Observer, ...] = ()
    part: SweepPart | None = None

    own_fields: ClassVar[tuple[Field, ...]] = ()  # of a result, that become variables in another way than others do

    @property
    def summary(self) -> str:
        """What its cube shows, the title unless another one is given."""
        return "sweep of a 3D dimer on a vibrating plate"

    @property
    def fields(self) -> tuple[Field, ...]:
        """What its observers add to the result of a point."""
        return tuple(each for observer in self.observers for each in observer.fields)

    @property
    def kind(self) -> np.dtype:
        """Of the result of one point."""
        return kind_with((*self.own_fields, *self.fields))

    @property
    def by_blocks(self) -> bool:
        """Whether the cube may be larger than memory, made block by block: that of a grid with one value a variable."""
        one_number = all(each.along is None and "S" not in each.type for each in self.fields)
        return one_number and not (self.own_fields or self.grid.columns)

    @property
    def size(self) -> int:
        """Number of points."""
        return self.grid.size

    @property
    def line(self) -> int:
        """See `Work`."""
        return self.grid.line

    def check_fits(self) -> None:
        """Refuse what memory cannot be expected to hold, see `cubes.grid`."""
        check_fits(self.grid, by_blocks=self.by_blocks)

    def configuration(self) -> dict[str, Any]:
        """All that decides the numbers, as JSON can hold it, with the version of the kernel."""
        settings = self.grid.configuration() | self.asked() | {"kernel_version": kernel_version()}
        if self.how.max_periods > self.how.periods:
            settings["max_periods"] = self.how.max_periods
        for observer in self.observers:
            settings |= observer.settings()
        return settings | ({} if self.part is None else {PART: str(self.part)})

    def cut(self, part: SweepPart) -> Self:
        """Return this study with the points of a part alone; raise a ParameterError if it cannot be cut into so many."""
        pieces, unit = self.size // self.line, "points" if self.line == 1 else "lines"
        if part.total > pieces:
            raise ParameterError(f"part = {part}: this sweep has {pieces} {unit}, and so at most {pieces} parts")
        return replace(self, part=part)

    def asked(self) -> dict[str, Any]:
        """The part of a configuration that says what is done at each point."""
        how = self.how
        return {"periods": how.periods, "rtol": how.rtol, "stop_when_settled": how.stop_when_settled}

    def narrowed(self, points: np.ndarray) -> tuple[Self, np.ndarray]:
        """See `Work`."""
        first, last = points[[0, -1]].tolist()
        grid, start = self.grid.window(first, last + 1)
        return replace(self, grid=grid), points - first + start

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """See `Work`: until one has used all its periods, so that quick points do not go on for long with slow ones."""
        done = 0
        for ran in self._runs(points, results, space):
            if not self.observed(ran, space):
                break
            done += len(ran.results)
        return done - done % self.line

    def check_here(self) -> None:
        """See `Work`."""
        for observer in self.observers:
            observer.check_here()

    def observed(self, ran: Ran, space: Workspace) -> bool:
        """Have the observers look at runs; whether they came to their end."""
        for observer in self.observers:
            observer.observe(ran, space)
        return not (self.observers and is_stopped(space))

    def _runs(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> Iterator[Ran]:
        """Run `points`, from the first one on; where a state is carried, in whole lines."""
        rows = self.grid.rows_at(points)
        has_ways = "direction" in self.grid.axes
        if has_ways or needs_of(self.observers):
            for first in range(0, points.size, self.line):
                line = slice(first, first + self.line)
                way = -1 if has_ways and self.grid.values(points[first])["direction"] else 1
                yield from self._carried(points[line][::way], rows[line][::way], results[line][::way], space)
        else:
            out, codes = blank(len(rows))
            done = run_patiently(rows, self.how, out, codes, until=SLOW_MODES, space=space)
            results["out"][:done], results["codes"][:done] = out[:done], codes[:done]
            yield Ran(rows[:done], self.how, results[:done])

    def _carried(self, points: np.ndarray, rows: np.ndarray, results: np.ndarray, space: Workspace) -> Iterator[Ran]:
        """Run the points of one line, or a point alone, each from the state in which the one before it has ended."""
        record = "record" in needs_of(self.observers)
        for k, solved in enumerate(carried(rows, self.how, space, record=record)):
            here = slice(k, k + 1)
            results["out"][here], results["codes"][here] = solved.out, solved.codes
            given = self.grid.given(points[k]) if record else None
            yield Ran(rows[here], self.how, results[here], solved, given)

    def batches(self, results: Callable[[], np.ndarray]) -> Iterator[Batch]:
        """What is to be run, one batch after the other; the study of the last one labels all results.

        Parameters
        ----------
        results : callable
            Gives those of all points so far, shape (grid.size,); of points of former batches they are there.
        """
        ranges = [Tile(0, self.size)] if self.part is None else self.part.ranges(self.size, self.line)
        yield Batch(self, ranges, sum(stop - start for start, stop in ranges))

    def stands(self, points: np.ndarray, results: np.ndarray) -> np.ndarray:
        """Which results of another cube, all of them run, are those that this study would give at `points`; shapes (n,)."""
        return np.ones(points.size, dtype=bool)

    def sample(self, rng: np.random.Generator) -> Sample:
        """Parts that tell what it costs: random points or lines; of a long line some values stand for all."""
        short, lines = self, self.size // self.line
        if self.line > MOST_OF_LINE:
            *_, (axis, values) = self.grid.axes.items()
            some = values[np.linspace(0, self.line - 1, MOST_OF_LINE).round().astype(int)]
            short = replace(self, grid=Grid(self.grid.axes | {axis: some}, self.grid.fixed))
        shares = np.full(short.line, self.line / short.line)
        numbers = rng.choice(lines, min(MOST_PARTS, lines), replace=False).tolist()
        each = (short.narrowed(np.arange(short.line) + k * short.line)[0] for k in numbers)
        return Sample(lines, "random points" if self.line == 1 else "random lines", ((part, shares) for part in each))

    def again(self, results: np.ndarray) -> np.ndarray:
        """Which of results, shape (n,), a retry forgets, in whole lines: those that failed, and those that depend on one."""
        return np.repeat(not_ok(results["codes"]).reshape(-1, self.line).any(axis=1), self.line)

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """Results of all points, shape (grid.size,), as a labelled cube."""
        return with_fields(build(self.grid, results["out"], results["codes"]), results, self.fields)

    def template(self) -> xr.Dataset:
        """The cube of its first point alone, which was not run."""
        return self.narrowed(np.arange(1))[0].as_cube(blank_results(1, self.kind))

    def results_of(self, cube: xr.Dataset) -> np.ndarray:
        """The results that `as_cube` made a cube of."""
        return results_in(cube, self.kind, self.fields)
