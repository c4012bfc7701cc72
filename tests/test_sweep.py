"""A sweep gives each point its own numbers, whoever runs it, and keeps the trouble of one tile to that tile."""

import heapq
import json
import pickle
import re
import sys
import threading
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import nbformat
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.cubes.results import Tile, chunks, split
from dimersweep.errors import KernelError, UnfinishedError
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.layout import CODE_MODE, CODE_STATUS, CODES, M_DRIFT, MODES, OK, OUT, ROW, ROW_BETA0
from dimersweep.storage.provenance import OURS
from dimersweep.studies.declared import from_cube
from dimersweep.studies.search import search
from dimersweep.studies.sweep import study_of
from dimersweep.work import proving
from dimersweep.work.progress import Tally, in_lines, notebook_bar
from dimersweep.work.proving import SCENES, bits_of, outcomes
from dimersweep.work.scheduling import TASK_POINTS, Pace
from tests.fakes import failing, fake_run_many, raising, run_tile
from tests.seams import no_work, prove_anew, prove_with, set_pace, use_kernel

ROOT = Path(__file__).parents[1]
GRID = {"f": [15, 20, 25], "beta0": {"start": 1, "stop": 89, "step": 1, "unit": "deg"}}


def quiet_sweep(grid=GRID, fixed=None, **settings):
    return dimersweep.sweep(grid, fixed, **({"periods": 5, "progress": False} | settings))


def test_a_sweep_fills_every_point(fake_kernel):
    cube = quiet_sweep()
    assert cube["mode"].shape == (3, 89)
    assert set(np.unique(names(cube["mode"]))) == {"drift", "rest", "unresolved"}
    drifts = names(cube["mode"]) == "drift"
    expected = cube["f"] ** 2 / 50 + 1e-3 * cube["beta0"]
    np.testing.assert_allclose(cube["radius"].where(drifts), expected.where(drifts))


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_the_numbers_do_not_depend_on_tiles_and_workers(fake_kernel, monkeypatch, workers):
    reference = quiet_sweep()
    set_pace(monkeypatch, 7)
    xr.testing.assert_equal(quiet_sweep(workers=workers), reference)


@pytest.mark.jit
def test_a_sweep_costs_little_beyond_its_kernel(monkeypatch):
    """Processor time outside the kernel over that within it, in the same sweep: what slows one slows the other."""
    within, points = [0.0], [0]

    def clocked(*arguments, **options):
        begun = time.process_time()
        made = run_many(*arguments, **options)
        within[0] += time.process_time() - begun
        points[0] += made
        return made

    use_kernel(monkeypatch, clocked)
    grid = {"f": [15, 20, 25], "beta0": np.linspace(0.05, 1.5, 600)}
    quiet_sweep({"f": [15, 20]})  # compiles

    def beyond():
        begun, within[0], points[0] = time.process_time(), 0.0, 0
        quiet_sweep(grid, periods=100, workers=1)
        assert points[0] == 1800  # none twice
        return (time.process_time() - begun - within[0]) / within[0]

    assert any(beyond() < 0.06 for _ in range(3))  # 0.02; a busy machine or a collection of garbage may disturb one


@pytest.mark.jit
def test_threads_and_tiles_give_the_bits_of_a_serial_run(monkeypatch):
    grid = {"f": [15, 25], "beta0": {"start": 3, "stop": 87, "step": 7, "unit": "deg"}}
    spec = study_of(grid, periods=40)
    results = run_tile(spec, Tile(0, spec.grid.size))
    out, codes = results["out"], results["codes"]
    for length in (1, 5):
        set_pace(monkeypatch, length)
        cube = quiet_sweep(grid, periods=40, workers=2)
        for name, values in (*zip(CODES, codes.T, strict=True), ("radius", out[:, 0])):
            assert cube[name].values.astype(values.dtype).tobytes() == values.tobytes(), name


