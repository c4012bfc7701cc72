"""The program with a change, in a process of its own."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import dimersweep

PACKAGE = Path(dimersweep.__file__).parent
UNCOMPILED = {"NUMBA_DISABLE_JIT": "1", "DIMERSWEEP_OTHER_PHYSICS": "1"}


def run_copy(folder: Path, script: Path | str, settings: Mapping[str, str] = UNCOMPILED) -> str:
    """What a script, or the text of one, prints that uses the copy of the package in a folder."""
    arguments = ["-c", script] if isinstance(script, str) else [str(script)]
    made = subprocess.run(
        [sys.executable, "-W", "ignore", *arguments],
        check=False,
        env=os.environ | {"PYTHONPATH": str(folder)} | settings,
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert made.returncode == 0, made.stderr
    return made.stdout


def copy_to(folder: Path) -> None:
    """A copy of the package in a folder."""
    shutil.copytree(PACKAGE, folder / "dimersweep")


def run_patched(folder: Path, changes: Iterable[tuple[str, str, str]], run: str, told: str) -> str:
    """What is printed of `told`, in which `run` is a run of the package in which lines of files are replaced.

    It is made without the proof of the kernel, which would take Python longer than the run, and say that it is another one.
    """
    copy_to(folder)
    for name, line, other in changes:
        file = folder / "dimersweep" / name
        text = file.read_text()
        assert text.count(line) == 1, f"{name}: {line}"
        file.write_text(text.replace(line, other))
    unproven = "from dimersweep.work.proving import PROVEN\nPROVEN.set()"
    return run_copy(folder, f"{unproven}\nfrom dimersweep import simulate\nrun = {run}\nprint({told})")


def touched(patch: str) -> set[str]:
    """The files that a patch changes or adds."""
    return set(re.findall(r"^\+\+\+ b/(\S+)$", patch, re.MULTILINE))


def apply(patch: Path, folder: Path) -> None:
    """Apply a patch to the copy of the package in a folder, all of it or nothing."""
    command = ["git", "apply", "--whitespace=nowarn", str(patch)]
    made = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
