"""Tasks come back in time whatever their points cost, the driver asks for few at a time, and a worker's death costs a tile."""

import logging
import os
import re
import signal
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import dask
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import dimersweep
from dimersweep.cubes.results import RESULT, Tile, blank_results, chunks, common, gaps, pieces, runs
from dimersweep.errors import KernelError, ParameterError, PointError, UnfinishedError
from dimersweep.extensions import ORBITS_CODE
from dimersweep.faces import __version__
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import is_stopped
from dimersweep.kernel.model.layout import M_DRIFT, M_UNRESOLVED, ROW, ROW_BETA0
from dimersweep.runs import solving
from dimersweep.storage.provenance import CHECKSUM
from dimersweep.studies.sweep import study_of
from dimersweep.work import scheduling, stopping, tiles, waiting
from dimersweep.work.proving import prove
from dimersweep.work.scheduling import IN_FLIGHT, Pool, run_tasks
from dimersweep.work.stopping import StopFlag, stoppable
from dimersweep.work.tiles import TaskResult, attempt
from dimersweep.work.waiting import Patience
from tests.fakes import CODE, points_on_disk, raising
from tests.seams import SteadyPace, no_warm_up, set_clock, set_pace, use_kernel

SPEC = study_of({"f": [15, 20], "A_r": [5, 6, 7], "beta0": {"start": 0.1, "stop": 1, "num": 40}}, periods=5)


def points_of(ranges):
    return [point for tile in ranges for point in range(*tile)]


ranges = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 9)), max_size=8).map(
    lambda pairs: [Tile(start, start + length) for start, length in pairs]
)


@given(ranges)
@example([Tile(0, 70)])
@example([Tile(60, 70), Tile(0, 1)])
def test_gaps_are_what_no_tile_covers(done):
    found = list(gaps(70, done))
    assert all(start < stop for start, stop in found)
    assert points_of(found) == sorted(set(range(70)) - set(points_of(done)))


@given(ranges, st.integers(1, 12))
def test_bundles_cover_all_points_and_are_full(done, length):
    missing = list(gaps(70, done))
    made = [each.tolist() for each in chunks(missing, lambda: length)]
    assert np.concatenate([*made, []]).tolist() == points_of(missing)
    assert [len(each) for each in made[:-1]] == [length] * (len(made) - 1)


@given(ranges, ranges)
def test_common_ranges_are_where_both_are(some, others):
    some, others = (list(gaps(70, each)) for each in (some, others))
    both = list(common(some, others))
    assert points_of(both) == sorted(set(points_of(some)) & set(points_of(others)))
    whole = [each.tile for each in pieces(np.array(points_of(both), dtype=int), blank_results(70))]
    assert points_of(whole) == points_of(both) and all(a.stop < b.start for a, b in pairwise(whole))


@given(st.lists(st.booleans()), st.integers(0, 5))
def test_runs_are_where_it_holds(chosen, start):
    assert points_of(runs(np.array(chosen, dtype=bool), start)) == [start + k for k, yes in enumerate(chosen) if yes]


@given(st.integers(0, 239), st.integers(1, 240))
def test_a_narrowed_spec_has_the_same_points(start, length):
    points = np.arange(start, min(start + length, 240))
    small, there = SPEC.narrowed(points)
    if start // 40 == points[-1] // 40:  # in one row of the last axis
        assert small.grid.size == points.size
    assert small.grid.rows_at(there).tobytes() == SPEC.grid.rows_at(points).tobytes()


CLOCK = [0.0]  # seconds


def slow_points(rows, periods, rtol, settle, out, codes, until=0, space=None):
    """As the kernel does it: a point that uses all its periods is slow, and the last one of its batch."""
    for k, row in enumerate(rows):
        slow = row[ROW_BETA0] > 0.5
        CLOCK[0] += 0.05 if slow else 1e-4
        codes[k, CODE["mode"]] = M_UNRESOLVED if slow else M_DRIFT
        if until >> int(codes[k, CODE["mode"]]) & 1:
            return k + 1
    return len(rows)


def test_a_task_that_meets_slow_points_comes_back_with_what_it_has(monkeypatch):
    use_kernel(monkeypatch, slow_points)
    set_clock(monkeypatch, lambda: CLOCK[0])
    made = attempt(SPEC, np.arange(240))
    assert made.seconds <= tiles.OVERTIME * tiles.TILE_SECONDS + 0.05
    assert 30 < len(made.results) < 60
    assert (made.results["codes"][:, CODE["mode"]] > 0).all()