def rings_down(rows, periods, rtol, settle, out, codes, until=0, space=None):
    """A kernel whose starts settle after 1000 beta0 periods, in drift, and never where f is 25."""
    need = np.where(rows[:, ROW.index("f")] == 25, np.inf, 1000 * rows[:, ROW_BETA0])
    codes[:, CODE_STATUS] = OK
    codes[:, CODE_MODE] = np.where(need <= periods, M_DRIFT, layout.M_UNRESOLVED)
    codes[:, layout.CODE_N_PERIODS] = np.minimum(need, periods)
    stops = np.flatnonzero(until >> codes[:, CODE_MODE] & 1)
    made = int(stops[0]) + 1 if stops.size else len(rows)
    codes[made:] = 0
    return made


@pytest.mark.parametrize("length", [1, 7])
def test_what_has_not_settled_is_run_longer(monkeypatch, tmp_path, length):
    use_kernel(monkeypatch, rings_down)
    set_pace(monkeypatch, length)
    grid = {"f": [15, 25], "beta0": np.arange(1, 100) / 1000}
    assert (names(quiet_sweep(grid)["mode"]) == "drift").sum() == 5
    cube = quiet_sweep(grid, max_periods=30, out=tmp_path / "cube.nc")
    modes, used = names(cube["mode"]), cube["n_periods"]
    assert (modes.sel(f=15)[:30] == "drift").all() and (modes.sel(f=15)[30:] == "unresolved").all()
    np.testing.assert_array_equal(used.sel(f=15), np.minimum(np.arange(1, 100), 30))
    assert (modes.sel(f=25) == "unresolved").all() and (used.sel(f=25) == 30).all()
    assert json.loads(cube.attrs["configuration"])["max_periods"] == 30
    assert from_cube(tmp_path / "cube.nc").sweep.max_periods == 30
    found = search(grid, over="beta0", ask="fraction", periods=5, max_periods=30, progress=False)
    assert found["runs"].sel(f=15).values[[MODES.index("drift"), MODES.index("unresolved")]].tolist() == [30, 69]


def test_a_point_that_fails_marks_only_itself(monkeypatch):
    use_kernel(monkeypatch, failing(lambda rows: rows[:, ROW.index("f")] == 20))
    set_pace(monkeypatch, 89)
    cube = quiet_sweep()
    failed = names(cube["mode"]) == "failed"
    assert failed.sel(f=20).all() and not failed.sel(f=[15, 25]).any()
    assert cube["radius"].sel(f=20).isnull().all()
    assert (names(cube["status"]) == "jammed").equals(failed)


@pytest.mark.parametrize("workers", [1, 3])
def test_points_that_cannot_be_run_are_left_to_be_done(fake_kernel, monkeypatch, tmp_path, workers):
    reference, out, asked = quiet_sweep(), tmp_path / "cube.nc", []
    bad = reference["beta0"].values[[7, 50]]
    with monkeypatch.context() as patch:
        use_kernel(patch, raising(lambda rows: np.isin(rows[:, ROW_BETA0], bad)))
        set_pace(patch, 89)
        told = r"^6 points could not be run, such as point \d+ \(f = .*\): MemoryError: no room; 261 of 267 points are kept in "
        with pytest.raises(UnfinishedError, match=told) as caught:
            quiet_sweep(out=out, workers=workers)
    number, beta0 = re.search(r"such as point (\d+) \(.*beta0 = (.*?)\)", str(caught.value)).groups()
    assert int(number) % 89 in (7, 50) and float(beta0) in bad
    assert not out.exists()

    def run_many(rows, *rest, until=0, space=None):
        asked.append(len(rows))
        return fake_run_many(rows, *rest, until=until)

    use_kernel(monkeypatch, run_many)
    xr.testing.assert_equal(quiet_sweep(out=out), reference)
    assert 6 <= sum(asked) <= 6 + 4  # an unresolved point ends its call


def test_many_breaks_alike_in_a_row_stop_the_sweep(monkeypatch, tmp_path):
    tried = []

    def run_many(rows, *rest, until=0, space=None):
        tried.append(len(rows))
        if len(tried) > 20:
            raise MemoryError("no room")
        return fake_run_many(rows, *rest, until=until)

    use_kernel(monkeypatch, run_many)
    set_pace(monkeypatch, 5)
    told = r"^1[0-2] points could not be run, .*: MemoryError: no room; the sweep was stopped, as these came in a row; \d+ of "
    with pytest.raises(UnfinishedError, match=told):
        quiet_sweep(workers=1, out=tmp_path / "cube.nc")
    assert not (tmp_path / "cube.nc").exists()
    assert len(tried) < 60


