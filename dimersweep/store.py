"""Cubes on disk: written whole or not at all, never over another file unasked, and checked when they are opened."""

import os
import tempfile
from pathlib import Path

import xarray as xr

from dimersweep.errors import StoreError
from dimersweep.provenance import digest


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
        If it exists, or its folder does not, or nothing can be created there.
    """
    path = Path(path)
    if path.is_dir():
        raise StoreError(f"{name} = {path}: is a folder; give a file name")
    if not path.parent.is_dir():
        raise StoreError(f"{name} = {path}: the folder {path.parent} does not exist")
    if path.exists() and not force:
        raise StoreError(f"{name} = {path}: exists already; give another name, or force it to be replaced (--force)")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise StoreError(f"{name} = {path}: the folder {path.parent} is not writable ({error.strerror})") from None
    return path


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_cube(cube: xr.Dataset, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write `cube` as NetCDF-4: to a temporary file beside `path`, which then takes its name in one step.

    Must be called in the thread that does all NetCDF work, as netCDF-C is not thread-safe.

    Raises
    ------
    StoreError
        If the file exists and `force` is not given, or the disk refuses.
    """
    path = check_writable(path, force=force)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        cube.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
        _sync(temporary)
        temporary.replace(path)
        _sync(path.parent)  # the new name must outlive a power cut too
    except (OSError, RuntimeError) as error:  # netCDF-C reports a full disk as a RuntimeError
        raise StoreError(f"out = {path}: could not be written ({error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def open_cube(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a cube that `sweep` wrote, whole into memory, and close its file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    xarray.Dataset
        As it was returned by `sweep`.

    Raises
    ------
    StoreError
        If there is no such file, it is no NetCDF file, or no (intact) cube of this program.
    """
    path = Path(path)
    if not path.is_file():
        raise StoreError(f"{path}: no such file")
    try:
        cube = xr.load_dataset(path, engine="netcdf4")
    except (OSError, ValueError, RuntimeError) as error:
        raise StoreError(f"{path}: is no NetCDF file, or a damaged one ({error})") from error
    if "dimersweep_cube" not in cube.attrs:
        raise StoreError(f"{path}: is a NetCDF file, but no cube of dimersweep")
    if digest(cube.attrs.get("configuration", "")) != cube.attrs.get("configuration_sha256") or "mode" not in cube:
        raise StoreError(f"{path}: is a cube of dimersweep that was changed or is incomplete; sweep it again")
    return cube
