"""Estimate the cost of a sweep, a search or a map from a timed sample of it; no file is written."""

from dataclasses import dataclass
from itertools import islice
from math import ceil, inf, isfinite, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np
from dask.utils import format_bytes, format_time

from dimersweep.cubes.cube import signed
from dimersweep.cubes.results import not_run
from dimersweep.storage.store import finished_at
from dimersweep.storage.tilestore import tiles_of
from dimersweep.studies.making import in_memory
from dimersweep.studies.study import MOST_PARTS, Sample, Study
from dimersweep.work.computing import prepare_kernel
from dimersweep.work.scheduling import TILES_PER_WORKER
from dimersweep.work.tiles import TILE_SECONDS

_SEED = 20100  # of the random points, fixed so that a plan can be repeated


@dataclass(frozen=True)
class Plan:
    """The expected cost of a sweep, a search or a map.

    Parameters
    ----------
    study : Study
        The whole study.
    done, workers : int
        Number of points that are finished already, and of threads of the run to come.
    sample : Sample
        Sample of the study that was run.
    points : ndarray, shape (n,), float64
        Number of points to run in each unit of the sample. A point that several units need counts in part.
    times : ndarray, shape (n,), float64
        Time of each unit [s].
    """

    study: Study
    done: int
    workers: int
    sample: Sample
    points: np.ndarray
    times: np.ndarray

    def _total(self, values: np.ndarray) -> tuple[float, float]:
        """Return the sum of `values` over all units, estimated from the sample, and its standard error."""
        n, units = values.size, self.sample.units
        # one unit of several gives no spread; the last factor is 0 if all units were sampled
        spread = inf if n < 2 < units else float(values.std(ddof=min(1, n - 1)))
        return units * float(values.mean()), units * spread * sqrt((1 - n / units) / n)

    @property
    def to_run(self) -> int:
        """Expected number of points that the whole sweep runs: those that are finished, and those to come."""
        return max(1, self.done, round(self._total(self.points)[0]))

    @property
    def tile_points(self) -> int:
        """Number of points in a tile: whole lines, about `TILE_SECONDS` of work, several tiles for each worker."""
        longest = ceil(self.to_run / (TILES_PER_WORKER * self.workers))
        length = min(longest, int(TILE_SECONDS * self.points.sum() / self.times.sum()))
        return self.study.line * max(1, length // self.study.line)

    @property
    def size(self) -> int:
        """Size of the cube before compression [bytes]."""
        cube = signed(self.study.template(), self.study.configuration())
        return self.study.size * sum(variable.nbytes for variable in cube.data_vars.values())

    @property
    def seconds(self) -> tuple[float, float]:
        """Expected time left, and its standard error from the spread of the sample [s]."""
        share = (1 - self.done / self.to_run) / self.workers
        time, error = self._total(self.times)
        return share * time, share * error

    def as_dict(self) -> dict[str, float]:
        """Return the plan as numbers, times in seconds."""
        left, (seconds, error) = self.to_run - self.done, self.seconds
        tiles = {"tiles": ceil(left / self.tile_points), "tile_points": self.tile_points}
        times = {"seconds": seconds, "seconds_error": error, "sample_seconds": float(self.times.mean())}
        return {"points": self.to_run, "done": self.done, "bytes": self.size, "workers": self.workers} | tiles | times

    def lines(self) -> list[str]:
        """Return the plan in words, as lines of text."""
        left, (seconds, error), size = self.to_run - self.done, self.seconds, self.study.size
        points = f"{self.to_run}"
        if not np.allclose(self.points, self.study.line):  # only cells of a map differ in their points
            spread = self._total(self.points)[1]
            points = f"about {points} (standard error {spread:.0f}), or a third more, of a fine grid of {size}"
        done = f", {self.done} of them done" if self.done else ""
        doubt = format_time(error) if isfinite(error) else "any time"
        low, middle, high = (format_time(float(value)) for value in np.quantile(self.times, (0, 0.5, 1)))
        return [
            f"points: {points}{done}",
            f"tiles: {ceil(left / self.tile_points)} of {self.tile_points} points",
            f"cube: {format_bytes(self.size)} before compression",
            f"time: {format_time(seconds)} on {self.workers} threads, give or take {doubt} (standard error)",
            f"sample: {self.times.size} {self.sample.unit}, {format_time(float(self.times.mean()))} each on average "
            f"(shortest {low}, median {middle}, longest {high})",
        ]


def plan(study: Study, workers: int, out: Path | None = None) -> Plan:
    """Return the expected cost of a study, from a sample of it that is timed on one thread.

    Parameters
    ----------
    study : Study
        The study. The grid of a sweep may be of any size: only the sampled points are laid out.
    workers : int
        Number of threads of the run to come.
    out : Path, optional
        File of the cube to come; points that are finished for it need not be run again.

    Returns
    -------
    Plan
    """
    prepare_kernel(progress=False)
    sample = study.sample(np.random.default_rng(_SEED))
    costs, started = [], perf_counter()
    for part in islice(sample.parts, MOST_PARTS):
        costs.append(_cost(*part))
        if perf_counter() - started > sample.seconds:
            break
    rows = [] if out is None else finished_at(tiles_of(out), study.configuration())
    return Plan(study, sum(row.stop - row.start for row in rows), workers, sample, *np.array(costs).T)


def _cost(part: Study, shares: np.ndarray) -> tuple[float, float]:
    """Run a part; return the number of its points, and its time [s], both with points weighted by `shares`."""
    results, seconds = in_memory(part)
    made = ~not_run(results["codes"])
    runs = results["counts"].sum(axis=1) if "counts" in (part.kind.names or ()) else made
    return float(shares[made].sum()), seconds * float(shares @ runs) / float(runs.sum())