def cannot_load(*arguments):
    raise EOFError("Ran out of input")


def all_nan(rows, periods, rtol, settle, out, codes):
    codes[:, CODE_MODE] = M_DRIFT


MACHINE = proving.machine()
REFUSED = "it must not be used. If its sources were changed on purpose, set DIMERSWEEP_OTHER_PHYSICS=1"


def test_many_threads_prove_the_kernel_once(monkeypatch):
    runs, run_many = [], proving.run_many

    def slow(*arguments):
        runs.append(1)
        time.sleep(0.05)
        return run_many(*arguments)

    prove_with(monkeypatch, slow)
    together = [threading.Thread(target=proving.prove) for _ in range(20)]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert runs == [1]


@pytest.mark.parametrize(
    ("kernel", "told"),
    [
        (cannot_load, "kernel: cannot run here (EOFError: Ran out of input)"),
        (all_nan, f"kernel: gives other digits for the base case (radius nan, drift) on {MACHINE}; {REFUSED}"),
        (
            lambda *arguments: None,
            f"kernel: gives other digits for the base case (radius nan, not_run) on {MACHINE}; {REFUSED}",
        ),
    ],
)
def test_a_kernel_that_does_not_work_ends_the_sweep_before_any_point(monkeypatch, tmp_path, kernel, told):
    prove_with(monkeypatch, kernel)
    no_work(monkeypatch)
    with pytest.raises(KernelError, match=f"^{re.escape(told)}$"):
        quiet_sweep(out=tmp_path / "cube.nc")
    assert list(tmp_path.iterdir()) == []


def test_the_cube_is_written_and_tells_its_configuration(fake_kernel, tmp_path):
    cube = quiet_sweep(fixed={"mu": 0.1}, out=tmp_path / "cube.nc", attrs={"title": "a title"})
    xr.testing.assert_identical(dimersweep.open_cube(tmp_path / "cube.nc"), cube)
    told = json.loads(cube.attrs["configuration"])
    assert cube.attrs["title"] == "a title"
    assert told["grid"]["f"] == [15, 20, 25] and told["fixed"]["mu"] == 0.1
    assert (told["periods"], told["rtol"], told["stop_when_settled"]) == (5, 1e-8, True)
    np.testing.assert_array_equal(told["grid"]["beta0"], cube["beta0"])


@pytest.mark.parametrize("out", ["cube.nc", "cube.zarr"])
def test_attributes_come_back_from_the_file(fake_kernel, monkeypatch, tmp_path, out):
    monkeypatch.chdir(tmp_path)
    own = {"title": "Γ, e", "note": "", "seed": 2**62, "ratio": np.float32(0.5), "series-1": [1, 2], "ends": (0.5, 1)}
    cube = quiet_sweep(out=out, attrs=own)
    told = dimersweep.open_cube(out).attrs
    assert {name: np.array(told[name]).tolist() for name in own} == own | {"ends": [0.5, 1.0]}
    assert set(cube.attrs) == OURS - {"extends"} | set(own)


def test_tiles_travel_by_pickle(fake_kernel):
    spec = pickle.loads(pickle.dumps(study_of(GRID, periods=5)))
    results = run_tile(spec, pickle.loads(pickle.dumps(Tile(10, 20))))
    assert results.tobytes() == run_tile(spec, Tile(0, 267))[10:20].tobytes()
    assert results["codes"].shape == (10, len(CODES))


@given(st.integers(1, 500), st.integers(1, 500))
def test_tiles_cover_every_point_once(size, length):
    points = [point for tile in split([Tile(0, size)], length) for point in range(*tile)]
    assert points == list(range(size))


def note(pace, points, seconds):
    pace.note(points, seconds)
    return pace.length


def test_a_tile_takes_about_half_a_second():
    pace = Pace(10_000, lambda: 2)
    assert (pace.length, pace.in_flight, pace.seconds) == (1, 2, 0.5)  # one task for each worker at first
    assert note(pace, 1, 0.01) == 4  # not 50 from one point
    assert pace.in_flight == 4
    assert note(pace, 4, 0.04) == 20
    assert note(pace, 16, 0.16) == 50
    assert note(pace, 50, 500.0) == 1
    assert note(pace, 1000, 1e-3) == 1250  # each worker gets a few


