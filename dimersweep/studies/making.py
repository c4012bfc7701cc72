"""A cube made whole, of a sweep, a search or a refined map: what is there already, the store, the crew, and the output."""

import json
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import flatten
from dimersweep.cubes.grid import check_fits
from dimersweep.cubes.results import failed
from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.memorystore import MemoryStore
from dimersweep.storage.netcdf import check_writable, open_cube, write_cube
from dimersweep.storage.provenance import as_text, attributes, differences
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.storage.zarr import check_zarr, is_zarr, write_zarr
from dimersweep.studies.deciding import SearchSpec
from dimersweep.studies.reuse import Reuse
from dimersweep.studies.sweep_spec import Spec
from dimersweep.work.computing import (
    Crew,
    How,
    Store,
    crew,
)


class Job(Protocol):
    """What a cube is made of."""

    @property
    def summary(self) -> str:
        """What the cube shows, its title unless another one is given."""

    @property
    def spec(self) -> Spec | SearchSpec:
        """Its points, the kind of their results, and how they are run."""

    @property
    def by_blocks(self) -> bool:
        """Whether the cube may be larger than memory: its results are those of `RESULT`, block by block."""

    @property
    def reuse(self) -> Reuse:
        """What is taken over from cubes that exist."""

    def again(self, results: np.ndarray) -> np.ndarray:
        """Which of `results`, shape (n,), a retry forgets: those that failed, and those that may depend on one; bool."""

    def configuration(self) -> dict[str, Any]:
        """All that decides its numbers, as JSON can hold it."""

    def fill(self, store: Store, crew: Crew) -> dict[str, str]:
        """Have `crew` run the points that `store` lacks; returns further attributes of the cube."""

    def cube(self, results: np.ndarray, attributes: Mapping[str, Any]) -> xr.Dataset:
        """The cube of the results of all points."""


@dataclass(frozen=True)
class Output:
    """Where a cube goes, and what may happen to what is there; see `sweep`.

    Parameters
    ----------
    path : path-like, optional
    force, keep_tiles : bool
    attrs : mapping of str to str, optional
        Further global attributes.
    """

    path: str | os.PathLike[str] | None
    force: bool = False
    keep_tiles: bool = False
    attrs: Mapping[str, str] | None = None


def make(job: Job, how: How, output: Output) -> xr.Dataset:
    """The cube of `job`, written if it has an output.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    if output.path is not None:
        return _to_file(job, how, output, Path(output.path))
    check_fits(job.spec.grid, by_blocks=job.by_blocks)
    if job.reuse.retry and job.reuse.extend is None:
        raise ParameterError("retry: needs an out, or a cube to extend")
    memory = MemoryStore(job.spec.grid.size, job.spec.kind)
    more = _filled(job, memory, how)
    return job.cube(memory.results, _attributes(job, memory, more, output))


def _filled(job: Job, store: Store, how: How) -> dict[str, str]:
    with crew(store, how) as hands:
        return job.fill(store, hands)


def _to_file(job: Job, how: How, output: Output, out: Path) -> xr.Dataset:
    if not is_zarr(out):
        check_fits(job.spec.grid, by_blocks=job.by_blocks)
    elif job.by_blocks:
        check_zarr()
    else:
        raise ParameterError(f"out = {out}: only a sweep of a whole grid is written as Zarr; give a NetCDF file")
    if out.exists() and not output.force:
        former = _former(out, job)
        if not job.reuse.retry or not failed(flatten(former)[1]).any():
            if how.progress:
                print(f"{out}: is complete already; nothing was run", file=sys.stderr, flush=True)
            return former
    replace = output.force or job.reuse.retry
    check_writable(out, force=replace)
    with (
        tile_store(out, job.configuration(), job.spec.grid.size, job.spec.kind, force=output.force) as store,
        _tidy(store),
    ):
        check_writable(out, force=replace)  # who held the lock before may have written it meanwhile
        for line in store.check():
            warnings.warn(line, RuntimeWarning, stacklevel=4)
        if job.reuse.retry and "failed" in store.modes():
            store.drop(job.again)
        more = _filled(job, store, how)
        cube = _written(job, store, _attributes(job, store, more, output), out, force=replace)
        if not output.keep_tiles:
            store.remove()
    return cube


def _written(job: Job, store: TileStore, told: Mapping[str, Any], out: Path, *, force: bool) -> xr.Dataset:
    if is_zarr(out):
        write_zarr(job.spec.grid, store.read, told, out, scratch=store.scratch, kept=store.keeps)
        return open_cube(out)
    cube = job.cube(store.read(0, job.spec.grid.size), told)
    write_cube(cube, out, force=force, scratch=store.scratch, kept=store.keeps)
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


def _former(out: Path, job: Job) -> xr.Dataset:
    """The cube that is at `out` already, if it is the one that `job` would give.

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
    old, new = json.loads(cube.attrs["configuration"]), job.configuration()
    if as_text(old) != as_text(new):
        raise StoreError(f"{cannot}. What differs:" + "".join(f"\n  {line}" for line in differences(old, new)))
    return cube


def _attributes(job: Job, store: Store, more: Mapping[str, str], output: Output) -> dict[str, Any]:
    """Global attributes of the cube."""
    told = attributes(job.configuration(), job.summary, store.wall) | {"kernel_time_s": store.seconds}
    return told | dict(more) | dict(output.attrs or {})
