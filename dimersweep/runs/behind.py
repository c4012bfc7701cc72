"""What made a point of a cube: its parameters and how its run was made, or what the point has lost of these."""

import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import line_number, made_number, same_number, settings_in
from dimersweep.cubes.grid import DIRECTIONS, Grid
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import ROW
from dimersweep.parameters import reduced, value_of, without_effect
from dimersweep.runs.solving import RunSettings
from dimersweep.symbols import ENDS, HIGHER, PARAMETERS, SETTINGS

AS_MADE = "take the point from the cube as it was made"
LOST_HERE = f"the point has lost it (where it was dropped, renamed, or put together with others); {AS_MADE}"


class Behind(NamedTuple):
    """What made a point of a cube.

    Attributes
    ----------
    parameters : dict of str to float
        Of its run.
    how : RunSettings
    kernel : float
        See `number_of`.
    line : Grid or None
        Where a state was carried to it: that line, in the order of its runs.
    place : int
        Of the point on it.
    """

    parameters: dict[str, float]
    how: RunSettings
    kernel: float
    line: Grid | None
    place: int


def behind(point: xr.Dataset) -> Behind:
    """What made one point of a cube.

    Raises
    ------
    ParameterError
        If it is not one point, has lost some of what made it, or has no run.
    """
    told, parameters = _settings_of(point), _parameters_at(point)
    how = RunSettings(
        int(told["periods"]), int(told["max_periods"]), told["rtol"], stop_when_settled=bool(told["stop_when_settled"])
    )
    line, place = _line_of(point, parameters, told["line"]) if "line" in told else (None, 0)
    return Behind(_reduced(parameters), how, told["kernel"], line, place)


def parameters_of(point: xr.Dataset) -> dict[str, float]:
    """The parameters of the run behind one point of a cube, without those that are as they would be if left out.

    Raises
    ------
    ParameterError
        See `behind`.
    """
    return _reduced(_parameters_at(point))


def _reduced(told: dict[str, float]) -> dict[str, float]:
    """Return parameters without those that follow from others; raise `ParameterError` if one of these says another thing."""
    kept: dict[str, float] = reduced(told)
    # beside unlike ends the value of both stands for nothing
    unlike = {name for name in without_effect(kept) if len({kept[end] for end in ENDS[name]}) > 1}
    for name, value in told.items():
        if name not in unlike and {value_of(each, kept) for each in ENDS.get(name, (name,))} != {value}:
            raise ParameterError(f"{name} = {value:g}: is not that of the run of this point; {AS_MADE}")
    return kept


def _parameters_at(point: xr.Dataset) -> dict[str, float]:
    """All parameters that a point tells."""
    told = {name: _value(point, name) for name in PARAMETERS if name in point.variables}
    if _tells_all(point):
        lost = [name for name in ROW if name not in told and name not in HIGHER]
    else:  # a cube of an earlier version tells those alone that were given
        known = _configuration(point)
        given = {*known.get("grid", {}), *known.get("points", {}), *known.get("fixed", {})} - {"direction"}
        given |= {known["search"]["axis"]} if "search" in known else set()
        lost = [name for name in ROW if value_of(name, told) is None] + [*given - {*told}]
        if given and {*told} - given:
            raise ParameterError(f"{min({*told} - given)}: comes from another cube than this point; {AS_MADE}")
    if lost:
        raise ParameterError(f"{lost[0]}: {LOST_HERE}")
    if "attractor" not in point["mode"].dims:
        _value(point, "mode")
    if "made_with" in point:
        varied = point["made_with"].attrs.get("varied", "").split()
        if not same_number(_value(point, "made_with"), made_number(point, varied)):
            raise ParameterError(f"made_with: parameters or settings at this point are not those of its run; {AS_MADE}")
    return told


def was_carried(point: xr.Dataset) -> bool:
    """Whether a state was carried to a point of a cube."""
    return bool({"direction", "line"} & {*point.variables}) or "direction" in _configuration(point).get("grid", {})


def _tells_all(point: xr.Dataset) -> bool:
    return bool({*SETTINGS} - {"periods"} & {*point.variables})  # of attractors, those of the motion


def _configuration(point: xr.Dataset) -> dict[str, Any]:
    """What the attributes tell of a cube that was made so; none of a point of cubes that were put together, for certain."""
    known: dict[str, Any] = json.loads(point.attrs.get("configuration", "{}"))
    return known


def _value(point: xr.Dataset, name: str) -> float:
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
    """How the run of a point was made, by the names of `SETTINGS`."""
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
    """The line along which a state was carried to a point, and its place there."""
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
