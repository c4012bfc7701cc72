"""The workers of another cluster give the numbers of threads, and a point that fails there leaves the others."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

from dimersweep import names, sweep

GRID = {"Gamma": [0.6, 0.7, 0.8, 0.9, 1.0, 1.1], "beta0": [0.2, 0.28]}
HOW = {"periods": 60, "progress": False}

if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        cube = sweep(GRID, client=executor, **HOW)
    assert cube.equals(sweep(GRID, workers=1, **HOW))
    assert {"rest", "drift"} <= set(names(cube["mode"]).values.flat)
