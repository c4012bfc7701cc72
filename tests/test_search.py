"""A search answers as a whole sweep would, with fewer runs, and whatever order its points are taken in."""

import json
import os
import signal

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.cubes.findings import runs_of
from dimersweep.errors import ParameterError, Stopped, StoreError, UnfinishedError
from dimersweep.kernel.model.layout import M_DRIFT, MODES, ROW
from dimersweep.studies import deciding
from dimersweep.studies.deciding import spread_order
from dimersweep.studies.search import search, study_of, waves
from dimersweep.studies.status import status, status_lines
from dimersweep.work.stopping import StopFlag
from dimersweep.work.tiles import attempt
from tests.fakes import failing, fake_run_many, forget_some, points_made, raising, same_bits
from tests.seams import no_work, set_pace, use_kernel

# with the fake kernel no start drifts where f is small, some do elsewhere
GRID = {"f": [0.2, 0.3, 0.4, 0.5, 1, 3, 9], "e": [0.5, 0.6, 0.7], "beta0": {"start": 0.03, "stop": 0.3, "num": 19}}


def quiet_search(grid=GRID, fixed=None, **settings):
    return search(grid, fixed, **({"over": "beta0", "periods": 5, "progress": False} | settings))


def brute_drifts(grid=GRID):
    return names(dimersweep.sweep(grid, periods=5, progress=False)["mode"]) == "drift"


def test_any_finds_what_a_whole_sweep_finds(fake_kernel):
    cube, drifts = quiet_search(), brute_drifts()
    answers = names(cube["answer"])
    assert {"no", "yes"} == set(np.unique(answers))
    xr.testing.assert_equal(answers == "yes", drifts.any("beta0"))
    for place in np.argwhere(answers.values == "yes"):
        point = dict(zip(answers.dims, place, strict=True))
        assert drifts.isel(point).sel(beta0=cube["beta0"].isel(point)).item()
    assert cube["beta0"].where(answers == "no").isnull().all()
    assert cube["n_runs"].sum() < 0.5 * drifts.size
    np.testing.assert_array_equal(cube["n_runs"], cube["runs"].sum("outcome"))


def test_the_deciding_run_gives_mode_and_orbit(fake_kernel):
    cube = quiet_search()
    yes = names(cube["answer"]) == "yes"
    assert (names(cube["mode"]).where(yes, "drift") == "drift").all()
    assert (names(cube["region"]).where(~yes, "rest") == "rest").all()
    expected = cube["f"] ** 2 / 50 + 1e-3 * cube["beta0"]
    np.testing.assert_allclose(cube["radius"], expected.where(yes).transpose("f", "e"))


def test_all_ends_with_the_first_that_differs(fake_kernel):
    cube, drifts = quiet_search(ask="all", mode="rest"), brute_drifts()
    answers = names(cube["answer"])
    xr.testing.assert_equal(answers == "yes", (~drifts).all("beta0"))
    no = answers == "no"
    assert (runs_of(cube, "drift").where(no, 1) == 1).all()
    assert cube["beta0"].notnull().equals(no)


def test_first_gives_the_least_value(fake_kernel):
    cube, drifts = quiet_search(ask="first"), brute_drifts()
    least = drifts["beta0"].where(drifts).min("beta0").transpose(*cube["beta0"].dims)
    np.testing.assert_array_equal(cube["beta0"], least)


def test_fraction_makes_every_run(fake_kernel):
    cube, drifts = quiet_search(ask="fraction"), brute_drifts()
    assert (cube["n_runs"] == drifts.sizes["beta0"]).all()
    np.testing.assert_array_equal(runs_of(cube, "drift"), drifts.sum("beta0"))
    assert set(np.unique(names(cube["region"]))) == {"rest", "mixed"}


def test_an_unresolved_run_leaves_the_answer_open(fake_kernel):
    grid = GRID | {"beta0": [0.01, 0.1, 0.3]}  # the first of them does not settle
    assert set(np.unique(names(quiet_search(grid)["answer"]))) == {"unsure", "yes"}
    first = quiet_search(grid, ask="first")
    assert set(np.unique(names(first["answer"]))) == {"unsure"}
    assert (names(first["region"]) == "drift").equals(first["beta0"].notnull())
    assert set(np.unique(names(quiet_search(grid, ask="all", mode="rest")["answer"]))) == {"unsure", "no"}


