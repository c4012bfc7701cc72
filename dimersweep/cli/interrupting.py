"""What Ctrl-C and SIGTERM do to a command that writes: one line says what is kept, and how to go on."""

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dimersweep.errors import Stopped

AGAIN = "run the same again with --force for the rest"

Stamp = tuple[int, int] | None  # of a file, to see whether it was replaced; None if there is none


@contextmanager
def interruptible(*outputs: Path | None, parts: Path | None = None, again: str = AGAIN) -> Iterator[None]:
    """End the process on Ctrl-C or SIGTERM with one line and the exit code of the signal.

    Parameters
    ----------
    *outputs : Path, optional
        What is to be written.
    parts : Path, optional
        The store of finished parts, from which the same command goes on.
    again : str
        How to go on if some of the outputs are written.
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
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _kept(before: Mapping[Path, Stamp], parts: Path | None, again: str) -> str:
    """What a stop leaves of the outputs, whose stamps were those `before`."""
    written = [str(path) for path, stamp in before.items() if _stamp(path) not in (None, stamp)]
    rest = [str(path) for path in before if str(path) not in written]
    if written:
        return f"{', '.join(written)} written" + (f", {', '.join(rest)} not; {again}" if rest else "")
    if parts is not None and parts.is_file():
        return f"what was finished is kept in {parts}; run the same again to go on"
    return "nothing was written"
