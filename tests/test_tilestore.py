"""What is on disk is used only if every check holds; what is not is told in one line and computed again."""

import errno
import hashlib
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import threading
import traceback
from contextlib import closing
from math import inf
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.results import Finished, Tile
from dimersweep.errors import StoreError
from dimersweep.storage.locking import is_locked, locked
from dimersweep.storage.store import Store
from dimersweep.storage.tilestore import TileStore, tile_store
from dimersweep.studies.status import status, status_lines
from dimersweep.studies.sweep import study_of
from dimersweep.work.tiles import attempt
from tests.fakes import points_made, points_on_disk
from tests.seams import another_version, no_work, set_pace

GRID = {"f": [15, 20, 25], "beta0": {"start": 1, "stop": 40, "step": 1, "unit": "deg"}}
SPEC = study_of(GRID, periods=5)
STORE = Path("cube.nc.tiles")


pytestmark = pytest.mark.usefixtures("empty_folder", "fake_kernel")


def sweep(**settings):
    return dimersweep.sweep(GRID, **({"periods": 5, "progress": False, "out": "cube.nc"} | settings))


def made(start, stop):
    """A finished tile."""
    return Finished(Tile(start, stop), attempt(SPEC, np.arange(start, stop)).results)


def left_behind(*tiles):
    """The store of a sweep that was killed after `tiles`, each in a row of its own."""
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        for tile in tiles:
            store.add(made(*tile))
            store.flush()


@pytest.fixture
def counted(asked, monkeypatch):
    """The rows of the points that are run, in tasks of ten."""
    set_pace(monkeypatch, 10)
    return asked


def test_finished_tiles_are_not_run_again(counted):
    reference = sweep(out=None)
    left_behind((0, 30), (50, 60))
    counted.clear()
    xr.testing.assert_equal(sweep(), reference)
    assert points_made(counted) == 120 - 40
    assert os.listdir() == ["cube.nc"]


def change(statement, *given):
    """Change a store as any client of SQLite may."""
    with closing(sqlite3.connect(STORE)) as file, file:
        file.execute(statement, given)


def flip(place):
    written = bytearray(STORE.read_bytes())
    written[place] ^= 1
    STORE.write_bytes(written)


def in_the_results():
    """A place in the results of the second row."""
    with closing(sqlite3.connect(STORE)) as file:
        ((results,),) = file.execute("SELECT substr(results, 1001, 100) FROM tiles WHERE start = 50")
    return STORE.read_bytes().rindex(results)


def cut_end():
    STORE.write_bytes(STORE.read_bytes()[:-100])


def forge(**columns):
    """Change the second row, so that its checksum is true of the new values."""
    with closing(sqlite3.connect(STORE)) as file, file:
        file.row_factory = sqlite3.Row
        row = dict(file.execute("SELECT * FROM tiles WHERE start = 50").fetchone()) | columns
        of, results = (
            file.execute("SELECT value FROM about WHERE name = 'configuration_sha256'").fetchone(),
            row["results"],
        )
        told = json.dumps([*of, *(row[name] for name in ("start", "stop", "what", "seconds", "wall", "at"))])
        row["sha256"] = hashlib.sha256(told.encode() + results).hexdigest()
        file.execute("DELETE FROM tiles WHERE start = 50")
        file.execute(f"INSERT INTO tiles VALUES ({', '.join('?' * len(row))})", tuple(row.values()))


def forge_modes(*codes):
    """Change modes in the results of the second row, with a true checksum."""
    results = made(50, 60).results.copy()
    results["codes"][: len(codes), 1] = codes
    forge(results=results.tobytes())


