"""Cubes on disk: written whole or not at all, never over another file unasked, and checked when they are opened."""

import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import NetCDF4DataStore
from xarray.backends.locks import HDF5_LOCK, NETCDFC_LOCK, DummyLock, combine_locks

from dimersweep.cubes.cube import FLAGS, check_codes, check_flags
from dimersweep.cubes.grid import MAX_POINTS
from dimersweep.errors import ParameterError, StoreError
from dimersweep.kernel.model.layout import MODES
from dimersweep.storage.files import replacing, told
from dimersweep.storage.provenance import CUBE_FORMAT, digest, read_configuration
from dimersweep.storage.zarr import blocks, is_zarr, read_zarr

PART_BYTES = 1 << 26  # of a cube, that are written at once
CUBES, TABLES = (".nc", ".zarr"), (".nc",)  # of sweeps; of single runs, borders, branches and families
DEFLATED = 1100  # zlib makes nothing smaller by more than this
# netCDF-C and HDF5 bear one thread at a time; xarray's own files wait for the same locks, taken in the same order
ONE_THREAD = combine_locks([NETCDFC_LOCK, HDF5_LOCK])


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
    wrong, shown = _no_output(path), _shown(path)
    if wrong:
        raise StoreError(f"{name} = {shown}: {wrong}")
    if not path.parent.is_dir():
        raise StoreError(f"{name} = {shown}: the folder {_shown(path.parent)} does not exist")
    if path.exists() and not force:
        raise StoreError(
            f"{name} = {shown}: exists already; give another name, or force it to be replaced (force=True)"
        )
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise StoreError(
            f"{name} = {shown}: the folder {_shown(path.parent)} is not writable ({error.strerror})"
        ) from None
    return path


def _shown(path: str | os.PathLike[str]) -> str:
    """A path as a message shows it: none and signs that a terminal would take for its own are seen."""
    text = str(path)
    return text if text and text.isprintable() else repr(text)


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


def check_ending(path: str, *, name: str = "out", what: str = "a cube", endings: tuple[str, ...] = CUBES) -> str:
    """`path`, if its ending is one of `endings`.

    Raises
    ------
    ParameterError
        If it is not: the ending would promise another format.
    """
    if Path(path).suffix not in endings:
        *others, last = endings
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise ParameterError(f"{name} = {_shown(path)}: {what} must end in {allowed}")
    return path


def check_output(
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    name: str = "out",
    what: str = "a cube",
    endings: tuple[str, ...] = CUBES,
) -> Path:
    """Refuse an output that could not be written, or whose ending promises another format, before any work is done.

    Each kind of output has endings of its own (`CUBES`, `TABLES`, and those of pictures, movies and pages), so that two
    outputs of different kinds never have one name.

    Raises
    ------
    ParameterError, StoreError
        As by `check_ending` and `check_writable`.
    """
    check_ending(os.fspath(path), name=name, what=what, endings=endings)
    return check_writable(path, force=force, name=name)


def refuse_input(output: Path, given: Path, name: str) -> None:
    """Refuse an output that would replace a file that the same call reads.

    Raises
    ------
    ParameterError
    """
    if output.exists() and given.exists() and output.samefile(given):
        raise ParameterError(f"{name} = {_shown(output)}: would replace what is read; give another name")


def write_cube(
    cube: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    scratch: Path | None = None,
    kept: str = "",
) -> None:
    """Write `cube` as NetCDF-4: to a temporary file, which then takes the name `path` in one step.

    Parameters
    ----------
    cube : xarray.Dataset
    path : path-like
    force : bool
        Whether it may replace an existing file.
    scratch : Path, optional
        The temporary file, see `replacing`.
    kept : str
        What the message of an error tells of results that are not lost.

    Raises
    ------
    StoreError
        If the file exists and `force` is not given, or the disk refuses.
    """
    path = check_writable(path, force=force)
    with told(f"out = {path}", kept), replacing(path, scratch) as temporary:
        for number, part in enumerate(_parts(cube)):
            _write_part(part, temporary, "a" if number else "w")


def _write_part(part: xr.Dataset, path: Path, mode: str) -> None:
    # without locks of xarray's: it would wait for those that are held, and ask a cluster that may have gone for one more
    with ONE_THREAD, NetCDF4DataStore.open(os.fspath(path), mode, lock=DummyLock()) as store:
        part.dump_to_store(store)


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
        if is_zarr(path):
            return cube
        if cube.sizes and cube["mode"].size > MAX_POINTS:
            raise StoreError(f"{path}: has {cube['mode'].size} points; a NetCDF cube may have {MAX_POINTS}")
        cube.load()
        for name in set(FLAGS) & set(cube.variables):
            check_flags(name, cube[name].values)
        return cube


