"""Threads that use files of cubes and runs at once, as visitors of a page do: ``python visitors.py``, in an empty folder."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import xarray as xr

from dimersweep import load_run, open_cube, simulate, sweep
from dimersweep.storage.cubefiles import write_cube

GRID = {"f": [15, 25], "beta0": np.linspace(0.1, 1.5, 20)}
HOW = {"periods": 3, "progress": False, "out": "cube.nc"}
ROUNDS = 2  # without the locks the first one is the last


def use(number, cube, run, lazy):
    """What one of them does."""
    for _ in range(ROUNDS):
        assert sweep(GRID, **HOW).identical(cube)
        write_cube(cube, f"copy-{number}.nc", force=True)
        assert open_cube(f"copy-{number}.nc").identical(cube)
        run.save(f"run-{number}.nc", force=True)
        assert load_run(f"run-{number}.nc").mode == run.mode
        np.testing.assert_array_equal(lazy["radius"].values, cube["radius"])


if __name__ == "__main__":
    made, simulated = sweep(GRID, **HOW), simulate(periods=3)
    with xr.open_dataset("cube.nc", cache=False) as opened, ThreadPoolExecutor(4) as threads:
        for done in [threads.submit(use, number, made, simulated, opened) for number in range(4)]:
            done.result()
