"""Evaluate cubes for pictures and notebooks: intervals, boundaries, exponents, minima and circles."""

import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from contourpy import contour_generator

from dimersweep.cubes.cube import names
from dimersweep.cubes.grid import DIRECTIONS
from dimersweep.cubes.results import runs
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, check_labels, number
from dimersweep.kernel.model.layout import M_DRIFT, MODES
from dimersweep.parameters import Parameters, dimer_from
from dimersweep.symbols import BASE, PARAMETERS

# relative distance within which a value is that of a point: units that are converted leave round-off of some 1e-16
SAME_VALUE = 1e-12
# points on each side of a minimum that the spline goes through: two or three are left of them in the coarser grids
VALLEY = 5


def edges_of(values: np.ndarray, lowest: float = -np.inf, highest: float = np.inf) -> np.ndarray:
    """Return the edges of the cells around the points of an axis, shape (n + 1,), within `lowest` and `highest`.

    An edge lies half way between neighbours: at their geometric mean where the values are in a fixed ratio, else at
    their mean. A single value has a cell of width 1.
    """
    if values.size == 1:
        return values[0] + np.array([-0.5, 0.5])
    sign = np.sign(values[0])
    geometric = is_geometric(sign * values)
    return np.clip(sign * np.exp(_middles(np.log(sign * values))) if geometric else _middles(values), lowest, highest)


def nearest(cube: xr.Dataset, name: str, value: Any) -> xr.Dataset:
    """Return the part of a cube at the value of the axis `name` that is nearest to `value`; of two, the larger one.

    Parameters
    ----------
    cube : xarray.Dataset
    name : str
        A parameter that is an axis of it, or `direction`.
    value : float or str
        A number in the SI unit, or a text with its unit, see `number`; a direction is given by its word.

    Raises
    ------
    ParameterError
        If `value` lies beyond the cells of the axis, as an angle in degrees without its unit does. On an axis of one
        value, if it is another value.
    """
    if name not in cube.coords:
        raise ParameterError(f"{name}: the cube has lost the values of this axis; take it as it was made, or use isel")
    if name == "direction":
        words = [DIRECTIONS[code] for code in cube["direction"].values.tolist()]
        if value not in words:
            raise ParameterError(f"direction = {value!r}: must be {' or '.join(words)}")
        return cube.sel(direction=DIRECTIONS.index(value))
    values, wanted = np.sort(cube[name].values), number(name, value)
    if not values.size:
        raise ParameterError(f"{name}: the axis is empty")
    edges = edges_of(values) if values.size > 1 else values.repeat(2)
    if not edges[0] <= wanted <= edges[-1] and not np.isclose(wanted, values, rtol=SAME_VALUE, atol=0).any():
        units = "" if PARAMETERS[name].units == "1" else f" {PARAMETERS[name].units}"
        allowed = f"lie on the axis, {values[0]:g} to {values[-1]:g}" if values.size > 1 else f"be {values[0]:g}"
        raise ParameterError(f"{name} = {wanted:g}: must {allowed}{units}")
    away = np.abs(values - wanted)
    places = np.flatnonzero(cube[name].values == values[away == away.min()].max())
    if places.size > 1:
        raise ParameterError(f"{name} = {wanted:g}: the axis has this value {places.size} times; take one by isel")
    return cube.isel({name: int(places[0])})


def _middles(values: np.ndarray) -> np.ndarray:
    """Return the edges half way between neighbours, and as far beyond the first and last value, shape (n + 1,)."""
    inner = (values[1:] + values[:-1]) / 2
    return np.concatenate([[2 * values[0] - inner[0]], inner, [2 * values[-1] - inner[-1]]])


def is_geometric(values: np.ndarray) -> bool:
    """Return True if three or more values of an axis are in a fixed ratio rather than at a fixed distance."""
    # two values are in a fixed ratio and at a fixed distance
    if values.size < 3 or values.min() <= 0:
        return False
    ratios, steps = np.diff(np.log(values)), np.diff(values)
    # 1e-6: far above round-off, though differences of like values enlarge it
    return bool(np.ptp(ratios) < 1e-6 * abs(ratios.mean()) and np.ptp(steps) > 1e-6 * abs(steps.mean()))


