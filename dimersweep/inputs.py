"""Check single numbers, counts, switches, units and files that a user gives."""

import re
import reprlib
import tomllib
from collections import Counter
from collections.abc import Mapping, Set
from datetime import timedelta
from decimal import Decimal
from fractions import Fraction
from functools import cache
from math import isfinite, pi
from numbers import Integral, Real
from pathlib import Path
from typing import Any
from unicodedata import normalize

import numpy as np

from dimersweep.errors import ParameterError, one_line
from dimersweep.symbols import PARAMETERS

RTOL_RANGE = (1e-13, 1e-2)
MAX_SECONDS = 1e8  # longest bound on a time, some three years: timers of the system take no longer ones
MAX_COUNT = 1_000_000_000  # most forcing periods, and other counts: below 2^31, as cubes store them in 32 bits

Size = Fraction | float
# simple units by all their names: size in m, kg, s and rad, and the powers of these. A turn is no pure number here, so
# that 900 rpm are 15 Hz and not 94 Hz. Sizes are fractions, so that 4.1 mm become the same float as 0.0041 m
_NAMED: dict[str, tuple[Size, dict[str, int]]] = {
    "1 dimensionless": (Fraction(1), {}),
    "% percent": (Fraction(1, 100), {}),
    "m meter metre": (Fraction(1), {"m": 1}),
    "g gram gramme": (Fraction(1, 1000), {"kg": 1}),
    "s sec second": (Fraction(1), {"s": 1}),
    "min minute": (Fraction(60), {"s": 1}),
    "h hr hour": (Fraction(3600), {"s": 1}),
    "d day": (Fraction(86400), {"s": 1}),
    "Hz HZ hertz": (Fraction(1), {"s": -1}),
    "rad radian": (Fraction(1), {"rad": 1}),
    "° deg degree": (pi / 180, {"rad": 1}),
    "r rev turn cycle revolution": (2 * pi, {"rad": 1}),
    "rpm RPM": (pi / 30, {"rad": 1, "s": -1}),
    "gn standard_gravity": (Fraction("9.80665"), {"m": 1, "s": -2}),
}
_WORDS = {word: unit for words, unit in _NAMED.items() for word in words.split()}
_WORDS |= {f"{word}s": unit for word, unit in _WORDS.items() if len(word) > 2}
_PREFIXES = {"n nano": -9, "u μ micro": -6, "m milli": -3, "c centi": -2, "k kilo": 3, "M mega": 6}
_UNITS = {
    prefix + word: (size * Fraction(10) ** power, powers)
    for prefixes, power in _PREFIXES.items()
    for prefix in prefixes.split()
    for word, (size, powers) in _WORDS.items()
} | _WORDS  # a name without a prefix wins over one with a prefix that is spelt alike
# an example of another unit of the same kind, for messages
_SUCH_AS = {"rad": "deg", "m": "mm", "m s-1": "mm/s", "m s-2": "g", "s": "ms", "Hz": "rpm", "rad s-1": "rpm"}


def _shown(value: Any) -> str:
    """Return a user's value as text for a message, on one line and shortened if it is long or deeply nested."""
    return " ".join(reprlib.repr(value).split())


@cache
def _parsed(text: str) -> tuple[Size, Counter[str]] | None:
    """Return the size of a unit such as m s-1, m/s or µm, and its powers of m, kg, s and rad; None if it is unknown."""
    size: Size = Fraction(1)
    powers = Counter[str]()
    text = re.sub(r"[\s_]per[\s_]", "/", normalize("NFKC", text).replace("−", "-").replace("**", "^"))
    for before, part in re.findall(r"([\s/*·.]*)([^\s/*·.]+)", re.sub(r"\s*\^\s*", "^", text)):
        found = re.fullmatch(r"(1|\D+?)(?:\^?([-+]?\d))?", part)
        if found is None or found[1] not in _UNITS:
            return None
        times = int(found[2] or 1) * (-1 if "/" in before else 1)
        size *= _UNITS[found[1]][0] ** times
        powers.update({base: power * times for base, power in _UNITS[found[1]][1].items()})
    return size, Counter({base: power for base, power in powers.items() if power})


