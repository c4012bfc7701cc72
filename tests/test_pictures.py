"""What is drawn, read back from the figures and compared with the data; and pictures of next to nothing."""

from itertools import combinations

import numpy as np
import pytest
import xarray as xr
from matplotlib import rc_context
from matplotlib import style as in_style
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.text import Text

import dimersweep
from dimersweep.analysis.attractors.pictures import MOST_NAMED, attractors, looks_of
from dimersweep.analysis.fits import Waveform
from dimersweep.analysis.fits.pictures import draw_fit
from dimersweep.analysis.orbits.borders.pictures import draw_borders
from dimersweep.cubes.cube import FLAGS, names
from dimersweep.cubes.grid import make_points
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import DI_ENDS, M_DRIFT, M_JUMP, M_NOT_RUN, M_REST, MODES
from dimersweep.plots import draw, energy_budget, last_cycle, movie, orbit, run_figure, view, write_picture
from dimersweep.plots import playback as playing
from dimersweep.plots.orbits import END_COLORS, LEFT_OUT_COLOR
from dimersweep.plots.runs import SLIPS, TERMS
from dimersweep.plots.style import ROW_COLORS, mode_colors, row_colors
from tests.checks.cubes import built, cube_of
from tests.checks.seeing import apart

pytestmark = pytest.mark.filterwarnings("error")
D, R, J = M_DRIFT, M_REST, M_JUMP
COLORS = {"drift": "#0072b2", "rest": "#999999", "jump": "#e69f00", "flutter": "#139059", "failed": "#000000"}
RED, BLUE, BLACK = "#d62728", "#1f4fd8", "#000000"  # of p1; of the first row
ENDS = {"none": "#ffffff", "sp_sp": "#0072b2", "sp_sk": "#e69f00", "sk_sp": "#dd99cc", "sk_sk": "#009e73"}


def with_paths(cube, per_period=4):
    """Tracks that begin at the origin, in circles of radius 1, 2, ... about (-1, 0), (-2, 0), ..., with a ripple of 2 mm."""
    n, cycle = cube["mode"].size, np.arange(0, 40 + 0.5 / per_period, 1 / per_period)
    radius, name = 1.0 + np.arange(n)[:, None], cube["mode"].dims[0]
    angle = 2 * np.pi * cycle / 40
    rim = radius + 2e-3 * np.sin(2 * np.pi * 10 * cycle / 40)
    x, y = rim * np.cos(angle) - radius, rim * np.sin(angle)
    along = (name, "cycle")
    return cube.assign(x=(along, x), y=(along, y)).assign_coords(cycle=cycle)


def color_at(axes, x, y, which=0):
    """The colour of the cell of a mesh that a place lies in."""
    mesh = [each for each in axes.collections if hasattr(each, "get_coordinates")][which]
    corners = mesh.get_coordinates()
    column = np.searchsorted(corners[0, :, 0], x) - 1
    row = np.searchsorted(corners[:, 0, 1], y) - 1
    shape = corners.shape[0] - 1, corners.shape[1] - 1
    mesh.update_scalarmappable()
    return to_hex(mesh.get_facecolors().reshape(*shape, 4)[row, column])


def labelled(axes):
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}


def legend_of(figure):
    (legend,) = figure.legends
    faces = [
        handle.get_facecolor() if hasattr(handle, "get_facecolor") else handle.get_color()
        for handle in legend.legend_handles
    ]
    return {text.get_text(): to_hex(face) for text, face in zip(legend.get_texts(), faces, strict=True)}


def drawn(figure, *, laid_out=True):
    """A figure that can be drawn, at little cost: a layout takes twice as long as all else, the lines of a heading half."""
    if not laid_out:
        figure.set_layout_engine("none")
    for text in figure.findobj(Text):
        text.set_wrap(False)
    figure.draw_without_rendering()
    return figure


# --- maps -------------------------------------------------------------------------------------------------------------
def test_a_map_of_modes_has_each_mode_in_its_place_and_its_colour():
    modes = np.array([[[R, D, D], [J, D, R]], [[D, R, R], [R, R, J]]])
    axes = {"f": [15, 20], "e": [0.5, 0.6], "Gamma": [0.8, 0.9, 1.1]}
    figure = draw(cube_of(modes, axes), "mode_map")
    panels = {each.get_title(): each for each in figure.axes}
    for k, f in enumerate(axes["f"]):
        panel = panels[f"$f$ = {f} Hz"]
        for j, e in enumerate(axes["e"]):
            for i, Gamma in enumerate(axes["Gamma"]):
                assert color_at(panel, Gamma, e) == COLORS[MODES[modes[k, j, i]]]
        assert panel.get_xlabel() == r"$\Gamma$"
    assert figure.axes[0].get_ylabel() == "$e$"
    assert legend_of(figure) == {
        "rest: both ends down (50.0 %)": COLORS["rest"],
        "drift (33.3 %)": COLORS["drift"],
        "jump (16.7 %)": COLORS["jump"],
    }
    lowest, highest = (np.array(each) for each in zip(panel.get_xlim(), panel.get_ylim(), strict=True))
    assert (lowest < highest).all()  # right and up


def test_a_strip_of_modes_runs_to_the_right():
    (axes,) = draw(cube_of([R, D, D, J], {"xdot0": [0.5, 1, 2, 3]})).axes
    words = ("rest", "drift", "drift", "jump")
    assert [color_at(axes, x, 0.5) for x in (0.5, 1, 2, 3)] == [COLORS[word] for word in words]
    assert axes.get_xlabel() == r"$\dot{x}_1(0)$ [m/s]"


def test_a_map_of_a_quantity_has_its_values_in_their_places_and_one_scale():
    values = np.array([[[1.0, 2, 3], [4, 5, np.nan]], [[7, 8, 9], [10, 11, 12]]])
    cube = cube_of(np.full(values.shape, D), {"f": [15, 20], "e": [0.5, 0.6], "Gamma": [0.8, 0.9, 1.1]}, radius=values)
    figure = draw(cube, quantity="radius")
    *panels, bar = figure.axes
    for k, panel in enumerate(panels):
        (mesh,) = panel.collections
        np.testing.assert_array_equal(np.ma.filled(mesh.get_array(), np.nan), values[k])
        assert mesh.get_clim() == (1, 12) and mesh.cmap.name == "viridis"
        corners = mesh.get_coordinates()
        np.testing.assert_allclose(corners[0, :, 0], [0.75, 0.85, 1.0, 1.2])
        np.testing.assert_allclose(corners[:, 0, 1], [0.45, 0.55, 0.65])
    assert bar.get_ylabel() == "radius [m]"
    line = draw(cube.isel(f=1, e=0), quantity="radius").axes[0].lines[0]
    np.testing.assert_array_equal(line.get_xydata(), [[0.8, 7], [0.9, 8], [1.1, 9]])


def test_curves_of_both_ways_are_told_apart():
    up = cube_of([D, D, D], {"Gamma": [0.8, 0.9, 1.1]}, zeta=[1.0, 2, 3])
    down = up.assign(zeta=up["zeta"] + 5)
    both = xr.concat([up, down], dim="direction").assign_coords(direction=[0, 1])
    (axes,) = draw(both, quantity="zeta").axes
    lines = labelled(axes)
    for word, values, marker in (("up", [1, 2, 3], ">"), ("down", [6, 7, 8], "<")):
        np.testing.assert_array_equal(lines[f"going {word}"].get_xydata(), np.column_stack([[0.8, 0.9, 1.1], values]))
        assert lines[f"going {word}"].get_marker() == marker
    assert axes.get_ylabel() == r"$\zeta$ [rad]"


def test_points_are_drawn_over_each_pair_of_their_parameters():
    table = {"Gamma": [0.8, 0.9, 1.0, 1.1], "f": [15, 25, 20, 10], "beta0": [0.1, 0.4, 0.3, 0.2]}
    cube = built(make_points(table), [R, D, J, D], radius=[np.nan, 2.0, 3.0, 4.0])
    for quantity in (None, "radius"):
        figure = draw(cube, quantity=quantity)
        for panel, (x, y) in zip(figure.axes, (("Gamma", "f"), ("Gamma", "beta0"), ("f", "beta0")), strict=False):
            (dots,) = panel.collections
            names = {"Gamma": r"$\Gamma$", "f": "$f$ [Hz]", "beta0": r"$\beta(0)$ [°]"}
            assert (panel.get_xlabel(), panel.get_ylabel()) == (names[x], names[y])
            np.testing.assert_array_equal(dots.get_offsets(), np.column_stack([table[x], table[y]]))
            if quantity is None:
                assert [to_hex(face) for face in dots.get_facecolors()] == [COLORS[MODES[k]] for k in (R, D, J, D)]
            else:
                np.testing.assert_array_equal(np.ma.filled(dots.get_array(), np.nan), cube["radius"])


