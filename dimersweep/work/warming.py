"""Compile the kernel in a process of its own, once for all processes that share a cache.

Compiling holds Python's lock, and takes 1 GB.
"""

import subprocess
import sys
import time
from contextlib import suppress

from dimersweep.errors import KernelError, one_line
from dimersweep.kernel.compiler import cache, pipelines, versions
from dimersweep.storage.locking import locked
from dimersweep.work.progress import report_compiling
from dimersweep.work.proving import is_proven, prove
from dimersweep.work.waiting import MEMORY

WARM = "warm"  # name of the mark in the cache that the code of the whole kernel is there
# program of the process that compiles
COMPILE = "from dimersweep.work.proving import prove; prove(); import dimersweep; dimersweep.simulate(periods=1)"


def get_ready(*, progress: bool = True) -> None:
    """Compile the kernel if its code is not there, load it and prove it; with `progress`, report the compiling."""
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
    """Return True if the code of the whole kernel is in the cache, or none is needed."""
    return (
        pipelines.pipeline() == pipelines.PYTHON
        or cache.load(versions.code_version(pipelines.pipeline()), WARM) is not None
    )


def _warm() -> None:
    """Have another process compile the kernel into the cache, or wait for a process that does so already.

    Meanwhile Python's lock of this process is free for its other threads.
    """
    for folder in cache.base_folders():
        # an OSError comes from a folder or a lock of another user, or a machine without memory for a process: then the
        # next folder is tried, and at last this process compiles
        with suppress(OSError):
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
    """Run the process that compiles, and put a mark into the cache if it succeeds."""
    done = subprocess.run([sys.executable, "-c", COMPILE], capture_output=True, text=True, check=False)
    if done.returncode < 0:
        raise KernelError(f"kernel: the process that compiles it was ended by signal {-done.returncode}; {MEMORY}")
    pipelines.take(pipelines.first_pipeline())  # the other process may have noted that the fast way fails
    if done.returncode == 0:
        cache.save(versions.code_version(pipelines.pipeline()), WARM, b"")
    else:  # this process meets the same error and raises it, or compiles without the cache
        why = one_line(done.stderr.strip().rpartition("\n")[2])
        print(f"kernel: compiled in this process, after {why}", file=sys.stderr)
