"""The unit of work: a range of grid points, and the pure function that any thread, process or machine runs it with."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from dimersweep.cube import blank
from dimersweep.grid import Grid
from dimersweep.kernel import kernel_version
from dimersweep.kernel.engine import run_many
from dimersweep.kernel.layout import CODES, M_FAILED

TILE_SECONDS = 0.5  # long against the cost of a task (4 ms), short against the patience of Ctrl-C (2 s)
TILES_PER_WORKER = 4  # at least, so that no worker idles for long at the end
_MODE = CODES.index("mode")


class Tile(NamedTuple):
    """The grid points `start` to `stop` - 1, in C order."""

    start: int
    stop: int


class Finished(NamedTuple):
    """A tile with its results, or with the error that kept it from any (empty if none)."""

    tile: Tile
    out: np.ndarray
    codes: np.ndarray
    error: str


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
    """

    grid: Grid
    periods: int
    rtol: float
    stop_when_settled: bool

    def configuration(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, with the version of the kernel that gives the results."""
        return {
            "grid": {name: values.tolist() for name, values in self.grid.axes.items()},
            "fixed": self.grid.fixed,
            "periods": self.periods,
            "rtol": self.rtol,
            "stop_when_settled": self.stop_when_settled,
            "kernel_version": kernel_version(),
        }


def run_tile(spec: Spec, tile: Tile) -> tuple[np.ndarray, np.ndarray]:
    """Run the points of one tile.

    Each point depends on its own row alone, so that any tiling gives the same numbers bit for bit.

    Returns
    -------
    out : ndarray, shape (tile.stop - tile.start, N_OUT), float64
    codes : ndarray, shape (tile.stop - tile.start, N_CODES), int64
    """
    out, codes = blank(tile.stop - tile.start)
    run_many(spec.grid.rows(*tile), spec.periods, spec.rtol, spec.stop_when_settled, out, codes)
    return out, codes


def attempt(spec: Spec, tile: Tile) -> Finished:
    """Run one tile; an exception marks its points as failed and goes no further."""
    try:
        return Finished(tile, *run_tile(spec, tile), error="")
    except Exception as error:  # whatever it is, it must not cost the other tiles
        out, codes = blank(tile.stop - tile.start)
        codes[:, _MODE] = M_FAILED
        return Finished(tile, out, codes, f"{type(error).__name__}: {error}")


def seconds_per_point(spec: Spec, sample: int = 8) -> float:
    """Mean time of a few points spread over the grid [s], without that of compiling."""
    attempt(spec, Tile(0, 1))
    start, done = perf_counter(), 0
    for point in np.linspace(0, spec.grid.size - 1, sample).astype(int).tolist():
        attempt(spec, Tile(point, point + 1))
        done += 1
        if perf_counter() - start > TILE_SECONDS:
            break
    return (perf_counter() - start) / done


def tile_length(spec: Spec, workers: int) -> int:
    """Points in a tile, so that one takes about `TILE_SECONDS` and each of `workers` gets a few."""
    longest = ceil(spec.grid.size / (TILES_PER_WORKER * workers))
    if longest == 1:
        return 1
    return max(1, min(longest, int(TILE_SECONDS / seconds_per_point(spec))))


def split(size: int, length: int) -> Iterator[Tile]:
    """Tiles of `length` points that cover `size` points; the last one may be shorter."""
    return (Tile(start, min(start + length, size)) for start in range(0, size, length))