def test_tiles_of_many_workers_are_longer_and_reached_in_two_waves():
    pace = Pace(10**9, lambda: 1000)
    assert (pace.length, pace.in_flight, pace.seconds) == (1, 1000, 4.0)
    for _ in range(1000):
        note(pace, 1, 0.001)
    assert (pace.length, pace.in_flight) == (4000, 2000)
    assert (
        note(Pace(10**8, lambda: 1), 10**6, 0.1) == TASK_POINTS
    )  # so that memory does not depend on how quick points are
    workers = [10]
    pace = Pace(10**6, lambda: workers[0])
    note(pace, 1000, 1.0)
    assert (pace.length, pace.in_flight) == (500, 20)
    workers[0] = 500  # more have come
    note(pace, 500, 0.5)
    assert (pace.length, pace.in_flight) == (500, 1000)  # each of them gets a few


def test_an_adaptive_cluster_sees_that_much_is_wanted_before_it_has_workers_and_once_a_task_has_come_back():
    workers = [0]
    pace = Pace(10_000, lambda: workers[0], demand=4096)
    assert pace.in_flight == 128
    workers[0] = 4
    assert pace.in_flight == 4  # tasks of one point, which cost more than they compute
    for _ in range(40):
        note(pace, 1, 0.004)
    assert (pace.length, pace.in_flight) == (125, 4096)


def test_results_are_taken_in_the_calling_thread(fake_kernel, monkeypatch):
    threads = set()
    monkeypatch.setattr(Tally, "add", lambda self, modes, seconds: threads.add(threading.current_thread()))
    quiet_sweep(workers=3)
    assert threads == {threading.main_thread()}


def test_the_time_left_does_not_count_what_is_under_way_as_slowness():
    """Eight workers with points of 10 s each: 240 take five minutes, from their second points on."""
    tally = Tally(249, {"rest": 1}, lambda: 8)
    for _ in range(9):
        assert tally.time_left() == "-:--:--"  # the first points, and one of 240, say little of the others
        tally.add({"drift": 1}, 10.0)
    tally.add({"rest": 1}, 10.0)
    assert tally.time_left() == "0:04:58"
    tally.add({"rest": 119})  # taken over from a former cube, in no time
    assert tally.time_left() == "0:02:29"


def times_left(points, point_seconds, first_seconds, workers):
    """The time left as shown, and the truth, whenever a task comes back: the clock is that of the tasks alone.

    The first task of each worker takes `first_seconds` more than its points do.
    """
    tally, pace = Tally(points, workers=lambda: workers), Pace(points, lambda: workers)
    tasks, told, now = chunks([Tile(0, points)], lambda: pace.length), [], 0.0
    busy = [(0.0, worker, 0, first_seconds) for worker in range(workers)]
    heapq.heapify(busy)
    while busy:
        now, worker, done, seconds = heapq.heappop(busy)
        if done:
            pace.note(done, seconds)
            tally.add({"drift": done}, seconds)
            told.append((now, tally.time_left()))
            seconds = 0.0
        if (task := next(tasks, None)) is not None:
            work = seconds + task.size * point_seconds
            heapq.heappush(busy, (now + work, worker, task.size, work))
    shown = [
        (at, sum(int(part) * 60**k for k, part in enumerate(left.split(":")[::-1])))
        for at, left in told
        if "-" not in left
    ]
    return [(at, left, now - at) for at, left in shown]


@pytest.mark.parametrize("workers", [1, 2, 16])
@pytest.mark.parametrize("first_seconds", [0.0, 1.0, 30.0])
def test_the_time_left_is_right_within_a_tenth_whatever_the_first_tasks_take(workers, first_seconds):
    """The first tasks may load or compile what the others find done. Times are shown to a second."""
    points = 6000 * workers
    told = times_left(points, 0.01, first_seconds, workers)
    begun = told[0][0]
    assert begun < first_seconds + 6  # of a minute of work for each worker
    for at, left, truth in told:
        assert left == pytest.approx(truth, rel=0.1, abs=1.5), at


