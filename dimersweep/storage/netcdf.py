"""Cubes on disk: written whole or not at all, never over another file unasked, and checked when they are opened."""

import json
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.files import sync, told
from dimersweep.storage.provenance import digest
from dimersweep.storage.zarr import is_zarr, read_zarr

PART_BYTES = 1 << 26  # of a cube, that are written at once
CUBES = (".nc", ".zarr")


def check_writable(path: str | os.PathLike[str], *, force: bool = False, name: str = "out") -> Path:
    """Refuse an output that could not be written, before any work is done.

    Parameters
    ----------
    path : path-like
        The file to be.
    force : bool
        Whether it may replace an existing file.
    name : str
        What the message calls it.

    Returns
    -------
    Path

    Raises
    ------
    StoreError
        If it exists, or its folder does not, or nothing can be created there; and, `force` or not, if it is a link, a
        device or anything else that is no file (or no Zarr group, for a name that ends in .zarr).
    """
    path = Path(path)
    wrong = _no_output(path)
    if wrong:
        raise StoreError(f"{name} = {path}: {wrong}")
    if not path.parent.is_dir():
        raise StoreError(f"{name} = {path}: the folder {path.parent} does not exist")
    if path.exists() and not force:
        raise StoreError(f"{name} = {path}: exists already; give another name, or force it to be replaced (force=True)")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise StoreError(f"{name} = {path}: the folder {path.parent} is not writable ({error.strerror})") from None
    return path


def _no_output(path: Path) -> str:
    """Why `path` cannot be replaced by a file, or a Zarr group, whoever allows it; "" if it can."""
    try:
        kind = os.lstat(path).st_mode
    except FileNotFoundError:
        return ""
    except (OSError, ValueError) as error:  # too long, with a NUL, below a file
        return f"cannot be a file ({getattr(error, 'strerror', None) or error})"
    if stat.S_ISLNK(kind):
        return f"is a link to {os.readlink(path)}; give the name of the file itself"
    if stat.S_ISDIR(kind) and not is_zarr(path):
        return "is a folder; give a file name"
    if stat.S_ISDIR(kind):
        foreign = any(path.iterdir()) and not (path / "zarr.json").is_file()
        return "is a folder, but no Zarr group; give another name" if foreign else ""
    if not stat.S_ISREG(kind):
        return "is no regular file; give another name"
    return "is a file, where a Zarr group is a folder; give another name" if is_zarr(path) else ""


def _parts(cube: xr.Dataset) -> Iterator[xr.Dataset]:
    """`cube` in parts of a few variables: xarray holds a copy of all that it writes at once."""
    names: list[Any] = []
    size = 0
    for name, variable in cube.data_vars.items():
        if names and size + variable.nbytes > PART_BYTES:
            yield cube[names]
            names, size = [], 0
        names.append(name)
        size += variable.nbytes
    yield cube[names]


def check_output(path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Refuse an output of a sweep that could not be written, or whose ending promises another format.

    Raises
    ------
    ParameterError
        If it ends in neither .nc nor .zarr.
    StoreError
        As by `check_writable`.
    """
    if Path(path).suffix not in CUBES:
        raise ParameterError(f"out = {path}: a cube must end in {' or '.join(CUBES)}")
    return check_writable(path, force=force)


def write_cube(
    cube: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    scratch: Path | None = None,
    kept: str = "",
) -> None:
    """Write `cube` as NetCDF-4: to a temporary file, which then takes the name `path` in one step.

    Must be called in the thread that does all NetCDF work, as netCDF-C is not thread-safe.

    Parameters
    ----------
    cube : xarray.Dataset
    path : path-like
    force : bool
        Whether it may replace an existing file.
    scratch : Path, optional
        The temporary file, on the same disk; beside `path` by default.
    kept : str
        What the message of an error tells of results that are not lost.

    Raises
    ------
    StoreError
        If the file exists and `force` is not given, or the disk refuses.
    """
    path = check_writable(path, force=force)
    temporary = scratch or path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with told(f"out = {path}", kept):
            temporary.unlink(missing_ok=True)
            for number, part in enumerate(_parts(cube)):
                part.to_netcdf(temporary, mode="a" if number else "w", engine="netcdf4", format="NETCDF4")
            sync(temporary)
            temporary.replace(path)
            sync(path.parent)  # the new name must outlive a power cut too
    finally:
        temporary.unlink(missing_ok=True)


def open_cube(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a cube that `sweep` wrote.

    Parameters
    ----------
    path : path-like
        A NetCDF file, which is read whole into memory and closed; or a folder that ends in .zarr, of which values are
        read, and their checksums tested, when they are used.

    Returns
    -------
    xarray.Dataset
        As it was returned by `sweep`.

    Raises
    ------
    StoreError
        If there is no such file, it is no NetCDF file or Zarr group, or no (intact) cube of this program.
    """
    path = Path(path)
    if os.path.isdir(path) and is_zarr(path):
        cube, kind = read_zarr(path), "Zarr group"
    else:
        cube, kind = read_netcdf(path), "NetCDF file"
    if "dimersweep_cube" not in cube.attrs:
        raise StoreError(f"{path}: is a {kind}, but no cube of dimersweep")
    text = cube.attrs.get("configuration", "")
    intact = digest(text) == cube.attrs.get("configuration_sha256") and "mode" in cube
    if not intact or not _fixed_as_told(cube, json.loads(text)):
        raise StoreError(f"{path}: is a cube of dimersweep that was changed or is incomplete; sweep it again")
    return cube


def _fixed_as_told(cube: xr.Dataset, configuration: Mapping[str, Any]) -> bool:
    """Whether the fixed parameters are those of the configuration: single values have no checksum of their own."""
    fixed = configuration.get("fixed", {})
    return all(bool((cube[name] == value).all()) for name, value in fixed.items() if name in cube.coords)


def read_netcdf(path: Path) -> xr.Dataset:
    """A NetCDF file, whole, in memory.

    Raises
    ------
    StoreError
        If there is none, or it is no NetCDF file, or damaged.
    """
    if os.path.isdir(path):
        raise StoreError(f"{path}: is a folder; give a NetCDF file, or a folder that ends in .zarr")
    if not os.path.isfile(path):  # a name that no file can have is no error for it
        raise StoreError(f"{path}: no such file")
    try:
        return xr.load_dataset(path, engine="netcdf4")
    except (OSError, ValueError, RuntimeError, AttributeError) as error:  # the last one of an attribute that is damaged
        raise StoreError(f"{path}: is no NetCDF file, or a damaged one ({error})") from error
