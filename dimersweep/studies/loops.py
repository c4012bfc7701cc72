"""Loops of hysteresis: where the motions on the way up and on the way down an axis part, and where they meet again."""

import json
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import Column, column, finished, table, variable
from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.cubes.results import runs
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number
from dimersweep.kernel.batch import Workspace
from dimersweep.kernel.model.layout import CODE_MODE, CODE_MODE_PERIOD, CODE_N_PERIODS
from dimersweep.parameters import fill_rows
from dimersweep.runs.accessor import is_of_this_kernel
from dimersweep.runs.carrying import carried
from dimersweep.runs.point_source import source_of
from dimersweep.runs.solving import Solved
from dimersweep.studies.deciding import OPEN
from dimersweep.studies.making import in_memory
from dimersweep.studies.observers import EndStates
from dimersweep.studies.study import Study
from dimersweep.symbols import PARAMETERS, Quantity
from dimersweep.work.stopping import stoppable

UP, DOWN = range(len(DIRECTIONS))
SIDES = ("low", "high")
# length of a run that locates the end of a loop, in runs of the line: at a fold the time to settle grows as one over
# the square root of the distance, so runs 16 times as long settle 256 times nearer to it
LONGER = 16


class LoopEnd(NamedTuple):
    """One end of a loop: an interval between two values of the axis, only one of which lies inside the loop.

    Attributes
    ----------
    below, above : float
        The two values, in the unit of the axis; both NaN where the loop goes on beyond the axis.
    modes : tuple of int
        Codes of the modes on the way up and on the way down, at the value inside the loop.
    inside : int
        Index of the value of the axis next to this end, inside the loop.
    """

    below: float
    above: float
    modes: tuple[int, int]
    inside: int


Ends = tuple[LoopEnd, LoopEnd]  # low end and high end of a loop


def loops(cube: xr.Dataset, *, within: float | None = None) -> xr.Dataset:
    """Find the loops of hysteresis of a cube: where the way up and the way down lead to different motions.

    Motions differ if their modes or their periods (in forcing periods) differ. Points that failed or have not settled
    are left out. So the ends of a loop lie between values at which both motions are known.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube of `sweep` or `bifurcation` with ``carry="both"``.
    within : float, optional
        Accuracy to which ends are located, in the unit of the axis. The step in which an end lies is halved: each new
        run starts from the state carried up to it from below, and down to it from above. The lines of these loops are
        run again for their states. By default the ends stay as accurate as the steps of the axis.

    Returns
    -------
    xarray.Dataset
        Loops along `loop`, line by line of the cube. In the unit of the axis: `low` and `high`, the middles of the
        steps in which the ends lie, with `low_error` and `high_error`, half the lengths of these steps; NaN for an end
        beyond the axis. Modes on the way up and down next to each end inside the loop, such as `mode_up_low`. Where the
        cube has an observer, its variables at the value of the axis next to each end inside the loop, such as
        `peak_up_low`. Parameters are coordinates. The attribute `cost` is the number of forcing periods that were run.

    Raises
    ------
    ParameterError
        If the cube does not have both directions, or `within` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import loops, sweep
    >>> cube = sweep({"Gamma": np.linspace(0.7, 1.1, 9)}, periods=200, carry="both", progress=False)
    >>> found = loops(cube, within=1e-3)
    >>> found["low"].values.round(2).tolist()  # the drift that comes down ends here, and what rests goes on resting
    [0.79]
    """
    if not isinstance(cube, xr.Dataset) or cube.sizes.get("direction", 0) != len(DIRECTIONS):
        raise ParameterError("loops: the cube has not both directions; make it with carry='both'")
    configuration = json.loads(cube.attrs["configuration"])
    *_, axis = configuration["grid"]
    within = None if within is None else as_number("within", within, PARAMETERS[axis].units)
    if within is not None and not within > 0:
        raise ParameterError(f"within = {within:g}: must be > 0")
    cube = cube.sel(direction=[UP, DOWN]).sortby(axis)
    others = [str(name) for name in cube["mode"].dims if name not in ("direction", axis)]
    motions = {
        name: cube[name].transpose(*others, "direction", axis).values.reshape(-1, len(DIRECTIONS), cube.sizes[axis])
        for name in ("mode", "mode_period")
    }
    values = cube[axis].values
    # indices of each line along the other axes
    places = np.array(list(np.ndindex(*(cube.sizes[name] for name in others))), dtype=int)
    found: list[tuple[int, Ends]] = []
    cost = 0
    for line in range(len(motions["mode"])):
        ends = list(_ends(values, motions["mode"][line], motions["mode_period"][line]))
        if ends and within is not None:
            here = dict(zip(others, places[line], strict=True))
            there = CarriedLine(_line_through(cube.isel(here | {"direction": UP, axis: 0})))
            ends = [stoppable(partial(there.located, pair, within)) for pair in ends]
            cost += there.cost
        found += [(line, pair) for pair in ends]
    made = _table(cube, axis, {name: places[:, k] for k, name in enumerate(others)}, found)
    for name in cube.data_vars.keys() & {*configuration.get("observe", {}).get("variables", ())}:
        made = made.assign(_observed(cube[name].transpose(*others, "direction", axis, ...), len(others), found))
    return finished(made.assign_attrs(parameter=axis, cost=float(cost)), f"Loops of hysteresis along {axis}")