def is_unit(text: str, like: str | None = None) -> bool:
    """Return True if a text is a unit such as mm, and no number.

    With `like`, it must be of the same kind as that unit.
    """
    found = None if re.match(r"\d|$", text) else _parsed(text)
    return found is not None and (like is None or found[1] == (_parsed(like) or found)[1])


def size_of(name: str, value: Any, unit: Any, units: str | None) -> Size:
    """Return the size of `unit`, the unit of `value`, in `units`; 1 if `units` is None.

    A text "g" is the earth's gravity for an acceleration, else a gram. A rate of turning is accepted for a frequency:
    900 rpm are 15 Hz. A frequency is no rate of turning, as some people mean turns by it and some radians.

    Raise a ParameterError if the unit is of another kind.
    """
    text = str(unit)
    if units is None or text == units:
        return Fraction(1)
    if units == "m s-2" and isinstance(unit, str):
        text = re.sub("^(m?)[gG]$", r"\1gn", text)
    given, wanted = _parsed(text), _parsed(units)
    if given is not None and wanted is not None:
        size = given[0] / wanted[0]
        if given[1] == wanted[1]:
            return size
        if units == "Hz" and given[1] == {"rad": 1, "s": -1}:
            return size / (2 * pi)
    such = f"{units}, {_SUCH_AS[units]} or the like" if units in _SUCH_AS else "left out" if units == "1" else units
    carried = "" if isinstance(value, str) else f"has the unit {unit}; "
    raise ParameterError(f"{name} = {_shown(value)}: {carried}the unit must be {such}")


def in_units(numbers: Any, size: Size) -> Any:
    """Return `numbers` times `size`, the size of their unit.

    A single number becomes the float nearest to the decimal number that was meant.
    """
    if isinstance(numbers, float) and isinstance(size, Fraction) and isfinite(numbers):
        return float(Fraction(repr(float(numbers))) * size)
    numerator, denominator = size.as_integer_ratio()
    return numbers * float(numerator) / float(denominator)


def _from_carrier(name: str, value: Any, units: str | None, result: bool) -> np.ndarray:
    """Return the numbers in an array, or in a number of another library, as floats in `units`, of any shape."""
    # an array of xarray may hold one of pint
    inner = getattr(value, "data", value) if hasattr(value, "dims") else value
    bare = getattr(inner, "magnitude", value)  # pint warns if its array is read without `magnitude`
    masked = np.ma.is_masked(bare)
    if masked and not result:
        raise ParameterError(f"{name} = {_shown(value)}: has masked values; give numbers only")
    try:
        array = np.asarray(np.where(np.ma.getmaskarray(bare), np.nan, np.ma.getdata(bare)) if masked else bare)
    except Exception as error:  # another library may raise anything
        raise ParameterError(f"{name}: cannot be read as numbers ({one_line(error)})") from None
    attributes = getattr(value, "attrs", None)
    unit = attributes.get("units") if isinstance(attributes, Mapping) else None
    for each in (value, inner):
        unit = getattr(each, "units", getattr(each, "unit", None)) if unit is None else unit
    if array.dtype.kind == "m":
        array, unit = np.asarray(array / np.timedelta64(1, "s")), "s"
    unit = unit.decode() if isinstance(unit, bytes) else unit
    plain = unit is None or (isinstance(unit, str) and not unit)
    if array.dtype.kind in "OTU":
        within = units if plain else "1"
        read = [as_number(name, each, within, result=result) for each in np.atleast_1d(array).tolist()]
        array = np.array(read).reshape(array.shape)
    if array.dtype.kind not in ("iufb" if result else "iuf"):
        dates = "; of dates give the time since one of them" if array.dtype.kind == "M" else ""
        raise ParameterError(f"{name} = {_shown(value)}: must be a number{dates}")
    with np.errstate(over="ignore"):  # floats of 80 or 128 bits may be beyond the range of 64 bits: they become inf
        numbers = array.astype(float)
    return numbers if plain else np.asarray(in_units(numbers[()], size_of(name, value, unit, units)))


