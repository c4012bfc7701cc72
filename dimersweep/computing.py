"""The points that a store lacks, run and put there: workers, progress, and the ways a sweep can end early."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from dimersweep.errors import PointError, Stopped
from dimersweep.kernel.layout import CODES, STATUS_MESSAGES, STATUSES
from dimersweep.memorystore import MemoryStore
from dimersweep.progress import tell_of_compiling, watch
from dimersweep.reuse import not_ok
from dimersweep.scheduling import Pool, cluster, connected, run_tiles, threads, warm_up
from dimersweep.signals import StopFlag, stop_on_signals
from dimersweep.tiles import Finished, Pace, Spec, bundles
from dimersweep.tilestore import TileStore

_MODE, _STATUS = CODES.index("mode"), CODES.index("status")

Store = MemoryStore | TileStore


@dataclass(frozen=True)
class How:
    """What decides how a sweep is run, but none of its numbers.

    Parameters
    ----------
    workers : int
        Threads of this process.
    client : distributed.Client or str, optional
        A cluster in place of them.
    progress, fail_fast : bool
        See `sweep`.
    """

    workers: int
    client: Any = None
    progress: bool = True
    fail_fast: bool = False


@contextmanager
def _pool(spec: Spec, how: How, client: Any, stop: StopFlag) -> Iterator[Pool]:
    with threads(spec, how.workers, stop) if client is None else cluster(spec, client) as pool:
        yield pool


def compute(spec: Spec, store: Store, how: How) -> None:
    """Run the points of `spec` that `store` lacks and put them there.

    Raises
    ------
    PointError, Stopped, StoreError
        See `sweep`; what was finished before is in the store.
    """
    ranges = store.gaps()
    if not ranges:
        return
    with ExitStack() as stack:
        client = None if how.client is None else stack.enter_context(connected(how.client))
        if how.progress:
            tell_of_compiling()
        stop = stack.enter_context(stop_on_signals())
        warm_up(spec, stop)  # before the clock of the progress starts, and before workers would all do it
        pool = stack.enter_context(_pool(spec, how, client, stop))
        shown = stack.enter_context(watch(spec.grid.size, show=how.progress, before=store.modes()))
        if how.progress and not pool.workers():
            print("waiting for the first worker of the cluster", file=sys.stderr, flush=True)
        pace = Pace(sum(stop - start for start, stop in ranges), max(1, pool.workers()))
        failures: list[tuple[int, str]] = []

        def take(finished: list[Finished]) -> None:
            pace.note(finished)
            for tile in finished:
                store.add(tile)
            codes = np.concatenate([tile.codes for tile in finished])
            shown.add(codes[:, _MODE])
            if how.fail_fast and not_ok(codes).any():
                failures.append(_failure(spec, next(tile for tile in finished if not_ok(tile.codes).any())))
                stop.set()

        try:
            run_tiles(pool, bundles(ranges, pace), take, stop)
        finally:
            store.flush()
    if failures:
        raise PointError(f"{min(failures)[1]}; {store.kept}")
    if stop.is_set() and store.gaps():
        raise Stopped(store.kept, stop.signal)


def _failure(spec: Spec, finished: Finished) -> tuple[int, str]:
    """The number of the first point of a tile that failed, and why it did."""
    row = int(not_ok(finished.codes).argmax())
    status = finished.codes[row, _STATUS]
    reason = finished.error.partition(": ")[2] or f"{STATUSES[status]}: {STATUS_MESSAGES[status]}"
    number = finished.tile.start + row
    return number, f"{spec.grid.point(number)} failed: {reason}"