def test_segments_are_the_angles_that_drift_in_their_rows():
    cube = cube_of([[R, D, D, R], [D, R, R, D]], {"f": [15, 20], "beta0": [0.1, 0.2, 0.3, 0.5]})
    axes = drawn(draw(cube, "segments"), laid_out=False).axes[0]
    rows = {text.get_text(): height for text, height in zip(axes.get_yticklabels(), axes.get_yticks(), strict=True)}
    spans = {}
    for row in axes.collections:
        for (left, low), (right, high) in row.get_segments():
            assert low == high
            spans.setdefault(low, []).append((round(left, 6), round(right, 6)))
    assert spans == {rows["$f$ = 15 Hz"]: [(0.15, 0.4)], rows["$f$ = 20 Hz"]: [(0.05, 0.15), (0.4, 0.6)]}
    told = {text.xy[1]: (text.get_text(), to_hex(text.get_color())) for text in axes.texts}
    assert told == {rows["$f$ = 15 Hz"]: ("0.250 rad", BLUE), rows["$f$ = 20 Hz"]: ("0.300 rad", RED)}
    assert [to_hex(row.get_colors()[0]) for row in axes.collections] == [BLUE, RED]
    (degrees,) = axes.child_axes
    np.testing.assert_allclose(degrees.get_xlim(), [0, 90])


def region_map():
    """Modes over e, then Gamma, and a cube with their regions."""
    modes = np.array([[R, R, J], [R, D, J], [R, D, R]])
    cube = cube_of(modes, {"e": [0.4, 0.5, 0.7], "Gamma": [0.8, 0.9, 1.1]})
    words = np.where(modes == D, "drift", np.where(modes == R, "rest", "mixed"))
    codes = np.vectorize({word: k for k, word in enumerate(FLAGS["region"])}.get)(words)
    cube["region"] = (
        cube["mode"].dims,
        codes,
        {"flag_values": np.arange(len(FLAGS["region"])), "flag_meanings": " ".join(FLAGS["region"])},
    )
    return modes, cube


def test_regions_are_in_their_places():
    modes, cube = region_map()
    figure = draw(cube, "regions")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$e$", r"$\Gamma$")
    shown = {"drift": "#ffffff", "rest": to_hex(0.6 * np.array(to_rgb(COLORS["rest"])) + 0.4), "jump": COLORS["jump"]}
    hatched = {}
    for each in axes.collections:
        if isinstance(each, QuadContourSet) and each.filled:
            hatched[each.hatches[0]] = each.get_paths()[0]
    for i, e in enumerate([0.4, 0.5, 0.7]):
        for j, Gamma in enumerate([0.8, 0.9, 1.1]):
            assert color_at(axes, e, Gamma) == shown[MODES[modes[i, j]]]
            assert hatched["|||"].contains_point((e, Gamma)) == (modes[i, j] == D)
            assert hatched["///"].contains_point((e, Gamma)) == (modes[i, j] == R)
    lines = [each for each in axes.collections if isinstance(each, QuadContourSet) and not each.filled]
    assert [to_hex(each.get_edgecolor()[0]) for each in lines] == [RED, BLUE]
    handles = {
        text.get_text(): handle
        for text, handle in zip(figure.legends[0].get_texts(), figure.legends[0].legend_handles, strict=True)
    }
    assert {text: handle.get_hatch() for text, handle in handles.items()} == {
        "$R_1$: some start drifts": "|||", "$R_2$: every start comes to rest": "///", "mostly jump": None,
    }  # fmt: skip


# --- orbits over parameters -------------------------------------------------------------------------------------------
def test_paths_are_drawn_about_their_centres_and_their_teeth_in_mm():
    cube = with_paths(cube_of([D, D, D], {"f": [15, 20, 25]}))
    whole, teeth = draw(cube, "paths").axes
    lines = labelled(whole)
    angle = 2 * np.pi * np.arange(0, 40.1, 0.25) / 40
    for k, (f, color) in enumerate(zip((15, 20, 25), (BLUE, RED, BLACK), strict=True)):
        line = lines[f"$f$ = {f} Hz: $R$ = {k + 1}.000 m"]
        rim = k + 1 + 2e-3 * np.sin(10 * angle)
        np.testing.assert_allclose(
            line.get_xydata(), np.column_stack([rim * np.cos(angle), rim * np.sin(angle)]), atol=3e-4
        )
        assert to_hex(line.get_color()) == to_hex(teeth.lines[k].get_color()) == color
        np.testing.assert_allclose(teeth.lines[k].get_xdata(), np.arange(0, 4.1, 0.25))
        np.testing.assert_allclose(teeth.lines[k].get_ydata(), 2 * np.sin(10 * angle)[-17:], atol=0.3)
    assert [whole.get_xlabel(), whole.get_ylabel()] == ["$x$ [m]", "$y$ [m]"]
    assert [teeth.get_xlabel(), teeth.get_ylabel()] == ["time [forcing periods]", "distance from the circle [mm]"]


def test_walks_have_their_tracks_their_velocities_and_their_curvatures():
    moving = {"centre_velocity_x": [0, -0.002, np.nan], "centre_velocity_y": [0, 0.001, np.nan], "track": [3, 4, 6]}
    cube = with_paths(cube_of([D, D, D], {"tilt": [0, 0.001, 0.002]}, **moving))
    left, right = draw(cube, "walks").axes
    for k, (line, word) in enumerate(zip(left.lines, ("circle", "loops", "cusps"), strict=False)):
        np.testing.assert_array_equal(line.get_xydata(), np.column_stack([cube["x"][k], cube["y"][k]]))
        assert line.get_label().endswith(f": {word}")
    lines = labelled(right)
    np.testing.assert_allclose(lines["along $x$"].get_xydata(), [[0, 0], [0.001, -2], [0.002, np.nan]])
    np.testing.assert_allclose(lines["along $y$"].get_xydata(), [[0, 0], [0.001, 1], [0.002, np.nan]])
    assert right.get_ylabel() == "velocity of the circle's centre [mm/s]"
    assert [(text.get_position(), text.get_text().strip()) for text in right.texts] == [((0.002, 0), "cusps")]
    level = cube_of([D, D, D], {"f": [15, 20, 25]}, precession_rate=[-0.5, 0.2, 1.0], speed=[2.0, 2.0, 4.0])
    _, right = draw(with_paths(level), "walks").axes
    np.testing.assert_allclose(right.lines[0].get_xydata(), [[15, 0.25], [20, -0.1], [25, -0.25]])
    assert right.get_ylabel() == "curvature $1/R$ [1/m]"


def laws():
    A_r, f = np.meshgrid([5.0, 6, 8], [15.0, 20, 30, 40], indexing="ij")
    columns = {
        "radius": 0.1 * (A_r - 1) ** 3 * f**-2,
        "period": 0.2 * (A_r - 1) * f,
        "zeta": 1.5 + 0.01 * A_r + 0.001 * f,
    }
    return cube_of(np.full(A_r.shape, D), {"A_r": [5, 6, 8], "f": [15, 20, 30, 40]}, **columns), columns


def test_trends_are_drawn_over_both_axes_with_lines_of_their_exponents():
    cube, columns = laws()
    panels = np.reshape(draw(cube, "trends").axes, (3, 2))
    powers = {"radius": (3, -2), "period": (1, 1)}
    labels = {"radius": r"$\bar R$ [m]", "period": r"$\bar T$ [s]", "zeta": r"$\zeta$ [rad]"}
    for row, (name, values) in zip(panels, columns.items(), strict=True):
        over_A, over_f = row
        assert over_A.get_ylabel() == labels[name]
        for k, f in enumerate((15, 20, 30, 40)):
            np.testing.assert_allclose(
                labelled(over_A)[f"$f$ = {f} Hz"].get_xydata(), np.column_stack([[4, 5, 7], values[:, k]])
            )
        for k, A_r in enumerate((5, 6, 8)):
            np.testing.assert_allclose(
                labelled(over_f)[f"$A_r$ = {A_r}"].get_xydata(), np.column_stack([[15, 20, 30, 40], values[k]])
            )
        for axes, k in ((over_A, 0), (over_f, 1)):
            if name in powers:
                x, y = np.log(axes.lines[-1].get_xydata().T)
                np.testing.assert_allclose(np.diff(y) / np.diff(x), powers[name][k], atol=1e-6)
                assert axes.get_xscale() == axes.get_yscale() == "log"
                assert axes.get_title().startswith(("$(A_r - 1)" if k == 0 else "$f") + f"^{{{powers[name][k]:.3f} ")
            else:
                np.testing.assert_allclose(axes.lines[-1].get_ydata(), np.pi / 2)
    assert [axes.get_xlabel() for axes in panels[-1]] == ["$A_r - 1$", "$f$ [Hz]"]


