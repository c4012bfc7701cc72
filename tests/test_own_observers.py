"""Observers of a user's own: in the cube, in every study, the same numbers whoever runs them, and a point each that fails."""

import importlib
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dimersweep import attractors, loops, make, names, open_cube, read_declaration, refine, search, simulate, sweep
from dimersweep.errors import ParameterError, PointError, StoreError
from dimersweep.studies.declared import from_cube
from dimersweep.studies.fingerprint import code_of
from dimersweep.studies.planning import plan
from dimersweep.studies.sweep import study_of
from tests import own_observers
from tests.own_observers import Scaled, counted, misshapen, spectral, turned

pytestmark = [pytest.mark.jit, pytest.mark.usefixtures("empty_folder")]

ROOT = Path(__file__).parents[1]
GRID = {"Gamma": [0.6, 0.8, 0.9, 1.0], "beta0": np.linspace(0.1, 0.6, 8)}
QUIET = {"periods": 60, "progress": False}
OWN = ("peak", "lines", "observer_error")


@pytest.fixture(scope="module")
def cube():
    """The sweep that the others are compared with."""
    return sweep(GRID, observe=spectral, workers=1, **QUIET)


@pytest.fixture(scope="module")
def plain():
    return sweep(GRID, **QUIET)


def same(one, other):
    """Whether two cubes have the same bits and the same labels."""
    attrs = [{k: v for k, v in each.attrs.items() if k in ("configuration", "values_sha256")} for each in (one, other)]
    return one.drop_attrs(deep=False).identical(other.drop_attrs(deep=False)) and attrs[0] == attrs[1]


# --- what stands in the cube --------------------------------------------------------------------------------------------


def test_what_it_gives_stands_in_the_cube_with_its_labels(cube):
    assert cube["peak"].dims == ("Gamma", "beta0") and cube["lines"].dims == ("Gamma", "beta0", "harmonic")
    assert cube["peak"].attrs == {"units": "Hz", "long_name": "frequency of the largest line of theta's rate"}
    for Gamma, beta0 in ((0.9, 0.1), (1.0, 0.6)):
        point = cube.sel(Gamma=Gamma, beta0=beta0)
        run = simulate(Gamma=Gamma, beta0=beta0, periods=60, stop_when_settled=True)
        assert run.n_periods == point["n_periods"]
        told = spectral(run)
        assert told.get("peak", np.nan) == pytest.approx(point["peak"].item(), abs=0, nan_ok=True)
    drifts = cube["mode"].values == 3
    assert (cube["peak"].values[drifts] == 15).all(), "a drift repeats each forcing period"
    assert not (cube["observer_error"] != b"").any()


def test_a_run_is_the_one_of_the_sweep_without_it(cube, plain):
    for name in plain.data_vars:
        assert cube[name].drop_attrs().identical(plain[name].drop_attrs()), name


def test_a_cube_is_read_as_it_was_written_and_damage_is_seen(cube, tmp_path):
    made = sweep(GRID, observe=spectral, workers=2, out="cube.nc", **QUIET)
    assert same(made, cube) and same(open_cube("cube.nc"), made)
    changed = made.copy(deep=True)
    changed["peak"][2, 3] = 1.0
    changed.to_netcdf("changed.nc")
    with pytest.raises(StoreError, match="is damaged, or values were changed"):
        open_cube("changed.nc")


def test_arguments_are_part_of_what_it_is():
    for observe in (Scaled(2.0), "tests.own_observers:Scaled"):
        how = {} if isinstance(observe, Scaled) else {"observe_with": {"factor": 2.0}}
        study = study_of({"Gamma": [0.9]}, observe=observe, periods=60, **how)
        assert study.configuration()["observe"]["arguments"] == {"factor": 2.0}
    sweep({"Gamma": [0.6]}, observe=Scaled(2.0), out="cube.nc", **QUIET)
    with pytest.raises(StoreError, match=r"observe.arguments: .*2.0.* -> .*3.0"):
        sweep({"Gamma": [0.6]}, observe=Scaled(3.0), out="cube.nc", **QUIET)


def find_in(folder):
    """Have a process find modules in a folder."""
    sys.path.append(folder)


# --- whoever runs it ----------------------------------------------------------------------------------------------------


