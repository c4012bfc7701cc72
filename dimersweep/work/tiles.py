"""The unit of work: ranges of grid points, and the pure function that any thread, process or machine runs them with."""

from collections.abc import Iterable
from time import perf_counter
from typing import NamedTuple, Protocol, Self

import numpy as np

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Bundle, Finished, Tile, blank_results
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.work.stopping import StopFlag

TILE_SECONDS = 0.5  # at least: long against the cost of a task (4 ms), short against what a kill may cost
CHUNK_SECONDS = 0.1  # what one call of the kernel aims at: it can be stopped only between calls
OVERTIME = 2  # a task whose points turn out slow comes back after so many times its time with those it has by then


class Broken(NamedTuple):
    """Points that are still to be done, and why: a reason that is not the model's, such as ``MemoryError: no room``."""

    tiles: Bundle
    reason: str

    @property
    def points(self) -> int:
        """Number of points."""
        return count(self.tiles)

    def moved(self, shift: int) -> "Broken":
        """These tiles and their reason, with `shift` added to the numbers of points."""
        return Broken(tuple(Tile(start + shift, stop + shift) for start, stop in self.tiles), self.reason)


class Made(NamedTuple):
    """What a task brings back: what it has done of its tiles, in their order, and what broke it off, if anything did."""

    finished: list[Finished]
    broken: Broken | None = None

    @property
    def done(self) -> int:
        """Number of points that are done."""
        return sum(len(tile.results) for tile in self.finished)

    @property
    def points(self) -> int:
        """Number of points that are done or broken: the first ones of the task."""
        return self.done + (self.broken.points if self.broken else 0)

    @property
    def seconds(self) -> float:
        """Time of the points that are done [s]."""
        return sum(tile.seconds for tile in self.finished)


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


class Work(Protocol):
    """What is done at each point of a grid: the numbers of a point depend on nothing else, so anybody may do it."""

    @property
    def grid(self) -> Grid:
        """The points."""

    @property
    def kind(self) -> np.dtype:
        """Of the result of one point, see `blank_results`."""

    @property
    def line(self) -> int:
        """How many points make one piece of work, see `Grid.line`: whoever runs them has them all, in one call."""

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """Run some of `points`, from the first one on, and count them.

        Parameters
        ----------
        points : ndarray, shape (n,), int
            Their numbers.
        results : ndarray, shape (n,)
            Filled as far as points are done.
        space : Workspace
            Scratch arrays; if they are stopped, the work ends before the point that it is at.
        """

    def narrowed(self, tiles: Bundle) -> tuple[Self, Bundle, int]:
        """The points of `tiles` in a work that is small enough to travel with every task, and the `shift` back."""


def attempt(
    work: Work, tiles: Bundle, stop: StopFlag | None = None, shift: int = 0, seconds: float = TILE_SECONDS
) -> Made:
    """Run tiles in short calls, for about `OVERTIME` times `seconds`, or up to a point that raises.

    Parameters
    ----------
    work : Work
    tiles : tuple of Tile
    stop : StopFlag, optional
        If it is set, the work ends before the point that it is at.
    shift : int
        What to add to the numbers of points, where `work` is a window of a larger grid.
    seconds : float
        Time that they are to take [s].

    Returns
    -------
    Made
        The last tile may be short, and those after it missing. The time stands with the first one.
    """
    begun = perf_counter()
    points = np.concatenate([np.arange(*tile) for tile in tiles])
    results = blank_results(points.size, work.kind)
    with (stop or StopFlag()).space() as space:
        done, broken = _advanced(work, points, results, space, begun + OVERTIME * seconds)
    for name in results.dtype.names or ():
        values = results[name]
        if values.dtype.kind == "f":
            values[np.isnan(values)] = np.nan  # every NaN has the same bits, whatever operation made it
    return Made(_cut(tiles, results[:done], perf_counter() - begun, shift), broken and broken.moved(shift))


def _advanced(
    work: Work, points: np.ndarray, results: np.ndarray, space: Workspace, ends: float
) -> tuple[int, Broken | None]:
    """Number of `points` that are done, from the first one on, and what broke off the work, if anything did."""
    line, begun = work.line, perf_counter()
    done, batch = 0, line
    while done < points.size:
        part = slice(done, done + batch)
        try:
            made = work.advance(points[part], results[part], space)
        except Exception as error:  # whatever it is, it must not cost the other points
            if points[part].size > line:
                batch = line  # find the one
                continue
            point = int(points[done])
            return done, Broken((Tile(point, point + line),), f"{type(error).__name__}: {error}")
        done += made
        now = perf_counter()
        if not made or now > ends or is_stopped(space):
            break
        batch = line * max(1, min(2 * batch, int(CHUNK_SECONDS * done / max(now - begun, 1e-9))) // line)
    return done, None


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