@pytest.mark.parametrize(("workers", "length"), [(1, 1), (2, 3), (5, 8)])
def test_threads_and_tilings_change_nothing(fake_kernel, monkeypatch, workers, length):
    reference = quiet_search(workers=1)
    set_pace(monkeypatch, length)
    xr.testing.assert_equal(quiet_search(workers=workers), reference)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.release) for seed in (2, 3))])
def test_what_was_known_before_changes_nothing(fake_kernel, tmp_path, seed):
    out = tmp_path / "cube.nc"
    reference = quiet_search(out=out, keep_tiles=True)
    spec = study_of(GRID, None, over="beta0", ask="any", mode="drift", periods=5, rtol=1e-8)
    forget_some(out, spec.configuration(), spec.kind, seed)
    xr.testing.assert_equal(quiet_search(out=out), reference)
    assert os.listdir(tmp_path) == ["cube.nc"]


def test_a_search_that_is_complete_is_not_made_again(fake_kernel, monkeypatch, tmp_path):
    reference = quiet_search(out=tmp_path / "cube.nc")
    no_work(monkeypatch)
    xr.testing.assert_identical(quiet_search(out=tmp_path / "cube.nc"), reference)
    with pytest.raises(StoreError, match=r'exists already; .*What differs:\n  search.ask: "any" -> "all"$'):
        quiet_search(out=tmp_path / "cube.nc", ask="all")


def test_a_search_that_is_stopped_keeps_what_it_has(fake_kernel, monkeypatch, tmp_path):
    out, asked, fast = tmp_path / "cube.nc", [], fake_run_many

    def interrupts(rows, *rest, until=0, space=None):
        asked.append(len(rows))
        if len(asked) == 9:
            signal.raise_signal(signal.SIGINT)
        return fast(rows, *rest, until=until, space=space)

    reference = quiet_search()
    with monkeypatch.context() as patch:
        use_kernel(patch, interrupts)
        with pytest.raises(Stopped, match=r"\d+ of 21 points are kept in .*cube.nc.tiles; run the same again to go on"):
            quiet_search(out=out, workers=1)
    assert status_lines(status(out))[-1] == "at work: nobody; run the same sweep again to go on"
    with pytest.raises(
        StoreError, match=r'holds results of other settings.*What differs:\n  search.mode: "drift" -> "jump"$'
    ):
        quiet_search(out=out, mode="jump")
    xr.testing.assert_equal(quiet_search(out=out), reference)


QUESTIONS = [{"ask": "any"}, {"ask": "all", "mode": "rest"}, {"ask": "first"}, {"ask": "fraction"}]
MORE = GRID | {"f": np.union1d(GRID["f"], [0.25, 2, 4]), "e": [0.5, 0.55, 0.6, 0.7]}


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question["ask"])
def test_a_search_is_extended_to_the_bits_of_a_new_one(asked, tmp_path, question):
    old = quiet_search(out=tmp_path / "old.nc", **question)
    asked.clear()
    reference = quiet_search(MORE, **question)
    whole, known = points_made(asked), reference["n_runs"].sel(f=old["f"], e=old["e"])
    asked.clear()
    cube = quiet_search(MORE, extend=tmp_path / "old.nc", out=tmp_path / "new.nc", **question)
    assert same_bits(cube, reference) and cube.attrs["extends"].startswith("old.nc, configuration sha256 ")
    # what a neighbour led to is tried again where it was led otherwise; nothing that took every run, or was not led, is
    free = known.sum() if question["ask"] in ("first", "fraction") else known.where(known == 19, 0).sum()
    assert free > 0 and points_made(asked) <= whole - free
    assert same_bits(quiet_search(MORE, extend=tmp_path / "new.nc", **question), reference)


