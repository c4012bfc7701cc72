"""The program with lines of it replaced, in a process of its own, uncompiled."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import dimersweep

PACKAGE = Path(dimersweep.__file__).parent


def run_patched(folder: Path, changes: Iterable[tuple[str, str, str]], run: str, told: str) -> str:
    """What is printed of `told`, in which `run` is a run of the package in which lines of files are replaced."""
    shutil.copytree(PACKAGE, folder / "dimersweep", ignore=shutil.ignore_patterns("__pycache__"))
    for name, line, other in changes:
        file = folder / "dimersweep" / name
        text = file.read_text()
        assert text.count(line) == 1, f"{name}: {line}"
        file.write_text(text.replace(line, other))
    script = f"from dimersweep import simulate\nrun = {run}\nprint({told})"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "DIMERSWEEP_OTHER_PHYSICS": "1", "PYTHONPATH": str(folder)}
    command = [sys.executable, "-W", "ignore", "-c", script]
    made = subprocess.run(command, check=False, env=environment, cwd=folder, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return made.stdout
