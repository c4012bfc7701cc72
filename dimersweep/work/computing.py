"""Run the points that a store lacks, and store their results: workers, progress, and early ends."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from typing import NamedTuple

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Finished, Tile, common, not_ok, pieces, tally, why_failed
from dimersweep.errors import PointError, Stopped, StoreError, UnfinishedError
from dimersweep.storage.tilestore import TileStore
from dimersweep.work.options import Options
from dimersweep.work.progress import Tally, watch
from dimersweep.work.scheduling import Pace, Pool, cluster, connected, run_tasks, threads
from dimersweep.work.stopping import StopFlag, stop_on_signals, stoppable
from dimersweep.work.tiles import Work
from dimersweep.work.waiting import Patience
from dimersweep.work.warming import get_ready

ALIKE = 10  # tasks in a row that break off for the same reason: the reason is not in the points then


class UnrunPoints(NamedTuple):
    """Points that were left without results, for a reason outside the model."""

    first: int
    points: int
    reason: str

    @property
    def sort(self) -> str:
        """Kind of the reason, such as MemoryError."""
        return self.reason.partition(":")[0]


def words_for(troubles: Sequence[UnrunPoints], grid: Grid) -> str:
    """Return words such as ``3 points could not be run, such as point 7 (Gamma = 0.9): MemoryError: no room``."""
    first, count = min(troubles), sum(each.points for each in troubles)
    points, such = ("points", ", such as ") if count > 1 else ("point", ": ")
    return f"{count} {points} could not be run{such}{grid.point(first.first)}: {first.reason}"


class PointRunner(ExitStack):
    """Workers for the points that a store lacks: started with the first missing point, closed with the context.

    Parameters
    ----------
    store : TileStore
        Store for the results.
    options : Options
        Options of the study: threads or cluster, progress, early ends.
    """

    def __init__(self, store: TileStore, options: Options) -> None:
        super().__init__()
        self.store, self.options = store, options
        self._pool: Pool | None = None
        self._stop: StopFlag
        self._shown: Tally

    def _hire(self, wanted: int) -> Pool:
        """Start threads or connect to the cluster, with progress and signals; return the pool of workers."""
        options = self.options
        client = None if options.client is None else self.enter_context(connected(options.client))
        self._stop = self.enter_context(stop_on_signals())
        pool = self.enter_context(threads(options.workers, self._stop) if client is None else cluster(client))
        self._shown = self.enter_context(watch(wanted, self.store.modes(), pool.workers, show=options.progress))
        if options.progress and not pool.workers():
            print("waiting for the first worker of the cluster", file=sys.stderr, flush=True)
        return pool

    def run(self, work: Work, ranges: Iterable[Tile], wanted: int, known: Iterable[Finished] = ()) -> None:
        """Run `work` at the points of `ranges` that neither the store nor `known` has; put all results into the store.

        Parameters
        ----------
        work : Work
            The work to do at each point.
        ranges : iterable of Tile
            Ranges of points.
        wanted : int
            Number of points to be run in all.
        known : iterable of Finished
            Results of points of these ranges that need not be run.

        Raises
        ------
        PointError, UnfinishedError, Stopped, StoreError
            As by `sweep`; results that were finished before are in the store.
        """
        self.store.expect(wanted)
        for piece in known:
            self.store.add(piece)
            if self._pool is not None:
                self._shown.add(tally(piece.codes))
        self.store.flush()
        missing = list(common(ranges, self.store.gaps()))
        if not missing:
            return
        if self._pool is None:
            work.check_here()
            self._pool = self._hire(wanted)
        self._shown.expect(wanted)
        left = sum(stop - start for start, stop in missing)
        pace = Pace(left, self._pool.workers, self._pool.demand)
        patience = Patience(self._pool, self._stop, self.options.give_up_after, show=self.options.progress)
        failures: list[tuple[int, str]] = []  # numbers of points that failed, with the reasons
        troubles: list[UnrunPoints] = []
        alike = 0  # troubles in a row for the same reason
        try:
            for points, made in run_tasks(self._pool, work, missing, pace, self._stop, patience):
                codes = made.results["codes"]
                left -= len(codes)
                for piece in pieces(points[: len(codes)], made.results, made.seconds):
                    self.store.add(piece)
                if len(codes):
                    self._shown.add(tally(codes), made.seconds)
                    alike = 0
                if made.broken:
                    troubles.append(UnrunPoints(int(points[len(codes)]), made.broken, made.reason))
                    alike = alike + 1 if troubles[-1].sort == troubles[-2:][0].sort else 1
                if self.options.fail_fast and not_ok(codes).any():
                    row = int(not_ok(codes).argmax())
                    failures.append((int(points[row]), why_failed(made.results[row])))
                if failures or alike >= ALIKE or (troubles and self.options.fail_fast):
                    self._stop.set()
        except BaseException as error:
            if not isinstance(error, StoreError):  # the disk has refused, so a flush would fail, too
                self.store.flush()
            raise
        self.store.flush()
        if failures:
            point, words = min(failures)
            raise PointError(f"{work.grid.point(point)} failed: {words}; {self.store.kept}")
        if troubles and not self._stop.signal:
            stopped = "; the sweep was stopped, as these came in a row" if alike >= ALIKE else ""
            raise UnfinishedError(f"{words_for(troubles, work.grid)}{stopped}; {self.store.kept}")
        if self._stop.given_up and left:
            raise UnfinishedError(f"given up: {self._stop.given_up}; {self.store.kept}")
        if left:
            raise Stopped(self.store.kept, self._stop.signal)


def prepare_kernel(*, progress: bool) -> None:
    """Compile or load the kernel, and prove it, in a thread: signals wait while the main thread is in the compiler.

    This comes before its version is written or compared, as only compiling shows how the kernel can be compiled. It
    also comes before the clock of the progress starts, and before all workers would compile it.

    Raises
    ------
    KernelError
        If the kernel cannot run, or gives wrong numbers.
    Stopped
        On Ctrl-C or SIGTERM.
    """
    stoppable(lambda _: get_ready(progress=progress), kept="nothing was begun")
