"""Versions, ways to compile and places where the package runs, or refuses to: ``python benchmarks/evidence/matrix.py``.

Every row has a wheel made from this checkout, and answers the same scenes: the modes must be those of the first
row that passes, and the states the same to the accuracy asked for. A refusal is one line. Nothing may end by a signal, or print
a traceback. Rows of a Python that is not installed are left out. Each extra is installed alone, and does what it is for; so is
what each target of ``./go`` sets up.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile

import numpy as np

from tests.checks.alone import SMOKES

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "tests" / "kernel" / "ways.py"
OLDEST = str(ROOT / ".ci" / "oldest.txt")
ALLOWED = 1e-7  # difference of states, in their scales: the scenes are run with rtol = 1e-8
SECONDS = 3600  # a process that takes longer hangs
TOLD = (
    "import llvmlite, numba, numpy, platform; "
    "print(f'Python {platform.python_version()}', *(f'{m.__name__} {m.__version__}' for m in (numba, llvmlite, numpy)))"
)
# who may write nowhere, has no home, and is not known to the system
NOBODY = (
    "import os, pwd, runpy, sys\n"
    "def unknown(uid): raise KeyError(uid)\n"
    "pwd.getpwuid = unknown\n"
    "sys.argv = sys.argv[1:]\n"
    "runpy.run_path(sys.argv[0], run_name='__main__')\n"
)


class Row(NamedTuple):
    """One row of the table."""

    name: str
    packages: tuple[
        str, ...
    ] = ()  # asked of pip, with what they need; they are put before those of the newest versions
    constraints: str = ""  # a file of versions for an environment of its own
    python: str = ""  # version; that of this process by default
    settings: tuple[tuple[str, str], ...] = ()  # of the environment
    place: str = ""
    refused: str = ""  # words of the line that refuses
    zarr: bool = False  # whether a Zarr group is opened too
    extra: str | None = None  # installed alone, in an environment of its own, and tried
    target: str = ""  # of ./go, in an environment of its own


PARTS = {
    "versions": (
        Row("oldest of everything", constraints=OLDEST, python="3.11"),
        *(Row(f"newest of everything, {python}", python=python) for python in ("3.11", "3.12", "3.13")),
        *(
            Row(f"numba {number}", (f"numba=={number}",))
            for number in ("0.62.1", "0.63.1", "0.64.0", "0.65.1", "0.66.0", "0.67.0", "0.68.0")
        ),
    ),
    "ways": (
        Row("plain", settings=(("DIMERSWEEP_COMPILER", "plain"),)),
        Row("plain, oldest of everything", (), OLDEST, "3.11", (("DIMERSWEEP_COMPILER", "plain"),)),
        Row("JIT off", settings=(("NUMBA_DISABLE_JIT", "1"),)),
        Row("code for any processor", settings=(("NUMBA_CPU_NAME", "generic"),)),
    ),
    "places": (
        Row("read-only home", place="read-only home"),
        Row("nothing can be written, nobody's home", place="nothing can be written"),
        Row("three first starts at once", place="three at once"),
    ),
    "refusals": (
        Row(
            "a compiler that there is not",
            settings=(("DIMERSWEEP_COMPILER", "quick"),),
            refused="must be fast or plain",
        ),
        Row("a numpy that numba refuses", ("--no-deps", "numba==0.62.1", "llvmlite==0.45.1"), refused="NumPy"),
        Row("zarr 3.0", ("zarr==3.0.10",), refused="must be >= 3.1", zarr=True),
    ),
    "extras": tuple(Row(f"{extra or 'none'} alone", extra=extra) for extra in SMOKES),
    "targets": (
        Row("./go fig07", target="fig07"),
        Row("./go docs", target="docs"),
    ),
}
# the suite tries places where little can be written, and the plain way of compiling where DIMERSWEEP_SLOW is set
SMALL = ("versions: oldest of everything", "refusals: a compiler that there is not")


class Outcome(NamedTuple):
    """What came out of a process: its exit status and what it printed."""

    code: int
    printed: str
    errors: str

    @property
    def fault(self) -> str:
        """What must never be, or nothing."""
        if self.code < 0:
            return f"ended by signal {-self.code}"
        if "Traceback" in self.errors:
            return f"a traceback: {self.errors.strip().splitlines()[-1]}"
        return "" if self.code in (0, 2) else f"exit status {self.code}"


def interpreter(version: str) -> str | None:
    """A Python of that version, if there is one."""
    if version in ("", f"{sys.version_info[0]}.{sys.version_info[1]}"):
        return sys.executable
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found = sorted(pyenv.glob(f"{version}.*/bin/python"))
    return str(found[-1]) if found else shutil.which(f"python{version}")


def run(command: list[str], folder: Path, **settings: str) -> Outcome:
    """Run a command in an environment that knows nothing of this process's own, in `folder`."""
    inherited = {
        name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "DIMERSWEEP_", "PYTHON"))
    }
    inherited.pop("XDG_CACHE_HOME", None)
    done = subprocess.run(
        command, env=inherited | settings, cwd=folder, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def pip(python: Path, *asked: str) -> None:
    """Have pip of an environment install what is asked.

    Raises
    ------
    SystemExit
        If it cannot, with its last line.
    """
    done = run([str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", *asked], ROOT)
    if done.code:
        raise SystemExit(done.errors.strip().splitlines()[-1])


def environment_of(row: Row, wheel: Path, folder: Path) -> tuple[Path, dict[str, str]]:
    """The Python of a row, and what puts its packages before the others; rows that ask alike share what is in `folder`.

    What an earlier call has left there is brought to what is asked now.
    """
    base = interpreter(row.python)
    assert base is not None
    like_this = not (row.python or row.constraints)  # then the packages of this process serve
    home = folder / ("here" if like_this else f"{row.python}-{Path(row.constraints).stem or 'newest'}")
    python = home / "bin" / "python"
    if not home.exists():
        subprocess.run([base, "-m", "venv", *(["--without-pip"] if like_this else []), str(home)], check=True)
    if not like_this:
        pip(python, "-U", "--upgrade-strategy=eager", str(wheel), *(("-c", row.constraints) if row.constraints else ()))
    (own,) = home.glob("lib/python*/site-packages")
    if like_this:
        (own / "packages.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    shutil.rmtree(own / "dimersweep", ignore_errors=True)  # of an earlier checkout
    ZipFile(wheel).extractall(own)
    if not row.packages:
        return python, {}
    before = folder / "-".join(name.strip("-") for name in row.packages)
    if not before.exists():
        pip(Path(sys.executable), "--target", str(before), *row.packages)
    return python, {"PYTHONPATH": str(before)}


def judged_alone(row: Row, wheel: Path, folder: Path) -> str:
    """The verdict on an extra, or on a target of ``./go``: whether all that it needs comes with it."""
    if row.target:
        asked = [str(ROOT / "go"), row.target, *(["--out", str(folder / "cube.nc")] if row.target == "fig07" else [])]
        done = run(asked, ROOT, DIMERSWEEP_VENV=str(folder / "venv"))
    else:
        assert row.extra is not None
        python = folder / "venv" / "bin" / "python"
        subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
        pip(python, f"{wheel}[{row.extra}]" if row.extra else str(wheel))
        done = run([str(python), "-c", SMOKES[row.extra]], folder)
    return f"FAIL: {done.errors.strip().splitlines()[-1]}" if done.code else "pass"


def bare(command: list[str]) -> list[str]:
    """A command without the rights of an administrator, who may write anywhere."""
    setpriv = shutil.which("setpriv")
    return [setpriv, "--bounding-set", "-all", *command] if setpriv and os.getuid() == 0 else command


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Let nobody write in a folder, or in those below it."""
    paths = [folder, *folder.rglob("*")]
    for path in paths:
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        yield
    finally:
        for path in paths:
            path.chmod(path.stat().st_mode | 0o200)


def started(row: Row, python: Path, folder: Path, settings: dict[str, str]) -> list[Outcome]:
    """Run the scenes as the row says; the answers lie in `folder`."""
    command = [str(python), str(SCENES), str(folder / "answers.npz")]
    if row.place == "three at once":
        with ThreadPoolExecutor() as pool:
            commands = [[*command[:2], str(folder / f"answers-{k}.npz")] for k in range(3)]
            return list(pool.map(lambda each: run(each, folder, **settings), commands))
    if row.place == "read-only home":
        with read_only(Path(settings["HOME"])):
            return [run(bare(command), folder, **settings)]
    if row.place == "nothing can be written":
        (folder / "file").touch()  # no folder can be made below it, by whomever
        nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "TMPDIR"), str(folder / "file" / "below")) | {"HOME": ""}
        with read_only(next(python.parents[1].glob("lib/python*/site-packages/dimersweep"))):
            return [run(bare([command[0], "-c", NOBODY, *command[1:]]), folder, **settings | nowhere)]
    return [run(command, folder, **settings)]


def command_line(row: Row, python: Path, folder: Path, settings: dict[str, str]) -> Outcome:
    """Ask the command line for a short run or, where the row says so, to open a Zarr group."""
    (folder / "cube.zarr").mkdir()
    asked = ("status", "cube.zarr") if row.zarr else ("simulate", "--periods", "5")
    return run([str(python), "-m", "dimersweep", *asked], folder, **settings)


def difference(folder: Path, reference: dict[str, np.ndarray]) -> str:
    """How the answers in `folder` differ from the first ones, which they become if there are none yet."""
    for file in sorted(folder.glob("answers*.npz")):
        found = dict(np.load(file))
        reference.update(reference or found)
        if (found["codes"] != reference["codes"]).any():
            return "other modes"
        apart = float(np.abs(found["states"] - reference["states"]).max())
        if not apart < ALLOWED:
            return f"states differ by {apart:.1e}"
    return ""


def judged(row: Row, python: Path, folder: Path, settings: dict[str, str], reference: dict[str, np.ndarray]) -> str:
    """The verdict on a row: pass, refused with the line, or FAIL with the reason."""
    settings = settings | {"HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp")} | dict(row.settings)
    (folder / "home").mkdir()
    (folder / "tmp").mkdir()
    if row.refused:
        told = command_line(row, python, folder, settings)
        lines = told.errors.strip().splitlines()
        if told.fault or told.code != 2 or len(lines) != 1 or row.refused not in lines[0]:
            return f"FAIL: {told.fault or 'no clear refusal: ' + ' '.join(lines)[-120:]}"
        return f"refused: {lines[0].removeprefix('dimersweep: error: ')}"
    outcomes = started(row, python, folder, settings)
    if not row.place:
        outcomes.append(command_line(row, python, folder, settings))
    for outcome in outcomes:
        if outcome.fault or outcome.code:
            return f"FAIL: {outcome.fault or outcome.errors.strip().splitlines()[-1]}"
    fault = difference(folder, reference)
    return f"FAIL: {fault}" if fault else "pass"


def main(arguments: list[str] | None = None) -> int:
    """Print the table; the number of rows that fail."""
    rows = {f"{part}: {row.name}": row for part, group in PARTS.items() for row in group}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--rows", nargs="+", choices=list(rows), metavar="ROW", help="rows, by 'part: name'")
    parser.add_argument("--small", action="store_true", help="the rows that take two minutes")
    parser.add_argument("--folder", type=Path, help="where environments are made and kept; by default they are deleted")
    given = parser.parse_args(arguments)
    chosen = SMALL if given.small else given.rows or [name for name in rows if name.partition(":")[0] in given.parts]
    failed, reference = 0, {}
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", scratch, str(ROOT)], check=True)
        (wheel,) = Path(scratch).glob("*.whl")
        for k, name in enumerate(chosen):
            row = rows[name]
            if interpreter(row.python) is None:
                print(f"{name:45s} left out: no Python {row.python}")
                continue
            folder = Path(scratch, str(k))
            folder.mkdir()
            if row.target or row.extra is not None:
                verdict = judged_alone(row, wheel, folder)
                print(f"{name:45s} {'-':65s} {verdict}", flush=True)
                failed += verdict.startswith("FAIL")
                continue
            python, settings = environment_of(row, wheel, (given.folder or Path(scratch)).absolute())
            versions = run([str(python), "-c", TOLD], folder, **settings).printed.strip()
            verdict = judged(row, python, folder, settings, reference)
            print(f"{name:45s} {versions or '-':65s} {verdict}", flush=True)
            failed += verdict.startswith("FAIL")
    return failed


if __name__ == "__main__":
    sys.exit(main())
