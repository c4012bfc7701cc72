"""The attacks of ``faults.py``: each damages a scene, which is then judged, or gives its own verdict."""

import json
import os
import random
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from fault_scene import SEARCH, TOML, Scene, Skipped, attack, ended, forked, line_of

# --- kills --------------------------------------------------------------------------------------------------------------


def killed(
    scene: Scene, number: int = signal.SIGKILL, share: tuple[float, float] = (0.0, 1.0), most: int = 4
) -> str | None:
    """Kill the sweep at random moments, and start it again each time; one that is cut short must not end with status 0."""
    for _ in range(most):
        pid = scene.start()
        time.sleep(scene.rng.uniform(*share) * scene.length)
        os.kill(pid, number)
        scene.kills += 1
        if ended(pid) == 0 and not scene.cube.exists():
            return f"FAILED: exit 0 without a cube: {scene.told()[-200:]}"
    return None


KILLS: dict[str, dict[str, Any]] = {
    "the client, at any moment": {},
    "the client, as it begins": {"share": (0.0, 0.1), "most": 6},
    "with SIGTERM": {"number": signal.SIGTERM},
    "with SIGINT": {"number": signal.SIGINT},
}
for _name, _how in KILLS.items():

    @attack(f"killed: {_name}")
    def _(scene: Scene, how: dict[str, Any] = _how) -> str | None:
        return killed(scene, **how)


@attack("killed: a Zarr sweep, at any moment")
def _(scene: Scene) -> str | None:
    as_zarr(scene)
    return killed(scene)


@attack("killed: a search, at any moment")
def _(scene: Scene) -> str | None:
    scene.reference = "search"
    scene.declare(TOML.format(out=scene.out) + SEARCH)
    return killed(scene)


def as_zarr(scene: Scene) -> None:
    """Let the sweep write Zarr."""
    scene.out = "cube.zarr"
    scene.declare(TOML.format(out=scene.out))


def killed_when(scene: Scene, holds: Callable[[], bool]) -> None:
    """Kill the sweep as soon as something holds, and a little later."""
    pid = scene.start()
    ends = time.monotonic() + 60
    while not holds() and time.monotonic() < ends and os.waitpid(pid, os.WNOHANG) == (0, 0):
        time.sleep(0.0005)
    time.sleep(scene.rng.uniform(0, 0.05))
    scene.kill(pid)


def writes_cube(scene: Scene) -> bool:
    """Whether the cube is being written, under its temporary name."""
    return any(scene.folder.glob(".dimersweep-*.tmp"))


@attack("killed: while it writes NetCDF")
def _(scene: Scene) -> None:
    killed_when(scene, lambda: writes_cube(scene))


@attack("killed: while it writes Zarr")
def _(scene: Scene) -> None:
    as_zarr(scene)
    killed_when(scene, lambda: writes_cube(scene))


@attack("killed: within the writes of the store, 40 times")
def _(scene: Scene) -> str | None:
    spec, results = known_results(scene)

    def write(done: int) -> None:
        """Write point after point, each as a transaction that is acknowledged, and all over again."""
        from dimersweep.cubes.results import Finished, Tile
        from dimersweep.storage.tilestore import tile_store

        while True:
            with tile_store(scene.cube, spec.configuration(), spec.grid.size, spec.kind) as store:
                for start, stop in store.gaps():
                    for k in range(start, stop):
                        store.add(Finished(Tile(k, k + 1), results[k : k + 1]))
                        store.flush()
                        os.write(done, b".")
                store.drop(lambda each: each["codes"][:, 0] == 0)  # all
                os.write(done, b"-")

    kept = 0
    for _ in range(40):
        ends = os.pipe()
        pid = forked(lambda end=ends[1]: write(end), scene.folder / "told")  # type: ignore[misc]
        os.close(ends[1])
        told = os.read(ends[0], 1)  # it has begun
        time.sleep(scene.rng.uniform(0, 0.05))
        scene.kill(pid)
        told += b"".join(iter(lambda end=ends[0]: os.read(end, 1 << 16), b""))  # type: ignore[misc]
        os.close(ends[0])
        least = len(told.rpartition(b"-")[2]) + (0 if b"-" in told else kept)
        kept = points_of(scene)
        if kept < least < len(results):  # once all were there, they are forgotten one by one
            return f"FAILED: {least} points were acknowledged, {kept} are there: {scene.told()[-200:]}"
    return None


