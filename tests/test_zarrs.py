"""A cube above memory has the layout of one in memory, block by block, and is resumed, refused and read like it."""

import errno
import os
import re
import shutil
from math import prod
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import dimersweep
from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.blocks import blocks, chunk_shape
from dimersweep.studies.status import status, status_lines
from tests.fakes import fake_run_many
from tests.seams import no_work, set_chunks, use_kernel

pytest.importorskip("zarr")
SMALL = {"f": [15, 20, 25], "beta0": {"start": 1, "stop": 8, "step": 1, "unit": "deg"}}  # a chunk for each f
GRID = {"f": [15, 25], "A_r": [5, 6], "beta0": {"start": 1, "stop": 11, "step": 1, "unit": "deg"}}


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch, fake_kernel):
    monkeypatch.chdir(tmp_path)
    set_chunks(monkeypatch, 8)


def sweep(grid=SMALL, **settings):
    return dimersweep.sweep(grid, **({"periods": 5, "progress": False, "out": "cube.zarr"} | settings))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The path of a cube that is written once, for tests to copy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("written"))
        use_kernel(patch, fake_run_many)
        set_chunks(patch, 8)
        sweep()
        return Path("cube.zarr").resolve()


@pytest.fixture
def cube(written):
    """The cube that ``sweep()`` writes, at cube.zarr."""
    shutil.copytree(written, "cube.zarr")
    return dimersweep.open_cube("cube.zarr")


@given(st.lists(st.integers(0, 13), min_size=1, max_size=4).map(tuple))
def test_blocks_are_chunks_and_follow_each_other(shape):
    numbers = np.arange(prod(shape)).reshape(shape)
    chunks, reached = chunk_shape(shape), 0
    for tile, where in blocks(shape):
        assert tile.start == reached
        np.testing.assert_array_equal(numbers[where].ravel(), np.arange(*tile))
        assert all(part.start % chunk == 0 for part, chunk in zip(where, chunks, strict=True))
        reached = tile.stop
    assert reached == prod(shape)


def test_it_is_the_cube_in_memory():
    cube, reference = sweep(GRID), sweep(GRID, out=None)
    assert cube["radius"].chunks is not None
    assert cube["e"].chunks is None
    xr.testing.assert_equal(cube.load(), reference)
    for name, variable in reference.variables.items():
        assert cube[name].dtype == variable.dtype
        assert cube[name].dims == variable.dims
        assert {key: str(value) for key, value in cube[name].attrs.items()} == {
            key: str(value) for key, value in variable.attrs.items()
        }
    assert cube["mode"].attrs["flag_values"].dtype == np.int8
    assert set(cube.attrs) == set(reference.attrs)
    assert os.listdir() == ["cube.zarr"]
    xr.testing.assert_identical(dimersweep.open_cube("cube.zarr").load(), cube)


def damage(name):
    """Change a byte of the numbers of a variable."""
    numbers = next(file for file in Path("cube.zarr", name).rglob("*") if file.is_file() and file.name != "zarr.json")
    written = bytearray(numbers.read_bytes())
    written[-6] ^= 1  # before the four bytes of a checksum
    numbers.write_bytes(written)


@pytest.mark.parametrize("name", ["radius", pytest.param("mode", marks=pytest.mark.release), "beta0", "e"])
def test_a_changed_byte_is_found_wherever_it_is_read(name, cube):
    damage(name)
    told = {
        "beta0": r"is no Zarr group, or a damaged one \(.*(checksum|corruption).*\)",
        "e": "is a cube of dimersweep that was changed or is incomplete; sweep it again",  # one value has no checksum
    }.get(name, rf"is damaged: {name} cannot be read \(.*(checksum|corruption).*\); sweep it again \(force=True\)")
    with pytest.raises(StoreError, match=rf"^cube.zarr: {told}$"):
        dimersweep.open_cube("cube.zarr").load()
    with pytest.raises(
        StoreError, match=rf"^out = cube.zarr: exists already, and cannot be used \(cube.zarr: {told}\);"
    ):
        sweep()
    with pytest.raises(StoreError, match=rf"^cube.zarr: {told}$"):
        dimersweep.sweep(SMALL | {"f": [15, 30]}, periods=5, progress=False, extend="cube.zarr", out="wide.zarr")
    assert os.listdir() == ["cube.zarr"]
    if name == "beta0":  # cannot be opened at all
        sweep(force=True)