def _ends(values: np.ndarray, mode: np.ndarray, period: np.ndarray) -> Iterator[Ends]:
    """Yield both ends of each loop of one line; modes and periods have the shape (2, n), the way up first."""
    known = np.flatnonzero(~np.isin(mode, OPEN).any(axis=0))
    values, mode, period = values[known], mode[:, known], period[:, known]
    for first, stop in runs((mode[UP] != mode[DOWN]) | (period[UP] != period[DOWN])):
        low, high = ((int(mode[UP, k]), int(mode[DOWN, k])) for k in (first, stop - 1))
        beyond = np.full(2, np.nan)
        below = values[first - 1 : first + 1] if first else beyond
        above = values[stop - 1 : stop + 1] if stop < values.size else beyond
        at = known[[first, stop - 1]].tolist()
        yield LoopEnd(below[0], below[1], low, at[0]), LoopEnd(above[0], above[1], high, at[1])


def _line_through(point: xr.Dataset) -> Study:
    """Return the line of a point as a study of its own, run up and down, which keeps the end states."""
    made = source_of(point)
    is_of_this_kernel(made.kernel, "the ends may lie elsewhere than its modes say")
    assert made.line is not None  # since the cube has directions
    grid = Grid({"direction": np.array([UP, DOWN])} | made.line.axes, made.line.fixed)
    return Study(grid=grid, how=made.how, observers=(EndStates(),))