def known_results(scene: Scene) -> tuple[Any, Any]:
    """The sweep that is declared, and the results of its points, of a process of their own."""
    import numpy as np

    from dimersweep.studies.declared import read_declaration

    spec: Any = read_declaration(scene.folder / "sweep.toml").study()
    place = scene.stock.folder / "results.npy"

    def compute() -> None:
        from dimersweep.work.tiles import attempt

        np.save(place, attempt(spec, np.arange(spec.grid.size), seconds=60.0).results)

    if not place.exists():
        ended(forked(compute, scene.folder / "told"))
    return spec, np.load(place)


def points_of(scene: Scene) -> int:
    """Number of the points that the store has, as its next owner finds them."""

    def count() -> None:
        spec, _ = known_results(scene)
        from dimersweep.storage.tilestore import tile_store

        with tile_store(scene.cube, spec.configuration(), spec.grid.size, spec.kind) as store:
            assert not store.damage, store.damage
            print(sum(store.modes().values()))

    code = ended(forked(count, scene.folder / "told"))
    return int(scene.told()) if code == 0 else -1


@attack("killed: while it replaces a Zarr cube")
def _(scene: Scene) -> None:
    as_zarr(scene)
    scene.declare(scene.text.replace("periods = 60", "periods = 61"))
    scene.complete()
    scene.declare()
    pid = scene.start("--force")
    time.sleep(scene.rng.uniform(0.5, 1.5) * scene.length)
    scene.kill(pid)
    scene.again = ("--force",)


# --- limits and disks ---------------------------------------------------------------------------------------------------


@attack("memory that runs out")
def _(scene: Scene) -> str | None:
    room = scene.rng.choice([10, 40, 80, 200])

    def before() -> None:
        used = 1024 * int(Path("/proc/self/statm").read_text().split()[0]) * 4
        resource.setrlimit(resource.RLIMIT_AS, (used + room * 2**20, resource.RLIM_INFINITY))

    return scene.came_through(scene.start(before=before))


@attack("files that may not grow")
def _(scene: Scene) -> str | None:
    most = scene.rng.choice([100, 3000, 10_000, 30_000])
    return scene.came_through(scene.start(before=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))))


@attack("few open files")
def _(scene: Scene) -> str | None:
    most = scene.rng.choice([8, 10, 12, 16])
    return scene.came_through(scene.start(before=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))))


def on_a_disk(scene: Scene, options: str) -> Path:
    """The place of the output on a small disk of its own, which goes with the scene."""
    place = scene.folder / "mine" / "disk"
    place.mkdir()
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", place], check=False).returncode:
        place.rmdir()
        raise Skipped("mounting is not allowed here")
    return place


def disk(scene: Scene, options: str, then: str) -> str | None:
    """Run a sweep on a small disk, and again when its options are others."""
    place = on_a_disk(scene, options)
    try:
        inner = scene.folder / "mine"
        scene.run("--out", str(place / "cube.nc"))
        first = line_of(scene.told())
        if not first or ("could not be written" not in first and "not writable" not in first):
            return f"FAILED: {scene.told()[-200:]}"
        subprocess.run(["mount", "-o", f"remount,{then}", place], check=True)
        if scene.run("--out", str(place / "cube.nc")):
            return f"FAILED: {scene.told()[-200:]}"
        shutil.copy(place / "cube.nc", scene.cube)
        return None if inner.exists() else "FAILED: the folder is gone"
    finally:
        subprocess.run(["umount", place], check=True)
        place.rmdir()


@attack("a disk that fills up")
def _(scene: Scene) -> str | None:
    return disk(scene, f"size={scene.rng.choice([8, 16, 24, 32])}k", "size=10m")


@attack("a disk that is full when the cube is written")
def _(scene: Scene) -> str | None:
    return disk(scene, "size=60k", "size=10m")


@attack("a disk that is read-only")
def _(scene: Scene) -> str | None:
    return disk(scene, "size=10m,ro", "rw")


# --- folders and files that vanish --------------------------------------------------------------------------------------


def during(scene: Scene, change: Callable[[], Any]) -> str | None:
    """Make a change while the sweep runs, which must come through or say why not."""
    pid = scene.start()
    time.sleep(scene.rng.uniform(0.2, 0.8) * scene.length)
    with suppress(OSError):  # it may have ended
        change()
    return scene.came_through(pid)


def read_for_a_while(scene: Scene) -> None:
    """Read all that is there, as any client of SQLite may, again and again."""
    ends = time.monotonic() + 0.5 * scene.length
    while time.monotonic() < ends:
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{scene.tiles}?mode=ro", uri=True)) as file:
            file.execute("SELECT * FROM tiles").fetchall()


