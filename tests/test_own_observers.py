"""Observers of a user's own: in the cube, in every study, the same numbers whoever runs them, and a point each that fails."""

import importlib
import json
import os
import subprocess
import sys
from functools import wraps
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import xarray as xr

from dimersweep import (
    attractors,
    loops,
    make,
    names,
    observer,
    open_cube,
    read_declaration,
    refine,
    search,
    simulate,
    sweep,
)
from dimersweep.errors import ParameterError, PointError, StoreError
from dimersweep.studies.declared import from_cube
from dimersweep.studies.planning import plan
from dimersweep.studies.sweep import study_of
from tests import own_observers
from tests.own_observers import Scaled, counted, fixed_time, misshapen, spectral, stopped, turned

pytestmark = [pytest.mark.jit, pytest.mark.usefixtures("empty_folder")]

ROOT = Path(__file__).parents[1]
GRID = {"Gamma": [0.6, 0.8, 0.9, 1.0], "beta0": np.linspace(0.1, 0.6, 6)}
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
        told = spectral(run.go_on(60 - run.n_periods) if run.n_periods < 60 else run)
        assert told.get("peak", np.nan) == pytest.approx(point["peak"].item(), abs=0, nan_ok=True)
    drifts = cube["mode"].values == 3
    assert (cube["peak"].values[drifts] == 15).all(), "a drift repeats each forcing period"
    assert not (cube["observer_error"] != "").any()


def test_a_run_is_the_one_of_the_sweep_without_it(cube, plain):
    for name in plain.data_vars:
        assert cube[name].equals(plain[name]), name


def test_a_cube_is_read_as_it_was_written_and_damage_is_seen(cube, tmp_path):
    made = sweep(GRID, observe=spectral, workers=2, out="cube.nc", **QUIET)
    assert same(made, cube) and same(open_cube("cube.nc"), made)
    changed = made.copy(deep=True)
    changed["peak"][2, 3] = 1.0
    changed.to_netcdf("changed.nc")
    with pytest.raises(StoreError, match="is damaged, or values were changed"):
        open_cube("changed.nc")


def test_a_run_has_its_whole_length_though_the_sweep_stops_when_it_has_settled(plain):
    made = sweep(GRID, observe=fixed_time, **QUIET)
    assert (names(made["status"]) == "ok").all() and made["n_periods"].min() < 15
    at_once = sweep(GRID, observe=fixed_time, stop_when_settled=False, **QUIET)
    np.testing.assert_array_equal(made["spans"], at_once["spans"])
    assert (sweep(GRID, observe=counted, **QUIET)["last"] == 60).all()
    short = sweep(GRID, observe=stopped, **QUIET)
    assert (short["last"] == short["n_periods"]).all() and short["n_periods"].equals(plain["n_periods"])
    patient = sweep({"Gamma": [0.9]}, observe=counted, periods=20, max_periods=160, progress=False)
    assert patient["last"] == patient["n_periods"] > 20


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


def test_one_that_dies_with_its_process_goes_on(cube, monkeypatch):
    code = (
        "import numpy as np; from tests.test_own_observers import GRID, QUIET; from dimersweep import sweep; "
        "from tests.own_observers import spectral; sweep(GRID, observe=spectral, out='cube.nc', workers=1, **QUIET)"
    )
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("DIE_AT", "calls")
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    before = len(Path("calls").read_text())
    sweep(GRID, observe=spectral, out="cube.nc", workers=1, **QUIET)
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
@observer(stop_when_settled=True, events={{"units": "1", "long_name": "events"}})
def f(run):
    return {{"events": scaled(run.n_events)}}
"""


def module(folder, factor):
    """What is called f in such a module."""
    return imported(folder, TEXT.format(factor=factor))


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
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as made,
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
    values = np.concatenate([[0.9], np.linspace(0.5, 0.89, 49)])
    made = sweep(points={"Gamma": values}, observe=turned, periods=20, out="cube.nc", progress=False)
    status = names(made["status"]).values
    assert (status == "observer").tolist() == [True] + [False] * 49
    assert made["observer_error"].values[0] == "ZeroDivisionError: at 0.9, for one"
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


@observer(wrong={"units": "1", "long_name": "nothing"})
def wordy(run):
    raise ValueError("Größe " + "µ" * 100 if run.parameters["Gamma"] < 0.7 else "Größe")


def test_what_it_says_is_a_text_whose_cut_is_marked():
    made = sweep({"Gamma": [0.6, 0.9]}, observe=wordy, out="cube.nc", **QUIET)
    long, short = made["observer_error"].values.tolist()
    assert short == "ValueError: Größe"
    assert long.startswith("ValueError: Größe µµ") and long.endswith("µ...") and 99 <= len(long.encode()) <= 100
    xr.testing.assert_identical(open_cube("cube.nc"), made)
    with xr.open_dataset("cube.nc") as back:
        assert back["observer_error"].values.tolist() == [long, short]


def test_another_shape_than_declared_is_told_at_each_point():
    made = sweep({"Gamma": [0.6, 0.9]}, observe=misshapen, **QUIET)
    assert set(made["observer_error"].values) == {"ValueError: wrong: has shape (3,), and () was declared"}
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
    assert found["last_down_low"].values[0] == inside["last"] == 100
    up = sweep({"Gamma": values[:3]}, periods=100, carry="up", observe=turned, progress=False)
    run = up.dimersweep.run(Gamma=values[2], direction="up")
    whole = run.go_on(100 - run.n_periods)
    assert up["turned"].values[0, 2] == turned(whole)["turned"], "from the state that was carried"


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

HEAD = """
import functools
from dataclasses import dataclass
from fractions import Fraction
import numpy as np
from dimersweep import observer
"""
MARKED = """
@observer(events={"units": "1", "long_name": "events"})
def f(run):
    return {"events": value(run.n_events)}
