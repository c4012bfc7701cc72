"""What is on disk is used only if every check holds; what is not is told in one line and computed again."""

import errno
import hashlib
import json
import os
import re
import shutil
import subprocess
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.results import Tile
from dimersweep.errors import StoreError
from dimersweep.storage.locking import locked
from dimersweep.storage.manifest import as_line, read_manifest
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.studies.status import status
from dimersweep.studies.sweep_spec import make_spec
from dimersweep.work.tiles import attempt
from tests.fakes import fake_run_many, set_pace

GRID = {"f": [15, 20, 25], "beta0": {"start": 1, "stop": 40, "step": 1, "unit": "deg"}}
SPEC = make_spec(GRID, periods=5)
HALF_WRITTEN = f".dimersweep-{'0' * 32}.tmp"


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch, fake_kernel):
    monkeypatch.chdir(tmp_path)


def sweep(**settings):
    return dimersweep.sweep(GRID, **({"periods": 5, "progress": False, "out": "cube.nc"} | settings))


def left_behind(*tiles):
    """The files of a sweep that was killed after `tiles`, each in a file of its own; their names."""
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        for tile in tiles:
            store.add(attempt(SPEC, (Tile(*tile),)).finished[0])
            store.flush()
        return [Path("cube.nc.tiles", entry.file) for entry in store.manifest.entries]


@pytest.fixture
def counted(monkeypatch):
    """Numbers of points that the kernel was asked for, each call one item."""
    asked = []

    def run_many(rows, *rest, until=0, space=None):
        asked.append(len(rows))
        return fake_run_many(rows, *rest)

    monkeypatch.setattr("dimersweep.runs.settings.run_many", run_many)
    set_pace(monkeypatch, 10)
    monkeypatch.setattr("dimersweep.work.computing.warm_up", lambda stop: None)
    return asked


def test_finished_tiles_are_not_run_again(counted):
    reference = sweep(out=None)
    left_behind((0, 30), (50, 60))
    counted.clear()
    xr.testing.assert_equal(sweep(), reference)
    assert sum(counted) == 120 - 40
    assert os.listdir() == ["cube.nc"]


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def flip(path):
    written = bytearray(path.read_bytes())
    written[-1] ^= 1
    path.write_bytes(written)


MANIFEST = Path("cube.nc.tiles/manifest.jsonl")


def listed():
    """What the lines of the manifest tell, without their checksums."""
    told = [json.loads(line) for line in MANIFEST.read_text().splitlines()]
    return [{name: value for name, value in line.items() if name != "check"} for line in told]


def list_anew(lines):
    """Write the manifest with true checksums."""
    MANIFEST.write_bytes(b"".join(map(as_line, lines)))


def forge(path, **changes):
    """Change a file and its entry, so that size and sha256 are true of the new bytes."""
    from hashlib import sha256

    points = np.load(path)
    for name, value in changes.items():
        points[name] = value
    np.save(path, points)
    told = listed()
    for line in told[1:]:
        if line["file"] == path.name:
            line["sha256"] = sha256(path.read_bytes()).hexdigest()
    list_anew(told)


def edit_head(**changes):
    head, *rest = listed()
    list_anew([head | changes, *rest])


def never_run(path):
    forge(path, out=np.nan, codes=0)


def torn_line(path):
    manifest = Path("cube.nc.tiles/manifest.jsonl")
    manifest.write_bytes(manifest.read_bytes()[:-30])


def garbled_line(path):
    manifest = Path("cube.nc.tiles/manifest.jsonl")
    manifest.write_text(manifest.read_text().replace('"file": "tiles-000002', '"file" "tiles-000002'))


def other_configuration(path):
    head, first, second = listed()
    list_anew([head, first, second | {"configuration_sha256": "0" * 64}])


