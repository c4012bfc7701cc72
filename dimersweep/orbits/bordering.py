"""Curves of borders over other parameters, and where they meet other borders."""

from collections.abc import Mapping
from heapq import heappop, heappush
from itertools import product, takewhile
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.curve import CURVES, KINDS, WORDS, Curve, Found
from dimersweep.orbits.finding import RTOL, checked, rolled_up
from dimersweep.orbits.orbit import Orbit
from dimersweep.orbits.return_map import OrbitLost
from dimersweep.orbits.tables import dataset
from dimersweep.orbits.word import change_of
from dimersweep.parameters import as_number, check_name, check_rtol
from dimersweep.symbols import PARAMETERS

MEETING = 1e-6  # how well a meeting is known, in the step of the curve


def border(
    kind: str,
    parameter: str,
    over: Mapping[str, Any],
    *,
    spin: float | None = None,
    start: Orbit | None = None,
    rtol: float = RTOL,
    **fixed: float,
) -> xr.Dataset:
    """A border of an orbit in one parameter, as a curve over the values of other ones.

    Parameters
    ----------
    kind : str
        fold, flip (period doubling), torus (Neimark-Sacker), or a change of word: any (word), or stick_slip, lift_off,
        double_impact, chatter, hop. The first one met from the start is the one that is followed.
    parameter : str
        The one that is solved for.
    over : mapping of str to sequence of float
        Values of one or more others; each point begins with what its neighbour has come to. A line of points that is not
        reached from the others is begun anew.
    spin : float, optional
        Axial spin [rad s-1]; by default what a lateral start with `xdot0` rolls up to. Of a fold, a flip and a torus it is
        that to which the spin is put back at the start of each forcing period; of a change of word that after the double
        impact.
    start : Orbit, optional
        From which the first point is looked for; by default one found between the ball's fold and flip.
    rtol : float
        Accuracy of the map [1].
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along the names in `over`: `parameter`, what an `Orbit` tells of the border's orbit, `status` ("ok", or why there is no
        point) and `cost`, the forcing periods of the map that a point took. Along `meeting`: where the curve meets another
        border, with its `meets`.

    Raises
    ------
    ParameterError
        For an unknown kind or parameter, or a value that is not allowed.
    OrbitError
        If no point of the border is found.
    """
    given, axes = _checked(kind, parameter, over, fixed)
    rtol = check_rtol(rtol)
    spin = rolled_up(given) if spin is None else as_number("spin", spin)
    curve = Curve(kind, parameter, given, spin, rtol)
    found, status = _walked(curve, axes, start)
    if not found:
        raise OrbitError(f"no {kind} found in {parameter}: {next(iter(status.values()))}")
    return _dataset(curve, axes, found, status)


