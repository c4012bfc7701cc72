"""Stop runs of the kernel from outside, by a signal or at a time: compiled code sees neither."""

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

RUN_GRACE = 1.0  # time to wait for a run to end when it is stopped [s]: a compiler at work does not end
POLL = 0.1  # time between two looks at the flag [s]

T = TypeVar("T")


class StopFlag(threading.Event):
    """An event that is set when work is to stop; runs on its scratch arrays then end, too."""

    signal = 0  # number of the signal that has set the flag, or 0
    given_up = ""  # in words, why a sweep that waited in vain has set the flag; "" else

    def __init__(self) -> None:
        super().__init__()
        self._spaces: dict[int, Workspace] = {}

    def set(self) -> None:
        """Set the flag, and stop all runs on its scratch arrays."""
        super().set()
        for space in list(self._spaces.values()):
            stop(space)

    @contextmanager
    def space(self) -> Iterator[Workspace]:
        """Yield scratch arrays for the runs of one thread; if the flag is set, these runs end at once."""
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
    """Yield a flag that SIGINT and SIGTERM set while the context lasts; a second signal raises `Stopped` at once.

    In a thread other than the main one, which receives no signals, nothing sets the flag by itself. A signal that is
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
    """Return the result of `call`, whose runs are stopped by a signal, or at the end of its time.

    Parameters
    ----------
    call : callable
        Function that runs the kernel on the scratch arrays it receives. It is called in another thread, so that this
        one sees signals; Python does not wait for that thread at its end. In a thread that receives no signals it is
        called right here, unless its time is bounded.
    seconds : float, optional
        Bound on the time of the call [s].
    kept : str
        Results that are saved already if it is stopped, in words; "" if there are none.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C if `kept` is empty.
    Stopped
        On SIGTERM, and on Ctrl-C if `kept` is not empty; it is a KeyboardInterrupt, too.
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
            raise KeyboardInterrupt  # a script that does not catch it ends as by the signal
        raise Stopped(kept, flag.signal)