def mode_of_no_name(path):
    points = np.load(path)
    points["codes"][3, 1] = 127
    np.save(path, points)
    told = listed()
    told[-1] |= {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    list_anew(told)


def other_digit(path):
    text = MANIFEST.read_text()
    at = text.index('"wall": ', text.index(path.name)) + len('"wall": ')
    MANIFEST.write_text(text[:at] + str((int(text[at]) + 1) % 10) + text[at + 1 :])


def other_modes(path):
    head, first, second = listed()
    list_anew([head, first, second | {"modes": {"rest": 9}}])


UNLISTED = (
    "cube.nc.tiles: files of points that the manifest does not list, as a kill may leave them: {}; "
    "they are deleted, and their points computed again"
)
LINE = "lines of the manifest that are cut or damaged: 1"


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (cut, r"tiles-000002.npy has \d+ bytes in place of \d+"),
        (flip, "tiles-000002.npy has other bytes than were written"),
        (Path.unlink, r"tiles-000002.npy cannot be read \(No such file or directory\)"),
        (never_run, "tiles-000002.npy has points that were not run"),
        (torn_line, LINE),
        (garbled_line, LINE),
        (mode_of_no_name, "tiles-000002.npy has other modes than were listed"),
        (other_digit, LINE),
        (other_modes, LINE),
        (other_configuration, LINE),
    ],
)
def test_damaged_results_are_told_and_computed_again(counted, damage, told):
    reference = sweep(out=None)
    names = left_behind((0, 30), (50, 60))
    damage(names[1])
    counted.clear()
    with pytest.warns(RuntimeWarning) as warned:
        cube = sweep()
    first, *rest = (str(warning.message) for warning in warned)
    assert re.fullmatch(rf"cube.nc.tiles: damaged results are computed again \({told}\)", first)
    assert rest == ([UNLISTED.format(1)] if told == LINE else [])
    assert sum(counted) == 120 - 30
    xr.testing.assert_equal(cube, reference)
    assert os.listdir() == ["cube.nc"]


def test_temporary_files_of_a_kill_are_no_trouble(counted, recwarn):
    left_behind((0, 30))
    Path("cube.nc.tiles", HALF_WRITTEN).write_bytes(b"half a fi")
    Path("cube.nc.tiles/cube.tmp").mkdir()  # of a Zarr group
    Path("cube.nc.tiles/cube.tmp/zarr.json").write_text("{")
    sweep(periods=6, force=True)
    assert not recwarn.list
    assert os.listdir() == ["cube.nc"]


def test_files_of_the_users_in_the_folder_stay_and_are_not_taken_for_results():
    for path in left_behind((0, 30)):
        path.unlink()
    MANIFEST.unlink()
    mine = [Path("cube.nc.tiles", name) for name in ("tiles-x.npy", "tiles-0003.npy.bak", "notes.tmp", "tiles-w12.npy")]
    for path in mine:
        path.write_text("precious")
    for again in ({}, {"force": True}, {"force": True, "periods": 6}):
        sweep(**again)
        Path("cube.nc").unlink()
        left_behind((0, 30))
    assert {path.read_text() for path in mine} == {"precious"}


def test_the_status_of_a_manifest_that_cannot_be_read_is_one_line():
    left_behind((0, 30))
    MANIFEST.unlink()
    MANIFEST.mkdir()
    with pytest.raises(StoreError, match=r"^cube.nc.tiles/manifest.jsonl: cannot be read \(Is a directory\)$"):
        status(Path("cube.nc"))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda path: path.write_text("hello\n"), r"manifest.jsonl: is damaged, or no manifest of this .*force=True"),
        (lambda path: path.write_text(path.read_text()[:200]), "manifest.jsonl: is damaged, or no manifest"),
        (lambda path: path.write_text(path.read_text().replace("15.0", "15.5", 1)), "manifest.jsonl: is damaged, or"),
        (lambda path: edit_head(dimersweep_manifest=2), "manifest.jsonl: has the format of another version"),
        (lambda path: edit_head(points=30), r"jsonl: is damaged \(tells of 30 points, where its grid has 120\); begin"),
        (lambda path: edit_head(points=10**15), r"is damaged \(tells of 1000000000000000 points, where its grid has"),
        (lambda path: edit_head(points="120"), "manifest.jsonl: is damaged, or no manifest of this version"),
        (
            lambda path: path.write_text(path.read_text().replace('"points": 120', '"points": 20')),
            "manifest.jsonl: is damaged, or no manifest",
        ),
        (Path.unlink, "cube.nc.tiles: holds results, but no manifest of them; begin anew"),
    ],
)
def test_a_manifest_that_does_not_match_is_refused_and_nothing_is_touched(spoil, message):
    left_behind((0, 30))
    spoil(Path("cube.nc.tiles/manifest.jsonl"))
    before = {path.name: path.read_bytes() for path in Path("cube.nc.tiles").glob("[!l]*")}
    with pytest.raises(StoreError, match=message):
        sweep()
    assert {path.name: path.read_bytes() for path in Path("cube.nc.tiles").glob("[!l]*")} == before
    sweep(force=True)
    assert os.listdir() == ["cube.nc"]


