"""A cube from start to end: what is there already, the store of its points and the crew that runs them, and the output."""

import json
import signal
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.cubes.cube import flatten, signed
from dimersweep.cubes.points import check_fits
from dimersweep.cubes.results import blank_results, failed
from dimersweep.errors import ParameterError, Stopped, StoreError
from dimersweep.runs import accessor  # noqa: F401 - gives every cube its `cube.dimersweep`
from dimersweep.storage.checking import check_unchanged, checksum_of
from dimersweep.storage.cubefiles import open_cube, write_cube
from dimersweep.storage.files import disk_errors
from dimersweep.storage.formats import format_of
from dimersweep.storage.memorystore import MemoryStore
from dimersweep.storage.outputs import check_output, check_writable
from dimersweep.storage.provenance import CHECKSUM, as_text, attributes, differences
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.studies.reuse import Known, check_alike
from dimersweep.studies.study import Label, Study
from dimersweep.work.computing import Crew, Store, crew, settle_way
from dimersweep.work.options import Options


def make_cube(study: Study, options: Options) -> xr.Dataset:
    """The cube of a study: what is there already, then what is missing.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    if study.grid.columns and options.extend is not None:
        raise ParameterError("extend: is for grids, not for single points")
    former = complete_cube(study, options)
    if former is not None:
        return former
    with unfinished_cube(study, options) as cube:
        known, origin = known_points(study, options)
        label = study.run(cube.crew, known)
        return cube.write(label, cube.attributes(origin))


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


def complete_cube(study: Study, options: Options) -> xr.Dataset | None:
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
    check_writable(out, force=options.force or options.retry)
    return None


class UnfinishedCube:
    """A cube that is being made: the store of its points, and the crew that runs those that are missing.

    Parameters
    ----------
    study : Study
    options : Options
    store : Store
    crew : Crew
    """

    def __init__(self, study: Study, options: Options, store: Store, crew: Crew) -> None:
        self.study, self.options, self.store, self.crew = study, options, store, crew
        self._written = False

    @property
    def kept(self) -> str:
        """What is kept if it is stopped now, in words."""
        return f"{self.options.out} is written" if self._written else self.store.kept

    @property
    def by_blocks(self) -> bool:
        """Whether it is written block by block."""
        return self.options.out is not None and format_of(self.options.out).write_blocks is not None

    def attributes(self, origin: Mapping[str, str]) -> dict[str, Any]:
        """Global attributes, with those of its `origin`."""
        common = attributes(self.study.configuration(), self.study.summary, self.store.wall)
        return common | {"kernel_time_s": self.store.seconds} | dict(origin) | dict(self.options.attrs)

    def write(self, label: Label, attributes: Mapping[str, Any]) -> xr.Dataset:
        """The finished cube with its checksum; written, if it has an output, and the folder of its points removed."""
        if self.by_blocks:
            return self._write_blocks(attributes)
        cube = signed(label(self.store.read(0, self.study.grid.size), attributes), self.study.configuration())
        cube.attrs[CHECKSUM] = checksum_of(cube)
        if isinstance(self.store, TileStore):
            scratch = self.store.store.scratch
            write_cube(cube, self.store.out, force=self._replaces, scratch=scratch, kept=self.store.kept_if_refused)
            self._tidy_up(self.store)
        return cube

    def _write_blocks(self, attributes: Mapping[str, Any]) -> xr.Dataset:
        """Write it block by block; returns it opened again."""
        assert isinstance(self.store, TileStore)
        out, write, study = self.store.out, format_of(self.store.out).write_blocks, self.study
        assert write is not None
        first = replace(study, grid=study.grid.window(0, 1)[0])
        small = signed(first.as_cube(blank_results(1, study.kind), attributes), study.configuration())
        with disk_errors(f"out = {out}", self.store.kept_if_refused):
            write(
                study.grid,
                small,
                lambda tile, axes: replace(study, grid=axes).as_cube(self.store.read(*tile), {}),
                out,
                scratch=self.store.store.scratch,
                workers=self.options.workers,
            )
        self._tidy_up(self.store)
        return open_cube(out)

    @property
    def _replaces(self) -> bool:
        return self.options.force or self.options.retry

    def _tidy_up(self, store: TileStore) -> None:
        self._written = True
        if not self.options.keep_tiles:
            store.store.remove()


@contextmanager
def unfinished_cube(study: Study, options: Options) -> Iterator[UnfinishedCube]:
    """A cube to be made, with what was finished of it before.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    settle_way(progress=options.progress)
    with ExitStack() as stack:
        store: Store = (
            MemoryStore(study.grid.size, study.kind)
            if options.out is None
            else stack.enter_context(_store_of(study, options, options.out))
        )
        cube = UnfinishedCube(study, options, store, stack.enter_context(crew(store, options)))
        try:
            yield cube
        except KeyboardInterrupt as stop:  # one that came while no points were run tells nothing
            raise Stopped(str(stop) or cube.kept, getattr(stop, "signal", signal.SIGINT)) from None


@contextmanager
def _store_of(study: Study, options: Options, out: Path) -> Iterator[TileStore]:
    """The store of finished points beside `out`, under its lock."""
    with (
        tile_store(out, study.configuration(), study.grid.size, study.kind, force=options.force) as store,
        _tidy(store),
    ):
        # who held the lock before may have written it meanwhile
        check_writable(out, force=options.force or options.retry)
        for line in store.store.trouble:
            warnings.warn(line, RuntimeWarning, stacklevel=8)  # of what has called sweep, search or refine
        if options.retry and "failed" in store.modes():
            store.drop(study.again)
        yield store


@contextmanager
def _tidy(store: TileStore) -> Iterator[None]:
    """Leave no store behind if nothing was finished."""
    try:
        yield
    except BaseException:
        if store.store.is_empty():
            with suppress(OSError):
                store.store.remove()
        raise


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
