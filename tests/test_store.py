"""Files are whole or absent, never replaced unasked, and only an intact cube of this program is opened."""

import os
import re
import subprocess
import sys
import tracemalloc
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.cube import blank, build, names
from dimersweep.cubes.grid import make_grid
from dimersweep.errors import StoreError, UserError
from dimersweep.storage.cubefiles import count_modes, open_cube, write_cube
from dimersweep.storage.files import HALF, replacing
from dimersweep.storage.outputs import check_output
from dimersweep.storage.provenance import attributes, digest
from dimersweep.studies.declared import from_cube
from dimersweep.studies.status import status


@pytest.fixture
def cube():
    grid = make_grid({"f": [15, 20]})
    return build(grid, *blank(2), attributes({"periods": 3}, "a title", 1.5))


def test_what_is_written_is_read(cube, tmp_path):
    write_cube(cube, tmp_path / "cube.nc")
    xr.testing.assert_identical(open_cube(tmp_path / "cube.nc"), cube)
    assert os.listdir(tmp_path) == ["cube.nc"]


def test_a_cube_is_written_without_the_cluster_that_ran_its_points(cube, tmp_path, monkeypatch):
    from distributed import Client

    monkeypatch.setattr("dask.distributed.Lock", lambda name: pytest.fail("the cluster was asked for a lock"))
    with Client(processes=False, n_workers=0, dashboard_address=None):
        write_cube(cube, tmp_path / "cube.nc")
    assert (tmp_path / "cube.nc").is_file()