"""
OF_CLASS = """
@observer(events={"units": "1", "long_name": "events"})
@dataclass
class f(Base):
    def __call__(self, run):
        return {"events": self.value(run.n_events)}
"""
CHANGES = {  # what one module has, the number 70 in place of 1 in the other, and what observes
    "a numpy number": ("K = np.float64(1)\ndef value(n): return K * n", MARKED),
    "an object array": ("K = np.array([1, None])\ndef value(n): return K[0] * n", MARKED),
    "a slice": ("K = slice(0, 1)\ndef value(n): return n * len(range(99)[K])", MARKED),
    "a fraction": ("K = Fraction(1, 3)\ndef value(n): return float(K * n)", MARKED),
    "a partial": ("value = functools.partial(lambda k, n: k * n, 1)", MARKED),
    "a cached helper": ("@functools.lru_cache\ndef value(n): return 1 * n", MARKED),
    "a vectorized one": ("value = np.vectorize(lambda n: 1 * n, otypes=[float])", MARKED),
    "a wrapped one": (
        "def same(g):\n    @functools.wraps(g)\n    def h(n): return 1 * g(n)\n    return h\n@same\ndef value(n): return n",
        MARKED,
    ),
    "an inherited method": ("class Base:\n    def value(self, n): return 1 * n", OF_CLASS),
    "a polynomial": ("value = np.polynomial.Polynomial([0, 1])", MARKED),
}


def imported(folder, text):
    """What is called f in a module with this text, which is written and imported now."""
    (folder / "my_module.py").write_bytes(text.encode())
    sys.modules.pop("my_module", None)
    importlib.invalidate_caches()
    sys.dont_write_bytecode = True
    return importlib.import_module("my_module").f


def code(observe):
    """What tells an observer from another."""
    return study_of({"Gamma": [0.6]}, observe=observe, periods=5).configuration()["observe"]["code"]


@pytest.mark.parametrize("kind", CHANGES)
def test_what_its_module_has_tells_it_from_another(kind, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    has, marked = CHANGES[kind]
    one, other = HEAD + has + marked, HEAD + has.replace("1", "70", 1) + marked
    codes = [code(imported(tmp_path, text)) for text in (one, other, one, one.replace("\n", "\r\n"))]
    assert codes[0] == codes[2] == codes[3] != codes[1]


def test_another_constant_is_not_taken_for_the_same(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    has, marked = CHANGES["a numpy number"]
    sweep({"Gamma": [0.6, 0.7]}, observe=imported(tmp_path, HEAD + has + marked), out="cube.nc", **QUIET)
    other = imported(tmp_path, HEAD + has.replace("1", "70") + marked)
    with pytest.raises(StoreError, match=r'made otherwise:\n  observe\.code: "text [0-9a-f]{16}" -> "text '):
        sweep({"Gamma": [0.6, 0.7, 0.8]}, observe=other, extend="cube.nc", **QUIET)


def codes_elsewhere(*paths):
    """What another process finds in the modules in these places."""
    show = (
        "import importlib, sys; from tests.test_own_observers import code\n"
        "for path in sys.argv[1:]:\n"
        "    sys.path.insert(0, path)\n"
        "    sys.modules.pop('my_module', None)\n"
        "    module = importlib.import_module('my_module')\n"
        "    assert module.__file__.startswith(path)\n"
        "    print(code(module.f))\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "1"}
    done = subprocess.run(
        [sys.executable, "-c", show, *paths], env=environment, capture_output=True, check=True, text=True
    )
    return done.stdout.split("\n")[:-1]


def test_another_process_another_place_and_an_archive_have_the_same(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    has, marked = CHANGES["an object array"]
    here = code(imported(tmp_path, HEAD + has + marked))
    (tmp_path / "other").mkdir()
    (tmp_path / "my_module.py").rename(tmp_path / "other" / "my_module.py")
    with ZipFile(tmp_path / "archive.zip", "w") as archive:
        archive.write(tmp_path / "other" / "my_module.py", "my_module.py")
    assert codes_elsewhere(str(tmp_path / "other"), str(tmp_path / "archive.zip")) == [here, here]


HELPED = """
from dimersweep import observer
import helpers
@observer(events={{"units": "1", "long_name": "events"}}{more})
def f(run):
    return {{"events": helpers.factor * run.n_events}}
