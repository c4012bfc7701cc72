"""Results of a sweep in the store beside the cube to be, or in memory where there is none."""

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

FLUSH_SECONDS = 0.5  # tiles that end within this time are written at once, so that fast sweeps do not wait for the disk
DISK_SHARE = 0.05  # of the driver's time at most: on a slow disk, tiles are written less often
FLUSH_BYTES = 1 << 26  # of tiles that wait, and of one row: more would take memory, and save no time


def tiles_of(out: Path) -> Path:
    """The store of the finished tiles of the cube `out`."""
    return out.with_name(out.name + ".tiles")


class TileStore(Store):
    """Results of a sweep in a store; get one from `tile_store`.

    Parameters
    ----------
    path, how
        See `Store`.
    kind : dtype
        Of the result of one point.
    """

    def __init__(self, path: Path, how: str, kind: np.dtype) -> None:
        super().__init__(path, how)
        self.kind = kind
        self._waiting: list[Finished] = []
        self._waiting_bytes = 0
        self._since, self._pause = perf_counter(), FLUSH_SECONDS

    @property
    def kept_if_refused(self) -> str:
        """What is kept if the disk refuses to write, in words."""
        if self.is_empty():
            return "nothing was finished before"
        return f"what was finished before is kept in {self.path}; mend that and run the same again"

    @property
    def kept(self) -> str:
        """What is kept if the sweep is stopped now, in words."""
        done = sum(self.modes().values())
        if not done:
            return "nothing was finished yet"
        return f"{words_for(self, done)} are kept in {self.path}; run the same again to go on"

    @property
    def wall(self) -> float:
        """Time of the sweep so far, with that of processes before this one [s]."""
        return sum(row.wall for row in self.summaries())

    @property
    def seconds(self) -> float:
        """Sum of the times of all tiles [s]."""
        return sum(row.seconds for row in self.summaries())

    def modes(self) -> dict[str, int]:
        """Tally of the points that are kept."""
        return dict(modes_of(self.summaries()))

    def add(self, finished: Finished) -> None:
        """Keep a finished tile; it is on disk after `FLUSH_SECONDS` (more on a slow disk), or with the next `flush`."""
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
            If the disk refuses; all that was written before is kept.
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
        with disk_errors(f"{self.path}: finished tiles", self.kept_if_refused), self.connection:
            yield

    def _pieces(self) -> Iterator[Finished]:
        """What waits, in order, with tiles that touch made one, and none too large."""
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
        results = self._packed(piece.results)
        self.put(StoredTile(*piece.tile, json.dumps(tally(piece.codes)), piece.seconds, wall, results=results))

    def _packed(self, results: np.ndarray) -> bytes | memoryview:
        return np.ascontiguousarray(results).view(np.uint8).data

    def expect(self, total: int) -> None:
        """Note how many points are to be run, where that is not the whole grid.

        Raises
        ------
        StoreError
            If the disk refuses.
        """
        if total != self.about["wanted"]:
            with self._writing():
                self.tell(wanted=total)

    def drop(self, unwanted: Callable[[np.ndarray], np.ndarray]) -> None:
        """Forget the points that `unwanted` picks: results to bool, both of shape (n,)."""
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
        """Why the results of a row must not be used; "" if they may."""
        why = super().why_not(row)
        if why or len(row.results) != (row.stop - row.start) * self.kind.itemsize:
            return why or "has results of another shape"
        codes = np.frombuffer(row.results, self.kind)["codes"]
        modes = codes[:, CODE_MODE]
        known = M_NOT_RUN < modes.min() <= modes.max() < len(MODES)
        return "" if known and json.dumps(tally(codes)) == row.what else "has other modes than were listed"

    def _finished(self, row: StoredTile) -> Finished:
        return Finished(Tile(row.start, row.stop), np.frombuffer(row.results, self.kind))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Results of the points `start` to `stop` - 1, shape (stop - start,); not run where they are missing.

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
    """Results of a sweep without an output: all in one array; the rows only tell of them."""

    kept = "nothing is kept, as no output was given"

    def __init__(self, path: Path, how: str, kind: np.dtype, size: int) -> None:
        super().__init__(path, how, kind)
        self._results = blank_results(size, kind)

    def add(self, finished: Finished) -> None:
        here = self._results[slice(*finished.tile)]
        here[:] = finished.results
        super().add(finished._replace(results=here))

    def _packed(self, results: np.ndarray) -> bytes:
        return b""

    def read(self, start: int, stop: int) -> np.ndarray:
        return self._results[start:stop]


def words_for(store: Store, done: int) -> str:
    """How far a sweep is that has so many points, such as ``12 of 132 points``."""
    more = " known to be needed so far" if "refine" in store.configuration else ""
    return f"{done} of {store.about['wanted']} points{more}"


def modes_of(rows: Iterable[StoredTile]) -> Counter[str]:
    """How many points of `rows` are in each mode."""
    modes: Counter[str] = Counter()
    for row in rows:
        modes.update(json.loads(row.what))
    return modes


def tile_store(
    out: Path | None, configuration: Mapping[str, Any], size: int, kind: np.dtype = RESULT, *, force: bool = False
) -> AbstractContextManager[TileStore]:
    """The finished tiles of the sweep for `out`, locked against other processes while the context lasts.

    Parameters
    ----------
    out : Path, optional
        The cube to be; without one they are in memory.
    configuration : mapping
        All that decides the numbers, see `Study.configuration`.
    size : int
        Number of points.
    kind : dtype
        Of the result of one of them.
    force : bool
        See `opened_store`, which also says what is raised.
    """
    make = partial(TileStore, kind=kind) if out is not None else partial(_HeldTiles, kind=kind, size=size)
    return opened_store(make, None if out is None else tiles_of(out), configuration, size, force=force)