RUNNING: dict[str, Callable[[Scene], Any]] = {
    "the store is removed": lambda scene: scene.tiles.unlink(),
    "the store is renamed": lambda scene: scene.tiles.rename(scene.folder / "told before"),
    "the store is cut": lambda scene: cut(scene.tiles, scene.rng),
    "a bit is flipped in the store": lambda scene: flip(scene.tiles, scene.rng),
    "the journal of the store is removed": lambda scene: scene.beside("-journal").unlink(),
    "another program reads the store": read_for_a_while,
}
for _name, _change in RUNNING.items():

    @attack(f"{_name} while it runs")
    def _(scene: Scene, change: Callable[[Scene], Any] = _change) -> str | None:
        return during(scene, lambda: change(scene))


def change(scene: Scene, statement: str, *given: Any) -> None:
    """Change the store as any client of SQLite may."""
    with closing(sqlite3.connect(scene.tiles)) as file, file:
        file.execute(statement, given)


def forge(scene: Scene, **columns: Any) -> None:
    """Change a row of the store, with a true checksum."""
    with closing(sqlite3.connect(scene.tiles)) as file, file:
        file.row_factory = sqlite3.Row
        rows = file.execute("SELECT * FROM tiles").fetchall()
        (digest,) = file.execute("SELECT value FROM about WHERE name = 'configuration_sha256'").fetchone()
        row = dict(scene.rng.choice(rows))
        file.execute("DELETE FROM tiles WHERE start = ?", (row["start"],))
        row |= columns
        told = json.dumps([digest, *(row[name] for name in ("start", "stop", "what", "seconds", "wall", "at"))])
        row["sha256"] = sha256(told.encode() + row["results"]).hexdigest()
        file.execute(f"INSERT INTO tiles VALUES ({', '.join('?' * len(row))})", tuple(row.values()))


def forge_configuration(scene: Scene) -> None:
    """Put another configuration into the store, with a true checksum."""
    told = scene.rng.choice(["[]", "null", "3", "{}", '{"grid": null}', "[" * 100_000, '{"grid": {}, "fixed": null}'])
    change(scene, "UPDATE about SET value = ? WHERE name = 'configuration'", told)
    change(
        scene,
        "UPDATE about SET value = ? WHERE name = 'configuration_sha256'",
        sha256(told.encode()).hexdigest(),
    )


FORGERIES: tuple[dict[str, Any], ...] = (
    {"stop": 10**9},
    {"start": -5},
    {"stop": 0},
    {"what": '{"rest": -1}'},
    {"what": "3"},
    {"what": "x"},
    {"seconds": "x"},
    {"at": "yesterday"},
    {"results": b""},
)
TOLD = (("points", -3), ("points", 10**15), ("wanted", 0), ("scratch", "mine/notes.txt"), ("format", 3), ("layout", ""))

BEGUN: dict[str, Callable[[Scene], Any]] = {  # what is done to a sweep that has begun
    "the store is removed": lambda scene: scene.tiles.unlink(),
    "a bit is flipped in the store": lambda scene: flip(scene.tiles, scene.rng),
    "a bit is flipped in the first page of the store": lambda scene: flip_before(scene.tiles, scene.rng, 4096),
    "the end is cut from the store": lambda scene: cut(scene.tiles, scene.rng),
    "a part of the store is overwritten": lambda scene: overwrite(scene.tiles, scene.rng),
    "a few bytes are put into the store": lambda scene: put_in(scene.tiles, scene.rng),
    "the tiles are taken out of the store": lambda scene: change(scene, "DELETE FROM tiles"),
    "the table of tiles is dropped": lambda scene: change(scene, "DROP TABLE tiles"),
    "a trigger is put into the store": lambda scene: change(
        scene, "CREATE TRIGGER t AFTER INSERT ON tiles BEGIN DELETE FROM tiles; END"
    ),
    "a store that names another host": lambda scene: change(
        scene, "UPDATE about SET value = ? WHERE name = 'host'", f"not-{socket.gethostname()}"
    ),
    "the configuration in the store is forged": forge_configuration,
    "what the store tells of itself is forged": lambda scene: change(
        scene, "UPDATE about SET value = ?2 WHERE name = ?1", *scene.rng.choice(TOLD)
    ),
    "a tile is forged": lambda scene: forge(scene, **scene.rng.choice(FORGERIES)),
    "two tiles are swapped": lambda scene: change(
        scene,
        "UPDATE tiles SET results = (SELECT results FROM tiles AS other WHERE other.start != tiles.start)",
    ),
    "a journal of rubbish": lambda scene: scene.beside("-journal").write_bytes(scene.rng.randbytes(5000)),
    "a journal of another file": lambda scene: scene.beside("-journal").write_bytes(another_journal(scene)),
    "a log of SQLite's beside the store": lambda scene: scene.beside("-wal").write_bytes(scene.rng.randbytes(5000)),
}
for _name, _change in BEGUN.items():

    @attack(_name)
    def _(scene: Scene, change: Callable[[Scene], Any] = _change) -> None:
        scene.begin()
        change(scene)