def test_a_tile_stops_when_it_is_told_to(monkeypatch):
    use_kernel(monkeypatch, slow_points)
    stop = StopFlag()
    stop.set()
    assert len(attempt(SPEC, np.arange(20, 240), stop).results) == 1


def test_one_point_that_raises_costs_no_other(monkeypatch):
    bad = SPEC.grid.axes["beta0"][7]
    use_kernel(monkeypatch, raising(lambda rows: rows[:, ROW_BETA0] == bad))
    made = attempt(SPEC, np.arange(40))
    assert len(made.results) == 7 and (made.results["codes"][:, CODE["mode"]] > 1).all()
    assert (made.broken, made.reason) == (1, "MemoryError: no room")


def patient(pool):
    """A flag that is not set, and who waits without a word."""
    stop = StopFlag()
    return stop, Patience(pool, stop, None, show=False)


def test_few_tasks_are_in_flight_and_short_ones_go_on():
    flying, most, taken, taken_up, given_back = set(), [0], [], [], []
    lock = threading.Lock()

    def submit(work, points, seconds, ahead):
        assert ahead == len(taken_up) - len(given_back)
        taken_up.append(points)
        future = Future()
        with lock:
            flying.add(future)
            most[0] = max(most[0], len(flying))

        def work():
            time.sleep(0.001)
            with lock:
                flying.discard(future)
            future.set_result(TaskResult(blank_results(min(3, points.size))))

        threading.Thread(target=work).start()
        return future

    pool, pace = Pool(submit, lambda: 3), SteadyPace(7, lambda: 3)
    for points, made in run_tasks(pool, SPEC, [Tile(0, 500)], pace, *patient(pool)):
        given_back.append(points)
        taken += points[: len(made.results)].tolist()
    assert sorted(taken) == list(range(500))
    assert most[0] <= 3 * IN_FLIGHT


@pytest.fixture(scope="module")
def two_workers():
    from distributed import Client, LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as made,
        Client(made) as client,
    ):
        yield client


@pytest.fixture
def cluster(two_workers):
    """The client of a cluster of two workers, of which one that has died before has come back."""
    two_workers.wait_for_workers(2)
    return two_workers


GRID = {"f": [15, 20, 25], "beta0": {"start": 10, "stop": 80, "num": 30, "unit": "deg"}}


def sweep(**settings):
    return dimersweep.sweep(GRID, **({"periods": 10, "progress": False} | settings))


@pytest.mark.jit
def test_a_worker_that_dies_costs_its_tile_alone(cluster, monkeypatch, tmp_path):
    def poison():
        import os

        import dimersweep.runs.solving as there

        run_many = there.run_many

        def dies_at_20_hz(rows, *rest, until=0, space=None):
            if (rows[:, ROW.index("f")] == 20).any():
                os._exit(1)
            return run_many(rows, *rest, until=until, space=space)

        there.ours, there.run_many = run_many, dies_at_20_hz

    def heal():
        import dimersweep.runs.solving as there

        there.run_many = getattr(there, "ours", there.run_many)  # a worker that has died comes back sound

    reference = sweep()
    set_pace(monkeypatch, 30)
    cluster.run(poison)
    told = r"^30 points could not be run, such as point 30 \(f = 20.0, .*\): KilledWorker: .*; 60 of 90 points are kept in "
    with pytest.raises(UnfinishedError, match=told):
        sweep(client=cluster, out=tmp_path / "cube.nc")
    cluster.wait_for_workers(2)
    cluster.run(heal)
    assert not (tmp_path / "cube.nc").exists()
    again = sweep(out=tmp_path / "cube.nc")  # here, where nobody dies
    for name in reference:
        assert again[name].values.tobytes() == reference[name].values.tobytes(), name


@pytest.mark.jit
def test_workers_with_another_kernel_are_refused_before_they_compile(cluster):
    def pretend():
        import dimersweep.work.scheduling as there

        there.ours = there.kernel_version, there.get_ready
        there.kernel_version, there.get_ready = lambda *code: "another", None

    def be_honest():
        import dimersweep.work.scheduling as there

        there.kernel_version, there.get_ready = there.ours

    cluster.run(pretend)
    versions = (
        rf"[0-9a-f]{{16}} of dimersweep {re.escape(__version__)} here, another of dimersweep {re.escape(__version__)}"
    )
    told = rf"^scheduler: worker process \d+ on \S+ has another kernel \({versions} there\); give all the same version$"
    try:
        with pytest.raises(ParameterError, match=told):
            sweep(client=cluster)
    finally:
        cluster.run(be_honest)