class CarriedLine:
    """One line of the carried axis, run anew up and down for the states at its values.

    Parameters
    ----------
    study : Study
        Study of this line alone, which keeps the end states.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        *_, (self.axis, self.values) = study.grid.axes.items()
        results, _ = in_memory(study)
        self.ends = results["end"].reshape(len(DIRECTIONS), self.values.size, 1, -1)
        self.cost = sum(study.how.cost(n) for n in results["codes"][:, CODE_N_PERIODS].tolist())

    def _row(self, value: float) -> np.ndarray:
        """Return the row of parameters at a value of the axis, shape (N_ROW,)."""
        row: np.ndarray = fill_rows(self.study.grid.fixed | {self.axis: value}, 1)[0]
        return row

    def _carry(self, start: np.ndarray | None, before: float, to: float, space: Workspace) -> Solved | None:
        """Carry a state from one value of the axis to another, and return the run; None if it was stopped.

        Near an end motions settle slowly, so the run may be `LONGER` times as long as on the line.
        """
        how = self.study.how._replace(max_periods=LONGER * self.study.how.max_periods)
        return next(carried([self._row(to)], how, space, start, self._row(before)), None)

    def located(self, ends: Ends, within: float, space: Workspace) -> Ends:
        """Return both ends of a loop, located to `within`."""
        low, high = ends
        return self._located(low, within, 1, space), self._located(high, within, 0, space)

    def _located(self, end: LoopEnd, within: float, inside: int, space: Workspace) -> LoopEnd:
        """Return an end, located by halving; an end beyond the axis is returned as it is.

        `inside` is 1 if the loop lies above the end (its low end), 0 if it lies below. The halving stops early at a
        motion that has not settled.
        """
        if np.isnan(end.below):
            return end
        below, above, modes, _ = end
        k, j = (int(np.searchsorted(self.values, value)) for value in (below, above))
        up, down = self.ends[UP][k], self.ends[DOWN][j]
        while above - below > 2 * within:  # the end is the middle, so the error is half the interval
            middle = 0.5 * (below + above)
            rising, falling = self._carry(up, below, middle, space), self._carry(down, above, middle, space)
            if middle in (below, above) or rising is None or falling is None:
                break
            self.cost += rising.cost + falling.cost
            one, two = _motion(rising), _motion(falling)
            if one[0] in OPEN or two[0] in OPEN:
                break
            if one != two:
                modes = one[0], two[0]
            if (one != two) == bool(inside):
                above, down = middle, falling.onward
            else:
                below, up = middle, rising.onward
        return LoopEnd(below, above, modes, end.inside)


def _motion(solved: Solved) -> tuple[int, int]:
    """Return the mode of a run (code), and the forcing periods after which its motion repeats."""
    return int(solved.codes[CODE_MODE]), int(solved.codes[CODE_MODE_PERIOD])


def _table(cube: xr.Dataset, axis: str, places: dict[str, np.ndarray], found: list[tuple[int, Ends]]) -> xr.Dataset:
    """Return the loops as a dataset; `places` has the indices of each line along the other axes."""
    units, meaning = PARAMETERS[axis].units, PARAMETERS[axis].long_name
    lines = np.array([line for line, _ in found], dtype=int)
    columns = []
    for k, which in enumerate(SIDES):
        below, above = np.array([pair[k][:2] for _, pair in found]).reshape(-1, 2).T
        end = Quantity(units, f"{which} end of the loop: {meaning}")
        error = Quantity(units, f"half the step that the {which} end lies in")
        columns += [Column(which, end, 0.5 * (below + above)), Column(f"{which}_error", error, 0.5 * (above - below))]
    made = table((), columns, "loop")
    for (k, which), (direction, word) in product(enumerate(SIDES), enumerate(DIRECTIONS)):
        flags = variable("mode", ("loop",), np.array([pair[k].modes[direction] for _, pair in found], dtype=np.int8))
        flags.attrs["long_name"] += f" on the way {word}, inside the loop at its {which} end"
        made[f"mode_{word}_{which}"] = flags
    coordinates = {
        name: column("loop", cube[name].values[each[lines]], PARAMETERS[name]) for name, each in places.items()
    }
    fixed = {name: cube[name].variable for name in PARAMETERS if name in cube.coords and not cube[name].ndim}
    coordinates["loop"] = column("loop", np.arange(len(found)), "number of the loop")
    return made.assign_coords(fixed | coordinates)


def _observed(variable: xr.DataArray, others: int, found: list[tuple[int, Ends]]) -> dict[str, xr.Variable]:
    """Return the values of an observed variable next to both ends of each loop, on the way up and down, by new names.

    The dimensions of `variable` are the `others`, `direction`, the axis of the loops, and its own.
    """
    values, dims = variable.values.reshape(-1, *variable.shape[others:]), ("loop", *variable.dims[others + 2 :])
    lines = np.array([line for line, _ in found], dtype=int)
    variables = {}
    for (k, which), (direction, word) in product(enumerate(SIDES), enumerate(DIRECTIONS)):
        inside = np.array([pair[k].inside for _, pair in found], dtype=int)
        variables[f"{variable.name}_{word}_{which}"] = xr.Variable(
            dims, values[lines, direction, inside], variable.attrs
        )
    return variables
