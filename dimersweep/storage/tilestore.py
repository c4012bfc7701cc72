"""Finished tiles beside the cube to be: files listed in a manifest, and a lock, in a folder that goes when the cube is written.

What a process killed at any moment leaves behind is a manifest whose entries are true, and perhaps a file that is not
listed or a last line that is cut. `check` names both, and they are never used.
"""

import os
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from dimersweep.cubes.results import (
    RESULT,
    Finished,
    Tile,
    blank_results,
    gaps,
    runs,
)
from dimersweep.errors import StoreError
from dimersweep.storage.beside import Beside
from dimersweep.storage.files import (
    append,
    delete,
    disk_errors,
    put,
)
from dimersweep.storage.manifest import (
    Entry,
    Manifest,
    as_line,
    lines,
    wanted_line,
)
from dimersweep.storage.shelf import Shelf, open_shelf
from dimersweep.storage.tilefiles import Damaged, read_points, write_points

FLUSH_SECONDS = 0.5  # tiles that end within this time share a file, so that fast sweeps do not wait for the disk
DISK_SHARE = 0.05  # of the driver's time at most: a slow disk gets larger files, less often
FLUSH_BYTES = 1 << 26  # of tiles that wait: a larger file would take memory, and save no time
KEPT_BYTES = 1 << 28  # of files that are held in memory while points are read in order
NAMED_FILES = 5  # whose damage is named one by one


def tiles_of(out: Path) -> Beside:
    """The folder that holds the finished tiles of the cube `out`: files of the driver, and those of workers."""
    return Beside(out, ".tiles", r"tiles-(\d+|w[0-9a-f]{16})\.npy")