def test_points_listed_twice_are_refused():
    left_behind((0, 30))
    head, told = listed()
    shutil.copy("cube.nc.tiles/tiles-000001.npy", "cube.nc.tiles/tiles-000002.npy")
    list_anew([head, told, told | {"file": "tiles-000002.npy"}])
    with pytest.raises(StoreError, match="its manifest lists points twice; begin anew"):
        sweep()


def test_another_kernel_is_refused(monkeypatch):
    left_behind((0, 30))
    ours = SPEC.configuration()["kernel_version"]
    monkeypatch.setattr("dimersweep.studies.sweep_spec.kernel_version", lambda: "0123456789abcdef")
    with pytest.raises(StoreError, match=f'What differs:\n  kernel_version: "{ours}" -> "0123456789abcdef"$'):
        sweep()


def test_force_keeps_what_fits_and_clears_what_does_not(counted):
    left_behind((0, 30))
    counted.clear()
    sweep(force=True)
    assert sum(counted) == 120 - 30
    Path("cube.nc").unlink()
    left_behind((0, 30))
    counted.clear()
    sweep(force=True, periods=6)
    assert sum(counted) == 120


def test_status_reads_a_manifest_line_by_line():
    left_behind((0, 30), (30, 60))
    head, first, *_ = listed()
    list_anew([head, *(first | {"file": f"tiles-{k:06d}.npy", "tiles": [[k % 90, k % 90 + 30]]} for k in range(3000))])
    tracemalloc.start()
    try:
        lines = status(Path("cube.nc"))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert lines[0].startswith("cube.nc: 90000 of 120 points done")
    assert peak < 300_000  # 7 MB as a whole


def test_status_tells_of_a_clock_that_was_set_back():
    left_behind((0, 30))
    head, first = listed()
    list_anew([head, first | {"time": "2999-01-01T00:00:00+00:00"}])
    assert status(Path("cube.nc"))[2] == "last tile: 2999-01-01T00:00:00+00:00, by a clock that has been set back since"


def test_nothing_is_said_to_be_kept_where_nothing_is(monkeypatch):
    monkeypatch.setattr(TileStore, "_write", full_disk)
    with pytest.raises(StoreError, match=r"\(No space left on device\); nothing was finished before$"):
        sweep()
    assert os.listdir() == []


def test_foreign_files_in_the_folder_stay():
    left_behind((0, 30))
    Path("cube.nc.tiles/notes.txt").write_text("precious")
    sweep()
    assert os.listdir("cube.nc.tiles") == ["notes.txt"]


def test_tiles_are_kept_when_asked():
    sweep(keep_tiles=True)
    assert sorted(os.listdir()) == ["cube.nc", "cube.nc.tiles"]
    assert status(Path("cube.nc"))[-1] == "cube: is written"
    assert status(Path("cube.nc.tiles"))[0] == "cube.nc: 120 of 120 points done (100 %)"


@pytest.fixture
def shelf(monkeypatch):
    """An open store, a shelf of it, and finished tiles to put there."""
    monkeypatch.setattr("dimersweep.storage.shelf.LEAST_BYTES", 500)
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        yield store, store.open_shelf(), attempt(SPEC, (Tile(0, 10), Tile(30, 60))).finished


def test_a_file_that_a_worker_has_written_is_as_one_of_the_driver(shelf):
    store, place, pieces = shelf
    store.enlist(place.keep(pieces))
    store.add(attempt(SPEC, (Tile(60, 70),)).finished[0])
    assert store.manifest.entries == []  # the manifest is written now and then
    store.flush()
    assert [entry.tiles for entry in store.manifest.entries] == [[(0, 10), (30, 60)], [(60, 70)]]
    assert [entry.wall > 0 for entry in store.manifest.entries] == [False, True]
    again = TileStore(store.out, read_manifest(MANIFEST), store.kind)
    assert again.check() == [] and again.gaps() == [Tile(10, 30), Tile(70, 120)]
    for piece in pieces:
        assert again.read(*piece.tile).tobytes() == piece.results.tobytes()
    store.beside.remove()
    assert os.listdir() == []


def test_nothing_is_put_where_the_token_is_not(shelf):
    store, place, pieces = shelf
    assert place.keep([pieces[0].part(Tile(0, 1))]) is None  # too small
    assert store.open_shelf().is_here() and not place.is_here()  # another run
    assert place.keep(pieces) is None
    store.beside.clear()
    assert place.keep(pieces) is None
    assert place._replace(folder="/nonexistent").keep(pieces) is None
    assert not list(store.folder.glob("tiles-*"))