def test_the_least_period_is_marked_where_it_is():
    speeds = np.linspace(1, 7, 25)
    periods = np.array([10 + (speeds - 4) ** 2, 20 + (speeds - 3) ** 2])
    columns = {"period": periods, "zeta": [1.6 + 0 * speeds, 1.6 + 0.01 * speeds]}
    cube = cube_of(np.full(periods.shape, D), {"A_r": [5, 6], "xdot0": speeds}, **columns)
    left, right = draw(cube, "minimum").axes
    for k, color in enumerate((BLUE, RED)):
        curve, mark = left.lines[2 * k : 2 * k + 2]
        assert curve.get_label() == f"$A_r$ = {5 + k}"
        np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([speeds, periods[k]]))
        np.testing.assert_allclose(mark.get_xydata(), [[4 - k, 10 * (k + 1)]], atol=1e-6)
        assert mark.get_label() == f"{10 * (k + 1)}.000 ± 0.000 s at {4 - k}.000 ± 0.000 m/s"
        zeta, down = right.lines[2 * k : 2 * k + 2]
        np.testing.assert_array_equal(zeta.get_xydata(), np.column_stack([speeds, columns["zeta"][k]]))
        np.testing.assert_allclose(down.get_xdata(), 4 - k, atol=1e-6)
        assert {to_hex(line.get_color()) for line in (curve, mark, zeta, down)} == {color}
    assert (left.get_ylabel(), right.get_ylabel()) == (r"$\bar T$ [s]", r"$\zeta$ [rad]")
    assert {left.get_xlabel(), right.get_xlabel()} == {r"$\dot{x}_1(0)$ [m/s]"}
    cube["period"][1, 8] = np.nan  # at the bottom: not located, and not marked
    left, right = draw(cube, "minimum").axes
    assert left.figure.legends[0].get_texts()[-1].get_text() == "$A_r$ = 6: no minimum located"
    assert len(right.lines) == 4  # two curves, the place of one minimum, pi/2


def with_circles(cube):
    """A cube of two axes with a circle in its first row, a plane, and a point without a spin that attracts."""
    values = {
        "spin": [[90.0, 80.0], [0.0, np.nan]],
        "radius": [[6.4, 6.2], [np.inf, np.nan]],
        "time": [[60.0, 600.0], [50.0, np.nan]],
    }
    return cube.assign({f"sustained_{name}": (cube["mode"].dims, column) for name, column in values.items()})


def test_chosen_circles_have_their_colours_and_others_are_grey():
    cube = with_circles(cube_of([[D, D], [D, R]], {"e": [0.6, 0.65], "Gamma": [0.8, 0.9]}))
    figure = draw(cube.assign_attrs(plot="circles"))
    radius, time = figure.axes[:2]
    for axes, values in (radius, [6.4, 6.2]), (time, [60.0, 600.0]):
        plane, none, circles = axes.collections
        assert circles.get_offsets().tolist() == [[0.8, 0.6], [0.9, 0.6]] and circles.get_array().tolist() == values
        assert plane.get_offsets().tolist() == [[0.8, 0.65]] and none.get_offsets().tolist() == [[0.9, 0.65]]
    (axes, other) = draw(cube.isel(e=0), "circles").axes
    assert axes.lines[0].get_xydata().tolist() == [[0.8, 6.4], [0.9, 6.2]] and other.get_yscale() == "log"
    with pytest.raises(ParameterError, match="circles: 3 parameters vary"):
        draw(cube.expand_dims(f=[15.0, 20.0]), "circles")


def test_the_ends_of_impacts_lie_at_mu_and_mu_s():
    ends = np.array([[["sp_sp", "sp_sk", "sk_sp"], ["none", "none", "sk_sk"]]])  # over A_r, mu, mu_s
    modes = np.array([[[D, D, D], [M_NOT_RUN, R, D]]])
    codes = np.vectorize(DI_ENDS.index)(ends)
    cube = cube_of(np.full(modes.shape, D), {"A_r": [6], "mu": [0.1, 0.3], "mu_s": [0.4, 0.5, 0.7]}, di_end=codes)
    cube["mode"] = cube["mode"].copy(data=modes)
    figure = draw(cube, "impact_ends")
    (axes,) = figure.axes
    for i, mu in enumerate((0.1, 0.3)):
        for j, mu_s in enumerate((0.4, 0.5, 0.7)):
            color = "#505050" if modes[0, i, j] == M_NOT_RUN else ENDS[ends[0, i, j]]
            assert color_at(axes, mu, mu_s) == color
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"$\mu$", r"$\mu_s$")
    np.testing.assert_allclose(axes.lines[0].get_xdata(), 0.19958, atol=1e-5)
    words = {"none": "no drift found"}
    assert legend_of(figure) == {words.get(end, end): color for end, color in ENDS.items()} | {
        r"$\mu_s < \mu$: not run": "#505050"
    }
    two = cube_of(np.full((2, 2, 2), D), {"A_r": [5, 7], "mu": [0.1, 0.2], "mu_s": [0.3, 0.4]})
    titles = [axes.get_title() for axes in draw(two, "impact_ends").axes]
    assert titles == [r"$A_r$ = 5, $\bar\mu$ = 0.239", r"$A_r$ = 7, $\bar\mu$ = 0.171"]


def test_velocities_along_the_axis_have_the_colour_of_their_end():
    codes = [DI_ENDS.index(end) for end in ("sp_sp", "sk_sk", "sp_sp", "none")]
    cube = with_paths(cube_of([D] * 4, {"A_r": [5, 6, 7, 8]}, di_end=codes))
    cube["axial_velocity"] = ("A_r", [0.01, -0.02, 0.03, np.nan])
    figure = draw(cube, "planar")
    lines = labelled(figure.axes[0])
    assert set(lines) == {"sp_sp", "sk_sk"}
    np.testing.assert_allclose(lines["sp_sp"].get_xydata(), [[5, 10], [7, 30]])
    np.testing.assert_allclose(lines["sk_sk"].get_xydata(), [[6, -20]])
    assert {word: to_hex(line.get_color()) for word, line in lines.items()} == {word: ENDS[word] for word in lines}
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("$A_r$", "drift velocity [mm/s]")


def strobed(cube):
    dims = cube["mode"].dims
    states = np.arange(cube["mode"].size * 4.0).reshape(*cube["mode"].shape, 4)
    columns = {"gap_1": 1e-3 * states, "gap_2": 2e-3 * states + 1, "theta_rate": -states}
    return cube.assign({f"strobe_{name}": ((*dims, "strobe"), values) for name, values in columns.items()})


def test_a_bifurcation_diagram_has_each_state_over_its_value_in_the_colour_of_its_mode():
    cube = strobed(cube_of([R, D, D], {"Gamma": [0.8, 0.9, 1.1]}))
    figure = draw(cube, "bifurcation")
    labels = {
        "gap of $p_1$ [mm]": ("gap_1", 1e3),
        "gap of $p_2$ [mm]": ("gap_2", 1e3),
        r"$\dot\theta$ [rad/s]": ("theta_rate", 1),
    }
    assert [axes.get_ylabel() for axes in figure.axes] == list(labels)
    for axes in figure.axes:
        name, factor = labels[axes.get_ylabel()]
        dots = {to_hex(line.get_color()): line.get_xydata() for line in axes.lines}
        values = factor * cube[f"strobe_{name}"].values
        np.testing.assert_allclose(dots[COLORS["rest"]], np.column_stack([np.full(4, 0.8), values[0]]))
        np.testing.assert_allclose(
            dots[COLORS["drift"]], np.column_stack([np.repeat([0.9, 1.1], 4), values[1:].ravel()])
        )
    assert figure.axes[-1].get_xlabel() == r"$\Gamma$"
    assert legend_of(figure) == {"rest: both ends down": COLORS["rest"], "drift": COLORS["drift"]}