def test_a_status_of_damaged_modes_is_one_line(cube):
    damage("mode")
    with pytest.raises(StoreError, match=r"^cube.zarr: is damaged: mode cannot be read \(.*\); sweep it again"):
        status_lines(status(Path("cube.zarr")))


def test_a_chunk_that_is_missing_is_found(cube):
    whole, found = cube.load(), 0
    files = [path for path in Path("cube.zarr").rglob("*") if path.is_file() and path.name != "zarr.json"]
    assert len({path.relative_to("cube.zarr").parts[0] for path in files}) > 30
    for path in files[::40]:
        written = path.read_bytes()
        path.unlink()
        try:  # one of missing values, or zeros, alone takes nothing away
            xr.testing.assert_equal(dimersweep.open_cube("cube.zarr").load(), whole)
        except StoreError as error:
            assert re.match(r"cube.zarr: is damaged: \w+ lacks 1 of its chunks; sweep it again", str(error))
            found += 1
        path.write_bytes(written)
    assert found > 1
    dimersweep.open_cube("cube.zarr").load()


def test_the_whole_is_never_in_memory(monkeypatch):
    from dimersweep.storage.tilestore import TileStore

    read, lengths = TileStore.read, []

    def watched(self, start, stop):
        lengths.append(stop - start)
        return read(self, start, stop)

    monkeypatch.setattr(TileStore, "read", watched)
    monkeypatch.setattr("dimersweep.cubes.grid.MAX_POINTS", 20)
    with pytest.raises(ParameterError, match=r"^grid: 44 points; one cube in memory may hold 20 \(an output that ends"):
        sweep(GRID, out="cube.nc")
    sweep(GRID)
    assert sum(lengths) == 44 and max(lengths) <= 8


def test_a_finished_one_is_returned_and_another_one_refused(monkeypatch, cube):
    no_work(monkeypatch)
    xr.testing.assert_identical(sweep().load(), cube.load())
    with pytest.raises(StoreError, match=r"cube.zarr: exists already; .*What differs:\n  periods: 5 -> 6$"):
        sweep(periods=6)


def test_force_replaces_it_and_an_extension_reads_it(cube):
    assert sweep(periods=6, force=True)["n_periods"].values.max() == 6
    wider = dimersweep.sweep(SMALL | {"f": [15, 30]}, periods=6, progress=False, extend="cube.zarr", out="wide.zarr")
    xr.testing.assert_equal(wider.load(), dimersweep.sweep(SMALL | {"f": [15, 30]}, periods=6, progress=False))


NOT_THAT = r"^cube.zarr: is not the cube that was opened any more \(it was replaced, moved or deleted\); open it again$"


def test_a_cube_in_hand_is_that_of_its_file_or_says_so(cube):
    """Values are read when they are used, and never those of another file, nor missing ones in place of those that are gone."""
    former, names = cube, ["radius", "n_events", "mode"]
    held = former[names].compute()
    lazy = [each for name in names for each in (former[name], former[name].max())] + [former["mode"].isel(f=[0, 2])]
    uses = [each.compute for each in lazy]
    uses += [former.dimersweep.plot, former.dimersweep.__repr__, lambda: former.dimersweep.run(f=15, beta0="5 deg")]
    uses += [lambda: former.to_netcdf("copy.nc"), lambda: dimersweep.simulate(start=former.isel(f=0, beta0=0))]
    other = sweep(periods=6, force=True)
    for use in uses:
        with pytest.raises(StoreError, match=NOT_THAT):
            use()
    xr.testing.assert_equal(held, sweep(out=None)[names])
    assert former["e"].item() == other["e"].item()  # single values were read when it was opened
    os.rename("cube.zarr", "moved.zarr")
    for name in names:
        with pytest.raises(StoreError, match=NOT_THAT):
            other[name].compute()
    assert (dimersweep.open_cube("moved.zarr")["n_periods"] == 6).all()
    os.rename("moved.zarr", "cube.zarr")
    assert (other["n_periods"] == 6).all()


def test_a_chunk_that_goes_while_a_cube_is_in_hand_is_found(cube):
    shutil.rmtree("cube.zarr/radius/c/2")
    cube["radius"].isel(f=0).compute()
    for part in ({"f": 2}, {"f": [0, 2]}, {"f": slice(None, None, -2)}, {}):
        with pytest.raises(
            StoreError, match=r"^cube.zarr: is damaged: radius lacks some of its chunks; sweep it again"
        ):
            cube["radius"].isel(part).compute()


