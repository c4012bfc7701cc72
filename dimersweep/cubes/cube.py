"""Build labelled cubes from the results of points: an xarray.Dataset over the axes of the grid, ready for CF NetCDF."""

import json
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar
from zlib import crc32

import numpy as np
import xarray as xr

from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.cubes.results import POINT_STATUSES, Field, blank_results
from dimersweep.errors import ParameterError, StoreError
from dimersweep.faces import __version__
from dimersweep.kernel.model.layout import CODE_WORDS, CODES, MODES, N_CODES, N_OUT, OUT, ROW
from dimersweep.parameters import completed
from dimersweep.symbols import PARAMETERS, QUANTITIES, SETTINGS, Quantity

NO_YES = ("no", "yes")  # words for False and True
FLAGS = {
    **CODE_WORDS,
    "status": POINT_STATUSES,
    "outcome": MODES,
    "answer": ("not_run", "no", "yes", "unsure"),
    "region": (*MODES, "mixed"),
    "computed": NO_YES,
    "confidence": ("not_run", "certain", "unsure", "changed"),
    "direction": DIRECTIONS,
}
EMPTY = {"U": "", "b": False, "i": 0}  # value of a column where there is no row, by the kind of its numbers; else NaN
# CF attributes of every file
CONVENTIONS, SOURCE = "CF-1.11", f"dimersweep {__version__}, event-driven simulation"
# attribute `history` of tables: without a time, so that the same call gives the same table
HISTORY = f"made by dimersweep {__version__}"
OF_A_RUN = "of a run of a 3D dimer on a vibrating plate"  # end of the titles of tables
# numbers of texts are below this (`number_of`): 31 bits fit the signed 32-bit integers of classic files
WRAP = 1 << 31
_SUMMED = {"fletcher32": True}  # a checksum that the NetCDF library itself tests, in any program that reads the file
# level 4 is the default of the NetCDF library for Python
PACKED = {"zlib": True, "complevel": 4, "shuffle": True, **_SUMMED}


