"""Paths of the centre of mass for the runs that a search decided on: positions over time, and the velocity along the axis."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cube import float_variable
from dimersweep.errors import ParameterError
from dimersweep.kernel.layout import M_DRIFT
from dimersweep.parameters import check_count
from dimersweep.run import simulate
from dimersweep.symbols import PARAMETERS, QUANTITIES, STATES
from dimersweep.threads import run_each

MAX_POINTS = 20_000_000  # positions in one cube


class Path(NamedTuple):
    """Positions [m], shape (n,), and mean velocity along the axis [m s-1], of the point with this number."""

    point: int
    x: np.ndarray
    y: np.ndarray
    axial_velocity: float


def check_length(runs: int, periods: int, per_period: int) -> None:
    """Refuse paths that are too long to be held in memory.

    Raises
    ------
    ParameterError
    """
    moments = check_count("paths.periods", periods) * check_count("paths.per_period", per_period) + 1
    if runs * moments > MAX_POINTS:
        raise ParameterError(f"paths: {runs} of {moments} positions each; one cube may hold {MAX_POINTS} positions")


def path_of(point: int, parameters: dict[str, Any], periods: int, per_period: int, rtol: float) -> Path:
    """The path of one run.

    The velocity is the mean over the last forcing period, along the axis from the end that is down to the other one.
    """
    run = simulate(**parameters, periods=periods, rtol=rtol)
    ends = run.n_periods / run.parameters["f"]
    states = run.states(np.linspace(0, ends, run.n_periods * per_period + 1))
    x, y, theta = (states[name].values for name in ("x", "y", "theta"))
    dx, dy = x[-1] - x[-1 - per_period], y[-1] - y[-1 - per_period]
    forward = 1 if run.down_share_1 >= run.down_share_2 else -1
    along = forward * (dy * np.cos(theta[-1]) - dx * np.sin(theta[-1]))
    full = np.full((2, periods * per_period + 1), np.nan)  # a run that fails is shorter
    full[:, : x.size] = x, y
    return Path(point, full[0], full[1], float(along * run.parameters["f"]))


def add_paths(cube: xr.Dataset, *, periods: int, per_period: int, rtol: float, workers: int) -> xr.Dataset:
    """`cube` of a search with the path of each of its deciding runs that drifts.

    Parameters
    ----------
    cube : xarray.Dataset
        Of `search`: all parameters of a run, the searched one among them, are in it.
    periods : int
        Forcing periods of each path.
    per_period : int
        Positions in one of them.
    rtol : float
        Accuracy [1].
    workers : int
        Threads.

    Returns
    -------
    xarray.Dataset
        With `x`, `y` over a new dimension `cycle`, the time in forcing periods, and `axial_velocity`; NaN where there
        is no run that drifts.

    Raises
    ------
    ParameterError
        If the paths are too long to be held in memory.
    """
    mode = cube["mode"]
    moments = periods * per_period + 1
    check_length(mode.size, periods, per_period)
    x, y = (np.full((mode.size, moments), np.nan) for _ in range(2))
    velocity = np.full(mode.size, np.nan)

    def take(path: Path) -> None:
        x[path.point], y[path.point], velocity[path.point] = path[1:]

    def task(point: int) -> Path:
        return path_of(point, _parameters(cube, point), periods, per_period, rtol)

    run_each(task, np.flatnonzero(mode.values.ravel() == M_DRIFT).tolist(), workers, take)
    dims = tuple(map(str, mode.dims))
    for name, values in (("x", x), ("y", y)):
        cube[name] = float_variable((*dims, "cycle"), values.reshape(*mode.shape, moments), STATES[name])
    cube["axial_velocity"] = float_variable(dims, velocity.reshape(mode.shape), QUANTITIES["axial_velocity"])
    cycles = xr.Variable(
        "cycle", np.arange(moments) / per_period, {"units": "1", "long_name": "time in forcing periods"}
    )
    cycles.encoding["_FillValue"] = None
    return cube.assign_coords(cycle=cycles)


def _parameters(cube: xr.Dataset, point: int) -> dict[str, float]:
    place: Any = dict(zip(cube["mode"].dims, np.unravel_index(point, cube["mode"].shape), strict=True))
    names = [name for name in PARAMETERS if name in cube.variables]
    return {
        name: cube[name].isel({dim: k for dim, k in place.items() if dim in cube[name].dims}).item() for name in names
    }
