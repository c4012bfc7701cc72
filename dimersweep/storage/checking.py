"""Whether what was read is the program's, and still as it was written: its configuration, its coordinates and its values."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.grid import finer
from dimersweep.errors import StoreError, one_line
from dimersweep.kernel.model.layout import CODES, OUT
from dimersweep.storage.blocks import blocks
from dimersweep.storage.provenance import CHECKSUM, FILE_FORMAT, digest, read_configuration
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
    text = dataset.attrs.get("configuration", "")
    try:
        if digest(text) == dataset.attrs.get("configuration_sha256"):
            return read_configuration(text)
    except (ValueError, TypeError, AttributeError) as error:
        raise changed(what, path, one_line(error)) from error
    raise changed(what, path)


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


def check_unchanged(cube: xr.Dataset, path: str | Path) -> None:
    """Refuse a cube that was cut, turned, moved or changed in any value since it was written to `path`.

    Of one that an earlier version has written, without a checksum, the axes are compared with its configuration.

    Raises
    ------
    StoreError
        If it was, or a value is damaged.
    """
    found, written = checksum_of(cube), cube.attrs.get(CHECKSUM)
    if written != found and (written is not None or not _has_declared_axes(cube)):
        raise StoreError(
            f"{path}: is a cube whose coordinates or values were changed since it was written; sweep it again"
        )


def check_undamaged(cube: xr.Dataset, path: str | Path) -> None:
    """Refuse a cube in memory that has all its points, but other values than were written to `path`.

    A part of a cube that its user has saved, or one with variables of the user's, has no checksum of its own.

    Raises
    ------
    StoreError
        If its checksum is not that of its values.
    """
    if CHECKSUM in cube.attrs and is_whole(cube) and checksum_of(cube) != cube.attrs[CHECKSUM]:
        raise StoreError(
            f"{path}: is damaged, or values were changed on purpose; without its attribute {CHECKSUM} it would be read as it is"
        )


def is_whole(cube: xr.Dataset) -> bool:
    """Whether a cube has the points that its configuration tells, and no variables of its user's."""
    return set(cube.variables) <= {*PARAMETERS, *QUANTITIES, *SETTINGS, "point"} and _has_declared_axes(cube)


def _has_declared_axes(cube: xr.Dataset) -> bool:
    """Whether a cube has the points that its configuration tells, in their order, and a result of each kind there."""
    configuration = read_configuration(cube.attrs["configuration"])
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
