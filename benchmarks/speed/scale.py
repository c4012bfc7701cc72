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
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from distributed import Client

import dimersweep.work.tiles
from dimersweep import open_cube, sweep
from dimersweep.cubes.cube import blank
from dimersweep.cubes.grid import make_grid
from dimersweep.cubes.results import RESULT, Tile
from dimersweep.kernel.model.layout import CODES, M_DRIFT, M_REST, OK, OUT, ROW
from dimersweep.storage.blocks import blocks
from dimersweep.storage.formats import FORMATS
from dimersweep.storage.tilestore import tiles_of
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


def stand_in(point: float, travel: bool) -> None:
    """Put a stand-in in place of the kernel of this process: each point takes `point` seconds, and ends are noted.

    If results are to `travel`, the process is blind to the driver's disk.
    """
    import time

    import dimersweep.work.scheduling as tasks
    import dimersweep.work.tiles as there
    from dimersweep.kernel.model.layout import CODES, M_DRIFT, OK

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

    there.run_many, tasks.attempt = run_many, counted
    if travel:
        from dimersweep.storage.shelf import Shelf

        Shelf.is_here = lambda self: False
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


def measure(workers: int, seconds: float, point: float, folder: Path, *, travel: bool = False) -> list[str]:
    """A row of the table: a sweep whose points, of some time each, would keep so many workers at work for some time."""
    points = int(workers * seconds / point)
    grid = {"f": np.linspace(15, 25, max(2, points // 1000)), "beta0": np.linspace(0.01, 1.5, 1000)}
    with cluster(workers, folder) as made:
        sweep({"f": [15.0, 20.0]}, periods=1, client=made.client, progress=False)  # all have loaded what they need
        made.client.run(stand_in, point, travel)
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


# --- a sweep of many points on one machine ------------------------------------------------------------------------------


def hashed(rows: np.ndarray, out: np.ndarray, codes: np.ndarray) -> None:
    """Numbers for each point that follow from its row, and cost next to nothing."""
    mixed = np.zeros(len(rows), dtype=np.uint64)
    for slot in (ROW.index("f"), ROW.index("beta0")):
        mixed = (mixed ^ rows[:, slot].copy().view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    out[:], codes[:] = np.nan, 0
    out[:, OUT.index("radius")] = (mixed >> np.uint64(11)) * 2.0**-53
    codes[:, CODES.index("status")] = OK
    codes[:, CODES.index("mode")] = np.where(mixed & np.uint64(1), M_DRIFT, M_REST)


def hashed_run_many(rows: Any, periods: int, rtol: float, settle: bool, out: Any, codes: Any, **more: Any) -> int:
    """In place of the kernel."""
    hashed(rows, out, codes)
    return len(rows)


def hashed_grid(points: int) -> dict[str, np.ndarray]:
    """Axes of a grid of so many points."""
    side = 10 ** (len(str(points)) // 2)
    return {"f": np.linspace(15, 25, points // side), "beta0": np.linspace(0.01, 1.5, side)}


def hashed_sweep(points: int, out: str) -> None:
    """A sweep of so many points on one thread."""
    dimersweep.work.tiles.run_many = hashed_run_many
    sweep(hashed_grid(points), periods=1, workers=1, out=out, progress=False)


def digest_of(points: int, values: Callable[[Tile, tuple[slice, ...]], Iterable[np.ndarray]]) -> str:
    """Hash of the modes and radii of a cube of so many points, in blocks."""
    found = sha256()
    for tile, where in blocks(tuple(axis.size for axis in hashed_grid(points).values())):
        for each in values(tile, where):
            found.update(each.tobytes())
    return found.hexdigest()


def digest_of_function(points: int) -> str:
    """What the hash of the cube must be."""
    grid = make_grid(hashed_grid(points))

    def values(tile: Tile, where: tuple[slice, ...]) -> Iterable[np.ndarray]:
        out, codes = blank(tile.stop - tile.start)
        hashed(grid.rows(*tile), out, codes)
        return codes[:, CODES.index("mode")].astype(np.int8), out[:, OUT.index("radius")]

    return digest_of(points, values)


def digest_of_cube(points: int, path: Path) -> str:
    """The hash of the cube that is there."""
    cube = open_cube(path)
    return digest_of(points, lambda tile, where: [cube[name][where].values for name in ("mode", "radius")])


def followed(points: int, out: Path, until: Callable[[], bool]) -> tuple[float, bool]:
    """Run the sweep in a process, killed as soon as `until` holds; its peak memory [bytes], and whether it was killed."""
    program = f"import scale; scale.hashed_sweep({points}, {str(out)!r})"
    process = psutil.Popen([sys.executable, "-c", program], cwd=Path(__file__).parent)
    peak = 0.0
    while process.poll() is None:
        with suppress(psutil.Error):
            peak = max(peak, process.memory_info().rss)
        if until():
            process.kill()
            process.wait()
            return peak, True
        time.sleep(0.01)
    if process.returncode:
        raise SystemExit(f"the sweep of {points} points fails with {process.returncode}")
    return peak, False


def large(points: int, folder: Path) -> str:
    """A row of the table of a sweep of so many points, killed half way and while its cube is written."""
    out, begun, peaks, kills = folder / "cube.zarr", time.time(), [], 0

    def half() -> bool:
        return (
            sum(path.stat().st_size for path in tiles_of(out).path.glob("tiles-*.npy")) > 0.5 * RESULT.itemsize * points
        )

    for until in (half, (tiles_of(out).path / "cube.tmp" / "radius" / "c").exists, lambda: False):
        peak, killed = followed(points, out, until)
        peaks.append(peak)
        kills += killed
    wall = time.time() - begun
    same = digest_of_cube(points, out) == digest_of_function(points)
    shutil.rmtree(out)
    return f"| {points:,} | {1e-6 * max(peaks):,.0f} | {kills} | {wall:,.0f} | {'the same' if same else 'OTHER'} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[10, 100, 300, 1000])
    parser.add_argument("--seconds", type=float, default=60.0, help="that the workers would take, all at work")
    parser.add_argument("--point", type=float, default=1e-3, help="time of a point")
    parser.add_argument("--travel", action="store_true", help="as if the workers did not share the driver's disk")
    parser.add_argument(
        "--sweep", type=int, nargs="+", help="points of sweeps on one thread, killed and resumed, instead"
    )
    given = parser.parse_args()
    if given.sweep:
        print("| points | peak memory (MB) | kills | s in all | cube and function |\n|---|---|---|---|---|")
        for points in given.sweep:
            with tempfile.TemporaryDirectory() as folder:
                print(large(points, Path(folder)), flush=True)
        return
    print(f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}")
    for workers in given.workers:
        with tempfile.TemporaryDirectory() as folder:
            row = measure(workers, given.seconds, given.point, Path(folder), travel=given.travel)
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