def test_a_store_that_is_cut_while_it_is_open_is_told_in_a_line():
    left_behind((0, 30), (50, 60))
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        os.truncate(STORE, os.path.getsize(STORE) // 4)
        store.connection.execute("PRAGMA shrink_memory")
        with pytest.raises(StoreError, match=r"cube.nc.tiles: cannot be read \(.*\); run the same again"):
            store.read(0, 120)


OTHER = "tile 50 has other bytes than were written"
LOST = "parts of the file cannot be read"


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda: flip(in_the_results()), OTHER),
        (lambda: change("UPDATE tiles SET results = x'00' WHERE start = 50"), OTHER),
        (lambda: change("UPDATE tiles SET wall = wall + 1 WHERE start = 50"), OTHER),
        (lambda: change("UPDATE tiles SET stop = 70 WHERE start = 50"), OTHER),
        (lambda: change("UPDATE tiles SET what = NULL, stop = x'00' WHERE start = 50"), OTHER),
        (lambda: change("UPDATE tiles SET start = 60 WHERE start = 50"), OTHER.replace("50", "60")),
        (lambda: forge(stop=59), "tile 50 has results of another shape"),
        (lambda: forge(stop=10**9), "tile 50 is not of this grid"),
        (lambda: forge(seconds="x"), OTHER),
        (lambda: forge(what='{"rest": 9}'), "tile 50 has other modes than were listed"),
        (lambda: forge_modes(0), "tile 50 has other modes than were listed"),
        (lambda: forge_modes(127), "tile 50 has other modes than were listed"),
        (cut_end, f"{OTHER}|{LOST}|{OTHER}; {LOST}"),
        (lambda: flip(18), LOST),  # as if it had a log of SQLite's beside it
        (lambda: flip(35), LOST),  # the list of free pages
    ],
)
def test_damaged_results_are_told_and_computed_again(counted, damage, told):
    reference = sweep(out=None)
    left_behind((0, 30), (50, 60))
    damage()
    counted.clear()
    assert status_lines(status(Path("cube.nc")))[0].startswith("cube.nc: ")
    with pytest.warns(RuntimeWarning, match=rf"^cube.nc.tiles: damaged results are computed again \(({told})\)$"):
        cube = sweep()
    assert points_made(counted) in (120 - 30, 120 - 40)
    xr.testing.assert_equal(cube, reference)
    assert os.listdir() == ["cube.nc"]


def test_a_store_is_mended_once_and_used_on(counted):
    left_behind((0, 30), (50, 60))
    cut_end()
    for trouble in (1, 0):
        with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
            assert len(store.damage) == trouble
            store.add(made(100, 110)) if trouble else None
            store.flush()
            assert store.gaps()[-1] == Tile(110, 120) and len(store.gaps()) > 1
            with pytest.raises(BlockingIOError), locked(STORE):  # what is locked is the new file
                pass
    assert os.listdir() == ["cube.nc.tiles"]


def test_what_a_kill_leaves_half_written_is_deleted(counted, recwarn):
    left_behind((0, 30))
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        scratch = store.scratch
        scratch.mkdir()  # of a Zarr group
        (scratch / "zarr.json").write_text("{")
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size):
        assert not scratch.exists()
        scratch.write_bytes(b"half a fi")
    sweep(periods=6, force=True)
    assert not recwarn.list
    assert os.listdir() == ["cube.nc"]


def forget_table():
    change("DROP TABLE tiles")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda: flip(0), "is damaged, or no store of this version of dimersweep; begin anew .*force=True"),
        (lambda: STORE.write_bytes(STORE.read_bytes()[:300]), "is damaged, or no store of this version"),
        (lambda: change("UPDATE about SET value = replace(value, '15.0', '15.5')"), "is damaged, or no store of this"),
        (lambda: change("UPDATE about SET value = '120' WHERE name = 'points'"), "is damaged, or no store of this"),
        (lambda: change("UPDATE about SET value = 'cube.nc' WHERE name = 'scratch'"), "is damaged, or no store of"),
        (lambda: change("DELETE FROM about WHERE name = 'configuration'"), "is damaged, or no store of this"),
        (lambda: change("UPDATE about SET value = 3 WHERE name = 'format'"), "has the format of another version"),
        (forget_table, "has the format of another version"),
        (
            lambda: change("UPDATE about SET value = 10000000000 WHERE name = 'points'"),
            r"is damaged \(tells of 10000000000 points, where its grid has 120\); begin",
        ),
    ],
)
def test_a_store_that_does_not_match_is_refused_and_nothing_is_touched(spoil, message):
    left_behind((0, 30))
    Path("precious").write_text("precious")
    spoil()
    before = STORE.read_bytes()
    with pytest.raises(StoreError, match=f"^cube.nc.tiles: {message}"):
        sweep()
    assert STORE.read_bytes() == before
    sweep(force=True)
    assert sorted(os.listdir()) == ["cube.nc", "precious"]