def _drift_rows(cube: xr.Dataset) -> xr.DataArray:
    """Return a mask of the points of `cube` that drift, shape (rows, beta0), the dip angles increasing."""
    mode = cube["mode"].squeeze()
    if "beta0" not in mode.dims or mode.ndim > 2 or not mode.size:
        axes = ", ".join(map(str, mode.dims)) or "none"
        raise ParameterError(f"drift_intervals: has axes {axes}; needs beta0 and at most one more")
    rows = mode if mode.ndim == 2 else mode.expand_dims("f")
    return (rows == M_DRIFT).transpose(..., "beta0").sortby("beta0")


def dip_range(angles: np.ndarray) -> tuple[float, float]:
    """Return the least and greatest dip angle that points at `angles` may stand for [rad].

    On each side of 0 that has points the range goes to a right angle; on a side without points it ends at 0. If all
    angles are 0, it goes to both right angles.
    """
    low, high = min(angles.min(), 0.0), max(angles.max(), 0.0)
    return (-np.pi / 2 if low < 0 or high == 0 else 0.0), (np.pi / 2 if high > 0 or low == 0 else 0.0)


def drift_intervals(cube: xr.Dataset) -> list[np.ndarray]:
    """Return the intervals of the initial dip angle that lead to drift, for each row of `cube`.

    Parameters
    ----------
    cube : xarray.Dataset
        With the axis `beta0` and at most one more. Each point stands for the angles half way to its neighbours. If all
        angles have one sign, the intervals end at 0.

    Returns
    -------
    list of ndarray, shape (n_intervals, 2)
        Start and end of each interval [rad], increasing.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"beta0": [0.2, 0.24, 0.28, 0.32]}, periods=60, progress=False)
    >>> [interval.round(2).tolist() for interval in plots.drift_intervals(cube)]
    [[[0.26, 0.34]]]
    """
    drift = _drift_rows(cube)
    angles = drift["beta0"].values
    edges = edges_of(angles, *dip_range(angles))
    return [edges[np.array(runs(row), dtype=int).reshape(-1, 2)] for row in drift.values]


def drift_lengths(cube: xr.Dataset) -> xr.DataArray:
    """Return the total length of the drift intervals of each row of `cube` [rad], along its other axis.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"beta0": [0.2, 0.24, 0.28, 0.32]}, periods=60, progress=False)
    >>> plots.drift_lengths(cube).values.round(2).tolist()
    [0.08]
    """
    rows = _drift_rows(cube).isel(beta0=0, drop=True)
    lengths = np.array([np.diff(intervals).sum() for intervals in drift_intervals(cube)])
    return rows.copy(data=lengths).rename("drift_length").assign_attrs(units="rad")


def search_summary(cube: xr.Dataset) -> str:
    """Return one line on a search: its question, how often each answer was given, and how many runs it took."""
    search = json.loads(cube.attrs["configuration"])["search"]
    made = cube["n_runs"].values > 0
    words, counts = np.unique(names(cube["answer"]).values[made], return_counts=True)
    answers = ", ".join(f"{word} {count}" for word, count in zip(words, counts, strict=True))
    taken, whole = int(cube["n_runs"].sum()), int(made.sum()) * len(search["values"])
    asked = (
        f"{search['ask']} {search['axis']} to {search['mode']}"
        if search["ask"] != "fraction"
        else f"modes over {search['axis']}"
    )
    return f"{asked}: {answers} at {int(made.sum())} points, in {taken} runs of {whole} that there are"


def runs_of(cube: xr.Dataset, mode: str) -> xr.DataArray:
    """Return the number of runs of a search that led to `mode`, over the axes of its cube.

    Examples
    --------
    >>> from dimersweep import search
    >>> from dimersweep.cubes.findings import runs_of
    >>> angles = {"start": 5, "stop": 35, "step": 5, "unit": "deg"}
    >>> grid = {"Gamma": [0.6, 0.9], "beta0": angles}
    >>> cube = search(grid, over="beta0", ask="fraction", periods=100, progress=False)
    >>> runs_of(cube, "drift").values.tolist(), cube["n_runs"].values.tolist()
    ([0, 2], [7, 7])
    """
    return cube["runs"].sel(outcome=MODES.index(mode))


