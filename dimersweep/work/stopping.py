"""Ending runs of the kernel from outside: compiled code does not see signals, nor the time."""

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from dimersweep.errors import Stopped
from dimersweep.kernel.batch import Workspace, new_workspace, stop

RUN_GRACE = 1.0  # seconds that a run has to end when it is stopped: a compiler at work does not

T = TypeVar("T")


class StopFlag(threading.Event):
    """Set when work is to stop: what runs on its spaces ends too. `signal` is the number of the signal that asked, or 0."""

    signal = 0

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


def in_thread(call: Callable[[], T]) -> "Future[T]":
    """The future of `call` in a thread of its own, for which Python does not wait at its end."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True, name="dimersweep").start()
    return future


def stoppable(call: Callable[[Workspace], T], seconds: float | None = None) -> T:
    """What `call` returns, with scratch arrays whose runs Ctrl-C stops, or the end of its time.

    Parameters
    ----------
    call : callable
        Runs the kernel on the arrays that it is given. Made in another thread, so that this one can see signals;
        in a thread that has none, and has no bound on its time, it is made right here.
    seconds : float, optional
        Bound on its time [s].
    """
    flag = StopFlag()

    def work() -> T:
        with flag.space() as space:
            return call(space)

    if seconds is None and threading.current_thread() is not threading.main_thread():
        return work()
    future: Future[T] | None = None
    try:
        future = in_thread(work)
        try:
            return future.result(seconds)
        except TimeoutError:
            flag.set()
            return future.result()
    except KeyboardInterrupt:
        flag.set()
        with suppress(TimeoutError):
            if future is not None:
                future.exception(RUN_GRACE)
        raise
