"""Fixtures of the tests around the kernel."""

import signal

import pytest
from hypothesis import settings

from tests.fakes import fake_run_many

settings.register_profile("unhurried", deadline=None)  # a machine may be busy
settings.load_profile("unhurried")
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts its background jobs with Ctrl-C ignored


@pytest.fixture
def fake_kernel(monkeypatch):
    """Run sweeps on `fake_run_many`."""
    monkeypatch.setattr("dimersweep.work.tiles.run_many", fake_run_many)


def pytest_collection_modifyitems(items):
    """Begin with the files that hold a slow test, so that no process is left alone with one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