def test_a_task_counts_all_its_points_with_its_time(fake_kernel, monkeypatch, tmp_path):
    """A task may hold many short ranges of points, as where every second point is there already."""
    angles = {"start": 1, "stop": 89, "step": 2, "unit": "deg"}
    former = quiet_sweep({"f": [15, 20, 25], "beta0": angles}, out=tmp_path / "old.nc")
    counted = []
    add = Tally.add
    monkeypatch.setattr(Tally, "add", lambda self, *told: counted.append(told) or add(self, *told))
    set_pace(monkeypatch, 10)
    cube = quiet_sweep(extend=tmp_path / "old.nc", workers=1)
    made = [(sum(modes.values()), seconds) for modes, *(seconds,) in (told for told in counted if len(told) > 1)]
    assert sum(points for points, _ in made) == cube["mode"].size - former["mode"].size
    assert all(seconds > 0 for _, seconds in made) and max(points for points, _ in made) == 10


def test_a_log_gets_plain_lines(capsys, monkeypatch):
    lines = Tally(4, show=in_lines())
    lines.add({"drift": 2, "rest": 1})  # too early for a line
    lines.add({"unresolved": 1})
    assert (
        capsys.readouterr().err == "4/4 points, 100 %, elapsed 0:00:00, left 0:00:00: drift 2, rest 1, unresolved 1\n"
    )


@pytest.mark.jit
def test_a_notebook_gets_a_live_bar():
    """One output of the cell, which is shown at once, moves, and tells the modes in the end; nothing goes to stderr."""
    nbclient, seen = pytest.importorskip("nbclient"), []

    class Watching(nbclient.NotebookClient):
        def process_message(self, msg, *rest):
            seen.append((msg["msg_type"], msg["content"].get("data", {}).get("text/html", "")))
            return super().process_message(msg, *rest)

    source = "import dimersweep\ncube = dimersweep.sweep({'Gamma': [0.5, 0.6, 0.9]}, periods=60)"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
    Watching(notebook, timeout=500, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}).execute()
    bars = [html for kind, html in seen if kind in ("display_data", "update_display_data")]
    assert bars[0] == "<progress value=0></progress>"
    (output,) = (each for each in notebook.cells[0].outputs if "data" in each)
    assert output.data["text/html"] == bars[-1]
    assert not [each for each in notebook.cells[0].outputs if "points" in each.get("text", "")]
    assert '<progress value="3" max="3"' in bars[-1] and bars[-1].endswith("rest 2, drift 1")


def test_a_process_without_a_notebook_has_no_bar(monkeypatch):
    assert notebook_bar() is None
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))  # imported, but no kernel
    assert notebook_bar() is None


# --- the known scenes with which a process begins -----------------------------------------------------------------------


def test_the_known_scenes_warn_of_nothing(monkeypatch):
    """A change of any number of theirs by more than 1e-4 of itself, also on purpose, has to be written there."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prove_anew(monkeypatch)
        proving.prove()


def test_each_bit_of_a_known_scene_is_compared(monkeypatch):
    out, codes = outcomes()
    for scene, numbers, code in zip(SCENES, out, codes, strict=True):
        assert bits_of(numbers, code) == scene["bits"]
    run_many = proving.run_many

    def other(rows, periods, rtol, settle, out, codes):
        run_many(rows, periods, rtol, settle, out, codes)
        out[3, OUT.index("zeta")] = np.nextafter(out[3, OUT.index("zeta")], 9.0)

    prove_with(monkeypatch, other)
    told = (
        r"^kernel: gives other digits for e_2 = 0.76, mu = 0.29 \(radius [0-9.]+, drift\) on .*with python .*, numba "
    )
    with pytest.raises(KernelError, match=told):
        quiet_sweep()


def test_elementary_functions_are_compared(monkeypatch):
    functions = proving.functions
    monkeypatch.setattr(proving, "functions", lambda x: np.nextafter(functions(x), 9.0))
    prove_anew(monkeypatch)
    with pytest.raises(KernelError, match=r"^kernel: gives other last digits of elementary functions on "):
        quiet_sweep()
