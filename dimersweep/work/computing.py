"""The points that a store lacks, run and put there: workers, progress, and the ways that this can end early."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from typing import NamedTuple

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Finished, Tile, common, not_ok, pieces, tally, why_failed
from dimersweep.errors import PointError, Stopped, StoreError, UnfinishedError
from dimersweep.storage.tilestore import TileStore
from dimersweep.work.options import Options
from dimersweep.work.progress import Tally, report_compiling, watch
from dimersweep.work.proving import is_proven
from dimersweep.work.scheduling import Pace, Pool, cluster, connected, run_tasks, threads
from dimersweep.work.stopping import StopFlag, stop_on_signals, stoppable
from dimersweep.work.tiles import Work
from dimersweep.work.waiting import patience
from dimersweep.work.warming import get_ready

ALIKE = 10  # tasks that break off in a row for the same reason: then it is not for the points


class Trouble(NamedTuple):
    """Points that were left without results, for a reason that is not the model's."""

    first: int
    points: int
    reason: str

    @property
    def sort(self) -> str:
        """Of reason, such as MemoryError."""
        return self.reason.partition(":")[0]


def words_for(troubles: Sequence[Trouble], grid: Grid) -> str:
    """Such as ``3 points could not be run, such as point 7 (Gamma = 0.9): MemoryError: no room``."""
    first, count = min(troubles), sum(each.points for each in troubles)
    points, such = ("points", ", such as ") if count > 1 else ("point", ": ")
    return f"{count} {points} could not be run{such}{grid.point(first.first)}: {first.reason}"


class Crew(ExitStack):
    """Those who run what a store lacks; they are hired with the first point that is missing, and go home at the end.

    Parameters
    ----------
    store : TileStore
        Where results are put.
    options : Options
    """

    def __init__(self, store: TileStore, options: Options) -> None:
        super().__init__()
        self.store, self.options = store, options
        self._pool: Pool | None = None
        self._stop: StopFlag
        self._shown: Tally

    def _hire(self, wanted: int) -> Pool:
        options = self.options
        client = None if options.client is None else self.enter_context(connected(options.client))
        self._stop = self.enter_context(stop_on_signals())
        pool = self.enter_context(threads(options.workers, self._stop) if client is None else cluster(client))
        self._shown = self.enter_context(watch(wanted, self.store.modes(), pool.workers, show=options.progress))
        if options.progress and not pool.workers():
            print("waiting for the first worker of the cluster", file=sys.stderr, flush=True)
        return pool

    def run(self, work: Work, ranges: Iterable[Tile], wanted: int, known: Iterable[Finished] = ()) -> None:
        """Do `work` at the points of `ranges` that the store lacks, but for what is known; all is handed to the store.

        Parameters
        ----------
        work : Work
        ranges : iterable of Tile
        wanted : int
            How many points are to be run in all.
        known : iterable of Finished
            Points of these ranges that need not be run.

        Raises
        ------
        PointError, UnfinishedError, Stopped, StoreError
            See `sweep`; what was finished before is in the store.
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
        failures: list[tuple[int, str]] = []  # points, and why they have failed
        troubles: list[Trouble] = []
        alike = 0  # of them, in a row
        try:
            with patience(self._shown, self._pool, self._stop, self.options.give_up_after, show=self.options.progress):
                for points, made in run_tasks(self._pool, work, missing, pace, self._stop):
                    codes = made.results["codes"]
                    left -= len(codes)
                    for piece in pieces(points[: len(codes)], made.results, made.seconds):
                        self.store.add(piece)
                    if len(codes):
                        self._shown.add(tally(codes), made.seconds)
                        alike = 0
                    if made.broken:
                        troubles.append(Trouble(int(points[len(codes)]), made.broken, made.reason))
                        alike = alike + 1 if troubles[-1].sort == troubles[-2:][0].sort else 1
                    if self.options.fail_fast and not_ok(codes).any():
                        row = int(not_ok(codes).argmax())
                        failures.append((int(points[row]), why_failed(made.results[row])))
                    if failures or alike >= ALIKE or (troubles and self.options.fail_fast):
                        self._stop.set()
        except StoreError:  # of a disk that has refused, and would refuse once more
            raise
        except BaseException:
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
    stoppable(lambda _: get_ready(), kept="nothing was begun")
