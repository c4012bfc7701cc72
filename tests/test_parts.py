"""The parts of a sweep, each made by itself, give the cube of one sweep; what does not go together is refused in a line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dimersweep
from dimersweep import merge, open_cube
from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.provenance import CHECKSUM
from dimersweep.storage.store import looked_at
from dimersweep.work.parts import TILES, SweepPart
from tests.own_observers import spectral
from tests.seams import another_version

pytestmark = pytest.mark.usefixtures("empty_folder")
GRID = {"f": [15, 20, 25], "beta0": {"start": 1, "stop": 80, "num": 16, "unit": "deg"}}
POINTS = {"Gamma": np.linspace(0.5, 1.2, 21), "beta0": np.linspace(0.1, 0.9, 21)}
DECLARED = """
[sweep]
periods = 20
output = "cube.nc"
[grid]
f = [15, 20, 25]
beta0 = {start = 1, stop = 80, num = 16, unit = "deg"}
"""


def sweep(grid=None, /, **how):
    """A small sweep."""
    return dimersweep.sweep(grid, **({"periods": 20, "progress": False} | how))


def make_parts(total, numbers=None, **how):
    """Make some parts of a small sweep; their files."""
    how = {"out": "cube.nc"} | how
    for number in numbers or range(1, total + 1):
        sweep(GRID, part=(number, total), **how)
    return [SweepPart(number, total).file(Path(how["out"])) for number in numbers or range(1, total + 1)]


@given(st.integers(1, 400), st.integers(1, 5), st.data())
def test_each_point_is_in_one_part(pieces, line, data):
    total = data.draw(st.integers(1, pieces))
    ranges = [SweepPart(number, total).ranges(pieces * line, line) for number in range(1, total + 1)]
    points = [point for each in ranges for tile in each for point in range(*tile)]
    assert sorted(points) == list(range(pieces * line))
    assert all(each == sorted(each) and 0 < len(each) <= TILES for each in ranges)
    assert all(start % line == stop % line == 0 for each in ranges for start, stop in each)


def test_parts_have_points_from_all_columns_of_a_grid():
    """Though the tiles of its rows are a multiple of the parts."""
    for number in range(1, 17):
        columns = [tile.start % 128 for tile in SweepPart(number, 16).ranges(128 * 128)]
        assert len(set(columns)) == 8


WAYS = {
    "a grid": (GRID, {}),
    "points": (None, {"points": POINTS}),
    "a state that is carried": ({"e": [0.5, 0.55, 0.6], "Gamma": [0.8, 0.9, 1.0]}, {"carry": "both"}),
    "all that can be asked": (
        GRID,
        {"certify": True, "strobes": 3, "max_periods": 40, "rtol": 1e-6, "observe": spectral},
    ),
}


@pytest.mark.jit
@pytest.mark.parametrize("way", WAYS)
def test_parts_in_any_order_give_the_cube_of_one_sweep(way):
    grid, how = WAYS[way]
    whole = sweep(grid, out="whole.nc", **how)
    for number in (numbers := [2, 3, 1]):
        part = sweep(grid, out="cube.nc", part=f"{number}/3", **how)
        assert 0 < (part["mode"] > 0).sum() < part["mode"].size
    merged = merge([f"cube.part-{number}-of-3.nc" for number in numbers], "cube.nc")
    assert merged.attrs[CHECKSUM] == whole.attrs[CHECKSUM]
    assert merged.attrs["configuration_sha256"] == whole.attrs["configuration_sha256"]
    assert open_cube("cube.nc").equals(open_cube("whole.nc"))
    assert sweep(grid, out="cube.nc", **how).identical(open_cube("cube.nc")), "it is complete"


@pytest.mark.jit
def test_parts_that_are_missing_are_made_if_that_is_asked(monkeypatch):
    whole = sweep(GRID)
    files = make_parts(4, [1, 3])
    with monkeypatch.context() as patch:  # part 2 is stopped
        patch.setattr("dimersweep.studies.making._close", lambda *_: pytest.fail("stopped"))
        with pytest.raises(pytest.fail.Exception):
            sweep(GRID, out="cube.nc", part="2/4")
    with looked_at(Path("cube.part-2-of-4.nc.tiles")) as store:
        assert sum(row.stop - row.start for row in store.summaries()) == 12
    with pytest.raises(StoreError, match=r"^cube.part-1-of-4.nc: these parts are missing: 2/4 \(begun\), 4/4; "):
        merge(files, "cube.nc")
    assert not Path("cube.nc").exists()
    assert merge(files, "cube.nc", finish=True, progress=False).attrs[CHECKSUM] == whole.attrs[CHECKSUM]
    assert not Path("cube.part-2-of-4.nc.tiles").exists()


@pytest.mark.jit
def test_a_part_is_a_cube_that_others_extend():
    whole = sweep(GRID)
    make_parts(2, [1])
    assert sweep(GRID, extend="cube.part-1-of-2.nc").attrs[CHECKSUM] == whole.attrs[CHECKSUM]


@pytest.mark.jit
def test_the_commands_make_parts_and_merge_them(done):
    Path("small.toml").write_text(DECLARED)
    for number in 2, 1:
        assert f"cube: cube.part-{number}-of-2.nc" in done("run", "small.toml", "--part", f"{number}/2")
    assert "cube: both.nc" in done("merge", "cube.part-2-of-2.nc", "cube.part-1-of-2.nc", "--out", "both.nc")
    assert open_cube("both.nc").attrs[CHECKSUM] == sweep(GRID).attrs[CHECKSUM]
    assert not Path("cube.part-1-of-2.png").exists() and Path("both.png").exists()


def refused(error, told, call):
    with pytest.raises(error) as found:
        call()
    assert str(found.value) == told


@pytest.mark.parametrize("part", ["0/4", "5/4", "3", "a/b", "1/0", "-1/4", "1/2/3", (1,), 3, "1/10001", "1.0/4"])
def test_what_is_no_part_is_refused(part):
    told = f"part = {part!r}: must be k/n with 1 <= k <= n <= 10000, such as 3/20"
    refused(ParameterError, told, lambda: sweep(GRID, part=part))


def test_what_cannot_be_cut_is_refused():
    told = "part = 1/49: this sweep has 48 points, and so at most 48 parts"
    refused(ParameterError, told, lambda: sweep(GRID, part=(1, 49)))
    told = "part = 1/4: this sweep has 3 lines, and so at most 3 parts"
    refused(ParameterError, told, lambda: sweep({"e": [0.5, 0.6, 0.7], "f": [15, 20]}, carry="up", part=(1, 4)))
    told = "part = 1/2: is for sweeps; the points of a search and of a map lead one another"
    refused(ParameterError, told, lambda: dimersweep.search(GRID, over="beta0", periods=5, part="1/2"))
    told = "out = cube.zarr: the cube of a part must end in .nc"
    refused(ParameterError, told, lambda: sweep(GRID, out="cube.zarr", part="1/2"))


@pytest.mark.jit
def test_what_does_not_go_together_is_refused_in_a_line(fake_kernel, monkeypatch):
    one, two = make_parts(2)
    sweep(GRID, out="whole.nc")
    (other,) = make_parts(3, [2], out="thirds.nc")
    make_parts(2, [2], out="longer.nc", periods=21)
    with monkeypatch.context() as patch:
        another_version(patch)
        make_parts(2, [2], out="former.nc")
    sweep(GRID | {"f": [15, 20, 26]}, out="beside.nc", part="2/2")
    different = f"{one} and {{}}: are parts of different sweeps ({{}})"
    for told, files in {
        "merge: no part was given": [],
        "whole.nc: is no part of a sweep, but a whole cube": [one, "whole.nc"],
        f"{one}: these parts are missing: 2/2; make them, or have them made here (finish=True)": [one],
        f"{one} and {one}: are the same part, 1/2": [one, two, one],
        f"{one} and {other}: are parts of 2 and of 3": [one, other],
        different.format("longer.part-2-of-2.nc", "periods: 20 -> 21"): [one, "longer.part-2-of-2.nc"],
        different.format(
            "former.part-2-of-2.nc", "kernel_version: the sources of dimersweep are those of another version"
        ): [
            one,
            "former.part-2-of-2.nc",
        ],
        different.format("beside.part-2-of-2.nc", "grid.f: [15.0, 20.0, 25.0] -> [15.0, 20.0, 26.0]"): [
            one,
            "beside.part-2-of-2.nc",
        ],
        "absent.nc: no such file": [one, "absent.nc"],
    }.items():
        refused(StoreError, told, lambda files=files: merge(files, "cube.nc"))
        assert not Path("cube.nc").exists()
    told = "out = whole.nc: exists already; give another name, or force it to be replaced (force=True)"
    refused(StoreError, told, lambda: merge([one, two], "whole.nc"))
    told = f"out = {one}: would replace what is read; give another name"
    refused(ParameterError, told, lambda: merge([one, two], one, force=True))
    refused(ParameterError, "out = cube.zarr: a cube must end in .nc", lambda: merge([one, two], "cube.zarr"))
    two.write_bytes(two.read_bytes()[:3000])
    with pytest.raises(StoreError, match=rf"^{two}: "):
        merge([one, two], "cube.nc")
