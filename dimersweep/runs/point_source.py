"""Find the parameters and settings of the run behind a point of a cube, or say which of them the point lacks."""

import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import line_number, same_number, settings_in, settings_number
from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.errors import ParameterError
from dimersweep.extensions import ATTRACTORS
from dimersweep.kernel.model.layout import ROW
from dimersweep.parameters import reduced, value_of, without_effect
from dimersweep.runs.solving import RunSettings
from dimersweep.symbols import ENDS, HIGHER, PARAMETERS, SETTINGS

TAKE_WHOLE = "take the point from the cube as it was made"
MISSING_HERE = f"the point has lost it (where it was dropped, renamed, or put together with others); {TAKE_WHOLE}"


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


def source_of(point: xr.Dataset) -> PointSource:
    """Return the parameters and settings from which one point of a cube was made.

    Raises
    ------
    ParameterError
        If `point` is not one point, lacks a parameter or a setting, or has no run.
    """
    settings, parameters = _settings_of(point), _parameters_at(point)
    how = RunSettings(
        int(settings["periods"]),
        int(settings["max_periods"]),
        settings["rtol"],
        stop_when_settled=bool(settings["stop_when_settled"]),
    )
    line, place = _line_of(point, parameters, settings["line"]) if "line" in settings else (None, 0)
    return PointSource(_reduced(parameters), how, settings["kernel"], line, place)


def parameters_of(point: xr.Dataset) -> dict[str, float]:
    """Return the parameters of the run behind one point of a cube, without parameters that change nothing (`reduced`).

    Raises
    ------
    ParameterError
        If `point` is not one point, or lacks a parameter.
    """
    return _reduced(_parameters_at(point))


def _reduced(parameters: dict[str, float]) -> dict[str, float]:
    """Return parameters without those that follow from others; raise `ParameterError` if one contradicts the others."""
    kept: dict[str, float] = reduced(parameters)
    # where the ends differ, the value of both ends is used by nothing, and may be anything
    unlike = {name for name in without_effect(kept) if len({kept[end] for end in ENDS[name]}) > 1}
    for name, value in parameters.items():
        if name not in unlike and {value_of(each, kept) for each in ENDS.get(name, (name,))} != {value}:
            raise ParameterError(f"{name} = {value:g}: is not that of the run of this point; {TAKE_WHOLE}")
    return kept


def _parameters_at(point: xr.Dataset) -> dict[str, float]:
    """Return all parameters that a point has; raise `ParameterError` if one is missing or comes from another cube."""
    parameters = {name: _value(point, name) for name in PARAMETERS if name in point.variables}
    if _tells_all(point):
        missing = [name for name in ROW if name not in parameters and name not in HIGHER]
    else:  # a cube of an earlier version has only the parameters that were given
        known = _configuration(point)
        given = {*known.get("grid", {}), *known.get("points", {}), *known.get("fixed", {})} - {"direction"}
        given |= {known["search"]["axis"]} if "search" in known else set()
        missing = [name for name in ROW if value_of(name, parameters) is None] + [*given - {*parameters}]
        if given and {*parameters} - given:
            raise ParameterError(f"{min({*parameters} - given)}: comes from another cube than this point; {TAKE_WHOLE}")
    if missing:
        raise ParameterError(f"{missing[0]}: {MISSING_HERE}")
    if ATTRACTORS not in point["mode"].dims:
        _value(point, "mode")
    if "made_with" in point:
        varied = point["made_with"].attrs.get("varied", "").split()
        if not same_number(_value(point, "made_with"), settings_number(point, varied)):
            raise ParameterError(
                f"made_with: parameters or settings at this point are not those of its run; {TAKE_WHOLE}"
            )
    return parameters


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
        none = f"has no value at this point, which the cubes it is put together from do not have; {TAKE_WHOLE}"
        raise ParameterError(f"{name}: {found if 'answer' in point and name in point.data_vars else none}")
    return value


def _settings_of(point: xr.Dataset) -> dict[str, float]:
    """Return the settings of the run of a point, by the names of `SETTINGS`."""
    if not _tells_all(point):
        try:
            return settings_in(_configuration(point))
        except KeyError as error:
            raise ParameterError(f"{error.args[0]}: {MISSING_HERE}") from None
    for name in SETTINGS:
        if name not in point.variables and (name != "line" or "direction" in point.variables):
            raise ParameterError(f"{name}: {MISSING_HERE}")
    return {name: _value(point, name) for name in SETTINGS if name in point.variables}


def _line_of(point: xr.Dataset, parameters: dict[str, float], number: float) -> tuple[Grid, int]:
    """Return the line along which a state was carried to a point, and the place of the point on it.

    `number` is the `line` of the point; the line that the configuration describes must have the same.
    """
    if "direction" not in point.variables:
        raise ParameterError(f"direction: {MISSING_HERE}")
    known = _configuration(point)
    if "direction" not in known.get("grid", {}) or not same_number(line_number(known), number):
        raise ParameterError(
            f"line: a state was carried to this point along other values than the cube tells; {TAKE_WHOLE}"
        )
    axis, values = list(known["grid"].items())[-1]
    fixed = {name: parameters[name] for name in (*known["grid"], *known["fixed"]) if name not in ("direction", axis)}
    along = values if DIRECTIONS[int(_value(point, "direction"))] == "up" else values[::-1]
    if parameters[axis] not in along:
        raise ParameterError(
            f"{axis} = {parameters[axis]}: is not on the line along which a state was carried; {TAKE_WHOLE}"
        )
    return Grid({axis: np.array(along)}, fixed), along.index(parameters[axis])
