"""Results of a sweep that has no file: the verbs of `TileStore` over plain arrays."""

from time import perf_counter

import numpy as np

from dimersweep.cubes.results import (
    RESULT,
    Finished,
    Tile,
    blank_results,
    gaps,
    tally,
)


class MemoryStore:
    """Results in memory, lost with the process.

    Parameters
    ----------
    size : int
        Number of points.
    kind : dtype
        Of the result of one of them.
    """

    out = None  # no file

    def __init__(self, size: int, kind: np.dtype = RESULT) -> None:
        self.results = blank_results(size, kind)
        self.seconds = 0.0
        self.started = perf_counter()
        self._done: list[Tile] = []

    def add(self, finished: Finished) -> None:
        """Keep a finished tile."""
        self.results[slice(*finished.tile)] = finished.results
        self.seconds += finished.seconds
        self._done.append(finished.tile)

    @property
    def wall(self) -> float:
        """Time of the sweep so far [s]."""
        return perf_counter() - self.started

    @property
    def kept(self) -> str:
        """What is kept of a sweep that is stopped, in words."""
        return "nothing is kept, as no output was given"

    def modes(self) -> dict[str, int]:
        """Tally of the points that are done."""
        counts = tally(self.results["codes"])
        counts.pop("not_run", None)
        return counts

    def expect(self, total: int) -> None:
        """Nobody asks how many points are wanted."""

    def flush(self) -> None:
        """Nothing waits."""

    def gaps(self) -> list[Tile]:
        """The ranges that are not yet done."""
        return list(gaps(len(self.results), self._done))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Results of the points `start` to `stop` - 1, shape (stop - start,)."""
        return self.results[start:stop]
