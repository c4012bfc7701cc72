"""The base of all studies: points, how each of them is run and observed, and how results become a cube and back."""

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
from dimersweep.studies.observers import FinishedRuns, Observer, needs_of
from dimersweep.work.parts import SweepPart

# parts that are timed at most: the standard error is 1/14 of the spread of their times then, and more change little
MOST_PARTS = 200
# values of a long line that are timed: a whole line may take as long as the sweep itself
MOST_OF_LINE = 20


class Batch(NamedTuple):
    """Points that are run together, before any point of the next batch.

    Attributes
    ----------
    study : Study
        Study that runs the points; for a search, with the hints that earlier batches gave.
    ranges : sequence of Tile
        The points, in order. Those with a result are not run again.
    wanted : int
        Number of points that the whole study is expected to run, as far as is known by now.
    """

    study: "Study"
    ranges: Sequence[Tile]
    wanted: int


class Sample(NamedTuple):
    """Parts of a study that are run to estimate the cost of the whole study.

    Attributes
    ----------
    units : int
        Number of parts of this kind in the whole study.
    unit : str
        Name of such parts in the plural, for messages.
    parts : iterator
        Pairs of a part (a study) and the weights of its points [1], shape (n,). A point on the border of several parts
        has a weight below 1, as other parts need it too.
    seconds : float
        Time after which no further part is run [s].
    """

    units: int
    unit: str
    parts: Iterator[tuple["Study", np.ndarray]]
    seconds: float = 10.0