def as_number(name: str, value: Any, units: str | None = "1", *, result: bool = False) -> float:
    """Return `value` as a finite float in `units`.

    Parameters
    ----------
    name : str
    value : float or str
        A number in `units`, a text with its unit, such as "16 deg" or "2 mm", or an object that carries its unit: a
        number of xarray, pint or astropy, or a duration.
    units : str, optional
        Unit of the result. If None, numbers of any unit are taken without conversion.
    result : bool
        True if a user's function returned `value`: it may be missing or infinite then, a bool is 0 or 1, and a masked
        value is NaN.

    Raises
    ------
    ParameterError
        If `value` is no real number (a bool is none), is masked or not finite, or has a unit of another kind.
    """
    if isinstance(value, timedelta):
        value = f"{value.total_seconds()!r} s"
    if isinstance(value, str):
        value = _from_text(name, value, units)
    elif hasattr(value, "__array__") and getattr(value, "ndim", 0) == 0:
        value = _from_carrier(name, value, units, result).item()
    if (isinstance(value, bool) and not result) or not isinstance(value, Real | Decimal):
        raise ParameterError(f"{name} = {_shown(value)}: must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not (result or isfinite(number)):
        raise ParameterError(f"{name} = {number}: must be finite")
    return number


def number(name: str, value: Any) -> float:
    """Return the value of the parameter `name` in its SI unit; see `as_number`."""
    return as_number(name, value, PARAMETERS[name].units)


def _from_text(name: str, text: str, units: str | None) -> float:
    """Return the number that a text such as "16 deg" gives, in `units`."""
    size, unit = size_and_unit(text)
    if size is None:
        either = ', or an angle with its unit such as "16 deg"' if units == "rad" else ""
        raise ParameterError(f"{name} = {text!r}: must be a number{either}")
    if re.match(r",\d", unit):
        raise ParameterError(f"{name} = {text!r}: has a decimal comma; give {text.replace(',', '.', 1).strip()}")
    return in_units(size, size_of(name, text, unit, units)) if unit else size


def size_and_unit(text: str) -> tuple[float | None, str]:
    """Split a text such as "16 deg" into its number and its unit; the number is None if there is none."""
    found = re.fullmatch(r"\s*([-+−]?[\d.]+(?:[eE][-+]?\d+)?|[-+]?inf|nan)\s*(.*?)\s*", text)
    try:
        return (float(found[1].replace("−", "-")), found[2]) if found else (None, "")
    except ValueError:
        return None, ""


def as_numbers(name: str, values: Any, units: str | None = "1", *, result: bool = False) -> np.ndarray:
    """Return `values` as finite floats in `units`, shape (n,); see `as_number`. A single number has shape (1,)."""
    if hasattr(values, "__array__") and getattr(values, "ndim", 1) == 1:
        column = np.atleast_1d(_from_carrier(name, values, units, result))
    elif isinstance(values, list) and {*map(type, values)} == {float}:
        column = np.array(values)
    else:
        listed = np.asarray(values).tolist() if getattr(values, "ndim", 0) > 1 else values
        listed = listed if isinstance(listed, list | tuple | range) else [listed]
        column = np.array([as_number(name, each, units, result=result) for each in listed], dtype=float)
    if not (result or np.isfinite(column).all()):
        raise ParameterError(f"{name} = {column[~np.isfinite(column)][0]}: must be finite")
    return column


def pair_of(name: str, pair: Any, what: str) -> tuple[Any, Any]:
    """Return the two values in `pair`, in their order; `what` says in a message what the pair must be.

    Raises
    ------
    ParameterError
        If `pair` has no two values in order, as a text, a set or a mapping.
    """
    in_order = not isinstance(pair, str | bytes | Mapping | Set) and np.iterable(pair)
    values = tuple(pair) if in_order else ()
    if len(values) != 2:
        raise ParameterError(f"{name} = {_shown(pair)}: must be {what}")
    return values


def columns_of(table: Any) -> list[Any]:
    """Return the columns of a table of numbers, each with its unit and labels; a single column is a table, too."""
    if getattr(table, "ndim", 0) == 2:
        places = getattr(table, "iloc", table)
        return [places[:, k] for k in range(table.shape[1])]
    rows = isinstance(table, list | tuple) and len(table) and isinstance(table[0], list | tuple | np.ndarray)
    return list(zip(*table, strict=True)) if rows else [table]


def check_labels(columns: Mapping[str, Any]) -> None:
    """Raise a ParameterError if columns that belong together have different labels of pandas or xarray."""
    known: dict[str, Any] = {}
    for name, values in columns.items():
        labels = getattr(values, "index", None)
        if hasattr(values, "indexes"):  # an array of xarray
            labels = values.indexes.get(*values.dims[:1])
        elif hasattr(values, "get_indexer"):  # an index of pandas is labelled by itself
            labels = values
        if hasattr(labels, "equals"):
            known[name] = labels
    for name, labels in known.items():
        first = next(iter(known))
        if not labels.equals(known[first]):
            raise ParameterError(f"{name}: has other labels than {first}; align them, or give both without")


def check_rtol(rtol: Any) -> float:
    """Return the accuracy `rtol` [1] as a float.

    Raises
    ------
    ParameterError
        If it is outside 1e-13 to 1e-2.
    """
    number = as_number("rtol", rtol)
    if not RTOL_RANGE[0] <= number <= RTOL_RANGE[1]:
        raise ParameterError(f"rtol = {number}: must be in [{RTOL_RANGE[0]}, {RTOL_RANGE[1]}]")
    return number


def check_count(name: str, value: Any, most: int = MAX_COUNT) -> int:
    """Return `value`, a number of periods or workers, for example, as an int from 1 to `most`.

    Raises
    ------
    ParameterError
        If it is no whole number, or outside that range.
    """
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, Integral) or value < 1:
        raise ParameterError(f"{name} = {_shown(value)}: must be a whole number >= 1")
    if int(value) > most:
        raise ParameterError(f"{name} = {value!r}: must be <= {most}")
    return int(value)


