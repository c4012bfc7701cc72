"""A sweep in a process of its own, slowed down so that it can be killed: ``python sweeper.py out workers seconds``."""

import sys
import time

import dimersweep.tiles
from dimersweep import sweep

GRID = {"Gamma": [0.5, 0.9, 1.2], "beta0": {"start": 0.2, "stop": 80, "num": 110, "unit": "deg"}}
SETTINGS = {"fixed": {"mu": 0.15}, "periods": 50}


def slow_down(seconds):
    """Let each point take `seconds` more, without any change in its numbers."""
    fast = dimersweep.tiles.run_many

    def run_many(rows, *rest, until=0):
        made = fast(rows, *rest, until=until)
        time.sleep(seconds * made)
        return made

    dimersweep.tiles.run_many = run_many


if __name__ == "__main__":
    out, workers, seconds = sys.argv[1:]
    slow_down(float(seconds))
    sweep(GRID, **SETTINGS, out=out, workers=int(workers), progress=False)
