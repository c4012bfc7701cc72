"""What a sweep, search or map costs beyond its kernel, and how it scales: ``python benchmarks/overhead.py [--sweep FILE]``.

Each round makes the same cube on one thread and on two, in turn, and the medians over the rounds are printed:
the time of the whole call over the sum of the kernel's times shared among the threads, and the speed of two threads over
that of one. The sum of kernel times is measured around the calls of the compiled code, on the threads that make them. Where the
kernel was not on a core all that time, other programs were at work, and the scaling says nothing.
"""

import argparse
import tempfile
import threading
from pathlib import Path
from statistics import median
from time import perf_counter, thread_time
from typing import Any

import dimersweep.tiles
from dimersweep import declaration, sweep
from dimersweep.datasets import make

ROOT = Path(__file__).resolve().parents[1]


class KernelClock:
    """Stands before the compiled function and adds up the time spent in it, over all threads [s]."""

    def __init__(self) -> None:
        self.inner = dimersweep.tiles.run_many
        self.lock = threading.Lock()
        self.seconds = self.cpu = 0.0

    def __call__(self, *arguments: Any, **more: Any) -> int:
        begun, begun_cpu = perf_counter(), thread_time()
        made = self.inner(*arguments, **more)
        spent, spent_cpu = perf_counter() - begun, thread_time() - begun_cpu
        with self.lock:
            self.seconds += spent
            self.cpu += spent_cpu
        return made


def measure(declared: declaration.Declaration, workers: int, clock: KernelClock) -> tuple[float, float, float]:
    """Wall time of the whole, sum of the kernel's times, and its time on a processor [s]."""
    clock.seconds = clock.cpu = 0.0
    with tempfile.TemporaryDirectory() as folder:
        begun = perf_counter()
        make(declared, Path(folder, "cube.nc"), workers=workers, progress=False)
        return perf_counter() - begun, clock.seconds, clock.cpu


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sweep", type=Path, default=ROOT / "sweeps" / "fig07.toml")
    given = parser.parse_args()
    declared = declaration.read_declaration(given.sweep)
    clock = KernelClock()
    dimersweep.tiles.run_many = clock  # type: ignore[assignment]
    sweep({"f": [15, 20]}, periods=2, progress=False)  # compiles
    times: dict[int, list[tuple[float, float, float]]] = {1: [], 2: []}
    for number in range(given.rounds):
        for workers in (1, 2) if number % 2 == 0 else (2, 1):
            times[workers].append(measure(declared, workers, clock))
    for workers, rounds in times.items():
        wall, kernel, cpu = (median(column) for column in zip(*rounds, strict=True))
        over = median(workers * wall / kernel for wall, kernel, _ in rounds)
        print(
            f"{workers} threads: wall {wall:.2f} s, sum of kernel times {kernel:.2f} s ({100 * cpu / kernel:.0f} % of it "
            f"on a core), overhead {over:.3f}"
        )
    gains = [one[0] / two[0] for one, two in zip(times[1], times[2], strict=True)]
    print(f"scaling from 1 to 2 threads: {median(gains):.2f} (rounds: {', '.join(f'{gain:.2f}' for gain in gains)})")


if __name__ == "__main__":
    main()
