"""What a sweep would cost, told from a timed sample of its points; nothing is written."""

from dataclasses import dataclass
from math import ceil, inf, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np

from dimersweep.cube import blank, build
from dimersweep.grid import Grid
from dimersweep.manifest import read_manifest
from dimersweep.provenance import as_text
from dimersweep.tiles import TILE_SECONDS, TILES_PER_WORKER, Spec, Tile, attempt, beyond, blank_results
from dimersweep.tilestore import manifest_of

SAMPLE = 200  # points timed at most
SAMPLE_SECONDS = 5.0  # the sample ends after this time, though not before its first point
_SEED = 20100


@dataclass(frozen=True)
class Plan:
    """The cost of a sweep.

    Parameters
    ----------
    points, done, workers : int
        Points of the grid, those among them that are finished already, and threads to be.
    bytes_per_point : int
        Of a cube, not compressed.
    times : ndarray, shape (n,), float64
        Times of random points of the grid [s].
    """

    points: int
    done: int
    workers: int
    bytes_per_point: int
    times: np.ndarray

    @property
    def tile_points(self) -> int:
        """Points in a tile."""
        longest = ceil(self.points / (TILES_PER_WORKER * self.workers))
        return max(1, min(longest, int(TILE_SECONDS / self.times.mean())))

    @property
    def seconds(self) -> float:
        """Estimate of the time left [s]."""
        return float(self.times.mean()) * (self.points - self.done) / self.workers

    @property
    def error(self) -> float:
        """Standard error of that estimate [s], from the spread of the sample."""
        if self.times.size < 2:
            return inf
        return self.seconds * float(self.times.std(ddof=1)) / float(self.times.mean()) / sqrt(self.times.size)

    def lines(self) -> list[str]:
        """The plan in words."""
        tiles = ceil((self.points - self.done) / self.tile_points)
        share = f", {self.done} of them done" if self.done else ""
        low, middle, high = (_time(float(value)) for value in np.quantile(self.times, (0, 0.5, 1)))
        return [
            f"points: {self.points}{share}",
            f"tiles: {tiles} of {self.tile_points} points",
            f"cube: {_bytes(self.points * self.bytes_per_point)} before compression",
            f"time: {_time(self.seconds)} on {self.workers} threads, give or take {_time(self.error)} (standard error)",
            f"sample: {self.times.size} random points, {_time(float(self.times.mean()))} each on average "
            f"(shortest {low}, median {middle}, longest {high})",
        ]


def plan(spec: Spec, workers: int, out: Path | None = None) -> Plan:
    """Time a random sample of the points of a sweep, on one thread.

    Parameters
    ----------
    spec : Spec
        Its grid may be of any size: only the sampled points are laid out.
    workers : int
        Threads that the sweep would have.
    out : Path, optional
        The cube to be; points that a sweep for it has finished need not be run again.

    Returns
    -------
    Plan
    """
    chosen = np.random.default_rng(_SEED).integers(spec.grid.size, size=min(SAMPLE, spec.grid.size))
    attempt(spec, (Tile(int(chosen[0]), int(chosen[0]) + 1),))  # compiles
    started, times = perf_counter(), list[float]()
    for point in chosen.tolist():
        times.append(attempt(spec, (Tile(point, point + 1),))[0].seconds)
        if perf_counter() - started > SAMPLE_SECONDS:
            break
    one, more = (
        Grid({name: values[:1] for name, values in spec.grid.axes.items()}, {}),
        beyond(blank_results(1, spec.kind)),
    )
    size = sum(variable.dtype.itemsize for variable in build(one, *blank(1), {}, more).data_vars.values())
    return Plan(spec.grid.size, _done(spec, out), workers, size, np.array(times))


def _done(spec: Spec, out: Path | None) -> int:
    if out is None or not manifest_of(out).exists():
        return 0
    manifest = read_manifest(manifest_of(out))
    same = as_text(manifest.configuration) == as_text(spec.configuration())
    return sum(entry.points for entry in manifest.entries) if same else 0


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
