"""The attacks of ``faults.py``: each damages a scene, which is then judged, or gives its own verdict."""

import json
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
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


@attack("killed: while it writes NetCDF")
def _(scene: Scene) -> None:
    killed_when(scene, (scene.tiles / "cube.tmp").exists)


@attack("killed: while it writes Zarr")
def _(scene: Scene) -> None:
    as_zarr(scene)
    killed_when(scene, (scene.tiles / "cube.tmp").exists)


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


VANISHING: dict[str, Callable[[Scene], Any]] = {
    "the folder of tiles is": lambda scene: shutil.rmtree(scene.tiles),
    "the manifest is": lambda scene: scene.manifest.unlink(),
    "the lock is": lambda scene: (scene.tiles / "lock").unlink(),
    "tiles are": lambda scene: [path.unlink() for path in scene.tiles.glob("tiles-*.npy")],
}
for _name, _remove in VANISHING.items():

    @attack(f"{_name} removed while it runs")
    def _(scene: Scene, remove: Callable[[Scene], Any] = _remove) -> str | None:
        return during(scene, lambda: remove(scene))


@attack("the folder of tiles is renamed while it runs")
def _(scene: Scene) -> str | None:
    wrong = during(scene, lambda: scene.tiles.rename(scene.folder / "moved"))
    if (scene.folder / "moved").exists():  # ours to tidy: it was moved by the user
        shutil.rmtree(scene.folder / "moved")
    return wrong


def a_tile(scene: Scene) -> Path:
    """One of the files of results that were left behind."""
    return scene.rng.choice(sorted(scene.tiles.glob("tiles-*.npy")))


BEGUN: dict[str, Callable[[Scene], Any]] = {  # what is done to a sweep that has begun
    "a tile is removed": lambda scene: a_tile(scene).unlink(),
    "all tiles are removed": lambda scene: [path.unlink() for path in scene.tiles.glob("tiles-*.npy")],
    "the manifest is removed": lambda scene: scene.manifest.unlink(),
    "a lock that names another host": lambda scene: (scene.tiles / "lock").write_text(
        json.dumps({"pid": 1, "host": f"not-{socket.gethostname()}", "since": "2001"})
    ),
    "a bit is flipped in a tile": lambda scene: flip(a_tile(scene), scene.rng),
    "a bit is flipped in the manifest": lambda scene: flip(scene.manifest, scene.rng),
    "a bit is flipped in the lock": lambda scene: flip(scene.tiles / "lock", scene.rng),
    "the end is cut from a tile": lambda scene: cut(a_tile(scene), scene.rng),
    "the end is cut from the manifest": lambda scene: cut(scene.manifest, scene.rng),
    "the end is cut from the lock": lambda scene: cut(scene.tiles / "lock", scene.rng),
}
for _name, _change in BEGUN.items():

    @attack(_name)
    def _(scene: Scene, change: Callable[[Scene], Any] = _change) -> None:
        scene.begin()
        change(scene)


@attack("the finished cube is removed")
def _(scene: Scene) -> None:
    scene.run("--keep-tiles")
    scene.cube.unlink()


@attack("a file in place of the folder of tiles")
def _(scene: Scene) -> None:
    scene.tiles.write_text("precious")


@attack("a link in place of the folder of tiles")
def _(scene: Scene) -> None:
    scene.tiles.symlink_to("mine")


@attack("links among the tiles")
def _(scene: Scene) -> None:
    scene.begin()
    path = scene.tiles / scene.rng.choice(["lock", "manifest.jsonl", "cube.tmp", "tiles-000002.npy"])
    path.unlink(missing_ok=True)
    path.symlink_to(scene.folder / "mine" / "notes.txt")


# --- flips, cuts and swaps ----------------------------------------------------------------------------------------------


def a_chunk(scene: Scene) -> Path:
    """One of the files of numbers of a Zarr cube."""
    return scene.rng.choice(sorted(path for path in scene.cube.rglob("c/**/*") if path.is_file()))


def flip(path: Path, rng: random.Random, start: int = 0) -> None:
    """Turn one bit over."""
    written = bytearray(path.read_bytes())
    written[rng.randrange(min(start, len(written) - 1), len(written))] ^= 1 << rng.randrange(8)
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


@attack("a digit is changed in the head of the manifest")
def _(scene: Scene) -> None:
    scene.begin()
    text = scene.manifest.read_text()
    places = [k for k, letter in enumerate(text.partition("\n")[0]) if letter.isdigit()]
    at = scene.rng.choice(places)
    scene.manifest.write_text(text[:at] + str((int(text[at]) + scene.rng.randrange(1, 10)) % 10) + text[at + 1 :])


