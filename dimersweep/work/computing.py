"""The points that a store lacks, run and put there: workers, progress, and the ways that this can end early."""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import wait
from contextlib import ExitStack

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Finished, Tile, not_ok, tally
from dimersweep.errors import PointError, Stopped, UnfinishedError
from dimersweep.kernel.model.layout import CODE_STATUS, STATUS_MESSAGES, STATUSES
from dimersweep.storage.tilestore import TileStore
from dimersweep.work.options import Options
from dimersweep.work.progress import Tally, report_compiling, watch
from dimersweep.work.proving import is_proven, prove
from dimersweep.work.scheduling import POLL, Pace, Pool, cluster, connected, run_tiles, threads
from dimersweep.work.stopping import StopFlag, in_thread, stop_on_signals
from dimersweep.work.tiles import Broken, Made, Work, count

ALIKE = 10  # tasks that break off in a row for the same reason: then it is not for the points


class Troubles:
    """What has left points without results, for reasons that are not the model's."""

    def __init__(self) -> None:
        self.first: Broken | None = None
        self.last = ""  # sort of reason
        self.points = 0
        self.alike = 0  # in a row

    def note(self, made: Made) -> None:
        """Take note of what a task has brought back."""
        if made.done:
            self.alike = 0
        if made.broken is None:
            return
        self.first = min(self.first or made.broken, made.broken)
        self.points += made.broken.points
        sort = made.broken.reason.partition(":")[0]
        self.alike = self.alike + 1 if sort == self.last else 1
        self.last = sort

    def words(self, grid: Grid) -> str:
        """Such as ``3 points could not be run, such as point 7 (Gamma = 0.9): MemoryError: no room``."""
        assert self.first is not None
        points, such = ("points", ", such as ") if self.points > 1 else ("point", ": ")
        where = grid.point(self.first.tiles[0].start)
        words = f"{self.points} {points} could not be run{such}{where}: {self.first.reason}"
        return words + ("; the sweep was stopped, as these came in a row" if self.alike >= ALIKE else "")


class Crew(ExitStack):
    """Those who run what a store lacks; they are hired with the first point that is missing, and go home at the end.

    Parameters
    ----------
    store : TileStore
        Where results are put; as many of its points as ``expect`` says are wanted.
    options : Options
    """

    def __init__(self, store: TileStore, options: Options) -> None:
        super().__init__()
        self.store, self.options, self.wanted = store, options, 0
        self._pool: Pool | None = None
        self._stop: StopFlag
        self._shown: Tally

    def expect(self, wanted: int) -> None:
        """Have the progress and the store know how many points are to be run in all."""
        self.wanted = wanted
        self.store.expect(wanted)
        if self._pool is not None:
            self._shown.expect(wanted)

    def take_over(self, pieces: Iterable[Finished]) -> None:
        """Put points into the store that need not be run."""
        for piece in pieces:
            self.store.add(piece)
            if self._pool is not None:
                self._shown.add(tally(piece.codes))
        self.store.flush()

    def _hire(self) -> Pool:
        options = self.options
        client = None if options.client is None else self.enter_context(connected(options.client))
        self._stop = self.enter_context(stop_on_signals())
        pool = self.enter_context(threads(options.workers, self._stop) if client is None else cluster(client))
        self._shown = self.enter_context(watch(self.wanted, self.store.modes(), pool.workers, show=options.progress))
        if options.progress and not pool.workers():
            print("waiting for the first worker of the cluster", file=sys.stderr, flush=True)
        return pool

    def run(self, work: Work, missing: Sequence[Tile], also: Callable[[Finished], None] | None = None) -> None:
        """Do `work` at the points of `missing`, and hand each tile that is finished to the store, and to `also`.

        Raises
        ------
        PointError, UnfinishedError, Stopped, StoreError
            See `sweep`; what was finished before is in the store.
        """
        if not missing:
            return
        if self._pool is None:
            self._pool = self._hire()
        left = count(missing)
        pace = Pace(left, self._pool.workers)
        failures: list[tuple[int, str]] = []
        troubles = Troubles()

        try:
            for made in run_tiles(self._pool, work, missing, pace, self._stop):
                troubles.note(made)
                if troubles.alike >= ALIKE or (troubles.points and self.options.fail_fast):
                    self._stop.set()
                left -= made.done
                modes: Counter[str] = Counter()
                for tile in made.finished:
                    self.store.add(tile)
                    if also:
                        also(tile)
                    if self.options.fail_fast and not_ok(tile.codes).any():
                        row = int(not_ok(tile.codes).argmax())
                        point, status = tile.tile.start + row, tile.codes[row, CODE_STATUS]
                        words = f"{STATUSES[status]}: {STATUS_MESSAGES[status]}"
                        failures.append((point, f"{work.grid.point(point)} failed: {words}"))
                        self._stop.set()
                    modes.update(tally(tile.codes))
                if modes:
                    self._shown.add(modes, made.seconds)
        finally:
            self.store.flush()
        if failures:
            raise PointError(f"{min(failures)[1]}; {self.store.kept}")
        if troubles.points and not self._stop.signal:
            raise UnfinishedError(f"{troubles.words(work.grid)}; {self.store.kept}")
        if left:
            raise Stopped(self.store.kept, self._stop.signal)


def settle_way(*, progress: bool) -> None:
    """Compile or load the kernel, and prove it, in a thread: signals wait while the main thread is in the compiler.

    That comes before its version is written or compared, as how it can be compiled is seen by doing it; before the clock of
    the progress starts; and before workers would all do it.

    Raises
    ------
    KernelError
        If it cannot run, or gives wrong numbers.
    Stopped
        On Ctrl-C or SIGTERM.
    """
    if is_proven():
        return
    if progress:
        report_compiling()
    with stop_on_signals() as stop:
        future = in_thread(prove)
        while not stop.is_set() and not wait([future], timeout=POLL).done:
            pass
        if future.done():
            future.result()
    if stop.is_set():
        raise Stopped("nothing was begun", stop.signal)
