"""All that decides the numbers of a sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.cubes.grid import Grid, make_grid
from dimersweep.cubes.results import RESULT, Bundle
from dimersweep.errors import ParameterError
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.parameters import check_count, check_rtol
from dimersweep.studies.certifying import certified
from dimersweep.work.tiles import SLOW_MODES, around, run_patiently

CERTIFIED = np.dtype([*RESULT.descr, ("confidence", "<i8"), ("error_estimate", "<f8")])  # the same of a certified one


def check_max_periods(periods: int, max_periods: int | None) -> int:
    """The longest run of a point: `periods` where nothing is given.

    Raises
    ------
    ParameterError
        If it is shorter than that.
    """
    longest = periods if max_periods is None else check_count("max_periods", max_periods)
    if longest < periods:
        raise ParameterError(f"max_periods = {longest}: must be >= periods = {periods}")
    return longest


@dataclass(frozen=True)
class Spec:
    """All that decides the numbers of a sweep.

    Parameters
    ----------
    grid : Grid
        The points.
    periods : int
        Forcing periods each point may take.
    rtol : float
        Accuracy [1].
    stop_when_settled : bool
        Whether a point stops as soon as its motion has settled.
    certify : bool
        Whether it is tried how sure each mode is.
    max_periods : int
        Forcing periods that a point may take if its motion has not settled by then, see `run_patiently`.
    """

    grid: Grid
    periods: int
    rtol: float
    stop_when_settled: bool
    certify: bool
    max_periods: int

    summary = "sweep of a 3D dimer on a vibrating plate"
    by_blocks = True

    @property
    def kind(self) -> np.dtype:
        """See `Work`."""
        return CERTIFIED if self.certify else RESULT

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """See `Work`: until one has used all its periods, so that quick points do not go on for long with slow ones."""
        out, codes = blank(points.size)
        rows = self.grid.rows_at(points)
        how = self.rtol, self.stop_when_settled
        done = run_patiently(rows, self.periods, self.max_periods, *how, out, codes, until=SLOW_MODES, space=space)
        results["out"][:done], results["codes"][:done] = out[:done], codes[:done]
        if self.certify:
            results["confidence"][:done], results["error_estimate"][:done] = certified(
                rows[:done], self.max_periods, *how, out[:done], codes[:done], space
            )
            return 0 if is_stopped(space) else done  # it may not have been certified
        return done

    def narrowed(self, tiles: Bundle) -> tuple["Spec", Bundle, int]:
        """See `Work`."""
        grid, moved, shift = around(self.grid, tiles)
        return replace(self, grid=grid), moved, shift

    def configuration(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, with the version of the kernel that gives the results."""
        told = {
            "grid": {name: values.tolist() for name, values in self.grid.axes.items()},
            "fixed": self.grid.fixed,
            "periods": self.periods,
            "rtol": self.rtol,
            "stop_when_settled": self.stop_when_settled,
            "kernel_version": kernel_version(),
        }
        if self.max_periods > self.periods:
            told["max_periods"] = self.max_periods
        if self.certify:
            told["certify"] = True
        return told

    @classmethod
    def from_configuration(cls, told: Mapping[str, Any]) -> "Spec":
        """The spec that gave `told` as its `configuration`, whatever the kernel was; judged like any other input.

        Raises
        ------
        ParameterError
            If a value is not allowed.
        KeyError
            If something is missing.
        """
        return make_spec(
            told["grid"],
            told["fixed"],
            periods=told["periods"],
            rtol=told["rtol"],
            stop_when_settled=told["stop_when_settled"],
            certify=told.get("certify", False),
            max_periods=told.get("max_periods"),
        )


def make_spec(
    axes: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    periods: int,
    rtol: float = 1e-8,
    stop_when_settled: bool = True,
    certify: bool = False,
    max_periods: int | None = None,
) -> Spec:
    """A spec from what a user gives, see `sweep`.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    grid = make_grid(axes, fixed)
    periods = check_count("periods", periods)
    longest = check_max_periods(periods, max_periods)
    if longest > periods and not stop_when_settled:
        raise ParameterError(f"max_periods = {longest}: is for runs that stop when they have settled")
    return Spec(grid, periods, check_rtol(rtol), bool(stop_when_settled), bool(certify), longest)
