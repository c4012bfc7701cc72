"""Numbers, counts and switches that a user gives, checked one at a time."""

import re
import reprlib
import tomllib
from collections.abc import Callable, Mapping
from math import isfinite, pi
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

from dimersweep.errors import ParameterError, one_line
from dimersweep.symbols import PARAMETERS

RTOL_RANGE = (1e-13, 1e-2)
DEGREES = ("deg", "degree", "degrees", "°")
# units that a text may give a value in, and their size in the SI unit
OTHER_UNITS = {
    "rad": dict.fromkeys(DEGREES, pi / 180),
    "m": {"mm": 1e-3},
    "m s-1": {"mm/s": 1e-3, "m/s": 1.0},
}
MAX_SECONDS = 1e8  # a bound on time: the system takes no longer ones
MAX_COUNT = 1_000_000_000  # forcing periods and other counts: the cube keeps them in 32 bits


def _shown(value: Any) -> str:
    """A value that a user gave, in a line, however long or deeply nested it is."""
    return " ".join(reprlib.repr(value).split())


def _unit_of(value: Any) -> Any:
    """The unit that a value of another library carries: xarray's and pandas' in their attributes, None if there is none."""
    attributes = getattr(value, "attrs", None)
    if isinstance(attributes, Mapping):
        return attributes.get("units", _unit_of(getattr(value, "data", None)))
    return getattr(value, "units", getattr(value, "unit", None))


def _check_carried(name: str, value: Any, units: str | None) -> None:
    """Refuse what a number or an array carries besides numbers: another unit, masked entries, dates, bools.

    Raises
    ------
    ParameterError
    """
    unit = _unit_of(value)
    if unit is not None and not (isinstance(unit, str) and (units is None or unit in ("", units))):
        wanted = "" if units is None else " without a unit" if units == "1" else f" in {units}"
        raise ParameterError(f"{name} = {_shown(value)}: has the unit {unit}; give plain numbers{wanted}")
    if np.ma.is_masked(value):
        raise ParameterError(f"{name} = {_shown(value)}: has masked values; give numbers only")
    if getattr(getattr(value, "dtype", None), "kind", "O") not in "iufOTU":
        raise ParameterError(f"{name} = {_shown(value)}: must be a number")


def as_number(name: str, value: Any, units: str | None = None) -> float:
    """`value` as a finite float.

    Parameters
    ----------
    name : str
    value : float
    units : str, optional
        The unit that a value may carry as an attribute; any, if it is not given.

    Raises
    ------
    ParameterError
        If it is no real number (a bool or a string is none), masked, of another unit or not finite.
    """
    _check_carried(name, value, units)
    if getattr(value, "ndim", None) == 0:  # a numpy scalar or a single value picked from a dataset
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ParameterError(f"{name} = {_shown(value)}: must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not isfinite(number):
        raise ParameterError(f"{name} = {number}: must be finite")
    return number


def number(name: str, value: Any, units: str | None = None) -> float:
    """The value of the parameter `name` in its SI unit, as a finite float.

    Parameters
    ----------
    name : str
    value : float or str
        A number in the SI unit, or a text with a unit after it, as "16 deg" or "2 mm".
    units : str, optional
        The SI unit of a quantity that is no parameter.

    Raises
    ------
    ParameterError
        If it is no number, or the unit is another one.
    """
    units = PARAMETERS[name].units if units is None else units
    if not isinstance(value, str):
        return as_number(name, value, units)
    factors = {"": 1.0, units: 1.0} | OTHER_UNITS.get(units, {})
    size, unit = _size_and_unit(value)
    if size is None:
        either = ', or an angle with its unit such as "16 deg"' if units == "rad" else ""
        raise ParameterError(f"{name} = {value!r}: must be a number{either}")
    if re.match(r",\d", unit):
        raise ParameterError(f"{name} = {value!r}: has a decimal comma; give {value.replace(',', '.', 1).strip()}")
    if unit not in factors:
        raise ParameterError(
            f"{name} = {value!r}: the unit must be {'left out' if units == '1' else units_taken(units)}"
        )
    return as_number(name, size * factors[unit])


def _size_and_unit(text: str) -> tuple[float | None, str]:
    """The number in a text such as "16 deg", and the unit after it."""
    found = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?|[-+]?inf|nan)\s*(.*?)\s*", text)
    try:
        return (float(found[1]), found[2]) if found else (None, "")
    except ValueError:
        return None, ""


