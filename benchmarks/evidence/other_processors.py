"""Whether this machine gives the bits that all others do: ``python benchmarks/evidence/other_processors.py``.

Compared are 720 runs of all lengths and accuracies (those of ``same_bits.py``), 200 random scenes of the whole model, 3,000
states between events, and 60 maps of a forcing period. The runs are compared with the file that is the promise of this version
of the arithmetic, ``tests/data/results.txt``.

``--write FILE`` keeps all that this machine gives, and ``--compare FILE ...`` compares files of several machines. Please send
a file of a machine that the page of limits does not name.

``--relay PYTHON`` has a sweep begun by another interpreter, such as one with another Numba, stopped there as by Ctrl-C after
a third of its points, gone on with here, stopped, and ended here, or in the ``--root``: the cube must be that of one that was
never stopped.

``--root FOLDER`` does both for a system for arm64 in a folder, which is emulated. On Debian, as root, in half an hour:

    apt-get install qemu-user-static debootstrap
    debootstrap --foreign --variant=minbase --arch=arm64 --include=python3,libstdc++6 bookworm FOLDER
    for each in FOLDER/var/cache/apt/archives/*.deb; do dpkg -x $each FOLDER; done
    pip download -d wheels --only-binary=:all: --python-version 3.11 --platform manylinux_2_28_aarch64 \\
        --platform manylinux_2_27_aarch64 --platform manylinux2014_aarch64 numba scipy xarray netCDF4 'dask[distributed]' \\
        matplotlib pydantic typer rich
    for each in wheels/*.whl; do unzip -qo $each -d FOLDER/opt/site; done
    cp /usr/bin/qemu-aarch64-static FOLDER/usr/bin; mkdir -p FOLDER/proc; mount --bind /proc FOLDER/proc
"""

import argparse
import hashlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PROMISE = ROOT / "tests" / "data" / "results.txt"
SEED = 55
SCENES, SCENE_PERIODS = 200, 40
RECORDED, STATES = 30, 100  # runs, and times of each
MAPS = 60
RTOL = 1e-8
THIRD = 110  # points of 330

Lines = dict[str, str]


def told(rows: np.ndarray, codes: np.ndarray, values: np.ndarray) -> str:
    """Return a result in words: a checksum of what was asked, whole numbers, and the bits of others, ``-`` for none."""
    asked = hashlib.sha256(np.asarray(rows, "<f8").tobytes()).hexdigest()[:8]
    flat = np.asarray(values, ">f8").ravel()
    bits = ["-" if np.isnan(each) and each.tobytes() == NAN else each.tobytes().hex() for each in flat]
    return f"{asked} | {' '.join(map(str, np.ravel(codes).tolist()))} | {' '.join(bits)}"


NAN = np.array([np.nan], ">f8").tobytes()


def runs(count: int = 720, first: int = 720) -> Iterator[tuple[str, str]]:
    """Yield the first few of the runs by their names."""
    from dimersweep.cubes.cube import blank
    from dimersweep.kernel.batch import run_many
    from dimersweep.parameters import Parameters
    from tests.checks.questions import questions

    for k, question in enumerate(questions(count)[:first]):
        scene = dict(question["scene"])
        periods, rtol, settle = (scene.pop(name) for name in ("periods", "rtol", "stop_when_settled"))
        scene.pop("record")
        rows, (out, codes) = Parameters(**scene).row()[None], blank(1)
        run_many(rows, periods, rtol, settle, out, codes)
        yield f"run {k}", told(np.append(rows, [periods, rtol, settle]), codes, out)


