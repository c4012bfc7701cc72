"""How far one driver and one scheduler carry: ``python benchmarks/speed/scale.py`` prints what docs/scale.md rests on.

It takes some minutes.

A scheduler, some processes of workers with many threads each, and the driver run as on a cluster, over the network of this
machine. In place of the kernel a stand-in waits for the time that its points would take and fills their results with numbers.
The processor time of each process is measured: workers have cores of their own on a cluster, but the driver and the scheduler
have one each, and what a task costs these says how many workers they can keep at work. On a machine of few cores all of them
share these, so that the points in a second are a lower bound.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from distributed import Client

from dimersweep import sweep
from dimersweep.kernel.model.layout import CODES, M_DRIFT, OK
from dimersweep.storage.formats import FORMATS
from dimersweep.work.scheduling import tile_seconds

WRITE = FORMATS[".zarr"].write_blocks
THREADS = 125  # of a process of workers
HEADS = (
    "workers",
    "points",
    "points/s",
    "busy",
    "busy, middle half",
    "tasks",
    "driver, ms a task",
    "scheduler, ms a task",
    "us a point",
    "written after (s)",
    "busy of 1,000 by the model",
)


def stand_in(point: float) -> None:
    """Put a stand-in in place of the kernel of this process: each point takes `point` seconds, and ends are noted."""
    import time

    import dimersweep.work.scheduling as tasks
    import dimersweep.work.tiles as there
    from dimersweep.runs import solving

    status, mode, attempt = CODES.index("status"), CODES.index("mode"), tasks.attempt
    there.ends, there.tasks = [], 0

    def run_many(rows, periods, rtol, settle, out, codes, until=0, space=None):  # type: ignore[no-untyped-def]
        time.sleep(point * len(rows))
        out[:], codes[:, status], codes[:, mode] = rows[:, :1], OK, M_DRIFT
        there.ends.append((time.time(), len(rows)))
        return len(rows)

    def counted(*arguments, **more):  # type: ignore[no-untyped-def]
        there.tasks += 1
        return attempt(*arguments, **more)

    solving.run_many, tasks.attempt = run_many, counted
    there.CHUNK_SECONDS = 60.0  # few calls: the threads of a process share one lock


def done() -> tuple[int, list[tuple[float, int]]]:
    """How many tasks this process has begun; when points have ended in it, and how many."""
    import dimersweep.work.tiles as there

    return there.tasks, there.ends


@contextmanager
def started(*command: str) -> Iterator[psutil.Process]:
    """A process that lives as long as the context."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
    process = subprocess.Popen([sys.executable, "-m", *command], env=environment, stderr=subprocess.DEVNULL)
    try:
        yield psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait()


class Cluster(NamedTuple):
    """A client, and the processes of its scheduler and its workers."""

    client: Client
    scheduler: psutil.Process
    workers: list[psutil.Process]


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[Cluster]:
    """A scheduler and so many threads of workers, in processes of `THREADS` at most."""
    address, place = folder / "scheduler.json", str(folder)
    share = [THREADS] * (workers // THREADS) + [workers % THREADS] * (workers % THREADS > 0)
    with ExitStack() as stack:
        options = "--scheduler-file", str(address)
        scheduler = stack.enter_context(started("dask", "scheduler", *options, "--port", "0", "--no-dashboard"))
        more = "--no-dashboard", "--no-nanny", "--local-directory", place
        made = [
            stack.enter_context(started("dask", "worker", *options, *more, "--nthreads", str(threads)))
            for threads in share
        ]
        while not address.exists():
            time.sleep(0.1)
        client = stack.enter_context(Client(scheduler_file=str(address)))
        client.wait_for_workers(len(share))
        yield Cluster(client, scheduler, made)


def processor_time(process: psutil.Process) -> float:
    """Of a process, so far [s]."""
    told = process.cpu_times()
    return float(told.user + told.system)


class Watch:
    """Notes what the driver and the scheduler have used, at the start of a sweep and when its cube begins to be written."""

    def __init__(self, made: Cluster) -> None:
        self.processes = (psutil.Process(), made.scheduler)
        self.began, self.used_before = self.now()
        self.ended, self.used = self.began, self.used_before

    def now(self) -> tuple[float, list[float]]:
        """The time, and the processor time of each process [s]."""
        return time.time(), [processor_time(process) for process in self.processes]

    def write(self, *arguments: Any, **more: Any) -> None:
        """Note it, and write the cube."""
        self.ended, self.used = self.now()
        WRITE(*arguments, **more)


def measure(workers: int, seconds: float, point: float, folder: Path) -> list[str]:
    """A row of the table: a sweep whose points, of some time each, would keep so many workers at work for some time."""
    points = int(workers * seconds / point)
    grid = {"f": np.linspace(15, 25, max(2, points // 1000)), "beta0": np.linspace(0.01, 1.5, 1000)}
    with cluster(workers, folder) as made:
        sweep({"f": [15.0, 20.0]}, periods=1, client=made.client, progress=False)  # all have loaded what they need
        made.client.run(stand_in, point)
        watch = Watch(made)
        FORMATS[".zarr"] = FORMATS[".zarr"]._replace(write_blocks=watch.write)
        sweep(grid, periods=1, client=made.client, progress=False, out=folder / f"{workers}.zarr")
        written = time.time() - watch.ended
        tasks, ends = zip(*made.client.run(done).values(), strict=True)
    used = np.subtract(watch.used, watch.used_before)
    return _row(workers, point, watch.began, np.concatenate(ends), sum(tasks), used, written)


def _row(
    workers: int, point: float, began: float, ends: np.ndarray, tasks: int, used: np.ndarray, written: float
) -> list[str]:
    """A row of the table, from the times `ends` at which so many points ended, shape (n, 2), and processor time `used`."""
    times, counts = ends.T
    ended, points = times.max(), counts.sum()
    first, last = began + 0.25 * (ended - began), began + 0.75 * (ended - began)
    steady = counts[(times > first) & (times <= last)].sum() / (last - first)
    rate = points / (ended - began)
    return [
        f"{workers:,}",
        f"{points:,.0f}",
        f"{rate:,.0f}",
        f"{100 * rate * point / workers:.0f} %",
        f"{100 * steady * point / workers:.0f} %",
        f"{tasks:,}",
        *(f"{1e3 * each / tasks:.2f}" for each in used),
        f"{1e6 * used.sum() / points:.2f}",
        f"{written:.1f}",
        f"{100 * share(1000, 1e3 * used.max() / tasks):.0f} %",
    ]


def share(workers: int, cost: float) -> float:
    """Of the time of `workers` that is spent on points, where a task costs the driver or the scheduler `cost` ms."""
    return min(1.0, 1e3 * tile_seconds(workers) / (cost * workers))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[10, 100, 300, 1000])
    parser.add_argument("--seconds", type=float, default=60.0, help="that the workers would take, all at work")
    parser.add_argument("--point", type=float, default=1e-3, help="time of a point")
    given = parser.parse_args()
    print(f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}")
    for workers in given.workers:
        with tempfile.TemporaryDirectory() as folder:
            row = measure(workers, given.seconds, given.point, Path(folder))
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
