"""Pictures of searches: each kind draws what it is for, and refuses other cubes with a reason."""

import re

import numpy as np
import pytest
from matplotlib.contour import QuadContourSet

from dimersweep.cubes.cube import names
from dimersweep.cubes.reading import circle_through, edges_of, search_summary
from dimersweep.errors import ParameterError
from dimersweep.plots import FIGURES, draw
from dimersweep.studies.refine import refine
from dimersweep.studies.search import search

BETA0 = {"start": 0.03, "stop": 0.3, "num": 19}


def searched(axes, **settings):
    return search(axes | {"beta0": BETA0}, **({"over": "beta0", "periods": 5, "progress": False} | settings))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("regions", "regions: needs the regions of a search over two axes"),
        ("paths", "paths: the cube has no paths over one axis; declare [paths]"),
        ("trends", "trends: has axes Gamma; needs A_r, f"),
        ("minimum", "minimum: has axes Gamma; needs A_r, xdot0"),
        ("impact_ends", "impact_ends: has axes Gamma; needs A_r, mu, mu_s"),
        ("shares", "shares: needs the runs of a search over two axes"),
        ("walks", "walks: the cube has no paths over one axis; declare [paths]"),
        ("planar", "planar: needs paths over one axis; declare [paths]"),
    ],
)
def test_a_cube_that_does_not_fit_is_refused(fake_kernel, kind, message):
    with pytest.raises(ParameterError) as caught:
        FIGURES[kind](searched({"Gamma": [0.8, 0.9, 1.0]}))
    assert str(caught.value) == message


@pytest.mark.jit
def test_walks_are_drawn_from_their_starts_with_the_velocity_of_the_centre():
    """The centre goes uphill in proportion to the tilt; a walk that turns back has a word in place of a velocity."""
    tilts = [0.0, 1e-3, 2e-3, 8e-3]
    cube = search(
        {"tilt": tilts, "beta0": [0.28]}, over="beta0", ask="first", periods=700, orbit_periods=700, progress=False,
        paths={"periods": 700, "per_period": 1},
    )  # fmt: skip
    left, right = FIGURES["walks"](cube).axes
    for line, x, y in zip(left.lines, cube["x"].values, cube["y"].values, strict=False):
        np.testing.assert_array_equal(line.get_xydata(), np.column_stack([x, y]))
    along, across, _ = (line.get_ydata() for line in right.lines)
    assert along[1:3] == pytest.approx(-11.6e3 * np.array(tilts[1:3]), rel=0.01)
    assert np.abs(across[:3]).max() < 0.05 * np.abs(along[1:3]).max()
    assert np.isnan(along[3])
    assert [(text.get_position()[0], text.get_text().strip()) for text in right.texts] == [(8e-3, "cusps")]


@pytest.mark.jit
def test_walks_of_unlike_balls_have_the_curvature_of_their_paths():
    cube = search(
        {"r_2": [4.9e-3, 5.05e-3], "beta0": [0.28]}, fixed={"r_1": 5e-3}, over="beta0", ask="first", periods=700,
        orbit_periods=700, progress=False, paths={"periods": 700, "per_period": 1},
    )  # fmt: skip
    _, right = FIGURES["walks"](cube).axes
    shown = right.lines[0].get_ydata()
    radii = [circle_through(x[60:], y[60:])[2] for x, y in zip(cube["x"].values, cube["y"].values, strict=True)]
    assert np.abs(shown) == pytest.approx(1 / np.array(radii), rel=1e-3)
    assert shown[0] < 0 < shown[1]


def test_trends_tell_the_exponent(fake_kernel):
    # the fake radius is f^2/50 + 1e-3 beta0
    cube = searched({"A_r": [5, 6, 7], "f": [3, 9, 27]})
    assert (names(cube["mode"]) == "drift").all()
    cube["period"] = cube["radius"]
    titles = [axes.get_title() for axes in FIGURES["trends"](cube).axes]
    assert float(re.match(r"\$f\^\{([\d.]+)", titles[1])[1]) == pytest.approx(2, abs=0.01)
    assert titles[0].startswith("$(A_r - 1)^{")


def test_a_minimum_is_marked_only_where_it_is_located(fake_kernel):
    cube = searched({"A_r": [5, 6], "xdot0": {"start": 1, "stop": 7, "num": 25}}, fixed={"f": 9.0})
    period = 10 + (cube["xdot0"] - 4) ** 2
    cube["period"] = period.where((cube["A_r"] == 5) | (cube["xdot0"] != 4.25)).transpose("A_r", "xdot0")
    left, right = FIGURES["minimum"](cube).axes
    told = [text.get_text() for text in left.get_legend().get_texts()]
    assert told == ["$A_r$ = 5", "10.000 ± 0.000 s at 4.000 ± 0.000 m/s", "$A_r$ = 6: no minimum located"]
    assert len(right.lines) == 4  # two curves, the place of one minimum, pi/2


def test_shares_are_those_of_the_runs(fake_kernel):
    cube = searched({"e": [0.5, 0.6], "f": [0.3, 3, 9]}, ask="fraction")
    (axes,) = FIGURES["shares"](cube).axes
    for line, row in zip(axes.lines, cube["runs"].values[:, :, 3], strict=True):
        np.testing.assert_allclose(line.get_ydata(), 100 * row / 19)


def test_ends_of_the_impact_have_one_map_for_each_aspect_ratio(fake_kernel):
    cube = searched({"A_r": [5, 7], "mu": [0.1, 0.2], "mu_s": [0.1, 0.2]}, fixed={"f": 9.0})
    figure = FIGURES["impact_ends"](cube)
    assert [axes.get_title() for axes in figure.axes] == [
        r"$A_r$ = 5, $\bar\mu$ = 0.239",
        r"$A_r$ = 7, $\bar\mu$ = 0.171",
    ]
    assert "no drift found" in figure.legends[0].get_texts()[0].get_text()  # mu_s below mu


def test_regions_have_borders_where_they_differ(fake_kernel):
    grid = {"f": [0.2, 0.3, 1.0, 9.0], "e": [0.5, 0.6], "beta0": BETA0}
    cube = refine(grid, halvings={"f": 2}, over="beta0", periods=5, progress=False, attrs={"plot": "regions"})
    (axes,) = draw(cube).axes
    borders = [each for each in axes.collections if isinstance(each, QuadContourSet) and not each.filled]
    assert len(borders) == 2  # one of the drift, one of the rest
    drifts = names(cube["region"]).isel(e=0) == "drift"
    first = int(np.flatnonzero(drifts.values).min())
    edge = edges_of(cube["f"].values)[first]  # of the cells that are drawn
    found = [np.concatenate([path.vertices for path in each.get_paths()]) for each in borders]
    assert any(np.abs(vertices[:, 0] - edge).max() < 1e-9 for vertices in found)


def test_answers_are_told_in_one_line(fake_kernel):
    told = search_summary(searched({"f": [0.2, 9.0]}))
    assert told.startswith("any beta0 to drift: no 1, yes 1 at 2 points, in ") and told.endswith(
        " runs of 38 that there are"
    )
    assert search_summary(searched({"f": [0.2, 9.0]}, ask="fraction")).startswith("modes over beta0: yes 2 at 2 points")
