"""The unit of work: ranges of grid points, and the pure function that any thread, process or machine runs them with."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from dimersweep.certifying import certified
from dimersweep.cube import blank
from dimersweep.errors import ParameterError
from dimersweep.grid import Grid, make_grid
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.layout import CODES, M_APERIODIC, M_FAILED, M_NOT_RUN, M_UNRESOLVED, N_CODES, N_OUT
from dimersweep.parameters import check_count, check_rtol

TILE_SECONDS = 0.5  # long against the cost of a task (4 ms), short against the patience of Ctrl-C (2 s)
CHUNK_SECONDS = 0.1  # what one call of the kernel aims at: it can be stopped only between calls
LONGEST_TILE = 2 * TILE_SECONDS  # a task whose points turn out slow comes back with those it has by then
SLOW_MODES = sum(1 << mode for mode in (M_FAILED, M_APERIODIC, M_UNRESOLVED))  # these use all periods they are given
RESULT = np.dtype([("out", "<f8", (N_OUT,)), ("codes", "<i8", (N_CODES,))])  # of one point of a sweep
CERTIFIED = np.dtype([*RESULT.descr, ("confidence", "<i8"), ("error_estimate", "<f8")])  # the same of a certified one
_MODE = CODES.index("mode")


def blank_results(n: int, kind: np.dtype = RESULT, mode: int = M_NOT_RUN) -> np.ndarray:
    """Results of `n` points that have none, shape (n,): NaN and 0, and `mode`, a code, as their mode.

    `kind` has the fields of `RESULT`, and perhaps more.
    """
    results = np.zeros(n, kind)
    for name in kind.names or ():
        if kind[name].base.kind == "f":
            results[name] = np.nan
    results["codes"][:, _MODE] = mode
    return results


def beyond(results: np.ndarray) -> dict[str, np.ndarray]:
    """The fields of results, shape (n,), that those of `RESULT` lack."""
    return {name: results[name] for name in results.dtype.names or () if name not in (RESULT.names or ())}


class Tile(NamedTuple):
    """The grid points `start` to `stop` - 1, in C order."""

    start: int
    stop: int


Bundle = tuple[Tile, ...]  # what one task runs: scattered points would be too little work one by one


class Finished(NamedTuple):
    """A tile with its results, shape (n,), and its time [s]."""

    tile: Tile
    results: np.ndarray
    seconds: float = 0.0

    @property
    def codes(self) -> np.ndarray:
        """Integer results, shape (n, N_CODES)."""
        codes: np.ndarray = self.results["codes"]
        return codes

    def part(self, tile: Tile) -> "Finished":
        """The points that lie in `tile`, which is covered."""
        return Finished(tile, self.results[tile.start - self.tile.start : tile.stop - self.tile.start])


class Broken(NamedTuple):
    """Points that are still to be done, and why: a reason that is not the model's, such as ``MemoryError: no room``."""

    tiles: Bundle
    reason: str

    @property
    def points(self) -> int:
        """Number of points."""
        return count(self.tiles)


class Made(NamedTuple):
    """What a task brings back: what it has done of its tiles, in their order, and what broke it off, if anything did."""

    finished: list[Finished]
    broken: Broken | None = None

    @property
    def points(self) -> int:
        """Number of points that are done or broken: the first ones of the task."""
        done = sum(len(tile.results) for tile in self.finished)
        return done + (self.broken.points if self.broken else 0)


def count(tiles: Iterable[Tile]) -> int:
    """Number of points in `tiles`."""
    return sum(stop - start for start, stop in tiles)


def after(tiles: Bundle, points: int) -> Bundle:
    """What is left of `tiles` without their first `points`."""
    left = []
    for start, stop in tiles:
        taken = min(points, stop - start)
        points -= taken
        if start + taken < stop:
            left.append(Tile(start + taken, stop))
    return tuple(left)


