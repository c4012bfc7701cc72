"""The format NetCDF-4, for cubes, runs and tables that are in memory as a whole."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import xarray as xr
from xarray.backends import NetCDF4DataStore
from xarray.backends.locks import HDF5_LOCK, NETCDFC_LOCK, DummyLock, combine_locks

from dimersweep.errors import StoreError
from dimersweep.storage.files import replacing
from dimersweep.storage.formats.format import Format, as_made, for_others

DEFLATED = 1100  # factor above which no file is compressed: the limit of zlib is 1032
# netCDF-C and HDF5 bear one thread at a time; xarray's own files wait for the same locks, taken in the same order.
# These locks have no public name, and `to_netcdf` takes none; a lock of ours would not keep a user's files waiting.
ONE_THREAD = combine_locks([NETCDFC_LOCK, HDF5_LOCK])


def write_netcdf(dataset: xr.Dataset, path: Path, scratch: Path | None = None) -> None:
    """Write a dataset to a temporary file, see `replacing`, which then takes the name `path` in one step."""
    plain = for_others(dataset)
    with (
        replacing(path, scratch) as temporary,
        ONE_THREAD,
        # without xarray's own locks: it would wait for those above, and ask a cluster, perhaps gone, for one more
        NetCDF4DataStore.open(os.fspath(temporary), "w", lock=DummyLock()) as store,
    ):
        plain.dump_to_store(store)


def read_netcdf(path: Path) -> xr.Dataset:
    """Return a NetCDF file as a dataset in memory.

    Raises
    ------
    StoreError
        If the file does not exist, is no NetCDF file, or is damaged.
    """
    with opened_netcdf(path) as dataset:
        return dataset.load()


@contextmanager
def opened_netcdf(path: Path) -> Iterator[xr.Dataset]:
    """Open a NetCDF file whose values are read when they are used; no other thread may use NetCDF meanwhile."""
    if os.path.isdir(path):
        raise StoreError(f"{path}: is a folder; give a NetCDF file")
    if not os.path.isfile(path):  # False, and no error, for a name that no file can have
        raise StoreError(f"{path}: no such file")
    # dask as a whole: xarray begins with a part of it, and two threads that begin with two of its parts get an ImportError
    import dask  # noqa: F401
    from netCDF4 import Dataset

    try:
        with ONE_THREAD, Dataset(path) as file:
            kinds = [(int(each.size), np.dtype(each.dtype).itemsize) for each in file.variables.values()]
            declared, size = sum(number * length for number, length in kinds), path.stat().st_size
            if declared > DEFLATED * size:
                raise StoreError(f"{path}: declares {declared} bytes, which its {size} cannot hold; it is damaged")
            # of the file that is open: xarray would open it once more, and look it up for each variable
            dataset = xr.open_dataset(NetCDF4DataStore(file, lock=DummyLock()), cache=False)
            dataset.encoding["source"] = os.path.abspath(path)
            yield as_made(dataset)
    except StoreError:
        raise
    except (OSError, ValueError, RuntimeError, AttributeError, MemoryError) as error:
        # netCDF4 raises an AttributeError for a damaged attribute
        raise StoreError(f"{path}: is no NetCDF file, or a damaged one ({error})") from error


NETCDF = Format(".nc", "NetCDF", "NetCDF file", opened_netcdf, write=write_netcdf)