def another_journal(scene: Scene) -> bytes:
    """What a change of another database, that is cut short, leaves beside it."""
    other = scene.stock.place()
    with closing(sqlite3.connect(other, isolation_level=None)) as file:
        file.execute("CREATE TABLE t (a)")
        file.execute("BEGIN IMMEDIATE")
        file.execute("PRAGMA cache_size = 1")
        file.executemany("INSERT INTO t VALUES (?)", [(bytes(3000),)] * 30)
        return other.with_name(f"{other.name}-journal").read_bytes()


@attack("the finished cube is removed")
def _(scene: Scene) -> None:
    scene.run("--keep-tiles")
    scene.cube.unlink()


IN_PLACE: dict[str, Callable[[Scene], Any]] = {
    "a file": lambda scene: scene.tiles.write_text("precious"),
    "a link": lambda scene: scene.tiles.symlink_to("mine/notes.txt"),
    "an empty folder": lambda scene: scene.tiles.mkdir(),
    "a database of the user's": lambda scene: scene.tiles.write_bytes(another_database(scene)),
}
for _name, _make in IN_PLACE.items():

    @attack(f"{_name} in place of the store")
    def _(scene: Scene, make: Callable[[Scene], Any] = _make) -> str | None:
        make(scene)
        before = scene.tiles.read_bytes() if scene.tiles.is_file() else b""
        scene.hostile, scene.again = True, scene.rng.choice([(), ("--force",)])
        code, told = scene.run(*scene.again), line_of(scene.told())
        if code == 0 or not told or (scene.tiles.read_bytes() if scene.tiles.is_file() else b"") != before:
            return f"FAILED: exit {code}: {scene.told()[-200:]}"
        return None


def another_database(scene: Scene) -> bytes:
    """A file of SQLite that is none of ours."""
    other = scene.stock.place()
    with closing(sqlite3.connect(other)) as file, file:
        file.execute("CREATE TABLE tiles (a)")
    return other.read_bytes()


@attack("the folder of a former revision in place of the store")
def _(scene: Scene) -> None:
    scene.tiles.mkdir()
    (scene.tiles / "manifest.jsonl").write_text("{}")
    scene.hostile, scene.again = True, scene.rng.choice([(), ("--force",)])


@attack("a link in place of the journal of the store")
def _(scene: Scene) -> None:
    scene.begin()
    scene.beside("-journal").symlink_to("mine/notes.txt")


# --- flips, cuts and swaps ----------------------------------------------------------------------------------------------


def a_chunk(scene: Scene) -> Path:
    """One of the files of numbers of a Zarr cube."""
    return scene.rng.choice(sorted(path for path in scene.cube.rglob("c/**/*") if path.is_file()))


def flip(path: Path, rng: random.Random, start: int = 0) -> None:
    """Turn one bit over."""
    written = bytearray(path.read_bytes())
    written[rng.randrange(min(start, len(written) - 1), len(written))] ^= 1 << rng.randrange(8)
    path.write_bytes(written)


def flip_before(path: Path, rng: random.Random, stop: int) -> None:
    """Turn one bit over in the first bytes."""
    written = bytearray(path.read_bytes())
    written[rng.randrange(stop)] ^= 1 << rng.randrange(8)
    path.write_bytes(written)


def overwrite(path: Path, rng: random.Random) -> None:
    """Put something else in place of up to 10 kB."""
    written = bytearray(path.read_bytes())
    start = rng.randrange(len(written))
    stop = min(len(written), start + rng.randrange(1, 10_000))
    written[start:stop] = rng.choice([bytes(stop - start), rng.randbytes(stop - start)])
    path.write_bytes(written)


def put_in(path: Path, rng: random.Random) -> None:
    """Shift what comes after some place."""
    written = bytearray(path.read_bytes())
    at = rng.randrange(len(written))
    written[at:at] = rng.randbytes(rng.randrange(1, 9))
    path.write_bytes(written)


def cut(path: Path, rng: random.Random) -> None:
    """Leave only the beginning."""
    written = path.read_bytes()
    path.write_bytes(written[: rng.randrange(len(written))])