# --- attractors -------------------------------------------------------------------------------------------------------
def shares_of(share, **axis):
    share = np.array(share, float)
    dims = (*axis, "attractor")
    n = share.shape[-1]
    words = np.array(["rest", "drift", "drift"][:n])
    return xr.Dataset(
        {
            "share": (dims, share),
            "share_low": (dims, share - 0.05 * (share > 0)), "share_high": (dims, share + 0.1 * (share > 0)),
            "mode": (dims, np.where(share > 0, words, "")), "periods": (dims, np.where(share > 0, [0, 1, 3][:n], 0)),
            "border": ("change", [0.85, 0.85, np.nan]), "border_kind": ("change", ["fold", "fold", ""]),
            "start": ("start", np.arange(10)),
        },
        {"attractor": np.arange(n), **axis},
    )  # fmt: skip


@pytest.mark.parametrize(("share", "over"), [([0.2, 0.5, 0.3], {}), ([[0.2, 0.5, 0.3]], {"Gamma": [0.9]})])
def test_bars_are_the_shares_of_attractors_with_their_bounds(share, over):
    axes = attractors(shares_of(share, **over)).axes[0]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == [
        "0: rest",
        "1: drift, period 1",
        "2: drift, period 3",
    ]
    bars = axes.containers[-1].patches if hasattr(axes.containers[-1], "patches") else axes.patches
    np.testing.assert_allclose([bar.get_height() for bar in bars], [20, 50, 30])
    looks = [(to_hex(bar.get_facecolor()), bar.get_hatch()) for bar in bars]
    assert looks == [(COLORS["rest"], ""), (COLORS["drift"], ""), (COLORS["drift"], "//")]
    spans = [np.array(segment)[:, 1] for each in axes.collections for segment in each.get_segments()]
    np.testing.assert_allclose(spans, [[15, 30], [45, 60], [25, 40]])
    assert axes.get_ylabel() == "share of the starts [%]"


@pytest.mark.parametrize("step", [1, -1])
def test_areas_are_the_shares_of_attractors_over_a_parameter(step):
    table = shares_of([[0.2, 0.8, 0], [0.5, 0.3, 0.2], [0, 0.4, 0.6]], Gamma=[0.8, 0.9, 1.0])
    figure = attractors(table.isel(Gamma=slice(None, None, step)))
    (axes,) = figure.axes
    areas = [each for each in axes.collections if not hasattr(each, "get_segments")]
    bottoms = np.cumsum([[0, 0, 0], [20, 50, 0], [80, 30, 40]], axis=0)
    for area, bottom, height in zip(areas, bottoms, [[20, 50, 0], [80, 30, 40], [0, 20, 60]], strict=True):
        corners = area.get_paths()[0].vertices
        for x, low, thick in zip((0.8, 0.9, 1.0), bottom, height, strict=True):
            here = corners[np.isclose(corners[:, 0], x), 1]
            np.testing.assert_allclose([here.min(), here.max()], [low, low + thick], atol=1e-9)
    assert [line.get_xdata() for line in axes.lines if line.get_linestyle() == "--"] == [[0.85, 0.85]]
    assert [(text.get_position()[0], text.get_text()) for text in axes.texts] == [(0.85, "fold")]
    assert axes.get_xlim()[0] < 0.8 < 1.0 < axes.get_xlim()[1] and axes.get_ylim() == (0, 100)
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"$\Gamma$", "share of the starts [%]")
    texts, handles = figure.legends[0].get_texts(), figure.legends[0].legend_handles
    colors = {text.get_text(): to_hex(handle.get_facecolor()) for text, handle in zip(texts, handles, strict=True)}
    names = ("0: rest", "1: drift, period 1", "2: drift, period 3")
    assert colors == {name: to_hex(area.get_facecolor()) for name, area in zip(names, areas, strict=True)}


# --- branches, curves and families ------------------------------------------------------------------------------------
def branch_table():
    """A branch that turns back at Gamma = 1.2, stable before its fold; and one of another A_r, unstable."""
    Gamma = [0.8, 1.0, 1.2, 1.0, 0.8, 0.7, 0.9, 1.1]
    radius = [1.0, 2, 3, 4, 5, 10.0, 11, 12]
    special = ["", "", "fold", "", "", "", "", "flip"]
    columns = {
        "Gamma": Gamma, "radius": radius, "period": 2 * np.array(radius), "zeta": -np.array(radius), "special": special,
        "stable": [1, 1, 1, 0, 0, 0, 0, 0], "branch": [0] * 5 + [1] * 3, "A_r": [6.0] * 5 + [7.0] * 3,
    }  # fmt: skip
    return xr.Dataset(
        {name: ("point", values) for name, values in columns.items()}, attrs={"parameter": "Gamma", "title": "t"}
    )


def runs_of(axes):
    """Pieces of the drawn curves of a panel: their style, and the least and greatest place along the parameter."""
    pieces = [line for line in axes.lines if line.get_linestyle() in ("-", "--") and line.get_xdata().size]
    return [(line.get_linestyle(), *np.round([line.get_xdata().min(), line.get_xdata().max()], 9)) for line in pieces]


@pytest.mark.parametrize("flip_is_stable", [0, 1])
def test_a_branch_is_solid_up_to_its_flip_and_no_further(flip_is_stable):
    columns = {"Gamma": [1.0, 1.2, 1.29, 1.33, 1.4], "stable": [1, 1, flip_is_stable, 0, 0], "branch": [0] * 5}
    columns |= {name: np.arange(1.0, 6) for name in ("radius", "period", "zeta")} | {
        "special": ["", "", "flip", "", ""]
    }
    table = xr.Dataset({name: ("point", each) for name, each in columns.items()}, attrs={"parameter": "Gamma"})
    figure = draw_borders(table)
    for axes in figure.axes:
        assert runs_of(axes) == [("-", 1.0, 1.29), ("--", 1.29, 1.4)]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["stable", "unstable", "flip"]
    figure = draw_borders(table.isel(point=[0, 1]))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["stable"]


def test_a_legend_of_curves_names_what_is_drawn_alone():
    table = curve_table()
    figure = draw_borders(table.assign(ball=table["ball"] * np.nan))
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "ball, closed form" in [text.get_text() for text in draw_borders(table).legends[0].get_texts()]
    assert "ball, closed form" not in words
    kind = next(word for word in words if word in set(table["kind"].values.tolist()))
    lost = table["Gamma"].where(table["kind"] != kind)
    assert kind not in [text.get_text() for text in draw_borders(table.assign(Gamma=lost)).legends[0].get_texts()]


def test_branches_are_solid_where_they_are_stable_and_marked_where_they_change():
    table = branch_table()
    figure = draw_borders(table)
    for axes, (name, label) in zip(
        figure.axes, (("radius", "radius [m]"), ("period", "period [s]"), ("zeta", r"$\zeta$ [rad]")), strict=True
    ):
        assert axes.get_ylabel() == label
        lines = [line for line in axes.lines if line.get_linestyle() in ("-", "--") and line.get_xdata().size]
        points = np.column_stack([table["Gamma"], table[name]])
        for part, style, color in (([0, 1, 2], "-", "C0"), ([3, 4], "--", "C0"), ([5, 6, 7], "--", "C1")):
            (line,) = [
                each for each in lines if each.get_linestyle() == style and to_hex(each.get_color()) == to_hex(color)
            ]
            for point in points[part]:
                assert np.abs(line.get_xydata() - point).max(axis=1).min() < 1e-9
        marks = {
            line.get_marker(): line.get_xydata()
            for line in axes.lines
            if line.get_marker() != "None" and line.get_xdata().size
        }
        np.testing.assert_array_equal(marks["s"], points[[2]])
        np.testing.assert_array_equal(marks["D"], points[[7]])
    texts, handles = figure.legends[0].get_texts(), figure.legends[0].legend_handles
    told = {text.get_text(): handle for text, handle in zip(texts, handles, strict=True)}
    assert (told["stable"].get_linestyle(), told["unstable"].get_linestyle()) == ("-", "--")
    assert (told["fold"].get_marker(), told["flip"].get_marker()) == ("s", "D")
    assert [to_hex(told[f"$A_r$ = {A_r}"].get_color()) for A_r in (6, 7)] == [to_hex("C0"), to_hex("C1")]
    assert figure.axes[-1].get_xlabel() == r"$\Gamma$"


def curve_table(**change):
    """Borders of Gamma over e, for two values of A_r, with the ball's closed form at 2 e; stable between 0.5 + e and 2 + e."""
    e, A_r = np.array([0.5, 0.6, 0.7]), np.array([5.0, 6.0])
    kinds = ["fold", "double_impact", "stable_from", "stable_to"]
    grid = A_r[:, None] * 0.1 + e
    Gamma = np.array([grid, grid + 1, 0 * grid + 0.5 + e, 0 * grid + 2 + e])
    ball = np.array([0 * grid + 2 * e, *[grid * np.nan] * 3])
    loses = np.array([0 * grid + [1, 0, 1], *[grid * np.nan] * 3])
    dims = ("border", "A_r", "e")
    columns = {"Gamma": (dims, Gamma), "ball": (dims, ball), "loses_stability": (dims, loses)}
    return xr.Dataset(
        columns, {"kind": ("border", kinds), "A_r": A_r, "e": e}, {"parameter": "Gamma", "title": "t"} | change
    )


