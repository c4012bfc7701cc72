"""Hysteresis: where the motions of a sweep that carries its state up and down an axis part, and where they meet again."""

import json
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import column, finished, variable
from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.cubes.results import runs
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number
from dimersweep.kernel.batch import Workspace
from dimersweep.kernel.model.layout import CODE_MODE, CODE_MODE_PERIOD, CODE_N_PERIODS
from dimersweep.parameters import fill_rows
from dimersweep.runs.accessor import is_of_this_kernel
from dimersweep.runs.behind import behind
from dimersweep.runs.carrying import carried
from dimersweep.runs.solving import Solved
from dimersweep.studies.deciding import OPEN
from dimersweep.studies.making import in_memory
from dimersweep.studies.observers import EndStates
from dimersweep.studies.study import Study
from dimersweep.symbols import PARAMETERS, Quantity
from dimersweep.work.stopping import stoppable

UP, DOWN = range(len(DIRECTIONS))
SIDES = ("low", "high")
LONGER = 16  # how much longer than a run of the line one may be that looks for the end of a loop


class LoopEnd(NamedTuple):
    """One end of a loop: between two values of the axis, of which one lies inside.

    Attributes
    ----------
    below, above : float
        The two values; NaN both where the loop is not closed on the axis.
    modes : tuple of int
        Modes of motion, codes, on the way up and down at the value inside.
    inside : int
        Number of the value of the axis that is next to it, inside the loop.
    """

    below: float
    above: float
    modes: tuple[int, int]
    inside: int


Ends = tuple[LoopEnd, LoopEnd]  # of a loop, the low one and the high one


def loops(cube: xr.Dataset, *, within: float | None = None) -> xr.Dataset:
    """The hysteresis loops of a cube: where going up and going down lead to different motions.

    Motions differ if their modes or their periods in forcing periods do. Points that failed or have not settled are left out:
    the ends of a loop lie between values at which both motions are known.

    Parameters
    ----------
    cube : xarray.Dataset
        Of `sweep` or `bifurcation` with ``carry="both"``.
    within : float, optional
        If given, ends are located to this, in the unit of the axis, by halving the step that they lie in: each new run starts
        from the state carried up to it from below, and down to it from above. The lines of these loops are run again for
        their states.

    Returns
    -------
    xarray.Dataset
        Along `loop`, one after the other on each line of the cube, in the unit of the axis: `low` and `high`, the middles of
        the steps in which its ends lie, with `low_error` and `high_error`, half the lengths of these; NaN for an end that lies
        beyond the axis. Besides the modes on the way up and down next to each end inside the loop, such as `mode_up_low`; and
        where the cube has an observer, what that tells at the value of the axis next to each end inside the loop, such as
        `peak_up_low`. Parameters are coordinates. The attribute `cost` is the number of forcing periods that were run.

    Raises
    ------
    ParameterError
        If the cube has not both directions, or `within` is not positive.

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
    places = np.array(list(np.ndindex(*(cube.sizes[name] for name in others))), dtype=int)  # of each line
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
    table = _table(cube, axis, {name: places[:, k] for k, name in enumerate(others)}, found)
    for name in cube.data_vars.keys() & {*configuration.get("observe", {}).get("variables", ())}:
        table = table.assign(_observed(cube[name].transpose(*others, "direction", axis, ...), len(others), found))
    return finished(table.assign_attrs(parameter=axis, cost=float(cost)), f"Loops of hysteresis along {axis}")


def _ends(values: np.ndarray, mode: np.ndarray, period: np.ndarray) -> Iterator[Ends]:
    """The ends of the loops of one line, from modes and periods of shape (2, n)."""
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
    """The line of a point on the way up, each way, as a sweep of its own."""
    made = behind(point)
    is_of_this_kernel(made.kernel, "the ends may lie elsewhere than its modes say")
    assert made.line is not None  # the cube has directions
    grid = Grid({"direction": np.array([UP, DOWN])} | made.line.axes, made.line.fixed)
    return Study(grid=grid, how=made.how, observers=(EndStates(),))


class CarriedLine:
    """One line of the carried axis, run anew each way for the states at its values.

    Parameters
    ----------
    study : Study
        Of this line alone.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        *_, (self.axis, self.values) = study.grid.axes.items()
        results, _ = in_memory(study)
        self.ends = results["end"].reshape(len(DIRECTIONS), self.values.size, 1, -1)
        self.cost = sum(study.how.cost(n) for n in results["codes"][:, CODE_N_PERIODS].tolist())

    def _row(self, value: float) -> np.ndarray:
        row: np.ndarray = fill_rows(self.study.grid.fixed | {self.axis: value}, 1)[0]
        return row

    def _carry(self, start: np.ndarray | None, before: float, to: float, space: Workspace) -> Solved | None:
        """Carry a state from one value to another; near an end motions settle slowly, and may take longer than on the line.

        None if it was stopped.
        """
        how = self.study.how._replace(max_periods=LONGER * self.study.how.max_periods)
        return next(carried([self._row(to)], how, space, start, self._row(before)), None)

    def located(self, ends: Ends, within: float, space: Workspace) -> Ends:
        """Both ends of a loop, located to `within`."""
        low, high = ends
        return self._located(low, within, 1, space), self._located(high, within, 0, space)

    def _located(self, end: LoopEnd, within: float, inside: int, space: Workspace) -> LoopEnd:
        """An end between values of the axis, located by halving; `inside` is 0 if the loop lies below it, 1 if above."""
        if np.isnan(end.below):
            return end
        below, above, modes, _ = end
        k, j = (int(np.searchsorted(self.values, value)) for value in (below, above))
        up, down = self.ends[UP][k], self.ends[DOWN][j]
        while above - below > 2 * within:  # half of it is the error
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
    """Its mode, and the forcing periods after which it repeats."""
    return int(solved.codes[CODE_MODE]), int(solved.codes[CODE_MODE_PERIOD])


