"""Derivatives of the return map: a change of the start in any direction goes over into that of the end."""

import numpy as np
import pytest

from dimersweep import orbits, simulate
from dimersweep.runs.growth import multipliers
from dimersweep.runs.period_map import NAMES, Section


@pytest.fixture(scope="module")
def run():
    return simulate(periods=200, rtol=1e-10)


def test_the_matrix_of_multipliers_maps_a_change_of_the_start(run):
    """By differences of the whole map along directions that mix the coordinates."""
    found = multipliers(run)
    free = [NAMES.index(name) for name in found.coordinates]
    record = run.record("the test")
    section = Section(record.row, 1e-11)
    last = record.segments[-1]
    state, modes = last[:16].copy(), last[16:18].copy()
    point = section.point(state)
    assert (np.diff(np.abs(found.values)) <= 0).all()  # the largest first
    np.testing.assert_allclose(np.prod(found.values), np.linalg.det(found.matrix), atol=1e-12)
    assert np.abs(found.matrix - found.matrix.T).max() > 0.1  # rows and columns are told apart
    for seed in range(3):
        way = np.zeros(len(NAMES))
        way[free] = np.random.default_rng(seed).normal(size=len(free))
        step = 2e-5
        ends = [section.after(section.held(section.state(point + by * way), modes), 1)[0] for by in (step, -step)]
        change = (ends[0] - ends[1])[free] / (2 * step)
        np.testing.assert_allclose(found.matrix @ way[free], change, atol=1e-3)


def test_the_derivatives_of_an_orbit_map_a_change_of_its_point():
    fixed = orbits.find(spin=100.0).fixed
    m, z = fixed.map, fixed.z
    assert np.abs(fixed.matrix - fixed.matrix.T).max() > 0.1
    for seed in range(3):
        way, step = np.random.default_rng(seed).normal(size=z.size), 2e-5
        ahead, back = m.image(z + step * way), m.image(z - step * way)
        np.testing.assert_allclose(fixed.matrix @ way, (ahead.point - back.point) / (2 * step), atol=1e-3)
        assert fixed.gradient @ way == pytest.approx((ahead.spin - back.spin) / m.unit / (2 * step), abs=1e-3)
