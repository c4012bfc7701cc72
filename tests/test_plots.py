"""Pictures: intervals and their lengths are right, and every kind of cube gives a figure or a clear refusal."""

import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import dimersweep
from dimersweep.cubes.reading import edges_of, minimum
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import M_DRIFT, M_REST, MODES
from dimersweep.plots import (
    MODE_COLORS,
    check_picture,
    draw,
    drift_intervals,
    drift_lengths,
    impact_rates,
    last_cycle,
    mode_map,
    movie,
    segments,
    write_picture,
)
from dimersweep.plots.style import Drawing, entitle, log_scale
from dimersweep.symbols import given
from tests.checks import cubes


def cube_of(modes, fixed=None, **axes):
    return cubes.cube_of(modes, axes, fixed)


D, R = M_DRIFT, M_REST


def test_intervals_reach_half_way_to_the_neighbours():
    cube = cube_of([[R, D, D, R], [D, R, R, D]], f=[15, 20], beta0=[0.1, 0.2, 0.3, 0.5])
    first, second = drift_intervals(cube)
    np.testing.assert_allclose(first, [[0.15, 0.4]])
    np.testing.assert_allclose(second, [[0.05, 0.15], [0.4, 0.6]])
    lengths = drift_lengths(cube)
    np.testing.assert_allclose(lengths, [0.25, 0.3])
    np.testing.assert_array_equal(lengths["f"], [15, 20])


def test_intervals_stay_within_zero_and_a_right_angle():
    whole = cube_of([D, D], beta0=[0.05, 1.5])
    np.testing.assert_allclose(drift_intervals(whole), [[[0, np.pi / 2]]])
    assert drift_lengths(cube_of([R, R], beta0=[0.1, 0.2])).item() == 0


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
    ],
)
def test_dips_of_the_other_sign_count_too_and_what_is_mirrored_or_reversed_is_as_long(angles, modes, expected):
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
WRITTEN = (
    "$e_{1}$ = 0.5",
    "$e_{2}$ = 0.7",
    r"$\Gamma_2$ = 0.1",
    r"$\phi_2$ = 17.19°",
    "$g$ = 9 m/s²",
    "$r$ = 0.006 m",
)
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
        assert not [told for name in UNLIKE if (told := given(name, UNLIKE[name]).replace(" ", "\xa0")) not in text]
    begun = dimersweep.simulate(start={"beta": 0.2}, periods=2)
    assert "β(0)" not in begun.conditions()
    assert begun.conditions().endswith(", from a given state")


FLAT = cube_of([R, D], f=[15, 20])


@pytest.mark.parametrize(
    ("cube", "kind", "more", "told"),
    [
        (FLAT, "segments", {}, "segments: has axes f; needs beta0 among them"),
        (cube_of([R], f=[15]), "mode_map", {}, "mode_map: has axes none; needs one of more than one value"),
        *((FLAT.isel(f=[]), kind, {}, f"{kind}: the axis f is empty") for kind in ("mode_map", "segments", "trends")),
        (FLAT, "pie", {}, "kind = 'pie': must be one of segments, mode_map"),
        (FLAT, None, {"quantity": "size"}, "quantity = 'size': must be one of mode, status, "),
        (FLAT, "trends", {"quantity": "radius"}, "quantity = 'radius': goes with a map, not with kind = 'trends'"),
    ],
)
def test_cubes_that_cannot_be_drawn_are_refused(cube, kind, more, told):
    with pytest.raises(ParameterError, match="^" + re.escape(told)):
        draw(cube, kind, **more)


def test_further_axes_are_panels_over_the_first_ones():
    deep = cube_of(np.full((3, 2, 4), R), f=[15, 20, 25], e=[0.5, 0.6], beta0=[0.1, 0.2, 0.3, 0.4])
    panels = [axes for axes in mode_map(deep).axes if axes.axison]
    assert [axes.get_title() for axes in panels] == ["$f$ = 15 Hz", "$f$ = 20 Hz", "$f$ = 25 Hz"]
    assert {axes.get_xlabel() for axes in panels} == {r"$\beta(0)$ [°]"}
    assert panels[0].get_ylabel() == "$e$"
    many = cube_of(np.full((5, 5, 2, 2), R), f=range(1, 6), g=range(1, 6), e=[0.5, 0.6], beta0=[0.1, 0.2])
    assert len([axes for axes in mode_map(many).axes if axes.axison]) == 12
    assert mode_map(many).get_suptitle().startswith("12 of 25 maps")


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
    write_picture(mode_map(cube), tmp_path / "a.png")
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
        check_picture(tmp_path / "a.xyz")


@pytest.mark.parametrize("friction", [{}, {"mu": 0.05, "mu_s": 0.1}])
def test_the_course_of_a_double_impact_leads_to_the_state_after_it(friction):
    run = dimersweep.simulate(periods=60, **friction)
    double = np.char.startswith(run.events["kind"].values, "DI")
    time = run.events["time"].values[double][-1]
    course = impact_rates(run, time)
    after = run.states(time)
    for name in ("beta_rate", "theta_rate", "gamma_rate"):
        assert course[name].values[-1] == pytest.approx(after[name].item(), abs=1e-10)
    assert course["kind"].values[0] == ""
    start, stop = last_cycle(run)
    assert stop - start == pytest.approx(1 / 15)
    assert stop < time + 1e-12