def listed(scene: Scene) -> list[dict[str, Any]]:
    """What the lines of the manifest tell."""
    lines = [json.loads(line) for line in scene.manifest.read_text().splitlines()]
    return [{name: value for name, value in line.items() if name != "check"} for line in lines]


def list_anew(scene: Scene, lines: list[dict[str, Any]]) -> None:
    """Write the manifest with true checksums."""
    from dimersweep.storage.manifest import as_line

    scene.manifest.write_bytes(b"".join(map(as_line, lines)))


@attack("the head of the manifest is forged: its configuration")
def _(scene: Scene) -> None:
    scene.begin()
    head, *rest = listed(scene)
    told = scene.rng.choice([[], None, 3, {}, {"grid": None}, head["configuration"] | {"fixed": None}])
    digest = sha256(json.dumps(told).encode()).hexdigest()
    list_anew(scene, [head | {"configuration": told, "configuration_sha256": digest}, *rest])


FORGERIES = (
    {"file": "../../mine/notes.txt"},
    {"tiles": [[0, 10**9]]},
    {"tiles": [[-5, 5]]},
    {"tiles": "all"},
    {"modes": {"rest": -1}},
    {"modes": 3},
    {"size": -1},
    {"seconds": "x"},
    {"time": "yesterday"},
    {"sha256": ""},
    {"more": 1},
)


LINES: dict[str, Callable[..., list[dict[str, Any]]]] = {  # of the manifest, with true checksums
    "the head of the manifest is forged: its points": lambda rng, head, *rest: [
        head | {"points": rng.choice([1, 20, 10**15, -3, 0, "120"])},
        *rest,
    ],
    "a line of the manifest is forged": lambda rng, head, first, *rest: [head, first | rng.choice(FORGERIES), *rest],
    "a line of the manifest is there twice": lambda rng, head, first, *rest: [head, first, first, *rest],
    "the lines of the manifest are in another order": lambda rng, head, *rest: [head, *rng.sample(rest, len(rest))],
}
for _name, _lines in LINES.items():

    @attack(_name)
    def _(scene: Scene, lines: Callable[..., list[dict[str, Any]]] = _lines) -> None:
        scene.begin()
        list_anew(scene, lines(scene.rng, *listed(scene)))


@attack("two tiles are swapped")
def _(scene: Scene) -> None:
    scene.begin()
    one, other = a_tile(scene), a_tile(scene)
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


@attack("tiles of another sweep")
def _(scene: Scene) -> None:
    scene.declare(scene.text.replace("xdot0 = 1", "xdot0 = 2"))
    scene.begin()
    scene.declare()


@attack("rubbish in the folder of tiles")
def _(scene: Scene) -> None:
    scene.begin()
    for name in ("tiles-999999.npy", "tiles-x.npy", "cube.tmp", "manifest.jsonl.tmp", "tiles-000009.npy.tmp"):
        (scene.tiles / name).write_bytes(scene.rng.randbytes(100))
    scene.again = ()


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
    while not (scene.tiles / "lock").exists() and time.monotonic() < ends:
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
    head, *rest = listed(scene)
    when = scene.rng.choice(["2999-01-01T00:00:00+00:00", "1970-01-01T00:00:00+00:00"])
    list_anew(scene, [head, *(line | {"time": when} for line in rest)])
    for path in (scene.manifest, *scene.tiles.glob("*.npy")):
        os.utime(path, (4e9, 4e9))
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
        from dimersweep.work.proving import proof

        proof.cache_clear()
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

    return with_kernel(scene, "runs.settings", ceases)


@attack("points that cannot be run")
def _(scene: Scene) -> str | None:
    from dimersweep.kernel.batch import run_many
    from dimersweep.kernel.model.layout import ROW_BETA0

    bad = scene.rng.uniform(0.1, 1.4)

    def some(rows: Any, *rest: Any, **more: Any) -> int:
        return raising() if (abs(rows[:, ROW_BETA0] - bad) < 0.04).any() else run_many(rows, *rest, **more)

    return with_kernel(scene, "runs.settings", some)


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
        from dimersweep.exploring.board import Board

        cube = open_cube(scene.cube)
        print(cube.dimersweep._repr_html_(), *(pane.object for pane in Board(cube).layout().select(HTML)))

    try:
        from panel.pane import HTML
    except ImportError:
        raise Skipped("panel is not installed") from None
    code = ended(forked(shown, scene.folder / "told"))
    told = scene.told()
    live = "<img" in told or "<script" in told
    return "same" if code == 0 and not live and told.count("&lt;img") == 2 else f"FAILED: {told[-200:]}"


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
