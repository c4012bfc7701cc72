"""How far one driver and one scheduler carry: ``python benchmarks/speed/scale.py`` prints the table of docs/scale.md.

It takes some minutes.

Workers are threads of one dask worker process, and the kernel is a stand-in that waits for the time that its points would take
and fills their results with numbers: a machine of two cores stands in for a thousand. What it costs to hand out tasks, to carry
results and to write them is real, and shared with the stand-ins: with cores of their own, workers leave the driver more room.
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client, LocalCluster

import dimersweep.work.tiles
from dimersweep import sweep
from dimersweep.kernel.model.layout import CODES, M_DRIFT, OK

CODE = {name: k for k, name in enumerate(CODES)}


class StandIn:
    """In place of the kernel: each point takes some time; notes when points end.

    Parameters
    ----------
    seconds : float
        Time of a point [s].
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.lock = seconds, threading.Lock()
        self.ends: list[tuple[float, int]] = []

    def __call__(
        self,
        rows: Any,
        periods: int,
        rtol: float,
        settle: bool,
        out: Any,
        codes: Any,
        until: int = 0,
        space: Any = None,
    ) -> int:
        time.sleep(self.seconds * len(rows))
        out[:], codes[:, CODE["status"]], codes[:, CODE["mode"]] = rows[:, :1], OK, M_DRIFT
        with self.lock:
            self.ends.append((time.perf_counter(), len(rows)))
        return len(rows)

    def busy(self, workers: int, begun: float, ended: float) -> tuple[float, float, float]:
        """Points per second, and the share of the workers' time spent on points: in all, and in the middle half of the run."""
        times, points = np.array(self.ends).T
        first, last = begun + 0.25 * (ended - begun), begun + 0.75 * (ended - begun)
        steady = points[(times > first) & (times <= last)].sum() / (last - first)
        rate = points.sum() / (ended - begun)
        return rate, rate * self.seconds / workers, steady * self.seconds / workers


def measure(workers: int, seconds: float, point: float, folder: Path) -> str:
    """A row of the table: a sweep whose points, of some time each, would keep so many workers at work for some time."""
    points = int(workers * seconds / point)
    grid = {"f": np.linspace(15, 25, max(2, points // 1000)), "beta0": np.linspace(0.01, 1.5, 1000)}
    stand_in = StandIn(point)
    dimersweep.work.tiles.run_many = stand_in
    dimersweep.work.tiles.CHUNK_SECONDS = 60.0  # few calls: the threads that stand in for processes share one lock
    cluster = LocalCluster(n_workers=1, threads_per_worker=workers, processes=False, dashboard_address=":0")
    with cluster, Client(cluster) as client:
        begun, used = time.perf_counter(), time.process_time()
        cube = sweep(grid, periods=1, client=client, progress=False, out=folder / f"{workers}.nc")
        ended = max(end for end, _ in stand_in.ends)
        whole, used = time.perf_counter() - begun, time.process_time() - used
    rate, share, steady = stand_in.busy(workers, begun, ended)
    size = cube["mode"].size
    return (
        f"| {workers} | {size} | {rate:,.0f} | {100 * share:.0f} % | {100 * steady:.0f} % "
        f"| {1e6 * used / size:.1f} | {size / used:,.0f} | {whole - (ended - begun):.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[10, 100, 300, 1000])
    parser.add_argument("--seconds", type=float, default=60.0, help="that the workers would take, all at work")
    parser.add_argument("--point", type=float, default=1e-3, help="time of a point")
    given = parser.parse_args()
    told = "workers | points | points/s | busy | busy, middle half | processor time a point (us) | points/s of one core"
    print(f"| {told} | written after (s) |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for workers in given.workers:
            print(measure(workers, given.seconds, given.point, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