def _checked(
    kind: str, parameter: str, over: Mapping[str, Any], fixed: dict[str, float]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """All parameters, and the axes.

    Raises
    ------
    ParameterError
        For what is not allowed.
    """
    if kind not in KINDS:
        raise ParameterError(f"kind = {kind!r}: unknown border (allowed: {', '.join(KINDS)})")
    check_name(parameter)
    if not isinstance(over, Mapping) or not over:
        raise ParameterError(f"over = {over!r}: must name at least one parameter with its values")
    axes = {}
    for name, values in over.items():
        check_name(name)
        if name == parameter or name in fixed:
            raise ParameterError(f"over: {name} is given twice")
        axes[name] = np.array([as_number(name, value) for value in np.atleast_1d(np.asarray(values))])
        if not axes[name].size:
            raise ParameterError(f"over: {name} has no values")
    for name, column in axes.items():
        for value in column:
            checked(fixed | {name: float(value)})
    return checked(fixed | {name: float(values[0]) for name, values in axes.items()}), axes


def outwards(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Every point of a grid, from its middle outwards."""
    middle = [(n - 1) // 2 for n in shape]
    points = product(*(range(n) for n in shape))
    return sorted(points, key=lambda index: sum(abs(k - m) for k, m in zip(index, middle, strict=True)))


class Try(NamedTuple):
    """A point to be looked for from a neighbour: how far that is, and the place of the point in the walk."""

    step: float
    place: int
    point: tuple[int, ...]
    axis: int
    side: int


def _walked(
    curve: "Curve", axes: dict[str, np.ndarray], start: Orbit | None
) -> tuple[dict[tuple[int, ...], Found], dict[tuple[int, ...], str]]:
    """The points that are found, and why the others are not: from the middle outwards, each from a neighbour.

    Short steps come first, so that a curve is followed along one axis before it is looked for across the others. A point that
    is not found from one neighbour is tried from the next. A line along the axis of the shortest steps that is not reached
    from the others is begun anew in its middle.
    """
    found: dict[tuple[int, ...], Found] = {}
    status: dict[tuple[int, ...], str] = {}
    order = outwards(tuple(len(values) for values in axes.values()))
    places = {index: place for place, index in enumerate(order)}
    waiting: list[Try] = []

    def tried(index: tuple[int, ...], near: list[Found]) -> None:
        values = {name: float(axes[name][k]) for name, k in zip(axes, index, strict=True)}
        try:
            found[index] = curve.point(values, near, start)
        except (OrbitLost, OrbitError, ParameterError) as reason:
            status.setdefault(index, str(reason))
            return
        for k, column in enumerate(axes.values()):
            for side in (-1, 1):
                other = _moved(index, k, -side)
                if other in places and other not in found:
                    step = _steps(column)[min(other[k], index[k])]
                    heappush(waiting, Try(round(step, 9), places[other], other, k, side))

    fine = min(range(len(axes)), key=lambda k: _steps(list(axes.values())[k]).min(initial=np.inf))
    begun: set[tuple[int, ...]] = set()  # lines along the finest axis
    for index in order:
        line = (*index[:fine], *index[fine + 1 :])
        if line in begun:
            continue
        tried(index, [])
        while waiting:
            one = heappop(waiting)
            if one.point not in found:
                beside = (_moved(one.point, one.axis, by * one.side) for by in (1, 2, 3))
                tried(one.point, [found[at] for at in takewhile(found.__contains__, beside)])
        begun |= {(*at[:fine], *at[fine + 1 :]) for at in found} | ({line} if found else set())
    return found, {index: status.get(index, "no neighbour was found") for index in order if index not in found}


def _steps(column: np.ndarray) -> np.ndarray:
    """Steps between the values of an axis, over the largest of them."""
    return np.abs(np.diff(column)) / np.abs(column).max()


def _moved(index: tuple[int, ...], axis: int, by: int) -> tuple[int, ...]:
    return tuple(n + by * (k == axis) for k, n in enumerate(index))


# --- where borders meet -------------------------------------------------------------------------------------------


def marks(kind: str, orbit: Orbit) -> dict[str, float]:
    """Test functions along a curve, by the name of what it meets where one changes its sign."""
    values = orbit.multipliers
    rest = np.delete(values, int(np.argmin(np.abs(values - {"fold": 1.0, "flip": -1.0}.get(kind, 0.0)))))
    real = rest[np.abs(rest.imag) < 1e-7].real
    told = {}
    if kind in ("fold", "flip", *WORDS):
        told[f"{kind}-fold" if kind != "fold" else "fold-fold"] = float(np.prod(1 - real)) if real.size else 1.0
        told[f"{kind}-flip"] = float(np.prod(1 + real)) if real.size else 1.0
    return told


def meetings(kind: str, a: Orbit, b: Orbit) -> list[str]:
    """Names of the borders that a curve meets between two of its points."""
    first, second = marks(kind, a), marks(kind, b)
    names = [name for name in first if first[name] * second[name] < 0]
    if a.word != b.word and kind in CURVES:
        names.append(f"{kind}-{change_of(a.word, b.word)}")
    return names


def _meetings(curve: Curve, axes: dict[str, np.ndarray], found: dict[tuple[int, ...], Found]) -> list[dict[str, Any]]:
    """Where the curve meets other borders along its last axis, each located between two points by halving."""
    names, rows = list(axes), []
    name = names[-1]
    for index, one in found.items():
        after = (*index[:-1], index[-1] + 1)
        if after not in found:
            continue
        two = found[after]
        for meets in meetings(curve.kind, one.orbit, two.orbit):
            values = {n: float(axes[n][k]) for n, k in zip(names, index, strict=True)}
            low, high = values[name], float(axes[name][after[-1]])
            a, b = one, two
            try:
                while abs(high - low) > MEETING * max(1.0, abs(high)):
                    middle = 0.5 * (low + high)
                    point = curve.point(values | {name: middle}, [a], None)
                    if meets in meetings(curve.kind, a.orbit, point.orbit):
                        high, b = middle, point
                    else:
                        low, a = middle, point
            except (OrbitLost, OrbitError):
                pass  # the bracket as far as it was narrowed
            values[name] = 0.5 * (low + high)
            rows.append(values | {curve.parameter: 0.5 * (a.value + b.value), "meets": meets})
    return rows


def _dataset(
    curve: Curve, axes: dict[str, np.ndarray], found: dict[tuple[int, ...], Found], status: dict[tuple[int, ...], str]
) -> xr.Dataset:
    shape = tuple(len(values) for values in axes.values())
    orbits = [one.orbit for one in found.values()]
    table = dataset(orbits, "found").drop_vars("cost")
    at = tuple(np.array(list(found)).T)
    result = xr.Dataset(coords={n: (n, v, PARAMETERS[n]._asdict()) for n, v in axes.items()})
    for name, column in table.data_vars.items():
        values = np.full(shape + column.shape[1:], _empty(column.dtype), dtype=column.dtype)
        values[at] = column.values
        result[name] = ((*axes, *column.dims[1:]), values, column.attrs)
    rows = {"cost": [one.cost for one in found.values()], curve.parameter: [one.value for one in found.values()]}
    for name, numbers in rows.items():
        values = np.full(shape, np.nan)
        values[at] = numbers
        result[name] = (tuple(axes), values)
    result[curve.parameter].attrs = PARAMETERS[curve.parameter]._asdict()
    result["cost"].attrs = {"units": "1", "long_name": "forcing periods of the map that the point took"}
    told = np.full(shape, "ok", dtype=object)
    for index, reason in status.items():
        told[index] = reason
    result["status"] = (tuple(axes), told.astype(str), {"long_name": "ok, or why there is no point"})
    met = _meetings(curve, axes, found)
    for name in (*axes, curve.parameter):
        units = PARAMETERS[name]._replace(long_name=f"{PARAMETERS[name].long_name} where two borders meet")._asdict()
        result[f"{name}_at_meeting"] = ("meeting", np.array([row[name] for row in met], dtype=float), units)
    names = np.array([row["meets"] for row in met], dtype=str)
    result["meets"] = ("meeting", names, {"long_name": "the two borders that meet"})
    fixed = {name: value for name, value in curve.given.items() if name not in (*axes, curve.parameter)}
    result.attrs = fixed | {
        "kind": curve.kind, "parameter": curve.parameter, "spin": curve.spin, "rtol": curve.rtol,
        "cost": curve.tape.spent.periods,
    }  # fmt: skip
    return result


def _empty(dtype: np.dtype) -> Any:
    return {"U": "", "b": False, "i": 0}.get(dtype.kind, np.nan)
