"""Send tasks to workers and take their results back: threads of this process, or of a dask.distributed cluster."""

import logging
import os
import socket
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from math import ceil
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from dimersweep.cubes.results import Tile, blank_results, chunks, ranges_of
from dimersweep.errors import KernelError, ParameterError, UserError, one_line
from dimersweep.extensions import ORBITS_CODE
from dimersweep.faces import __version__
from dimersweep.kernel import kernel_version
from dimersweep.work.proving import is_proven
from dimersweep.work.stopping import POLL, StopFlag
from dimersweep.work.tiles import TILE_SECONDS, TaskResult, Work, attempt
from dimersweep.work.waiting import MEMORY, Patience, lacks, words_for
from dimersweep.work.warming import get_ready

IN_FLIGHT = 2  # tasks for each worker: one runs and one waits, so that no worker idles and few tasks pile up
# number of tasks that a cluster has at a time, however few workers it has. An adaptive cluster asks for a thread for
# every 5 s of work, or every ten tasks: these are enough for 400 threads at once
DEMAND = 4096
# number of tasks of one point that a cluster without workers has at first: dask reckons half a second for each
FIRST_SHOWN = 128
TASK_GRACE = 1.0  # time to wait for running tasks when the sweep is stopped [s]
CONNECT_SECONDS = 10.0  # time to find a scheduler [s]
ANSWER_SECONDS = 2.0  # time for the answer of a worker [s]: its event loop is free while it computes
CLIENT_LOGS = ("distributed.client", "tornado.application", "asyncio")  # loggers of a connection that breaks
COUNT_SECONDS = 5.0  # time between two counts of the workers of a cluster, which may come and go [s]
TASK_GROWTH = 4  # largest ratio of the points of a task to the points that have come back in all
TASK_POINTS = 1 << 18  # largest number of points of a task, however quick they are: its results take 50 MB of memory
TILES_PER_WORKER = 4  # least number of tasks for each worker, so that no worker idles for long at the end
TASK_SECONDS = 0.004  # greatest cost of a task to driver and scheduler [s]: tasks are longer for more workers

DISCONNECTED = "scheduler: the connection to the cluster is lost; what was finished is kept"


class Pool(NamedTuple):
    """Workers that run tasks.

    Attributes
    ----------
    submit : callable
        ``submit(work, points, seconds, ahead)`` returns the future of a task, which waits behind `ahead` other tasks.
    workers : callable
        Returns the number of threads.
    stop : callable
        Stops the tasks of other processes, which do not see the flag of this one.
    lacks : callable
        Returns True if workers are missing.
    words : callable
        Returns a line on the workers that are there.
    demand : int
        Number of tasks that it takes at a time, however few workers it has.
    """

    submit: Callable[[Work, np.ndarray, float, int], "Future[TaskResult]"]
    workers: Callable[[], int]
    stop: Callable[[], None] = lambda: None
    lacks: Callable[[], bool] = lambda: False
    words: Callable[[], str] = lambda: "all threads are at work"
    demand: int = 0


def tile_seconds(workers: int) -> float:
    """Return the time of a task [s] at which driver and scheduler keep pace with a number of workers."""
    return max(TILE_SECONDS, TASK_SECONDS * workers)


class Pace:
    """The length of tasks in points: 1 at first, then by the time that the last points took.

    Parameters
    ----------
    size : int
        Number of points to run, of which each worker is to get a few tasks.
    workers : callable
        Returns the number of workers, which may come and go.
    demand : int
        Number of tasks that the pool takes at a time, see `Pool`.
    """

    def __init__(self, size: int, workers: Callable[[], int], demand: int = 0) -> None:
        self.size, self.workers, self.demand = size, workers, demand
        self.length, self.seen, self.is_known = 1, 0, False

    @property
    def seconds(self) -> float:
        """Time that a task should take [s]."""
        return tile_seconds(self.workers())

    @property
    def in_flight(self) -> int:
        """Largest number of tasks under way; small as long as the time of a point is not known."""
        workers = self.workers()
        # workers that are there answer soon, and a task of one point costs more than it computes
        shown = 0 if workers else min(FIRST_SHOWN, self.demand)
        return max(self.demand if self.is_known else shown, (IN_FLIGHT if self.seen else 1) * max(1, workers))

    def note(self, points: int, seconds: float) -> None:
        """Set the length of the next tasks from a task that has run a number of points in a time [s]."""
        if not points:
            return
        self.seen += points
        aim = int(self.seconds * points / max(seconds, 1e-6))
        longest = ceil(self.size / (TILES_PER_WORKER * max(1, self.workers())))
        length = min(aim, longest, TASK_POINTS)
        self.length, self.is_known = max(1, min(length, TASK_GROWTH * self.seen)), length <= TASK_GROWTH * self.seen