"""


def test_a_module_that_it_depends_on_counts_and_may_not_change_meanwhile(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    codes = {}
    for more in ("", ', depends="helpers"', ", depends=[helpers]"):
        for factor in (1, 70):
            (tmp_path / "helpers.py").write_text(f"factor = {factor}")
            sys.modules.pop("helpers", None)
            codes[more, factor] = code(f := imported(tmp_path, HELPED.format(more=more)))
    same = {more: codes[more, 1] == codes[more, 70] for more in ("", ', depends="helpers"', ", depends=[helpers]")}
    assert [*same.values()] == [True, False, False]
    (tmp_path / "helpers.py").write_text("factor = 1\n")
    with pytest.raises(
        ParameterError, match=r"observe = 'my_module:f': is another version here; import all of it anew"
    ):
        sweep({"Gamma": [0.6]}, observe=f, **QUIET)


def test_one_of_a_module_that_was_imported_anew_is_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    f = imported(tmp_path, TEXT.format(factor=1))
    (tmp_path / "my_module.py").write_text(TEXT.format(factor=2))
    assert sweep({"Gamma": [0.6]}, observe=f, **QUIET)["events"] > 0, "a file that has changed since is not what runs"
    importlib.reload(sys.modules["my_module"])
    with pytest.raises(
        ParameterError, match=r"observe = 'my_module:f': is another version here; import all of it anew"
    ):
        sweep({"Gamma": [0.6]}, observe=f, **QUIET)


def test_a_version_stands_in_place_of_the_text(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    grid, text = {"Gamma": [0.6, 0.7]}, TEXT.format(factor=1)
    sweep(grid, observe=imported(tmp_path, text), out="cube.nc", **QUIET)
    known = open_cube("cube.nc").attrs["configuration"].split('"code": "')[1][:21]
    told = text.replace("@observer(", f'@observer(version="{known}", ') + "# laid out anew\n"
    whole = sweep({"Gamma": [0.6, 0.7, 0.8]}, observe=imported(tmp_path, told), extend="cube.nc", **QUIET)
    assert (whole["events"] == whole["n_events"]).all()
    assert code(imported(tmp_path, text.replace("@observer(", "@observer(version=2, "))) == "2"


def test_a_cell_of_a_notebook_has_its_text():
    from IPython.core.interactiveshell import InteractiveShell

    shell, codes = InteractiveShell(), []
    for factor in (1, 1, 70):
        shell.run_cell(TEXT.format(factor=factor), store_history=True).raise_error()
        codes.append(code(shell.user_ns["f"]))
    assert codes[0] == codes[1] != codes[2]


FIELD = {"events": {"units": "1", "long_name": "events"}}


@pytest.mark.parametrize(
    "text", ["f = observer(**FIELD)(lambda run: {})", "@observer(**FIELD)\ndef f(run):\n    return {}"]
)
def test_what_has_no_text_of_its_own_needs_a_version(text):
    space = {"observer": observer, "FIELD": FIELD}
    with pytest.raises(ParameterError, match=r"^observer: .*give version="):
        exec(text, space)
    exec(text.replace("**FIELD", "version=3, **FIELD"), space)
    assert code(space["f"]) == "3"


def test_what_only_wraps_or_inherits_is_not_taken_for_what_was_marked():
    @wraps(spectral)
    def wrapped(run):
        return {"peak": 70.0}

    class Inherits(Scaled):
        def __call__(self, run):
            return {"scaled": 70.0}

    for observe in (wrapped, Inherits(2.0)):
        with pytest.raises(ParameterError, match=r"declares nothing; mark a function or a dataclass, above all else"):
            sweep({"Gamma": [0.6]}, observe=observe, **QUIET)


def test_two_of_one_name_in_one_file_are_told_apart(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    one, other = MARKED.replace("def f", "def g"), MARKED.replace("def f", "def g").replace("value(", "2 * value(")
    f = imported(tmp_path, HEAD + "def value(n): return n\n" + one + "f = [g]\n" + other + "f += [g]\n")
    assert f[0].__qualname__ == f[1].__qualname__ and code(f[0]) != code(f[1])
