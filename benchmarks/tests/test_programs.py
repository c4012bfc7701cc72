"""Every program of the benchmarks can be started: what it takes from the package, and from its neighbours, is there."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOMS = ("speed", "evidence", "peers")
FOUND = {path.stem: path for room in ROOMS for path in sorted((Path(__file__).parents[1] / room).rglob("*.py"))}
# these change the compiler, and where its code is kept: a kernel of the process of the tests would be another one
ALONE = ("fusings",)


@pytest.mark.parametrize("name", [name for name in FOUND if name not in ALONE])
def test_a_program_finds_what_it_imports(name):
    if name in ("phases", "taylor"):
        pytest.importorskip("heyoka")
    before = dict(os.environ)
    import_module(name)
    assert os.environ == before, "a program that changes the process of all tests belongs to ALONE"


@pytest.mark.parametrize("name", ALONE)
def test_a_program_that_changes_its_process_finds_what_it_imports(name):
    started = [sys.executable, str(FOUND[name]), "--help"]
    done = subprocess.run(started, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
