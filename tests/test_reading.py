"""What is read off a cube: known curves, laws, valleys and circles come back."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import linregress

from dimersweep.cubes.findings import boundary, circle_through, edges_of, exponents, minimum, runs_of, stick_ratio
from dimersweep.cubes.results import blank_results
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import M_DRIFT, M_REST
from dimersweep.studies.deciding import A_NO, A_YES
from dimersweep.studies.search import study_of
from tests.checks.cubes import radii


def test_the_boundary_runs_half_way_between_points_that_differ():
    axes = {"e": np.linspace(0.4, 0.8, 9), "Gamma": np.linspace(0.5, 1.5, 41)}
    spec = study_of(
        axes | {"beta0": [0.1, 0.2]}, None, over="beta0", ask="any", mode="drift", periods=1, rtol=1e-6, orbit_periods=0
    )
    e, Gamma = np.meshgrid(*axes.values(), indexing="ij")
    drifts = Gamma.ravel() > 1.5 - 0.5 * e.ravel()  # not the same with its axes exchanged
    results = blank_results(spec.grid.size, spec.kind)
    results["answer"] = np.where(drifts, A_YES, A_NO)
    results["counts"][:, M_DRIFT], results["counts"][:, M_REST] = drifts, 2 * ~drifts
    cube = spec.as_cube(results)
    (line,) = boundary(cube, "drift")
    assert np.abs(line[:, 1] - (1.5 - 0.5 * line[:, 0])).max() <= 0.025 + 1e-12
    assert np.ptp(line[:, 0]) == pytest.approx(0.4)
    assert runs_of(cube, "rest").sum() == 2 * (~drifts).sum()
    assert boundary(cube, "flutter") == []
    with pytest.raises(ParameterError, match=r"^boundary: has axes Gamma; needs 2 of them$"):
        boundary(cube.isel(e=[0]), "drift")
    with pytest.raises(ParameterError, match=r"^boundary: the cube has no regions; it is not of a search$"):
        boundary(cube.drop_vars("region"), "drift")


def test_exponents_of_a_law_come_back():
    A_r, f = np.meshgrid([5, 6, 7.0], [15, 20, 30.0], indexing="ij")
    rng = np.random.default_rng(1)
    for noise in (0.0, 0.01):
        radius = 0.1 * (A_r - 1) ** 2.9 * f**-2.1 * (1 + noise * rng.standard_normal(A_r.shape))
        laws = exponents(radii(radius, A_r=[5, 6, 7], f=[15, 20, 30]))
        assert laws["A_r"].exponent == pytest.approx(2.9, abs=1e-9 + 4 * laws["A_r"].error)
        assert laws["f"].exponent == pytest.approx(-2.1, abs=1e-9 + 4 * laws["f"].error)
        assert (laws["f"].error > 1e-3) == (noise > 0)
        assert laws["f"].least <= laws["f"].exponent <= laws["f"].greatest


def test_exponents_leave_out_what_does_not_drift():
    radius = np.array([1.0, 4.0, 99.0, 16.0])
    modes = [M_DRIFT, M_DRIFT, M_REST, M_DRIFT]
    law = exponents(radii(radius, modes, f=[10, 20, 30, 40]))["f"]
    assert law.exponent == pytest.approx(2)
    with pytest.raises(ParameterError, match=r"^exponents: 2 points drift; too few for a fit over f$"):
        exponents(radii([1, 2, 3], [M_DRIFT, M_DRIFT, M_REST], f=[10, 20, 30]))


@pytest.mark.filterwarnings("error")
def test_a_law_of_scattered_points_has_no_slopes_between_neighbours():
    law = exponents(radii([1, np.nan, 16, np.nan, 81, np.nan], f=[10, 20, 40, 60, 90, 100]))["f"]
    assert law.exponent == pytest.approx(2, abs=1e-9) and np.isnan([law.least, law.greatest]).all()


@pytest.mark.filterwarnings("error")
def test_an_axis_may_have_any_values_where_nothing_drifts():
    law = exponents(radii([np.nan, -3, 1, 4, 16], [M_REST, M_REST, *[M_DRIFT] * 3], xdot0=[-1, 0, 1, 2, 4]))
    assert law["xdot0"] == pytest.approx((2, 0, 2, 2), abs=1e-9)


def test_exponents_are_of_numbers_over_the_axes():
    cube = radii([1, 2, 4], f=[10, 20, 40])
    with pytest.raises(ParameterError, match=r"^quantity = 'size': must be one of mode_period, "):
        exponents(cube, "size")
    both = build_carried(cube)
    with pytest.raises(
        ParameterError, match=r"^exponents: has axes direction, f; needs parameters of more than one value$"
    ):
        exponents(both)
    assert exponents(both.sel(direction=0))["f"].exponent == pytest.approx(1)


def build_carried(cube):
    """Such a cube as if it had been carried up and down."""
    return xr.concat([cube, cube], dim="direction").assign_coords(direction=[0, 1])


def test_the_bottom_of_the_first_valley():
    x = np.linspace(0.5, 9, 69)
    y = 30 / x + x**2 + 40 * (x > 7)
    y[2] = np.nan
    low = minimum(x, y)
    at = 15 ** (1 / 3)
    assert low.at == pytest.approx(at, abs=max(low.at_error, 1e-3)) and low.at_error < 0.02
    assert low.value == pytest.approx(30 / at + at**2, rel=1e-4) and low.value_error < 0.02
    assert low.words("s", "m/s").startswith(f"{low.value:.3f} ± ")
    nowhere = minimum(x, 1 / x)
    assert np.isnan(nowhere).all() and not nowhere.located and nowhere.words("s", "m/s") == "no minimum located"


def test_a_valley_beside_chaos_is_not_dug_deeper():
    """A smooth valley keeps its bottom where a scatter begins on its right; a coarse one is refused."""
    fine, coarse = np.linspace(1, 7, 61), np.linspace(1, 7, 13)
    for x, located in ((fine, True), (coarse, False)):
        y = 10 + (x - 4.1) ** 2
        y[x > 5.2] = 20 + 100 * (np.arange((x > 5.2).sum()) % 2 == 0)  # far above, up and down
        low = minimum(x, y)
        assert low.located == located
        if located:
            assert (low.at, low.value) == pytest.approx((4.1, 10), abs=1e-6)


def test_no_bottom_is_dug_far_below_the_points():
    """Coarse points whose right side is scatter: a spline through them would go 15 % below the lowest one."""
    x = np.arange(0.5, 8, 0.5)
    y = np.array([40, 20, 13.5, 10.4, 8.7, 8.1, 9.5, 28, 26.5, 13.5, 16, 37, 12, 115, 22])
    assert not minimum(x, y).located
    assert minimum(x, 30 / x + x**2).located


def test_a_bottom_beside_an_unknown_value_is_not_located():
    x = np.linspace(1, 7, 61)
    y = 10 + (x - 4.1) ** 2
    assert minimum(x, y).located
    y[32] = np.nan  # right of the lowest point
    assert not minimum(x, y).located


def test_a_piece_of_a_circle():
    angle = np.linspace(0, 1, 50)
    assert circle_through(2 + 3 * np.cos(angle), -1 + 3 * np.sin(angle)) == pytest.approx((2, -1, 3))


@pytest.mark.parametrize(("A_r", "ratio"), [(4, 0.29643), (5, 0.23932), (6, 0.19958), (7, 0.17103)])
def test_the_axial_stick_ratio(A_r, ratio):
    assert stick_ratio(A_r) == pytest.approx(ratio, abs=5e-6)


def test_the_error_of_an_exponent_is_that_of_a_straight_line():
    """Of few points, where the two numbers that a line takes count."""
    f = np.array([15.0, 17.0, 21.0, 30.0])
    radius = 0.1 * f**-2.1 * np.array([1.01, 0.97, 1.02, 0.99])
    law = exponents(radii(radius, f=f))["f"]
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