def boundary(cube: xr.Dataset, region: str) -> list[np.ndarray]:
    """Return the border of a region in a map of two axes, as polylines.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `search` or `refine`, with two axes of more than one value.
    region : str
        Word of a region, such as drift or rest.

    Returns
    -------
    list of ndarray, shape (n, 2)
        Polylines; the columns are the first and the second axis of the map. They run half way between neighbouring
        points that differ.

    Raises
    ------
    ParameterError
        If the cube has no regions over two axes.

    Examples
    --------
    >>> from dimersweep import search
    >>> from dimersweep.cubes.findings import boundary
    >>> angles = {"start": 5, "stop": 35, "step": 5, "unit": "deg"}
    >>> grid = {"Gamma": [0.6, 0.7, 0.8, 0.9, 1.0], "f": [12, 15, 20], "beta0": angles}
    >>> cube = search(grid, over="beta0", ask="first", periods=100, progress=False)
    >>> [line.round(3).tolist() for line in boundary(cube, "drift")]  # pairs of Gamma and f
    [[[0.75, 12.0], [0.8, 13.5], [0.85, 15.0], [0.8, 17.5], [0.75, 20.0]]]
    """
    if "region" not in cube:
        raise ParameterError("boundary: the cube has no regions; it is not of a search")
    inside = (names(cube["region"]) == region).squeeze()
    if inside.ndim != 2:
        raise ParameterError(f"boundary: has axes {', '.join(map(str, inside.dims)) or 'none'}; needs 2 of them")
    first, second = (inside[dim].values for dim in inside.dims)
    lines = contour_generator(second, first, inside.values.astype(float)).lines(0.5)
    return [np.asarray(line)[:, ::-1] for line in lines]


class PowerLaw(NamedTuple):
    """Exponent of a power law with its standard error, and the least and greatest slope between neighbouring points.

    Examples
    --------
    >>> from dimersweep.cubes.findings import PowerLaw
    >>> law = PowerLaw(exponent=2.92, error=0.02, least=2.88, greatest=2.95)
    >>> law.least <= law.exponent <= law.greatest
    True
    """

    exponent: float
    error: float
    least: float
    greatest: float


def over_axes(cube: xr.Dataset, quantity: str, *, flags: bool = True) -> xr.DataArray:
    """Return the variable `quantity` of a cube, which must lie over all axes of the cube.

    Without `flags`, codes of words are refused as well.

    Raises
    ------
    ParameterError
        If the cube has no such variable.
    """
    known = [str(name) for name, each in cube.data_vars.items() if each.dims == cube["mode"].dims]
    known = [name for name in known if flags or "flag_meanings" not in cube[name].attrs]
    if quantity not in known:
        raise ParameterError(f"quantity = {quantity!r}: must be one of {', '.join(known)}")
    return cube[quantity]