def degrees_in(value: Any) -> float | None:
    """The degrees that a text such as "16 deg" tells, or 0; None of anything else."""
    if isinstance(value, int | float) and not isinstance(value, bool) and value == 0:
        return 0.0
    size, unit = _size_and_unit(value) if isinstance(value, str) else (None, "")
    return size if unit in DEGREES else None


def units_taken(units: str) -> str:
    """The units that a value of a quantity may be given in, in words: its own, and another one."""
    return " or ".join([units, *list(OTHER_UNITS.get(units, {}))[:1]])


def as_numbers(name: str, values: Any, read: Callable[[str, Any], float], units: str | None = None) -> np.ndarray:
    """`values` as finite floats, shape (n,); a lone number is one value.

    Parameters
    ----------
    name : str
    values : array_like
    read : callable
        Reads each value that is not in an array of numbers: `as_number` or `number`.
    units : str, optional
        See `as_number`.

    Raises
    ------
    ParameterError
    """
    if hasattr(values, "__array__"):
        _check_carried(name, values, units)
        try:
            values = np.asarray(values)
        except Exception as error:  # whatever another library says
            raise ParameterError(f"{name}: cannot be read as numbers ({one_line(error)})") from None
        values = values if values.dtype.kind in "iuf" and values.ndim == 1 else values.tolist()
    if isinstance(values, np.ndarray) or (isinstance(values, list) and {*map(type, values)} == {float}):
        with np.errstate(over="ignore"):  # of longer floats
            column = np.array(values, dtype=float)
        if not np.isfinite(column).all():
            raise ParameterError(f"{name} = {column[~np.isfinite(column)][0]}: must be finite")
        return column
    values = values if isinstance(values, list | tuple | range) else [values]
    return np.array([read(name, value) for value in values], dtype=float)


def check_rtol(rtol: Any) -> float:
    """The accuracy `rtol` [1] as a float.

    Raises
    ------
    ParameterError
        Outside 1e-13 to 1e-2.
    """
    number = as_number("rtol", rtol)
    if not RTOL_RANGE[0] <= number <= RTOL_RANGE[1]:
        raise ParameterError(f"rtol = {number}: must be in [{RTOL_RANGE[0]}, {RTOL_RANGE[1]}]")
    return number


def check_count(name: str, value: Any, most: int = MAX_COUNT) -> int:
    """`value` as an int of at least 1 and at most `most`, for a number of periods or of workers.

    Raises
    ------
    ParameterError
        If it is no whole number, or out of that range.
    """
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, Integral) or value < 1:
        raise ParameterError(f"{name} = {_shown(value)}: must be a whole number >= 1")
    if int(value) > most:
        raise ParameterError(f"{name} = {value!r}: must be <= {most}")
    return int(value)


def check_switch(name: str, value: Any) -> bool:
    """`value` as a bool.

    Raises
    ------
    ParameterError
        If it is neither true nor false: a word such as "no" would count as true.
    """
    if value is True or value is False or type(value).__name__ == "bool":  # that of numpy, too
        return bool(value)
    raise ParameterError(f"{name} = {_shown(value)}: must be True or False")


def check_seconds(max_seconds: Any) -> float | None:
    """A bound on the time of a run [s] as a float above 0, or None for none.

    Raises
    ------
    ParameterError
        If it is no number, or not above 0.
    """
    if max_seconds is None:
        return None
    number = as_number("max_seconds", max_seconds)
    if number <= 0:
        raise ParameterError(f"max_seconds = {number}: must be > 0")
    return min(number, MAX_SECONDS)


def read_text(path: Path) -> str:
    """What is written in a file of a user's, without the mark that some editors begin it with.

    Raises
    ------
    ParameterError
        If it cannot be read, or is no text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path}: is no text in UTF-8 ({error})") from None


def read_toml(path: Path) -> dict[str, Any]:
    """What a file of TOML says.

    Raises
    ------
    ParameterError
        If it cannot be read, or is no TOML.
    """
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ParameterError(f"{path}: is nested too deeply") from None
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"{path}: is no valid TOML ({error})") from None