def test_one_that_dies_with_its_process_goes_on(cube):
    code = (
        "import numpy as np; from tests.test_own_observers import GRID, QUIET; from dimersweep import sweep; "
        "from tests.own_observers import spectral; sweep(GRID, observe=spectral, out='cube.nc', workers=1, **QUIET)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT), "DIE_AT": "calls"}
    process = partial(subprocess.run, [sys.executable, "-c", code], check=False)
    assert process(env=environment).returncode == 9
    before = len(Path("calls").read_text())
    assert process(env=environment).returncode == 0
    made = len(Path("calls").read_text()) - before
    assert before == 20 and made < cube["mode"].size
    assert same(open_cube("cube.nc"), cube)


def test_a_cube_is_extended(cube):
    sweep(GRID | {"Gamma": [0.6, 1.0]}, observe=spectral, out="some.nc", **QUIET)
    whole = sweep(GRID, observe=spectral, extend="some.nc", **QUIET)
    assert same(whole, cube)
    with pytest.raises(StoreError, match=r"as it was made otherwise:\n  observe\.name"):
        sweep(GRID, observe=turned, extend="some.nc", **QUIET)


TEXT = """
from dimersweep import observer
FACTOR = {factor}
def scaled(n):
    return FACTOR * n
@observer(events={{"units": "1", "long_name": "events"}})
def f(run):
    return {{"events": scaled(run.n_events)}}
"""


def module(folder, factor):
    """A module with an observer, as it is written now."""
    (folder / "my_module.py").write_text(TEXT.format(factor=factor))
    sys.modules.pop("my_module", None)
    importlib.invalidate_caches()
    sys.dont_write_bytecode = True
    return importlib.import_module("my_module").f


def test_another_version_of_it_makes_another_study(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    grid, how = {"Gamma": [0.6, 0.7]}, {"out": "cube.nc"} | QUIET
    first = sweep(grid, observe=module(tmp_path, 1), **how)
    again = sweep(grid, observe=module(tmp_path, 1), **how)
    assert same(first, again)
    other = module(tmp_path, 2)  # a constant that a function uses which the observer calls
    with pytest.raises(StoreError, match=r'exists already; give another name.*\n  observe\.code: "'):
        sweep(grid, observe=other, **how)
    with pytest.raises(StoreError, match=r'made otherwise:\n  observe\.code: "'):
        sweep(grid, observe=other, extend="cube.nc", **QUIET)


def test_workers_have_the_same_numbers_and_tell_what_they_lack(cube, tmp_path, monkeypatch):
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as made,
        Client(made) as client,
    ):
        assert same(sweep(GRID, observe=spectral, client=client, out="cube.nc", **QUIET), cube)
        (tmp_path / "here").mkdir()
        monkeypatch.syspath_prepend(tmp_path / "here")
        observe = module(tmp_path / "here", 1)
        lacking = r"^scheduler: worker process \d+ on .*: observe = 'my_module:f': there is no module my_module$"
        with pytest.raises(ParameterError, match=lacking):
            sweep(GRID, observe=observe, client=client, **QUIET)
        (tmp_path / "my_module.py").write_text(TEXT.format(factor=2))
        client.run(find_in, str(tmp_path))
        with pytest.raises(ParameterError, match=r"worker process .* observe = 'my_module:f': is another version here"):
            sweep(GRID, observe=observe, client=client, **QUIET)


# --- one that raises ----------------------------------------------------------------------------------------------------


def test_one_that_raises_takes_its_point_alone_and_is_tried_again():
    Path("fails").touch()
    values = np.concatenate([[0.9], np.linspace(0.5, 0.89, 999)])
    made = sweep(points={"Gamma": values}, observe=turned, periods=20, out="cube.nc", progress=False)
    status = names(made["status"]).values
    assert (status == "observer").tolist() == [True] + [False] * 999
    assert made["observer_error"].values[0] == b"ZeroDivisionError: at 0.9, for one"
    assert np.isnan(made["turned"].values[0]) and np.isfinite(made["turned"].values[1:]).all()
    assert names(made["mode"]).values[0] != "failed", "its run was made"
    Path("fails").unlink()
    again = sweep(points={"Gamma": values}, observe=turned, periods=20, out="cube.nc", retry=True, progress=False)
    assert (names(again["status"]) == "ok").all() and np.isfinite(again["turned"]).all()
    assert again["turned"][1:].identical(made["turned"][1:])


def test_at_the_first_one_that_raises_a_sweep_may_stop(capsys):
    Path("fails").touch()
    with pytest.raises(PointError, match=r"Gamma = 0.9\) failed: observer: ZeroDivisionError: at 0.9, for one; "):
        sweep({"Gamma": [0.6, 0.9]}, observe=turned, fail_fast=True, **QUIET)
    sweep({"Gamma": [0.6, 0.9]}, observe=turned, periods=60)
    assert "failed 1" in capsys.readouterr().err


def test_another_shape_than_declared_is_told_at_each_point():
    made = sweep({"Gamma": [0.6, 0.9]}, observe=misshapen, **QUIET)
    assert set(made["observer_error"].values) == {b"ValueError: wrong: has shape (3,), and () was declared"}
    assert (names(made["status"]) == "observer").all()


# --- in other studies ---------------------------------------------------------------------------------------------------


def test_a_search_and_a_map_observe_the_deciding_runs():
    grid = {"Gamma": [0.6, 0.9, 1.0], "beta0": np.linspace(0.1, 0.6, 6)}
    found = search(grid, over="beta0", observe=spectral, **QUIET)
    decided = found["peak"].where(found["answer"] == 2, drop=True)
    assert decided.size == 2 and (decided == 15).all()
    assert np.isnan(found["peak"].sel(Gamma=0.6)), "no run alone has decided"
    longer = search(grid, over="beta0", orbit_periods=70, observe=counted, **QUIET)
    assert longer["last"].values.tolist()[1:] == [70, 70]
    fine = refine(grid, over="beta0", halvings={"Gamma": 1}, observe=spectral, **QUIET)
    assert fine["peak"].sel(Gamma=0.9) == 15 and np.isnan(fine["peak"].where(fine["computed"] == 0)).all()


def test_loops_tell_it_next_to_their_ends():
    values = np.linspace(0.7, 1.1, 9)
    made = sweep({"Gamma": values}, periods=100, carry="both", observe=counted, progress=False)
    found = loops(made)
    low = np.searchsorted(values, found["low"].values[0])
    inside = made.sel(direction=1).isel(Gamma=low)
    assert found["last_down_low"].values[0] == inside["n_periods"] == inside["last"]
    up = sweep({"Gamma": values[:3]}, periods=100, carry="up", observe=turned, progress=False)
    run = up.dimersweep.run(Gamma=values[2], direction="up")
    assert up["turned"].values[0, 2] == turned(run)["turned"], "from the state that was carried"


def test_attractors_have_it_for_each_start():
    drawn = {"starts": 12, "periods": 100, "progress": False}
    found = attractors({"beta0": ("1 deg", "60 deg")}, observe=spectral, out="found.nc", **drawn)
    assert found["peak"].dims == ("start",) and found["lines"].dims == ("start", "harmonic")
    drift = found["attractor"].values[names(found["mode"]).values == "drift"][0]
    assert (found["peak"].values[found["basin"].values == drift] == 15).all()


# --- in files and on the command line -------------------------------------------------------------------------------------

FILE = """
[sweep]
periods = 60
observe = "my_module:f"
output = "file.nc"
[grid]
Gamma = [0.6, 0.9]
"""


def test_a_file_names_one_that_lies_beside_it(tmp_path, monkeypatch, call):
    folder = tmp_path / "files"
    folder.mkdir()
    monkeypatch.setattr(sys, "path", [*sys.path])
    sys.modules.pop("my_module", None)
    (folder / "my_module.py").write_text(TEXT.format(factor=3))
    (folder / "file.toml").write_text(FILE)
    made = make(read_declaration(folder / "file.toml"), "cube.nc", progress=False)
    assert (made["events"] == 3 * made["n_events"]).all()
    assert from_cube("cube.nc").study().configuration() == json.loads(made.attrs["configuration"])
    out, _, code = call("run", str(folder / "file.toml"), "--observe", "tests.own_observers:turned", "--out", "t.nc")
    assert code == 0 and "rest 1, drift 1" in out and "turned" in open_cube("t.nc")
    out, _, code = call("plan", str(folder / "file.toml"), "--observe", "tests.own_observers:counted")
    assert code == 0 and "2 random points" in out


def test_a_plan_times_it():
    slow = study_of({"Gamma": [0.6, 0.9]}, observe=own_observers.slow, periods=60)
    assert plan(slow, 1).seconds[0] > 0.4


# --- what tells it from another -------------------------------------------------------------------------------------------


def made_from(text):
    space = {"__name__": "somewhere"}
    exec(text, space)
    return space["f"]


FIRST = "K = 1\ndef g(x, n=2): return x + n\ndef f(run): return g(K) if run in {'a', 'b', 'c'} else [g(i) for i in run]"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("K = 1", "K = 2"),
        ("n=2", "n=3"),
        ("x + n", "x - n"),
        ("'c'", "'d'"),
        ("g(i)", "g(-i)"),
        ("def f(run)", "def f(run, t=1)"),
    ],
)
def test_what_it_does_and_what_it_names_tell_it_from_another(old, new):
    same_text = made_from("\n\n" + FIRST + "\n# a comment\n")
    assert code_of(made_from(FIRST), ()) == code_of(same_text, ())
    assert code_of(made_from(FIRST), ()) != code_of(made_from(FIRST.replace(old, new)), ())


def test_other_processes_find_the_same():
    show = f"exec({FIRST!r}); from dimersweep.studies.fingerprint import code_of; print(code_of(f, ()))"
    told = set()
    for seed in "01":
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": seed}
        told.add(subprocess.run([sys.executable, "-c", show], env=environment, capture_output=True, check=True).stdout)
    assert len(told) == 1