def exponents(cube: xr.Dataset, quantity: str = "radius") -> dict[str, PowerLaw]:
    """Fit a power law of `quantity` in all axes of `cube` at once; for A_r the base is A_r - 1.

    The standard error is that of a straight line through the logarithms. The slopes between neighbours show how far the
    law holds.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `search` or `sweep`; points that do not drift are left out.
    quantity : str
        Variable of the cube, such as radius or period; positive where there is drift.

    Returns
    -------
    dict of str to PowerLaw
        The law in each axis of more than one value. Where no two neighbours drift, its slopes are NaN.

    Raises
    ------
    ParameterError
        If there are too few points that drift, or they do not vary along each axis by itself; or if the quantity or an
        axis has values there that are not positive.

    Examples
    --------
    >>> from dimersweep import search
    >>> from dimersweep.cubes.findings import exponents
    >>> angles = {"start": 5, "stop": 35, "step": 5, "unit": "deg"}
    >>> cube = search({"A_r": [5, 6, 7], "beta0": angles}, over="beta0", ask="first", periods=100, progress=False)
    >>> law = exponents(cube, "radius")["A_r"]  # the radius grows like (A_r - 1) to this power
    >>> round(law.exponent, 2), round(law.error, 2)
    (2.92, 0.02)
    """
    values = over_axes(cube, quantity, flags=False).where(cube["mode"] == M_DRIFT).squeeze(drop=True)
    axes = [str(dim) for dim in values.dims]
    if not axes or not set(axes) <= set(PARAMETERS):
        raise ParameterError(
            f"exponents: has axes {', '.join(axes) or 'none'}; needs parameters of more than one value"
        )
    values = values.where(np.isfinite(values))
    points = values.stack(point=axes).dropna("point")
    drifts = f"all {points.size} points that drift"
    if points.size <= len(axes) + 1:
        raise ParameterError(f"exponents: {points.size} points drift; too few for a fit over {', '.join(axes)}")
    target = _logarithms(quantity, points.values, " where it drifts")
    logs = [_logarithms(*_grown(name, points[name].values)) for name in axes]
    fixed = [name for name, log in zip(axes, logs, strict=True) if not np.ptp(log)]
    if fixed:
        raise ParameterError(f"exponents: {fixed[0]} is the same at {drifts}")
    design = np.column_stack([np.ones(points.size), *logs])
    if np.linalg.matrix_rank(design) <= len(axes):
        raise ParameterError(f"exponents: {' and '.join(axes)} vary together at {drifts}")
    fit, *_ = np.linalg.lstsq(design, target)
    rest = target - design @ fit
    covariance = np.linalg.inv(design.T @ design) * (rest @ rest) / (target.size - design.shape[1])
    found = {}
    for name, exponent, error in zip(axes, fit[1:], np.sqrt(np.diag(covariance))[1:], strict=True):
        # an axis may be 0 or negative where nothing drifts: its logarithm there is not used
        with np.errstate(invalid="ignore", divide="ignore"):
            level, along = (xr.apply_ufunc(np.log, each).diff(name) for each in (values, _grown(name, values[name])[1]))
        slopes = level / along
        found[name] = PowerLaw(float(exponent), float(error), float(slopes.min()), float(slopes.max()))
    return found


def _grown(name: str, values: Any) -> tuple[str, Any]:
    """Return the base of the power law in the axis `name`, its name and its values.

    It is the axis itself, but A_r - 1 for A_r: the distance of the balls.
    """
    return (f"{name} - 1", values - 1) if name == "A_r" else (name, values)


def _logarithms(what: str, values: np.ndarray, where: str = "") -> np.ndarray:
    """Return the logarithms of values; raise `ParameterError` if one is not positive."""
    if values.min() <= 0:
        raise ParameterError(
            f"exponents: {what} is {values.min():g} to {values.max():g}{where}; a power law needs values > 0"
        )
    return np.log(values)


class Minimum(NamedTuple):
    """Place and value of a minimum, each with the change that a grid twice as coarse would make.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.cubes.findings import minimum
    >>> xdot0 = np.linspace(1, 5, 17)
    >>> minimum(xdot0, 10 + (xdot0 - 3.1) ** 2).words("s", "m/s")
    '10.000 ± 0.000 s at 3.100 ± 0.000 m/s'
    >>> minimum(xdot0, xdot0).located
    False
    """

    at: float
    at_error: float
    value: float
    value_error: float

    @property
    def located(self) -> bool:
        """True if a minimum was located; else all its numbers are NaN."""
        return bool(np.isfinite(self.at))

    def words(self, unit: str, at_unit: str) -> str:
        """Return the minimum in words, with its errors, in the units given."""
        if not self.located:
            return "no minimum located"
        return f"{self.value:.3f} ± {self.value_error:.3f} {unit} at {self.at:.3f} ± {self.at_error:.3f} {at_unit}"