@pytest.mark.jit
def test_a_worker_whose_kernel_does_not_work_gets_no_work(cluster, tmp_path, monkeypatch):
    """One of two, whose first task ends the sweep: it fails when the other one has done the rest, which is kept."""
    out, late = tmp_path / "cube.nc", tmp_path / "late"

    def damage(late):
        import dimersweep.work.proving as there

        def cannot_load(*arguments):
            ends = time.monotonic() + 60
            while not late.exists() and time.monotonic() < ends:
                time.sleep(0.01)
            raise EOFError("Ran out of input")

        there.ours, there.run_many = there.run_many, cannot_load
        there.PROVEN.clear()

    def mend():
        import dimersweep.work.proving as there

        there.run_many = there.ours

    def fail_when_the_rest_is_done():
        wait_for(lambda: points_on_disk(out) >= 60)
        late.touch()

    set_pace(monkeypatch, 5)  # so that the damaged one holds a few of 18 tasks
    monkeypatch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
    damaged, _ = cluster.nthreads()
    cluster.run(damage, late, workers=[damaged])
    failing = threading.Thread(target=fail_when_the_rest_is_done)
    failing.start()
    told = r"^scheduler: worker process \d+ on .*: kernel: cannot run here \(EOFError: Ran out of input\)$"
    try:
        with pytest.raises(KernelError, match=told):
            sweep(client=cluster, out=out)
    finally:
        failing.join()
        cluster.run(mend, workers=[damaged])
    assert 60 <= points_on_disk(out) < 90 and not out.exists()
    assert sweep(client=cluster, out=out).attrs[CHECKSUM] == sweep().attrs[CHECKSUM]


@pytest.mark.jit
def test_an_adaptive_cluster_sees_the_work_that_waits(monkeypatch):
    """One thread, and 40 s of work: as many more are asked for as do it in the 5 s that dask aims at."""
    from distributed import Client, LocalCluster

    fast, asked, points = solving.run_many, [], []

    def slow(rows, *rest, until=0, space=None):
        made = fast(rows, *rest, until=until, space=space)
        points.append(made)
        time.sleep(0.01 * made)
        return made

    def ask():
        ends = time.monotonic() + 30
        while time.monotonic() < ends and max(asked, default=0) < 6:
            asked.append(client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.adaptive_target()))
            time.sleep(0.1)
        os.kill(os.getpid(), signal.SIGINT)

    use_kernel(monkeypatch, slow)
    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with LocalCluster(**one) as cluster, Client(cluster) as client:
        threading.Thread(target=ask).start()
        with pytest.raises(KeyboardInterrupt):
            dimersweep.sweep(
                {"beta0": {"start": 10, "stop": 80, "num": 4000, "unit": "deg"}},
                periods=10,
                progress=False,
                client=client,
            )
        wait_for(lambda: not any(client.run(busy).values()))
        assert not client.futures
    assert max(asked) >= 6 and sum(points) < 2000


def test_what_a_task_leaves_undone_is_cut_as_all_else():
    def submit(work, points, seconds, ahead):
        future = Future()
        future.set_result(TaskResult(blank_results(min(3, points.size)), 1.0))
        return future

    class Learning(SteadyPace):
        def note(self, points, seconds):
            self.length = 3

    sizes, pool = [], Pool(submit, lambda: 1)
    for points, _ in run_tasks(pool, SPEC, [Tile(0, 90)], Learning(90), *patient(pool)):
        sizes.append(points.size)
    assert sizes == [90] + [3] * 29


# --- a wait is never silent ------------------------------------------------------------------------------------------------


class Planned(NamedTuple):
    """A client with a cluster of dask-jobqueue, as far as is looked at."""

    cluster: object


class SLURMCluster:
    """What dask-jobqueue's has."""

    plan = ("a", "b")
    job_header = "#SBATCH -J dask-worker\n#SBATCH -e logs/dask-worker-%J.err\n#SBATCH -p closed\n#SBATCH --mem=16G"


