"""Store the results of a sweep, in a file beside its output, or in memory without an output."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from dimersweep.cubes.results import RESULT, Finished, Tile, blank_results, runs, split, tally
from dimersweep.kernel.model.layout import CODE_MODE, M_NOT_RUN, MODES
from dimersweep.storage.files import disk_errors
from dimersweep.storage.store import Store, StoredTile, opened_store

FLUSH_SECONDS = 0.5  # time within which tiles are written together, so that fast sweeps do not wait for the disk
DISK_SHARE = 0.05  # greatest share of the driver's time for the disk: on a slow disk, tiles are written less often
FLUSH_BYTES = 1 << 26  # greatest size of tiles that wait, and of one row: more would take memory, and save no time


def tiles_of(out: Path) -> Path:
    """Return the path of the store with the finished tiles of the cube `out`."""
    return out.with_name(out.name + ".tiles")


class TileStore(Store):
    """A store of the results of a sweep; `tile_store` opens one.

    Parameters
    ----------
    path, how
        As in `Store`.
    kind : dtype
        Type of the result of one point.
    """

    def __init__(self, path: Path, how: str, kind: np.dtype) -> None:
        super().__init__(path, how)
        self.kind = kind
        self._waiting: list[Finished] = []
        self._waiting_bytes = 0
        self._since, self._pause = perf_counter(), FLUSH_SECONDS

    @property
    def kept_if_refused(self) -> str:
        """Words for a message on a disk error: which results are kept."""
        if self.is_empty():
            return "nothing was finished before"
        return f"what was finished before is kept in {self.path}; mend that and run the same again"

    @property
    def kept(self) -> str:
        """Words for a message when the sweep stops: which results are kept."""
        done = sum(self.modes().values())
        if not done:
            return "nothing was finished yet"
        return f"{words_for(self, done)} are kept in {self.path}; run the same again to go on"

    @property
    def wall(self) -> float:
        """Duration of the sweep so far, with that of processes before this one [s]."""
        return sum(row.wall for row in self.summaries())

    @property
    def seconds(self) -> float:
        """Sum of the times of all tiles [s]."""
        return sum(row.seconds for row in self.summaries())

    def modes(self) -> dict[str, int]:
        """Return the number of stored points in each mode."""
        return dict(modes_of(self.summaries()))

    def add(self, finished: Finished) -> None:
        """Add a finished tile; it is on disk after `FLUSH_SECONDS` (later on a slow disk), or with the next `flush`."""
        self._waiting.append(finished)
        self._waiting_bytes += finished.results.nbytes
        if perf_counter() - self._since > self._pause or self._waiting_bytes > FLUSH_BYTES:
            self.flush()
            self._pause = max(FLUSH_SECONDS, (perf_counter() - self._since) / DISK_SHARE)

    def flush(self) -> None:
        """Write the tiles that wait.

        Raises
        ------
        StoreError
            If the disk refuses; tiles that were written before are kept.
        """
        if not self._waiting:
            return
        now = perf_counter()
        with self._writing():
            wall = now - self._since
            for piece in self._pieces():
                self._put(piece, wall)
                wall = 0.0
        self._since, self._waiting, self._waiting_bytes = now, [], 0

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write in one transaction; turn errors of the disk into a StoreError."""
        with disk_errors(f"{self.path}: finished tiles", self.kept_if_refused), self.connection:
            yield

    def _pieces(self) -> Iterator[Finished]:
        """Yield the tiles that wait, in order: tiles that touch are merged, and large ones are split."""
        waiting = sorted(self._waiting, key=lambda finished: finished.tile)
        breaks = [k for k, (a, b) in enumerate(pairwise(waiting), 1) if a.tile.stop != b.tile.start]
        for first, last in pairwise([0, *breaks, len(waiting)]):
            touching = waiting[first:last]
            seconds = sum(each.seconds for each in touching)
            whole = Tile(touching[0].tile.start, touching[-1].tile.stop)
            results = np.concatenate([each.results for each in touching])
            for tile in split([whole], max(1, FLUSH_BYTES // self.kind.itemsize)):
                yield Finished(whole, results).part(tile)._replace(seconds=seconds)
                seconds = 0.0

    def _put(self, piece: Finished, wall: float) -> None:
        """Add a row for a tile; `wall` is the time since the rows before it [s]."""
        results = self._packed(piece.results)
        self.put(StoredTile(*piece.tile, json.dumps(tally(piece.codes)), piece.seconds, wall, results=results))

    def _packed(self, results: np.ndarray) -> bytes | memoryview:
        """Return results as the bytes of a row."""
        return np.ascontiguousarray(results).view(np.uint8).data

    def expect(self, total: int) -> None:
        """Store the number of points that are to be run, where that is not the whole grid.

        Raises
        ------
        StoreError
            If the disk refuses.
        """
        if total != self.about["wanted"]:
            with self._writing():
                self.tell(wanted=total)

    def drop(self, unwanted: Callable[[np.ndarray], np.ndarray]) -> None:
        """Delete the points for which `unwanted` returns True: a function of results, both of shape (n,)."""
        for summary in list(self.summaries()):
            (row,) = self.meeting(summary.start, summary.start + 1)
            whole = self._finished(row)
            kept = [whole.part(tile) for tile in runs(~unwanted(whole.results), row.start)]
            if sum(len(piece.results) for piece in kept) < len(whole.results):
                with self._writing():
                    self.take_out(row.start)
                    for number, piece in enumerate(kept):
                        self._put(piece, 0.0 if number else row.wall)

    def why_not(self, row: StoredTile) -> str:
        """Return the reason why the results of a row must not be used; "" if they may be."""
        why = super().why_not(row)
        if why or len(row.results) != (row.stop - row.start) * self.kind.itemsize:
            return why or "has results of another shape"
        codes = np.frombuffer(row.results, self.kind)["codes"]
        modes = codes[:, CODE_MODE]
        known = M_NOT_RUN < modes.min() <= modes.max() < len(MODES)
        return "" if known and json.dumps(tally(codes)) == row.what else "has other modes than were listed"

    def _finished(self, row: StoredTile) -> Finished:
        """Return the finished tile that a row of the table stands for."""
        return Finished(Tile(row.start, row.stop), np.frombuffer(row.results, self.kind))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return the results of the points `start` to `stop` - 1, shape (stop - start,); missing ones are not run.

        Raises
        ------
        StoreError
            If a tile was damaged since the store was opened.
        """
        results = blank_results(stop - start, self.kind)
        for row in self.meeting(start, stop):
            piece = self._finished(row).part(Tile(max(row.start, start), min(row.stop, stop)))
            results[piece.tile.start - start : piece.tile.stop - start] = piece.results
        return results


class _HeldTiles(TileStore):
    """A store of a sweep without an output: all results lie in one array, and rows have no bytes."""

    kept = "nothing is kept, as no output was given"

    def __init__(self, path: Path, how: str, kind: np.dtype, size: int) -> None:
        super().__init__(path, how, kind)
        self._results = blank_results(size, kind)

    def add(self, finished: Finished) -> None:
        """Copy the results of a finished tile into the array, and enter the tile in the table of the store."""
        here = self._results[slice(*finished.tile)]
        here[:] = finished.results
        super().add(finished._replace(results=here))

    def _packed(self, results: np.ndarray) -> bytes:
        """Return no bytes, as the results lie in the array."""
        return b""

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return the results of the points `start` to `stop` - 1, a view of the array."""
        return self._results[start:stop]


def words_for(store: Store, done: int) -> str:
    """Return the progress of a sweep with `done` points in words, such as ``12 of 132 points``."""
    more = " known to be needed so far" if "refine" in store.configuration else ""
    return f"{done} of {store.about['wanted']} points{more}"


def modes_of(rows: Iterable[StoredTile]) -> Counter[str]:
    """Return the number of points of `rows` in each mode."""
    modes: Counter[str] = Counter()
    for row in rows:
        modes.update(json.loads(row.what))
    return modes


def tile_store(
    out: Path | None, configuration: Mapping[str, Any], size: int, kind: np.dtype = RESULT, *, force: bool = False
) -> AbstractContextManager[TileStore]:
    """Open the store of the sweep for `out`, locked against other processes while the context lasts.

    Parameters
    ----------
    out : Path, optional
        File of the cube to come; by default the store is in memory.
    configuration : mapping
        All settings that decide the numbers, see `Study.configuration`.
    size : int
        Number of points.
    kind : dtype
        Type of the result of one point.
    force : bool
        As in `opened_store`, whose errors are raised, too.
    """
    make = partial(TileStore, kind=kind) if out is not None else partial(_HeldTiles, kind=kind, size=size)
    return opened_store(make, None if out is None else tiles_of(out), configuration, size, force=force)