def minimum(points: np.ndarray, values: np.ndarray) -> Minimum:
    """Find the bottom of the first valley of `values`, on a cubic spline through them.

    Parameters
    ----------
    points, values : ndarray, shape (n,)
        Places in any order, and the values there; unknown values are NaN.

    Returns
    -------
    Minimum
        NaN if no minimum is located: there is no valley, one of its sides has fewer than three points, or a value
        beside its lowest point is unknown. Neither is it located if a grid twice as coarse would put it outside the
        valley, or if the spline digs far below the points.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.cubes.findings import minimum
    >>> xdot0 = np.linspace(1, 5, 17)
    >>> lowest = minimum(xdot0, 10 + (xdot0 - 3.1) ** 2)
    >>> round(lowest.at, 6), round(lowest.value, 6)
    (3.1, 10.0)
    """
    nowhere = Minimum(*[float("nan")] * 4)
    check_labels({"points": points, "values": values})
    points, values = as_numbers("points", points, None), as_numbers("values", values, None, result=True)
    order = np.argsort(points)
    points, values = points[order], values[order]
    known = np.flatnonzero(np.isfinite(values))
    x, y = points[known], values[known]
    turns = np.flatnonzero((y[1:-1] <= y[:-2]) & (y[1:-1] <= y[2:])) + 1
    # three points on each side: the coarser grids below, every second point, then see both slopes
    if not turns.size or not 3 <= turns[0] < y.size - 3:
        return nowhere
    low = int(turns[0])
    left, right = x[low - 1], x[low + 1]
    near = slice(max(0, low - VALLEY), low + VALLEY + 1)
    at, value = _bottom(x[near], y[near], left, right)
    coarser = np.array([_bottom(x[near][first::2], y[near][first::2]) for first in (0, 1)])
    at_error, value_error = np.abs(coarser - [at, value]).max(axis=0)
    walls = y[low - 2 : low + 3].max() - y[low]  # two points to each side are the neighbours in the coarser grids
    rise = max(y[low - 1], y[low + 1]) - y[low]
    # a parabola through three points goes at most an eighth of the rise below the lowest of them: twice that is allowed
    too_deep = y[low] - value > rise / 4
    if known[low + 1] - known[low - 1] > 2 or at_error > right - left or value_error > walls or too_deep:
        return nowhere
    return Minimum(at, float(at_error), value, float(value_error))


def _bottom(x: np.ndarray, y: np.ndarray, left: float = -np.inf, right: float = np.inf) -> tuple[float, float]:
    """Return the lowest point of the cubic spline through `y` at `x`, between `left` and `right`, and its height."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(x, y)
    flat = spline.derivative().roots(extrapolate=False)
    places = np.concatenate([flat, x])
    places = places[(left <= places) & (places <= right)]
    lowest = places[np.argmin(spline(places))]
    return float(lowest), float(spline(lowest))


def circle_through(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Fit a circle to a path, by least squares of its equation; return its centre and radius in the unit of `x`.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Points of the path [m].

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.cubes.findings import circle_through
    >>> angle = np.linspace(0, 1, 5)
    >>> a, b, radius = circle_through(3 + 2 * np.cos(angle), 4 + 2 * np.sin(angle))
    >>> round(a, 6), round(b, 6), round(radius, 6)
    (3.0, 4.0, 2.0)
    """
    x, y = as_numbers("x", x, "m"), as_numbers("y", y, "m")
    a, b, c = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(x.size)]), x**2 + y**2)[0]
    return float(a), float(b), float(np.sqrt(c + a * a + b * b))


def stick_ratio(
    A_r: float,
    r: float = BASE["r"],
    rho_b: float = BASE["rho_b"],
    rho_r: float = BASE["rho_r"],
    D_r: float = BASE["D_r"],
) -> float:
    """Return mubar, the axial friction per normal force that keeps one contact of a level dimer from slipping [1].

    It is (l r/2)/(J_t/m + r^2), with J_t the transverse inertia about the centre of mass. An end that slips when mu <
    mubar cannot come to rest in an impact at that end.

    Parameters
    ----------
    A_r, r, rho_b, rho_r, D_r : float
        Parameters of the dimer, as in `simulate`.

    Examples
    --------
    >>> from dimersweep.cubes.findings import stick_ratio
    >>> round(stick_ratio(5), 3), round(stick_ratio(6), 3), round(stick_ratio(7), 3)
    (0.239, 0.2, 0.171)
    """
    body = {"A_r": A_r, "r": r, "rho_b": rho_b, "rho_r": rho_r, "D_r": D_r}
    pair = dimer_from(Parameters(**body).given()).pair
    return float(-pair.na_1 / pair.aa)