def test_what_is_waited_for_is_told_with_where_to_look(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "dask-worker-7.err").write_text("no such queue")
    asked = "SLURMCluster asks for 2 (each of them -J dask-worker -e logs/dask-worker-%J.err -p closed --mem=16G)"
    look = "see the queue (squeue --me), and the newest log of a job: logs/dask-worker-7.err"
    client = Planned(SLURMCluster())
    assert waiting.words_for(client, {}, [], 0) == f"no worker; {asked}; {look}"
    told = waiting.words_for(client, {"one": 4}, [True, False, False], 1)
    assert told == (
        "1 workers with 4 threads; 1 have yet to compile or load the kernel; 3 have left, 2 of them untold: a worker takes 270 "
        f"MB with the kernel loaded, and 1.0 GB beside it while that is compiled; {asked}; {look}; cluster.adapt("
        "minimum_jobs=n, maximum_jobs=n) replaces workers that leave, cluster.scale does not"
    )
    assert [waiting.lacks(client, dict.fromkeys(names, 1)) for names in ("", "a", "ab")] == [True, True, False]
    nobody = Planned(None)  # it was given an address
    assert waiting.words_for(nobody, {}, [], 0) == "no worker" and waiting.lacks(nobody, {})


def wait_for(holds):
    """Wait until something holds, which takes a moment on a quiet machine."""
    ends = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < ends
        time.sleep(0.05)


def test_workers_that_leave_are_counted_and_who_listens_to_the_scheduler_goes_on():
    from distributed import Client, LocalCluster

    heard = []

    def hears(what):
        client.log_event("all", what)
        return any(message == what for _, message in list(heard))

    quiet = {"processes": False, "dashboard_address": ":0"}
    with LocalCluster(n_workers=2, threads_per_worker=1, **quiet) as made, Client(made) as client:
        client.subscribe_topic("all", heard.append)
        wait_for(lambda: hears("before"))
        with scheduling.cluster(client) as pool:
            assert pool.workers() == 2 and "left" not in pool.words()
            client.retire_workers([next(iter(client.nthreads()))])
            wait_for(lambda: "; 1 have left" in pool.words())
            assert "untold" not in pool.words()
        wait_for(lambda: hears("after"))
        client.unsubscribe_topic("all")


def pool_that(lacks):
    return Pool(None, lambda: 2, lacks=lambda: lacks, words=lambda: "two workers")


def waits(monkeypatch, pool, seconds, step=1.0, came=lambda at: False, give_up_after=None):
    """Look so many times a second, for so many seconds of a clock that does not wait; the flag, and when it was set [s]."""
    clock, stop = [0.0], StopFlag()
    monkeypatch.setattr(waiting, "monotonic", lambda: clock[0])
    patience = Patience(pool, stop, give_up_after, show=True)
    while clock[0] < seconds and not stop.is_set():
        clock[0] += step
        patience.look(came=came(clock[0]))
    return stop, clock[0]


@pytest.mark.parametrize("lacking", [True, False], ids=["a worker is missing", "nothing comes back"])
def test_a_wait_is_told_every_minute(monkeypatch, capsys, lacking):
    stop, _ = waits(monkeypatch, pool_that(lacking), 200.0, came=lambda at: lacking)
    silent = [""] * 3 if lacking else [f"no result for 0:0{minute}:00; " for minute in (1, 2, 3)]
    assert capsys.readouterr().err.splitlines() == [f"{each}two workers" for each in silent]
    assert not stop.is_set()


def test_a_wait_begins_with_the_last_result(monkeypatch, capsys):
    waits(monkeypatch, pool_that(False), 120.0, came=lambda at: at <= 50.0)
    assert capsys.readouterr().err == "no result for 0:01:00; two workers\n"


def test_nothing_is_told_while_all_are_there_and_results_come(monkeypatch, capsys):
    stop, _ = waits(monkeypatch, pool_that(False), 1000.0, came=lambda at: at % 50.0 == 0.0, give_up_after=55.0)
    assert capsys.readouterr().err == "" and not stop.is_set()


def test_nobody_waits_longer_than_was_asked(monkeypatch, capsys):
    stop, seconds = waits(monkeypatch, pool_that(True), 1000.0, 0.1, give_up_after=30.0)
    assert seconds == pytest.approx(30.0, abs=0.2) and capsys.readouterr().err == ""
    assert stop.given_up == "no result for 0:00:30; two workers"


