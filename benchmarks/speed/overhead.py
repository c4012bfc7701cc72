"""The cost of a sweep, search or map beyond its kernel, its scaling: ``python benchmarks/speed/overhead.py [--sweep FILE]``.

Each round makes the same cube on one thread and on two, in turn, and the medians over the rounds are printed:
the time of the whole call over the sum of the kernel's times shared among the threads, and the speed of two threads over
that of one. The sum of kernel times is measured around the calls of the compiled code, on the threads that make them. Where the
kernel was not on a core all that time, other programs were at work, and the scaling says nothing.

With ``--paired`` the processor time of a whole sweep, on one thread and on two, is compared with that of plain calls of the
compiled code for the same points on as many threads, in turn: other programs change little of that.

Ends with 1 if the overhead with two threads or the scaling misses its limit, and with 2 if the machine was too busy to tell.
"""

import argparse
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from time import perf_counter, process_time, thread_time
from typing import Any

import numpy as np

import dimersweep.runs.solving
import dimersweep.work.tiles
from dimersweep import sweep
from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import run_many
from dimersweep.studies import declaration
from dimersweep.studies.datasets import make
from dimersweep.studies.sweep_spec import Spec

ROOT = Path(__file__).resolve().parents[2]
OVERHEAD, SCALING = 1.1, 1.7  # limits: below, above
PAIRED = 1.03  # limit of the overhead in processor time
ON_CORE = 0.95  # share of the kernel's time on a processor, below which the machine was busy
CALLS = (  # of compiled code, by those who run points and record paths
    (dimersweep.work.tiles, "run_many"),
    (dimersweep.runs.solving, "run_recorded"),
)


class KernelClock:
    """Adds up the time spent in compiled functions, over all threads [s]."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.seconds = self.cpu = 0.0

    def before(self, inner: Callable[..., Any]) -> Callable[..., Any]:
        """`inner`, its time being added."""

        def timed(*arguments: Any, **more: Any) -> Any:
            begun, begun_cpu = perf_counter(), thread_time()
            made = inner(*arguments, **more)
            spent, spent_cpu = perf_counter() - begun, thread_time() - begun_cpu
            with self.lock:
                self.seconds += spent
                self.cpu += spent_cpu
            return made

        return timed


def measure(declared: declaration.Declaration, workers: int, clock: KernelClock) -> tuple[float, float, float]:
    """Wall time of the whole, sum of the kernel's times, and its time on a processor [s]."""
    clock.seconds = clock.cpu = 0.0
    with tempfile.TemporaryDirectory() as folder:
        begun = perf_counter()
        make(declared, Path(folder, "cube.nc"), workers=workers, progress=False)
        return perf_counter() - begun, clock.seconds, clock.cpu


def plain(spec: Spec, workers: int) -> float:
    """Processor time of calls of the compiled code for all points of a sweep, one call on each thread [s]."""
    rows = spec.grid.rows(0, spec.grid.size)
    shares = [np.ascontiguousarray(rows[k::workers]) for k in range(workers)]
    with ThreadPoolExecutor(workers) as pool:
        begun = process_time()
        for done in [pool.submit(run_plainly, spec, share) for share in shares]:
            done.result()
        return process_time() - begun


def run_plainly(spec: Spec, rows: np.ndarray) -> None:
    """One plain call."""
    out, codes = blank(len(rows))
    run_many(rows, spec.how.periods, spec.how.rtol, spec.how.stop_when_settled, out, codes)


def paired(declared: declaration.Declaration, rounds: int) -> int:
    """Compare sweeps with plain calls, in processor time; 0 if the limit holds."""
    spec = declared.study()
    assert isinstance(spec, Spec), "paired: is for sweeps of a whole grid"
    ratios: dict[int, list[float]] = {}
    for workers in (1, 2):
        before, ratios[workers] = plain(spec, workers), []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as folder:
                begun = process_time()
                make(declared, Path(folder, "cube.nc"), workers=workers, progress=False)
                whole = process_time() - begun
            after = plain(spec, workers)
            ratios[workers].append(2 * whole / (before + after))
            before = after
    for workers, found in ratios.items():
        each = ", ".join(f"{ratio:.3f}" for ratio in found)
        print(f"{workers} threads: processor time of the sweep over that of plain calls {median(found):.3f} ({each})")
    return 0 if max(map(median, ratios.values())) < PAIRED else 1


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sweep", type=Path, default=ROOT / "sweeps" / "fig07.toml")
    parser.add_argument("--paired", action="store_true", help="compare processor times with those of plain calls")
    given = parser.parse_args()
    declared = declaration.read_declaration(given.sweep)
    if given.paired:
        sweep({"f": [15, 20]}, periods=2, progress=False)  # compiles
        sys.exit(paired(declared, given.rounds))
    clock = KernelClock()
    for module, name in CALLS:
        setattr(module, name, clock.before(getattr(module, name)))
    sweep({"f": [15, 20]}, periods=2, progress=False)  # compiles
    times: dict[int, list[tuple[float, float, float]]] = {1: [], 2: []}
    for number in range(given.rounds):
        for workers in (1, 2) if number % 2 == 0 else (2, 1):
            times[workers].append(measure(declared, workers, clock))
    over, share = {}, {}
    for workers, rounds in times.items():
        wall, kernel, cpu = (median(column) for column in zip(*rounds, strict=True))
        over[workers], share[workers] = median(workers * wall / kernel for wall, kernel, _ in rounds), cpu / kernel
        print(
            f"{workers} threads: wall {wall:.2f} s, sum of kernel times {kernel:.2f} s ({100 * share[workers]:.0f} % of it "
            f"on a core), overhead {over[workers]:.3f}"
        )
    gains = [one[0] / two[0] for one, two in zip(times[1], times[2], strict=True)]
    scaling = median(gains)
    print(f"scaling from 1 to 2 threads: {scaling:.2f} (rounds: {', '.join(f'{gain:.2f}' for gain in gains)})")
    sys.exit(judged(over[2], scaling, min(share.values())))


def judged(over: float, scaling: float, on_core: float) -> int:
    """Say whether the limits hold; 0 if both do, 1 if one does not, 2 if the machine was busy."""
    if on_core < ON_CORE:
        print(f"no verdict: the kernel was on a core for {100 * on_core:.0f} % of its time only; the machine is busy")
        return 2
    holds = over < OVERHEAD and scaling > SCALING
    print(f"{'holds' if holds else 'MISSED'}: overhead < {OVERHEAD} with two threads, scaling > {SCALING}")
    return 0 if holds else 1


if __name__ == "__main__":
    main()
