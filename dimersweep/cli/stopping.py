"""What Ctrl-C and SIGTERM do to a command that keeps what it has finished."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dimersweep.errors import Stopped


@contextmanager
def stoppable() -> Iterator[None]:
    """End the process on Ctrl-C or SIGTERM with one line and the exit code of the signal."""

    def terminate(number: int, frame: Any) -> None:
        raise Stopped("", number)

    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt as stop:
        number = stop.signal if isinstance(stop, Stopped) else signal.SIGINT
        word = "interrupted" if number == signal.SIGINT else "terminated"
        print(f"dimersweep: {word}: {stop}".rstrip(": "), file=sys.stderr, flush=True)
        os._exit(128 + number)  # threads may be inside compiled code, which signals do not reach