def test_a_sweep_is_given_up_if_that_was_asked(monkeypatch):
    def endless(rows, *rest, until=0, space=None):
        while not is_stopped(space):
            time.sleep(0.01)
        return 0

    use_kernel(monkeypatch, endless)
    no_warm_up(monkeypatch)
    told = r"^given up: no result for 0:00:0\d; all threads are at work; nothing is kept, as no output was given$"
    with pytest.raises(UnfinishedError, match=told):
        sweep(give_up_after="300 ms")


@pytest.mark.jit
def test_the_words_of_a_wait_come_from_the_workers(cluster):
    seen = []

    def forget():
        from dimersweep.work import proving

        proving.PROVEN.clear()

    with scheduling.cluster(cluster) as pool:
        assert pool.workers() == 2
        for change in (forget, prove):
            cluster.run(change)
            seen.append((pool.lacks(), pool.words()))
    there = "2 workers with 2 threads"
    assert seen == [(False, f"{there}; 2 have yet to compile or load the kernel"), (False, there)]


@pytest.mark.jit
def test_a_worker_that_hangs_is_told_of_and_waited_for_no_longer_than_a_moment(cluster, monkeypatch):
    monkeypatch.setattr(scheduling, "ANSWER_SECONDS", 0.5)
    one, *_ = cluster.run(os.getpid).values()
    with scheduling.cluster(cluster) as pool:
        assert pool.workers() == 2
        os.kill(one, signal.SIGSTOP)
        try:
            with pytest.warns(RuntimeWarning, match=r"^scheduler: a worker could not be told to stop \(TimeoutError: "):
                pool.stop()
            assert pool.words() == "2 workers with 2 threads"
        finally:
            os.kill(one, signal.SIGCONT)


def test_an_error_in_the_machinery_is_logged_unless_it_is_that_of_a_task_that_was_cancelled(cluster, caplog):
    from distributed.client import FutureCancelledError

    with scheduling.cluster(cluster):
        for error in (FutureCancelledError("key", "unknown"), ValueError("news")):
            logging.getLogger("tornado.application").error("Exception in callback", exc_info=error)
    assert [record.exc_info[0] for record in caplog.records if record.name == "tornado.application"] == [ValueError]


def test_a_scheduler_that_hangs_leaves_the_count_of_its_workers(cluster, monkeypatch):
    def hangs(callback_timeout):
        raise TimeoutError

    monkeypatch.setattr(scheduling, "COUNT_SECONDS", 0.0)
    with scheduling.cluster(cluster) as pool:
        assert pool.workers() == 2
        monkeypatch.setattr(cluster, "nthreads", hangs)
        assert pool.workers() == 2


def busy(dask_worker):
    """How many tasks a worker is at."""
    return len(dask_worker.active_threads)


@pytest.mark.jit
@pytest.mark.parametrize("how", ["Ctrl-C", "fail_fast"])
def test_nobody_computes_after_a_stop(cluster, how, recwarn):
    """The points of the second half take ten minutes, unless they are stopped, or fail where that ends the sweep."""

    def delay(fails):
        import time

        import dimersweep.runs.solving as there
        from dimersweep.kernel.batch import is_stopped
        from dimersweep.kernel.model.layout import CODE_MODE, CODE_STATUS, JAMMED, M_FAILED

        there.ours = run_many = there.run_many

        def waits(rows, *rest, until=0, space=None):
            made = run_many(rows, *rest, until=until, space=space)
            if fails and (rows[:, ROW.index("f")] == 25).any():
                rest[-1][:, [CODE_MODE, CODE_STATUS]] = M_FAILED, JAMMED
                return made
            ends = time.monotonic() + 600 * (rows[:, ROW.index("f")] == 20).any()
            while not is_stopped(space) and time.monotonic() < ends:
                time.sleep(0.01)
            return made

        there.run_many = waits

    def heal():
        import dimersweep.runs.solving as there

        there.run_many = there.ours

    def interrupt():
        ends = time.monotonic() + 60
        while time.monotonic() < ends and sum(cluster.run(busy).values()) < 2:
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    cluster.run(delay, how == "fail_fast")
    points = {"f": [15.0] * 10 + [20.0] + [25.0 if how == "fail_fast" else 20.0] * 9}
    try:
        if how == "Ctrl-C":
            threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt if how == "Ctrl-C" else PointError):
            dimersweep.sweep(points=points, periods=10, progress=False, client=cluster, fail_fast=how == "fail_fast")
        ends = time.monotonic() + 60  # in which a busy machine stops them, and none of them ends by itself
        while any(cluster.run(busy).values()) and time.monotonic() < ends:
            time.sleep(0.1)
        assert set(cluster.run(busy).values()) == {0}
        assert not cluster.futures
    finally:
        cluster.run(heal)
    logs = [line for lines in cluster.get_worker_logs().values() for _, line in lines]
    assert not any("Traceback" in line and "stop_elsewhere" in line for line in logs)
    assert not recwarn.list


