"""Fixtures of the tests around the kernel."""

import pytest
from fakes import fake_run_many
from hypothesis import settings

settings.register_profile("unhurried", deadline=None)  # a machine may be busy
settings.load_profile("unhurried")


@pytest.fixture
def fake_kernel(monkeypatch):
    """Run sweeps on `fake_run_many`."""
    monkeypatch.setattr("dimersweep.tiles.run_many", fake_run_many)