def run_patiently(
    rows: np.ndarray,
    periods: int,
    max_periods: int,
    rtol: float,
    settle: bool,
    out: np.ndarray,
    codes: np.ndarray,
    until: int = 0,
) -> int:
    """Run points as `run_many` does, up to the first that has not settled; that one again for twice as long, and so on.

    A longer run starts anew: what comes out depends on the point alone. Most motions settle soon, and those that ring down
    slowly are too few to be given all they may need at once.

    Parameters
    ----------
    rows, rtol, settle, out, codes, until
        See ``kernel.batch.run_rows``.
    periods, max_periods : int
        Forcing periods of the first run of a point, and of the longest.

    Returns
    -------
    int
        Number of points made.
    """
    made = run_many(rows, periods, rtol, settle, out, codes, until=until | 1 << M_UNRESOLVED)
    last = slice(made - 1, made)
    while codes[made - 1, _MODE] == M_UNRESOLVED and periods < max_periods:
        periods = min(2 * periods, max_periods)
        run_many(rows[last], periods, rtol, settle, out[last], codes[last], until=until)
    return made


def check_max_periods(periods: int, max_periods: int | None) -> int:
    """The longest run of a point: `periods` where nothing is given.

    Raises
    ------
    ParameterError
        If it is shorter than that.
    """
    longest = periods if max_periods is None else check_count("max_periods", max_periods)
    if longest < periods:
        raise ParameterError(f"max_periods = {longest}: must be >= periods = {periods}")
    return longest


class Work(Protocol):
    """What is done at each point of a grid: the numbers of a point depend on nothing else, so anybody may do it."""

    @property
    def grid(self) -> Grid:
        """The points."""

    @property
    def kind(self) -> np.dtype:
        """Of the result of one point, see `blank_results`."""

    def advance(self, points: np.ndarray, results: np.ndarray, stopped: Callable[[], bool]) -> int:
        """Run some of `points`, from the first one on, and count them.

        Parameters
        ----------
        points : ndarray, shape (n,), int
            Their numbers.
        results : ndarray, shape (n,)
            Filled as far as points are done.
        stopped : callable
            If it says True, the work may end before a point is done.
        """

    def narrowed(self, tiles: Bundle) -> tuple[Self, Bundle, int]:
        """The points of `tiles` in a work that is small enough to travel with every task, and the `shift` back."""