@pytest.mark.jit
def test_the_loss_of_the_scheduler_is_told_and_costs_nothing_finished(tmp_path, recwarn):
    from distributed import Client, LocalCluster

    out = tmp_path / "cube.nc"
    grid = {"beta0": {"start": 10, "stop": 80, "num": 4000, "unit": "deg"}}
    made = LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=":0")
    client = Client(made, timeout=3)

    def close_when_some_are_done():
        while not points_on_disk(out):
            time.sleep(0.05)
        made.close()

    closing = threading.Thread(target=close_when_some_are_done)
    closing.start()
    with pytest.raises(
        dimersweep.errors.UserError, match=r"^scheduler: the connection to the cluster is lost; what was"
    ):
        dimersweep.sweep(grid, periods=60, out=out, client=client, progress=False)
    closing.join()
    client.close()
    assert points_on_disk(out)
    assert not any("told to stop" in str(each.message) for each in recwarn.list)


LOGS = ("distributed.client", "tornado.application")


class Complaining:
    """A client that logs what went wrong when it is closed, as that of distributed does after the loss of its scheduler."""

    def __init__(self, address, timeout):
        self.address = address

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        for name in LOGS:
            logging.getLogger(name).error("Traceback (most recent call last):")

    def run(self, function, on_error):
        return {"tcp://worker": function()}


def test_the_log_of_our_own_client_stays_out_of_sight_and_that_of_others_does_not(monkeypatch):
    import distributed

    logs, seen = [logging.getLogger(name) for name in LOGS], []
    watch = logging.Handler()
    watch.emit = lambda record: seen.append(record.getMessage())
    monkeypatch.setattr(distributed, "Client", Complaining)
    for log in logs:
        monkeypatch.setattr(log, "handlers", [watch])
    with scheduling.connected("tcp://scheduler"):
        pass
    assert seen == []
    with scheduling.connected(Complaining("tcp://scheduler", 3)):
        for log in logs:
            log.error("told")
    assert seen == ["told"] * len(logs)


class Endless(NamedTuple):
    """Work that goes on until it is stopped."""

    kind: np.dtype = RESULT
    line: int = 1

    def check_here(self):
        """Take nothing."""

    def advance(self, points, results, space):
        """Wait for the stop."""
        ends = time.monotonic() + 60.0
        while not is_stopped(space) and time.monotonic() < ends:
            time.sleep(0.01)
        return 0


def test_a_task_elsewhere_ends_when_its_asker_says_so(monkeypatch):
    monkeypatch.setattr(scheduling, "get_ready", lambda: None)
    run = partial(scheduling.run_elsewhere, Endless(), np.arange(3), 60.0, (kernel_version(*ORBITS_CODE), __version__))
    with ThreadPoolExecutor(2) as pool:
        mine, other = pool.submit(run, "mine"), pool.submit(run, "another's")
        scheduling.stop_elsewhere("mine")
        assert len(mine.result(30).results) == 0
        assert not other.done()
        scheduling.stop_elsewhere("another's")
        assert len(other.result(30).results) == 0
        assert len(run("mine").results) == 0, "a task that comes later"


# --- a run that is to stop ends, or is left alone, by what stopped it ------------------------------------------------------


@pytest.mark.parametrize("ends", [True, False], ids=["a run that sees the flag", "a compiler that does not"])
def test_ctrl_c_comes_out_as_such(monkeypatch, ends):
    monkeypatch.setattr(stopping, "RUN_GRACE", 60.0 if ends else 0.05)
    seen, late = [], threading.Event()

    def call(space):
        seen.append(space)
        os.kill(os.getpid(), signal.SIGINT)
        while not (is_stopped(space) if ends else late.wait(60)):
            time.sleep(1e-3)

    with pytest.raises(KeyboardInterrupt):
        stoppable(call)
    assert is_stopped(seen[0])
    late.set()


def test_a_bound_on_the_time_sets_the_flag_and_waits_for_what_comes_back():
    def call(space):
        while not is_stopped(space):
            time.sleep(1e-3)
        return "stopped"

    assert stoppable(call, seconds=0.05) == "stopped"
