"""Moreau's time stepping converges, with order 1, to the engine's sustained contact."""

import numpy as np
import pytest

from .cases import STRETCHES, order, stretch_errors


@pytest.mark.parametrize("name", STRETCHES)
def test_time_stepping_converges_to_sustained_contact(name):
    steps = 2e-4 / 4.0 ** np.arange(4)
    errors = stretch_errors(STRETCHES[name], steps)
    assert errors[-1] < 2e-4
    assert order(steps, errors) == pytest.approx(1, abs=0.1)