@dataclass(frozen=True, kw_only=True)
class Study:
    """Everything that decides the numbers of a cube. This class runs every point once; it fulfils `Work`.

    Parameters
    ----------
    grid : Grid
        The points. If the grid has the axis `direction`, the state is carried along the last axis, see
        `with_directions`.
    how : RunSettings
        Length and accuracy of each run.
    observers : tuple of Observer
        Observers, which add variables to the result of each point.
    part : SweepPart, optional
        Part of the points to be run; by default all are. Points of other parts stay without a result.
    """

    grid: Grid
    how: RunSettings
    observers: tuple[Observer, ...] = ()
    part: SweepPart | None = None

    # fields that a kind of study adds to a result; its `as_cube` makes variables of them, not `with_fields`
    own_fields: ClassVar[tuple[Field, ...]] = ()

    @property
    def summary(self) -> str:
        """Title of the cube, unless a user gives another one."""
        return "sweep of a 3D dimer on a vibrating plate"

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields that the observers add to the result of a point."""
        return tuple(each for observer in self.observers for each in observer.fields)

    @property
    def kind(self) -> np.dtype:
        """Type of the result of one point: `RESULT` with the fields of this study and of its observers."""
        return kind_with((*self.own_fields, *self.fields))

    @property
    def by_blocks(self) -> bool:
        """True if the cube can be written block by block, and so be larger than memory.

        Each variable must be one number at each point of a grid.
        """
        one_number = all(each.along is None and "S" not in each.type for each in self.fields)
        return one_number and not (self.own_fields or self.grid.columns)

    @property
    def size(self) -> int:
        """Number of points."""
        return self.grid.size

    @property
    def line(self) -> int:
        """Number of points that must be run together, in one call: a whole line where a state is carried, else 1."""
        return self.grid.line

    def check_fits(self) -> None:
        """Raise a ParameterError if memory cannot hold the points of this study, see `cubes.grid`."""
        check_fits(self.grid, by_blocks=self.by_blocks)

    def configuration(self) -> dict[str, Any]:
        """Return all settings that decide the numbers, as JSON can hold them, with the version of the kernel."""
        settings = self.grid.configuration() | self.asked() | {"kernel_version": kernel_version()}
        if self.how.max_periods > self.how.periods:
            settings["max_periods"] = self.how.max_periods
        for observer in self.observers:
            settings |= observer.settings()
        return settings | ({} if self.part is None else {PART: str(self.part)})

    def cut(self, part: SweepPart) -> Self:
        """Return this study with the points of a part alone; refuse more parts than lines (ParameterError)."""
        pieces, unit = self.size // self.line, "points" if self.line == 1 else "lines"
        if part.total > pieces:
            raise ParameterError(f"part = {part}: this sweep has {pieces} {unit}, and so at most {pieces} parts")
        return replace(self, part=part)

    def asked(self) -> dict[str, Any]:
        """Return the settings of the configuration that say what is done at each point."""
        how = self.how
        return {"periods": how.periods, "rtol": how.rtol, "stop_when_settled": how.stop_when_settled}

    def narrowed(self, points: np.ndarray) -> tuple[Self, np.ndarray]:
        """Return the study on the smallest window of the grid that holds `points`, and their numbers there.

        `points` are increasing.
        """
        first, last = points[[0, -1]].tolist()
        grid, start = self.grid.window(first, last + 1)
        return replace(self, grid=grid), points - first + start

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """Run `points` in order, fill in `results`, and return the number of points that were run.

        The work ends after a run that has used all its periods: quick points do not wait for slow ones. Lines are run
        whole.
        """
        done = 0
        for runs in self._runs(points, results, space):
            if not self.observed(runs, space):
                break
            done += len(runs.results)
        return done - done % self.line

    def check_here(self) -> None:
        """Raise a ParameterError if an observer cannot work in this process.

        An observer may lack something that it needs, or another version of it may be loaded here.
        """
        for observer in self.observers:
            observer.check_here()

    def observed(self, runs: FinishedRuns, space: Workspace) -> bool:
        """Show runs to all observers; return False if the work was stopped meanwhile."""
        for observer in self.observers:
            observer.observe(runs, space)
        return not (self.observers and is_stopped(space))

    def _runs(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> Iterator[FinishedRuns]:
        """Run `points` from the first one on, in whole lines where a state is carried; yield the runs."""
        rows = self.grid.rows_at(points)
        has_directions = "direction" in self.grid.axes
        if has_directions or needs_of(self.observers):
            for first in range(0, points.size, self.line):
                line = slice(first, first + self.line)
                # results lie by increasing values of the axis; on the way down the run begins at the last of them
                step = -1 if has_directions and self.grid.values(points[first])["direction"] else 1
                yield from self._carried(points[line][::step], rows[line][::step], results[line][::step], space)
        else:
            out, codes = blank(len(rows))
            done = run_patiently(rows, self.how, out, codes, until=SLOW_MODES, space=space)
            results["out"][:done], results["codes"][:done] = out[:done], codes[:done]
            yield FinishedRuns(rows[:done], self.how, results[:done])

    def _carried(
        self, points: np.ndarray, rows: np.ndarray, results: np.ndarray, space: Workspace
    ) -> Iterator[FinishedRuns]:
        """Run the points of one line, each from the end of the run before it; a line may be a single point."""
        record = "record" in needs_of(self.observers)
        for k, solved in enumerate(carried(rows, self.how, space, record=record)):
            here = slice(k, k + 1)
            results["out"][here], results["codes"][here] = solved.out, solved.codes
            given = self.grid.given(points[k]) if record else None
            yield FinishedRuns(rows[here], self.how, results[here], solved, given)

    def batches(self, results: Callable[[], np.ndarray]) -> Iterator[Batch]:
        """Yield the batches of points to be run, one after the other; the study of the last one labels all results.

        Parameters
        ----------
        results : callable
            Returns the results of all points so far, shape (grid.size,). Those of former batches are complete.
        """
        ranges = [Tile(0, self.size)] if self.part is None else self.part.ranges(self.size, self.line)
        yield Batch(self, ranges, sum(stop - start for start, stop in ranges))

    def stands(self, points: np.ndarray, results: np.ndarray) -> np.ndarray:
        """Return True for each result that this study would give at `points`, too; shape (n,).

        `results`, shape (n,), are of another cube with the same settings, and were all run.
        """
        return np.ones(points.size, dtype=bool)

    def sample(self, rng: np.random.Generator) -> Sample:
        """Return parts to estimate the cost from: random points, or random lines.

        Of a line with more than `MOST_OF_LINE` values some, evenly spread, stand for all.
        """
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
        """Return True for each result that a retry deletes: results that failed, and those that depend on one.

        `results` has shape (n,). Lines are deleted whole, as each of their runs starts from the one before it.
        """
        return np.repeat(not_ok(results["codes"]).reshape(-1, self.line).any(axis=1), self.line)

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """Return the results of all points, shape (grid.size,), as a labelled cube."""
        return with_fields(build(self.grid, results["out"], results["codes"]), results, self.fields)

    def template(self) -> xr.Dataset:
        """Return the cube of the first point alone, without a result: it has all variables and attributes."""
        return self.narrowed(np.arange(1))[0].as_cube(blank_results(1, self.kind))

    def results_of(self, cube: xr.Dataset) -> np.ndarray:
        """Return the results of all points of a cube that `as_cube` made, shape (grid.size,)."""
        return results_in(cube, self.kind, self.fields)