@contextmanager
def threads(workers: int, stop: StopFlag) -> Iterator[Pool]:
    """Yield a pool of threads in this process, the default: the kernel runs without Python's lock."""
    executor = ThreadPoolExecutor(workers, thread_name_prefix="dimersweep")
    try:
        yield Pool(
            lambda work, points, seconds, ahead: executor.submit(attempt, work, points, stop, seconds),
            lambda: workers,
        )
    finally:
        stop.set()
        executor.shutdown(wait=False, cancel_futures=True)


# in a worker process: a flag for each asker (a pool in another process) whose tasks it has run, or who has asked it to
# stop
_flags: dict[str, StopFlag] = {}


def stop_elsewhere(asker: str) -> None:
    """Stop, in a worker process, the tasks of one asker, also those that are still to come."""
    _flags.setdefault(asker, StopFlag()).set()


def _versions() -> tuple[str, str]:
    """Return the version of results with orbits, which an observer may ask for, and that of dimersweep."""
    return kernel_version(*ORBITS_CODE), __version__


def run_elsewhere(work: Work, points: np.ndarray, seconds: float, asked: tuple[str, str], asker: str) -> TaskResult:
    """Run points in a worker process for an asker in another process, if the kernel is the same there, and proven here.

    `asked` has the versions of the kernel and of dimersweep of the asker.

    Raises
    ------
    ParameterError
        If this process has another kernel, whose numbers could differ, or lacks something that the work needs.
    KernelError
        If the kernel cannot run here, or gives wrong numbers.
    """
    who = f"scheduler: worker process {os.getpid()} on {socket.gethostname()}"
    if asked[0] != _versions()[0]:  # asked first, before minutes are spent on compiling
        one, other = (" of dimersweep ".join(versions) for versions in (asked, _versions()))
        raise ParameterError(f"{who} has another kernel ({one} here, {other} there); give all the same version")
    try:
        get_ready()
        work.check_here()
    except (KernelError, ParameterError) as error:
        raise type(error)(f"{who}: {error}") from None
    return attempt(work, points, _flags.setdefault(asker, StopFlag()), seconds)


