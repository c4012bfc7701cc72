"""Pictures: intervals and their lengths are right; every kind of cube, of searches too, gives a figure or a clear refusal."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.contour import QuadContourSet
from PIL import Image

import dimersweep
from dimersweep import plots
from dimersweep.cubes.cube import names
from dimersweep.cubes.findings import circle_through, edges_of, minimum, search_summary
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import M_DRIFT, M_REST, MODES
from dimersweep.plots import FIGURES, MODE_COLORS, draw, drift_intervals, drift_lengths, mode_map, movie, segments
from dimersweep.plots.style import Drawing, entitle, log_scale
from dimersweep.studies.refine import refine
from dimersweep.studies.search import search
from dimersweep.symbols import parameter_shown
from tests.checks import cubes


def cube_of(modes, fixed=None, **axes):
    return cubes.cube_of(modes, axes, fixed)


D, R = M_DRIFT, M_REST


@pytest.mark.parametrize(
    ("angles", "modes", "expected"),
    [
        ([-0.45, -0.2, -0.1], [D, D, R], [[-0.575, -0.15]]),
        ([-0.3, -0.1, 0.1, 0.2], [R, D, D, R], [[-0.2, 0.15]]),
        ([-0.3, -0.1, 0.1, 0.2], [D, R, R, D], [[-0.4, -0.2], [0.15, 0.25]]),
        ([-1.5, -0.1], [D, D], [[-np.pi / 2, 0]]),  # no point is on the other side
        ([-1.5, 1.5], [D, D], [[-np.pi / 2, np.pi / 2]]),
        ([-0.2, 0.0], [R, D], [[-0.1, 0]]),
        ([0.0, 0.2], [D, R], [[0, 0.1]]),
        ([0.05, 1.5], [D, D], [[0, np.pi / 2]]),
        ([0.1, 0.2, 0.3, 0.5], [D, R, R, D], [[0.05, 0.15], [0.4, 0.6]]),
        ([0.1, 0.2], [R, R], np.empty((0, 2))),
    ],
)
def test_intervals_reach_half_way_on_either_side_and_what_is_mirrored_or_reversed_is_as_long(angles, modes, expected):
    cube = cube_of(modes, beta0=angles)
    (found,) = drift_intervals(cube)
    np.testing.assert_allclose(found, expected, atol=1e-15)
    length = drift_lengths(cube).item()
    assert length == pytest.approx(np.ptp(expected, axis=1).sum(), abs=1e-15)
    mirrored = cube_of(modes[::-1], beta0=[-angle for angle in angles[::-1]])
    np.testing.assert_allclose(drift_intervals(mirrored)[0], -np.array(expected)[::-1, ::-1], atol=1e-15)
    for again in (
        cube.sortby("beta0", ascending=False),
        cube.isel(beta0=np.random.default_rng(1).permutation(len(angles))),
    ):
        np.testing.assert_array_equal(drift_intervals(again), [found])
        assert drift_lengths(again).item() == length


def test_lengths_lie_along_the_other_axes():
    lengths = drift_lengths(cube_of([[R, D, D, R], [D, R, R, D]], f=[15, 20], beta0=[0.1, 0.2, 0.3, 0.5]))
    np.testing.assert_allclose(lengths, [0.25, 0.3])
    np.testing.assert_array_equal(lengths["f"], [15, 20])


def test_segments_reach_as_far_as_the_dips_do():
    modes = np.array([[R, D, D, R], [D, D, R, D]])
    cube = cube_of(modes, f=[15, 20], beta0=[-0.3, -0.1, 0.1, 0.3])
    for shown in (cube, cube.sortby("beta0", ascending=False)):
        axes = segments(shown).axes[0]
        drawn = [np.array(row.get_segments()).tolist() for row in axes.collections]
        expected = [[[[-0.2, 0], [0.2, 0]]], [[[-0.4, 1], [0, 1]], [[0.2, 1], [0.4, 1]]]]
        for row, one in zip(drawn, expected, strict=True):
            np.testing.assert_allclose(row, one, atol=1e-15)
        assert axes.get_xlim() == (-np.pi / 2, np.pi / 2)
        ticks = dict(zip((tick.get_text() for tick in axes.get_xticklabels()), axes.get_xticks(), strict=True))
        assert ticks["-π/8"] == -np.pi / 8 and ticks["π/2"] == np.pi / 2
        assert [text.get_text() for text in axes.texts] == ["0.400 rad", "0.600 rad"]
    assert segments(cube.isel(beta0=[0, 1])).axes[0].get_xlim() == (-np.pi / 2, 0)


def test_the_order_of_axes_and_of_values_does_not_matter():
    modes = np.array([[R, D, D], [D, D, R]])
    cube = cube_of(modes, f=[15, 20], beta0=[0.1, 0.2, 0.3])
    turned = cube_of(modes.T, beta0=[0.1, 0.2, 0.3], f=[15, 20])
    np.testing.assert_array_equal(drift_lengths(cube), drift_lengths(turned))
    speeds = np.linspace(1, 5, 17)
    valley = 10 + (speeds - 3.1) ** 2
    assert minimum(speeds[::-1], valley[::-1]) == minimum(speeds, valley)
    for values in ([1.0, 2.0, 4.0, 8.0], [0.1, 0.2, 0.4]):
        np.testing.assert_allclose(edges_of(np.array(values[::-1])), edges_of(np.array(values))[::-1])


def test_mode_map_has_one_color_and_one_legend_entry_for_each_mode():
    modes = np.tile(np.arange(len(MODES)), (2, 1))
    figure = mode_map(cube_of(modes, e=[0.4, 0.5], Gamma=np.linspace(0.8, 1.2, len(MODES))))
    (legend,) = figure.legends
    down = {"rest": "", "rolls": ", speed changes", "slides": ", slipping"}
    words = [f"{mode}: both ends down{down[mode]}" if mode in down else mode for mode in MODES]
    assert [text.get_text() for text in legend.get_texts()] == [f"{word} (9.1 %)" for word in words]
    assert len({to_rgb(color) for color in MODE_COLORS.values()}) == len(MODES) == len(MODE_COLORS)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == (r"$\Gamma$", "$e$")


UNLIKE = {"e_1": 0.5, "e_2": 0.7, "Gamma_2": 0.1, "phi_2": 0.3, "g": 9.0, "r": 6e-3, "rho_b": 7000.0, "phi0": 1.0}
WRITTEN = ("$e_{1}$ = 0.5", "$e_{2}$ = 0.7", r"$\Gamma_2$ = 0.1", r"$\phi_2$ = 17.19°", "$g$ = 9 m/s²", "$r$ = 0.006 m")
WRITTEN += (r"$\rho_b$ = 7000 kg/m³", r"$\phi_0$ = 57.3°")


def heading_of(figure, path):
    """The heading of a figure, which must lie inside the picture that is written."""
    figure.savefig(path)
    box, picture = figure._suptitle.get_window_extent(), figure.bbox
    assert picture.x0 <= box.x0 < box.x1 <= picture.x1 and picture.y0 <= box.y0 < box.y1 <= picture.y1
    return figure.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize("draws", [segments, mode_map, lambda cube: draw(cube, quantity="radius")])
def test_a_picture_of_a_cube_names_all_that_is_not_the_base_case_s(draws, tmp_path):
    cube = cube_of([[[R, D, D], [D, D, R]]], UNLIKE, A_r=[5.0], f=[15, 20], beta0=[0.1, 0.2, 0.3])
    heading = heading_of(draws(cube), tmp_path / "a.png")
    for told in (*WRITTEN, "$A_r$ = 5"):
        assert told in heading
    assert "$e$" not in heading and "$f$" not in heading


@pytest.mark.jit
def test_a_run_names_all_that_is_not_the_base_case_s(tmp_path, monkeypatch):
    run = dimersweep.simulate(**UNLIKE, periods=12)
    heading = heading_of(run.plot(), tmp_path / "a.png")
    moving = []
    monkeypatch.setattr(movie, "entitle", lambda figure, text: moving.append(text) or entitle(figure, text))
    run.animate(tmp_path / "a.gif", periods=1, speed=1)
    for told in WRITTEN:
        assert told in heading
        assert told in moving[0].replace("\N{NO-BREAK SPACE}", " ")
    page = run.animate(tmp_path / "a.html", periods=1, speed=1).read_text(encoding="utf-8")
    for text in (page, run._repr_html_()):
        assert not [
            told for name in UNLIKE if (told := parameter_shown(name, UNLIKE[name]).replace(" ", "\xa0")) not in text
        ]
    begun = dimersweep.simulate(start={"beta": 0.2}, periods=2)
    assert "β(0)" not in begun.conditions()
    assert begun.conditions().endswith(", from a given state")


def test_of_too_many_panels_some_are_drawn():
    many = cube_of(np.full((5, 5, 2, 2), R), f=range(1, 6), g=range(1, 6), e=[0.5, 0.6], beta0=[0.1, 0.2])
    figure = mode_map(many)
    assert len([axes for axes in figure.axes if axes.axison]) == 12
    assert figure.get_suptitle().startswith("12 of 25 maps")


def test_values_in_a_fixed_ratio_are_drawn_on_logarithmic_axes():
    cube = cube_of(np.full((4, 3), R), f=[1, 10, 100, 1000], Gamma=[0.8, 0.9, 1.0])
    (axes,) = mode_map(cube).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    edges = edges_of(cube["f"].values)
    np.testing.assert_allclose(edges, 10 ** np.array([-0.5, 0.5, 1.5, 2.5, 3.5]))


def test_maps_have_angles_in_round_degrees():
    cube = cube_of(np.full((2, 3), R), phi0=[0.0, np.pi], beta0=np.deg2rad([2, 44, 86]))
    figure = mode_map(cube)
    figure.canvas.draw()
    (axes,) = figure.axes
    assert [tick.get_text() for tick in axes.get_xticklabels()][1:-2] == ["0", "20", "40", "60", "80"]
    np.testing.assert_allclose(axes.get_xticks()[1:4], np.deg2rad([0, 20, 40]), atol=1e-15)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"$\beta(0)$ [°]", r"$\phi_0$ [°]")


def test_angles_in_a_fixed_ratio_have_round_degrees_on_a_logarithmic_axis():
    figure = mode_map(cube_of(np.full((2, 4), R), f=[15, 20], beta0=np.deg2rad([1, 3, 9, 27])))
    figure.canvas.draw()
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_xlabel()) == ("log", r"$\beta(0)$ [°]")
    told = {tick.get_text(): tick.get_position()[0] for tick in axes.get_xticklabels()}
    assert {"1", "2", "5", "10", "20"} <= told.keys()
    assert told["20"] == pytest.approx(np.pi / 9)


def test_a_picture_is_as_large_whoever_saves_it(tmp_path):
    cube = cube_of([[R, D, D], [D, D, R]], f=[15, 20], beta0=[0.1, 0.2, 0.3])
    plots.write_picture(mode_map(cube), tmp_path / "a.png")
    mode_map(cube).savefig(tmp_path / "b.png")
    sizes = [Image.open(tmp_path / name).size for name in ("a.png", "b.png")]
    assert sizes[0] == sizes[1] == (1500, 960)


def test_a_logarithmic_axis_of_less_than_a_decade_has_plain_numbers():
    figure = Drawing(4, 3)
    axes = figure.subplots()
    axes.plot([1, 2], [37.0, 59.0])
    log_scale(axes)
    figure.canvas.draw()
    shown = [tick.get_text() for tick in axes.get_yticklabels()]
    assert {"40", "50"} <= set(shown) and not any("$" in text for text in shown)


def test_every_mode_is_seen_as_a_dot_on_white():
    """The contrast of WCAG 2, which is 1 for white itself."""
    for mode, color in MODE_COLORS.items():
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(color)]
        contrast = 1.05 / (np.dot([0.2126, 0.7152, 0.0722], linear) + 0.05)
        assert contrast > 1.8 or mode == "not_run", (mode, contrast)


def test_a_picture_needs_a_known_ending(tmp_path):
    with pytest.raises(ParameterError, match=r"^out = .*a.xyz: a picture must end in .png, .pdf or .svg$"):
        plots.check_picture(tmp_path / "a.xyz")


@pytest.mark.parametrize("friction", [{}, {"mu": 0.05, "mu_s": 0.1}])
def test_the_course_of_a_double_impact_leads_to_the_state_after_it(friction):
    run = dimersweep.simulate(periods=60, **friction)
    double = names(run.events["kind"]).str.startswith("DI").values
    time = run.events["time"].values[double][-1]
    course = plots.impact_rates(run, time)
    after = run.states(time)
    for name in ("beta_rate", "theta_rate", "gamma_rate"):
        assert course[name].values[-1] == pytest.approx(after[name].item(), abs=1e-10)
    assert names(course["kind"]).values[0] == names(run.events["contact_before"]).values[run.events["time"] == time][0]
    start, stop = plots.last_cycle(run)
    assert stop - start == pytest.approx(1 / 15)
    assert stop < time + 1e-12


# --- of searches -------------------------------------------------------------------------------------------------------
BETA0 = {"start": 0.03, "stop": 0.3, "num": 19}


def searched(axes, **settings):
    return search(axes | {"beta0": BETA0}, **({"over": "beta0", "periods": 5, "progress": False} | settings))


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
@pytest.mark.parametrize("beta0", [0.28, -0.28])
def test_a_drift_along_the_axis_has_the_sense_from_the_end_that_is_down(beta0):
    """As the centre of mass goes in a run, in which one sees which end is down; either end may be."""
    cube = search(
        {"A_r": [5.5, 6.0], "beta0": [beta0]}, fixed={"xdot0": 0.0}, over="beta0", ask="first", periods=200,
        orbit_periods=200, progress=False, paths={"periods": 200, "per_period": 1},
    )  # fmt: skip
    for A_r, told in zip((5.5, 6.0), cube["axial_velocity"].values, strict=True):
        last = dimersweep.simulate(A_r=A_r, beta0=beta0, xdot0=0.0, periods=200).states(np.linspace(199, 200, 301) / 15)
        y, from_p1 = last["y"].values, (last["y"] - last["y1"]).values  # the heading stays along Y
        down = [float((last[f"gap_{end}"] == 0).mean()) for end in (1, 2)]
        sense = np.sign(from_p1[-1]) * (1 if down[0] > down[1] else -1)
        assert max(down) > 0.9 > 2 * min(down)
        assert told == pytest.approx(15 * sense * (y[-1] - y[0]), rel=1e-6) and abs(told) > 1e-4


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


def test_shares_are_those_of_the_runs(fake_kernel):
    cube = searched({"e": [0.5, 0.6], "f": [0.3, 3, 9]}, ask="fraction")
    (axes,) = FIGURES["shares"](cube).axes
    for line, row in zip(axes.lines, cube["runs"].values[:, :, 3], strict=True):
        np.testing.assert_allclose(line.get_ydata(), 100 * row / 19)


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
