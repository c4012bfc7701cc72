"""Tiles to workers and results back: threads of this process, or those of any dask.distributed cluster."""

import logging
import os
import platform
import socket
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from math import ceil
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, TypeVar
from uuid import uuid4

import numpy as np

from dimersweep.cubes.results import Tile, blank_results, chunks, ranges_of
from dimersweep.errors import KernelError, ParameterError, UserError, one_line
from dimersweep.faces import __version__
from dimersweep.kernel import kernel_version
from dimersweep.work.progress import report_compiling
from dimersweep.work.proving import is_proven
from dimersweep.work.stopping import POLL, StopFlag
from dimersweep.work.tiles import TILE_SECONDS, Made, Work, attempt
from dimersweep.work.waiting import MEMORY, lacks, words_for
from dimersweep.work.warming import get_ready, is_compiling

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

KERNEL_NAME = "kernel version"

T = TypeVar("T")
LOST = "scheduler: the connection to the cluster is lost; what was finished is kept"


class Pool(NamedTuple):
    """Where work is done: ``submit(work, points, seconds)`` gives a future of a `Made`; ``workers()`` counts threads.

    ``stop()`` has tasks end that do not see the flag of this process; ``lacks()`` tells whether workers are missing, and
    ``words()`` who is there; and `demand` is how many tasks it may be given ahead.
    """

    submit: Callable[[Work, np.ndarray, float], "Future[Made]"]
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
            lambda work, points, seconds: executor.submit(attempt, work, points, stop, seconds),
            lambda: workers,
        )
    finally:
        stop.set()
        executor.shutdown(wait=False, cancel_futures=True)


_flags: dict[str, StopFlag] = {}  # in a worker process: of those for whom it has worked, or who asked it to stop


def stop_elsewhere(asker: str) -> None:
    """In a worker process, end the tasks of one who asked for them, and those of him that are still to come."""
    _flags.setdefault(asker, StopFlag()).set()


def run_elsewhere(work: Work, points: np.ndarray, seconds: float, made_of: Mapping[str, str], asker: str) -> Made:
    """Run points in a worker process, if that has the same kernel as the process that asks, and it works there.

    `made_of` is that process's `kernel_made_of`.

    Raises
    ------
    ParameterError
        If the kernel is another one: its numbers could differ; or if something that the work takes is missing.
    KernelError
        If it cannot run there, or gives wrong numbers.
    """
    who = f"worker process {os.getpid()} on {socket.gethostname()}"
    refuse_others(who, made_of)  # before minutes go by
    if not is_proven():
        report_compiling()
    try:
        get_ready()
        work.check_here()
    except (KernelError, ParameterError) as error:
        raise type(error)(f"scheduler: {who}: {error}") from None
    return attempt(work, points, _flags.setdefault(asker, StopFlag()), seconds)


@cache
def _packages() -> dict[str, str]:
    told = {name: metadata.version(name) for name in ("numba", "llvmlite", "numpy")}
    return {"dimersweep": __version__, "Python": platform.python_version()} | told


def kernel_made_of() -> dict[str, str]:
    """Return the version of the kernel here, and of each package that it is made with."""
    return {KERNEL_NAME: kernel_version()} | _packages()


def refuse_others(who: str, asked: Mapping[str, str]) -> None:
    """Raise a ParameterError if the kernel of this process, `who`, has other sources than the one that is asked for.

    The line names every package that differs, as the sources of one that is installed may have come with another.
    """
    here = kernel_made_of()
    if here[KERNEL_NAME] != asked[KERNEL_NAME]:
        other = "; ".join(
            f"{name} {value} here, {here[name]} there" for name, value in asked.items() if value != here[name]
        )
        raise ParameterError(f"scheduler: {who} has another kernel ({other}); give all the same version of dimersweep")


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
    flying: set[Future[Made]] = set()

    def workers() -> int:
        nonlocal counted, there
        if time.monotonic() - counted > COUNT_SECONDS:
            with _connection():
                counted, there = time.monotonic(), client.nthreads()
        return sum(there.values())

    def words() -> str:
        # what the scheduler has noted is asked for: who subscribes to it replaces whoever else has on this client
        noted: Any = answer_of(lambda: client.get_events("all"))
        events = [] if isinstance(noted, Exception) else [event for at, event in noted if at >= begun]
        gone = [event for event in events if isinstance(event, dict) and event.get("action") == "remove-worker"]
        left = [bool(event.get("expected")) for event in gone]
        compiling = list(ask_workers(client, is_compiling).values()).count(True)
        return words_for(client, there, left, compiling)

    def submit(work: Work, points: np.ndarray, seconds: float) -> "Future[Made]":
        # The task carries its points along: data scattered beforehand could die with a worker. What waits behind others of
        # ours lets those of another driver pass.
        given = *work.narrowed(points), seconds, kernel_made_of(), asker
        with _connection():
            future: Future[Made] = executor.submit(run_elsewhere, *given, priority=-len(flying))
        flying.add(future)
        future.add_done_callback(flying.discard)
        return future

    def stop() -> None:
        for error in ask_workers(client, stop_elsewhere, asker).values():
            if error is not None and not isinstance(error, OSError):  # of one that has left
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


