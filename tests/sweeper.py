"""A cube made in a process of its own, slowed down so that it can be killed: ``python sweeper.py kind out workers seconds``."""

import sys
import time
from pathlib import Path

import dimersweep.runs.solving
from dimersweep import make, sweep
from dimersweep.studies.declared import read_declaration
from dimersweep.studies.search import search
from tests.own_observers import spectral

GRID = {"Gamma": [0.5, 0.9, 1.2], "beta0": {"start": 0.2, "stop": 80, "num": 60, "unit": "deg"}}
SETTINGS = {"fixed": {"mu": 0.15}, "periods": 50}
SEARCHED = {"Gamma": [0.5, 0.7, 0.8, 0.9, 1.0, 1.2], "f": [15, 20, 25, 30], "beta0": [0.1, 0.3, 0.5, 0.7, 0.9]}
SEARCH = {"over": "beta0", "periods": 60, "orbit_periods": 30, "paths": {"periods": 10, "per_period": 4}}
TURNED = {"e": [0.45, 0.5, 0.55, 0.6, 0.65], "Gamma": {"start": 0.75, "stop": 1.1, "num": 8}}
CARRY = {"carry": "both", "periods": 60, "strobes": 3}
SMALL_MAP = Path(__file__).parents[1] / "sweeps" / "fig08-small.toml"

OBSERVED = {"Gamma": [0.6, 0.8, 0.9, 1.0], "beta0": {"start": 0.1, "stop": 0.6, "num": 12}}

MAKERS = {
    "sweep": lambda out, **how: sweep(GRID, **SETTINGS, out=out, progress=False, **how),
    "search": lambda out, **how: search(SEARCHED, **SEARCH, out=out, progress=False, **how),
    "carry": lambda out, **how: sweep(TURNED, **CARRY, out=out, progress=False, **how),
    "observed": lambda out, **how: sweep(OBSERVED, periods=60, observe=spectral, out=out, progress=False, **how),
    "map": lambda out, **how: make(read_declaration(SMALL_MAP), out, progress=False, **how),
}


def slow_down(seconds):
    """Let each run take `seconds` more, without any change in its numbers."""
    fast = dimersweep.runs.solving.run_many

    def run_many(rows, *rest, until=0, space=None):
        made = fast(rows, *rest, until=until, space=space)
        time.sleep(seconds * made)
        return made

    one_of_a_line = dimersweep.runs.solving.run_recorded

    def run_recorded(*given):
        time.sleep(seconds)
        return one_of_a_line(*given)

    dimersweep.runs.solving.run_many = run_many
    dimersweep.runs.solving.run_recorded = run_recorded


if __name__ == "__main__":
    kind, out, workers, seconds = sys.argv[1:]
    slow_down(float(seconds))
    MAKERS[kind](out, workers=int(workers))
