"""Memory that a sweep takes for each point beyond its output: ``python benchmarks/speed/memory.py``, in a minute or so.

Two sweeps of different size run in fresh processes, in memory and to a file. Their peak memory differs by what a point costs:
as the operating system sees it (peak resident memory), and as Python's allocator does (tracemalloc, which counts the arrays of
NumPy and can be repeated to the byte). The output itself, as the cube says, is taken off.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from dimersweep.cubes.grid import MAX_POINTS

ROOT = Path(__file__).resolve().parents[2]
MOST = 1000.0  # bytes a point may take beyond its output
SWEEP = """
import json, resource, sys, tracemalloc
import numpy as np
from dimersweep import sweep

points, traced, out = int(sys.argv[1]), sys.argv[2] == "traced", sys.argv[3] or None
settings = {"fixed": {"Gamma": 0.1, "e": 0.0}, "periods": 1, "workers": 1, "progress": False}
sweep({"beta0": [0.1, 0.2]}, **settings)  # compiles and imports
if traced:
    tracemalloc.start()
grid = {"beta0": np.linspace(1e-3, 1.0, points // 100), "phi0": np.linspace(0, 1, 100)}
cube = sweep(grid, out=out, **settings)
peak = tracemalloc.get_traced_memory()[1] if traced else 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([peak, cube.nbytes]))
"""


def peak(points: int, traced: bool, to_file: bool) -> tuple[float, float]:
    """Peak memory of a sweep of so many points, and the size of its cube [bytes]."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder, "cube.nc")) if to_file else ""
        command = [sys.executable, "-c", SWEEP, str(points), "traced" if traced else "resident", out]
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    most, size = json.loads(done.stdout)
    return most, size


def bytes_a_point(small: int, large: int, traced: bool, to_file: bool) -> tuple[float, float]:
    """Bytes a point takes in all, and beyond its output."""
    (low, low_cube), (high, high_cube) = (peak(points, traced, to_file) for points in (small, large))
    whole, output = (high - low) / (large - small), (high_cube - low_cube) / (large - small)
    return whole, whole - output


def main(arguments: list[str] | None = None) -> list[float]:
    """Print the bytes a point takes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", type=int, default=20_000, help="points of the smaller sweep")
    parser.add_argument("--large", type=int, default=120_000, help="points of the larger sweep")
    given = parser.parse_args(arguments)
    found = []
    for to_file in (False, True):
        for traced in (True, False):
            whole, beyond = bytes_a_point(given.small, given.large, traced, to_file)
            found.append(beyond)
            where, how = "to a file" if to_file else "in memory", "allocated" if traced else "resident"
            verdict = "" if found[-1] < MOST else f"  MORE than {MOST:.0f}"
            print(
                f"sweep {where}: {found[-1]:6.0f} bytes a point beyond the output, {how}{verdict}; {whole:.0f} in all, "
                f"{1e-9 * whole * MAX_POINTS:.1f} GB for {MAX_POINTS} points",
                flush=True,
            )
    return found


if __name__ == "__main__":
    main()
