"""Whether what was read is the program's, and still as it was written: its configuration, its coordinates and its values."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.grid import finer
from dimersweep.errors import StoreError, one_line
from dimersweep.kernel.model.layout import CODES, OUT
from dimersweep.storage.blocks import blocks
from dimersweep.storage.provenance import CHECKSUM, FILE_FORMAT, configuration_in
from dimersweep.symbols import PARAMETERS, QUANTITIES, SETTINGS


def configuration_of(dataset: xr.Dataset, what: str, path: Path, noun: str = "NetCDF file") -> dict[str, Any]:
    """The configuration of a cube or a run that was read, if it is one of this program's, and intact.

    Parameters
    ----------
    dataset : xarray.Dataset
    what : str
        What it is to be: cube or run.
    path : Path
    noun : str
        What it is otherwise.

    Raises
    ------
    StoreError
        If it is another thing, of another format, or its configuration was changed.
    """
    version = dataset.attrs.get(f"dimersweep_{what}")
    if version is None:
        raise StoreError(f"{path}: is a {noun}, but no {what} of dimersweep")
    if str(version) != FILE_FORMAT:
        raise StoreError(
            f"{path}: is a {what} of format {version}; this version of dimersweep reads format {FILE_FORMAT}"
        )
    try:
        return configuration_in(dataset.attrs)
    except ValueError as error:
        raise changed(what, path, one_line(error)) from error


def changed(what: str, path: Path, why: str = "") -> StoreError:
    """The error for a cube or a run that is no longer as it was written."""
    then = "; sweep it again" if what == "cube" else ""
    return StoreError(f"{path}: is a {what} of dimersweep that was changed or is incomplete{why and f' ({why})'}{then}")


def checksum_of(cube: xr.Dataset) -> str:
    """The checksum of all variables of a cube; of a lazy one each block is read once, and none is kept.

    Raises
    ------
    StoreError
        If a value of a lazy one is damaged.
    """
    checksum = Checksum(cube)
    for name, variable in cube.variables.items():
        for _, where in blocks(variable.shape):
            checksum.add(name, variable[where].values)
    return checksum.digest()


def soundness(cube: xr.Dataset) -> str:
    """Whether a cube is as it was written.

    Returns
    -------
    str
        whole; a part, if its user has taken one, or has added variables; else changed: cut, turned, moved, or in any value. Of
        one without a checksum, as earlier versions have written them, the axes are compared with its configuration.

    Raises
    ------
    StoreError
        If a value of a lazy one is damaged.
    """
    complete, written = _has_declared_axes(cube), cube.attrs.get(CHECKSUM)
    if written is None:
        return "whole" if complete else "part"
    if checksum_of(cube) == written:
        return "whole"
    observed = configuration_in(cube.attrs).get("observe", {}).get("variables", ()) if complete else ()
    ours = {*PARAMETERS, *QUANTITIES, *SETTINGS, *observed, "point"}
    return "changed" if complete and set(cube.variables) <= ours else "part"


def check_unchanged(cube: xr.Dataset, path: str | Path) -> None:
    """Refuse a cube that is not as it was written to `path`.

    Raises
    ------
    StoreError
    """
    if soundness(cube) != "whole":
        raise StoreError(
            f"{path}: is a cube whose coordinates or values were changed since it was written; sweep it again"
        )


def check_configured(cube: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Refuse a cube whose configuration is that of other points, as xarray keeps the first one's of several cubes.

    Raises
    ------
    StoreError
    """
    if not _has_declared_axes(cube):
        points = " x ".join(f"{name} ({n})" for name, n in cube["mode"].sizes.items()) or "one point"
        why = f"its configuration is that of other points than it has, {points}: it was cut, or put together of several"
        raise StoreError(f"{path}: {why}; give the cubes as they were made")


def _has_declared_axes(cube: xr.Dataset) -> bool:
    """Whether a cube has the points that its configuration tells, in their order, and a result of each kind there."""
    try:
        configuration = configuration_in(cube.attrs)
    except ValueError:
        return False
    halvings = configuration.get("refine", {}).get("halvings", {})
    axes = {
        name: finer(np.array(values), halvings.get(name, 0)) for name, values in configuration.get("grid", {}).items()
    }
    columns = configuration.get("points", {})
    return (
        {*OUT, *CODES, *axes, *columns} <= set(cube.variables)
        and cube["mode"].dims == (tuple(axes) or ("point",))
        and all(np.array_equal(cube[name], values) for name, values in (axes | columns).items())
    )
