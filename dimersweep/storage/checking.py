"""Whether a cube is still the one that was written: its coordinates and its values, in their order."""

from pathlib import Path

import numpy as np
import xarray as xr

from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.grid import finer
from dimersweep.errors import StoreError
from dimersweep.kernel.model.layout import CODES, OUT
from dimersweep.storage.blocks import blocks
from dimersweep.storage.provenance import CHECKSUM, read_configuration
from dimersweep.symbols import PARAMETERS, QUANTITIES, SETTINGS


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
