"""Special points of branches are where their multiplier is what it has to be."""

import numpy as np
import pytest

from dimersweep import orbits
from tests.checks.tables import multipliers


@pytest.mark.parametrize(
    ("kind", "begin", "to", "multiplier", "within"), [("fold", 0.8, 0.78, 1.0, 2e-5), ("flip", 1.25, 1.28, -1.0, 1e-6)]
)
def test_a_border_on_a_branch_has_its_multiplier(kind, begin, to, multiplier, within):
    """At a fold two multipliers meet, as the root of the distance: so they are known less well there."""
    branch = orbits.follow(orbits.find(spin=100.0, Gamma=begin), "Gamma", to=to, sequences=False)
    at = branch["special"].values == kind
    assert at.sum() == 1
    assert np.abs(multipliers(branch)[at] - multiplier).min() < within
