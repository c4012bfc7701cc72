"""Tell the user every minute what a sweep waits for, if results or workers are missing, and give up in time."""

import re
import sys
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from time import monotonic
from typing import Any

from dimersweep.work.progress import clock
from dimersweep.work.stopping import StopFlag

SILENT_SECONDS = 60.0  # time between two lines [s]
# hints for the user: the memory of a worker, and the way to keep a cluster at its size
MEMORY = "a worker takes 270 MB with the kernel loaded, and 1.0 GB beside it while that is compiled"
HEAL = "cluster.adapt(minimum_jobs=n, maximum_jobs=n) replaces workers that leave, cluster.scale does not"


class Patience:
    """Watch over a sweep: a line once a minute while results or workers are missing, and an end after a long wait.

    Parameters
    ----------
    pool : Pool
        Workers that are watched.
    stop : StopFlag
        Flag that is set if no result comes for `seconds`.
    seconds : float or None
        Longest time without a result [s]; None for no bound.
    show : bool
        Print the lines.
    """

    def __init__(self, pool: Any, stop: StopFlag, seconds: float | None, *, show: bool) -> None:
        self.pool, self.stop, self.seconds, self.show = pool, stop, inf if seconds is None else seconds, show
        # times of the last line, of the last result, and of the last look at which all workers were there [s]
        self.printed = self.came = self.well = monotonic()

    def look(self, *, came: bool) -> None:
        """Note whether a result has come since the last look; print a line or set the flag if it is time."""
        now = monotonic()
        self.came = now if came else self.came
        self.well = self.well if self.pool.lacks() else now
        silent = now - self.came
        if silent >= self.seconds:
            self.stop.given_up = f"no result for {clock(silent)}; {self.pool.words()}"
            self.stop.set()
        elif self.show and now - max(self.printed, min(self.came, self.well)) >= SILENT_SECONDS:
            self.printed = now
            words = f"no result for {clock(silent)}; " if silent >= 1.0 else ""
            print(words + self.pool.words(), file=sys.stderr, flush=True)


def lacks(client: Any, there: Mapping[str, int]) -> bool:
    """Return True if a client has no workers, or fewer than its cluster asks for."""
    return len(there) < max(1, len(getattr(client.cluster, "plan", ())))


def words_for(client: Any, there: Mapping[str, int], retired: Sequence[bool], unready: int) -> str:
    """Return a line on the workers of a client; if some are missing, also on the jobs of the cluster and their logs.

    `there` has the threads of each worker, `retired` has True or, if it died, False for each that has left, and
    `unready` counts workers that have not compiled or loaded the kernel yet.
    """
    words = f"{len(there)} workers with {sum(there.values())} threads" if there else "no worker"
    words += f"; {unready} have yet to compile or load the kernel" if unready else ""
    left, died = len(retired), retired.count(False)
    words += f"; {left} have left" if left else ""
    words += f", {died} of them untold: {MEMORY}" if died else ""
    cluster = client.cluster
    if cluster is None or not lacks(client, there):
        return words
    words += f"; {type(cluster).__name__} asks for {len(getattr(cluster, 'plan', ()))}"
    if header := getattr(cluster, "job_header", ""):
        asked = " ".join(line.partition(" ")[2] for line in header.splitlines())
        files = [Path(name) for name in re.findall(r"-[oe] (\S+)", header)] or [Path("slurm-%j.out")]
        logs = [log for each in files for log in each.parent.glob(re.sub("%[a-zA-Z]", "*", each.name))]
        newest = max(logs, key=lambda log: log.stat().st_mtime, default="none yet")
        words += f" (each of them {asked}); see the queue (squeue --me), and the newest log of a job: {newest}"
        words += f"; {HEAL}" if left else ""
    return words
