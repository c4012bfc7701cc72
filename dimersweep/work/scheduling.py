"""Tiles to workers and results back: threads of this process, or those of any dask.distributed cluster."""

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
from dimersweep.faces import __version__
from dimersweep.kernel import kernel_version
from dimersweep.work.proving import is_proven
from dimersweep.work.stopping import POLL, StopFlag
from dimersweep.work.tiles import TILE_SECONDS, TaskResult, Work, attempt
from dimersweep.work.waiting import MEMORY, Patience, lacks, words_for
from dimersweep.work.warming import get_ready

IN_FLIGHT = 2  # tasks for each worker: one runs and one waits, so that none idles and a million tiles do not pile up
# tasks that a cluster is shown, however few workers it has: an adaptive one asks for as many threads as there are 5 s of work,
# or ten tasks, and these are enough for 400 threads at once
DEMAND = 4096
FIRST_SHOWN = 128  # of them before one has come back: of a point each, which dask takes for half a second
TASK_GRACE = 1.0  # seconds that running tiles have to come back when the sweep is stopped
CONNECT_SECONDS = 10.0  # to find a scheduler
ANSWER_SECONDS = 2.0  # that workers have to answer what they are asked: their loop is free while they compute
CLIENT_LOGS = ("distributed.client", "tornado.application", "asyncio")  # they log a connection that is lost
COUNT_SECONDS = 5.0  # between two counts of the workers of a cluster, which may come and go
TASK_GROWTH = 4  # a task has at most this many times the points that have come back in all
TASK_POINTS = 1 << 18  # points of a task, however quick they are: its results take 50 MB of whoever holds them
TILES_PER_WORKER = 4  # at least, so that no worker idles for long at the end
TASK_SECONDS = 0.004  # that a task costs driver and scheduler at most: tasks are long enough for so many workers

LOST = "scheduler: the connection to the cluster is lost; what was finished is kept"


class Pool(NamedTuple):
    """Where work is done: ``submit(work, points, seconds, ahead)`` gives a future of a `TaskResult`, behind `ahead` others.

    ``workers()`` counts threads; ``stop()`` has tasks end that do not see the flag of this process; ``lacks()`` tells whether
    workers are missing, and ``words()`` who is there; and `demand` is how many tasks it may be given ahead.
    """

    submit: Callable[[Work, np.ndarray, float, int], "Future[TaskResult]"]
    workers: Callable[[], int]
    stop: Callable[[], None] = lambda: None
    lacks: Callable[[], bool] = lambda: False
    words: Callable[[], str] = lambda: "all threads are at work"
    demand: int = 0


def tile_seconds(workers: int) -> float:
    """Time of a task for so many workers [s]: driver and scheduler are to keep pace with all of them."""
    return max(TILE_SECONDS, TASK_SECONDS * workers)


class Pace:
    """How many points make a task, from the time that the last ones took; one at first.

    Parameters
    ----------
    size : int
        Points to run: each worker is to get a few tasks of them.
    workers : callable
        How many run at a time; they may come and go.
    demand : int
        See `Pool`.
    """

    def __init__(self, size: int, workers: Callable[[], int], demand: int = 0) -> None:
        self.size, self.workers, self.demand = size, workers, demand
        self.length, self.seen, self.is_known = 1, 0, False

    @property
    def seconds(self) -> float:
        """Time that a task is to take [s]."""
        return tile_seconds(self.workers())

    @property
    def in_flight(self) -> int:
        """How many tasks may be under way: as long as nothing is known of their time, few of them."""
        ahead = self.demand if self.is_known else min(FIRST_SHOWN, self.demand)
        return max(ahead, (IN_FLIGHT if self.seen else 1) * max(1, self.workers()))

    def note(self, points: int, seconds: float) -> None:
        """Learn from what a task has done: so many points in so much time [s]."""
        if not points:
            return
        self.seen += points
        aim = int(self.seconds * points / max(seconds, 1e-6))
        longest = ceil(self.size / (TILES_PER_WORKER * max(1, self.workers())))
        length = min(aim, longest, TASK_POINTS)
        self.length, self.is_known = max(1, min(length, TASK_GROWTH * self.seen)), length <= TASK_GROWTH * self.seen


@contextmanager
def threads(workers: int, stop: StopFlag) -> Iterator[Pool]:
    """A pool of threads in this process, the default: the kernel leaves Python's lock alone."""
    executor = ThreadPoolExecutor(workers, thread_name_prefix="dimersweep")
    try:
        yield Pool(
            lambda work, points, seconds, ahead: executor.submit(attempt, work, points, stop, seconds),
            lambda: workers,
        )
    finally:
        stop.set()
        executor.shutdown(wait=False, cancel_futures=True)


_flags: dict[str, StopFlag] = {}  # in a worker process: of those for whom it has worked, or who asked it to stop