def scenes() -> Iterator[tuple[str, str]]:
    """Yield the scenes of the whole model, half of them far from the base case."""
    from dimersweep.cubes.cube import blank
    from dimersweep.kernel.batch import run_many
    from tests.checks.random_scenes import rows_of

    rows = np.vstack([rows_of(block, SCENES // 2, SEED, "whole") for block in (0, 1)])
    out, codes = blank(len(rows))
    run_many(rows, SCENE_PERIODS, RTOL, False, out, codes)
    for k in range(len(rows)):
        yield f"scene {k}", told(rows[k], codes[k], out[k])


def states() -> Iterator[tuple[str, str]]:
    """Yield states between the events of recorded runs."""
    from dimersweep import simulate
    from dimersweep.errors import ParameterError
    from tests.checks.random_scenes import parameters_of, rows_of

    rows = np.vstack([rows_of(0, RECORDED, SEED + 1, domain) for domain in ("near", "whole")])[::2]
    for k, row in enumerate(rows):
        run = simulate(**parameters_of(row), periods=20)
        times = np.arange(STATES) * (run.duration / STATES)
        try:
            found = run.states(times)
        except (ParameterError, RuntimeError) as error:
            yield f"states {k}", str(error)
            continue
        table = np.array([each.values for each in found.data_vars.values() if each.dtype == float])
        for j in range(STATES):
            yield f"state {k}.{j}", told(np.append(row, times[j]), np.zeros(0, int), table[:, j])


def maps() -> Iterator[tuple[str, str]]:
    """Yield what a forcing period makes of the states in which runs near the base case end."""
    from dimersweep.cubes.cube import blank
    from dimersweep.kernel.batch import N_START, run_request, run_rows
    from dimersweep.kernel.course import new_workspace
    from dimersweep.kernel.record import no_record
    from dimersweep.runs.period_map import Section
    from tests.checks.random_scenes import rows_of

    for k, row in enumerate(rows_of(2, MAPS, SEED, "near")):
        space, (out, codes) = new_workspace(), blank(1)
        run_rows(row[None], np.zeros((0, N_START)), run_request(60, RTOL), 0, out, codes, space, no_record())
        section = Section(row, RTOL)
        points, modes = [section.point(space.state)], space.modes.copy()
        for _ in range(2):
            point, modes = section.after(section.state(points[-1], modes), 1)
            points.append(point)
        yield f"map {k}", told(row, modes.astype(int), np.array(points))


KINDS: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
    "runs": runs,
    "scenes": scenes,
    "states": states,
    "maps": maps,
}


def machine() -> str:
    """Return the processor, and what makes code for it."""
    from dimersweep.kernel.compiler.pipelines import pipeline
    from dimersweep.kernel.compiler.versions import compiler

    made = compiler(pipeline())
    versions = ", ".join(f"{name} {made[name]}" for name in ("python", "numba", "llvmlite", "numpy"))
    return (
        f"{platform.system()} {platform.machine()}, {versions}, {made['way']} way, code for {made['target'].split()[0]}"
    )


def read(file: Path) -> tuple[str, Lines]:
    """Return of which machine a file is, and its results."""
    first, *others = file.read_text().splitlines()
    return first.removeprefix("# "), dict(line.split(": ", 1) for line in others if line)


def write(file: Path, about: str, lines: Lines) -> None:
    """Keep results."""
    file.write_text("\n".join([f"# {about}", *(f"{name}: {each}" for name, each in lines.items())]) + "\n")


def compare(one: Lines, other: Lines) -> Iterator[str]:
    """Yield how many results of each kind are the same, bit for bit, in their whole numbers, and in what was asked."""
    for kind in dict.fromkeys(name.split()[0] for name in one):
        names = [name for name in one if name.split()[0] == kind and name in other]
        pairs = [(one[name].split(" | "), other[name].split(" | ")) for name in names]
        same = [sum(a[:k] == b[:k] for a, b in pairs) for k in (3, 2, 1)]
        yield f"{kind}s: {same[0]} of {len(names)} the same bits, {same[1]} the same codes, {same[2]} the same scenes"


# sweep that several machines make in turn
RELAY = {"Gamma": [0.5, 0.9, 1.2], "beta0": {"start": 0.2, "stop": 80, "num": 110, "unit": "deg"}}


def leg(file: Path, points: int) -> None:
    """Make a sweep, or go on with it, and stop it as Ctrl-C does when so many points more are there; 0: to its end."""
    from dimersweep import sweep
    from dimersweep.runs import solving

    signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell takes from what it runs in the background
    run_many, done = solving.run_many, 0

    def counting(rows: np.ndarray, *rest: object, **how: object) -> int:
        nonlocal done
        made = run_many(rows, *rest, **how)
        time.sleep(0.02 * made)  # so that tasks are short
        done += made
        if done - made < points <= done:
            os.kill(os.getpid(), signal.SIGINT)
        return made

    solving.run_many = counting
    print(f"  {machine()}: ", end="", flush=True)
    try:
        cube = sweep(RELAY, {"mu": 0.15}, periods=50, out=file, workers=1, progress=False)
    except KeyboardInterrupt as stop:
        print(f"stopped, {str(stop).partition(' in ')[0]}", flush=True)
        return
    values = b"".join(str(name).encode() + cube[name].values.tobytes() for name in sorted(cube.variables))
    print(f"{done} points, and the cube is there: {hashlib.sha256(values).hexdigest()[:16]}", flush=True)


def last_word(command: list[str], file: Path, points: int) -> str:
    """Return the last word of what a `leg` in a process of its own prints, which is printed here as well."""
    done = subprocess.run([*command, "--leg", str(file), str(points)], check=True, stdout=subprocess.PIPE, text=True)
    print(done.stdout, end="", flush=True)
    return done.stdout.split()[-1]


def relay(python: str, root: Path | None) -> bool:
    """Return whether a sweep that machines have made by turns is that of one that was never stopped."""
    here = [sys.executable, __file__]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "relay.nc")
        alone = last_word(here, Path(folder, "alone.nc"), 0)
        last_word([python, __file__], file, THIRD)
        last_word(here, file, THIRD)
        if root:
            for each in file.parent.glob("relay.nc*"):
                shutil.copy(each, root / "tmp")
            here, file = emulation(root), Path("/tmp/relay.nc")
        same = last_word(here, file, 0) == alone
    print("the same cube" if same else "another cube")
    return same


def emulation(folder: Path) -> list[str]:
    """Return the command that calls this program in a system for arm64 in a folder, to which the sources are copied."""
    inside = folder / "opt" / "dimersweep"
    shutil.rmtree(inside, ignore_errors=True)
    shutil.copytree(ROOT, inside, ignore=shutil.ignore_patterns(".*", "__pycache__"))
    variables = ["PYTHONPATH=/opt/dimersweep:/opt/site", "NUMBA_CACHE_DIR=/tmp/numba", "HOME=/tmp"]
    python = [
        "/usr/bin/qemu-aarch64-static",
        *(word for each in variables for word in ("-E", each)),
        "/usr/bin/python3",
    ]
    return ["chroot", str(folder), *python, f"/opt/dimersweep/{Path(__file__).resolve().relative_to(ROOT)}"]


def emulated(folder: Path, file: Path) -> None:
    """Write the results of a system for arm64 in a folder."""
    subprocess.run([*emulation(folder), "--write", "/tmp/results.txt"], check=True)
    shutil.copy(folder / "tmp" / "results.txt", file)


def main() -> None:
    """Compare, and end with 1 where any bit differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, metavar="FILE")
    parser.add_argument("--compare", type=Path, nargs="+", default=[], metavar="FILE")
    parser.add_argument("--root", type=Path, metavar="FOLDER")
    parser.add_argument("--relay", metavar="PYTHON")
    parser.add_argument("--leg", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    given = parser.parse_args()
    sys.path[:0] = [str(ROOT)]
    if given.leg:
        leg(Path(given.leg[0]), int(given.leg[1]))
        return
    if given.relay:
        sys.exit(not relay(given.relay, given.root))
    found = [read(file) for file in given.compare]
    if given.root:
        file = given.root / "tmp" / "of_arm64.txt"
        emulated(given.root, file)
        found.append(read(file))
    if not given.compare or given.root or given.write:
        here = machine(), dict(line for kind in given.kinds for line in KINDS[kind]())
        found.insert(0, here)
        if given.write:
            write(given.write, *here)
    others = found[1:] if len(found) > 1 else [read(PROMISE)] if PROMISE.exists() and not given.write else []
    print(found[0][0])
    alike = True
    for about, lines in others:
        print(f"and {about}")
        for line in compare(found[0][1], lines):
            print("  " + line)
        alike &= all(found[0][1][name] == lines[name] for name in found[0][1].keys() & lines.keys())
    sys.exit(not alike)


if __name__ == "__main__":
    main()
