"""A cube from start to end: what is there already, the store of its points and the crew that runs them, and the output."""

import json
import signal
import sys
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import xarray as xr

from dimersweep.cubes.cube import flatten, signed
from dimersweep.cubes.grid import check_fits
from dimersweep.cubes.results import blank_results, failed
from dimersweep.errors import ParameterError, Stopped, StoreError
from dimersweep.runs import accessor  # noqa: F401 - gives every cube its `cube.dimersweep`
from dimersweep.storage.checking import check_unchanged, checksum_of
from dimersweep.storage.cubefiles import open_cube, write_cube
from dimersweep.storage.files import disk_errors
from dimersweep.storage.formats import format_of
from dimersweep.storage.outputs import check_output
from dimersweep.storage.provenance import CHECKSUM, as_text, attributes, differences
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.studies.reuse import Known, check_alike
from dimersweep.studies.study import Label, Study
from dimersweep.work.computing import Crew, settle_way
from dimersweep.work.options import Given, Options, make_options


def make_cube(study: Study, **given: Unpack[Given]) -> xr.Dataset:
    """The cube of a study: what is there already, then what is missing.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    options = make_options(**given)
    if study.grid.columns and options.extend is not None:
        raise ParameterError("extend: is for grids, not for single points")
    former = _complete_cube(study, options)
    if former is not None:
        return former
    settle_way(progress=options.progress)
    out, replaces = options.out, options.force or options.retry
    with (
        tile_store(out, study.configuration(), study.grid.size, study.kind, force=options.force) as store,
        Crew(store, options) as hired,
    ):
        if out is not None:
            check_output(out, force=replaces, endings=None)  # who held the lock before may have written it meanwhile
        for line in store.file.trouble:
            warnings.warn(line, RuntimeWarning, stacklevel=3)  # of what has called sweep, search or refine
        if options.retry and "failed" in store.modes():
            store.drop(study.again)
        written = False
        try:
            known, origin = known_points(study, options)
            label = study.run(hired, known)
            told = attributes(study.configuration(), study.summary, store.wall) | {"kernel_time_s": store.seconds}
            cube = _finished(study, options, store, label, told | origin | dict(options.attrs))
            written = True
            if out is not None and not options.keep_tiles:
                store.file.remove()
        except KeyboardInterrupt as stop:  # one that came while no points were run tells nothing
            kept = f"{out} is written" if written else store.kept
            raise Stopped(str(stop) or kept, getattr(stop, "signal", signal.SIGINT)) from None
    return cube


def _finished(study: Study, options: Options, store: TileStore, label: Label, told: Mapping[str, Any]) -> xr.Dataset:
    """The cube of all results with what it tells of itself, its checksum among that; written, if it has an output."""
    out, replaces = options.out, options.force or options.retry
    write_blocks = None if out is None else format_of(out).write_blocks
    if out is not None and write_blocks is not None:  # block by block, and opened then
        first = replace(study, grid=study.grid.window(0, 1)[0]).as_cube(blank_results(1, study.kind))
        with disk_errors(f"out = {out}", store.kept_if_refused):
            write_blocks(
                study.grid,
                signed(first.assign_attrs(told), study.configuration()),
                lambda tile, axes: replace(study, grid=axes).as_cube(store.read(*tile)),
                out,
                scratch=store.file.scratch,
                workers=options.workers,
            )
        return open_cube(out)
    results = store.read(0, study.grid.size)
    if out is None:
        store.file.close()  # memory holds them once
    cube = signed(label(results).assign_attrs(told), study.configuration())
    cube.attrs[CHECKSUM] = checksum_of(cube)
    if out is not None:
        write_cube(cube, out, force=replaces, scratch=store.file.scratch, kept=store.kept_if_refused)
    return cube


def known_points(study: Study, options: Options) -> tuple[list[Known], dict[str, str]]:
    """What other cubes have of the points of `study`, and the attributes that tell of the first of them.

    These are the cube to extend, and at a retry the one at the output.

    Raises
    ------
    StoreError
        See `check_alike` and `Known`.
    """
    origin: dict[str, str] = {}
    known = []
    paths = [options.extend, options.out if options.retry and options.out and options.out.exists() else None]
    for path in (each for each in paths if each is not None):
        cube, name = open_cube(path), str(path)
        if not study.grid.columns:
            check_alike(cube, study.configuration(), name)
        known.append(Known(cube, name, study.grid, study.results_of, options.unwanted))
        if path is options.extend:
            origin["extends"] = f"{Path(path).name}, configuration sha256 {cube.attrs['configuration_sha256']}"
    return known, origin


def _complete_cube(study: Study, options: Options) -> xr.Dataset | None:
    """The cube of `study` if it is at the output already, with nothing to retry; the output is judged.

    Raises
    ------
    ParameterError, StoreError
        If there is another cube, or the output cannot be written.
    """
    out = options.out
    written = None if out is None else format_of(out)
    if written is None or not written.write_blocks:
        check_fits(study.grid, by_blocks=study.by_blocks)
    elif not study.by_blocks:
        raise ParameterError(
            f"out = {out}: only a sweep of a whole grid is written as {written.name}; give a NetCDF file"
        )
    if written is not None:
        written.check()
    if out is None:
        if options.retry and options.extend is None:
            raise ParameterError("retry: needs an out, or a cube to extend")
        return None
    check_output(out, force=True)  # what can never be written to is refused first
    if out.exists() and not options.force:
        former = _former(out, study)
        if not options.retry or not failed(flatten(former)[1]).any():
            if options.progress:
                print(f"{out}: is complete already; nothing was run", file=sys.stderr, flush=True)
            return former
    check_output(out, force=options.force or options.retry, endings=None)
    return None


def _former(out: Path, study: Study) -> xr.Dataset:
    """The cube that is at `out` already, if it is the one that `study` would give.

    Raises
    ------
    StoreError
        If it is not.
    """
    other = "give another name, or force it to be replaced (force=True)"
    try:
        cube = open_cube(out)
        old, new = json.loads(cube.attrs["configuration"]), study.configuration()
        if as_text(old) == as_text(new):
            check_unchanged(cube, out)
            return cube
    except StoreError as error:
        raise StoreError(f"out = {out}: exists already, and cannot be used ({error}); {other}") from None
    changes = "".join(f"\n  {line}" for line in differences(old, new))
    raise StoreError(f"out = {out}: exists already; {other}. What differs:{changes}")
