"""Fixtures of the tests around the kernel."""

import pytest
from fakes import fake_run_many


@pytest.fixture
def fake_kernel(monkeypatch):
    """Run sweeps on `fake_run_many`."""
    monkeypatch.setattr("dimersweep.tiles.run_many", fake_run_many)
    monkeypatch.setattr("dimersweep.deciding.run_many", fake_run_many)
