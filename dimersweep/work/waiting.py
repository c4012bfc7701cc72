"""Say every minute what a sweep waits for, while nothing comes back or workers are missing, and give up when asked to."""

import re
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

from dimersweep.work.progress import Tally, clock
from dimersweep.work.stopping import StopFlag

LOOK_SECONDS, SILENT_SECONDS = 5.0, 60.0  # between two looks, and two lines
QUEUES = {"sbatch": "squeue --me", "bsub": "bjobs", "condor_submit": "condor_q"}  # by what a job is submitted with
MEMORY = "a worker takes 270 MB with the kernel loaded, and 1.0 GB beside it while that is compiled"
HEAL = "cluster.adapt(minimum_jobs=n, maximum_jobs=n) replaces workers that leave, cluster.scale does not"


@contextmanager
def patience(tally: Tally, pool: Any, stop: StopFlag, seconds: float | None = None, *, show: bool) -> Iterator[None]:
    """Say what is waited for on stderr, if it is to be shown, and set `stop` if nothing has come back for `seconds` [s].

    There is a line for each minute without a result in the `tally`, and for each in which workers of the `Pool` were missing.
    """
    ended = threading.Event()

    def watch() -> None:
        done, told = tally.done, monotonic()
        came = well = told  # the last result, and when all workers were there
        while not ended.wait(LOOK_SECONDS if seconds is None else min(LOOK_SECONDS, seconds / 2)):
            now = monotonic()
            done, came = tally.done, now if tally.done != done else came
            well = well if pool.lacks() else now
            silent = f"no result for {clock(now - came)}; "
            if seconds is not None and now - came >= seconds:
                stop.given_up = silent + pool.words()
                stop.set()
                return
            if show and now - max(told, min(came, well)) >= SILENT_SECONDS - LOOK_SECONDS / 2:
                told = now
                print((silent if now - came >= LOOK_SECONDS else "") + pool.words(), file=sys.stderr, flush=True)

    threading.Thread(target=watch, daemon=True, name="dimersweep-waits").start()
    try:
        yield
    finally:
        ended.set()


def lacks(client: Any, there: Mapping[str, int]) -> bool:
    """Return whether a client has none of its workers, or fewer than its cluster asks for."""
    return len(there) < max(1, len(getattr(client.cluster, "plan", ())))


def words_for(client: Any, there: Mapping[str, int], told_to_leave: Sequence[bool], compiling: int) -> str:
    """Return who works for a client, and if workers are missing what is asked for, and where to look.

    `there` has the threads of each worker, and `told_to_leave` whether each that has left was told to.
    """
    words = f"{len(there)} workers with {sum(there.values())} threads" if there else "no worker"
    words += f"; {compiling} wait until the kernel is compiled" if compiling else ""
    left, died = len(told_to_leave), told_to_leave.count(False)
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
        queue = QUEUES.get(getattr(cluster.job_cls, "submit_command", ""), "the queue")
        words += f" (each of them {asked}); see {queue}, and the newest log of a job: {newest}"
        words += f"; {HEAL}" if left else ""
    return words