for _what, _damage in (("a bit is flipped in", flip), ("the end is cut from", cut)):

    @attack(f"{_what} the numbers of a NetCDF cube")
    def _(scene: Scene, damage: Callable[[Path, random.Random], None] = _damage) -> None:
        scene.complete()
        damage(scene.cube, scene.rng)

    @attack(f"{_what} a chunk of a Zarr cube")
    def _(scene: Scene, damage: Callable[[Path, random.Random], None] = _damage) -> None:
        as_zarr(scene)
        scene.complete()
        damage(a_chunk(scene), scene.rng)


@attack("tiles of another sweep")
def _(scene: Scene) -> None:
    scene.declare(scene.text.replace("xdot0 = 1", "xdot0 = 2"))
    scene.begin()
    scene.declare()


# --- others at work, and clocks -----------------------------------------------------------------------------------------


@attack("two sweeps on one output")
def _(scene: Scene) -> str | None:
    first = scene.start(told="told before")
    time.sleep(scene.rng.uniform(0, 0.5) * scene.length)
    second = scene.start()
    wrong = scene.came_through(first, "told before") or scene.came_through(second)
    return wrong or (None if scene.cube.exists() else "FAILED: neither came through")


@attack("a holder of the lock that is stopped")
def _(scene: Scene) -> str | None:
    first = scene.start(told="told before")
    ends = time.monotonic() + 60
    while not scene.tiles.exists() and time.monotonic() < ends:
        time.sleep(0.002)
    time.sleep(0.05)
    os.kill(first, signal.SIGSTOP)
    code = scene.run()
    told = scene.told()
    os.kill(first, signal.SIGCONT)
    wrong = scene.came_through(first, "told before")
    if wrong:
        return wrong
    if code == 0 and not scene.cube.exists():
        return "FAILED: exit 0 without a cube"
    return None if code == 0 or "a sweep is at work here" in line_of(told) else f"FAILED: {told[-200:]}"


@attack("a clock that is set back or ahead")
def _(scene: Scene) -> str | None:
    scene.begin()
    when = scene.rng.choice(["2999-01-01T00:00:00+00:00", "1970-01-01T00:00:00+00:00"])
    change(scene, "UPDATE tiles SET at = ?", when)
    os.utime(scene.tiles, (4e9, 4e9))
    from dimersweep.studies.status import status

    lines = " ".join(status(scene.cube))
    return f"FAILED: {lines}" if "-" in lines.partition("last tile: ")[2].partition(" ago")[0][:2] else None


# --- a kernel that does not work ----------------------------------------------------------------------------------------


def raising(*arguments: Any, **more: Any) -> int:
    """No kernel."""
    raise EOFError("Ran out of input")


def wrong(*arguments: Any, **more: Any) -> int:
    """A kernel that does nothing."""
    return len(arguments[0])


def with_kernel(scene: Scene, module: str, kernel: Callable[..., int]) -> str | None:
    """Run the sweep with another kernel; it must not come through."""

    def before() -> None:
        from dimersweep.work.proving import PROVEN

        PROVEN.clear()
        import_module(f"dimersweep.{module}").run_many = kernel

    code = scene.run(before=before)
    if code == 0 or not line_of(scene.told()) or scene.cube.exists():
        return f"FAILED: exit {code}, {scene.told()[-200:]}"
    return None


@attack("a kernel that cannot run")
def _(scene: Scene) -> str | None:
    return with_kernel(scene, "work.proving", raising)


@attack("a kernel that gives nothing")
def _(scene: Scene) -> str | None:
    return with_kernel(scene, "work.proving", wrong)


@attack("a kernel that ceases to run")
def _(scene: Scene) -> str | None:
    from dimersweep.kernel.batch import run_many

    left = scene.rng.randrange(1, 121)  # points: of the 120, so that it always does

    def ceases(rows: Any, *rest: Any, **more: Any) -> int:
        nonlocal left
        left -= len(rows)
        return run_many(rows, *rest, **more) if left > 0 else raising()

    return with_kernel(scene, "runs.solving", ceases)


@attack("points that cannot be run")
def _(scene: Scene) -> str | None:
    from dimersweep.kernel.batch import run_many
    from dimersweep.kernel.model.layout import ROW_BETA0

    bad = scene.rng.uniform(0.1, 1.4)

    def some(rows: Any, *rest: Any, **more: Any) -> int:
        return raising() if (abs(rows[:, ROW_BETA0] - bad) < 0.04).any() else run_many(rows, *rest, **more)

    return with_kernel(scene, "runs.solving", some)


