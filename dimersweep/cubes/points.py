"""Points that are no grid: a table of parameters, one row a point."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dimersweep.cubes.grid import MAX_POINTS, Grid, laid_out
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, number
from dimersweep.parameters import check, check_name, keeps_rules, reduced
from dimersweep.symbols import PARAMETERS


def make_points(table: Any, fixed: Mapping[str, Any] | None = None) -> Grid:
    """Judge a table of points.

    Parameters
    ----------
    table : mapping of str to array_like, pandas.DataFrame or xarray.Dataset
        A column of one length for each parameter that varies, in SI units; of a dataset, its parameters of one dimension.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.

    Returns
    -------
    Grid
        Along `point`, the number of each.

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed, and for a rule between two of them the point.
    """
    given = _columns(table)
    if not given:
        raise ParameterError("points: has no column; give at least one parameter that varies")
    columns, held = laid_out(given, fixed, _column, gaps=PARAMETERS)
    lengths = {name: values.size for name, values in columns.items()}
    n, *others = set(lengths.values())
    if others:
        counts = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ParameterError(f"points: the columns differ in length ({counts})")
    if not 1 <= n <= MAX_POINTS:
        raise ParameterError(f"points: {n} of them; must be 1 to {MAX_POINTS}")
    kept = np.broadcast_to(keeps_rules(held | columns), n)
    if not kept.all():
        first = int(np.argmin(kept))
        try:
            check(held | {name: values[first] for name, values in columns.items()})
        except ParameterError as error:
            raise ParameterError(f"point {first}: {error}") from None
    return Grid({"point": np.arange(n)}, held, columns)


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


def check_fits(grid: Grid, *, by_blocks: bool) -> None:
    """Refuse a grid whose results memory cannot be expected to hold.

    Parameters
    ----------
    grid : Grid
    by_blocks : bool
        Whether its cube could be written without being held in memory.

    Raises
    ------
    ParameterError
    """
    if grid.size > MAX_POINTS:
        way_out = " (an output that ends in .zarr is not held in memory)" if by_blocks else ""
        raise ParameterError(f"grid: {grid.size} points; one cube in memory may hold {MAX_POINTS}{way_out}")
