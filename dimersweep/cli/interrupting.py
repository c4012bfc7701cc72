"""End a command on Ctrl-C or SIGTERM with one line: the files that are kept, and how to resume."""

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dimersweep.errors import Stopped

AGAIN = "run the same again with --force for the rest"

Stamp = tuple[int, int] | None  # inode and time of change [ns] of a file, which show that it was replaced; None without


@contextmanager
def interruptible(*outputs: Path | None, parts: Path | None = None, again: str = AGAIN) -> Iterator[None]:
    """End the process on Ctrl-C or SIGTERM with one line and the exit code of the signal.

    Parameters
    ----------
    *outputs : Path, optional
        Files that the command writes.
    parts : Path, optional
        Store of finished points, from which the same command resumes.
    again : str
        Advice for the user if only some of the outputs are written.
    """
    before = {path: _stamp(path) for path in outputs if path is not None}

    def terminate(number: int, frame: Any) -> None:
        raise Stopped("", number)

    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt as stop:
        number = stop.signal if isinstance(stop, Stopped) else signal.SIGINT
        word = "interrupted" if number == signal.SIGINT else "terminated"
        print(f"dimersweep: {word}: {str(stop) or _kept(before, parts, again)}", file=sys.stderr, flush=True)
        os._exit(128 + number)  # threads may be inside compiled code, which signals do not reach


def _stamp(path: Path) -> Stamp:
    """Return the inode and the time of change [ns] of a file; None if there is no file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _kept(before: Mapping[Path, Stamp], parts: Path | None, again: str) -> str:
    """Return the message on the outputs that were written before the stop; `before` are their stamps at the start."""
    written = [str(path) for path, stamp in before.items() if _stamp(path) not in (None, stamp)]
    rest = [str(path) for path in before if str(path) not in written]
    if written:
        return f"{', '.join(written)} written" + (f", {', '.join(rest)} not; {again}" if rest else "")
    if parts is not None and parts.is_file():
        return f"what was finished is kept in {parts}; run the same again to go on"
    return "nothing was written"