def test_another_kernel_is_refused(monkeypatch):
    left_behind((0, 30))
    another_version(monkeypatch, "0123456789abcdef")
    told = "kernel_version: the sources of dimersweep are those of another version"
    with pytest.raises(StoreError, match=f"What differs:\n  {told}$"):
        sweep()


def test_force_keeps_what_fits_and_clears_what_does_not(counted):
    left_behind((0, 30))
    counted.clear()
    sweep(force=True)
    assert points_made(counted) == 120 - 30
    Path("cube.nc").unlink()
    left_behind((0, 30))
    counted.clear()
    sweep(force=True, periods=6)
    assert points_made(counted) == 120


def test_status_reads_while_another_writes():
    with tile_store(Path("cube.nc"), SPEC.configuration(), SPEC.grid.size) as store:
        store.add(made(0, 30))
        store.flush()
        with store.connection:
            store.take_out(0)
            assert status_lines(status(Path("cube.nc")))[0] == "cube.nc: 30 of 120 points done (25 %)"
        assert status_lines(status(Path("cube.nc")))[0] == "cube.nc: 0 of 120 points done (0 %)"


def test_status_tells_of_a_clock_that_was_set_back():
    left_behind((0, 30))
    change("UPDATE tiles SET at = '2999-01-01T00:00:00+00:00'")
    assert (
        status_lines(status(Path("cube.nc")))[2]
        == "last tile: 2999-01-01T00:00:00+00:00, by a clock that has been set back since"
    )


@pytest.mark.parametrize("column", ["what = 'x'", "at = 'yesterday'", "what = 3", "what = '{\"rest\": -1}'"])
def test_status_tells_of_damage(column):
    left_behind((0, 30))
    change(f"UPDATE tiles SET {column}")
    assert "cube.nc.tiles: is damaged; what is lost will be computed again" in status_lines(status(Path("cube.nc")))


def test_nothing_is_said_to_be_kept_where_nothing_is(monkeypatch):
    monkeypatch.setattr(TileStore, "_put", full_disk)
    with pytest.raises(StoreError, match=r"\(No space left on device\); nothing was finished before$"):
        sweep()
    assert os.listdir() == []


def test_tiles_are_kept_when_asked():
    sweep(keep_tiles=True)
    assert sorted(os.listdir()) == ["cube.nc", "cube.nc.tiles"]
    assert status_lines(status(Path("cube.nc")))[-1] == "cube: is written"
    assert status_lines(status(STORE))[0] == "cube.nc: 120 of 120 points done (100 %)"


def test_only_some_of_many_damaged_tiles_are_told_by_name():
    left_behind(*((k, k + 9) for k in range(0, 90, 10)))
    change("UPDATE tiles SET sha256 = ''")
    told = r"(tile \d+ has other bytes than were written; ){5}and 4 more\)$"
    with pytest.warns(RuntimeWarning, match=rf"^cube.nc.tiles: damaged results are computed again \({told}"):
        sweep()
    assert os.listdir() == ["cube.nc"]


@pytest.mark.parametrize("target", ["elsewhere", "nowhere", "file", ""])
def test_what_is_no_store_is_refused_before_any_work_and_stays(monkeypatch, target):
    Path("elsewhere").mkdir()
    Path("file").write_text("precious")
    STORE.symlink_to(target) if target else STORE.write_text("precious")
    no_work(monkeypatch)
    for force in (False, True):
        with pytest.raises(StoreError, match=r"^cube.nc.tiles: .*, where what is finished is kept; move it, or"):
            sweep(force=force)
    assert os.listdir("elsewhere") == []
    assert sorted(os.listdir()) == ["cube.nc.tiles", "elsewhere", "file"]
    assert Path("file").read_text() == "precious" and (target or STORE.read_text() == "precious")


