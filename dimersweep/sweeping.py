"""A whole sweep: a grid in, a labelled cube out; workers compute, and the calling thread keeps all books and files."""

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT

from dimersweep.computing import How, Store, compute
from dimersweep.cube import build, flatten
from dimersweep.errors import ParameterError, StoreError
from dimersweep.grid import check_fits
from dimersweep.memorystore import MemoryStore
from dimersweep.parameters import check_count
from dimersweep.provenance import as_text, attributes, differences
from dimersweep.reuse import Known, not_ok, not_run
from dimersweep.store import check_writable, open_cube, write_cube
from dimersweep.tiles import Spec, make_spec
from dimersweep.tilestore import TileStore, tile_store
from dimersweep.zarrs import check_zarr, is_zarr, write_zarr

_SUMMARY = "sweep of a 3D dimer on a vibrating plate"


def sweep(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    periods: int,
    rtol: float = 1e-8,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    stop_when_settled: bool = True,
    force: bool = False,
    attrs: Mapping[str, str] | None = None,
    client: Any = None,
    extend: str | os.PathLike[str] | None = None,
    retry: bool = False,
    fail_fast: bool = False,
    keep_tiles: bool = False,
) -> xr.Dataset:
    """Run the dimer at every point of a grid.

    With an `out`, finished points are kept in the folder ``<out>.tiles`` beside it until the cube is written: the same call
    goes on where a former one was stopped or killed, with any number of workers.

    Parameters
    ----------
    grid : mapping of str to array_like or mapping
        The axes: a parameter's name (see `Parameters`) and its values, or ``{"start", "stop", "step" or "num"}`` with
        the stop included; ``"unit": "deg"`` for angles in degrees. SI units otherwise.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    periods : int
        Forcing periods each point may take.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    out : path-like, optional
        NetCDF file to write the cube to, whole or not at all; or, if it ends in .zarr, a Zarr group, for cubes larger
        than memory. A complete cube of this very sweep is read and returned.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        Whether to show finished points, time left and a tally of modes on stderr.
    stop_when_settled : bool
        Whether a point stops as soon as its motion has settled.
    force : bool
        Whether `out` may replace an existing file, and results of another configuration be deleted.
    attrs : mapping of str to str, optional
        Further global attributes, such as a title.
    client : distributed.Client or str, optional
        A dask.distributed client, or the address of a scheduler such as ``tcp://host:8786``, to run on.
    extend : path-like, optional
        A cube whose points are taken over where this grid has them, value by value; same settings, same kernel.
    retry : bool
        Whether points of `out` (or `extend`) that failed are run again.
    fail_fast : bool
        Whether to stop at the first point that fails; what was finished is kept.
    keep_tiles : bool
        Whether the folder of finished points stays when the cube is written.

    Returns
    -------
    xarray.Dataset
        `mode`, `status`, orbit quantities and counts over the axes, with units and provenance. The numbers depend
        neither on the workers nor on how the grid is cut into tiles.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError
        For an `out` that cannot be written or belongs to another sweep, before any work; or a disk that refuses later.
    PointError
        With `fail_fast`, for the first point that fails.
    Stopped
        A KeyboardInterrupt, after Ctrl-C or SIGTERM; what was finished is kept.
    """
    spec = make_spec(grid, fixed, periods=periods, rtol=rtol, stop_when_settled=stop_when_settled)
    how = How(CPU_COUNT if workers is None else check_count("workers", workers), client, progress, fail_fast)
    target = None if out is None else Path(out)
    if target is None or not is_zarr(target):
        check_fits(spec.grid)
    if target is not None:
        return _to_file(spec, target, how, attrs, extend, force=force, retry=retry, keep_tiles=keep_tiles)
    if retry and extend is None:
        raise ParameterError("retry: needs an out, or a cube to extend")
    memory = MemoryStore(spec.grid.size)
    origin = _take_over(memory, spec, extend, not_ok if retry else not_run)
    compute(spec, memory, how)
    return build(spec.grid, memory.out, memory.codes, _attributes(spec, memory, origin | dict(attrs or {})))


