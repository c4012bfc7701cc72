"""Tables of points that a sweep file gives in a CSV file, as a list, or as ranges to draw from."""

import csv
from collections.abc import Mapping
from decimal import Context, Decimal, localcontext
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from dimersweep.cubes.grid import MAX_POINTS, RATIO_DIGITS, axis_values
from dimersweep.errors import ParameterError, one_line
from dimersweep.inputs import check_count

SAMPLES = ("random", "latin_hypercube", "sobol")


def point_table(
    *, file: str | None, columns: Mapping[str, Any], ranges: Mapping[str, Any], **drawn: Any
) -> dict[str, Any]:
    """Return the table of points that a section ``[points]`` declares, as `make_points` takes it.

    Parameters
    ----------
    file : str, optional
        CSV file with the names of parameters in its first line.
    columns : mapping
        Values of each parameter: a list, or ``{"values": ..., "unit": ...}``.
    ranges : mapping
        ``{"start", "stop"}`` of each parameter, with an optional ``"unit"`` and ``"spacing": "log"``.
    **drawn
        Settings of points that are drawn, see `draw_points`.

    Raises
    ------
    ParameterError
        If there is none of the three or more than one, or one of their settings is not allowed.
    """
    if [file is not None, bool(columns), bool(ranges)].count(True) != 1:
        raise ParameterError("points: give one of file, columns and ranges")
    if ranges:
        return draw_points(ranges, **drawn)
    for name, value in drawn.items():
        if value is not None:
            raise ParameterError(f"points.{name} = {value!r}: is for points that are drawn from points.ranges")
    return dict(columns) if file is None else _read(file)


def draw_points(
    ranges: Mapping[str, Any], *, sample: str | None, number: int | None, seed: int | None
) -> dict[str, np.ndarray]:
    """Draw points from the box of some ranges with `scipy.stats.qmc`; the same seed gives the same points.

    Parameters
    ----------
    ranges : mapping
        Ranges of the parameters, see `point_table`.
    sample : str
        One of `SAMPLES`; a Latin hypercube by default.
    number : int
        Number of points; a power of two for a Sobol sequence, as other numbers of its points cover the box unevenly.
    seed : int
        Seed of the random numbers; 0 by default.

    Returns
    -------
    dict of str to ndarray, shape (number,)
        Values of each parameter, SI units.

    Raises
    ------
    ParameterError
        If the number, or a range, is missing or not allowed.
    """
    from scipy.stats import qmc

    if number is None:
        raise ParameterError("points.number: is missing; how many points are drawn")
    n = check_count("points.number", number)
    if n > MAX_POINTS:
        raise ParameterError(f"points.number = {n}: must be <= {MAX_POINTS}")
    if sample == "sobol" and n & (n - 1):
        raise ParameterError(
            f"points.number = {n}: must be a power of two for a Sobol sequence, such as {1 << n.bit_length()}"
        )
    boxes = {name: _ends(name, declared) for name, declared in ranges.items()}
    rng = np.random.default_rng(seed or 0)
    if sample == "random":
        unit = rng.random((n, len(boxes)))
    else:
        engine = qmc.Sobol if sample == "sobol" else qmc.LatinHypercube
        unit = engine(len(boxes), seed=rng).random(n)
    return {name: between(*box, share) for (name, box), share in zip(boxes.items(), unit.T, strict=True)}


def _ends(name: str, declared: Any) -> tuple[float, float, bool]:
    """Return both ends of a range, in SI units, and True if it is covered evenly on a logarithmic scale."""
    needed = {"start", "stop"}
    if not isinstance(declared, Mapping) or not needed <= declared.keys() <= {*needed, "unit", "spacing"}:
        raise ParameterError(f"points.ranges.{name}: give start and stop, and perhaps unit and spacing")
    low, high = axis_values(name, {**declared, "num": 2}).tolist()
    by_ratio = declared.get("spacing") == "log"
    if by_ratio and not isfinite(high / low):
        raise ParameterError(f"points.ranges.{name}: stop = {high} is too far from start = {low}")
    return low, high, by_ratio


def between(low: float, high: float, by_ratio: bool, share: np.ndarray) -> np.ndarray:
    """Return the values at shares in [0, 1) of a range, shape (n,).

    `by_ratio` divides the range on a logarithmic scale, in decimal arithmetic: each value is the nearest float, as in
    `cubes.grid`.
    """
    if not by_ratio:
        return low + (high - low) * share
    with localcontext(Context(prec=RATIO_DIGITS)):
        first = Decimal(low)
        log = (Decimal(high) / first).ln()
        return np.fromiter((first * (log * Decimal(at)).exp() for at in share.tolist()), float, share.size)


def _read(file: str) -> dict[str, list[str]]:
    """Return the columns of a CSV file by name; its first line has the names.

    Raises
    ------
    ParameterError
        If the file cannot be read, is empty, or a line (which is named) has more or fewer values than the first line
        has names.
    """
    where = f"points.file = {file!r}"
    try:
        with Path(file).open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, skipinitialspace=True)
            rows = [(reader.line_num, row) for row in reader if row not in ([], [""])]
    except OSError as error:
        raise ParameterError(f"{where}: cannot be read ({error.strerror})") from None
    except (ValueError, csv.Error) as error:
        raise ParameterError(f"{where}: is no table ({one_line(error)})") from None
    if not rows:
        raise ParameterError(f"{where}: is no table (it is empty)")
    names = [" ".join(name.split()) for name in rows[0][1]]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"{where}: has {names.count(name)} columns {name}; give each parameter once")
    for line, row in rows:
        if len(row) != len(names):
            raise ParameterError(f"{where}: line {line} has {len(row)} values for {len(names)} columns")
    return {name: [row[k] for _, row in rows[1:]] for k, name in enumerate(names)}