def check_switch(name: str, value: Any) -> bool:
    """Return `value` as a bool.

    Raises
    ------
    ParameterError
        If it is neither true nor false: a word such as "no" would count as true.
    """
    if value is True or value is False or type(value).__name__ == "bool":  # the last is the type of numpy
        return bool(value)
    raise ParameterError(f"{name} = {_shown(value)}: must be True or False")


def check_seconds(given: Any, name: str = "max_seconds") -> float | None:
    """Return a bound on a time [s] as a float above 0 and at most `MAX_SECONDS`; None, for no bound, stays None.

    Raises
    ------
    ParameterError
        If it is no number, or not above 0.
    """
    if given is None:
        return None
    number = as_number(name, given, "s")
    if number <= 0:
        raise ParameterError(f"{name} = {number}: must be > 0")
    return min(number, MAX_SECONDS)


def read_text(path: Path) -> str:
    """Return the text in a user's file, without the byte order mark that some editors write at its start.

    Raises
    ------
    ParameterError
        If the file cannot be read, or is no text in UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path}: is no text in UTF-8 ({error})") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises
    ------
    ParameterError
        If the file cannot be read, or is no valid TOML.
    """
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ParameterError(f"{path}: is nested too deeply") from None
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"{path}: is no valid TOML ({error})") from None
