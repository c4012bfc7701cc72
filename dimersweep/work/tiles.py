"""The unit of work: some points of a grid, and the pure function with which any thread or process runs them."""

from time import perf_counter
from typing import NamedTuple, Protocol, Self

import numpy as np

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import blank_results
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.work.stopping import StopFlag

TILE_SECONDS = 0.5  # least time of a task: long against its cost (4 ms), short against the work that a kill may waste
CHUNK_SECONDS = 0.1  # time of one call of the kernel: a run can be stopped only between calls
OVERTIME = 2  # factor over its time after which a task returns with the points it has by then, if they are slow


class TaskResult(NamedTuple):
    """The results of a task.

    Attributes
    ----------
    results : ndarray, shape (n,)
        Results of the first n of its points.
    seconds : float
        Time that these points took [s].
    broken : int
        Number of points after these at which the task broke off; they are still to be run.
    reason : str
        Reason of breaking off, outside the model, such as ``MemoryError: no room``.
    """

    results: np.ndarray
    seconds: float = 0.0
    broken: int = 0
    reason: str = ""


class Work(Protocol):
    """Work at each point of a grid, as a protocol.

    The numbers of a point depend on the point alone, so any worker may run it.
    """

    @property
    def grid(self) -> Grid:
        """Points of the work."""

    @property
    def kind(self) -> np.dtype:
        """Type of the result of one point, see `blank_results`."""

    @property
    def line(self) -> int:
        """Number of points that a worker must run together, in one call, see `Grid.line`."""

    def check_here(self) -> None:
        """Raise a ParameterError if this process lacks something that the work needs."""

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """Run some of `points`, from the first one on, and return their number.

        Parameters
        ----------
        points : ndarray, shape (n,), int
            Numbers of the points.
        results : ndarray, shape (n,)
            Results, filled in for the points that are done.
        space : Workspace
            Scratch arrays. If a stop is set there, the work ends before the present point.
        """

    def narrowed(self, points: np.ndarray) -> tuple[Self, np.ndarray]:
        """Return a work with these points that is small enough to travel with every task, and their numbers there."""


def attempt(work: Work, points: np.ndarray, stop: StopFlag | None = None, seconds: float = TILE_SECONDS) -> TaskResult:
    """Run points in short calls, for about `OVERTIME` times `seconds`, or up to a point that raises.

    Parameters
    ----------
    work : Work
        The work to do at each point.
    points : ndarray, shape (n,), int
        Numbers of the points.
    stop : StopFlag, optional
        Flag that ends the work before the present point when it is set.
    seconds : float
        Time that the points are expected to take [s].
    """
    begun, line, reason = perf_counter(), work.line, ""
    results = blank_results(points.size, work.kind)
    done, batch = 0, line
    with (stop or StopFlag()).space() as space:
        while done < points.size:
            part = slice(done, done + batch)
            try:
                made = work.advance(points[part], results[part], space)
            except Exception as error:  # any error of a point must not cost the other points
                if points[part].size > line:
                    batch = line  # one by one, to find the point that raises
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
    return TaskResult(results[:done], perf_counter() - begun, line if reason else 0, reason)