def blank(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return results of `n` points that have not run.

    Returns
    -------
    out : ndarray, shape (n, N_OUT), float64
        NaN, in the order of ``kernel.layout.OUT``.
    codes : ndarray, shape (n, N_CODES), int64
        0, which is ``not_run`` and ``none``, in the order of ``kernel.layout.CODES``.
    """
    return np.full((n, N_OUT), np.nan), np.zeros((n, N_CODES), dtype=np.int64)


def coordinate(name: str, values: Any, quantity: Quantity) -> xr.Variable:
    """Return the values along the axis `name` as a coordinate with its unit."""
    return labelled(xr.Variable((name,), values), quantity)


def labelled(values: xr.Variable, quantity: Quantity) -> xr.Variable:
    """Return values of a coordinate with their unit."""
    variable = column(values.dims, values.values, quantity)
    variable.encoding.update(_SUMMED if values.dims else {}, _FillValue=None)  # CF: a coordinate has no missing values
    return variable


def variable(name: str, dims: tuple[str, ...], values: np.ndarray, quantity: Quantity | None = None) -> xr.Variable:
    """Return results as a variable with its unit, see `column`, to be compressed in files.

    The unit and the long name are those of `QUANTITIES`, unless a `quantity` is passed. In files, NaN marks floats that
    are missing; integers have no such mark.
    """
    made = column(dims, values, quantity or QUANTITIES[name], FLAGS.get(name, ()))
    # with a fill value, xarray would read integers back as floats
    made.encoding.update(PACKED, _FillValue=np.nan if made.dtype.kind == "f" else None)
    return made


def column(dims: Any, entries: Any, said: Quantity | str, words: Sequence[str] = ()) -> xr.Variable:
    """Return a column of a table: numbers with their unit, texts, or flags as int8 with their `words`.

    Entries of flags are words or codes. Where several codes share a word, all of them become the first, so that each
    word has one code. Truth values without `words` are flags, too, and stay of type bool: xarray writes and reads them.
    Whole numbers have 32 bits where these hold them, as programs that know classic files alone read no others.
    """
    values, quantity = np.asarray(entries), said if isinstance(said, Quantity) else Quantity("1", said)
    kind = values.dtype.kind
    if words or kind == "b":
        if kind in "OU":
            values = np.vectorize(words.index, otypes=[np.int8])(values)
        coded, words = values.astype(np.int8, copy=False) if words else values, words or NO_YES
        firsts = np.array([words.index(word) for word in words], dtype=np.int8)
        if len(distinct := dict(zip(words, firsts, strict=True))) < len(words):
            coded = firsts[coded]
        flags = {"flag_values": np.array([*distinct.values()]), "flag_meanings": " ".join(distinct)}
        return xr.Variable(dims, coded, {"long_name": quantity.long_name} | flags)
    if kind in "OSU":
        texts = np.char.decode(values, "utf-8") if kind == "S" else values
        # arrays of characters: classic files and many programs have no strings of any length
        return xr.Variable(dims, texts, {"long_name": quantity.long_name}, {"dtype": "S1"})
    number = float if kind == "f" else kind_of_whole(values)
    return xr.Variable(dims, values.astype(number, copy=False), quantity.attributes(number))


class Column(NamedTuple):
    """Column of a table, see `table`."""

    name: str
    quantity: Quantity | str  # unit and meaning; a text is the meaning of a number without unit
    of: Any  # function that reads the value of a row, or the values of all rows
    words: Sequence[str] = ()  # words of a flag
    along: str = ""  # dimension of the values of one row, where a row has several


def table(rows: Collection[Any], columns: Iterable[Column], dims: str | tuple[str, ...]) -> xr.Dataset:
    """Return the table of `rows`, with one variable for each of `columns`, see `column`; of two of one name the last.

    Columns that are given as values need no rows, and may lie along several `dims`.
    """
    over, made = (dims,) if isinstance(dims, str) else dims, {}
    for name, quantity, of, words, along in columns:
        values = [of(row) for row in rows] if callable(of) else of
        made[name] = column((*over, along) if along else over, values, quantity, words)
    return xr.Dataset(made)


def over_grid(
    rows: xr.Dataset, places: Sequence[Sequence[int]], dims: tuple[str, ...], shape: tuple[int, ...]
) -> dict[Hashable, xr.Variable]:
    """Return the columns of a table over a grid, with its rows at `places`; elsewhere are the values of `EMPTY`.

    The rows lie along the first dimension of each column.
    """
    at, made = tuple(np.array(places).T), {}
    for name, each in rows.data_vars.items():
        values = np.full(shape + each.shape[1:], EMPTY.get(each.dtype.kind, np.nan), dtype=each.dtype)
        values[at] = each.values
        made[name] = xr.Variable((*dims, *each.dims[1:]), values, each.attrs, each.encoding)
    return made


def kind_of_whole(numbers: np.ndarray) -> type[np.signedinteger[Any]]:
    """Return the type for whole numbers in files: 32 bits, or 64 if one of the numbers does not fit in 32."""
    return np.int32 if np.array_equal(numbers, numbers.astype(np.int32)) else np.int64


def fixed_coordinates(parameters: Mapping[str, float]) -> dict[str, xr.Variable]:
    """Return parameters that hold for a whole table as scalar coordinates with their units."""
    return {name: labelled(xr.Variable((), value), PARAMETERS[name]) for name, value in parameters.items()}


def finished(table: xr.Dataset, title: str) -> xr.Dataset:
    """Return a table with its title, source and history as attributes; attributes that it has already stay.

    Its coordinates are written without a fill value, which CF forbids.
    """
    for name in table.coords:
        table[name].encoding["_FillValue"] = None
    attributes = {"Conventions": CONVENTIONS, "title": title, "source": SOURCE, "history": HISTORY}
    return table.assign_attrs(attributes | table.attrs)


def build(grid: Grid, out: np.ndarray, codes: np.ndarray, attributes: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Build the cube of a swept grid from the results of its points.

    Parameters
    ----------
    grid : Grid
        Its axes are the dimensions, in that order; its fixed parameters become scalar coordinates.
    out : ndarray, shape (grid.size, N_OUT), float64
        Float results of each point; NaN where they have no meaning.
    codes : ndarray, shape (grid.size, N_CODES), int64
        Integer results of each point.
    attributes : mapping, optional
        Global attributes.

    Returns
    -------
    xarray.Dataset
        `mode`, `status`, `di_end` (int8 with flag meanings), counts (int32) and the float quantities, each with units.
    """
    dims = tuple(grid.axes)
    columns = dict(zip((*CODES, *OUT), (*codes.T, *out.T), strict=True))
    variables = {
        name: variable(name, dims, columns[name].reshape(grid.shape)) for name in dict.fromkeys(("mode", *columns))
    }
    return xr.Dataset(variables, coordinates_of(grid), attributes)


def with_fields(cube: xr.Dataset, results: np.ndarray, fields: Iterable[Field]) -> xr.Dataset:
    """Return `cube` with one more variable for each of `fields`, from `results` of shape (n,).

    `cube` itself may be modified. A variable that says more about another one is listed among its
    `ancillary_variables`.
    """
    shape, dims = cube["mode"].shape, tuple(map(str, cube["mode"].dims))
    for name, quantity, _, along, about in fields:
        over = dims if along is None else (*dims, along.name)
        values = results[name].reshape(*shape, *results.dtype[name].shape)
        cube[name] = variable(name, over, values, quantity)
        if along is not None:
            cube = cube.assign_coords({along.name: coordinate(*along)})
        if about:
            known = cube[about].attrs.get("ancillary_variables", "")
            cube[about].attrs["ancillary_variables"] = f"{known} {name}".strip()
    return cube


def results_in(cube: xr.Dataset, kind: np.dtype, fields: Iterable[Field]) -> np.ndarray:
    """Return the results that `build` and `with_fields` made `cube` from, shape (n,).

    Fields of `kind` that are not in `fields` are blank.
    """
    results = blank_results(cube["mode"].size, kind)
    results["out"], results["codes"] = flatten(cube)
    for field in fields:
        values = cube[field.name].values.reshape(results[field.name].shape)
        results[field.name] = np.char.encode(values.astype(str), "utf-8") if values.dtype.kind in "OU" else values
    return results


def coordinates_of(grid: Grid) -> dict[str, xr.Variable]:
    """Return the coordinates of a cube: its axes or columns of points, and all other parameters beside them."""
    quantities = PARAMETERS | {"point": Quantity("1", "number of the point")}
    values = {name: xr.Variable((name,), axis) for name, axis in grid.axes.items() if name != "direction"}
    values |= {name: xr.Variable(("point",), column) for name, column in grid.columns.items()}
    values |= {name: xr.Variable((), value) for name, value in grid.fixed.items()}
    coordinates = {name: labelled(xr.as_variable(each), quantities[name]) for name, each in completed(values).items()}
    if "direction" in grid.axes:
        coordinates["direction"] = variable("direction", ("direction",), grid.axes["direction"])
    return coordinates


def settings_in(configuration: Mapping[str, Any]) -> dict[str, float]:
    """Return the settings of the runs of a cube from its configuration, by the names of `SETTINGS`.

    Where a search makes its deciding runs once more, with `orbit_periods`, the settings are those of these second runs.

    Raises
    ------
    KeyError
        If the configuration lacks a setting.
    """
    late = configuration.get("search", {}).get("orbit_periods", 0)
    first = late or configuration["periods"]
    settings = {
        "periods": first,
        "max_periods": late or configuration.get("max_periods", first),
        "rtol": configuration["rtol"],
        "stop_when_settled": int(configuration.get("stop_when_settled", True) and not late),
        "kernel": number_of(configuration["kernel_version"]),
    }
    return settings | ({"line": line_number(configuration)} if "direction" in configuration.get("grid", {}) else {})


def number_of(text: str) -> int:
    """Return a checksum of a text as a whole number of 31 bits.

    An integer of a classic file holds it, and so does a float of 64 bits.
    """
    return crc32(text.encode()) % WRAP


def same_number(one: float, other: float) -> bool:
    """Return True if two numbers can be those of one text (`number_of`).

    Former cubes have 32 bits of the number. A classic copy of them wraps it round, so that 31 bits are compared.
    """
    return one % WRAP == other % WRAP


def line_number(configuration: Mapping[str, Any]) -> int:
    """Return the number of the line along which a state was carried (`number_of`).

    It is computed from the last axis, its values, and the names of all other parameters that were given.
    """
    *others, (axis, values) = configuration["grid"].items()
    return number_of(json.dumps([axis, values, *sorted({*dict(others), *configuration["fixed"]})]))


def signed(cube: xr.Dataset, configuration: Mapping[str, Any]) -> xr.Dataset:
    """Return a cube with the settings of its runs at each point, so that a point can be run again wherever it goes.

    Settings are coordinates, as parameters are. Where cubes are put together, xarray may keep the settings of the first
    for all. The variable `made_with` lies along the axes, so that each point keeps its own number.
    """
    settings = {name: xr.Variable((), value) for name, value in settings_in(configuration).items()}
    cube = cube.assign_coords({name: labelled(each, SETTINGS[name]) for name, each in settings.items()})
    varied = [name for name in (*ROW, *SETTINGS) if name in cube.variables and cube.variables[name].ndim]
    number = np.full(cube["mode"].shape, settings_number(cube, varied))
    cube["made_with"] = variable("made_with", tuple(map(str, cube["mode"].dims)), number)
    cube["made_with"].attrs["varied"] = " ".join(varied)
    return cube


def settings_number(point: xr.Dataset, varied: Collection[str]) -> int:
    """Return the number of the parameters and settings of a point, but for the kernel and those in `varied`."""
    names = [name for name in (*ROW, *SETTINGS) if name in point.variables and name not in (*varied, "kernel")]
    values = [(name, float(point.variables[name].values.item())) for name in names]
    return number_of(json.dumps(values))


def flatten(cube: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the results that `build` made `cube` from.

    Returns
    -------
    out : ndarray, shape (n, N_OUT), float64
    codes : ndarray, shape (n, N_CODES), int64
    """
    out, codes = (np.column_stack([cube[name].values.ravel() for name in names]) for names in (OUT, CODES))
    return out.astype(float, copy=False), codes.astype(np.int64, copy=False)


def check_codes(flags: xr.DataArray) -> None:
    """Refuse a flag variable whose codes are floats, as `where` makes them; its values are not read.

    Raises
    ------
    StoreError
    """
    if flags.dtype.kind not in "iu":
        cure = "give the cube as it was opened, or a part of it by sel or isel"
        raise StoreError(
            f"{flags.name}: is of type {flags.dtype}, as where() makes it, and codes are whole numbers; {cure}"
        )


def check_flags(name: Any, values: np.ndarray, codes: Any = None) -> None:
    """Refuse values of a flag variable that are no codes of its words.

    `codes` are the allowed ones, by default those of `FLAGS`.

    Raises
    ------
    StoreError
        Naming the first such value.
    """
    wrong = ~np.isin(values, range(len(FLAGS[name])) if codes is None else codes)
    if wrong.any():
        raise StoreError(f"{name} = {values[wrong][0]}: is the code of no {name}; the cube was changed")


Flagged = TypeVar("Flagged", xr.DataArray, xr.Dataset)


def names(flags: Flagged) -> Flagged:
    """Return the words of a flag variable, such as "drift" for each point of ``cube["mode"]``.

    Of a dataset, return it with words in place of the codes of all its flags.

    Parameters
    ----------
    flags : xarray.DataArray of int or bool, or xarray.Dataset
        With the CF attributes `flag_values` and `flag_meanings`, in a dataset at each of its flags.

    Returns
    -------
    xarray.DataArray of str, or xarray.Dataset
        Same dimensions and coordinates. Other variables of a dataset are unchanged, truth values, too.

    Raises
    ------
    ParameterError
        If it is no flag variable.
    StoreError
        If a number is the code of no word.

    Examples
    --------
    >>> from dimersweep import names, sweep
    >>> cube = sweep({"Gamma": [0.6, 0.9]}, periods=60, progress=False)
    >>> names(cube["mode"]).values.tolist()
    ['rest', 'drift']
    """
    if isinstance(flags, xr.Dataset):
        coded = {name: each for name, each in flags.variables.items() if "flag_meanings" in each.attrs}
        return flags.assign({name: names(flags[name]).variable for name in coded if coded[name].dtype != bool})
    if not isinstance(flags, xr.DataArray) or "flag_meanings" not in flags.attrs:
        given = getattr(flags, "name", None) or type(flags).__name__
        raise ParameterError(f"names: {given} has no words; give a flag variable such as cube['mode']")
    codes, words = flags.attrs["flag_values"], np.array(flags.attrs["flag_meanings"].split())
    check_flags(flags.name, flags.values, codes)
    return without_attrs(flags.copy(deep=False, data=words[np.searchsorted(codes, flags.values)]))


def without_attrs(array: xr.DataArray) -> xr.DataArray:
    """Return a shallow copy of an array in which it and its coordinates have no attributes."""
    bare: xr.DataArray = array.copy(deep=False)
    for each in (bare, *bare.coords.values()):  # `drop_attrs` takes 60 times as long, a tenth of a second
        each.attrs = {}
    return bare
