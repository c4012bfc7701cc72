"""What is read off cubes against other programs and by hand: errors of exponents, edges of cells."""

import numpy as np
import pytest
from scipy.stats import linregress

from dimersweep.cubes.findings import edges_of, exponents
from tests.test_reading import cube_of


def test_the_error_of_an_exponent_is_that_of_a_straight_line():
    """Of few points, where the two numbers that a line takes count."""
    f = np.array([15.0, 17.0, 21.0, 30.0])
    radius = 0.1 * f**-2.1 * np.array([1.01, 0.97, 1.02, 0.99])
    law = exponents(cube_of("radius", radius, f=f))["f"]
    line = linregress(np.log(f), np.log(radius))
    assert law.exponent == pytest.approx(line.slope, rel=1e-9)
    assert law.error == pytest.approx(line.stderr, rel=1e-9)
    slopes = np.diff(np.log(radius)) / np.diff(np.log(f))
    assert (law.least, law.greatest) == pytest.approx((slopes.min(), slopes.max()))


@pytest.mark.parametrize(
    ("values", "edges"),
    [
        ([1, 2, 3], [0.5, 1.5, 2.5, 3.5]),
        ([1, 2, 4.5], [0.5, 1.5, 3.25, 5.75]),
        ([1, 2, 4], np.array([1, 2, 4, 8]) / np.sqrt(2)),
        ([1, 2, 4.1], [0.5, 1.5, 3.05, 5.15]),  # nearly in a fixed ratio
        ([4, 2, 1], np.array([8, 4, 2, 1]) / np.sqrt(2)),
        ([-1, 0, 1], [-1.5, -0.5, 0.5, 1.5]),
        ([3], [2.5, 3.5]),
    ],
)
def test_cells_end_half_way_between_points_and_as_far_beyond_the_last(values, edges):
    np.testing.assert_allclose(edges_of(np.array(values, float)), edges, rtol=1e-12)