def _table(cube: xr.Dataset, axis: str, places: dict[str, np.ndarray], found: list[tuple[int, Ends]]) -> xr.Dataset:
    """The loops as a dataset."""
    units, meaning = PARAMETERS[axis].units, PARAMETERS[axis].long_name
    lines = np.array([line for line, _ in found], dtype=int)
    columns = {}
    for k, which in enumerate(SIDES):
        below, above = np.array([pair[k][:2] for _, pair in found]).reshape(-1, 2).T
        columns[which] = 0.5 * (below + above), Quantity(units, f"{which} end of the loop: {meaning}")
        columns[f"{which}_error"] = (
            0.5 * (above - below),
            Quantity(units, f"half the step that the {which} end lies in"),
        )
    table = xr.Dataset({name: column("loop", values, said) for name, (values, said) in columns.items()})
    for (k, which), (way, word) in product(enumerate(SIDES), enumerate(DIRECTIONS)):
        flags = variable("mode", ("loop",), np.array([pair[k].modes[way] for _, pair in found], dtype=np.int8))
        flags.attrs["long_name"] += f" on the way {word}, inside the loop at its {which} end"
        table[f"mode_{word}_{which}"] = flags
    told = {name: column("loop", cube[name].values[each[lines]], PARAMETERS[name]) for name, each in places.items()}
    fixed = {name: cube[name].variable for name in PARAMETERS if name in cube.coords and not cube[name].ndim}
    told["loop"] = column("loop", np.arange(len(found)), "number of the loop")
    return table.assign_coords(fixed | told)


def _observed(variable: xr.DataArray, others: int, found: list[tuple[int, Ends]]) -> dict[str, xr.Variable]:
    """What an observer tells next to the ends of loops, from a variable over other axes, direction, the axis, and its own."""
    values, dims = variable.values.reshape(-1, *variable.shape[others:]), ("loop", *variable.dims[others + 2 :])
    lines = np.array([line for line, _ in found], dtype=int)
    told = {}
    for (k, which), (way, word) in product(enumerate(SIDES), enumerate(DIRECTIONS)):
        inside = np.array([pair[k].inside for _, pair in found], dtype=int)
        told[f"{variable.name}_{word}_{which}"] = xr.Variable(dims, values[lines, way, inside], variable.attrs)
    return told
