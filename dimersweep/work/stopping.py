"""Ending runs of the kernel from outside: compiled code does not see signals, nor the time."""

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from math import inf
from time import monotonic
from typing import Any, TypeVar

from dimersweep.errors import Stopped
from dimersweep.kernel.batch import Workspace, new_workspace, stop

RUN_GRACE = 1.0  # seconds that a run has to end when it is stopped: a compiler at work does not
POLL = 0.1  # seconds between two looks at the flag

T = TypeVar("T")


class StopFlag(threading.Event):
    """Set when work is to stop: what runs on its spaces ends too. `signal` is the number of the signal that asked, or 0."""

    signal = 0
    given_up = ""  # what was waited for in vain

    def __init__(self) -> None:
        super().__init__()
        self._spaces: dict[int, Workspace] = {}

    def set(self) -> None:
        """Have all work stop."""
        super().set()
        for space in list(self._spaces.values()):
            stop(space)

    @contextmanager
    def space(self) -> Iterator[Workspace]:
        """Scratch arrays for the runs of one thread."""
        space = new_workspace()
        self._spaces[id(space)] = space
        if self.is_set():
            stop(space)
        try:
            yield space
        finally:
            del self._spaces[id(space)]


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


def stoppable(call: Callable[[Workspace], T], seconds: float | None = None, kept: str = "") -> T:
    """What `call` returns, with scratch arrays whose runs a signal stops, or the end of its time.

    Parameters
    ----------
    call : callable
        Runs the kernel on the arrays that it is given. Made in another thread, for which Python does not wait at its end, so
        that this one can see signals; in a thread that has none, and has no bound on its time, it is made right here.
    seconds : float, optional
        Bound on its time [s].
    kept : str
        What is kept if it is stopped, in words.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, and `Stopped`, which is one, on SIGTERM; or on both, if something is kept.
    """
    future: Future[T] = Future()
    ends = inf if seconds is None else monotonic() + seconds

    def run(flag: StopFlag) -> None:
        try:
            with flag.space() as space:
                future.set_result(call(space))
        except BaseException as error:
            future.set_exception(error)

    with stop_on_signals() as flag:
        if seconds is None and threading.current_thread() is not threading.main_thread():
            run(flag)
        else:
            threading.Thread(target=run, args=(flag,), daemon=True, name="dimersweep").start()
        while not flag.is_set() and not wait([future], min(POLL, max(0.0, ends - monotonic()))).done:
            if monotonic() >= ends:
                flag.set()
        if not flag.signal:
            return future.result()
        with suppress(TimeoutError):
            future.exception(RUN_GRACE)
        if flag.signal == signal.SIGINT and not kept:
            raise KeyboardInterrupt  # a script that does not catch it ends by the signal
        raise Stopped(kept, flag.signal)