def test_curves_of_borders_are_drawn_over_their_last_axis_in_the_style_of_the_others():
    cube = cube_of([[R, D, D], [D, R, R]], {"Gamma": [0.9, 1.1], "e": [0.5, 0.6, 0.7]})
    table = curve_table()
    figure = drawn(draw_borders(table, cube), laid_out=False)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$e$", r"$\Gamma$")
    for k, style in enumerate(("-", "--")):
        Gamma = table["Gamma"].isel(A_r=k).values
        mine = [line for line in axes.lines if line.get_linestyle() == style]
        pale, strong = (line for line in mine if to_hex(line.get_color()) == "#0072b2")  # fold
        np.testing.assert_array_equal(pale.get_xydata(), np.column_stack([table["e"], Gamma[0]]))
        np.testing.assert_array_equal(strong.get_ydata(), [Gamma[0, 0], np.nan, Gamma[0, 2]])
        assert (pale.get_alpha(), strong.get_alpha()) == (0.35, None)
        (other,) = (line for line in mine if to_hex(line.get_color()) == "#009e73")
        np.testing.assert_array_equal(other.get_ydata(), Gamma[1])
    (ball,) = (line for line in axes.lines if to_hex(line.get_color()) == BLACK)
    np.testing.assert_allclose(ball.get_xydata(), np.column_stack([table["e"], 2 * table["e"]]))
    shades = [each.get_paths()[0] for each in axes.collections if not hasattr(each, "get_coordinates")]
    for path in shades:
        assert [path.contains_point((0.6, Gamma)) for Gamma in (1.0, 1.2, 2.5, 2.7)] == [False, True, True, False]
    assert len(shades) == 2
    assert color_at(axes, 0.5, 1.1) == COLORS["drift"] == color_at(axes, 0.6, 0.9)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"$A_r$ = 5", "$A_r$ = 6", "fold", "double_impact", "ball, closed form"} <= set(texts)


def family_table():
    """Two families over the spin: the period of one has a minimum, that of the other falls on."""
    spin = np.array([90.0, 100, 110, 120])
    period = np.array([[5.0, 4, 6, 7], [9, 8, 7, 6.5]])
    columns = {"radius": period + 1, "period": period, "zeta": period / 5, "spin_drift": -0.01 * period * spin}
    table = xr.Dataset(
        {name: (("over", "spin"), values) for name, values in columns.items()},
        {"spin": spin, "A_r": ("over", [5.0, 6.0])},
    )
    table.attrs = {"title": "t", "what": "families"}
    return table


def test_families_are_drawn_over_their_spin_with_the_least_period():
    spin, period = np.array([90.0, 100, 110, 120]), np.array([[5.0, 4, 6, 7], [9, 8, 7, 6.5]])
    radius, seconds, zeta, decay = draw_borders(family_table()).axes
    for k in range(2):
        for axes, values in ((radius, period[k] + 1), (seconds, period[k]), (zeta, period[k] / 5)):
            np.testing.assert_allclose(labelled(axes)[f"$A_r$ = {5 + k}"].get_xydata(), np.column_stack([spin, values]))
        np.testing.assert_allclose(decay.lines[k].get_xydata(), np.column_stack([spin, 0.01 * period[k]]))
    marks = [line.get_xydata() for line in seconds.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(marks, [[[100, 4]]])  # the other one falls on
    assert [axes.get_ylabel() for axes in (radius, seconds, zeta)] == ["radius [m]", "period [s]", r"$\zeta$ [rad]"]
    assert decay.get_xlabel() == zeta.get_xlabel() == "axial spin [rad/s]"


# --- fits -------------------------------------------------------------------------------------------------------------
def test_a_fit_is_drawn_with_its_ellipses():
    values, ranges = {"e": 0.6, "Gamma": 0.9, "f": 15.0}, {"e": (0.5, 0.7), "Gamma": (0.8, 1.2), "f": (10.0, 20.0)}
    root = np.array([[0.01, 0, 0], [0.02, 0.01, 0], [-0.3, 0.2, 0.5]])
    covariance = root @ root.T
    figure = draw_fit(values, covariance, ranges)
    names = list(values)
    labels = {"e": "$e$", "Gamma": r"$\Gamma$", "f": "$f$ [Hz]"}
    for row in range(2):
        for column in range(row + 1):
            axes = figure.axes[2 * row + column]
            pair = [column, row + 1]
            inverse = np.linalg.inv(covariance[np.ix_(pair, pair)])
            centre = np.array([values[names[k]] for k in pair])
            for region, times in zip(axes.collections, (2, 1), strict=True):
                (ellipse,) = region.get_paths()
                away = ellipse.vertices - centre
                np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, inverse, away), times**2)
                assert region.get_label() == f"{times} standard deviation{'s' * (times > 1)}"
            np.testing.assert_array_equal(axes.lines[0].get_xydata(), [centre])
            assert (axes.get_xlim(), axes.get_ylim()) == (ranges[names[column]], ranges[names[row + 1]])
            if row == 1:
                assert axes.get_xlabel() == labels[names[column]]
        assert figure.axes[2 * row].get_ylabel() == labels[names[row + 1]]


def test_a_fit_of_one_parameter_is_drawn_as_its_density():
    (axes,) = draw_fit({"f": 15.0}, np.array([[0.25]]), {"f": (10.0, 20.0)}).axes
    x, y = axes.lines[0].get_xydata().T
    np.testing.assert_allclose(y, np.exp(-2 * (x - 15) ** 2))
    np.testing.assert_allclose([(span.get_x(), span.get_width()) for span in axes.patches], [(14, 2), (14.5, 1)])
    assert axes.get_xlabel() == "$f$ [Hz]"


# --- runs -------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def run():
    """A drift whose balls are unlike, on a plate that moves sideways too."""
    return dimersweep.simulate(periods=60, r_2=5.02e-3, r_1=5e-3)


@pytest.mark.jit
def test_the_picture_of_a_run_has_its_heights_its_orbit_and_its_portraits(run):
    figure = run_figure(run, periods=3)
    heights, path, *portraits = figure.axes
    assert [axes.get_title(loc="left")[:3] for axes in figure.axes] == ["(a)", "(b)", "(c)", "(d)", "(e)"]
    lines = labelled(heights)
    states = run.states(lines["$p_1$"].get_xdata() / 15)
    assert lines["$p_1$"].get_xdata()[[0, -1]] == pytest.approx([57, 60])
    for label, values, color in (
        ("$p_1$", states["plate"] + states["gap_1"], RED),
        ("$p_2$", states["plate"] + states["gap_2"], BLACK),
        ("plate", states["plate"], "#56b4e9"),
    ):
        np.testing.assert_allclose(lines[label].get_ydata(), 1e3 * values, atol=1e-9)
        assert to_hex(lines[label].get_color()) == color
    assert (heights.get_xlabel(), heights.get_ylabel()) == ("time [forcing periods]", "height [mm]")
    x, y = path.lines[0].get_xydata().T
    whole = run.states(np.linspace(0, 4, x.size))
    np.testing.assert_allclose(x, whole["x"], atol=1e-12)
    np.testing.assert_allclose(y, whole["y"], atol=1e-12)
    (arrows,) = (each for each in path.collections if hasattr(each, "U"))
    for at, u, v in zip(arrows.get_offsets(), arrows.U, arrows.V, strict=True):
        k = int(np.argmin(np.hypot(x - at[0], y - at[1])))
        ahead = np.array([x[k + 40] - x[k], y[k + 40] - y[k]])
        np.testing.assert_allclose([u, v], ahead, atol=1e-12)
    assert arrows.angles == "xy"
    np.testing.assert_array_equal(path.lines[1].get_xydata(), [[x[0], y[0]]])
    assert (path.get_xlabel(), path.get_ylabel()) == ("$x$ [m]", "$y$ [m]")
    names = {
        "beta": (r"$\beta$ [rad]", r"\beta"),
        "theta": (r"$\theta - \theta_0$ [rad]", r"\theta"),
        "gamma": (r"$\gamma - \gamma_0$ [rad]", r"\gamma"),
    }
    start, stop = last_cycle(run)
    fine = run.states(np.linspace(start, stop, 4001))
    for axes, (angle, (label, letter)) in zip(portraits, names.items(), strict=True):
        assert (axes.get_xlabel(), axes.get_ylabel()) == (label, rf"$\dot{{{letter}}}$ [rad/s]")
        values = fine[angle].values - (0 if angle == "beta" else fine[angle].values[0])
        rates = fine[f"{angle}_rate"].values
        pieces = [line.get_xydata() for line in axes.lines if line.get_linestyle() in ("-", "--")]
        points = np.concatenate(pieces)
        scale = np.array([np.ptp(values), np.ptp(rates)])
        for k in range(0, 4001, 400):
            assert (np.abs(points - [values[k], rates[k]]) / scale).max(axis=1).min() < 5e-3
        down = fine["contact_state"].values != 0
        dashed = sum(len(line.get_xdata()) for line in axes.lines if line.get_linestyle() == "--")
        assert dashed / len(points) == pytest.approx(down.mean(), abs=0.02)


