"""Lay out the points of grids. A grid is stored as its axes; any range of its points is computed when needed."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from decimal import Context, Decimal, localcontext
from fractions import Fraction
from functools import partial
from itertools import accumulate, pairwise, repeat
from math import isfinite, lcm, prod
from operator import mul
from typing import Any

import numpy as np

from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, as_numbers, check_count, check_labels, in_units, number, size_and_unit, size_of
from dimersweep.parameters import check, check_effect, check_name, fill_rows, keeps_rules, reduced, spelt_out
from dimersweep.symbols import BASE, ENDS, PARAMETERS, START

# most values of an axis, and most points of a cube in memory: about 14 GB, see benchmarks/speed/memory.py
MAX_POINTS = 50_000_000

# digits of values in a fixed ratio: each is rounded MAX_POINTS times at most, which leaves more digits than a float has
RATIO_DIGITS = 40
EXACT = 1 << 53  # up to this size every whole number is a float
# relative difference of a number of steps from a whole one: far above round-off, and 1/20 of a step at MAX_POINTS
STEP_TOLERANCE = 1e-9
DIRECTIONS = ("up", "down")  # directions in which a state is carried along an axis; their places are the codes
_FORMS = "give values, or start, stop and either step or num; unit is optional, and spacing = log with num"
Reader = Callable[[str, Any], float]


def evenly(start: float, stop: float, count: int) -> np.ndarray:
    """Return `count` values from `start` to `stop` at equal distances.

    Each is the float nearest to the decimal number meant: 0.1, 0.2 and 0.3 are the floats that one would write. Both
    ends are exact.
    """
    first, last = Fraction(repr(float(start))), Fraction(repr(float(stop)))
    step = (last - first) / max(1, count - 1)
    parts = lcm(first.denominator, step.denominator)
    least, each = int(first * parts), int(step * parts)  # in units of 1/parts
    # floats hold these whole numbers exactly, so that the division rounds each value once, to the nearest float
    if max(parts, abs(least), abs(least + each * (count - 1))) <= EXACT:
        return (least + each * np.arange(count)) / parts
    # Python divides whole numbers of any size with one rounding
    return np.array([(least + each * k) / parts for k in range(count)])


def _from_range(
    name: str, read: Reader, spacing: str, *, start: Any, stop: Any, step: Any = None, num: Any = None
) -> np.ndarray:
    """Return values from `start` to `stop`: `num` of them, or in steps that must reach the stop up to round-off."""
    start, stop = read(f"{name}.start", start), read(f"{name}.stop", stop)
    if spacing == "log" and not 0 < start < stop:
        raise ParameterError(f"{name}.start = {start}: must be > 0 and < stop = {stop}, for logarithmic spacing")
    if stop < start:
        raise ParameterError(f"{name}.stop = {stop}: must be >= start = {start}")
    if spacing == "log":
        return _in_ratio(start, stop, check_count(f"{name}.num", num, MAX_POINTS))
    if not isfinite(stop - start):
        raise ParameterError(f"{name}.stop = {stop}: is too far from start = {start}")
    if num is not None:
        return evenly(start, stop, check_count(f"{name}.num", num, MAX_POINTS))
    stride = read(f"{name}.step", step)
    if stride <= 0:
        raise ParameterError(f"{name}.step = {stride}: must be > 0")
    steps = (stop - start) / stride
    if steps >= MAX_POINTS:
        raise ParameterError(f"{name}.step = {stride}: gives more than {MAX_POINTS} values")
    if abs(steps - round(steps)) > STEP_TOLERANCE * max(1.0, steps):
        near = [n for n in (int(steps), int(steps) + 1) if n]
        stops = " or ".join(f"{start + n * stride:.15g}" for n in near)
        raise ParameterError(
            f"{name}.step = {stride}: no whole steps from start = {start} to stop = {stop}; "
            f"give stop = {stops}, or num = {' or '.join(f'{n + 1}' for n in near)} in place of step"
        )
    return evenly(start, stop, round(steps) + 1)


def _in_ratio(low: float, high: float, count: int) -> np.ndarray:
    """Return `count` values from `low` to `high` in a fixed ratio, each the nearest float.

    They are computed in decimal numbers: the powers of numpy depend on the processor.
    """
    with localcontext(Context(prec=RATIO_DIGITS)):
        first, last = Decimal(repr(low)), Decimal(repr(high))
        ratio = (last / first) ** (Decimal(1) / max(1, count - 1))
        values = np.fromiter(accumulate(repeat(ratio, count - 1), mul, initial=first), float, count)
    values[-1], values[0] = high, low
    return values


def _from_declaration(name: str, declared: Mapping[str, Any]) -> np.ndarray:
    """Return the values in SI units that an axis declares by ``values`` or by a range, see `axis_values`.

    Where start, stop and step share one unit and no ``unit`` is given, the range is laid out in this unit.
    """
    given = dict(declared)
    units = PARAMETERS[name].units
    spacing = given.pop("spacing", "linear")
    ends = {each: given.get(each) for each in ("start", "stop", "step")}
    sizes = {each: size_and_unit(str(end)) for each, end in ends.items() if isinstance(end, str | int | float)}
    own = {unit for number, unit in sizes.values() if number != 0}
    # all numbers have one and the same unit: steps are even in this unit, and exact in its decimals
    if "unit" not in given and len(own - {""}) == len(own) == 1:
        given |= {each: number for each, (number, _) in sizes.items()} | {"unit": own.pop()}
    unit = given.pop("unit", units)
    size = size_of(f"{name}.unit", unit, unit, units)
    read: Reader = partial(as_number, units=unit)
    if spacing not in ("linear", "log"):
        raise ParameterError(f"{name}.spacing = {spacing!r}: must be linear or log")
    if set(given) == {"values"} and spacing == "linear":
        values = as_numbers(name, given["values"], unit)
    elif set(given) == {"start", "stop", "num"} or (set(given) == {"start", "stop", "step"} and spacing == "linear"):
        values = _from_range(name, read, spacing, **given)
    else:
        raise ParameterError(f"{name}: has {', '.join(given) or 'nothing'}; {_FORMS}")
    return in_units(values, size)


def fixed_value(name: str, value: Any) -> float:
    """Return a fixed value in its SI unit.

    It is given as a number, as a text with its unit, or as a mapping with a `value` and a `unit`.

    Raises
    ------
    ParameterError
        If the name is unknown, or `value` is none of these.
    """
    check_name(name)
    if isinstance(value, Mapping):
        if set(value) != {"value", "unit"}:
            raise ParameterError(f"{name}: has {', '.join(value) or 'nothing'}; give value and unit")
        value = f"{as_number(name, value['value'], value['unit'])!r} {value['unit']}"
    return number(name, value)


def axis_values(name: str, declared: Any) -> np.ndarray:
    """Return the values of one axis of a grid, checked.

    Parameters
    ----------
    name : str
        A parameter of the model.
    declared : array_like or mapping
        Values, or ``{"values": ...}``, ``{"start", "stop", "step"}`` or ``{"start", "stop", "num"}``, each with an
        optional ``"unit"`` ("deg" for an angle). The stop of a range belongs to it; whole steps must reach it. With
        ``"spacing": "log"`` the `num` values are in a fixed ratio. A value may be a text with its unit, such as "16
        deg".

    Returns
    -------
    ndarray, shape (n,), float64
        SI units, strictly increasing.

    Raises
    ------
    ParameterError
        If the name is unknown, or the axis empty, not finite or not strictly increasing.
    """
    check_name(name)
    values = (
        _from_declaration(name, declared)
        if isinstance(declared, Mapping)
        else as_numbers(name, declared, PARAMETERS[name].units)
    )
    if values.size == 0:
        raise ParameterError(f"{name}: the axis is empty; give at least one value")
    falls = np.flatnonzero(np.diff(values) <= 0)
    if falls.size:
        before, after = values[falls[0]], values[falls[0] + 1]
        raise ParameterError(f"{name} = {after} after {before}: the values of an axis must increase, each given once")
    return values


def finer(values: np.ndarray, halvings: int) -> np.ndarray:
    """Return `values` with each interval halved `halvings` times; the given values stay bit for bit."""
    ends = pairwise(values.tolist())
    return np.concatenate([*(evenly(*pair, (1 << halvings) + 1)[:-1] for pair in ends), values[-1:]])


@dataclass(frozen=True)
class Grid:
    """Outer product of named axes with all other parameters fixed; points are numbered in C order.

    Single points are a grid, too: its one axis is `point`, and `columns` has the parameters that vary.

    Parameters
    ----------
    axes : dict of str to ndarray
        Values of each axis, shape (n_k,), SI units, in the order of the cube's dimensions.
    fixed : dict of str to float
        The other parameters, SI units.
    columns : dict of str to ndarray
        For single points: values of the parameters that vary, shape (n,), SI units. Else empty.
    """

    axes: dict[str, np.ndarray]
    fixed: dict[str, float]
    columns: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(values.size for values in self.axes.values())

    @property
    def size(self) -> int:
        """Number of points."""
        return prod(self.shape)

    def rows_at(self, points: np.ndarray) -> np.ndarray:
        """Return the kernel rows of `points`, shape (n, N_ROW), float64, from their numbers in C order, shape (n,)."""
        return fill_rows(self.fixed | self.values(points), points.size)

    def values(self, points: Any) -> dict[str, np.ndarray]:
        """Return the values of what varies at `points`, numbers in C order; each array has the shape of `points`."""
        if self.columns:
            return {name: values[points] for name, values in self.columns.items()}
        places = np.unravel_index(points, self.shape)
        return {name: values[k] for (name, values), k in zip(self.axes.items(), places, strict=True)}

    def given(self, number: int) -> dict[str, float]:
        """Return the parameters that are given at the point `number`, varied and fixed, without `direction`."""
        varied = {name: float(value) for name, value in self.values(number).items() if name != "direction"}
        return self.fixed | varied

    def point(self, number: int) -> str:
        """Return the point `number` in words, such as ``point 7 (Gamma = 0.9, beta0 = 0.2)``."""
        values = self.values(number).items()
        given = (f"{name} = {DIRECTIONS[k] if name == 'direction' else repr(float(k))}" for name, k in values)
        return f"point {number} ({', '.join(given)})"

    @property
    def line(self) -> int:
        """Number of points in one piece of work: a line of the last axis where a state is carried along it, else 1."""
        return self.shape[-1] if "direction" in self.axes else 1

    def configuration(self) -> dict[str, Any]:
        """Return the part of a configuration that gives the points."""
        kind, varied = ("points", self.columns) if self.columns else ("grid", self.axes)
        return {kind: {name: values.tolist() for name, values in varied.items()}, "fixed": self.fixed}

    def window(self, start: int, stop: int) -> tuple["Grid", int]:
        """Return a small grid that has the points `start` to `stop` - 1 in one piece, and the number of `start` in it.

        Tasks that travel carry it in place of the whole grid, whose axes may be long.
        """
        axes, stride, lead = dict(self.axes), self.size, 0
        for name, values in self.axes.items():
            stride //= values.size
            first, last = (start - lead) // stride, (stop - 1 - lead) // stride
            axes[name] = values[first : last + 1]
            lead += first * stride
            if last > first:
                break
        columns = {name: values[start:stop] for name, values in self.columns.items()}
        return Grid(axes, self.fixed, columns), start - lead


def without_directions(axes: Mapping[str, Any] | None) -> tuple[dict[str, Any] | None, str | None]:
    """Return the axes that a user gave, and `carry`, from the axes of a configuration.

    It is the inverse of `with_directions`.
    """
    if axes is None or "direction" not in axes:
        return axes if axes is None else dict(axes), None
    codes = axes["direction"]
    carry = "both" if len(codes) == len(DIRECTIONS) else DIRECTIONS[next(iter(codes))]
    return {name: values for name, values in axes.items() if name != "direction"}, carry


def with_directions(grid: Grid, carry: Any) -> Grid:
    """Return a grid along whose last axis the state is carried: an axis `direction`, of codes, comes before that axis.

    Raises
    ------
    ParameterError
        If `carry` is no direction, or the last axis is a parameter of the start, which no later run
        of a line uses.
    """
    if carry not in (*DIRECTIONS, "both"):
        raise ParameterError(f"carry = {carry!r}: must be one of {', '.join(DIRECTIONS)}, both")
    *others, last = grid.axes
    if last in (*START, "phi0"):
        raise ParameterError(
            f"carry = {carry!r}: goes along the last axis, {last}, which is of the start and changes no later run; "
            "make another axis the last one"
        )
    codes = [k for k, word in enumerate(DIRECTIONS) if carry in (word, "both")]
    axes = {name: grid.axes[name] for name in others} | {"direction": np.array(codes), last: grid.axes[last]}
    return Grid(axes, grid.fixed)


def legal_points(grid: Grid) -> np.ndarray:
    """Return a mask of the points that keep the rules between two parameters, shape (grid.size,), bool.

    Such a rule: mu_s is not below mu.

    Raises
    ------
    ParameterError
        If no point keeps them.
    """
    legal = np.broadcast_to(keeps_rules(grid.values(np.arange(grid.size))), grid.size)
    if not legal.any():
        check(grid.axes)
    return legal


def laid_out(
    varied: Mapping[str, Any], fixed: Any, read: Callable[[str, Any], np.ndarray], gaps: Collection[str]
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the values of varied and of all other parameters, checked together.

    `read` takes the name of a varied parameter and what is given for it, and returns its values. Combinations on the
    axes in `gaps` may break rules between two parameters.

    Raises
    ------
    ParameterError
        If a value is not allowed, or a parameter is given twice or has no effect beside others.
    """
    if not isinstance(fixed, Mapping | None):
        raise ParameterError(f"fixed = {fixed!r}: must be a mapping of parameters and values")
    given = spelt_out(fixed or {}, dict.fromkeys(varied))
    for name in given:
        check_name(name)
        if name in varied:
            raise ParameterError(f"{name}: given twice, as an axis and as a fixed value")
    check_effect({*varied, *given})
    values = {name: read(name, each) for name, each in varied.items()}
    constant = fixed_values(values, given)
    check(constant | values, gaps)
    return values, constant