# --- hostile declarations -----------------------------------------------------------------------------------------------

DECLARED = {
    "periods beyond any run": ("periods = 60", "periods = 9223372036854775808"),
    "no periods": ("periods = 60", "periods = 0"),
    "periods that are no number": ("periods = 60", "periods = '60'"),
    "an output that is nothing": ('output = "cube.nc"', 'output = ""'),
    "an output that is a folder": ('output = "cube.nc"', 'output = "mine"'),
    "an output that is a device": ('output = "cube.nc"', 'output = "/dev/full"'),
    "an output below a file": ('output = "cube.nc"', 'output = "cube.nc.bak/cube.nc"'),
    "an output of 300 letters": ('output = "cube.nc"', f'output = "{"a" * 300}"'),
    "an output with a NUL": ('output = "cube.nc"', 'output = "a\\u0000b"'),
    "an unknown key": ("periods = 60", "periods = 60\nperiod = 60"),
    "an unknown parameter": ("xdot0 = 1", "xdot1 = 1"),
    "a parameter that is not finite": ("xdot0 = 1", "xdot0 = nan"),
    "a parameter that is not allowed": ("xdot0 = 1", "e = 7"),
    "a value of both ends beside that of each": ("xdot0 = 1", "e = 0.6\ne_1 = 0.5\ne_2 = 0.4"),
    "a stop between two steps": ("[15, 20, 25]", "{ start = 15, stop = 25, step = 3 }"),
    "a range wider than any number": (
        'start = 3, stop = 87, num = 40, unit = "deg"',
        "start = -1.7e308, stop = 1.7e308, num = 40",
    ),
    "an axis of 10^12 values": ("num = 40", "num = 1000000000000"),
    "a grid of 10^11 points": ("num = 40", "num = 40000000"),
    "an axis nested 5,000 deep": ("[15, 20, 25]", "[" * 5000 + "15" + "]" * 5000),
    "an axis nested 50 deep": ("[15, 20, 25]", "[" * 50 + "15" + "]" * 50),
    "an axis that falls": ("[15, 20, 25]", "[25, 20, 15]"),
    "an axis of words": ("[15, 20, 25]", "['__import__(\"os\")']"),
    "no valid TOML": ("[grid]", "[grid"),
}
for _name, (_old, _new) in DECLARED.items():

    @attack(f"declared: {_name}")
    def _(scene: Scene, old: str = _old, new: str = _new) -> None:
        text = scene.text.replace(old, new)
        if new.endswith("40000000"):
            text = text.replace("[15, 20, 25]", "{ start = 15, stop = 25, num = 2500 }")
        scene.declare(text)
        scene.hostile = True
        scene.again = scene.rng.choice([(), ("--force",)])


@attack("declared: random bytes")
def _(scene: Scene) -> None:
    (scene.folder / "sweep.toml").write_bytes(scene.rng.randbytes(scene.rng.randrange(1, 300)))
    scene.hostile = True


@attack("declared: a table with lines of other lengths")
def _(scene: Scene) -> None:
    lines = [f"{20 + k},0.{1 + k % 9}" for k in range(50)]
    lines[scene.rng.randrange(50)] += scene.rng.choice([",0.3", ",", ",0.3,0.4"])
    lines[scene.rng.randrange(50)] = "20"
    (scene.folder / "mine" / "points.csv").write_text("\n".join(["f,Gamma", *lines]))
    grid = scene.text[scene.text.index("[grid]") : scene.text.index("[fixed]")]
    scene.declare(scene.text.replace(grid, '[points]\nfile = "mine/points.csv"\n'))
    scene.precious = scene.snapshot()
    scene.hostile = True


@attack("values that are no plain numbers")
def _(scene: Scene) -> str:
    import numpy as np
    import xarray as xr

    chosen = scene.rng.choice(
        [
            np.ma.array([15.0, 20.0], mask=[False, True]),
            [15.0, np.ma.masked],
            xr.DataArray([15.0, 20.0], attrs={"units": "kHz"}),
            np.array([15, 20], dtype="M8[ns]"),
            np.array([15, 20], dtype="m8[s]"),
            np.array([False, True]),
        ]
    )
    result = scene.folder / "told"

    def call() -> None:
        from dimersweep import simulate, sweep
        from dimersweep.errors import ParameterError

        calls = (
            lambda: simulate(f=chosen[1], periods=1),
            lambda: sweep({"f": chosen}, periods=1, progress=False),
            lambda: sweep(points={"f": chosen}, periods=1, progress=False),
        )
        for each in calls:
            try:
                taken = each()
            except ParameterError as error:
                print(error)
            else:
                raise SystemExit(f"{chosen!r} was taken: {taken}")

    code = ended(forked(call, result), 60)
    lines = result.read_text().splitlines()
    return f"refused: {lines[0]}" if code == 0 and len(lines) == 3 else f"FAILED: {chosen!r}: {lines[-3:]}"


