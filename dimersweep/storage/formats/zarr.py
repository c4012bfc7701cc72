"""The format Zarr, for cubes larger than memory: groups that are written block after block of grid points."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.cube import coordinates_of
from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Tile
from dimersweep.errors import StoreError, one_line
from dimersweep.storage.blocks import blocks, chunk_shape
from dimersweep.storage.checking import soundness
from dimersweep.storage.files import replacing, sync
from dimersweep.storage.formats.format import Format, as_made, range_of
from dimersweep.storage.provenance import CHECKSUM

WRITERS = 4  # most threads that write: with more the disk is the limit
OLDEST_ZARR = (3, 1)  # oldest allowed version of zarr: earlier ones may run code that a store brings along


def check_zarr() -> None:
    """Refuse to go on without the package zarr, or with an old version of it.

    Raises
    ------
    StoreError
        If zarr is missing or older than `OLDEST_ZARR`.
    """
    try:
        import zarr
    except ImportError:
        raise StoreError("zarr: is not installed; pip install 'dimersweep[zarr]'") from None
    if tuple(map(int, zarr.__version__.split(".")[:2])) < OLDEST_ZARR:
        raise StoreError(
            f"zarr = {zarr.__version__}: must be >= 3.1, as an older one may run code that a store brings along; "
            "pip install -U 'dimersweep[zarr]'"
        )


def write_zarr(
    grid: Grid,
    small: xr.Dataset,
    block_of: Callable[[Tile, Grid], xr.Dataset],
    path: Path,
    *,
    scratch: Path,
    workers: int = WRITERS,
) -> None:
    """Write the cube of a grid block by block to `scratch`, on the same disk, which then takes the name `path`.

    Blocks are read and summed one after the other, and written by threads. Two of them are in memory at a time.

    Parameters
    ----------
    grid : Grid
        The points of the cube.
    small : xarray.Dataset
        The cube of the first point alone, with all attributes.
    block_of : callable
        ``block_of(tile, axes)`` returns the cube of the points of a tile, which are those of a grid with these axes.
    path, scratch : Path
        Final and temporary path. A group that exists at `path` is replaced.
    workers : int
        Number of threads that may be used.

    Raises
    ------
    OSError, RuntimeError
        If the disk refuses.
    """
    import zarr

    template, (made_with,) = _template(grid, small), small["made_with"].values.ravel()
    checksum, writing, ranges = Checksum(template), list[Future[None]](), dict.fromkeys(template.data_vars, np.empty(0))
    # chunks with missing values only are written, too, so that a chunk without a file is known to be lost
    whole = zarr.config.set({"array.write_empty_chunks": True})
    with replacing(path, scratch), whole, ThreadPoolExecutor(min(workers, WRITERS)) as threads:
        template.to_zarr(scratch, mode="w", compute=False, consolidated=False)
        group = zarr.open_group(scratch, mode="r+")
        arrays = dict(group.arrays())
        for name in template.coords:
            checksum.add(name, template[name].values)
        for tile, where in blocks(grid.shape):
            axes = {name: values[part] for (name, values), part in zip(grid.axes.items(), where, strict=True)}
            block = block_of(tile, Grid(axes, {}))
            block["made_with"] = xr.full_like(block["mode"], made_with, dtype=made_with.dtype)
            for future in writing:
                future.result()
            writing = []
            for name, variable in block.data_vars.items():
                checksum.add(name, variable.values)
                if not np.can_cast(variable.dtype, arrays[str(name)].dtype):
                    raise StoreError(f"{path}: {name} has counts beyond 32 bits; give a NetCDF file")
                ranges[name] = range_of(np.append(ranges[name], range_of(variable.values)))
                writing.append(threads.submit(arrays[str(name)].__setitem__, where, variable.values))
        for future in writing:
            future.result()
        for name, ends in ranges.items():
            if ends.size:
                arrays[str(name)].attrs["actual_range"] = ends.astype(template[name].dtype).tolist()
        group.attrs[CHECKSUM] = checksum.digest()
        list(threads.map(sync, (path for path in scratch.rglob("*") if path.is_file())))


def _template(grid: Grid, small: xr.Dataset) -> xr.Dataset:
    """Return the lazy cube of `grid`, with types, chunks and attributes as in `small`, to be written without values."""
    import dask.array
    from zarr.codecs import ZstdCodec

    chunks = chunk_shape(grid.shape)
    summed = {"compressors": [ZstdCodec(checksum=True)]}
    coordinates = {str(name): each.variable for name, each in small.coords.items()} | coordinates_of(grid)
    for variable in coordinates.values():
        variable.attrs["actual_range"] = range_of(variable.values).tolist()
        variable.encoding = {"_FillValue": None} | (summed if variable.dims else {})
    kinds = {variable.dtype for variable in small.data_vars.values()}
    zeros = {kind: dask.array.zeros(grid.shape, dtype=kind, chunks=chunks) for kind in kinds}
    lazy = {
        name: xr.Variable(
            variable.dims,
            zeros[variable.dtype],
            variable.attrs,
            {"_FillValue": variable.encoding["_FillValue"], "chunks": chunks, **summed},
        )
        for name, variable in small.data_vars.items()
    }
    return xr.Dataset(lazy, coordinates, small.attrs)


def _chunks_of(variable: xr.Variable) -> tuple[int, ...]:
    """Return the lengths of the chunks of a variable along its dimensions."""
    return tuple(variable.encoding.get("chunks") or variable.shape)


def _lacking(folder: Path, variable: xr.Variable, where: tuple[Any, ...] | None = None) -> int:
    """Return the number of chunks of a variable without a file, among those with values at `where`, or among all."""
    sizes = list(zip(variable.shape, _chunks_of(variable), strict=True))
    numbers: list[Any] = [range(-(-length // chunk)) for length, chunk in sizes]
    if where is not None:
        parts = zip(sizes, where, strict=True)
        numbers = [np.unique(np.arange(length)[part] // chunk) for (length, chunk), part in parts]
    return sum(not (folder / "c").joinpath(*map(str, place)).is_file() for place in product(*numbers))


class _Numbers:
    """Values of a variable of a group, read when they are used; damage that is found then is reported in one line.

    By then the group may have been replaced, and missing chunks would be read as missing values. So the description of
    the group, as it was when the group was opened, is compared after each reading.
    """

    def __init__(self, path: Path, name: str, variable: xr.Variable, description: bytes, *, whole: bool) -> None:
        self.path, self.name, self.variable = path, name, variable.copy(deep=False)
        self.description, self.whole = description, whole
        self.shape, self.dtype, self.ndim = variable.shape, variable.dtype, variable.ndim

    def __getitem__(self, where: tuple[Any, ...]) -> np.ndarray:
        try:
            values, why = self.variable[where].values, ""
        except MemoryError:
            raise
        except Exception as error:  # each compressor has errors of its own
            why = f"{self.name} cannot be read ({one_line(error)})"
        if not why and self.whole and _lacking(self.path / self.name, self.variable, where):
            why = f"{self.name} lacks some of its chunks"
        if _description_of(self.path) != self.description:
            gone = "is not the cube that was opened any more (it was replaced, moved or deleted)"
            raise StoreError(f"{self.path}: {gone}; open it again")
        if why:
            raise StoreError(f"{self.path}: is damaged: {why}; sweep it again (force=True)")
        return values


def _description_of(path: Path) -> bytes:
    """Return the description of a group: its attributes, with the checksum of all values and the time of writing."""
    try:
        return (path / "zarr.json").read_bytes()
    except OSError:
        return b""


@contextmanager
def opened_zarr(path: Path) -> Iterator[xr.Dataset]:
    """Open a group as a dataset whose values are read when they are used.

    Raises
    ------
    StoreError
        If there is no group, or it is damaged.
    """
    import dask  # noqa: F401 (as a whole, see `opened_netcdf`)
    from dask.array import from_array

    check_zarr()
    description = _description_of(path)
    try:  # format 3 only: format 2 may name filters that run code
        cube = xr.open_dataset(path, engine="zarr", consolidated=False, zarr_format=3, cache=False)
    except Exception as error:  # a changed description may lead to any error
        raise StoreError(f"{path}: is no Zarr group, or a damaged one ({one_line(error)})") from error
    lacking = {str(name): _lacking(path / str(name), variable) for name, variable in cube.variables.items()}
    for name, variable in cube.variables.items():
        if name not in cube.indexes:  # indexes are in memory already
            numbers = _Numbers(path, str(name), variable, description, whole=not lacking[str(name)])
            chunks = _chunks_of(variable)  # none of a single value, which is compared as soon as a cube is opened
            variable.data = from_array(numbers, chunks, name=False, fancy=False) if chunks else numbers[()]
        if "flag_values" in variable.attrs:  # a list, as Zarr stores attributes as JSON
            variable.attrs["flag_values"] = np.array(variable.attrs["flag_values"], dtype=variable.dtype)
    # a sweep writes all chunks; a copy by xarray lacks chunks that have only missing values or zeros: then the checksum
    # of all values decides
    name, number = next(((name, number) for name, number in lacking.items() if number), ("", 0))
    ours = number > 0 and "dimersweep_cube" in cube.attrs
    found = soundness(cube) if ours else ""
    if found == "part":
        raise StoreError(
            f"{path}: is a part of a cube, of which {name} lacks {number} chunks: lost, or not written as they hold nothing; "
            "write it with zarr.config.set({'array.write_empty_chunks': True}), or as NetCDF"
        )
    if found == "changed" or (ours and CHECKSUM not in cube.attrs):
        raise StoreError(f"{path}: is damaged: {name} lacks {number} of its chunks; sweep it again (force=True)")
    yield as_made(cube)


ZARR = Format(".zarr", "Zarr", "Zarr group", opened_zarr, write_blocks=write_zarr, check=check_zarr, marker="zarr.json")