def test_a_link_in_place_of_the_journal_leads_nowhere():
    left_behind((0, 30))
    Path("precious").write_text("precious")
    Path("cube.nc.tiles-journal").symlink_to("precious")
    try:
        sweep()
    except StoreError as error:
        assert "\n" not in str(error)
    assert Path("precious").read_text() == "precious"


def test_a_lock_frees_itself_and_is_not_shared():
    with locked(STORE):
        with pytest.raises(BlockingIOError), locked(STORE):
            pass
        code = f"from dimersweep.storage.locking import *; from pathlib import Path; print(is_locked(Path('{STORE}')))"
        asked = [sys.executable, "-c", code + f"; locked(Path('{STORE}')).__enter__()"]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
        other = subprocess.run(asked, env=environment, capture_output=True, text=True, check=False)
        assert other.stdout == "True\n" and "BlockingIOError" in other.stderr
        STORE.unlink()  # as the holder does at its end
        with locked(STORE):
            assert is_locked(STORE)
    assert not is_locked(STORE)


def test_a_disk_without_locks_is_used_with_a_warning(monkeypatch):
    def no_locks(handle, how, what):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("dimersweep.storage.locking.fcntl.fcntl", no_locks)
    with pytest.warns(RuntimeWarning, match="^this file system has no locks; take care that no other sweep"):
        sweep()
    assert os.listdir() == ["cube.nc"]