def count_modes(path: str | os.PathLike[str]) -> dict[str, int]:
    """How many points of the cube at `path` are in each mode; they are read block by block.

    Raises
    ------
    StoreError
        See `open_cube`.
    """
    with _opened(Path(path)) as cube:
        return modes_in(cube)


def modes_in(cube: xr.Dataset) -> dict[str, int]:
    """How many points of `cube` are in each mode, the most frequent first; a lazy one is read block by block."""
    counts = np.zeros(len(MODES), dtype=np.int64)
    for _, where in blocks(cube["mode"].shape):
        values = cube["mode"][where].values.ravel()
        check_flags("mode", values)
        counts += np.bincount(values, minlength=len(MODES))
    return {MODES[code]: int(counts[code]) for code in np.argsort(-counts, kind="stable") if counts[code]}


@contextmanager
def _opened(path: Path) -> Iterator[xr.Dataset]:
    """The cube at `path`, whose values are still to be read, if what it tells of itself is sound."""
    if os.path.isdir(path) and is_zarr(path):
        yield _sound(read_zarr(path), path, "Zarr group")
        return
    with _netcdf(path) as cube:
        yield _sound(cube, path, "NetCDF file")


def read_netcdf(path: Path) -> xr.Dataset:
    """A NetCDF file, whole, in memory.

    Raises
    ------
    StoreError
        If there is none, or it is no NetCDF file, or damaged.
    """
    with _netcdf(path) as dataset:
        return dataset.load()


@contextmanager
def _netcdf(path: Path) -> Iterator[xr.Dataset]:
    """A NetCDF file whose values are still to be read, while no other thread is at one."""
    if os.path.isdir(path):
        raise StoreError(f"{path}: is a folder; give a NetCDF file, or a folder that ends in .zarr")
    if not os.path.isfile(path):  # a name that no file can have is no error for it
        raise StoreError(f"{path}: no such file")
    with _damage_told(path), ONE_THREAD:
        declared, size = _declared_bytes(path), path.stat().st_size
        if declared > DEFLATED * size:
            raise StoreError(f"{path}: declares {declared} bytes, which its {size} cannot hold; it is damaged")
        with xr.open_dataset(path, engine="netcdf4", cache=False, lock=DummyLock()) as dataset:
            yield dataset


def _declared_bytes(path: Path) -> int:
    """What the numbers of a NetCDF file would take, as it says."""
    from netCDF4 import Dataset

    with Dataset(path) as file:
        return sum(int(variable.size) * np.dtype(variable.dtype).itemsize for variable in file.variables.values())


def _sound(cube: xr.Dataset, path: Path, kind: str) -> xr.Dataset:
    if "dimersweep_cube" not in cube.attrs:
        raise StoreError(f"{path}: is a {kind}, but no cube of dimersweep")
    version = cube.attrs["dimersweep_cube"]
    if str(version) != CUBE_FORMAT:
        raise StoreError(
            f"{path}: is a cube of format {version}; this version of dimersweep reads format {CUBE_FORMAT}"
        )
    text = cube.attrs.get("configuration", "")
    try:
        intact = digest(text) == cube.attrs.get("configuration_sha256") and "mode" in cube
        told = read_configuration(text)
        intact = intact and set(told.get("grid", {})) <= set(cube.dims) and _fixed_as_told(cube, told)
        for name in set(FLAGS) & set(cube.variables):
            check_codes(cube[name])
    except StoreError as error:
        raise StoreError(f"{path}: {error}") from None
    except (ValueError, TypeError, AttributeError):
        intact = False
    if not intact:
        raise StoreError(f"{path}: is a cube of dimersweep that was changed or is incomplete; sweep it again")
    return cube


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    try:
        yield
    except StoreError:
        raise
    except (OSError, ValueError, RuntimeError, AttributeError, MemoryError) as error:
        # an AttributeError is that of an attribute that is damaged
        raise StoreError(f"{path}: is no NetCDF file, or a damaged one ({error})") from error


def _fixed_as_told(cube: xr.Dataset, configuration: Mapping[str, Any]) -> bool:
    """Whether the fixed parameters are those of the configuration: single values have no checksum of their own."""
    fixed = configuration.get("fixed", {})
    return all(bool((cube[name] == value).all()) for name, value in fixed.items() if name in cube.coords)