def answer_of(ask: Callable[[], T]) -> T | Exception:
    """Return what a scheduler or its workers answer, or the error.

    A worker that hangs, or a scheduler that is lost, would keep whoever waits for it: where the answer takes longer than
    `ANSWER_SECONDS` that is the error.
    """
    answers: list[T | Exception] = [TimeoutError(f"no answer within {ANSWER_SECONDS:g} s")]

    def wait_for_it() -> None:
        try:
            answers.append(ask())
        except Exception as error:  # distributed has no common class for what a lost scheduler leads to
            answers.append(error)

    asking = threading.Thread(target=wait_for_it, daemon=True, name="dimersweep-asks")
    asking.start()
    asking.join(ANSWER_SECONDS)
    return answers[-1]


def ask_workers(client: Any, function: Callable[..., Any], *given: Any) -> dict[str, Any]:
    """Return what a function gives in each worker process, by its address, or the error that it raised there.

    Where no worker can be asked there is an error alone, with no address; see `answer_of`.
    """
    found = answer_of(lambda: client.run(function, *given, on_error="return"))
    return {"": found} if isinstance(found, Exception) else found


@contextmanager
def _connection() -> Iterator[None]:
    try:
        yield
    except Exception as error:  # distributed has no common class for what a lost scheduler leads to
        raise UserError(f"{LOST} ({type(error).__name__}: {error})") from error


def outcome(future: "Future[Made]", points: int) -> Made:
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
        return Made(blank_results(0), broken=points, reason=f"{type(error).__name__}: {error}{hint}")


def run_tasks(
    pool: Pool, work: Work, missing: Iterable[Tile], pace: Pace, stop: StopFlag
) -> Iterator[tuple[np.ndarray, Made]]:
    """Do `work` at the points of `missing`, in tasks as `pace` says, until all are done or `stop` is set.

    What a task brings back undone becomes a task of its own. After `stop`, tasks that run have `TASK_GRACE` seconds to come
    back with the points they have.

    Yields
    ------
    points : ndarray of int
        Of a task.
    made : Made
        What it brings back.
    """
    running: dict[Future[Made], np.ndarray] = {}
    done: SimpleQueue[Future[Made]] = SimpleQueue()  # to wait for each of thousands takes far longer
    undone: deque[np.ndarray] = deque()
    tasks = chunks(missing, lambda: pace.length, work.line)
    while not stop.is_set():
        while len(running) < pace.in_flight and (done.empty() or len(running) < IN_FLIGHT * pool.workers()):
            task = undone.popleft() if undone else next(tasks, None)
            if task is None:
                break
            future = pool.submit(work, task, pace.seconds)
            running[future] = task
            future.add_done_callback(done.put)
        if not running:
            return
        try:
            future = done.get(timeout=POLL)
        except Empty:
            continue
        task = running.pop(future)
        made = outcome(future, task.size)
        pace.note(len(made.results), made.seconds)
        left = task[len(made.results) + made.broken :]
        undone.extend(chunks(ranges_of(left), lambda: pace.length, work.line))  # it may be far too much for one
        yield task, made
    pool.stop()
    for future in wait(running, timeout=TASK_GRACE).done:
        if not future.cancelled() and future.exception() is None:
            yield running[future], future.result()
