"""Points that are no grid: a table of parameters, one row a point, with what else of the points does not vary."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dimersweep.cubes.grid import MAX_POINTS, Grid, as_fixed, fixed_values, refuse_twice
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, number
from dimersweep.parameters import check, check_name, fill_rows, keeps_rules, reduced
from dimersweep.symbols import PARAMETERS


@dataclass(frozen=True)
class Points:
    """Single points, numbered in their order; stands in for `Grid`.

    Parameters
    ----------
    columns : dict of str to ndarray
        Values of the parameters that vary, shape (n,), SI units.
    fixed : dict of str to float
        The other parameters, SI units.
    """

    columns: dict[str, np.ndarray]
    fixed: dict[str, float]

    @property
    def axes(self) -> dict[str, np.ndarray]:
        """The one axis of their cube: `point`, the number of each."""
        return {"point": np.arange(self.size)}

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points, as that of an array."""
        return (self.size,)

    @property
    def size(self) -> int:
        """Number of points."""
        return len(next(iter(self.columns.values())))

    def rows_at(self, points: np.ndarray) -> np.ndarray:
        """Kernel rows of `points`, numbers of shape (n,); shape (n, N_ROW), float64."""
        return fill_rows(self.fixed | self.values(points), points.size)

    def values(self, points: Any) -> dict[str, np.ndarray]:
        """Values of the parameters that vary at `points`, of the same shape."""
        return {name: values[points] for name, values in self.columns.items()}

    line = 1  # see `Grid.line`

    def point(self, number: int) -> str:
        """Such as ``point 7 (Gamma = 0.9, beta0 = 0.2)``."""
        values = (f"{name} = {float(values[number])!r}" for name, values in self.columns.items())
        return f"point {number} ({', '.join(values)})"

    def window(self, start: int, stop: int) -> tuple["Points", int]:
        """The points `start` to `stop` - 1 alone, and the number of the first of them there; see `Grid.window`."""
        return Points({name: values[start:stop] for name, values in self.columns.items()}, self.fixed), 0

    def configuration(self) -> dict[str, Any]:
        """The part of a configuration that gives the points."""
        return {"points": {name: values.tolist() for name, values in self.columns.items()}, "fixed": self.fixed}

    def first(self) -> "Points":
        """Its first point alone."""
        return self.window(0, 1)[0]


def make_points(table: Any, fixed: Mapping[str, Any] | None = None) -> Points:
    """Judge a table of points.

    Parameters
    ----------
    table : mapping of str to array_like, pandas.DataFrame or xarray.Dataset
        A column of one length for each parameter that varies, in SI units; of a dataset, its parameters of one dimension.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.

    Returns
    -------
    Points

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed, and for a rule between two of them the point.
    """
    columns = {name: _column(name, values) for name, values in _columns(table).items()}
    if not columns:
        raise ParameterError("points: has no column; give at least one parameter that varies")
    lengths = {name: values.size for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ParameterError(f"points: the columns differ in length ({counts})")
    if not 1 <= next(iter(lengths.values())) <= MAX_POINTS:
        raise ParameterError(f"points: {next(iter(lengths.values()))} of them; must be 1 to {MAX_POINTS}")
    fixed = as_fixed(fixed)
    refuse_twice(columns, fixed)
    held = fixed_values(columns, fixed)
    check(held | columns, gaps=(*held, *columns))
    _check_ties(Points(columns, held))
    return Points(columns, held)


def _columns(table: Any) -> dict[str, Any]:
    if hasattr(table, "data_vars"):
        told = {str(name): each for name, each in table.variables.items() if name in PARAMETERS}
        if "mode" in table:  # a cube tells what follows from the rest, too
            told = reduced(told)
        return {name: each for name, each in told.items() if each.ndim == 1}
    if hasattr(table, "items"):
        columns = [(str(name), values) for name, values in table.items()]
        names = [name for name, _ in columns]
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f"points: has {names.count(name)} columns {name}; give each parameter once")
        return dict(columns)
    raise ParameterError(f"points: is a {type(table).__name__}; give a mapping of parameters to columns, or a table")


def _column(name: str, values: Any) -> np.ndarray:
    check_name(name)
    if not isinstance(values, list | tuple | range) and getattr(values, "ndim", 0) != 1:
        raise ParameterError(f"{name}: has shape {getattr(values, 'shape', ())}; must be one column")
    return as_numbers(name, values, number, PARAMETERS[name].units)


def _check_ties(points: Points) -> None:
    """Judge each point by the rules that tie two parameters.

    Raises
    ------
    ParameterError
    """
    kept = np.broadcast_to(keeps_rules(points.fixed | points.columns), points.size)
    if kept.all():
        return
    first = int(np.argmin(kept))
    try:
        check(points.fixed | {name: values[first] for name, values in points.columns.items()})
    except ParameterError as error:
        raise ParameterError(f"point {first}: {error}") from None


AnyGrid = Grid | Points


def check_fits(grid: AnyGrid, *, by_blocks: bool) -> None:
    """Refuse a grid whose results memory cannot be expected to hold.

    Parameters
    ----------
    grid : Grid or Points
    by_blocks : bool
        Whether its cube could be written without being held in memory.

    Raises
    ------
    ParameterError
    """
    if grid.size > MAX_POINTS:
        way_out = " (an output that ends in .zarr is not held in memory)" if by_blocks else ""
        raise ParameterError(f"grid: {grid.size} points; one cube in memory may hold {MAX_POINTS}{way_out}")