class TileStore:
    """Results of a sweep in a folder; get one from `tile_store`, which holds its lock.

    Parameters
    ----------
    out : Path
        The cube to be.
    manifest : Manifest
        As it stands on disk.
    kind : dtype
        Of the result of one point.
    """

    def __init__(self, out: Path, manifest: Manifest, kind: np.dtype) -> None:
        self.out, self.beside, self.manifest, self.kind = out, tiles_of(out), manifest, kind
        self.folder, self.scratch = self.beside.path, self.beside.scratch
        self.waiting: list[Finished] = []
        self._waiting_bytes = 0
        self._unlisted: list[Entry] = []  # files of workers that the manifest does not list yet
        self._since = perf_counter()
        self._pause = FLUSH_SECONDS
        numbers = (path.stem.removeprefix("tiles-") for path in self.beside.files())
        self._number = max((int(number) for number in numbers if number.isdigit()), default=0)
        self._cache: dict[str, tuple[int, dict[Tile, Finished]]] = {}  # bytes and pieces of files
        self._cached = 0  # bytes of all of them
        self._index: list[tuple[Tile, Entry]] = []

    @property
    def kept_if_refused(self) -> str:
        """What is kept if the disk refuses to write, in words."""
        if not self.manifest.done:
            return "nothing was finished before"
        return f"what was finished before is kept in {self.folder}; mend that and run the same again"

    @property
    def kept(self) -> str:
        """What is kept if the sweep is stopped now, in words."""
        if not self.manifest.done:
            return "nothing was finished yet"
        return f"{self.manifest.words} are kept in {self.folder}; run the same again to go on"

    @property
    def wall(self) -> float:
        """Time of the sweep so far, with that of processes before this one [s]."""
        return sum(entry.wall for entry in self.manifest.entries)

    @property
    def seconds(self) -> float:
        """Sum of the times of all tiles [s]."""
        return sum(entry.seconds for entry in self.manifest.entries)

    def gaps(self) -> list[Tile]:
        """The ranges that are not yet on disk."""
        return list(gaps(self.manifest.size, (tile for entry in self.manifest.entries for tile in entry.tiles)))

    def check(self) -> list[str]:
        """Forget and delete what is damaged or not listed, and say so, and what else a user should know, in lines."""
        kept, trouble = [], []
        for entry in self.manifest.entries:
            try:
                read_points(self.folder, entry, self.kind)
                kept.append(entry)
            except Damaged as error:
                trouble.append(f"{entry.file} {error}")
        if any(later.start < earlier.stop for earlier, later in pairwise(sorted(t for e in kept for t in e.tiles))):
            raise StoreError(f"{self.folder}: its manifest lists points twice; begin anew (force=True)")
        listed = {entry.file for entry in self.manifest.entries}
        unlisted = sum(path.name not in listed for path in self.beside.files())
        if self.manifest.damaged:
            trouble.append(f"lines of the manifest that are cut or damaged: {self.manifest.damaged}")
        if trouble or unlisted:
            self._relist(kept)
        if len(trouble) > NAMED_FILES:
            trouble = [*trouble[:NAMED_FILES], f"and {len(trouble) - NAMED_FILES} more"]
        lines = [f"{self.folder}: damaged results are computed again ({'; '.join(trouble)})"] if trouble else []
        if unlisted:
            files = f"files of points that the manifest does not list, as a kill may leave them: {unlisted}"
            lines.append(f"{self.folder}: {files}; they are deleted, and their points computed again")
        return lines

    def _relist(self, entries: list[Entry]) -> None:
        """Put `entries` in place of those of the manifest, and delete all other files."""
        self.manifest.entries, self.manifest.damaged, self._index = entries, 0, []
        written = lines(self.manifest)
        put(self.beside.manifest, [written])
        self.manifest.length = len(written)
        listed = {entry.file for entry in entries}
        for path in (*self.beside.files(), *self.beside.half_written()):
            if path.name not in listed:
                delete(path)

    def _write(self, pieces: list[Finished], wall: float) -> Entry:
        self._number += 1  # a name is never used twice, so that no entry can be true of another file
        return write_points(self.folder / f"tiles-{self._number:06d}.npy", pieces, self.manifest.sha256, wall)

    def add(self, finished: Finished) -> None:
        """Keep a finished tile; it is on disk after `FLUSH_SECONDS` (more on a slow disk), or with the next `flush`."""
        self.waiting.append(finished)
        self._waiting_bytes += finished.results.nbytes
        self._flush_in_time()

    def open_shelf(self) -> Shelf:
        """Let workers that share the disk put their results into the folder by themselves; see `enlist`.

        Raises
        ------
        StoreError
            If the disk refuses.
        """
        with disk_errors(f"{self.folder}: finished tiles", self.kept_if_refused):
            return open_shelf(self.folder, self.manifest.sha256)

    def enlist(self, entry: Entry) -> None:
        """List a file that a worker has put into the folder; the manifest on disk has it as late as a tile of `add`.

        Raises
        ------
        StoreError
            If it is not there, or the disk refuses.
        """
        try:
            size = os.stat(self.folder / entry.file).st_size
        except OSError as error:
            why = f"cannot be read, though a worker has written it ({error.strerror})"
            raise StoreError(f"{self.folder / entry.file}: {why}; {self.kept_if_refused}") from None
        if size != entry.size:
            raise StoreError(
                f"{self.folder / entry.file}: has {size} bytes in place of {entry.size}; run the same again"
            )
        self._unlisted.append(entry)
        self._flush_in_time()

    def _flush_in_time(self) -> None:
        if perf_counter() - self._since > self._pause or self._waiting_bytes > FLUSH_BYTES:
            self.flush()
            self._pause = max(FLUSH_SECONDS, (perf_counter() - self._since) / DISK_SHARE)

    def flush(self) -> None:
        """Write the tiles that wait, and list those that workers have written.

        Raises
        ------
        StoreError
            If the disk refuses; all that was written before is kept.
        """
        if not self.waiting and not self._unlisted:
            return
        now = perf_counter()
        with disk_errors(f"{self.folder}: finished tiles", self.kept_if_refused):
            entries = [*self._unlisted, *([self._write(self.waiting, 0.0)] if self.waiting else [])]
            entries[-1] = replace(entries[-1], wall=now - self._since)
            self._append(b"".join(map(as_line, entries)))
        self.manifest.entries += entries
        self._index, self._unlisted = [], []
        self._since, self.waiting, self._waiting_bytes = now, [], 0

    def _append(self, line: bytes) -> None:
        append(self.beside.manifest, line, self.manifest.length)
        self.manifest.length += len(line)

    def expect(self, total: int) -> None:
        """Note in the manifest how many points are to be run, where that is not the whole grid.

        Raises
        ------
        StoreError
            If the disk refuses.
        """
        if total != self.manifest.wanted:
            with disk_errors(f"{self.folder}: the list of finished tiles", self.kept_if_refused):
                self._append(wanted_line(total))
            self.manifest.wanted = total

    def drop(self, unwanted: Callable[[np.ndarray], np.ndarray]) -> None:
        """Forget the points that `unwanted` picks: results to bool, both of shape (n,)."""
        entries = []
        for entry in self.manifest.entries:
            pieces = read_points(self.folder, entry, self.kind)
            kept = [piece.part(tile) for piece in pieces for tile in runs(~unwanted(piece.results), piece.tile.start)]
            if sum(len(piece.results) for piece in kept) == entry.points:
                entries.append(entry)
            elif kept:
                entries.append(self._write(kept, entry.wall))
        if entries != self.manifest.entries:
            self._relist(entries)

    def read(self, start: int, stop: int) -> np.ndarray:
        """Results of the points `start` to `stop` - 1, shape (stop - start,); not run where they are missing.

        Raises
        ------
        StoreError
            If a file was damaged since it was written or checked.
        """
        results = blank_results(stop - start, self.kind)
        for tile, entry in self._meeting(start, stop):
            piece = self._pieces(entry)[tile].part(Tile(max(tile.start, start), min(tile.stop, stop)))
            results[piece.tile.start - start : piece.tile.stop - start] = piece.results
        return results

    def _meeting(self, start: int, stop: int) -> Iterator[tuple[Tile, Entry]]:
        """The listed tiles that have points from `start` to `stop` - 1, in order."""
        if not self._index:
            self._index = [(tile, entry) for entry in self.manifest.entries for tile in entry.tiles]
            self._index.sort(key=lambda item: item[0])
        first = bisect_right(self._index, start, key=lambda item: item[0].stop)
        for tile, entry in islice(self._index, first, None):
            if tile.start >= stop:
                return
            yield tile, entry

    def _pieces(self, entry: Entry) -> dict[Tile, Finished]:
        if entry.file not in self._cache:
            while self._cache and self._cached + entry.size > KEPT_BYTES:
                self._cached -= self._cache.pop(next(iter(self._cache)))[0]
            try:
                pieces = {piece.tile: piece for piece in read_points(self.folder, entry, self.kind)}
            except Damaged as error:
                raise StoreError(f"{self.folder / entry.file}: {error}; run the same again") from None
            self._cache[entry.file] = entry.size, pieces
            self._cached += entry.size
        return self._cache[entry.file][1]

    def modes(self) -> dict[str, int]:
        """Tally of the points on disk."""
        total: dict[str, int] = {}
        for entry in self.manifest.entries:
            for mode, count in entry.modes.items():
                total[mode] = total.get(mode, 0) + count
        return total


@contextmanager
def tile_store(
    out: Path, configuration: Mapping[str, Any], size: int, kind: np.dtype = RESULT, *, force: bool = False
) -> Iterator[TileStore]:
    """The finished tiles of the sweep for `out`, locked against other processes while the context lasts.

    Parameters
    ----------
    out : Path
        The cube to be.
    configuration : mapping
        All that decides the numbers, see ``Spec.configuration``.
    size : int
        Number of points.
    kind : dtype
        Of the result of one of them.
    force : bool
        See `Beside.claimed`, which also says what is raised.
    """
    with tiles_of(out).claimed(configuration, size, force=force) as manifest:
        yield TileStore(out, manifest, kind)
