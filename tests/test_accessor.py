"""What a cube can do: draw itself, tell its drifts, and give the run behind a point."""

import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.errors import ParameterError, StoreError
from tests.seams import another_version

pytestmark = pytest.mark.jit
DEG = np.pi / 180


@pytest.fixture(scope="module")
def cube():
    return dimersweep.sweep(
        {"f": [15, 20], "beta0": {"start": 8, "stop": 24, "step": 4, "unit": "deg"}},
        fixed={"Gamma": 0.9},
        periods=150,
        progress=False,
        attrs={"title": "some starts"},
    )


def test_the_run_behind_a_point_is_the_one_of_the_cube(cube):
    run = cube.dimersweep.run(f=15, beta0="16.3 deg")
    point = cube.sel(f=15, beta0=16 * DEG, method="nearest")
    assert run.parameters["beta0"] == point["beta0"].item() == pytest.approx(16 * DEG)
    assert (run.mode, run.n_periods) == ("drift", point["n_periods"].item())
    assert run.orbit.radius == pytest.approx(point["radius"].item(), rel=1e-6)
    longer = cube.dimersweep.run(f=15, beta0="16 deg", periods=200, record=False)
    assert longer.n_periods == 200
    assert dimersweep.simulate(start=point, periods=3).parameters == run.parameters


def test_the_run_behind_a_search_is_the_one_that_decided():
    found = dimersweep.search(
        {"f": [15, 20], "beta0": {"start": 8, "stop": 60, "step": 4, "unit": "deg"}},
        over="beta0",
        ask="first",
        periods=150,
        orbit_periods=160,
        progress=False,
    )
    run = found.dimersweep.run(f=20)
    assert (run.n_periods, run.mode) == (160, "drift")
    assert run.parameters["beta0"] == found.sel(f=20)["beta0"].item()
    assert run.orbit.radius == pytest.approx(found.sel(f=20)["radius"].item(), rel=1e-6)


def test_the_run_behind_each_point_of_a_patient_sweep_has_its_periods_events_and_mode():
    """Some points are classified after twice their first periods: another verdict than after all that they may take at once."""
    axes = {"Gamma": {"start": 1.2, "stop": 3.0, "num": 6}, "beta0": {"start": 10, "stop": 80, "num": 8, "unit": "deg"}}
    cube = dimersweep.sweep(axes, periods=40, max_periods=300, progress=False).stack(point=("Gamma", "beta0"))
    cube = cube.reset_index("point")
    assert 80 in cube["n_periods"]
    for number in range(cube.sizes["point"]):
        point, run = cube.isel(point=number), cube.dimersweep.run(point=number, record=number % 2 == 0)
        assert run.mode == dimersweep.names(point["mode"]).item(), number
        for name in ("mode_period", "n_periods", "n_events"):
            assert getattr(run, name) == point[name].item(), (number, name)


def test_drifts_are_a_mask(cube):
    drifts = cube.dimersweep.drifts()
    assert drifts.dtype == bool
    np.testing.assert_array_equal(drifts, dimersweep.names(cube["mode"]) == "drift")
    assert (cube.dimersweep.modes() == dimersweep.names(cube["mode"])).all()


def test_a_cube_draws_itself(cube, tmp_path):
    assert cube.dimersweep.plot().legends
    assert cube.dimersweep.plot(quantity="radius", path=tmp_path / "radius.png")
    assert (tmp_path / "radius.png").exists()
    assert cube.dimersweep.plot("segments").axes


def test_a_cube_tells_what_it_is(cube):
    assert repr(cube.dimersweep).startswith("<cube of dimersweep over f (2), beta0 (5): ")
    table = cube.dimersweep._repr_html_().replace("\N{NO-BREAK SPACE}", " ")
    for word in ("some starts", "axis β(0)", "drift", "Γ = 0.9"):
        assert word in table


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"f": 15}, r"^beta0: has 5 values; give one of them$"),
        ({"F": 15}, r"^F: unknown axis of the cube; did you mean f\? \(allowed: f, beta0\)$"),
        ({"f": "15 deg", "beta0": 0.1}, r"^f = '15 deg': the unit must be Hz, rpm or the like$"),
        ({"f": 15, "beta0": 16}, r"^beta0 = 16: must lie on the axis, \S+ to \S+ rad$"),
        ({"f": 50, "beta0": "16 deg"}, r"^f = 50: must lie on the axis, 15 to \d+ Hz$"),
    ],
)
def test_a_point_that_is_none_is_named(cube, where, message):
    with pytest.raises(ParameterError, match=message):
        cube.dimersweep.run(**where)


def test_an_empty_axis_has_no_run(cube):
    with pytest.raises(ParameterError, match=r"^f: the axis is empty$"):
        cube.isel(f=slice(0, 0)).dimersweep.run(f=15, beta0="16 deg")


@pytest.mark.parametrize("number", [-1, 10, 2.5, "a", True])
def test_a_point_beyond_the_table_is_named(cube, number):
    table = cube.stack(point=("f", "beta0")).reset_index("point")
    with pytest.raises(ParameterError, match=rf"^point = {number!r}: must be a whole number from 0 to 9$"):
        table.dimersweep.at(point=number)


def test_modes_that_are_no_whole_numbers_are_not_drawn(cube):
    told = (
        r"^mode: is of type float(32|64), as where\(\) makes it, and codes are whole numbers; give the cube as it was"
    )
    whole = cube.assign(mode=cube["mode"].astype(float))
    for changed in (whole, cube.where(cube["f"] > 15)):
        for use in (changed.dimersweep.plot, changed.dimersweep.__repr__):
            with pytest.raises(StoreError, match=told):
                use()
    with pytest.raises(StoreError, match=r"^mode = nan: is the code of no mode; the cube was changed$"):
        cube.where(cube["f"] > 15).dimersweep.modes()


def test_a_title_that_is_no_text_is_shown(cube):
    assert "<b>5</b>" in cube.assign_attrs(title=5).dimersweep._repr_html_()


def test_the_run_behind_a_point_of_another_kernel_says_so(cube, monkeypatch):
    another_version(monkeypatch)
    with pytest.warns(RuntimeWarning, match=r"^the cube was made by another version of the kernel; the run may differ"):
        cube.dimersweep.run(f=15, beta0="16 deg")


def test_other_datasets_have_no_such_thing():
    other = xr.Dataset({"a": 1}).dimersweep
    for asked in (other.drifts, other.modes, other.at, other.run):
        with pytest.raises(ParameterError, match="no cube of dimersweep"):
            asked()
    assert repr(other).startswith("<xarray.Dataset>") and "xarray" in other._repr_html_()
