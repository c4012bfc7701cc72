"""Write cubes, whole or not at all, and open them, with checks against damage and changes."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from operator import eq
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import FLAGS, check_codes, check_flags, same_number, settings_in
from dimersweep.cubes.grid import MAX_POINTS
from dimersweep.errors import StoreError
from dimersweep.extensions import ATTRACTORS, ORBITS
from dimersweep.kernel.model.layout import MODES
from dimersweep.parameters import completed
from dimersweep.storage.blocks import blocks
from dimersweep.storage.checking import changed, configuration_of, soundness
from dimersweep.storage.files import disk_errors
from dimersweep.storage.formats import FORMATS, format_at, format_of
from dimersweep.storage.outputs import check_output
from dimersweep.storage.provenance import CHECKSUM
from dimersweep.symbols import SETTINGS


def write_cube(
    cube: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    scratch: Path | None = None,
    kept: str = "",
) -> None:
    """Write a dataset in memory to `path`, in the format of the ending, in one step.

    Parameters
    ----------
    cube : xarray.Dataset
        Dataset in memory.
    path : path-like
        File to write.
    force : bool
        If True, an existing file may be replaced.
    scratch : Path, optional
        Temporary path, see `replacing`.
    kept : str
        Advice at the end of an error message, on results that are kept.

    Raises
    ------
    StoreError
        If the file exists and `force` is False, or the disk refuses.
    """
    path = check_output(path, force=force, endings=None)
    write = format_of(path).write
    assert write is not None
    with disk_errors(f"out = {path}", kept):
        write(cube, path, scratch)


def open_cube(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a cube that `sweep` wrote.

    Parameters
    ----------
    path : path-like
        A NetCDF file, which is read whole into memory and closed; or a folder that ends in .zarr, of which values are
        read, and their checksums tested, when they are used.

    Returns
    -------
    xarray.Dataset
        The cube, as `sweep` returned it.

    Raises
    ------
    StoreError
        If there is no such file, it is no NetCDF file or Zarr group, or no (intact) cube of this program. Of a Zarr
        group also later, when a value that is damaged is used.

    Examples
    --------
    >>> from dimersweep import open_cube, sweep
    >>> cube = sweep({"Gamma": [0.6, 0.9]}, periods=60, progress=False, out="two.nc")
    >>> open_cube("two.nc").identical(cube)
    True
    """
    if not isinstance(path, str | os.PathLike):
        raise StoreError(f"{path!r}: is no path")
    path = Path(path)
    with _opened(path) as cube:
        if format_at(path).write_blocks:
            return cube
        if cube.sizes and cube["mode"].size > MAX_POINTS:
            raise StoreError(f"{path}: has {cube['mode'].size} points; a NetCDF cube may have {MAX_POINTS}")
        cube.load()
        for name in set(FLAGS) & set(cube.variables):
            check_flags(name, cube[name].values)
        if soundness(cube) == "changed":
            read = f"without its attribute {CHECKSUM} it would be read as it is"
            raise StoreError(f"{path}: is damaged, or values were changed on purpose; {read}")
        return cube


def open_result(path: Path) -> xr.Dataset:
    """Open a cube, see `open_cube`, or a table of attractors or orbits; these are recognised by their columns.

    Raises
    ------
    StoreError
        If the file is neither a cube nor such a table.
    """
    with format_at(path).opened(path) as data:
        if {ATTRACTORS, ORBITS} & {*data.variables}:
            return data.load()
    return open_cube(path)


def count_modes(path: str | os.PathLike[str]) -> dict[str, int]:
    """Return the number of points in each mode of the cube at `path`, which is read block by block.

    Raises
    ------
    StoreError
        As by `open_cube`.
    """
    with _opened(Path(path)) as cube:
        return modes_in(cube)


def modes_in(cube: xr.Dataset) -> dict[str, int]:
    """Return the number of points of `cube` in each mode, the most frequent first; read a lazy cube by blocks."""
    counts = np.zeros(len(MODES), dtype=np.int64)
    for _, where in blocks(cube["mode"].shape):
        values = cube["mode"][where].values.ravel()
        check_flags("mode", values)
        counts += np.bincount(values, minlength=len(MODES))
    return {MODES[code]: int(counts[code]) for code in np.argsort(-counts, kind="stable") if counts[code]}


@contextmanager
def _opened(path: Path) -> Iterator[xr.Dataset]:
    """Open the cube at `path`, check its configuration and codes; values are still to be read."""
    found = format_at(path)
    if os.path.isdir(path) and not found.marker:
        folders = " or ".join(each.ending for each in FORMATS.values() if each.marker)
        raise StoreError(f"{path}: is a folder; give a NetCDF file, or a folder that ends in {folders}")
    with found.opened(path) as cube:
        configuration = configuration_of(cube, "cube", path, found.noun)
        try:
            intact = "mode" in cube and set(configuration.get("grid", {})) <= set(cube.dims)
            intact = intact and _fixed_as_configured(cube, configuration)
            for name in set(FLAGS) & set(cube.variables):
                check_codes(cube[name])
        except StoreError as error:
            raise StoreError(f"{path}: {error}") from None
        except (ValueError, TypeError, AttributeError):
            intact = False
        if not intact:
            raise changed("cube", path)
        yield cube


def _fixed_as_configured(cube: xr.Dataset, configuration: Mapping[str, Any]) -> bool:
    """Return True if single values are as the configuration says: they have no checksum of their own."""
    varied = {*configuration.get("grid", {}), *configuration.get("points", {})}
    single = {name for name in cube.coords if not cube.variables[name].ndim} - varied
    settings = completed(configuration.get("fixed", {})) | (settings_in(configuration) if single & {*SETTINGS} else {})
    compare = dict.fromkeys(("kernel", "line"), same_number)
    return all(
        compare.get(name, eq)(cube.variables[name].values.item(), value)
        for name, value in settings.items()
        if name in single
    )