def stop_elsewhere(asker: str) -> None:
    """In a worker process, end the tasks of one who asked for them, and those of him that are still to come."""
    _flags.setdefault(asker, StopFlag()).set()


def run_elsewhere(work: Work, points: np.ndarray, seconds: float, asked: tuple[str, str], asker: str) -> TaskResult:
    """Run points in a worker process, if that has the same kernel as the process that asks, and it works there.

    `asked` are the versions of the kernel and of dimersweep in that process.

    Raises
    ------
    ParameterError
        If the kernel is another one: its numbers could differ; or if something that the work takes is missing.
    KernelError
        If it cannot run there, or gives wrong numbers.
    """
    who = f"scheduler: worker process {os.getpid()} on {socket.gethostname()}"
    if asked[0] != kernel_version():  # before minutes go by
        one, other = " of dimersweep ".join(asked), f"{kernel_version()} of dimersweep {__version__}"
        raise ParameterError(f"{who} has another kernel ({one} here, {other} there); give all the same version")
    try:
        get_ready()
        work.check_here()
    except (KernelError, ParameterError) as error:
        raise type(error)(f"{who}: {error}") from None
    return attempt(work, points, _flags.setdefault(asker, StopFlag()), seconds)


@contextmanager
def connected(client: Any) -> Iterator[Any]:
    """A dask.distributed client as it is, or one for a scheduler's address that is closed at the end.

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


@contextmanager
def cluster(client: Any) -> Iterator[Pool]:
    """The workers of a dask.distributed client."""
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
        # what the scheduler has noted is asked for: who subscribes to it replaces whoever else has on this client
        noted = answers(client.sync, client.scheduler.events).get("all", ())
        events = [event for at, event in noted if at >= begun and isinstance(event, dict)]
        left = [bool(event.get("expected")) for event in events if event.get("action") == "remove-worker"]
        unready = list(answers(client.run, is_proven, on_error="return").values()).count(False)
        return words_for(client, there, left, unready)

    def submit(work: Work, points: np.ndarray, seconds: float, ahead: int) -> "Future[TaskResult]":
        # The task carries its points along: data scattered beforehand could die with a worker. What waits behind others of
        # ours lets those of another driver pass.
        with _connection():
            given = *work.narrowed(points), seconds, (kernel_version(), __version__), asker
            return executor.submit(run_elsewhere, *given, priority=-ahead)

    def stop() -> None:
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
        with suppress(Exception):  # of a connection that is lost, for which distributed has no common class
            executor.shutdown(wait=False)


def answers(ask: Callable[..., dict[str, Any]], *given: Any, **more: Any) -> dict[str, Any]:
    """Return what a method of a client answers within `ANSWER_SECONDS`; an error alone where whom it asks hangs, or is lost."""
    try:
        return ask(*given, callback_timeout=ANSWER_SECONDS, **more)
    except Exception as error:  # distributed has no common class for what a lost scheduler leads to
        return {"": error}


@contextmanager
def _connection() -> Iterator[None]:
    try:
        yield
    except Exception as error:  # distributed has no common class for what a lost scheduler leads to
        raise UserError(f"{LOST} ({type(error).__name__}: {error})") from error


def outcome(future: "Future[TaskResult]", points: int) -> TaskResult:
    """What became of a task of so many points: all are broken if the worker died with them.

    Raises
    ------
    UserError
        If the connection to the cluster is lost, or a worker cannot take part.
    """
    try:
        return future.result()
    except CancelledError:
        raise UserError(LOST) from None
    except UserError:
        raise
    except Exception as error:  # of the machinery: `attempt` catches those of the kernel
        hint = f" {MEMORY}" if type(error).__name__ == "KilledWorker" else ""
        return TaskResult(blank_results(0), broken=points, reason=f"{type(error).__name__}: {error}{hint}")


def run_tasks(
    pool: Pool, work: Work, missing: Iterable[Tile], pace: Pace, stop: StopFlag, patience: Patience
) -> Iterator[tuple[np.ndarray, TaskResult]]:
    """Do `work` at the points of `missing`, in tasks as `pace` says, until all are done or `stop` is set, as by `patience`.

    What a task brings back undone becomes a task of its own. After `stop`, tasks that run have `TASK_GRACE` seconds to come
    back with the points they have.

    Yields
    ------
    points : ndarray of int
        Of a task.
    made : Made
        What it brings back.
    """
    running: dict[Future[TaskResult], np.ndarray] = {}
    done: SimpleQueue[Future[TaskResult]] = SimpleQueue()  # to wait for each of thousands takes far longer
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
        undone.extend(chunks(ranges_of(left), lambda: pace.length, work.line))  # it may be far too much for one
        yield task, made
    pool.stop()
    for future in wait(running, timeout=TASK_GRACE).done:
        if not future.cancelled() and future.exception() is None:
            yield running[future], future.result()