def test_a_parameter_that_was_fixed_becomes_an_axis_of_a_search(asked, tmp_path):
    grid = {"f": GRID["f"], "beta0": GRID["beta0"]}
    quiet_search(grid, {"e": 0.6}, ask="first", out=tmp_path / "old.nc")
    asked.clear()
    cube = quiet_search(GRID, ask="first", extend=tmp_path / "old.nc")
    assert points_made(asked) == cube["n_runs"].drop_sel(e=0.6).sum()
    assert same_bits(cube, quiet_search(ask="first"))


def test_the_cube_of_a_sweep_does_not_extend_a_search(fake_kernel, tmp_path):
    dimersweep.sweep(GRID, periods=5, progress=False, out=tmp_path / "grid.nc")
    with pytest.raises(StoreError, match=r"grid.nc: is the cube of a whole grid; it cannot be extended to a search$"):
        quiet_search(extend=tmp_path / "grid.nc")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"grid": GRID | {"beta0": [0.1, 0.3]}}, r"\n  search.values: 19 values from 0.03 to 0.3.* -> \[0.1, 0.3\]"),
        ({"ask": "first"}, r'\n  search.ask: "any" -> "first"'),
        ({"max_periods": 7}, r"\n  max_periods: nothing -> 7"),
    ],
)
def test_a_search_made_otherwise_is_not_extended(fake_kernel, tmp_path, settings, told):
    quiet_search(out=tmp_path / "old.nc")
    with pytest.raises(StoreError, match=f"old.nc: cannot be extended to this sweep, as it was made otherwise:{told}$"):
        quiet_search(extend=tmp_path / "old.nc", **settings)


@pytest.mark.parametrize(
    ("question", "stopped"),
    [
        *((question, False) for question in QUESTIONS),
        (QUESTIONS[0], True),
        *(pytest.param(question, True, marks=pytest.mark.release) for question in QUESTIONS[1:]),
    ],
    ids=lambda given: given["ask"] if isinstance(given, dict) else str(given),
)
def test_a_retry_gives_the_bits_of_a_search_without_failures(fake_kernel, monkeypatch, tmp_path, question, stopped):
    out, reference = tmp_path / "cube.nc", quiet_search(**question)
    with monkeypatch.context() as patch:
        use_kernel(patch, failing(lambda rows: rows[:, ROW.index("f")] == 3))
        broken = quiet_search(out=out, keep_tiles=stopped, **question)
    assert (names(broken["mode"]) == "failed").sum() == 3
    if stopped:
        out.unlink()
    cube = quiet_search(out=out, retry=True, **question)
    assert same_bits(cube, reference) and same_bits(dimersweep.open_cube(out), reference)
    assert os.listdir(tmp_path) == ["cube.nc"]
    no_work(monkeypatch)
    assert same_bits(quiet_search(out=out, retry=True, **question), reference)


def test_a_retry_searches_again_only_where_a_failure_may_have_led(fake_kernel, monkeypatch, asked, tmp_path):
    with monkeypatch.context() as patch:
        use_kernel(patch, failing(lambda rows: (rows[:, ROW.index("f")] == 3) & (rows[:, 0] == 0.6)))
        quiet_search(out=tmp_path / "cube.nc")
    asked.clear()
    cube = quiet_search(out=tmp_path / "cube.nc", retry=True)
    assert 0 < points_made(asked) < cube["n_runs"].where(names(cube["answer"]) == "yes", 0).sum()


def test_a_long_point_can_be_stopped_within(monkeypatch):
    spec = study_of(GRID, None, over="beta0", ask="all", mode="rest", periods=5, rtol=1e-8)
    use_kernel(monkeypatch, fake_run_many)
    stop = StopFlag()
    stop.set()
    assert len(attempt(spec, np.arange(1), stop).results) == 0


@pytest.mark.jit
def test_threads_give_the_bits_of_a_serial_search():
    grid = {"Gamma": [0.8, 0.9, 1.0], "f": [15, 25], "beta0": {"start": 4, "stop": 74, "step": 10, "unit": "deg"}}
    one, two = (quiet_search(grid, periods=100, workers=workers, orbit_periods=50) for workers in (1, 2))
    assert (names(one["answer"]) == "yes").any()
    for name in one.data_vars:
        assert one[name].values.tobytes() == two[name].values.tobytes(), name