@pytest.mark.jit
def test_a_motion_that_does_not_repeat_is_drawn_by_its_section():
    run = dimersweep.simulate(Gamma=1.75, e=0.6, periods=120)
    assert run.mode == "aperiodic"
    _, _, beta, theta, spin = run_figure(run).axes
    section = run.section()
    np.testing.assert_array_equal(
        beta.lines[0].get_xydata(), np.column_stack([section["beta"], section["beta_rate"]])[60:]
    )
    for axes, name, letter in ((theta, "theta_rate", r"\theta"), (spin, "gamma_rate", r"\gamma")):
        rates = section[name].values
        np.testing.assert_array_equal(axes.lines[0].get_xydata(), np.column_stack([rates[:-1], rates[1:]])[59:])
        assert (axes.get_xlabel(), axes.get_ylabel()) == (
            rf"$\dot{{{letter}}}_n$ [rad/s]",
            rf"$\dot{{{letter}}}_{{n+1}}$ [rad/s]",
        )


@pytest.mark.jit
def test_the_bars_of_a_budget_are_its_works(run):
    axes = Figure().subplots()
    energy_budget(axes, run, periods=10)
    budget = run.energy("event")
    late = budget.isel(part=np.flatnonzero(budget["time"].values >= 50 / 15 * (1 - 1e-12)))
    words = {
        "plate_1": "from the plate, $p_1$", "restitution_1": "restitution, $p_1$", "restitution_2": "restitution, $p_2$",
        "slip_1": "slip, $p_1$", "slip_2": "slip, $p_2$", "plate_2": "from the plate, $p_2$",
    }  # fmt: skip
    rows = [tick.get_text() for tick in axes.get_yticklabels()]
    bars = {container.get_label(): [bar.get_width() for bar in container] for container in axes.containers}
    for name, label in words.items():
        for row, kind in enumerate(rows):
            here = np.ones(late.sizes["part"], bool) if kind == "all" else names(late["kind"]).values == kind
            work = 1e5 * late[name].values[here].sum()
            if label in bars:
                assert bars[label][row] == pytest.approx(work, rel=1e-5, abs=1e-3 * max(map(abs, bars[label])))
    assert set(words.values()) >= bars.keys() and len(bars) >= 4
    assert bars["slip, $p_1$"][-1] < 0
    colors = {container.get_label(): to_hex(container.patches[0].get_facecolor()) for container in axes.containers}
    dark = {"from the plate, $p_1$": "#1b7837", "restitution, $p_1$": "#2166ac", "slip, $p_1$": "#b2182b"}
    assert dark.items() <= colors.items()
    assert axes.get_xlabel() == "work on the dimer, per forcing period [µJ]"


def check_marks(lines, shown, k, look, balls):
    """Each mark goes from pole to pole of its ball, through the place of the mark or the opposite one, where it is seen."""
    axis, toward = np.diff(shown.balls[k], axis=0)[0], np.cross(*look)
    axis /= np.linalg.norm(axis)
    for line, ball, side in zip(lines, np.repeat(balls, 2), (1, -1, 1, -1), strict=True):
        places = (line.get_xydata() - ball.center) / ball.radius
        angles = np.linspace(0, np.pi, len(places))
        points = np.outer(np.cos(angles), axis) + side * np.outer(np.sin(angles), shown.mark[k])
        seen = points @ toward > 0
        np.testing.assert_array_equal(np.isfinite(places), np.column_stack([seen, seen]))
        np.testing.assert_allclose(places[seen], 0.92 * points[seen] @ np.transpose(look), atol=1e-12)
    assert len({to_hex(line.get_color()) for line in lines}) == 2


@pytest.mark.jit
def test_a_movie_shows_the_balls_where_they_are(run):
    shown = playing.frames(run, playing.playback_of(run, 2, fps=10))
    states = run.states(shown.cycles / 15)
    side, above = Figure().subplots(1, 2)
    updates = movie._side_view(side, shown), movie._view_from_above(above, shown)
    length, told = 5 * (5 + 5.02), view.seen(run, playing.playback_of(run, 2, fps=10))
    for k in (0, 5, 9):
        at = {name: 1e3 * states[name].values[k] for name in ("x1", "y1", "z1", "x", "y", "plate")}
        beta, theta = states["beta"].values[k], states["theta"].values[k]
        flat = length * np.cos(beta)
        first = np.array([at["x1"], at["y1"], at["z1"]])
        second = first + np.array([-flat * np.sin(theta), flat * np.cos(theta), length * np.sin(beta)])
        table, rod, one, two, *marks = updates[0](k)
        np.testing.assert_allclose([one.center, two.center], [(0, first[2]), (flat, second[2])])
        np.testing.assert_allclose(rod.get_xydata(), [(0, first[2]), (flat, second[2])])
        assert table.get_y() + table.get_height() == pytest.approx(at["plate"])
        assert (one.radius, two.radius) == pytest.approx((5, 5.02))
        assert [to_hex(ball.get_facecolor()) for ball in (one, two)] == [RED, "#0072b2"]
        check_marks(marks, shown, k, [np.append(shown.along[k], 0), [0, 0, 1]], (one, two))
        _, track, rod, one, two, *marks = updates[1](k)
        check_marks(marks, shown, k, [[1, 0, 0], [0, 1, 0]], (one, two))
        np.testing.assert_allclose([one.center, two.center], [first[:2], second[:2]])
        np.testing.assert_allclose(rod.get_xydata(), [one.center, two.center])
        np.testing.assert_allclose(track.get_xydata()[-1], (at["x"], at["y"]))
        assert len(track.get_xdata()) == k + 1
        np.testing.assert_allclose(told["balls"][k], [*first, *second], atol=1e-2)
        assert told["plate"][k] == pytest.approx(at["plate"], abs=1e-2)
    assert (side.get_xlabel(), side.get_ylabel()) == ("along the rod [mm]", "height [mm]")
    assert (above.get_xlabel(), above.get_ylabel()) == ("$x$ [mm]", "$y$ [mm]")
    assert [(text.get_text(), to_hex(text.get_color())) for text in side.texts] == [
        ("$p_1$", RED),
        ("$p_2$", "#0072b2"),
    ]


# --- styles, places and files ----------------------------------------------------------------------------------------
STYLES = ("default", "dark_background", "ggplot")
ONE_PANEL = ("mode_map", "segments", "planar", "regions", "attractors", "bars", "curves", "ways", "quantity")


def picture_of(kind, run, **look):
    """A picture of each kind that there is."""
    if kind in ("attractors", "bars"):
        table = shares_of([[0.2, 0.8, 0], [0.5, 0.3, 0.2], [0, 0.4, 0.6]], Gamma=[0.8, 0.9, 1.0])
        return attractors(table if kind == "attractors" else table.isel(Gamma=1), **look)
    if kind in ("branches", "curves", "families"):
        return draw_borders({"branches": branch_table, "curves": curve_table, "families": family_table}[kind](), **look)
    if kind == "fit":
        return draw_fit(
            {"e": 0.6, "Gamma": 0.9, "f": 15.0}, 1e-4 * np.eye(3), dict.fromkeys(("e", "Gamma", "f"), (0, 20)), **look
        )
    if kind == "waveform":
        return Waveform(15.0, {"z": {1: (0.9, 0.0), 2: (0.02, 1.0)}}).plot(**look)
    if kind == "run":
        return run_figure(run, **look)
    if kind == "quantity":
        cube = cube_of(np.full((2, 2), D), {"f": [15, 20], "e": [0.5, 0.6]}, radius=[[1.0, 2], [3, 4]])
        return draw(cube, quantity="radius", **look)
    if kind == "ways":
        both = [cube_of([D, D, D], {"Gamma": [0.8, 0.9, 1.1]}, zeta=[1.0, 2, k]) for k in (3, 4)]
        return draw(xr.concat(both, dim="direction").assign_coords(direction=[0, 1]), quantity="zeta", **look)
    return draw(CUBES[kind](), kind, **look)