def _to_file(
    spec: Spec,
    out: Path,
    how: How,
    attrs: Mapping[str, str] | None,
    extend: str | os.PathLike[str] | None,
    *,
    force: bool,
    retry: bool,
    keep_tiles: bool,
) -> xr.Dataset:
    if is_zarr(out):
        check_zarr()
    if out.exists() and not force:
        former = _former(out, spec)
        if not retry or not not_ok(flatten(former)[1]).any():
            if how.progress:
                print(f"{out}: is complete already; nothing was run", file=sys.stderr, flush=True)
            return former
    force_cube = force or retry
    check_writable(out, force=force_cube)
    unwanted = not_ok if retry else not_run
    with tile_store(out, spec.configuration(), spec.grid.size, force=force) as store, _tidy(store):
        check_writable(out, force=force_cube)  # who held the lock before may have written it meanwhile
        for line in store.check():
            warnings.warn(line, RuntimeWarning, stacklevel=3)
        if retry:
            store.drop(not_ok)
        origin = _take_over(store, spec, extend, unwanted)
        if retry and out.exists():
            _take_over(store, spec, out, unwanted)
        compute(spec, store, how)
        told = _attributes(spec, store, origin | dict(attrs or {}))
        if is_zarr(out):
            write_zarr(spec.grid, store.read, told, out, scratch=store.scratch, kept=store.keeps)
            cube = open_cube(out)
        else:
            cube = build(spec.grid, *store.read(0, spec.grid.size), told)
            write_cube(cube, out, force=force_cube, scratch=store.scratch, kept=store.keeps)
        if not keep_tiles:
            store.remove()
    return cube


@contextmanager
def _tidy(store: TileStore) -> Iterator[None]:
    """Leave no folder behind if nothing was finished."""
    try:
        yield
    except BaseException:
        if not store.manifest.entries:
            with suppress(OSError):
                store.remove()
        raise


def _former(out: Path, spec: Spec) -> xr.Dataset:
    """The cube that is at `out` already, if it is the one that `spec` would give.

    Raises
    ------
    StoreError
        If it is not.
    """
    cannot = f"out = {out}: exists already; give another name, or force it to be replaced (--force)"
    try:
        cube = open_cube(out)
    except StoreError:
        raise StoreError(cannot) from None
    old, new = json.loads(cube.attrs["configuration"]), spec.configuration()
    if as_text(old) != as_text(new):
        raise StoreError(f"{cannot}. What differs:" + "".join(f"\n  {line}" for line in differences(old, new)))
    return cube


def _take_over(
    store: Store, spec: Spec, source: str | os.PathLike[str] | None, unwanted: Callable[[np.ndarray], np.ndarray]
) -> dict[str, str]:
    """Put the points that are missing and that the cube `source` has into the store; the attributes that tell of it."""
    if source is None:
        return {}
    cube = open_cube(source)
    for piece in Known(cube, str(source), spec).pieces(store.gaps(), unwanted):
        store.add(piece)
    store.flush()
    return {"extends": f"{Path(source).name}, configuration sha256 {cube.attrs['configuration_sha256']}"}


def _attributes(spec: Spec, store: Store, more: Mapping[str, str]) -> dict[str, Any]:
    """Global attributes of the cube, and a warning if points failed for reasons that are not of the model."""
    errors = sorted(store.errors)
    if errors:
        warnings.warn(f"{len(errors)} tiles have points that failed; {errors[0]}", RuntimeWarning, stacklevel=4)
    told = attributes(spec.configuration(), _SUMMARY, store.wall) | {"kernel_time_s": store.seconds}
    return told | dict(more) | ({"failures": "; ".join(errors)} if errors else {})
