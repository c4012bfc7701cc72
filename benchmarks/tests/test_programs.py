"""Every program of the benchmarks can be started: what it takes from the package, and from its neighbours, is there."""

from importlib import import_module
from pathlib import Path

import pytest

ROOMS = ("speed", "evidence", "peers")
FOUND = [path.stem for room in ROOMS for path in sorted((Path(__file__).parents[1] / room).rglob("*.py"))]


@pytest.mark.parametrize("name", FOUND)
def test_a_program_finds_what_it_imports(name):
    if name in ("phases", "taylor"):
        pytest.importorskip("heyoka")
    import_module(name)