KINDS = (
    *("mode_map", "segments", "regions", "trends", "minimum", "impact_ends", "paths", "walks", "planar", "bifurcation"),
    *("circles", "quantity", "ways", "attractors", "bars", "branches", "curves", "families", "fit", "waveform", "run"),
)


# heights of pictures that are 8.6 cm wide [inches]; one of trends, three rows by two columns of panels, is for a whole page
HEIGHTS = dict.fromkeys(KINDS, 3.4) | dict.fromkeys(("minimum", "circles", "fit", "waveform", "walks"), 6.0)
HEIGHTS |= dict.fromkeys(("branches", "paths", "bifurcation"), 7.0) | dict.fromkeys(("families", "impact_ends"), 9.0)
HEIGHTS |= {"run": 10.0}
del HEIGHTS["trends"]


def texts_of(figure):
    """The texts of a figure that are seen, with their boxes: ticks beyond the ends of an axis are not."""
    beyond = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low - 1e-6 * (high - low) <= tick.get_loc() <= high + 1e-6 * (high - low):
                    beyond |= {tick.label1, tick.label2}
        beyond |= set() if axes.axison and axes.get_visible() else {*axes.findobj(Text)}
    seen = [
        text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip() and text not in beyond
    ]
    return [(text.get_text(), text.get_window_extent()) for text in seen]


@pytest.mark.jit
@pytest.mark.parametrize("kind", HEIGHTS)
def test_no_text_is_over_another_in_a_column_of_a_paper(kind, run):
    with rc_context({"font.size": 8}):
        figure = picture_of(kind, run, size=(8.6 / 2.54, HEIGHTS[kind]))
        figure.draw_without_rendering()
        texts, page = texts_of(figure), figure.bbox
        assert len(texts) > 4
        for (one, a), (other, b) in combinations(texts, 2):
            over = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
            assert min(over) <= 1, (one, other)
        for text, box in texts:
            assert min(box.x0, box.y0, page.x1 - box.x1, page.y1 - box.y1) > -1, text
        panels = [axes.get_window_extent() for axes in figure.axes if axes.axison and axes.get_visible()]
        for legend in figure.legends:
            assert legend.get_window_extent().y1 <= min(panel.y0 for panel in panels)


def test_words_are_as_large_as_the_style_says():
    sizes = []
    for size in (6, 12):
        with rc_context({"font.size": size}):
            sizes.append(
                np.unique(
                    [text.get_fontsize() for text in drawn(picture_of("mode_map", None), laid_out=False).findobj(Text)]
                )
            )
    assert sizes[0].size > 1 and np.allclose(2 * sizes[0], sizes[1])


def test_a_variable_of_an_observer_has_its_own_label():
    cube = cube_of(np.full((2, 2), D), {"f": [15, 20], "e": [0.5, 0.6]})
    told = {"units": "m s-1", "long_name": "mean rate of the gap"}
    cube = cube.assign(gap_mean=(cube["mode"].dims, np.arange(4.0).reshape(2, 2), told))
    assert draw(cube, quantity="gap_mean").axes[1].get_ylabel() == "mean rate of the gap [m/s]"
    assert draw(cube.isel(e=[0]), quantity="gap_mean").axes[0].get_ylabel() == "mean rate of the gap [m/s]"
    cube["gap_mean"].attrs = {}
    assert draw(cube, quantity="gap_mean").axes[1].get_ylabel() == "gap_mean"


def test_certified_segments_show_which_modes_are_unsure():
    beta0 = np.deg2rad([10.0, 20, 30, 40])
    cube = cube_of([[R, D, D, D], [D, D, D, R]], {"f": [15, 20], "beta0": beta0})
    sure = np.array([[1, 2, 1, 3], [1, 1, 2, 1]], np.int8)
    words = {"flag_values": np.arange(4, dtype=np.int8), "flag_meanings": " ".join(FLAGS["confidence"])}
    figure = draw(cube.assign(confidence=(cube["mode"].dims, sure, words)), "segments")
    (marks,) = [line for line in figure.axes[0].lines if line.get_marker() == "|"]
    np.testing.assert_allclose(marks.get_xydata(), [(beta0[1], 0), (beta0[3], 0), (beta0[2], 1)])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mode unsure, or another one near"]
    certain = cube.assign(confidence=(cube["mode"].dims, np.ones_like(sure), words))
    assert not draw(certain, "segments").legends


def all_apart(colors, least=20):
    """Each two of them, to all readers."""
    return not [pair for pair in combinations(colors, 2) if apart(*pair) < least]


@pytest.mark.parametrize("name", STYLES)
def test_colours_are_told_apart_by_readers_with_deuteranopia_and_protanopia(name):
    with in_style.context(name):
        assert all_apart(mode_colors().values())
        assert all_apart(row_colors(len(ROW_COLORS)))
        assert all_apart([*END_COLORS.values(), LEFT_OUT_COLOR])
        assert all_apart([color for term, (_, color) in TERMS.items() if term not in SLIPS])
        assert all_apart([color for term, (_, color) in TERMS.items() if term in SLIPS])  # hatched
        words = ["rest", "aperiodic", "rolls", "slides", "failed", "unresolved", *["drift"] * 14, "flutter", "jump"]
        for named in (words[:MOST_NAMED], words[::-1][:MOST_NAMED]):
            table = xr.Dataset({"mode": ("attractor", named)}, {"attractor": np.arange(len(named))})
            for (one, hatch), (other, across) in combinations(looks_of(table), 2):
                assert hatch != across or apart(one, other) >= 20


# on a dark ground, most is lost that a picture does not take from the style
OF_RELEASE = [name if name == "dark_background" else pytest.param(name, marks=pytest.mark.release) for name in STYLES]


@pytest.mark.jit
@pytest.mark.parametrize("name", OF_RELEASE)
@pytest.mark.parametrize("kind", KINDS)
def test_lines_and_words_are_seen_on_the_ground_of_each_style(kind, name, run):
    with in_style.context(name):
        figure = picture_of(kind, run)
        drawn(figure, laid_out=bool(figure.legends))
        for axes in figure.axes:
            for line in axes.lines:
                for color in (line.get_color(), line.get_markeredgecolor()) if line.get_alpha() is None else ():
                    assert apart(color, axes.get_facecolor()) >= 20, (line.get_label(), color)
            for text in axes.findobj(Text):
                assert apart(text.get_color(), figure.get_facecolor()) >= 20, text
        for each in figure.legends:
            panels = [axes.get_window_extent() for axes in figure.axes if axes.axison]
            assert not any(each.get_window_extent().overlaps(panel) for panel in panels)


# pictures share what writes them: here are words, numbers of all signs and formulas
WRITTEN = ("walks",)


@pytest.mark.jit
@pytest.mark.parametrize(
    "kind", [kind if kind in WRITTEN else pytest.param(kind, marks=pytest.mark.release) for kind in KINDS]
)
def test_files_have_fonts(kind, run, tmp_path):
    figure = picture_of(kind, run)
    figure.set_layout_engine("none")
    figure.savefig(tmp_path / "a.pdf")
    write_picture(figure, tmp_path / "a.svg")
    told = (tmp_path / "a.pdf").read_bytes()
    assert b"/CIDFontType2" in told and b"/Type3" not in told
    assert "<text" in (tmp_path / "a.svg").read_text(encoding="utf-8")


@pytest.mark.jit
@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_is_drawn_where_it_is_wanted(kind, run):
    own = picture_of(kind, run, size=(5, 6), title="")
    assert own.get_size_inches().tolist() == [5, 6] and not own.get_suptitle()
    part, other = (whole := Figure((20, 7), layout="constrained")).subfigures(1, 2)
    assert picture_of(kind, run, ax=part, title="mine") is part
    assert part.get_suptitle() == "mine" and len(part.axes) == len(own.axes)
    assert not other.axes and not whole.get_suptitle()
    drawn(whole, laid_out=False)
    left, right = (figure := Figure((12, 4), layout="constrained")).subplots(1, 2)
    if kind not in ONE_PANEL:
        with pytest.raises(
            ParameterError, match=r"^ax: is one Axes for a picture of [2-9] panels; give a Figure or SubFi"
        ):
            picture_of(kind, run, ax=left)
        return
    assert picture_of(kind, run, ax=left, title="mine") is figure
    assert left.get_title() == "mine" and left.has_data() and not right.has_data() and not figure.get_suptitle()
    assert not figure.legends and (kind in ("segments", "quantity", "bars")) == (left.get_legend() is None)
    drawn(figure)
    assert isinstance(left, Axes) and left.get_window_extent().width > 1