@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_a_copy_that_xarray_made_is_a_cube(cube):
    """xarray writes no chunks of missing values, or zeros, alone: the checksum of all values tells that none is lost."""
    cube.to_zarr("copy.zarr", consolidated=False)
    cube.load().to_zarr("loaded.zarr")  # the cube is in memory from now on
    for path in ("copy.zarr", "loaded.zarr"):
        assert len([*Path(path).rglob("*")]) < len([*Path("cube.zarr").rglob("*")])
        xr.testing.assert_equal(dimersweep.open_cube(path).load(), cube)
    assert status_lines(status(Path("copy.zarr")))[1:] == status_lines(status(Path("cube.zarr")))[1:]
    wider = sweep(SMALL | {"f": [15, 30]}, extend="copy.zarr", out=None)
    assert wider.isel(f=0, drop=True).equals(cube.isel(f=0, drop=True))
    sweep(out="copy.zarr")  # is complete already
    files = [path for path in Path("copy.zarr").rglob("*") if path.is_file() and path.name != "zarr.json"]
    for path in files[::80]:
        written = path.read_bytes()
        path.unlink()
        with pytest.raises(StoreError, match=r"^copy.zarr: is damaged: \w+ lacks \d+ of its chunks; sweep it again"):
            dimersweep.open_cube("copy.zarr")
        path.write_bytes(written)


def test_a_part_that_xarray_wrote_says_how_to_write_it(cube):
    part = cube.isel(beta0=slice(0, 4))
    part.to_zarr("part.zarr", consolidated=False)
    told = r"^part.zarr: is a part of a cube, of which \w+ lacks \d+ chunks: lost, or not written as they hold nothing; write"
    with pytest.raises(StoreError, match=told):
        dimersweep.open_cube("part.zarr")
    with zarr_config({"array.write_empty_chunks": True}):
        part.to_zarr("whole.zarr", consolidated=False)
    xr.testing.assert_equal(dimersweep.open_cube("whole.zarr").load(), part.load())


def zarr_config(given):
    import zarr

    return zarr.config.set(given)


def test_a_full_disk_keeps_the_points(monkeypatch):
    with monkeypatch.context() as patch:

        def full(self, *arguments, **more):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        patch.setattr(xr.Dataset, "to_zarr", full)
        told = "out = cube.zarr: could not be written (No space left on device); what was finished before is kept"
        with pytest.raises(StoreError, match=f"^{re.escape(told)}"):
            sweep()
    no_work(monkeypatch)
    sweep()
    assert os.listdir() == ["cube.zarr"]


def test_what_is_no_cube_is_refused():
    os.mkdir("empty.zarr")
    with pytest.raises(StoreError, match=r"^empty.zarr: is no Zarr group, or a damaged one"):
        dimersweep.open_cube("empty.zarr")
    xr.Dataset({"a": ("x", [1.0])}).to_zarr("other.zarr", consolidated=False)
    with pytest.raises(StoreError, match=r"^other.zarr: is a Zarr group, but no cube of dimersweep$"):
        dimersweep.open_cube("other.zarr")
    why = r"exists already, and cannot be used \(other.zarr: is a Zarr group, but no cube of dimersweep\)"
    with pytest.raises(StoreError, match=rf"^out = other.zarr: {why}; give another name, or force it"):
        sweep(out="other.zarr")


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "zarr", None)
    with pytest.raises(StoreError, match=r"^zarr: is not installed; pip install 'dimersweep\[zarr\]'$"):
        sweep()


def test_a_zarr_that_may_run_code_of_a_store_is_refused(monkeypatch, cube):
    monkeypatch.setattr("zarr.__version__", "3.0.10")
    for use in (lambda: dimersweep.open_cube("cube.zarr"), lambda: sweep(out="other.zarr")):
        with pytest.raises(StoreError, match=r"^zarr = 3.0.10: must be >= 3.1, as an older one may run code"):
            use()


def test_a_store_whose_filters_may_run_code_is_not_read(monkeypatch, cube):
    read = []
    monkeypatch.setattr("numcodecs.fletcher32.Fletcher32.decode", lambda *given: read.append(given))
    filters = {"filters": [zarr_filter("fletcher32")], "compressors": None}
    foreign = xr.Dataset({"mode": ("f", np.arange(3.0), {}, filters)}, attrs=cube.attrs)
    foreign.to_zarr("foreign.zarr", consolidated=False, zarr_format=2)
    with pytest.raises(StoreError, match=r"^foreign.zarr: is no Zarr group, or a damaged one"):
        dimersweep.open_cube("foreign.zarr").load()
    assert not read


def zarr_filter(name):
    import numcodecs

    return numcodecs.get_codec({"id": name})
