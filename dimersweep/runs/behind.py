"""Find the parameters and settings of the run behind a point of a cube, or say which of them the point lacks."""

import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import line_number, made_number, same_number, settings_in
from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.errors import ParameterError
from dimersweep.extensions import ATTRACTORS
from dimersweep.kernel.model.layout import ROW
from dimersweep.parameters import reduced, value_of, without_effect
from dimersweep.runs.solving import RunSettings
from dimersweep.symbols import ENDS, HIGHER, PARAMETERS, SETTINGS

AS_MADE = "take the point from the cube as it was made"
LOST_HERE = f"the point has lost it (where it was dropped, renamed, or put together with others); {AS_MADE}"


class PointSource(NamedTuple):
    """Parameters and settings from which a point of a cube was made.

    Attributes
    ----------
    parameters : dict of str to float
        Parameters of the run.
    how : RunSettings
    kernel : float
        Number of the version of the kernel, see `number_of`.
    line : Grid or None
        Line along which a state was carried to the point, in the order of its runs; None if no state was carried.
    place : int
        Number of the point on `line`.
    """

    parameters: dict[str, float]
    how: RunSettings
    kernel: float
    line: Grid | None
    place: int


def behind(point: xr.Dataset) -> PointSource:
    """Return the parameters and settings from which one point of a cube was made.

    Raises
    ------
    ParameterError
        If `point` is not one point, lacks a parameter or a setting, or has no run.
    """
    told, parameters = _settings_of(point), _parameters_at(point)
    how = RunSettings(
        int(told["periods"]), int(told["max_periods"]), told["rtol"], stop_when_settled=bool(told["stop_when_settled"])
    )
    line, place = _line_of(point, parameters, told["line"]) if "line" in told else (None, 0)
    return PointSource(_reduced(parameters), how, told["kernel"], line, place)


def parameters_of(point: xr.Dataset) -> dict[str, float]:
    """Return the parameters of the run behind one point of a cube, without parameters that change nothing (`reduced`).

    Raises
    ------
    ParameterError
        If `point` is not one point, or lacks a parameter.
    """
    return _reduced(_parameters_at(point))


def _reduced(told: dict[str, float]) -> dict[str, float]:
    """Return parameters without those that follow from others; raise `ParameterError` if one contradicts the others."""
    kept: dict[str, float] = reduced(told)
    # where the ends differ, the value of both ends is used by nothing, and may be anything
    unlike = {name for name in without_effect(kept) if len({kept[end] for end in ENDS[name]}) > 1}
    for name, value in told.items():
        if name not in unlike and {value_of(each, kept) for each in ENDS.get(name, (name,))} != {value}:
            raise ParameterError(f"{name} = {value:g}: is not that of the run of this point; {AS_MADE}")
    return kept


def _parameters_at(point: xr.Dataset) -> dict[str, float]:
    """Return all parameters that a point has; raise `ParameterError` if one is missing or comes from another cube."""
    told = {name: _value(point, name) for name in PARAMETERS if name in point.variables}
    if _tells_all(point):
        lost = [name for name in ROW if name not in told and name not in HIGHER]
    else:  # a cube of an earlier version has only the parameters that were given
        known = _configuration(point)
        given = {*known.get("grid", {}), *known.get("points", {}), *known.get("fixed", {})} - {"direction"}
        given |= {known["search"]["axis"]} if "search" in known else set()
        lost = [name for name in ROW if value_of(name, told) is None] + [*given - {*told}]
        if given and {*told} - given:
            raise ParameterError(f"{min({*told} - given)}: comes from another cube than this point; {AS_MADE}")
    if lost:
        raise ParameterError(f"{lost[0]}: {LOST_HERE}")
    if ATTRACTORS not in point["mode"].dims:
        _value(point, "mode")
    if "made_with" in point:
        varied = point["made_with"].attrs.get("varied", "").split()
        if not same_number(_value(point, "made_with"), made_number(point, varied)):
            raise ParameterError(f"made_with: parameters or settings at this point are not those of its run; {AS_MADE}")
    return told


def was_carried(point: xr.Dataset) -> bool:
    """Return True if a state was carried to a point of a cube."""
    return bool({"direction", "line"} & {*point.variables}) or "direction" in _configuration(point).get("grid", {})


def _tells_all(point: xr.Dataset) -> bool:
    """Return True if a point has the settings of its run, as points of this version have."""
    # `periods` does not count: a table of attractors has the periods of the motion by that name
    return bool({*SETTINGS} - {"periods"} & {*point.variables})


def _configuration(point: xr.Dataset) -> dict[str, Any]:
    """Return the configuration in the attributes of a cube, {} if there is none.

    It need not be that of a point in a cube that was put together from several.
    """
    known: dict[str, Any] = json.loads(point.attrs.get("configuration", "{}"))
    return known


def _value(point: xr.Dataset, name: str) -> float:
    """Return the one value of a coordinate or variable of a point; raise `ParameterError` if it has several, or NaN."""
    values = point.variables[name].values
    if values.size != 1:
        raise ParameterError(f"{name}: has {values.size} values; give one point, such as cube.sel({name}=...)")
    value = float(values.item())
    if np.isnan(value):
        found = "the search has found none here; give one"
        none = f"has no value at this point, which the cubes it is put together from do not have; {AS_MADE}"
        raise ParameterError(f"{name}: {found if 'answer' in point and name in point.data_vars else none}")
    return value


def _settings_of(point: xr.Dataset) -> dict[str, float]:
    """Return the settings of the run of a point, by the names of `SETTINGS`."""
    if not _tells_all(point):
        try:
            return settings_in(_configuration(point))
        except KeyError as error:
            raise ParameterError(f"{error.args[0]}: {LOST_HERE}") from None
    for name in SETTINGS:
        if name not in point.variables and (name != "line" or "direction" in point.variables):
            raise ParameterError(f"{name}: {LOST_HERE}")
    return {name: _value(point, name) for name in SETTINGS if name in point.variables}


def _line_of(point: xr.Dataset, parameters: dict[str, float], number: float) -> tuple[Grid, int]:
    """Return the line along which a state was carried to a point, and the place of the point on it.

    `number` is the `line` of the point; the line that the configuration describes must have the same.
    """
    if "direction" not in point.variables:
        raise ParameterError(f"direction: {LOST_HERE}")
    known = _configuration(point)
    if "direction" not in known.get("grid", {}) or not same_number(line_number(known), number):
        raise ParameterError(
            f"line: a state was carried to this point along other values than the cube tells; {AS_MADE}"
        )
    axis, values = list(known["grid"].items())[-1]
    fixed = {name: parameters[name] for name in (*known["grid"], *known["fixed"]) if name not in ("direction", axis)}
    along = values if DIRECTIONS[int(_value(point, "direction"))] == "up" else values[::-1]
    if parameters[axis] not in along:
        raise ParameterError(
            f"{axis} = {parameters[axis]}: is not on the line along which a state was carried; {AS_MADE}"
        )
    return Grid({axis: np.array(along)}, fixed), along.index(parameters[axis])
