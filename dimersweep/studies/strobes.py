"""Strobes: the state at the start of each of some forcing periods after a run, at every point of a sweep."""

from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import coordinate, float_variable
from dimersweep.kernel.course import Workspace
from dimersweep.kernel.model.layout import CODE_N_PERIODS, CODE_STATUS, OK
from dimersweep.runs.recorded import states_of_segments
from dimersweep.runs.solving import run_row
from dimersweep.symbols import STATE_QUANTITIES, Quantity

MAX_STROBES = 20_000_000  # in one cube, which is held in memory
STROBED = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "theta_rate", "beta_rate")


def strobe_fields(n: int) -> list[tuple[Any, ...]]:
    """What `n` strobes add to the result of a point."""
    return [(f"strobe_{name}", "<f8", (n,)) for name in STROBED]


def add_strobes(
    rows: np.ndarray, rtol: float, results: np.ndarray, space: Workspace, start: np.ndarray | None = None
) -> None:
    """Run points on, and fill in the strobes of their next forcing periods; NaN where a point has failed.

    They start as their rows say, or all from `start`, shape (1, N_START).
    """
    n = results[f"strobe_{STROBED[0]}"].shape[1]
    for row, result in zip(rows, results, strict=True):
        if result["codes"][CODE_STATUS] != OK:
            continue
        done = int(result["codes"][CODE_N_PERIODS])
        end = run_row(row, start, done, rtol, space, settle=False, record=False).end
        more = run_row(row, end.start, done + n, rtol, space, settle=False, record=True, past=end.past)
        if more.record is None or more.codes[CODE_STATUS] != OK:
            continue
        states = states_of_segments(more.record, np.arange(done + 1, done + n + 1))
        for name in STROBED:
            result[f"strobe_{name}"] = states[name]


def with_strobes(cube: xr.Dataset, results: np.ndarray) -> xr.Dataset:
    """`cube` with the strobes in `results`, along `strobe`."""
    shape, dims = cube["mode"].shape, tuple(map(str, cube["mode"].dims))
    for name in STROBED:
        values = results[f"strobe_{name}"]
        units, meaning = (
            STATE_QUANTITIES[name].units,
            f"{STATE_QUANTITIES[name].long_name}, at the start of a forcing period",
        )
        cube[f"strobe_{name}"] = float_variable((*dims, "strobe"), values.reshape(*shape, -1), Quantity(units, meaning))
    numbers = coordinate("strobe", np.arange(values.shape[-1]), Quantity("1", "forcing periods after the run"))
    return cube.assign_coords(strobe=numbers)
