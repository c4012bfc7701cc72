"""How sure verdicts are: against borders found by bisection and finer runs; in cubes, files and declarations."""

from pathlib import Path

import numpy as np
import pytest

import dimersweep
from dimersweep import Parameters, make
from dimersweep.cubes.cube import FLAGS, names
from dimersweep.errors import ParameterError, StoreError
from dimersweep.kernel.model.layout import CODES, M_APERIODIC, M_DRIFT, M_REST, M_UNRESOLVED, OUT
from dimersweep.runs.shadows import CERTAIN, CHANGED, ORBIT, UNSURE, certified, compared, orbit_difference
from dimersweep.runs.solving import RunSettings, run_all_patiently
from dimersweep.studies.declared import from_cube, read_declaration
from tests.seams import set_chunks

GRID = {"Gamma": [0.7, 0.9], "beta0": {"start": 4, "stop": 60, "num": 8, "unit": "deg"}}
SETTINGS = {"periods": 100, "progress": False, "workers": 1}
MODE, SETTLED_AFTER = CODES.index("mode"), OUT.index("settled_after")
DECLARED = """
[sweep]
title = "sure or not"
periods = 100
output = "cube.nc"
certify = true
[grid]
Gamma = [0.7, 0.9]
beta0 = {start = 4, stop = 60, num = 8, unit = "deg"}
"""


pytestmark = pytest.mark.usefixtures("empty_folder")


def classified(periods=100, max_periods=None, **start):
    """Mode and confidence of one point."""
    row, how = Parameters(**start).row()[None], RunSettings(periods, max_periods or periods, 1e-8)
    out, codes = run_all_patiently(row, how)
    return codes[0, MODE], certified(row, how, out, codes)[0][0]


def test_a_verdict_is_certain_but_at_a_border():
    """Between a start that drifts and one that does not, bisection finds a change: there, but not far from it, it is told."""
    inside, outside = np.deg2rad(16.0), np.deg2rad(4.0)
    modes = [classified(beta0=beta0) for beta0 in (inside, outside)]
    assert modes[0] == (M_DRIFT, CERTAIN)
    assert modes[1][0] != M_DRIFT
    while abs(inside - outside) > 1e-9:
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if classified(beta0=middle)[0] == M_DRIFT else (inside, middle)
    assert classified(beta0=inside)[1] in (UNSURE, CHANGED)
    assert classified(beta0=outside)[1] in (UNSURE, CHANGED)


def test_what_has_not_settled_is_unsure():
    assert classified(e=0.8, Gamma=3.0, f=25.0, beta0=0.3) == (M_APERIODIC, UNSURE)
    assert classified(periods=10) == (M_UNRESOLVED, UNSURE)


@pytest.mark.parametrize("Gamma", [0.8, 0.85])
def test_a_point_that_may_take_more_periods_is_as_certain_as_its_first_run(Gamma):
    """Its shadows begin with as few periods as it does, so that they settle by the same rule."""
    alone = classified(periods=40, max_periods=40, Gamma=Gamma, beta0=np.deg2rad(18.9))
    assert alone == (M_DRIFT, CERTAIN)
    assert classified(periods=40, max_periods=640, Gamma=Gamma, beta0=np.deg2rad(18.9)) == alone


def test_a_mode_by_another_transient_is_luck():
    out, codes = np.full((4, len(OUT)), np.nan), np.zeros((4, len(CODES)), dtype=int)
    codes[:, MODE], out[:, SETTLED_AFTER] = M_DRIFT, 30.0
    other_out, other_codes = out.copy(), codes.copy()
    other_out[1, SETTLED_AFTER] = 31.0
    other_codes[2, MODE] = M_REST
    other_codes[3, CODES.index("n_periods")] = 1
    assert compared((out, codes), (other_out, other_codes)).tolist() == [CERTAIN, UNSURE, CHANGED, UNSURE]


def test_the_error_of_an_orbit_is_that_to_a_much_finer_run():
    rows = np.array([Parameters(beta0=beta0).row() for beta0 in (0.28, 0.3)])
    how = RunSettings(100, 100, 1e-5)
    coarse, finest = run_all_patiently(rows, how), run_all_patiently(rows, how._replace(rtol=1e-12))
    assert (coarse[1][:, MODE] == M_DRIFT).all()
    error = certified(rows, how, *coarse)[1]
    assert error == pytest.approx(orbit_difference(coarse[0], finest[0]), rel=0.2)
    assert (error > 0).all()
    phase = np.zeros((1, len(OUT)))
    phase[0, ORBIT] = 1, 1, 1, 1, 1, 0.99
    after = phase.copy()
    after[0, ORBIT[5]] = 0.01
    assert orbit_difference(phase, after) == pytest.approx([0.02])


