"""Small verbs on which much rests, tried in both directions, at both ends and in several units."""

import numpy as np
import pytest
import xarray as xr

from dimersweep.cubes.checksum import Checksum
from dimersweep.cubes.cube import blank, build
from dimersweep.cubes.grid import make_grid
from dimersweep.plots.tables import cube_table
from dimersweep.storage.checking import checksum_of
from dimersweep.studies.making import _places


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1.0, 1e6])
def test_a_point_is_taken_over_bit_for_bit_only(unit):
    old = unit * np.array([0.1, 0.2, 0.3, 0.7])
    assert _places(old, old[[3, 0, 2, 1]]).tolist() == [3, 0, 2, 1]
    for beside in (np.nextafter(old, -np.inf), np.nextafter(old, np.inf), old * (1 - 1e-13), old * (1 + 1e-13)):
        assert _places(old, beside).tolist() == [-1] * 4
    assert _places(old, unit * np.array([0.0, 0.15, 1.0])).tolist() == [-1] * 3


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