def fixed_values(varied: Mapping[str, np.ndarray], fixed: Mapping[str, Any]) -> dict[str, float]:
    """Return every parameter that does not vary, in SI units: from `fixed`, or from the base case.

    What differs from end to end is given by its values at the ends, so that the same points have the same description.
    """
    constant = {name: fixed_value(name, value) for name, value in (BASE | dict(fixed)).items() if name not in varied}
    for both, ends in ENDS.items():
        if both in constant and {*ends} & {*varied, *fixed}:
            value = constant.pop(both)
            constant = {end: value for end in ends if end not in varied} | constant
    return constant


def make_grid(
    axes: Mapping[str, Any], fixed: Mapping[str, Any] | None = None, *, gaps: Collection[str] = (), carry: Any = None
) -> Grid:
    """Build a grid and check all its points, axis by axis.

    Parameters
    ----------
    axes : mapping of str to array_like or mapping
        Each axis as `axis_values` takes it.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    gaps : collection of str
        Axes on which points may break a rule that ties two of them (mu_s below mu); see `legal_points`.
    carry : str, optional
        The direction in which a state is carried along the last axis, or both; see `with_directions`.

    Returns
    -------
    Grid

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed.
    """
    if not isinstance(axes, Mapping):
        raise ParameterError(f"grid: is a {type(axes).__name__}; give a mapping of parameters to their values")
    if not axes:
        raise ParameterError("grid: has no axis; give at least one parameter to sweep")
    grid = Grid(*laid_out(axes, fixed, axis_values, gaps))
    return grid if carry is None else with_directions(grid, carry)