def test_a_resumed_sweep_shuts_out_workers_of_the_one_that_was_killed(shelf):
    store, place, _ = shelf
    assert place.is_here()
    shutil.copytree(store.folder, "killed.nc.tiles")
    killed = place._replace(folder=str(Path("killed.nc.tiles").absolute()))
    assert killed.is_here()
    with tile_store(Path("killed.nc"), SPEC.configuration(), SPEC.grid.size):
        assert not killed.is_here()


def test_results_travel_where_a_worker_cannot_write(shelf, monkeypatch):
    store, place, pieces = shelf

    monkeypatch.setattr("dimersweep.storage.files.sync", lambda path: full_disk())
    assert place.keep(pieces) is None
    assert sorted(path.name for path in store.folder.iterdir()) == ["lock", "manifest.jsonl", "token"]


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (Path.unlink, r"cannot be read, though a worker has written it \(No such file"),
        (cut, r"has \d+ bytes in place of \d+; run the same again$"),
    ],
)
def test_a_file_of_a_worker_that_is_not_as_it_says_stops_the_sweep(shelf, damage, told):
    store, place, pieces = shelf
    entry = place.keep(pieces)
    damage(store.folder / entry.file)
    with pytest.raises(StoreError, match=rf"^cube.nc.tiles/tiles-w\w+.npy: {told}"):
        store.enlist(entry)


@pytest.mark.parametrize("name", ["tiles-w{:016x}.npy", "tiles-{:06d}.npy"])
def test_files_that_a_kill_left_unlisted_are_not_called_damaged(counted, name):
    reference = sweep(out=None)
    left_behind((0, 30))
    for k in range(2, 5):
        shutil.copy("cube.nc.tiles/tiles-000001.npy", Path("cube.nc.tiles", name.format(k)))
    counted.clear()
    with pytest.warns(RuntimeWarning) as warned:
        cube = sweep()
    assert [str(warning.message) for warning in warned] == [UNLISTED.format(3)]
    assert sum(counted) == 120 - 30
    xr.testing.assert_equal(cube, reference)
    assert os.listdir() == ["cube.nc"]


def test_only_some_of_many_damaged_files_are_told_by_name():
    for path in left_behind(*((k, k + 10) for k in range(0, 90, 10))):
        path.unlink()
    told = r"(tiles-\d+.npy cannot be read \(No such file or directory\); ){5}and 4 more\)$"
    with pytest.warns(RuntimeWarning, match=rf"^cube.nc.tiles: damaged results are computed again \({told}"):
        sweep()
    assert os.listdir() == ["cube.nc"]


@pytest.mark.parametrize("target", ["elsewhere", "nowhere", "file"])
def test_a_folder_of_tiles_that_is_a_link_is_refused_before_any_work(monkeypatch, target):
    Path("elsewhere").mkdir()
    Path("file").write_text("precious")
    Path("cube.nc.tiles").symlink_to(target)
    monkeypatch.setattr("dimersweep.runs.settings.run_many", lambda *rest, **more: pytest.fail("work was done"))
    with pytest.raises(StoreError, match=r"^cube.nc.tiles: is no folder, where what is finished is kept; move it, or"):
        sweep(force=True)
    assert os.listdir("elsewhere") == []
    assert sorted(os.listdir()) == ["cube.nc.tiles", "elsewhere", "file"]


@pytest.mark.parametrize("name", ["lock", "manifest.jsonl", HALF_WRITTEN, "cube.tmp"])
def test_links_among_the_tiles_never_lead_to_another_file(name):
    left_behind((0, 30))
    Path("precious").write_bytes(MANIFEST.read_bytes())
    Path("cube.nc.tiles", name).unlink(missing_ok=True)
    Path("cube.nc.tiles", name).symlink_to(Path("precious").absolute())
    before = Path("precious").read_bytes()
    try:
        sweep()
    except StoreError as error:
        assert "\n" not in str(error)
    assert Path("precious").read_bytes() == before


def test_a_lock_frees_itself_and_is_not_shared():
    told = rf"^folder: a sweep is at work here \(process {os.getpid()} on "
    with locked(Path("folder/lock")):
        with pytest.raises(StoreError, match=told), locked(Path("folder/lock")):
            pass
        Path("folder/lock").unlink()  # as the holder does at its end
    with locked(Path("folder/lock")):
        pass


def test_a_disk_without_locks_is_used_with_a_warning(monkeypatch):
    def no_locks(handle, how):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("dimersweep.storage.locking.fcntl.flock", no_locks)
    with pytest.warns(RuntimeWarning, match="^this file system has no locks; take care that no other sweep"):
        sweep()
    assert os.listdir() == ["cube.nc"]