# --- hostile cubes ------------------------------------------------------------------------------------------------------


def bomb(path: Path) -> None:
    """A small file that declares 200 GB."""
    from netCDF4 import Dataset

    with Dataset(path, "w") as file:
        file.createDimension("f", 25 * 10**9)
        file.createVariable("mode", "i8", ("f",), zlib=True, chunksizes=(10**6,))
        file.setncattr("dimersweep_cube", "1")


def forged(text: str, cube: Path) -> None:
    """A cube whose configuration is another one, with a true checksum."""
    from netCDF4 import Dataset

    with Dataset(cube, "a") as file:
        file.setncatts({"configuration": text, "configuration_sha256": sha256(text.encode()).hexdigest()})


def mode_127(cube: Path) -> None:
    """A cube with a mode that there is not."""
    from netCDF4 import Dataset

    with Dataset(cube, "a") as file:
        file["mode"][0, 3] = 127


def later(cube: Path) -> None:
    """A cube that says it is of a later format."""
    from netCDF4 import Dataset

    with Dataset(cube, "a") as file:
        file.setncattr("dimersweep_cube", 99)


CUBES: dict[str, Callable[[Scene], Any]] = {
    "of a later format": lambda scene: later(scene.cube),
    "random bytes": lambda scene: scene.cube.write_bytes(scene.rng.randbytes(5000)),
    "an empty file": lambda scene: scene.cube.write_bytes(b""),
    "a text": lambda scene: scene.cube.write_text("precious"),
    "a file that declares 200 GB": lambda scene: bomb(scene.cube),
    "a configuration that is a list": lambda scene: forged("[]", scene.cube),
    "a configuration nested without end": lambda scene: forged("[" * 100_000, scene.cube),
    "a configuration without parameters": lambda scene: forged('{"grid": {}, "fixed": null}', scene.cube),
    "a mode that there is not": lambda scene: mode_127(scene.cube),
}
for _name, _make in CUBES.items():

    @attack(f"a cube that is {_name}")
    def _(scene: Scene, make: Callable[[Scene], Any] = _make) -> str | None:
        scene.complete()
        make(scene)
        before = scene.cube.read_bytes()
        code, told = scene.run(), scene.told()
        if code == 0 or not line_of(told):
            return f"FAILED: exit {code}: {told[-200:]}"
        if scene.cube.read_bytes() != before:
            return "FAILED: it was replaced unasked"
        scene.again = ("--force",)
        return None


@attack("a Zarr group of others in place of the cube")
def _(scene: Scene) -> str | None:
    as_zarr(scene)
    scene.cube.mkdir()
    (scene.cube / "notes.txt").write_text("precious")
    for more in ((), ("--force",)):
        if scene.run(*more) == 0 or not line_of(scene.told()):
            return f"FAILED: {scene.told()[-200:]}"
    if (scene.cube / "notes.txt").read_text() != "precious":
        return "FAILED: it is gone"
    return f"refused: {line_of(scene.told())[19:]}"


@attack("a Zarr cube whose description is forged")
def _(scene: Scene) -> None:
    as_zarr(scene)
    scene.complete()
    path = scene.rng.choice(sorted(scene.cube.rglob("zarr.json")))
    path.write_text(scene.rng.choice(["{", "[]", "null", '{"zarr_format": 9}', "[" * 50_000, ""]))


@attack("a chunk of a Zarr cube is removed")
def _(scene: Scene) -> None:
    as_zarr(scene)
    scene.complete()
    a_chunk(scene).unlink()


# --- other commands -----------------------------------------------------------------------------------------------------


def command(scene: Scene, *arguments: str) -> int:
    """A child that runs another command in the folder of the scene."""

    def call() -> None:
        from dimersweep.cli import main

        os.chdir(scene.folder)
        sys.argv = ["dimersweep", *arguments]
        main()

    return forked(call, scene.folder / "told")


