"""The path of one run: positions of the centre of mass over time, and the velocity along the axis."""

from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.kernel.batch import Workspace
from dimersweep.parameters import Parameters
from dimersweep.runs.run import simulate_judged
from dimersweep.runs.solving import MAX_RECORDED

MAX_POSITIONS = 20_000_000  # in one cube, which is held in memory


@dataclass(frozen=True)
class PathLength:
    """How much of the path of the centre of mass is kept of a run.

    Parameters
    ----------
    periods : int
        Forcing periods.
    per_period : int
        Positions in one of them.
    """

    periods: int
    per_period: int

    @property
    def moments(self) -> int:
        """Number of positions."""
        return self.periods * self.per_period + 1

    @property
    def fields(self) -> list[tuple[Any, ...]]:
        """What a path adds to the result of a point: positions [m] and the axial velocity [m s-1]."""
        return [("x", "<f8", (self.moments,)), ("y", "<f8", (self.moments,)), ("axial_velocity", "<f8")]

    def check(self, runs: int) -> None:
        """Refuse paths that are too long to be held in memory.

        Raises
        ------
        ParameterError
        """
        if runs * self.moments > MAX_POSITIONS:
            raise ParameterError(
                f"paths: {runs} of {self.moments} positions each; one cube may hold {MAX_POSITIONS} positions"
            )


def path_length(periods: int, per_period: int = 8) -> PathLength:
    """A length from what a user gives.

    Raises
    ------
    ParameterError
        If a number is not allowed.
    """
    return PathLength(check_count("paths.periods", periods, MAX_RECORDED), check_count("paths.per_period", per_period))


def path_of(
    parameters: dict[str, Any], length: PathLength, rtol: float, space: Workspace
) -> tuple[np.ndarray, np.ndarray, float]:
    """The path of one run, made on `space`.

    Returns
    -------
    x, y : ndarray, shape (length.moments,), float64
        Position of the centre of mass [m]; NaN after the end of a run that fails.
    axial_velocity : float
        Mean over the last forcing period, along the axis from the end that is down to the other one [m s-1]; NaN if no
        period was completed.
    """
    full = np.full((2, length.moments), np.nan)
    run = simulate_judged(Parameters(**parameters), length.periods, rtol, False, True, space)
    if not run.n_periods:
        return full[0], full[1], nan
    ends = run.n_periods / run.parameters["f"]
    states = run.states(np.linspace(0, ends, run.n_periods * length.per_period + 1))
    x, y, theta = (states[name].values for name in ("x", "y", "theta"))
    dx, dy = x[-1] - x[-1 - length.per_period], y[-1] - y[-1 - length.per_period]
    forward = 1 if run.down_share_1 >= run.down_share_2 else -1
    along = forward * (dy * np.cos(theta[-1]) - dx * np.sin(theta[-1]))
    full[:, : x.size] = x, y
    return full[0], full[1], float(along * run.parameters["f"])
