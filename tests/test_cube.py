"""A cube tells its units, its words and its origin, and reads back as it was written."""

import hashlib
import json

import netCDF4
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.cube import blank, build, names
from dimersweep.cubes.grid import make_grid
from dimersweep.kernel.model.layout import CODES, DI_ENDS, M_DRIFT, MODES, OUT, STATUSES
from dimersweep.plots.tables import cube_table
from dimersweep.storage.checking import checksum_of
from dimersweep.storage.provenance import attributes


@pytest.fixture
def cube():
    grid = make_grid({"Gamma": [0.8, 0.9], "beta0": [0.1, 0.2, 0.3]})
    out, codes = blank(grid.size)
    codes[4, CODES.index("mode")] = M_DRIFT
    out[4, OUT.index("radius")] = 4.2
    return build(grid, out, codes, attributes({"periods": 3}, "a title", 1.5))


def test_points_land_where_the_grid_says(cube):
    assert cube["mode"].dims == ("Gamma", "beta0")
    assert cube["mode"].sel(Gamma=0.9, beta0=0.2) == M_DRIFT
    assert cube["radius"].sel(Gamma=0.9, beta0=0.2) == 4.2
    assert np.isnan(cube["radius"]).sum() == 5
    assert names(cube["mode"]).sel(Gamma=0.9, beta0=0.2) == "drift"


def test_labels_are_int8_flags_with_meanings(cube):
    for name, words in (("mode", MODES), ("status", (*STATUSES, "observer")), ("di_end", DI_ENDS)):
        assert cube[name].dtype == np.int8
        assert cube[name].attrs["flag_values"].dtype == np.int8
        assert cube[name].attrs["flag_meanings"].split() == list(words)
        assert "units" not in cube[name].attrs
    for name in ("n_events", "n_periods", "mode_period"):
        assert cube[name].dtype == np.int32


def test_everything_has_a_meaning_and_measures_have_units(cube):
    for name, variable in cube.variables.items():
        assert variable.attrs["long_name"], name
        assert "units" in variable.attrs or "flag_values" in variable.attrs, name
    assert (cube["beta0"].attrs["units"], cube["f"].attrs["units"]) == ("rad", "Hz")
    lowered = [str(name).lower() for name in cube.variables]
    assert len(set(lowered)) == len(lowered), "CF wants names that differ in more than case"


def test_attributes_say_where_the_cube_comes_from(cube):
    told = cube.attrs
    assert told["Conventions"] == "CF-1.11"
    assert told["configuration_sha256"] == hashlib.sha256(told["configuration"].encode()).hexdigest()
    assert json.loads(told["configuration"]) == {"periods": 3}
    for name in ("kernel_version", "git_commit", "git_dirty", "numba", "numpy", "python", "cpu", "history"):
        assert isinstance(told[name], str) and told[name]
    assert told["wall_time_s"] == 1.5
    assert dimersweep.__version__ in told["source"]


@pytest.mark.parametrize("engine", ["netcdf4", "h5netcdf"])
def test_round_trip_keeps_every_type_and_value(cube, tmp_path, engine):
    cube.to_netcdf(tmp_path / "cube.nc")
    back = xr.load_dataset(tmp_path / "cube.nc", engine=engine)
    xr.testing.assert_equal(cube, back)
    assert {name: back[name].dtype for name in back} == {name: cube[name].dtype for name in cube}


def test_the_file_follows_cf(cube, tmp_path):
    cube.to_netcdf(tmp_path / "cube.nc")
    with netCDF4.Dataset(tmp_path / "cube.nc") as file:
        for name in ("Gamma", "beta0", "f", "mode", "status", "di_end", "n_events"):
            assert "_FillValue" not in file[name].ncattrs(), name
        assert file["mode"].dtype == np.int8
        assert file["mode"].filters()["complevel"] == 4
        assert file["radius"].filters()["shuffle"]
        assert all(variable.filters()["fletcher32"] for variable in file.variables.values() if variable.ndim)


def test_a_checksum_tells_a_cube_from_each_that_is_like_it():
    values = np.arange(4.0).reshape(2, 2)
    cube = xr.Dataset({"a": (("x", "y"), values), "b": ("x", [1.0, 2.0])}, {"x": [0.0, 1.0], "y": [0.0, 1.0]})
    others = {
        "dimensions": cube.assign(a=(("y", "x"), values)),
        "turned": cube.assign(a=(("x", "y"), values.T)),
        "an axis": cube.assign(b=("y", [1.0, 2.0])),
        "names": cube.rename(a="b", b="a"),
        "types": cube.assign(b=("x", np.array([1.0, 2.0]).view(np.int64))),
        "a coordinate": cube.assign_coords(y=[0.0, np.nextafter(1.0, 0.0)]),
        "one ulp up": cube.assign(b=("x", [1.0, np.nextafter(2.0, 3.0)])),
        "one ulp down": cube.assign(b=("x", [1.0, np.nextafter(2.0, 0.0)])),
    }
    sums = {name: checksum_of(each) for name, each in others.items()}
    assert len({*sums.values(), checksum_of(cube)}) == len(others) + 1
    pieces = Checksum(cube)
    for name in cube.variables:
        for each in np.array_split(cube[name].values.ravel(), 2):
            pieces.add(name, each)
    assert pieces.digest() == checksum_of(cube)


def test_a_table_of_a_cube_has_its_axes_in_their_units():
    grid = make_grid({"f": [15, 25], "beta0": np.deg2rad([3, 60]), "xdot0": [0.5, 2], "e": [0.2, 0.9]}, {})
    told = cube_table(build(grid, *blank(grid.size), {})).replace("\N{NO-BREAK SPACE}", " ")
    for span in ("from 15 Hz to 25 Hz", "from 3° to 60°", "from 0.5 m/s to 2 m/s", "from 0.2 to 0.9"):
        assert f"2 values {span}" in told
