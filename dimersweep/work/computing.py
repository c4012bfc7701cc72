"""The points that a store lacks, run and put there: workers, progress, and the ways that this can end early."""

import sys
from collections.abc import Iterable
from contextlib import ExitStack

import numpy as np

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Finished, Tile, common, not_ok, pieces, tally
from dimersweep.errors import PointError, Stopped, UnfinishedError
from dimersweep.kernel.model.layout import CODE_STATUS, STATUS_MESSAGES, STATUSES
from dimersweep.storage.tilestore import TileStore
from dimersweep.work.options import Options
from dimersweep.work.progress import Tally, report_compiling, watch
from dimersweep.work.proving import is_proven, prove
from dimersweep.work.scheduling import Pace, Pool, cluster, connected, run_tasks, threads
from dimersweep.work.stopping import StopFlag, stop_on_signals, stoppable
from dimersweep.work.tiles import Made, Work

ALIKE = 10  # tasks that break off in a row for the same reason: then it is not for the points


class Troubles:
    """What has left points without results, for reasons that are not the model's."""

    def __init__(self) -> None:
        self.first, self.reason = -1, ""  # of these points, and why
        self.points = 0
        self.alike, self.last = 0, ""  # in a row, and their sort of reason

    def note(self, points: np.ndarray, made: Made) -> None:
        """Take note of what a task of these points has brought back."""
        if len(made.results):
            self.alike = 0
        if not made.broken:
            return
        first = int(points[len(made.results)])
        if not self.points or first < self.first:
            self.first, self.reason = first, made.reason
        self.points += made.broken
        sort = made.reason.partition(":")[0]
        self.alike = self.alike + 1 if sort == self.last else 1
        self.last = sort

    def words(self, grid: Grid) -> str:
        """Such as ``3 points could not be run, such as point 7 (Gamma = 0.9): MemoryError: no room``."""
        points, such = ("points", ", such as ") if self.points > 1 else ("point", ": ")
        words = f"{self.points} {points} could not be run{such}{grid.point(self.first)}: {self.reason}"
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

    def run(self, work: Work, ranges: Iterable[Tile]) -> None:
        """Do `work` at the points of `ranges` that the store lacks, and hand what is finished to the store.

        Raises
        ------
        PointError, UnfinishedError, Stopped, StoreError
            See `sweep`; what was finished before is in the store.
        """
        missing = list(common(ranges, self.store.gaps()))
        if not missing:
            return
        if self._pool is None:
            self._pool = self._hire()
        left = sum(stop - start for start, stop in missing)
        pace = Pace(left, self._pool.workers)
        failures: list[tuple[int, int]] = []  # points, and their status
        troubles = Troubles()

        try:
            for points, made in run_tasks(self._pool, work, missing, pace, self._stop):
                troubles.note(points, made)
                codes = made.results["codes"]
                left -= len(codes)
                for piece in pieces(points[: len(codes)], made.results, made.seconds):
                    self.store.add(piece)
                if len(codes):
                    self._shown.add(tally(codes), made.seconds)
                if self.options.fail_fast and not_ok(codes).any():
                    row = int(not_ok(codes).argmax())
                    failures.append((int(points[row]), codes[row, CODE_STATUS]))
                if failures or troubles.alike >= ALIKE or (troubles.points and self.options.fail_fast):
                    self._stop.set()
        finally:
            self.store.flush()
        if failures:
            point, status = min(failures)
            words = f"{STATUSES[status]}: {STATUS_MESSAGES[status]}"
            raise PointError(f"{work.grid.point(point)} failed: {words}; {self.store.kept}")
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
    stoppable(lambda _: prove(), kept="nothing was begun")
