"""Ctrl-C and SIGTERM as a flag that a sweep looks at, so that what is finished is kept before it ends."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dimersweep.errors import Stopped
from dimersweep.work.stopping import StopFlag


@contextmanager
def stop_on_signals() -> Iterator[StopFlag]:
    """A flag that SIGINT and SIGTERM set while the context lasts; a second one raises `Stopped` at once.

    In a thread other than the main one, which cannot have signals, the flag is never set by itself. A signal that is
    ignored stays ignored.
    """
    flag = StopFlag()

    def note(number: int, frame: Any) -> None:
        if flag.is_set():
            raise Stopped("", number)
        flag.signal = number
        flag.set()

    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    watched = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    try:
        for number in watched:
            signal.signal(number, note)
        yield flag
    finally:
        for number in watched:
            signal.signal(number, before[number])