@dataclass(frozen=True)
class Spec:
    """All that decides the numbers of a sweep.

    Parameters
    ----------
    grid : Grid
        The points.
    periods : int
        Forcing periods each point may take.
    rtol : float
        Accuracy [1].
    stop_when_settled : bool
        Whether a point stops as soon as its motion has settled.
    certify : bool
        Whether it is tried how sure each mode is.
    max_periods : int
        Forcing periods that a point may take if its motion has not settled by then, see `run_patiently`.
    """

    grid: Grid
    periods: int
    rtol: float
    stop_when_settled: bool
    certify: bool
    max_periods: int

    @property
    def kind(self) -> np.dtype:
        """See `Work`."""
        return CERTIFIED if self.certify else RESULT

    def advance(self, points: np.ndarray, results: np.ndarray, stopped: Callable[[], bool]) -> int:
        """See `Work`: until one has used all its periods, so that quick points do not go on for long with slow ones."""
        out, codes = blank(points.size)
        rows = self.grid.rows_at(points)
        how = self.rtol, self.stop_when_settled
        done = run_patiently(rows, self.periods, self.max_periods, *how, out, codes, until=SLOW_MODES)
        results["out"][:done], results["codes"][:done] = out[:done], codes[:done]
        if self.certify:
            results["confidence"][:done], results["error_estimate"][:done] = certified(
                rows[:done], self.max_periods, *how, out[:done], codes[:done]
            )
        return done

    def narrowed(self, tiles: Bundle) -> tuple["Spec", Bundle, int]:
        """See `Work`."""
        grid, moved, shift = around(self.grid, tiles)
        return replace(self, grid=grid), moved, shift

    def configuration(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, with the version of the kernel that gives the results."""
        told = {
            "grid": {name: values.tolist() for name, values in self.grid.axes.items()},
            "fixed": self.grid.fixed,
            "periods": self.periods,
            "rtol": self.rtol,
            "stop_when_settled": self.stop_when_settled,
            "kernel_version": kernel_version(),
        }
        if self.max_periods > self.periods:
            told["max_periods"] = self.max_periods
        if self.certify:
            told["certify"] = True
        return told

    @classmethod
    def from_configuration(cls, told: Mapping[str, Any]) -> "Spec":
        """The spec that gave `told` as its `configuration`, whatever the kernel was; judged like any other input.

        Raises
        ------
        ParameterError
            If a value is not allowed.
        KeyError
            If something is missing.
        """
        return make_spec(
            told["grid"],
            told["fixed"],
            periods=told["periods"],
            rtol=told["rtol"],
            stop_when_settled=told["stop_when_settled"],
            certify=told.get("certify", False),
            max_periods=told.get("max_periods"),
        )


def make_spec(
    axes: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    periods: int,
    rtol: float = 1e-8,
    stop_when_settled: bool = True,
    certify: bool = False,
    max_periods: int | None = None,
) -> Spec:
    """A spec from what a user gives, see `sweep`.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    grid = make_grid(axes, fixed)
    periods = check_count("periods", periods)
    longest = check_max_periods(periods, max_periods)
    if longest > periods and not stop_when_settled:
        raise ParameterError(f"max_periods = {longest}: is for runs that stop when they have settled")
    return Spec(grid, periods, check_rtol(rtol), bool(stop_when_settled), bool(certify), longest)


def _never() -> bool:
    return False


def attempt(work: Work, tiles: Bundle, stopped: Callable[[], bool] = _never, shift: int = 0) -> Made:
    """Run tiles in short calls, for about `LONGEST_TILE` seconds, or up to a point that raises.

    Parameters
    ----------
    work : Work
    tiles : tuple of Tile
    stopped : callable
        Asked between two calls; if it says True, the work ends there.
    shift : int
        What to add to the numbers of points, where `work` is a window of a larger grid.

    Returns
    -------
    Made
        The last tile may be short, and those after it missing. The time is told with the first one.
    """
    begun = perf_counter()
    points = np.concatenate([np.arange(*tile) for tile in tiles])
    results = blank_results(points.size, work.kind)
    done, batch, broken = 0, 1, None
    while done < points.size:
        part = slice(done, done + batch)
        try:
            made = work.advance(points[part], results[part], stopped)
        except Exception as error:  # whatever it is, it must not cost the other points
            if points[part].size > 1:
                batch = 1  # find the one
                continue
            point = int(points[done]) + shift
            broken = Broken((Tile(point, point + 1),), f"{type(error).__name__}: {error}")
            break
        done += made
        spent = perf_counter() - begun
        if not made or spent > LONGEST_TILE or stopped():
            break
        batch = max(1, min(2 * batch, int(CHUNK_SECONDS * done / spent)))
    _one_nan(results)
    return Made(_cut(tiles, results[:done], perf_counter() - begun, shift), broken)


def _one_nan(results: np.ndarray) -> None:
    """Give every NaN the same pattern of bits, whatever operation made it."""
    for name in results.dtype.names or ():
        values = results[name]
        if values.dtype.kind == "f":
            values[np.isnan(values)] = np.nan


def _cut(tiles: Bundle, results: np.ndarray, seconds: float, shift: int) -> list[Finished]:
    """Results of the points of `tiles`, as far as they go, tile by tile."""
    finished: list[Finished] = []
    first = 0
    for start, stop in tiles:
        if first == len(results):
            break
        last = min(first + stop - start, len(results))
        tile = Tile(start + shift, start + shift + last - first)
        finished.append(Finished(tile, results[first:last], 0.0 if finished else seconds))
        first = last
    return finished


def around(grid: Grid, tiles: Bundle) -> tuple[Grid, Bundle, int]:
    """A window of `grid` with the points of `tiles`, these by their numbers there, and the `shift` back."""
    window, start = grid.window(tiles[0].start, tiles[-1].stop)
    shift = tiles[0].start - start
    return window, tuple(Tile(a - shift, b - shift) for a, b in tiles), shift


def split(ranges: Iterable[Tile], length: int) -> Iterator[Tile]:
    """Tiles of at most `length` points that cover `ranges`."""
    return (Tile(at, min(at + length, stop)) for start, stop in ranges for at in range(start, stop, length))


def gaps(size: int, done: Iterable[Tile]) -> Iterator[Tile]:
    """The ranges of `size` points that no tile of `done` covers."""
    reached = 0
    for start, stop in sorted(done):
        if start > reached:
            yield Tile(reached, start)
        reached = max(reached, stop)
    if reached < size:
        yield Tile(reached, size)


def runs(chosen: np.ndarray, start: int = 0) -> list[Tile]:
    """The ranges where `chosen`, shape (n,), bool, holds; its first item is point `start`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], chosen, [False])).astype(np.int8))) + start
    return [Tile(a, b) for a, b in edges.reshape(-1, 2).tolist()]
