"""All that decides the numbers of a sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.cubes.grid import carry_of, make_grid, with_directions
from dimersweep.cubes.points import AnyGrid, make_points
from dimersweep.cubes.results import RESULT, Bundle
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, check_switch
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.runs.carrying import carried
from dimersweep.runs.settings import SLOW_MODES, RunSettings, run_patiently, run_settings
from dimersweep.runs.shadows import certified
from dimersweep.studies.strobes import MAX_STROBES, add_strobes, strobe_fields
from dimersweep.work.tiles import around

CERTIFIED = np.dtype([*RESULT.descr, ("confidence", "<i8"), ("error_estimate", "<f8")])  # result of a certified point


@dataclass(frozen=True)
class Spec:
    """All that decides the numbers of a sweep.

    Parameters
    ----------
    grid : Grid or Points
        The points. Where it has the axis `direction`, the state is carried along the last axis, see `with_directions`.
    how : RunSettings
        How long each point is run, and how accurately.
    certify : bool
        Whether it is tried how sure each mode is.
    strobes : int
        Forcing periods after the run whose starts are kept, see `add_strobes`; 0 for none.
    """

    grid: AnyGrid
    how: RunSettings
    certify: bool
    strobes: int = 0

    summary = "sweep of a 3D dimer on a vibrating plate"

    @property
    def by_blocks(self) -> bool:
        """Whether the cube may be written block by block: that of a grid without strobes."""
        return not (self.strobes or self.grid.columns)

    @property
    def kind(self) -> np.dtype:
        """See `Work`."""
        kind = CERTIFIED if self.certify else RESULT
        return np.dtype([*kind.descr, *strobe_fields(self.strobes)]) if self.strobes else kind

    @property
    def line(self) -> int:
        """See `Work`."""
        return self.grid.line

    def whole_lines(self, points: np.ndarray) -> np.ndarray:
        """The lines in which one of `points` is, for points of whole lines; bool, shape (n,), as `points`."""
        return np.repeat(points.reshape(-1, self.line).any(axis=1), self.line)

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """See `Work`: until one has used all its periods, so that quick points do not go on for long with slow ones."""
        if "direction" in self.grid.axes:
            return self._carry_on(points, results, space)
        out, codes = blank(points.size)
        rows = self.grid.rows_at(points)
        done = run_patiently(rows, self.how, out, codes, until=SLOW_MODES, space=space)
        results["out"][:done], results["codes"][:done] = out[:done], codes[:done]
        if self.certify:
            results["confidence"][:done], results["error_estimate"][:done] = certified(
                rows[:done], self.how, out[:done], codes[:done], space
            )
        if self.strobes:
            add_strobes(rows[:done], self.how.rtol, results[:done], space)
        if (self.certify or self.strobes) and is_stopped(space):
            return 0  # some of it may be missing
        return done

    def _carry_on(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """Run whole lines, and count their points."""
        line = self.line
        for done in range(0, points.size, line):
            self._run_line(points[done : done + line], results[done : done + line], space)
            if is_stopped(space):
                return done
        return points.size

    def _run_line(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> None:
        """Run the points of one line in its direction, each from the state in which the one before it has ended."""
        down = bool(self.grid.values(points[0])["direction"])
        rows, results = self.grid.rows_at(points)[:: -1 if down else 1], results[:: -1 if down else 1]
        for k, link in enumerate(carried(rows, self.how, space)):
            here = slice(k, k + 1)
            results["out"][here], results["codes"][here] = link.out, link.codes
            if self.strobes:
                add_strobes(rows[here], self.how.rtol, results[here], space, link.start)

    def narrowed(self, tiles: Bundle) -> tuple["Spec", Bundle, int]:
        """See `Work`."""
        grid, moved, shift = around(self.grid, tiles)
        return replace(self, grid=grid), moved, shift

    def configuration(self) -> dict[str, Any]:
        """All that decides the numbers, as plain numbers, lists and strings, with the version of the kernel."""
        settings = self.grid.configuration() | {
            "periods": self.how.periods,
            "rtol": self.how.rtol,
            "stop_when_settled": self.how.stop_when_settled,
            "kernel_version": kernel_version(),
        }
        if self.how.max_periods > self.how.periods:
            settings["max_periods"] = self.how.max_periods
        if self.certify:
            settings["certify"] = True
        if self.strobes:
            settings["strobes"] = self.strobes
        return settings

    @classmethod
    def from_configuration(cls, settings: Mapping[str, Any]) -> "Spec":
        """The spec that gave `settings` as its `configuration`, whatever the kernel was; judged like any other input.

        Raises
        ------
        ParameterError
            If a value is not allowed.
        KeyError
            If something is missing.
        """
        axes, carry = without_directions(settings.get("grid"))
        return make_spec(
            axes,
            settings["fixed"],
            carry=carry,
            points=settings.get("points"),
            periods=settings["periods"],
            rtol=settings["rtol"],
            stop_when_settled=settings["stop_when_settled"],
            certify=settings.get("certify", False),
            max_periods=settings.get("max_periods"),
            strobes=settings.get("strobes", 0),
        )


def without_directions(axes: Mapping[str, Any] | None) -> tuple[dict[str, Any] | None, str | None]:
    """The axes that a user gave, and `carry`, from those of a configuration."""
    if axes is None or "direction" not in axes:
        return axes if axes is None else dict(axes), None
    return {name: values for name, values in axes.items() if name != "direction"}, carry_of(axes["direction"])


def make_spec(
    axes: Mapping[str, Any] | None,
    fixed: Mapping[str, Any] | None = None,
    *,
    points: Any = None,
    certify: bool = False,
    strobes: int = 0,
    carry: str | None = None,
    **how: Any,
) -> Spec:
    """A spec from what a user gives, see `sweep`; `how` is what `run_settings` takes.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    if (axes is None) == (points is None):
        raise ParameterError("grid: give either a grid or points")
    if carry is not None and axes is None:
        raise ParameterError(f"carry = {carry!r}: is for grids, whose last axis it goes along, not for single points")
    grid: AnyGrid
    if axes is None:
        grid = make_points(points, fixed)
    else:
        grid = make_grid(axes, fixed) if carry is None else with_directions(make_grid(axes, fixed), carry)
    if carry is not None and check_switch("certify", certify):
        raise ParameterError("certify: is for points that start by themselves, and goes without carry")
    kept = 0 if strobes == 0 else check_count("strobes", strobes)
    if grid.size * kept > MAX_STROBES:
        raise ParameterError(f"strobes = {kept}: of {grid.size} points; one cube may hold {MAX_STROBES} strobes")
    return Spec(grid, run_settings(**how), check_switch("certify", certify), kept)
