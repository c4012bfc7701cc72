"""Make a cube in three steps: open its store and start workers, fill the store with results, close it into a cube."""

import signal
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import signed
from dimersweep.cubes.results import Finished, common
from dimersweep.errors import ParameterError, Stopped
from dimersweep.storage.checking import checksum_of
from dimersweep.storage.cubefiles import open_cube, write_cube
from dimersweep.storage.files import disk_errors
from dimersweep.storage.formats import format_of
from dimersweep.storage.outputs import TABLES, check_ending, check_output
from dimersweep.storage.provenance import CHECKSUM, attributes
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.studies.reuse import Known, complete_cube, known_points
from dimersweep.studies.study import Batch, Study
from dimersweep.work.computing import PointRunner, prepare_kernel
from dimersweep.work.options import IN_PASSING, OptionKeywords, Options, make_options


def make_cube(study: Study, **given: Unpack[OptionKeywords]) -> xr.Dataset:
    """Return the cube of a study: take the points that are known already, and run those that are missing.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    study, options = _part_of(study, make_options(**given))
    former = complete_cube(study, options)
    if former is not None:
        return former
    prepare_kernel(progress=options.progress)
    with _opened(study, options) as (store, hired):
        written = False
        try:
            known, origin = known_points(study, options)
            study = fill(study, hired, known)
            cube = _close(study, options, store, origin)
            written = True
            if options.out is not None and not options.keep_tiles:
                store.remove()
        except KeyboardInterrupt as stop:  # while no points were run, its message is empty
            kept = f"{options.out} is written" if written else store.kept
            raise Stopped(str(stop) or kept, getattr(stop, "signal", signal.SIGINT)) from None
    return cube


def in_memory(study: Study, options: Options = IN_PASSING) -> tuple[np.ndarray, float]:
    """Run all points of a study anew; return their results, shape (size,), and the time that they took [s]."""
    with tile_store(None, study.configuration(), study.size, study.kind) as store, PointRunner(store, options) as hired:
        fill(study, hired)
        return store.read(0, study.size), store.seconds


def _part_of(study: Study, options: Options) -> tuple[Study, Options]:
    """Return a study and its options; where a part is asked for, the study of this part with the part's own output.

    Raises
    ------
    ParameterError
        If the study cannot be cut so, or cannot be extended.
    """
    if options.part is not None:
        study = study.cut(options.part)
        if options.out is not None:
            check_ending(str(options.out), what="the cube of a part", endings=TABLES)
            options = replace(options, out=options.part.file(options.out))
    if study.grid.columns and options.extend is not None:
        raise ParameterError("extend: is for grids, not for single points")
    return study, options


@contextmanager
def _opened(study: Study, options: Options) -> Iterator[tuple[TileStore, PointRunner]]:
    """Open the store of a study, locked against other processes; yield it with the workers that run its points."""
    with (
        tile_store(options.out, study.configuration(), study.size, study.kind, force=options.force) as store,
        PointRunner(store, options) as hired,
    ):
        if options.out is not None:
            # another process may have written the output while this one waited for the lock of the store
            check_output(options.out, force=options.force or options.retry, endings=None)
        for line in store.damage:
            # the warning points at user code: 1 to 3 are this function, its context and `make_cube`, 4 is sweep or search
            warnings.warn(line, RuntimeWarning, stacklevel=5)
        if options.retry and "failed" in store.modes():
            store.drop(study.again)
        yield store, hired


def fill(study: Study, hired: PointRunner, known: Sequence[Known] = ()) -> Study:
    """Complete the store of a study, batch by batch: copy the points that other cubes have, and run the others.

    `known` looks up the points of other cubes, `hired` are the workers with the store. Return the study of the last
    batch, which labels all results: in a refinement it has all cells.
    """
    store, size = hired.store, study.size

    def found(batch: Batch) -> Iterator[Finished]:
        for points_in in known:
            yield from points_in(common(batch.ranges, store.gaps()), batch.study.stands)
            store.flush()

    for batch in study.batches(lambda: store.read(0, size)):
        study = batch.study
        hired.run(*batch, found(batch))
    return study


def _close(study: Study, options: Options, store: TileStore, origin: Mapping[str, str]) -> xr.Dataset:
    """Return the cube of all results in the store, with its attributes and checksum; write it to the output, if any."""
    made = attributes(study.configuration(), study.summary, store.wall) | {"kernel_time_s": store.seconds}
    attrs = {**made, **origin, **options.attrs}
    out, replaces = options.out, options.force or options.retry
    write_blocks = format_of(out or Path()).write_blocks
    # a cube that may be larger than memory is written block by block, and opened again lazily
    if out is not None and write_blocks is not None:
        with disk_errors(f"out = {out}", store.kept_if_refused):
            write_blocks(
                study.grid,
                signed(study.template().assign_attrs(attrs), study.configuration()),
                lambda tile, axes: replace(study, grid=axes).as_cube(store.read(*tile)),
                out,
                scratch=store.scratch,
                workers=options.workers,
            )
        return open_cube(out)
    cube = signed(study.as_cube(store.read(0, study.size)).assign_attrs(attrs), study.configuration())
    cube.attrs[CHECKSUM] = checksum_of(cube)
    if out is not None:
        write_cube(cube, out, force=replaces, scratch=store.scratch, kept=store.kept_if_refused)
    return cube
