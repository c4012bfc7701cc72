"""Leave out what needs the JIT when it is off, and mark cases between others."""

from itertools import groupby

import numba
import pytest


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their markers
def pytest_collection_modifyitems(items):
    """Where the JIT is off, skip tests marked ``jit``, which would take hours, and mark all cases but the ends of a test."""
    if not numba.config.DISABLE_JIT:
        return
    for item in items:
        if item.get_closest_marker("jit"):
            item.add_marker(pytest.mark.skip(reason="the JIT is off"))
    of_each_change = [item for item in items if not item.get_closest_marker("release")]
    for _, cases in groupby(of_each_change, key=lambda item: item.nodeid.partition("[")[0]):
        for case in list(cases)[1:-1]:
            case.add_marker("inner_case")