def full_disk(*arguments, **more):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_keeps_what_was_finished_before(counted, monkeypatch):
    writes = []
    write = TileStore._write

    def fills_up(self, pieces, wall):
        writes.append(pieces)
        return write(self, pieces, wall) if len(writes) < 3 else full_disk()

    with monkeypatch.context() as patch:
        patch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
        patch.setattr("dimersweep.storage.tilestore.DISK_SHARE", 1e9)
        patch.setattr(TileStore, "_write", fills_up)
        with pytest.raises(StoreError) as error:
            sweep(workers=1)
    assert str(error.value) == (
        "cube.nc.tiles: finished tiles: could not be written (No space left on device); "
        "what was finished before is kept in cube.nc.tiles; mend that and run the same again"
    )
    kept = sum(len(finished.codes) for pieces in writes[:2] for finished in pieces)
    assert kept > 0
    counted.clear()
    sweep()
    assert sum(counted) == 120 - kept


@pytest.fixture
def disk(tmp_path):
    """A small disk of its own, and a function that mounts it with other options."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("needs the right to mount")
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24k", "tmpfs", str(place)], check=False).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        yield place, lambda options: subprocess.run(["mount", "-o", f"remount,{options}", str(place)], check=True)
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_is_really_full(disk, monkeypatch):
    place, remount = disk
    reference = sweep(out=None)
    with monkeypatch.context() as patch:
        patch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
        patch.setattr("dimersweep.storage.tilestore.DISK_SHARE", 1e9)
        set_pace(patch, 10)
        with pytest.raises(StoreError, match=r"\(No space left on device\); what was finished before is kept in "):
            sweep(out=place / "cube.nc", workers=1)
    assert os.listdir(place) == ["cube.nc.tiles"]
    remount("size=10m")
    xr.testing.assert_equal(sweep(out=place / "cube.nc"), reference)
    assert os.listdir(place) == ["cube.nc"]


def test_a_disk_that_is_read_only(disk):
    place, remount = disk
    remount("ro")
    with pytest.raises(StoreError, match=rf"cube.nc: the folder {place} is not writable \(Read-only file system\)"):
        sweep(out=place / "cube.nc")


def test_a_slow_disk_is_asked_less_often(monkeypatch):
    whole, write, written = attempt(SPEC, (Tile(0, 120),)).finished[0], TileStore._write, []
    clock = [0.0]
    monkeypatch.setattr("dimersweep.storage.tilestore.perf_counter", lambda: clock[0])

    def slow(self, pieces, wall):
        clock[0] += 0.02
        written.append(len(pieces))
        return write(self, pieces, wall)

    monkeypatch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
    monkeypatch.setattr(TileStore, "_write", slow)
    with tile_store(Path("cube.nc"), SPEC.configuration(), 120) as store:
        for point in range(120):
            clock[0] += 0.01
            store.add(whole.part(Tile(point, point + 1)))
        store.flush()
        assert store.gaps() == []
    assert sum(written) == 120 and len(written) < 6


def test_a_cube_that_cannot_be_written_costs_no_points(counted, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(xr.Dataset, "dump_to_store", full_disk)
        with pytest.raises(
            StoreError, match=r"^out = cube.nc: could not be written \(No space left on device\); what "
        ):
            sweep()
    counted.clear()
    sweep()
    assert counted == []


def test_what_is_read_is_what_was_added():
    whole = attempt(SPEC, (Tile(0, 120),)).finished[0]
    with tile_store(Path("cube.nc"), SPEC.configuration(), 120) as store:
        for piece in ((30, 40), (90, 120), (10, 30), (0, 5)):
            store.add(whole.part(Tile(*piece)))
        store.flush()
        store.add(whole.part(Tile(5, 10)))
        store.flush()
        assert store.gaps() == [Tile(40, 90)]
        assert [entry.tiles for entry in store.manifest.entries] == [[(0, 5), (10, 40), (90, 120)], [(5, 10)]]
        for start, stop in ((0, 40), (3, 12), (39, 40), (100, 120)):
            assert store.read(start, stop).tobytes() == whole.results[start:stop].tobytes()
        assert (store.read(35, 95)["codes"][5:55] == 0).all()
        store.drop(lambda results: results["codes"][:, 1] == 3)
        drifting = np.flatnonzero(whole.codes[:, 1] == 3)
        missing = [point for tile in store.gaps() for point in range(*tile)]
        assert missing == sorted({*drifting.tolist(), *range(40, 90)})
        assert store.check() == []