def test_a_reader_that_does_not_let_go_is_told_of(monkeypatch):
    monkeypatch.setattr("dimersweep.storage.store.BUSY_SECONDS", 0.1)
    left_behind((0, 30))
    with closing(sqlite3.connect(STORE, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT * FROM tiles").fetchone()
        with pytest.raises(StoreError, match=r"^cube.nc.tiles: .*could not be written \(database is locked\)"):
            sweep()
    assert points_on_disk(Path("cube.nc")) == 30


def flush_each_tile(patch):
    patch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
    patch.setattr("dimersweep.storage.tilestore.DISK_SHARE", 1e9)


def full_disk(*arguments, **more):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_keeps_what_was_finished_before(counted, monkeypatch):
    writes = []
    put = Store.put

    def fills_up(self, tile, *rest, **more):
        writes.append(tile.stop - tile.start)
        return put(self, tile, *rest, **more) if len(writes) < 3 else full_disk()

    with monkeypatch.context() as patch:
        flush_each_tile(patch)
        patch.setattr(Store, "put", fills_up)
        with pytest.raises(StoreError) as error:
            sweep(workers=1)
    assert str(error.value) == (
        "cube.nc.tiles: finished tiles: could not be written (No space left on device); "
        "what was finished before is kept in cube.nc.tiles; mend that and run the same again"
    )
    kept = sum(writes[:2])
    assert kept > 0
    for thread in threading.enumerate():  # a task that was under way as the disk filled up may still count its points
        if thread.name.startswith("dimersweep"):
            thread.join()
    counted.clear()
    sweep()
    assert points_made(counted) == 120 - kept


@pytest.fixture
def disk(tmp_path):
    """A small disk of its own, and a function that mounts it with other options."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("needs the right to mount")
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(place)], check=False).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        yield place, lambda options: subprocess.run(["mount", "-o", f"remount,{options}", str(place)], check=True)
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_is_really_full(disk, monkeypatch):
    place, remount = disk
    reference = sweep(out=None)
    with monkeypatch.context() as patch:
        flush_each_tile(patch)
        set_pace(patch, 10)
        with pytest.raises(
            StoreError, match=r"\(database or disk is full\); what was finished before is kept in "
        ) as told:
            sweep(out=place / "cube.nc", workers=1)
    assert "".join(traceback.format_exception(told.value)).count("StoreError: ") == 1
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
    whole, put, written = made(0, 120), Store.put, []
    clock = [0.0]
    monkeypatch.setattr("dimersweep.storage.tilestore.perf_counter", lambda: clock[0])

    def slow(self, tile, *rest, **more):
        clock[0] += 0.02
        written.append(tile.stop - tile.start)
        return put(self, tile, *rest, **more)

    monkeypatch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", 0.0)
    monkeypatch.setattr(Store, "put", slow)
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


def test_what_is_read_is_what_was_added(monkeypatch):
    monkeypatch.setattr("dimersweep.storage.tilestore.FLUSH_SECONDS", inf)  # written where that is asked for alone
    whole = made(0, 120)
    with tile_store(Path("cube.nc"), SPEC.configuration(), 120) as store:
        for piece in ((30, 40), (90, 120), (10, 30), (0, 5)):
            store.add(whole.part(Tile(*piece)))
        store.flush()
        store.add(whole.part(Tile(5, 10)))
        store.flush()
        assert store.gaps() == [Tile(40, 90)]
        rows = [(row.start, row.stop, row.wall > 0) for row in store.summaries()]
        assert rows == [(0, 5, True), (5, 10, True), (10, 40, False), (90, 120, False)]
        for start, stop in ((0, 40), (3, 12), (39, 40), (100, 120)):
            assert store.read(start, stop).tobytes() == whole.results[start:stop].tobytes()
        assert (store.read(35, 95)["codes"][5:55] == 0).all()
        store.drop(lambda results: results["codes"][:, 1] == 3)
        drifting = np.flatnonzero(whole.codes[:, 1] == 3)
        missing = [point for tile in store.gaps() for point in range(*tile)]
        assert missing == sorted({*drifting.tolist(), *range(40, 90)})
        monkeypatch.setattr("dimersweep.storage.tilestore.FLUSH_BYTES", 20 * store.kind.itemsize)
        store.add(whole.part(Tile(40, 90)))
        assert [row.start for row in store.summaries() if 40 <= row.start < 90] == [40, 60, 80]
        assert store.read(40, 90).tobytes() == whole.results[40:90].tobytes()
    with tile_store(Path("cube.nc"), SPEC.configuration(), 120) as store:
        assert store.damage == []


def test_any_client_of_sqlite_can_read_it():
    left_behind((0, 30), (50, 60))
    with closing(sqlite3.connect(f"file:{STORE}?mode=ro", uri=True)) as file:
        assert dict(file.execute("SELECT name, value FROM about"))["points"] == 120
        ((kept, modes),) = file.execute("SELECT sum(stop - start), group_concat(what) FROM tiles")
        assert kept == 40 and "drift" in modes
        ((results,),) = file.execute("SELECT results FROM tiles WHERE start = 50")
    whole = made(50, 60).results
    assert np.frombuffer(results, whole.dtype).tobytes() == whole.tobytes()


HALF_WRITTEN = """
import os, signal, sqlite3
file = sqlite3.connect("cube.nc.tiles", isolation_level=None)
file.execute("PRAGMA cache_size = 1")
file.execute("BEGIN IMMEDIATE")
file.execute("UPDATE tiles SET results = zeroblob(9000)")
file.executemany("INSERT INTO tiles (start, stop, results) VALUES (?, 1, zeroblob(9000))", [(k,) for k in range(200, 300)])
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_kill_has_left_half_written_is_taken_back(counted, recwarn):
    reference = sweep(out=None)
    left_behind((0, 30), (50, 60))
    before = STORE.read_bytes()
    subprocess.run([sys.executable, "-c", HALF_WRITTEN], check=False)
    half = STORE.read_bytes()
    assert half != before and Path("cube.nc.tiles-journal").stat().st_size > 4096
    assert status_lines(status(Path("cube.nc")))[0].startswith("cube.nc: ")
    assert STORE.read_bytes() == half
    counted.clear()
    xr.testing.assert_equal(sweep(), reference)
    assert points_made(counted) == 120 - 40
    assert not recwarn.list and os.listdir() == ["cube.nc"]


def test_a_disk_that_cannot_be_read_costs_nothing(monkeypatch):
    left_behind((0, 30))
    before = STORE.read_bytes()

    def fails(self, columns="*"):
        raise sqlite3.OperationalError("disk I/O error")

    with monkeypatch.context() as patch:
        patch.setattr(Store, "rows", fails)
        with pytest.raises(
            StoreError, match=r"^cube.nc.tiles: could not be written \(disk I/O error\); nothing was com"
        ):
            sweep()
    assert STORE.read_bytes() == before
