"""Leave out what needs the JIT when it is off."""

import numba
import pytest


def pytest_collection_modifyitems(items):
    """Skip tests marked ``jit`` where the JIT is off: they would take hours."""
    if numba.config.DISABLE_JIT:
        for item in items:
            if item.get_closest_marker("jit"):
                item.add_marker(pytest.mark.skip(reason="the JIT is off"))