@pytest.mark.filterwarnings("error")
def test_a_straight_path_has_an_error_of_what_it_has():
    """It has no radius and no period, and does not turn: with `xdot0` = 0 its precession rate is 0."""
    cube = dimersweep.sweep({"beta0": [0.2, 0.3]}, {"xdot0": 0.0}, **SETTINGS, certify=True)
    assert names(cube["mode"]).values.tolist() == ["rest", "drift"]
    assert np.isnan(cube["radius"]).all() and cube["precession_rate"].values[1] == 0.0
    assert np.isnan(cube["error_estimate"].values[0]) and 0 < cube["error_estimate"].values[1] < 1e-6
    straight, turns = np.full((2, 1, len(OUT)), np.nan)
    straight[0, ORBIT], turns[0, ORBIT] = [np.nan, np.nan, 3.0, 0.1, 0.0, 0.5], [1e9, 1e9, 3.0, 0.1, 1e-9, 0.5]
    assert orbit_difference(straight, straight) == [0.0]
    assert np.isnan([orbit_difference(straight, turns), orbit_difference(turns, straight)]).all()


def test_a_cube_tells_confidence_and_error():
    plain = dimersweep.sweep(GRID, **SETTINGS)
    cube = dimersweep.sweep(GRID, **SETTINGS, certify=True, out="cube.nc")
    for name in plain.data_vars:
        np.testing.assert_array_equal(plain[name], cube[name])
    assert "confidence" not in plain
    again = dimersweep.open_cube("cube.nc")
    assert again.identical(cube)
    told = again["confidence"]
    assert told.dtype == np.int8
    assert told.attrs["flag_meanings"].split() == list(FLAGS["confidence"])
    assert told.attrs["flag_values"].tolist() == [0, 1, 2, 3]
    assert again["mode"].attrs["ancillary_variables"] == "confidence error_estimate"
    assert again["error_estimate"].attrs["units"] == "1"
    drifts = (names(again["mode"]) == "drift") & (names(told) == "certain")
    assert drifts.any()
    assert float(again["error_estimate"].where(drifts).max()) < 1e-6
    assert (names(told) == "certain").mean() > 0.5
    assert again["error_estimate"].where(names(again["mode"]) != "drift").isnull().all()


def test_certified_points_extend_certified_sweeps_only():
    dimersweep.sweep(GRID, **SETTINGS, certify=True, out="cube.nc")
    dimersweep.sweep(GRID, **SETTINGS, out="plain.nc")
    more = GRID | {"Gamma": [0.7, 0.8, 0.9]}
    whole = dimersweep.sweep(more, **SETTINGS, certify=True)
    cube = dimersweep.sweep(more, **SETTINGS, certify=True, extend="cube.nc")
    assert "extends" in cube.attrs
    for name in ("mode", "confidence", "error_estimate"):
        np.testing.assert_array_equal(cube[name], whole[name])
    with pytest.raises(StoreError, match="certify: "):
        dimersweep.sweep(more, **SETTINGS, certify=True, extend="plain.nc")


def test_a_cube_above_memory_has_them_too(fake_kernel, monkeypatch):
    pytest.importorskip("zarr")
    set_chunks(monkeypatch, 3)
    cube = dimersweep.sweep(GRID, **SETTINGS, certify=True, out="cube.zarr")
    memory = dimersweep.sweep(GRID, **SETTINGS, certify=True)
    for name in ("confidence", "error_estimate"):
        np.testing.assert_array_equal(cube[name], memory[name])
        assert cube[name].attrs["long_name"] == memory[name].attrs["long_name"]
    assert (cube["confidence"] != 0).all()


def test_a_declaration_and_the_command_line_certify(fake_kernel, call):
    Path("sweep.toml").write_text(DECLARED)
    cube = make(read_declaration("sweep.toml"), None, progress=False)
    assert set(names(cube["confidence"]).values.ravel()) <= {"certain", "unsure", "changed"}
    Path("plain.toml").write_text(DECLARED.replace("certify = true\n", ""))
    assert "modes that are certain " in call("run", "plain.toml", "--certify")[0]
    assert from_cube("cube.nc").sweep.certify
    assert "points: 16" in call("plan", "sweep.toml")[0]


def test_a_search_is_not_certified():
    Path("search.toml").write_text(DECLARED + '[search]\nover = "beta0"\n')
    with pytest.raises(ParameterError, match="certify: is for sweeps of a whole grid"):
        read_declaration("search.toml")