@pytest.mark.jit
def test_the_deciding_run_can_be_followed_for_longer():
    grid = {"xdot0": [1.0], "beta0": [np.deg2rad(16)]}
    short = quiet_search(grid, periods=200)
    long = quiet_search(grid, periods=200, orbit_periods=150)
    run = dimersweep.simulate(periods=150, record=False)
    assert json.loads(long.attrs["configuration"])["search"]["orbit_periods"] == 150
    assert long["n_periods"].item() == 150 > short["n_periods"].item()
    assert long["zeta"].item() == run.orbit.zeta != short["zeta"].item()
    assert long["n_runs"].item() == 1


def test_points_that_break_a_rule_between_two_axes_are_left_out(fake_kernel):
    grid = {"mu": [0.1, 0.2, 0.3], "mu_s": [0.1, 0.3], "beta0": [0.05, 0.1]}
    cube = quiet_search(grid)
    legal = cube["mu_s"] >= cube["mu"]
    assert (names(cube["answer"]) == "not_run").equals(~legal.transpose("mu", "mu_s"))
    assert (cube["n_runs"].where(~legal, 0) == 0).all()
    with pytest.raises(ParameterError, match=r"^mu_s = 0.1: must be >= mu = 0.2"):
        quiet_search({"mu": [0.2, 0.3], "mu_s": [0.1, 0.15], "beta0": [0.05, 0.1]})
    with pytest.raises(ParameterError, match=r"^mu_s = 0.1: must be >= mu = 0.2"):
        quiet_search({"mu_s": [0.1, 0.3], "beta0": [0.05, 0.1]})


def test_a_point_that_cannot_be_run_is_left_to_be_done(fake_kernel, monkeypatch, tmp_path):
    reference, out = quiet_search(), tmp_path / "cube.nc"
    with monkeypatch.context() as patch:
        use_kernel(patch, raising(lambda rows: rows[:, ROW.index("f")] == 3))
        set_pace(patch, 1)
        with pytest.raises(UnfinishedError, match=r"could not be run.* point 15 \(f = 3.0, .*MemoryError: no room; "):
            quiet_search(out=out)
    assert not out.exists()
    assert same_bits(quiet_search(out=out), reference)


def test_a_point_that_fails_marks_only_itself(fake_kernel, monkeypatch):
    use_kernel(monkeypatch, failing(lambda rows: rows[:, ROW.index("f")] == 3))
    set_pace(monkeypatch, 1)
    cube = quiet_search()
    failed = names(cube["mode"]) == "failed"
    assert failed.sel(f=3).all() and not failed.drop_sel(f=3).any()
    assert (names(cube["answer"]).sel(f=3) == "unsure").all()
    assert (names(cube["region"]).sel(f=3) == "failed").all()


def test_a_search_is_written_and_read_back(fake_kernel, tmp_path):
    cube = quiet_search(out=tmp_path / "cube.nc")
    back = dimersweep.open_cube(tmp_path / "cube.nc")
    xr.testing.assert_identical(back, cube)
    assert back["answer"].dtype == back["region"].dtype == np.int8


@given(st.integers(1, 300))
def test_the_spread_order_tries_each_value_once(n):
    order = spread_order(n)
    assert sorted(order) == list(range(n))


def test_the_spread_order_hits_every_interval_early():
    # after k trials no stretch without one is longer than twice the even spacing
    order = spread_order(64)
    for k in range(2, 64):
        assert np.diff(np.sort(np.append(order[:k], [0, 64]))).max() <= 2 * 64 / k


@given(st.lists(st.integers(1, 12), min_size=1, max_size=3))
def test_waves_take_each_point_once_and_know_earlier_ones_only(shape):
    known = set()
    for wave in waves(tuple(shape)):
        assert not known & wave.keys()
        for near in wave.values():
            assert set(near) <= known or not known
        known |= wave.keys()
    assert len(known) == np.prod(shape)


def test_a_hint_is_tried_first(fake_kernel):
    question = deciding.Question("beta0", np.linspace(0.1, 1, 10), "any", M_DRIFT)
    assert question.order([7, 2])[:2].tolist() == [7, 2]
    assert sorted(question.order([7, 2])) == list(range(10))
    assert question.until() == 1 << MODES.index("drift")
