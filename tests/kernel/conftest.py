"""Make what the tests around the kernel share importable; leave out what needs the JIT when it is off."""

import sys
from pathlib import Path

import numba
import pytest

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent, HERE.parents[1] / "benchmarks"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))


def pytest_collection_modifyitems(items):
    """Skip tests marked ``jit`` where the JIT is off: they would take hours."""
    if numba.config.DISABLE_JIT:
        for item in items:
            if item.get_closest_marker("jit"):
                item.add_marker(pytest.mark.skip(reason="the JIT is off"))