@contextmanager
def connected(client: Any) -> Iterator[Any]:
    """Yield a dask.distributed client as it is, or one for a scheduler's address, which is closed at the end.

    Raises
    ------
    ParameterError
        If there is no scheduler at that address.
    """
    if not isinstance(client, str):
        yield client
        return
    from distributed import Client

    try:
        made = Client(client, timeout=CONNECT_SECONDS)
    except (OSError, ValueError, ImportError) as error:
        raise ParameterError(f"scheduler = {client}: cannot be reached ({error})") from None
    with _quiet(), made:
        yield made


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the logs of our own client, with their tracebacks, from the user, who sees each error in one line."""
    logs = [logging.getLogger(name) for name in CLIENT_LOGS]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


def _is_news(record: logging.LogRecord) -> bool:
    """Return False for the error of a task that was cancelled, for which the executor of distributed may still wait."""
    return not (record.exc_info and isinstance(record.exc_info[1], CancelledError))


@contextmanager
def cluster(client: Any) -> Iterator[Pool]:
    """Yield the workers of a dask.distributed client as a pool; after an error in the context, stop their tasks."""
    logging.getLogger("tornado.application").addFilter(_is_news)
    executor: Any = client.get_executor(pure=False)
    counted, asker, begun = -COUNT_SECONDS, uuid4().hex, time.time()
    there: dict[str, int] = {}

    def workers() -> int:
        nonlocal counted, there
        if time.monotonic() - counted > COUNT_SECONDS:
            with _connection(), suppress(TimeoutError):
                there = client.nthreads(callback_timeout=ANSWER_SECONDS)
            counted = time.monotonic()
        return sum(there.values())

    def words() -> str:
        # the notes of the scheduler are asked for. To subscribe to them would replace a handler that the user has on
        # this client
        noted = answers(client.sync, client.scheduler.events).get("all", ())
        events = [event for at, event in noted if at >= begun and isinstance(event, dict)]
        left = [bool(event.get("expected")) for event in events if event.get("action") == "remove-worker"]
        unready = list(answers(client.run, is_proven, on_error="return").values()).count(False)
        return words_for(client, there, left, unready)

    def submit(work: Work, points: np.ndarray, seconds: float, ahead: int) -> "Future[TaskResult]":
        # the task carries its points along: data scattered beforehand could die with a worker. Its priority is lower
        # the more tasks of this driver are ahead, so that tasks of another driver pass
        with _connection():
            given = *work.narrowed(points), seconds, _versions(), asker
            return executor.submit(run_elsewhere, *given, priority=-ahead)

    def stop() -> None:
        if client.scheduler is None:  # a client that is closed, as after its scheduler has gone, reaches no worker
            return
        for error in answers(client.run, stop_elsewhere, asker, on_error="return").values():
            has_left = isinstance(error, OSError) and not isinstance(error, TimeoutError)
            if error is not None and not has_left:
                why = f"{type(error).__name__}: {one_line(error)}"
                warnings.warn(f"scheduler: a worker could not be told to stop ({why})", RuntimeWarning, stacklevel=2)

    try:
        yield Pool(submit, workers, stop, lambda: lacks(client, there), words, DEMAND)
    except BaseException:
        stop()
        raise
    finally:
        with suppress(Exception):  # the connection may be broken, for which distributed has no common class of errors
            executor.shutdown(wait=False)


def answers(call: Callable[..., dict[str, Any]], *given: Any, **more: Any) -> dict[str, Any]:
    """Return the answers to a method of a client, by worker, within `ANSWER_SECONDS`.

    If the scheduler hangs, or the connection is broken, the error is the only entry, under "".
    """
    try:
        return call(*given, callback_timeout=ANSWER_SECONDS, **more)
    except Exception as error:  # the errors after a broken connection have no common class in distributed
        return {"": error}


@contextmanager
def _connection() -> Iterator[None]:
    """Raise a UserError for an error in the context, which shows that the connection to the cluster is broken."""
    try:
        yield
    except Exception as error:  # the errors after a broken connection have no common class in distributed
        raise UserError(f"{DISCONNECTED} ({type(error).__name__}: {error})") from error


def outcome(future: "Future[TaskResult]", points: int) -> TaskResult:
    """Return the result of a task with a number of points; if its worker died, all of them count as broken.

    Raises
    ------
    UserError
        If the connection to the cluster is lost, or a worker cannot take part.
    """
    try:
        return future.result()
    except CancelledError:
        raise UserError(DISCONNECTED) from None
    except UserError:
        raise
    except Exception as error:  # an error of the machinery: `attempt` catches errors of the kernel
        hint = f" {MEMORY}" if type(error).__name__ == "KilledWorker" else ""
        return TaskResult(blank_results(0), broken=points, reason=f"{type(error).__name__}: {error}{hint}")


def run_tasks(
    pool: Pool, work: Work, missing: Iterable[Tile], pace: Pace, stop: StopFlag, patience: Patience
) -> Iterator[tuple[np.ndarray, TaskResult]]:
    """Run `work` at the points of `missing`, in tasks as long as `pace` says, until all are done or `stop` is set.

    `patience` may set `stop`, too. Points that a task leaves undone go into new tasks. After `stop`, running tasks have
    `TASK_GRACE` seconds to come back with the points they have done.

    Yields
    ------
    points : ndarray of int
        Numbers of the points of a task.
    made : TaskResult
        Its results.
    """
    running: dict[Future[TaskResult], np.ndarray] = {}
    # futures that have ended, put there by themselves: to look at thousands of futures each time takes far longer
    done: SimpleQueue[Future[TaskResult]] = SimpleQueue()
    undone: deque[np.ndarray] = deque()
    tasks = chunks(missing, lambda: pace.length, work.line)
    while not stop.is_set():
        while len(running) < pace.in_flight and (done.empty() or len(running) < IN_FLIGHT * pool.workers()):
            task = undone.popleft() if undone else next(tasks, None)
            if task is None:
                break
            future = pool.submit(work, task, pace.seconds, len(running))
            running[future] = task
            future.add_done_callback(done.put)
        if not running:
            return
        try:
            future = done.get(timeout=POLL)
        except Empty:
            patience.look(came=False)
            continue
        task = running.pop(future)
        made = outcome(future, task.size)
        pace.note(len(made.results), made.seconds)
        patience.look(came=len(made.results) > 0)
        left = task[len(made.results) + made.broken :]
        undone.extend(chunks(ranges_of(left), lambda: pace.length, work.line))  # for one task they may be far too many
        yield task, made
    pool.stop()
    for future in wait(running, timeout=TASK_GRACE).done:
        if not future.cancelled() and future.exception() is None:
            yield running[future], future.result()