@pytest.mark.jit
def test_threads_use_files_at_once(tmp_path):
    """NetCDF-C and HDF5 would end in a segmentation fault, in three of four such processes."""
    visitors = Path(__file__).parent / "checks" / "visitors.py"
    done = subprocess.run(
        [sys.executable, visitors], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.jit
@pytest.mark.parametrize("name", ["cube.nc", "cube.zarr"])
def test_a_thread_may_open_a_cube_while_another_loads_dask(name, tmp_path):
    """Of two threads that load dask at once, from different ends, both would get an ImportError."""
    dimersweep.sweep({"f": [15, 20]}, periods=1, progress=False, out=tmp_path / name)
    program = f"""
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import netCDF4
import zarr

import dimersweep

half_way, begun = Event(), Event()

class HalfWay:
    def find_spec(self, name, path=None, target=None):
        if name == "dask.config":
            half_way.set()
            begun.wait(0.5)  # in vain: the other thread waits for this one
        elif name in ("dask.base", "dask.array"):
            begun.set()

dimersweep.open_cube
sys.meta_path.insert(0, HalfWay())

def use():
    half_way.wait()
    return dimersweep.open_cube({name!r}).sizes["f"]

with ThreadPoolExecutor() as threads:
    other = threads.submit(use)
    try:
        dimersweep.sweep
        print(half_way.is_set())
    finally:
        half_way.set()
    print(other.result())
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout == "True\n2\n", done.stderr


def test_an_existing_file_stays_unless_forced(cube, tmp_path):
    path = tmp_path / "cube.nc"
    path.write_text("precious")
    with pytest.raises(StoreError, match=r"^out = .*cube.nc: exists already; .*force=True"):
        write_cube(cube, path)
    assert path.read_text() == "precious"
    write_cube(cube, path, force=True)
    assert open_cube(path).sizes == {"f": 2}


def test_a_temporary_file_has_a_name_that_nobody_else_has(tmp_path):
    (tmp_path / "page.html.tmp").write_text("precious")

    def write(k):
        with replacing(tmp_path / "page.html") as temporary:
            temporary.write_text(f"{k}" * 1000)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(write, range(100)))
    written = (tmp_path / "page.html").read_text()
    assert written in {f"{k}" * 1000 for k in range(100)}
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "page.html": written,
        "page.html.tmp": "precious",
    }


def test_two_who_write_one_file_do_not_meet(cube, tmp_path):
    with replacing(tmp_path / "run.nc") as first, replacing(tmp_path / "run.nc") as second:
        for temporary in (first, second):
            assert HALF.fullmatch(temporary.name)
            temporary.write_text(temporary.name)
        write_cube(cube, tmp_path / "cube.nc")
        assert first != second
    assert sorted(os.listdir(tmp_path)) == ["cube.nc", "run.nc"]
    assert (tmp_path / "run.nc").stat().st_mode == (tmp_path / "cube.nc").stat().st_mode


def test_a_write_that_fails_leaves_nothing_behind(cube, tmp_path, monkeypatch):
    def full_disk(self, store):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xr.Dataset, "dump_to_store", full_disk)
    with pytest.raises(StoreError, match=r"could not be written \(NetCDF: HDF error\)"):
        write_cube(cube, tmp_path / "cube.nc")
    assert os.listdir(tmp_path) == []


def test_a_cube_is_written_without_a_copy_of_it(tmp_path):
    """Peak memory of the writing, beside the cube itself: some copies of a variable."""
    grid = make_grid({"f": np.linspace(15, 25, 100), "beta0": np.linspace(0.1, 1, 300)})
    cube = build(grid, *blank(grid.size), attributes({"periods": 3}, "a title", 1.5))
    write_cube(cube, tmp_path / "first.nc")  # what is imported and kept counts once
    tracemalloc.start()
    try:
        write_cube(cube, tmp_path / "cube.nc")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 3 * 8 * grid.size < cube.nbytes / 8
    xr.testing.assert_identical(open_cube(tmp_path / "cube.nc"), cube)
    variables = list(xr.open_dataset(tmp_path / "cube.nc").data_vars)
    assert variables == list(cube.data_vars)


def link(path):
    (path.parent / "target").write_text("precious")
    path.symlink_to("target")


def files_in(folder):
    """What is there, but for when it was last looked at."""
    found = {path: os.lstat(path) for path in folder.rglob("*")}
    return {path: (each.st_ino, each.st_mode, each.st_size, each.st_ctime_ns) for path, each in found.items()}


def zarr_of_others(path):
    path.mkdir()
    (path / "notes.txt").write_text("precious")


@pytest.mark.parametrize(
    ("name", "made", "told"),
    [
        ("cube.nc", link, r"cube.nc: is a link to target; give the name of the file itself$"),
        ("cube.nc", lambda path: path.symlink_to("nothing"), r"cube.nc: is a link to nothing; give the name of"),
        ("cube.nc", os.mkfifo, r"cube.nc: is no regular file; give another name$"),
        ("cube.nc", lambda path: path.mkdir(), r"cube.nc: is a folder; give a file name$"),
        ("nowhere/cube.nc", lambda path: None, r"nowhere/cube.nc: the folder .*nowhere does not exist$"),
        (
            "cube.zarr",
            lambda path: path.write_text("precious"),
            r"cube.zarr: is a file, where a Zarr group is a folder",
        ),
        ("cube.zarr", zarr_of_others, r"cube.zarr: is a folder, but no Zarr group; give another name$"),
        ("a" * 300 + ".nc", lambda path: None, r"a.nc: cannot be a file \(File name too long\)$"),
        ("a\0.nc", lambda path: None, r"cannot be a file \(.*null.*\)$"),
        ("file/cube.nc", lambda path: path.parent.write_text(""), r"cube.nc: cannot be a file \(Not a directory\)$"),
    ],
)
def test_what_is_no_regular_file_is_never_replaced(cube, tmp_path, name, made, told):
    path = tmp_path / name
    made(path)
    before = files_in(tmp_path)
    for write in (partial(check_output, endings=None), partial(write_cube, cube)):
        with pytest.raises(StoreError, match=rf"^out = .*{told}"):
            write(path, force=True)
    assert files_in(tmp_path) == before


@pytest.mark.parametrize("path", ["/dev/full", "/dev/null", ".", "", ".."])
def test_devices_and_folders_are_never_replaced(cube, path):
    with pytest.raises(StoreError, match=r"^out = .*: is (no regular file|a folder); give"):
        write_cube(cube, path, force=True)


@pytest.mark.parametrize("name", ["a" * 300, "a\0", "."])
def test_names_that_no_file_can_have_are_told(name):
    for ask in (open_cube, lambda path: status(Path(path))):
        with pytest.raises(StoreError, match=r": (no such|is no cube|is a folder)"):
            ask(name)


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="needs a folder that refuses even root")
def test_a_folder_that_refuses_files_is_named():
    with pytest.raises(StoreError, match=r"out = /proc/cube.nc: the folder /proc is not writable"):
        check_output("/proc/cube.nc", endings=None)


def whole_bytes(cube, path):
    write_cube(cube, path)
    return path.read_bytes()


@pytest.mark.parametrize(("ask", "told"), [(open_cube, "no such file$"), (status, "no such cube, and no sweep for it")])
def test_a_cube_that_is_not_there_is_told(tmp_path, ask, told):
    with pytest.raises(StoreError, match=f"absent.nc: {told}"):
        ask(tmp_path / "absent.nc")


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda cube, path: path.write_text("hello"), "is no NetCDF file, or a damaged one"),
        (lambda cube, path: path.write_bytes(whole_bytes(cube, path)[:-4000]), "is no NetCDF file, or a damaged one"),
        (lambda cube, path: xr.Dataset({"a": 1}).to_netcdf(path), "is a NetCDF file, but no cube of dimersweep$"),
        (
            lambda cube, path: cube.assign_attrs(configuration='{"periods": 4}').to_netcdf(path),
            "is a cube of dimersweep that was changed or is incomplete; sweep it again$",
        ),
        (
            lambda cube, path: cube.assign(mode=cube["mode"].astype(float)).to_netcdf(path),
            r"mode: is of type float64, as where\(\) makes it, and codes",
        ),
        *(
            (
                lambda cube, path, version=version: cube.assign_attrs(dimersweep_cube=version).to_netcdf(path),
                f"is a cube of format {version}; this version of dimersweep reads",
            )
            for version in ("99", 99, "0.9")
        ),
    ],
)
def test_files_that_are_no_cubes_are_told_apart(cube, tmp_path, make, told):
    make(cube, tmp_path / "file.nc")
    for ask in (open_cube, status):
        with pytest.raises(StoreError, match=rf"file.nc: {told}"):
            ask(tmp_path / "file.nc")


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "3",
        "null",
        '{"grid": ' * 50_000,
        "[" * 100_000,
        '{"fixed": null}',
        '{"fixed": {"e": null}}',
        '{"grid": []}',
        '{"grid": {"f": 3}}',
        '{"grid": {"f": [[[]]]}}',
        '{"grid": {"e": [0.5]}}',
        "{",
    ],
    ids=lambda text: text[:24],
)
def test_a_forged_configuration_is_refused(cube, tmp_path, text):
    cube.assign_attrs(configuration=text, configuration_sha256=digest(text)).to_netcdf(tmp_path / "forged.nc")
    for ask in (open_cube, from_cube, status):
        with pytest.raises(StoreError, match=r"forged.nc: is a cube of dimersweep that was changed or is incomplete"):
            ask(tmp_path / "forged.nc")


@pytest.mark.parametrize("text", ["{}", '{"grid": {}}', '{"grid": {}, "fixed": {}, "periods": "x"}', '{"search": 3}'])
def test_a_configuration_that_lacks_what_is_needed_is_told(cube, tmp_path, text):
    cube.assign_attrs(configuration=text, configuration_sha256=digest(text)).to_netcdf(tmp_path / "forged.nc")
    with pytest.raises(UserError) as caught:
        from_cube(tmp_path / "forged.nc")
    assert str(caught.value).startswith(str(tmp_path / "forged.nc"))
    with pytest.raises(UserError, match=r"forged\.nc"):
        dimersweep.sweep({"f": [15]}, periods=3, extend=tmp_path / "forged.nc", progress=False)


def test_codes_of_no_word_are_refused(cube, tmp_path):
    cube["mode"].values[1] = 127
    write_cube(cube, tmp_path / "forged.nc")
    for ask in (open_cube, status):
        with pytest.raises(StoreError, match=r"^mode = 127: is the code of no mode; the cube was changed$"):
            ask(tmp_path / "forged.nc")
    with pytest.raises(StoreError, match=r"^mode = 127: is the code of no mode"):
        names(cube["mode"])


@pytest.mark.parametrize("points", [10**7, 10**10])
def test_a_small_file_that_declares_much_is_refused(cube, tmp_path, points):
    attrs = dict(cube.attrs)
    with netCDF4.Dataset(tmp_path / "bomb.nc", "w") as file:
        file.createDimension("f", points)
        for name, kind in (("mode", "i1"), ("radius", "f8"), ("f", "f8")):
            file.createVariable(name, kind, ("f",), zlib=True, chunksizes=(10**6,), fill_value=False)
        file.setncatts({name: value for name, value in attrs.items() if name != "title"})
    assert os.path.getsize(tmp_path / "bomb.nc") < 50_000
    for ask in (open_cube, status):
        with pytest.raises(StoreError, match=r"bomb.nc: declares \d+ bytes, which its \d+ cannot hold; it is damaged$"):
            ask(tmp_path / "bomb.nc")


@pytest.mark.parametrize("path", ["", "a\0b", "a\nb", "a\x1b[2Jb", "a\0b.nc", "a\nb/cube.nc", "a\x1b[2Jb/cube.nc"])
def test_a_name_that_a_terminal_would_not_show_is_told_as_python_writes_it(path):
    with pytest.raises(UserError) as caught:
        check_output(path)
    assert str(caught.value).startswith(f"out = {path!r}: ")
    assert str(caught.value).isprintable()


def packed(numbers, written):
    """Where the deflated bytes of an array, and of its checksum, lie in those of a file: start and stop."""
    for start in (found.start() for found in re.finditer(b"x", written)):
        stream = zlib.decompressobj()
        with suppress(zlib.error):
            if stream.decompress(written[start:])[:-4] == numbers.tobytes():
                return start, len(written) - len(stream.unused_data)
    raise AssertionError("it is not there")


def test_modes_that_are_damaged_are_told_by_all_that_read_them(tmp_path):
    grid = make_grid({"f": np.linspace(15, 20, 5000)})
    cube = build(grid, *blank(5000), attributes({"periods": 3}, "a title", 1.5))
    cube["mode"].values[:] = np.random.default_rng(0).integers(0, 5, 5000)
    write_cube(cube, tmp_path / "cube.nc")
    written = bytearray((tmp_path / "cube.nc").read_bytes())
    start, stop = packed(cube["mode"].values, bytes(written))
    written[(start + stop) // 2] ^= 1
    (tmp_path / "cube.nc").write_bytes(written)
    for read in (open_cube, count_modes, status):
        with pytest.raises(StoreError, match=r"cube.nc: is no NetCDF file, or a damaged one \(NetCDF: [^\n]*\)$"):
            read(tmp_path / "cube.nc")
