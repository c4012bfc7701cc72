"""Every declared dataset is allowed, and its small preset gives a cube that others can read, and its figure."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from dimersweep import make
from dimersweep.cubes.cube import FLAGS
from dimersweep.cubes.findings import circle_through
from dimersweep.errors import ParameterError
from dimersweep.storage.cubefiles import open_cube
from dimersweep.studies.declared import from_cube, read_declaration
from tests.checks.conform import conforms

SWEEPS = Path(__file__).parents[1] / "sweeps"
SMALL = sorted(path.stem for path in SWEEPS.glob("*-small.toml"))
# of each kind of cube one: a sweep, one with a state for each period, both ways, a search with paths, a map, points
OF_EACH_KIND = ("fig07-small", "bifurcation-small", "hysteresis-small", "fig13-small", "fig08-small", "friction-small")
SEARCHED = [name for name in SMALL if read_declaration(SWEEPS / f"{name}.toml").search is not None]


@pytest.mark.parametrize("path", sorted(SWEEPS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_declaration_is_allowed_and_has_a_small_preset(path):
    declared = read_declaration(path)
    assert declared.sweep.output == f"{path.stem}.nc"
    small = read_declaration(path.with_name(path.stem.removesuffix("-small") + "-small.toml"))
    assert small.plot.kind == declared.plot.kind
    over, small_over = (each.grid or each.points.columns for each in (declared, small))
    assert list(small_over) == list(over)


@pytest.mark.jit
@pytest.mark.parametrize(
    ("name", "engine"),
    [
        *((name, "netcdf4") for name in SMALL),
        *((name, "h5netcdf") for name in OF_EACH_KIND),
        *(pytest.param(name, "h5netcdf", marks=pytest.mark.release) for name in SMALL if name not in OF_EACH_KIND),
    ],
)
def test_a_small_preset_gives_a_cube_that_others_read(name, engine, small_cubes):
    path = small_cubes / f"{name}.nc"
    cube = open_cube(path)
    with xr.open_dataset(path, engine=engine) as back:
        flags = {name for name in FLAGS if name in back.variables}
        assert ({"mode", "answer", "region", "outcome"} if name in SEARCHED else {"mode"}) <= flags
        assert all(back[name].dtype == np.int8 for name in flags)
        assert all(np.array_equal(back[name], cube[name]) for name in flags)
    picture = Image.open(small_cubes / f"{name}.png")  # which the command has drawn
    assert min(picture.size) > 200 and np.ptp(np.asarray(picture.convert("L"))) > 200


@pytest.mark.jit
@pytest.mark.parametrize(
    "name", [name if name in OF_EACH_KIND else pytest.param(name, marks=pytest.mark.release) for name in SMALL]
)
def test_the_cube_of_a_small_preset_follows_the_conventions(name, small_cubes, tmp_path):
    path = tmp_path / f"{name}.nc"
    shutil.copyfile(small_cubes / path.name, path)
    conforms(path)


@pytest.mark.jit
@pytest.mark.parametrize("name", ["fig13-small", "fig08-small"])
def test_a_cube_carries_what_makes_it_again(name, tmp_path):
    declared = read_declaration(SWEEPS / f"{name}.toml")
    if declared.refine:
        declared.sweep.periods, declared.sweep.max_periods = 30, 60
        declared.grid["beta0"] = {"start": 10, "stop": 80, "num": 3, "unit": "deg"}
    cube = make(declared, tmp_path / "first.nc", progress=False)
    again = make(from_cube(tmp_path / "first.nc"), tmp_path / "again.nc", progress=False, workers=1)
    assert again.attrs["configuration_sha256"] == cube.attrs["configuration_sha256"]
    for variable in cube.variables:
        assert again[variable].values.tobytes() == cube[variable].values.tobytes(), variable
    xr.testing.assert_identical(open_cube(tmp_path / "again.nc"), again)


@pytest.mark.jit
def test_paths_are_those_of_the_orbits(small_cubes):
    cube = open_cube(small_cubes / "fig13-small.nc")
    for place in range(cube.sizes["xdot0"]):
        x, y = (cube[name].values[place] for name in ("x", "y"))
        radius = circle_through(x[200:], y[200:])[2]
        assert radius == pytest.approx(cube["radius"].values[place], rel=0.01)
    speed = np.hypot(x[-1] - x[-17], y[-1] - y[-17]) * 15
    assert abs(cube["axial_velocity"].values[-1]) < 0.1 * speed  # the orbit is run across the axis
    assert cube["cycle"].values[-1] * 16 + 1 == x.size


def test_paths_too_long_to_hold_are_refused(tmp_path):
    text = (SWEEPS / "fig13-small.toml").read_text()
    path = tmp_path / "long.toml"
    path.write_text(text.replace("per_period = 16", "per_period = 100000"))
    with pytest.raises(
        ParameterError, match=r"paths: 3 of 10000001 positions each; one cube may hold 20000000 positions$"
    ):
        read_declaration(path)