def test_round_off_fills_no_panel():
    tiny = cube_of([D, D, D], {"Gamma": [0.8, 0.9, 1.1]}, zeta=[1e-31, -2e-31, 3e-31])
    low, high = draw(tiny, quantity="zeta").axes[0].get_ylim()
    assert high - low > 0.01
    cube = cube_of(np.full((2, 2), D), {"f": [15, 20], "e": [0.5, 0.6]}, zeta=np.pi / 2 + 1e-15 * np.eye(2))
    low, high = draw(cube, quantity="zeta").axes[0].collections[0].get_clim()
    assert high - low > 0.01 and low < np.pi / 2 < high


@pytest.mark.jit
def test_no_arrow_is_cut(run):
    axes = Figure().subplots()
    orbit(axes, run)
    drawn(axes.figure)
    (arrows,) = (each for each in axes.collections if hasattr(each, "U"))
    heads = arrows.get_offsets() + np.column_stack([arrows.U, arrows.V]) / arrows.scale
    for values, (low, high) in zip(heads.T, (axes.get_xlim(), axes.get_ylim()), strict=True):
        assert low < values.min() and values.max() < high


# --- next to nothing --------------------------------------------------------------------------------------------------
CUBES = {
    "mode_map": lambda: cube_of([[R, D, D], [D, R, R]], {"f": [15, 20], "e": [0.4, 0.5, 0.7]}),
    "segments": lambda: cube_of([[R, D, D], [D, R, R]], {"f": [15, 20], "beta0": [0.1, 0.2, 0.4]}),
    "trends": lambda: laws()[0],
    "minimum": lambda: cube_of(
        np.full((2, 25), D), {"A_r": [5, 6], "xdot0": np.linspace(1, 7, 25)}, period=np.full((2, 25), 2.0)
    ),
    "impact_ends": lambda: cube_of(np.full((2, 2, 3), D), {"A_r": [5, 6], "mu": [0.1, 0.3], "mu_s": [0.4, 0.5, 0.7]}),
    "paths": lambda: with_paths(cube_of([D, D, D], {"f": [15, 20, 25]})),
    "walks": lambda: with_paths(cube_of([D, D, D], {"f": [15, 20, 25]})),
    "planar": lambda: with_paths(cube_of([D, D, D], {"f": [15, 20, 25]})).assign(axial_velocity=("f", [1.0, 2, 3])),
    "bifurcation": lambda: strobed(cube_of([R, D, D], {"Gamma": [0.8, 0.9, 1.1]})),
    "circles": lambda: with_circles(cube_of([[D, D], [D, R]], {"e": [0.6, 0.65], "Gamma": [0.8, 0.9]})),
    "regions": lambda: region_map()[1],
}


def with_values(cube, mode, value):
    """A cube with one mode and one value all over."""
    made = cube.copy(deep=True)
    for name, each in made.data_vars.items():
        if each.dtype.kind == "f":
            made[name] = each.copy(data=np.full(each.shape, value))
    made["mode"] = made["mode"].copy(data=np.full(made["mode"].shape, mode, made["mode"].dtype))
    return made


@pytest.mark.parametrize("kind", [*CUBES, "quantity"])
def test_a_picture_of_next_to_nothing_is_drawn_or_refused_in_a_line(kind):
    cube = CUBES["mode_map" if kind == "quantity" else kind]()
    dims = cube["mode"].dims
    parts = [cube.isel({dim: slice(0, 1) for dim in dims})] if len(dims) > 1 else []
    parts += [cube.isel({dim: slice(0, n)}) for dim in dims for n in (0, 1)]
    parts += [cube.isel(dict.fromkeys(dims, 0))]
    # what does not drift has no values
    parts += [with_values(cube, *each) for each in ((D, np.nan), (D, 2.0), (R, np.nan), (M_NOT_RUN, np.nan))]
    made = 0
    two = [cube.isel({dim: slice(0, 2)}) for dim in dims if cube.sizes[dim] > 2]  # axes as those of three
    for k, part in enumerate([*parts, *two]):
        try:
            figure = draw(part, quantity="radius") if kind == "quantity" else draw(part, kind)
            if k < len(parts):
                drawn(figure, laid_out=made == 0)
            made += 1
        except ParameterError as error:
            assert "\n" not in str(error)
    assert made >= 3


def test_points_that_are_all_alike_or_few_are_drawn_or_refused():
    alike = built(make_points({"f": [15, 15, 15], "e": [0.6, 0.6, 0.6]}), [D, D, D])
    one = built(make_points({"f": [15], "e": [0.6]}), [D])
    for cube in (alike, one, one.isel(point=[])):
        for quantity in (None, "radius"):
            with pytest.raises(
                ParameterError,
                match=r"^mode_map: (all points have the same parameters; needs one|has axes none|the axis)",
            ):
                draw(cube, quantity=quantity)
    two = built(make_points({"f": [15, 15, 20], "e": [0.6, 0.6, 0.6]}), [D, D, D])
    for quantity in (None, "radius"):
        (dots,) = drawn(draw(two, quantity=quantity), laid_out=False).axes[0].collections
        assert len(dots.get_offsets()) == 3


def test_trends_over_one_value_have_no_exponent_there():
    cube, _ = laws()
    titles = [axes.get_title() for axes in draw(cube.isel(A_r=[0]), "trends").axes]
    assert titles[0] == "no exponent: too few points drift" and titles[1].startswith("$f^{-2.000 ")


def test_branches_curves_and_families_of_next_to_nothing_are_drawn():
    table = branch_table()
    unknown = table.assign(dict.fromkeys(("radius", "period", "zeta"), table["radius"] * np.nan))
    for part in (table.isel(point=[0]), table.isel(point=[0, 0]), unknown):
        drawn(draw_borders(part.assign_attrs(table.attrs)), laid_out=False)
    curves = curve_table()
    for part in (
        curves.isel(e=[0]),
        curves.isel(A_r=[0]),
        curves.assign(Gamma=curves["Gamma"] * np.nan, ball=curves["ball"] * np.nan),
    ):
        drawn(draw_borders(part), laid_out=False)
    spin = np.array([90.0, 100])
    for values in ([[np.nan, np.nan]], [[5.0, np.nan]], [[5.0, 5.0]]):
        columns = {name: (("over", "spin"), np.array(values)) for name in ("radius", "period", "zeta", "spin_drift")}
        table = xr.Dataset(columns, {"spin": spin, "A_r": ("over", [6.0])}, {"what": "families"})
        drawn(draw_borders(table), laid_out=values == [[5.0, 5.0]])


@pytest.mark.parametrize("share", [[1.0], [0.0, 0.0], [np.nan, np.nan]])
def test_attractors_of_next_to_nothing_are_drawn(share):
    drawn(attractors(shares_of(share)))
    drawn(attractors(shares_of([share], Gamma=[0.9])), laid_out=False)
    drawn(attractors(shares_of([share, share], Gamma=[0.9, 1.0])))


@pytest.mark.parametrize(
    "covariance",
    [np.zeros((2, 2)), [[1e-4, 1e-4], [1e-4, 1e-4]], [[np.inf, np.nan], [np.nan, 1e-4]], np.full((2, 2), np.nan)],
)
def test_a_fit_that_is_exact_or_open_is_drawn(covariance):
    covariance, ranges = np.array(covariance, float), {"e": (0.5, 0.7), "Gamma": (0.8, 1.2)}
    drawn(draw_fit({"e": 0.6, "Gamma": 0.9}, covariance, ranges))
    drawn(draw_fit({"e": 0.6}, covariance[:1, :1], {"e": (0.5, 0.7)}))


@pytest.mark.jit
@pytest.mark.parametrize(
    "scene",
    [{"Gamma": 0.0, "xdot0": 0.0, "beta0": 0.0}, {"Gamma": 0.5}, {"Gamma": 3.0}],
)
def test_a_run_of_next_to_nothing_is_drawn(scene, tmp_path):
    run = dimersweep.simulate(periods=1, **scene)
    drawn(run_figure(run), laid_out=scene["Gamma"] == 0)
    axes = Figure().subplots()
    energy_budget(axes, run)
    orbit(Figure().subplots(), run)
    run.animate(tmp_path / "a.gif", periods=1, fps=5, dpi=20)