def make_points(table: Any, fixed: Mapping[str, Any] | None = None) -> Grid:
    """Check a table of points, and return it as a grid along `point`.

    Parameters
    ----------
    table : mapping of str to array_like, pandas.DataFrame or xarray.Dataset
        A column of one length for each parameter that varies, in SI units; of a dataset, its parameters of one
        dimension.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.

    Returns
    -------
    Grid
        Along `point`, the numbers of the points.

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed, and for a rule between two of them the point.
    """
    given = _columns(table)
    check_labels(given)
    if not given:
        raise ParameterError("points: has no column; give at least one parameter that varies")
    columns, constant = laid_out(given, fixed, _column, gaps=PARAMETERS)
    lengths = {name: values.size for name, values in columns.items()}
    n, *others = set(lengths.values())
    if others:
        counts = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ParameterError(f"points: the columns differ in length ({counts})")
    if not 1 <= n <= MAX_POINTS:
        raise ParameterError(f"points: {n} of them; must be 1 to {MAX_POINTS}")
    kept = np.broadcast_to(keeps_rules(constant | columns), n)
    if not kept.all():
        first = int(np.argmin(kept))
        try:
            check(constant | {name: values[first] for name, values in columns.items()})
        except ParameterError as error:
            raise ParameterError(f"point {first}: {error}") from None
    return Grid({"point": np.arange(n)}, constant, columns)


