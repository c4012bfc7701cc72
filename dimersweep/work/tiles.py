"""The unit of work: some points of a grid, and the pure function that any thread, process or machine runs them with."""

from time import perf_counter
from typing import NamedTuple, Protocol, Self

import numpy as np

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import blank_results
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.work.stopping import StopFlag

TILE_SECONDS = 0.5  # at least: long against the cost of a task (4 ms), short against what a kill may cost
CHUNK_SECONDS = 0.1  # what one call of the kernel aims at: it can be stopped only between calls
OVERTIME = 2  # a task whose points turn out slow comes back after so many times its time with those it has by then


class Made(NamedTuple):
    """What a task brings back.

    Attributes
    ----------
    results : ndarray, shape (n,)
        Of the first of its points.
    seconds : float
        Time that they took [s].
    broken : int
        How many points after these are still to be done, and have broken it off.
    reason : str
        Why, if it is not the model's: such as ``MemoryError: no room``.
    """

    results: np.ndarray
    seconds: float = 0.0
    broken: int = 0
    reason: str = ""


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

    def check_here(self) -> None:
        """Raise a ParameterError if this process lacks something that the work takes."""

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

    def narrowed(self, points: np.ndarray) -> tuple[Self, np.ndarray]:
        """A work with these points that is small enough to travel with every task, and their numbers there."""


def attempt(work: Work, points: np.ndarray, stop: StopFlag | None = None, seconds: float = TILE_SECONDS) -> Made:
    """Run points in short calls, for about `OVERTIME` times `seconds`, or up to one that raises.

    Parameters
    ----------
    work : Work
    points : ndarray, shape (n,), int
        Their numbers.
    stop : StopFlag, optional
        If it is set, the work ends before the point that it is at.
    seconds : float
        Time that they are to take [s].
    """
    begun, line, reason = perf_counter(), work.line, ""
    results = blank_results(points.size, work.kind)
    done, batch = 0, line
    with (stop or StopFlag()).space() as space:
        while done < points.size:
            part = slice(done, done + batch)
            try:
                made = work.advance(points[part], results[part], space)
            except Exception as error:  # whatever it is, it must not cost the other points
                if points[part].size > line:
                    batch = line  # find the one
                    continue
                reason = f"{type(error).__name__}: {error}"
                break
            done += made
            taken = perf_counter() - begun
            if not made or taken > OVERTIME * seconds or is_stopped(space):
                break
            batch = line * max(1, min(2 * batch, int(CHUNK_SECONDS * done / max(taken, 1e-9))) // line)
    for name in results.dtype.names or ():
        values = results[name]
        if values.dtype.kind == "f":
            values[np.isnan(values)] = np.nan  # every NaN has the same bits, whatever operation made it
    return Made(results[:done], perf_counter() - begun, line if reason else 0, reason)