BORDERS = """[borders]
title = "borders to be attacked"
output = "{out}"
[curves]
kinds = ["fold"]
spin = 100
[over]
e = [0.5, 0.6]
"""
NOT_BORDERS: dict[str, tuple[str, str]] = {
    "an output that is a picture": ("{out}", "atlas.png"),
    "an output that is a text": ("{out}", "mine/notes.txt"),
    "an output that is no table": ("{out}", "cube.nc.bak"),
    "no kinds": ('["fold"]', "[]"),
    "a kind twice": ('["fold"]', '["fold", "fold"]'),
    "a spin beyond any orbit": ("spin = 100", "spin = 1e308"),
    "an axis nested 5,000 deep": ("[0.5, 0.6]", "[" * 5000 + "0.5" + "]" * 5000),
    "what is solved for, fixed": ("[over]", "[fixed]\nGamma = 1\n[over]"),
    "bytes that are no text": ("[over]", "[over] # \udcff"),
}
for _name, (_old, _new) in NOT_BORDERS.items():

    @attack(f"borders: {_name}")
    def _(scene: Scene, old: str = _old, new: str = _new) -> str:
        text = BORDERS.replace(old, new).replace("{out}", "atlas.nc")
        (scene.folder / "atlas.toml").write_bytes(text.encode(errors="surrogateescape"))
        before = scene.snapshot()
        code = ended(command(scene, "borders", "atlas.toml", *scene.rng.choice([(), ("--force",)])), 20)
        if code == 0 or not line_of(scene.told()):
            return f"FAILED: exit {code}: {scene.told()[-200:]}"
        return f"refused: {line_of(scene.told())[19:]}" if scene.snapshot() == before else "FAILED: it wrote"


@attack("killed: a picture or a movie that replaces another")
def _(scene: Scene) -> str:
    from PIL import Image

    option, name = scene.rng.choice([("--movie", "walk.gif"), ("--plot", "walk.png"), ("--plot", "walk.pdf")])
    path, neighbour = scene.folder / name, scene.folder / f"{name}.tmp"
    for each in (path, neighbour):
        each.write_text("precious")
    before = scene.snapshot()
    pid = command(scene, "simulate", "--periods", "4", option, name, "--force")
    ends = time.monotonic() + 60
    while time.monotonic() < ends and scene.snapshot() == before:  # until it begins to write
        time.sleep(0.0005)
    time.sleep(scene.rng.uniform(0, 0.3))
    scene.kill(pid)
    after = {file: digest for file, digest in scene.snapshot().items() if not file.startswith(".dimersweep-")}
    if before | {name: after.get(name)} != after:
        return "FAILED: what lay beside it was changed"
    written = path.read_bytes()
    if written == b"precious":
        return "same"
    if name.endswith(".pdf"):
        return "same" if written.rstrip().endswith(b"%%EOF") else "FAILED: half a file"
    with Image.open(path) as picture:  # raises where it is not whole
        for frame in range(getattr(picture, "n_frames", 1)):
            picture.seek(frame)
            picture.load()
    return "same"


@attack("a cube whose title is markup")
def _(scene: Scene) -> str:
    markup = "<img src=x onerror=alert(1)> <script>alert(1)</script> [a](javascript:alert(1))"
    scene.declare(scene.text.replace("a sweep to be attacked", markup))
    scene.complete()

    def shown() -> None:
        from dimersweep import open_cube
        from dimersweep.exploring.page import LivePage

        cube = open_cube(scene.cube)
        print(cube.dimersweep._repr_html_(), LivePage(cube).html().count(markup))

    code = ended(forked(shown, scene.folder / "told"))
    told = scene.told()
    live = "<img" in told or "<script" in told
    return (
        "same"
        if code == 0 and not live and told.count("&lt;img") == 1 and told.split()[-1] == "0"
        else f"FAILED: {told[-200:]}"
    )


# --- wild parameters ----------------------------------------------------------------------------------------------------

WILD = {
    "e": (0.0, 1.0),
    "Gamma": (1e-3, 50.0),
    "f": (1e-2, 1e4),
    "A_r": (2.0, 200.0),
    "mu": (0.0, 3.0),
    "beta0": (0.0, 1.57),
    "xdot0": (-1e3, 1e3),
    "r": (1e-5, 1.0),
    "g": (1e-3, 1e3),
}


@attack("wild parameters, for a second each")
def _(scene: Scene) -> str:
    chosen = {name: scene.rng.uniform(*limits) for name, limits in WILD.items()} | {"mu_s": 4.0, "D_r": 0.0}
    result = scene.folder / "told"

    def call() -> None:
        from dimersweep import simulate

        run = simulate(**chosen, periods=20, record=False, max_seconds=1.0)
        assert run.status == "ok" or run.mode == "failed", run

    code = ended(forked(call, result), 60)
    return "same" if code == 0 else f"FAILED: {chosen}: {result.read_text()[-300:]}"
