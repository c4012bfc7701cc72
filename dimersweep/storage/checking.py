"""Check that a cube or a run that was read is one of this program, and is unchanged since it was written."""

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
    """Return the configuration of a cube or a run that was read, if it is one of this program, and intact.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset that was read.
    what : str
        Expected kind of the dataset: cube or run.
    path : Path
        Its path, for messages.
    noun : str
        Noun for a file of its format, for messages.

    Raises
    ------
    StoreError
        If it is of another kind or another version of the format, or its configuration was changed.
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
    """Return the error that refuses a file whose cube or run (`what`) was changed, or is incomplete.

    `why`, if it is not empty, stands in brackets at the end of the message.
    """
    then = "; sweep it again" if what == "cube" else ""
    return StoreError(f"{path}: is a {what} of dimersweep that was changed or is incomplete{why and f' ({why})'}{then}")


def checksum_of(cube: xr.Dataset) -> str:
    """Return the checksum of all variables of a cube; blocks of a lazy cube are read one by one.

    Raises
    ------
    StoreError
        If a value of a lazy cube is damaged.
    """
    checksum = Checksum(cube)
    for name, variable in cube.variables.items():
        for _, where in blocks(variable.shape):
            checksum.add(name, variable[where].values)
    return checksum.digest()


def soundness(cube: xr.Dataset) -> str:
    """Return whether a cube is as it was written, in a word: whole, part or changed.

    Returns
    -------
    str
        "whole"; "part" if a user has taken a part of it, or has added variables; else "changed": cut, transposed,
        moved, or in any value. Cubes of earlier versions have no checksum; their axes are compared with their
        configuration.

    Raises
    ------
    StoreError
        If a value of a lazy cube is damaged.
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
        If it is only a part, or was changed.
    """
    if soundness(cube) != "whole":
        raise StoreError(
            f"{path}: is a cube whose coordinates or values were changed since it was written; sweep it again"
        )


def check_configured(cube: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Refuse a cube whose configuration is that of other points.

    Such a cube is cut, or joined from several: xarray keeps the attributes of the first.

    Raises
    ------
    StoreError
        If the points differ; the message has the axes of the cube.
    """
    if not _has_declared_axes(cube):
        points = " x ".join(f"{name} ({n})" for name, n in cube["mode"].sizes.items()) or "one point"
        why = f"its configuration is that of other points than it has, {points}: it was cut, or put together of several"
        raise StoreError(f"{path}: {why}; give the cubes as they were made")


def _has_declared_axes(cube: xr.Dataset) -> bool:
    """Return True if a cube has the points of its configuration, in order, and all results of each point."""
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
