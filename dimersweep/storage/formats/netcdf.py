"""Cubes, runs and tables as NetCDF-4 files, whole in memory."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import NetCDF4DataStore
from xarray.backends.locks import HDF5_LOCK, NETCDFC_LOCK, DummyLock, combine_locks

from dimersweep.errors import StoreError
from dimersweep.storage.files import replacing
from dimersweep.storage.formats.format import Format, as_made, for_others

PART_BYTES = 1 << 26  # of a cube, that are written at once
DEFLATED = 1100  # zlib makes nothing smaller by more than this
# netCDF-C and HDF5 bear one thread at a time; xarray's own files wait for the same locks, taken in the same order.
# xarray gives them out by no public name, and `to_netcdf` takes none: a lock of ours would not keep a user's files waiting.
ONE_THREAD = combine_locks([NETCDFC_LOCK, HDF5_LOCK])


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


def write_netcdf(dataset: xr.Dataset, path: Path, scratch: Path | None = None) -> None:
    """Write a dataset to a temporary file, see `replacing`, which then takes the name `path` in one step."""
    with replacing(path, scratch) as temporary:
        for number, part in enumerate(_parts(for_others(dataset))):
            # without xarray's locks: it would wait for those that are held, and ask a cluster that may have gone for one more
            mode, name = "a" if number else "w", os.fspath(temporary)
            with ONE_THREAD, NetCDF4DataStore.open(name, mode, lock=DummyLock()) as store:
                part.dump_to_store(store)


def read_netcdf(path: Path) -> xr.Dataset:
    """A NetCDF file, whole, in memory.

    Raises
    ------
    StoreError
        If there is none, or it is no NetCDF file, or damaged.
    """
    with opened_netcdf(path) as dataset:
        return dataset.load()


@contextmanager
def opened_netcdf(path: Path) -> Iterator[xr.Dataset]:
    """A NetCDF file whose values are still to be read, while no other thread is at one."""
    if os.path.isdir(path):
        raise StoreError(f"{path}: is a folder; give a NetCDF file")
    if not os.path.isfile(path):  # a name that no file can have is no error for it
        raise StoreError(f"{path}: no such file")
    from netCDF4 import Dataset

    try:
        with ONE_THREAD:
            with Dataset(path) as file:
                kinds = [(int(each.size), np.dtype(each.dtype).itemsize) for each in file.variables.values()]
            declared, size = sum(number * length for number, length in kinds), path.stat().st_size
            if declared > DEFLATED * size:
                raise StoreError(f"{path}: declares {declared} bytes, which its {size} cannot hold; it is damaged")
            with xr.open_dataset(path, engine="netcdf4", cache=False, lock=DummyLock()) as dataset:
                yield as_made(dataset)
    except StoreError:
        raise
    except (OSError, ValueError, RuntimeError, AttributeError, MemoryError) as error:
        # an AttributeError is that of an attribute that is damaged
        raise StoreError(f"{path}: is no NetCDF file, or a damaged one ({error})") from error


NETCDF = Format(".nc", "NetCDF", "NetCDF file", opened_netcdf, write=write_netcdf)