def _columns(table: Any) -> dict[str, Any]:
    """Return the columns of a table by name: of a dataset, its parameters of one dimension; of a mapping, all."""
    if hasattr(table, "data_vars"):
        parameters = {str(name): each for name, each in table.variables.items() if name in PARAMETERS}
        if "mode" in table:  # a cube has parameters that follow from others, too: they are left out
            parameters = reduced(parameters)
        return {name: each for name, each in parameters.items() if each.ndim == 1}
    if hasattr(table, "items"):
        columns = [(str(name), values) for name, values in table.items()]
        names = [name for name, _ in columns]
        for name in names:
            if names.count(name) > 1:
                raise ParameterError(f"points: has {names.count(name)} columns {name}; give each parameter once")
        return dict(columns)
    raise ParameterError(f"points: is a {type(table).__name__}; give a mapping of parameters to columns, or a table")


def _column(name: str, values: Any) -> np.ndarray:
    """Return a column of a table in SI units, given as a sequence or as a declaration like that of an axis."""
    check_name(name)
    if isinstance(values, Mapping):
        return _from_declaration(name, values)
    if not isinstance(values, list | tuple | range) and getattr(values, "ndim", 0) != 1:
        raise ParameterError(f"{name}: has shape {getattr(values, 'shape', ())}; must be one column")
    return as_numbers(name, values, PARAMETERS[name].units)


def check_fits(grid: Grid, *, by_blocks: bool) -> None:
    """Refuse a grid with more than `MAX_POINTS` points: memory would not hold its results.

    Parameters
    ----------
    grid : Grid
    by_blocks : bool
        True if a file can take the cube block by block. The grid is refused all the same, but the message names such a
        file as the way out.

    Raises
    ------
    ParameterError
        If the grid has too many points.
    """
    if grid.size > MAX_POINTS:
        remedy = " (an output that ends in .zarr is not held in memory)" if by_blocks else ""
        raise ParameterError(f"grid: {grid.size} points; one cube in memory may hold {MAX_POINTS}{remedy}")
