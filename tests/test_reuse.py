"""A cube is extended, and its failed points are run again, without running any other point twice."""

import os

import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.errors import ParameterError, StoreError
from tests.fakes import failing, fake_run_many, set_pace

BETA0 = np.linspace(0.1, 1.5, 29)
GRID = {"f": [15, 25], "beta0": BETA0}


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def asked(monkeypatch):
    """Rows that the kernel was asked for."""
    rows_of_all = []

    def run_many(rows, *rest, until=0, space=None):
        rows_of_all.append(rows.copy())
        return fake_run_many(rows, *rest)

    monkeypatch.setattr("dimersweep.work.tiles.run_many", run_many)
    set_pace(monkeypatch, 10)
    monkeypatch.setattr("dimersweep.work.computing.warm_up", lambda stop: None)
    return rows_of_all


def sweep(grid=GRID, fixed=None, **settings):
    return dimersweep.sweep(grid, fixed, **({"periods": 5, "progress": False} | settings))


def points(asked):
    return sum(map(len, asked))


@pytest.mark.parametrize(
    ("grid", "fixed", "new"),
    [
        ({"f": [15, 20, 25], "beta0": BETA0}, {}, 29),  # a value between
        ({"f": [15, 25], "beta0": np.append(BETA0, 1.55)}, {}, 2),  # a value after
        ({"f": [15, 25], "beta0": np.sort(np.append(BETA0, BETA0[1:] - 0.02))}, {}, 56),  # values between all
        ({"f": [15, 25], "Gamma": [0.8, 0.9], "beta0": BETA0}, {}, 58),  # an axis that was a fixed value
        ({"beta0": BETA0}, {"f": 25}, 0),  # a fixed value that was an axis
        ({"beta0": BETA0[:5], "f": [15, 16]}, {}, 5),  # another order, and fewer values
        (GRID, {}, 0),
    ],
)
def test_points_of_a_cube_are_taken_over(asked, grid, fixed, new):
    sweep(out="old.nc")
    reference = sweep(grid, fixed)
    asked.clear()
    cube = sweep(grid, fixed, extend="old.nc", out="new.nc")
    assert points(asked) == new
    xr.testing.assert_equal(cube, reference)
    assert {name: cube[name].values.tobytes() for name in cube} == {n: reference[n].values.tobytes() for n in reference}
    assert cube.attrs["extends"].startswith("old.nc, configuration sha256 ")
    asked.clear()
    xr.testing.assert_equal(sweep(grid, fixed, extend="old.nc"), reference)
    assert points(asked) == new


def test_values_match_bit_for_bit_or_not_at_all(asked):
    sweep(out="old.nc")
    asked.clear()
    moved = BETA0.copy()
    moved[7] = np.nextafter(moved[7], 2)
    sweep({"f": [15, 25], "beta0": moved}, extend="old.nc")
    assert points(asked) == 2
    assert {row[7] for rows in asked for row in rows} == {moved[7]}


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"periods": 6}, "  periods: 5 -> 6"),
        ({"rtol": 1e-6}, "  rtol: 1e-08 -> 1e-06"),
        ({"stop_when_settled": False}, "  stop_when_settled: true -> false"),
        ({"fixed": {"mu": 0.1}}, "  fixed.mu: 0.2 -> 0.1"),
        (
            {"grid": {"beta0": BETA0, "e_1": [0.5]}, "fixed": {"f": 15}},
            "  parameters: e, e_1, e_2 in one of them only",
        ),
    ],
)
def test_a_cube_made_otherwise_is_not_extended(asked, settings, told):
    sweep(out="old.nc")
    asked.clear()
    with pytest.raises(StoreError) as error:
        sweep(**{"extend": "old.nc", "out": "new.nc"} | settings)
    first, *changes = str(error.value).splitlines()
    assert first == "old.nc: cannot be extended to this sweep, as it was made otherwise:"
    assert told in changes
    assert (asked, os.listdir()) == ([], ["old.nc"])


def test_a_cube_of_another_kernel_is_not_extended(asked, monkeypatch):
    sweep(out="old.nc")
    monkeypatch.setattr("dimersweep.studies.sweep_spec.kernel_version", lambda: "another")
    with pytest.raises(StoreError, match=r'otherwise:\n  kernel_version: "[0-9a-f]{16}" -> "another"$'):
        sweep(extend="old.nc")


def test_a_cube_without_any_of_the_points_is_refused(asked):
    sweep(out="old.nc")
    with pytest.raises(StoreError, match=r"^old.nc: has no point of this sweep \(f has none of its values\)$"):
        sweep({"f": [16, 17], "beta0": BETA0}, extend="old.nc")


def test_failed_points_are_run_again(monkeypatch, asked):
    reference = sweep()
    with monkeypatch.context() as patch:
        patch.setattr("dimersweep.work.tiles.run_many", failing(lambda rows: rows[:, 7] > 1.3))
        cube = sweep(out="cube.nc")
    failed = int((names(cube["mode"]) == "failed").sum())
    assert failed == 8
    asked.clear()
    assert sweep(out="cube.nc")["mode"].equals(cube["mode"])  # not without being asked
    assert points(asked) == 0
    again = sweep(out="cube.nc", retry=True)
    assert points(asked) == failed
    xr.testing.assert_equal(again, reference)
    xr.testing.assert_equal(dimersweep.open_cube("cube.nc"), reference)
    asked.clear()
    sweep(out="cube.nc", retry=True)
    assert points(asked) == 0


def test_a_stopped_sweep_runs_its_failed_points_again(monkeypatch, asked):
    reference = sweep()
    with monkeypatch.context() as patch, pytest.raises(dimersweep.errors.PointError):
        patch.setattr("dimersweep.work.tiles.run_many", failing(lambda rows: rows[:, 7] > 1.3))
        sweep(out="cube.nc", fail_fast=True, workers=1)
    assert os.listdir() == ["cube.nc.tiles"]
    xr.testing.assert_equal(sweep(out="cube.nc", retry=True), reference)


def test_retry_needs_a_cube(asked):
    with pytest.raises(ParameterError, match=r"^retry: needs an out, or a cube to extend$"):
        sweep(retry=True)
    sweep(out="cube.nc", retry=True)  # nothing is there yet: a first try
    with pytest.raises(StoreError, match=r"cube.nc: exists already; .*What differs:\n  periods: 5 -> 6"):
        sweep(out="cube.nc", retry=True, periods=6)
