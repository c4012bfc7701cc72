"""A cube made again from its provenance: the declaration that it tells to have come from."""

import json
import os
from collections.abc import Mapping
from typing import Any

import xarray as xr

from dimersweep.cubes.grid import without_directions
from dimersweep.errors import StoreError, one_line
from dimersweep.storage.cubefiles import open_cube
from dimersweep.storage.provenance import differences
from dimersweep.studies.declaration import Declaration

MADE_BY = ("source", "git_commit", "python", "numpy", "numba", "llvmlite", "cpu")


def from_cube(path: str | os.PathLike[str], *, other_kernel: bool = False) -> Declaration:
    """The declaration that gives the cube at `path` again, from what the cube tells of itself.

    Parameters
    ----------
    path : path-like
    other_kernel : bool
        Whether the cube may come from another kernel than this program's, or be configured in ways that it does not
        know.

    Returns
    -------
    Declaration

    Raises
    ------
    StoreError
        If there is no such cube, or it comes from another kernel; with the versions that made it.
    """
    cube = open_cube(path)
    configuration = json.loads(cube.attrs["configuration"])
    try:
        declaration = _declared(cube, configuration, path)
    except (KeyError, TypeError, ValueError, AttributeError) as error:  # a ValidationError is a ValueError
        raise StoreError(f"{path}: tells a configuration that this version does not know ({one_line(error)})") from None
    changes = differences(configuration, declaration.study().configuration())
    if changes and not other_kernel:
        made_by = ", ".join(f"{name} {cube.attrs.get(name, 'unknown')}" for name in MADE_BY)
        raise StoreError(
            f"{path}: was made by another version, so its numbers may differ in the last digits; install that one "
            f"({made_by}), or go on with other_kernel=True. What differs:" + "".join(f"\n  {line}" for line in changes)
        )
    return declaration


def _declared(cube: xr.Dataset, configuration: Mapping[str, Any], path: str | os.PathLike[str]) -> Declaration:
    """The declaration of a sweep, a search or a refined map with this configuration."""
    sweep: dict[str, Any] = {name: configuration[name] for name in ("periods", "rtol")}
    sweep |= {"title": cube.attrs["title"], "max_periods": configuration.get("max_periods"), "output": str(path)}
    given: dict[str, Any] = {"fixed": configuration["fixed"], "plot": {"kind": cube.attrs.get("plot", "mode_map")}}
    if "search" in configuration:
        asked = dict(configuration["search"])
        over, values = asked.pop("axis"), asked.pop("values")
        given |= {"grid": configuration["grid"] | {over: values}, "search": asked | {"over": over}}
        given |= {name: configuration[name] for name in ("refine", "paths") if name in configuration}
    else:
        sweep["stop_when_settled"] = configuration["stop_when_settled"]
        sweep |= {name: configuration[name] for name in ("certify", "strobes") if name in configuration}
        given["grid"], sweep["carry"] = without_directions(configuration.get("grid"))
        given |= {"points": {"columns": configuration["points"]}} if "points" in configuration else {}
    return Declaration.model_validate(given | {"sweep": sweep})
