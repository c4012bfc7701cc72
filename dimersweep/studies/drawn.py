"""Starts, drawn from ranges or given as a table: where the runs behind `attractors` begin."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from dimersweep.cubes.grid import make_points
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, number
from dimersweep.parameters import check_name
from dimersweep.symbols import START

STARTING = (*START, "phi0")  # parameters that starts are drawn from


def drawn_starts(ranges: Any, fixed: Any, points: Any, starts: int, seed: int) -> dict[str, np.ndarray]:
    """Columns of starts: those of a table, or drawn evenly and independently from ranges, whose ends are judged as starts.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    if (ranges is None) == (points is None):
        raise ParameterError("ranges: give either ranges to draw from or points")
    if points is not None:
        columns = make_points(points).columns
        _check_starts(columns)
        return columns
    if not isinstance(ranges, Mapping) or not ranges:
        raise ParameterError(f"ranges = {ranges!r}: must be a mapping of parameters to pairs such as (0.1, 0.5)")
    _check_starts(ranges)
    count = check_count("starts", starts)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ParameterError(f"seed = {seed!r}: must be a whole number >= 0")
    pairs, draw = {name: _pair(name, pair) for name, pair in ranges.items()}, np.random.default_rng(int(seed))
    make_points(pairs, fixed)
    return {name: draw.uniform(low, high, size=count) for name, (low, high) in pairs.items()}


def _check_starts(names: Iterable[str]) -> None:
    """Refuse to draw what makes another dimer or another plate: motions are compared on one."""
    for name in names:
        check_name(name)
        if name not in STARTING:
            raise ParameterError(f"{name}: is no part of a start; draw from {', '.join(STARTING)}")


def _pair(name: str, pair: Any) -> tuple[float, float]:
    """The ends of a range in SI units."""
    if not isinstance(pair, list | tuple | np.ndarray) or len(pair) != 2:
        raise ParameterError(f"{name} = {pair!r}: must be a pair of its least and its greatest value")
    low, high = (number(name, value) for value in pair)
    if not low < high:
        raise ParameterError(f"{name} = {low:g} to {high:g}: the least value must be below the greatest")
    return low, high
