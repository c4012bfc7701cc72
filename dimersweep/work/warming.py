"""The kernel compiled by a process of its own, once for all that share a cache: that keeps Python's lock, and takes 1 GB."""

import subprocess
import sys
import time
from contextlib import suppress

from dimersweep.errors import KernelError, one_line
from dimersweep.kernel.compiler import cache, versions, ways
from dimersweep.storage.locking import locked
from dimersweep.work.progress import report_compiling
from dimersweep.work.proving import is_proven, prove
from dimersweep.work.waiting import MEMORY

WARM = "warm"  # what is kept beside the code when all of it is there
COMPILE = "from dimersweep.work.proving import prove; prove(); import dimersweep; dimersweep.simulate(periods=1)"


def get_ready(*, progress: bool = True) -> None:
    """Compile the kernel, where that is still to be done, load it and prove it; say that it is compiled, if that is wanted."""
    if is_proven():
        return
    if progress:
        report_compiling()
    cache.under_way.set()
    try:
        _warm()
    finally:
        cache.under_way.clear()
    prove()


def _is_warm() -> bool:
    return ways.way() == ways.PYTHON or cache.load(versions.code_version(ways.way()), WARM) is not None


def _warm() -> None:
    """Have the kernel compiled and kept, while this process stays free for others; wait for one that does it already."""
    for folder in cache.base_folders():
        with suppress(
            OSError
        ):  # of a folder, or a lock, of somebody else's, or of a machine without room for a process
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            while not _is_warm():
                try:
                    with locked(folder / "compiling.lock"):
                        if not _is_warm():
                            _compile()
                        return
                except BlockingIOError:
                    time.sleep(0.5)
            return


def _compile() -> None:
    done = subprocess.run([sys.executable, "-c", COMPILE], capture_output=True, text=True, check=False)
    if done.returncode < 0:
        raise KernelError(f"kernel: the process that compiles it was ended by signal {-done.returncode}; {MEMORY}")
    ways.take(ways.first_way())  # which that process may have found to fail
    if done.returncode == 0:
        cache.save(versions.code_version(ways.way()), WARM, b"")
    else:  # this process will find the same, or do without
        why = one_line(done.stderr.strip().rpartition("\n")[2])
        print(f"kernel: compiled in this process, after {why}", file=sys.stderr)
