"""States that are carried along an axis: each run goes on where the one before it ended, whoever makes them."""

import json
from math import sin
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep import bifurcation, loops, names, open_cube, orbits, plots, simulate, sweep
from dimersweep.cubes.results import Tile, chunks
from dimersweep.errors import ParameterError, StoreError, UnfinishedError
from dimersweep.kernel.batch import N_START
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import CODE_STATUS, D1, D2, DIP, JAMMED, M_DRIFT, N1, N2, OK, WB
from dimersweep.parameters import Parameters, dimer_from
from dimersweep.runs import carrying, solving, starting
from dimersweep.runs.solving import RunSettings
from dimersweep.studies.declared import read_declaration
from dimersweep.studies.planning import plan
from dimersweep.studies.reuse import points_in
from dimersweep.studies.study import Study
from dimersweep.studies.sweep import study_of
from tests.fakes import same_bits
from tests.seams import another_version

pytestmark = [pytest.mark.jit, pytest.mark.usefixtures("empty_folder")]

GAMMA = np.linspace(0.74, 1.1, 10)
GRID = {"e": [0.55, 0.6], "Gamma": GAMMA}
QUIET = {"periods": 100, "progress": False}


@pytest.fixture(scope="module")
def both():
    """The sweep that the others are compared with."""
    return sweep(GRID, carry="both", **QUIET)


@pytest.fixture
def asked(monkeypatch):
    """The lines that are run: the number of runs of each."""
    made = []

    def counted(rows, *how, **more):
        made.append(len(rows))
        return carrying.carried(rows, *how, **more)

    monkeypatch.setattr("dimersweep.studies.study.carried", counted)
    return made


def way(cube, word):
    return cube.isel(direction=[k for k, each in enumerate(names(cube["direction"]).values) if each == word])


# --- what a line is -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("word", ["up", "down"])
def test_each_run_starts_where_the_one_before_it_has_ended(both, word):
    """Against runs made one after the other by hand, each from the end of the one before."""
    line = way(both, word).isel(direction=0).sel(e=0.6)
    run = None
    for value in GAMMA if word == "up" else GAMMA[::-1]:
        start = {} if run is None else {"start": run}
        run = simulate(Gamma=value, periods=100, stop_when_settled=True, **start)
        point = line.sel(Gamma=value)
        assert (run.mode, run.n_periods) == (names(point["mode"]).item(), point["n_periods"].item())
        if run.orbit:
            assert point["radius"].item() == pytest.approx(run.orbit.radius, rel=1e-6)
            assert point["spin"].item() == pytest.approx(run.orbit.spin, rel=1e-9)


def test_the_first_run_of_a_line_starts_as_its_parameters_say(both):
    plain = sweep(GRID, **QUIET)
    for word, first in (("up", 0), ("down", -1)):
        line = way(both, word).isel(direction=0)
        for name in ("n_events", "radius", "mode", "settled_after"):
            np.testing.assert_array_equal(line[name].isel(Gamma=first), plain[name].isel(Gamma=first))


def test_what_rests_stays_at_rest_until_the_plate_throws_it_off():
    """Closed form: no start but Gamma > 1 lifts a dimer that rests."""
    cube = sweep({"Gamma": [0.3, 0.9, 0.95, 0.99, 1.0, 1.001, 1.01]}, carry="up", **QUIET)
    assert names(cube["mode"]).values[0, :5].tolist() == ["rest"] * 5
    assert "rest" not in names(cube["mode"]).values[0, 5:]


def test_directions_are_runs_of_their_own(both):
    for word in ("up", "down"):
        assert same_bits(sweep(GRID, carry=word, **QUIET), way(both, word))


def test_words_and_places_of_the_directions(both):
    assert both["mode"].dims == ("e", "direction", "Gamma")
    assert names(both["direction"]).values.tolist() == ["up", "down"]
    down = both.dimersweep.at(e=0.6, direction="down", Gamma=0.9)
    assert down["mode"].item() == M_DRIFT
    with pytest.raises(ParameterError, match="direction = 'left': must be up or down"):
        both.dimersweep.at(e=0.6, direction="left", Gamma=0.9)


def test_the_run_behind_a_point(both):
    for word in ("up", "down"):
        for value in GAMMA[[0, 3, -1]]:
            where = {"e": 0.6, "direction": word, "Gamma": value}
            run, point = both.dimersweep.run(**where), both.dimersweep.at(**where)
            assert (run.n_events, run.n_periods) == (point["n_events"].item(), point["n_periods"].item())
            assert run.mode == names(point["mode"]).item()
            if run.orbit:
                assert run.orbit.radius == point["radius"].item()  # the same bits
            assert (run.start is None) == (value == GAMMA[0 if word == "up" else -1])
    again = simulate(start=run.start, Gamma=value, periods=20) if run.start else None
    assert again is None or again.mode == run.mode


def test_a_point_alone_does_not_tell_what_was_carried_to_it(both):
    with pytest.raises(ParameterError, match="start: to this point a state was carried"):
        simulate(start=both.dimersweep.at(e=0.6, direction="up", Gamma=0.9))


def test_strobes_go_on_from_the_run_that_carried_on(both):
    diagram = bifurcation(GRID, carry="both", strobes=3, **QUIET)
    assert same_bits(diagram[list(both.data_vars)], both)
    where = {"e": 0.6, "direction": "down", "Gamma": 0.9}
    run = diagram.dimersweep.run(**where).go_on(3)
    point = diagram.dimersweep.at(**where)
    last = run.section()["gap_2"].values[-3:]
    np.testing.assert_allclose(point["strobe_gap_2"].values, last, rtol=1e-12)


def test_a_run_that_fails_hands_on_what_it_was_given(monkeypatch):
    kernel, starts = solving.run_recorded, []

    def sometimes(row, ask, out, codes, record, space, start):
        starts.append(start)
        kernel(row, ask, out, codes, record, space, start)
        if len(starts) == 2:
            codes[0, CODE_STATUS] = JAMMED

    monkeypatch.setattr(solving, "run_recorded", sometimes)
    rows = [Parameters(Gamma=value).row() for value in (0.9, 0.91, 0.92)]
    runs = list(carrying.carried(rows, RunSettings(60, 60, 1e-8), new_workspace()))
    assert [int(each.codes[CODE_STATUS]) for each in runs] == [OK, JAMMED, OK]
    assert starts[0] is None
    np.testing.assert_array_equal(starts[2], starts[1])


# --- bodies of another shape ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [{"A_r": 6.5}, {"r_2": 5.2e-3}, {"r": 4e-3}])
@pytest.mark.parametrize("dip", [0.0, 1e-9, 0.2, -0.3])
def test_no_end_of_another_body_is_below_the_plate(change, dip):
    """Gaps and their rates go with the dip angle of the new body, and the lower end stays where it is."""
    old, new = Parameters(), Parameters(**change)
    start = np.zeros((1, N_START))
    dm, later = dimer_from(old.given()), dimer_from(new.given())
    start[0, [DIP, WB, N1]] = dip, 2.0, 0.1
    rise = dm.l * (sin(dm.beta_0 + dip) - sin(dm.beta_0))
    start[0, [D1, D2]] = max(0.0, -rise), max(0.0, rise)
    moved = starting.fitted(start, old.row(), new.row())[0]
    rise = later.l * (sin(later.beta_0 + dip) - sin(later.beta_0))
    assert moved[D2] - moved[D1] == pytest.approx(rise, abs=1e-17)
    assert min(moved[D1], moved[D2]) == 0.0
    apart = later.l * np.cos(later.beta_0 + dip) * 2.0
    assert moved[N2] - moved[N1] == pytest.approx(apart, rel=1e-14)
    assert moved[DIP] == dip


def test_a_length_may_be_the_axis():
    """The drift is carried from body to body, and each time it is the orbit of that body at the spin that is left."""
    cube = sweep({"A_r": np.linspace(6.2, 7, 5)}, carry="down", periods=200, progress=False).isel(direction=0)
    assert names(cube["mode"]).values.tolist() == ["drift"] * 5
    for value in cube["A_r"].values:
        point = cube.sel(A_r=value)
        orbit = orbits.find(A_r=value, spin=point["spin"].item())
        assert point["radius"].item() == pytest.approx(orbit.radius, rel=1e-3)
        assert point["zeta"].item() == pytest.approx(orbit.zeta, abs=1e-3)


# --- hysteresis -----------------------------------------------------------------------------------------------------------


def drift_ends(word, start, stop, step):
    """Where the drift of the base case at Gamma = 0.9 ends: the values on both sides, and its spin there."""
    values = np.arange(round(start / step), round(stop / step) + 1) * step
    line = sweep({"Gamma": values}, periods=300, carry=word, progress=False).isel(direction=0)
    line = line if word == "up" else line.isel(Gamma=slice(None, None, -1))
    drifts = (line["mode"] == M_DRIFT).values
    last = int(drifts.argmin()) - 1
    assert last > 0, "it drifts at first, and not for ever"
    inside, outside = line["Gamma"].values[last : last + 2]
    return inside, outside, line["spin"].values[last], names(line["mode"]).values[last + 1]


@pytest.mark.parametrize(
    ("word", "low", "high", "kind", "next_mode"),
    [("down", 0.75, 0.85, "fold", "rest"), ("up", 0.9, 1.3, "flip", "period_n")],
)
def test_the_drift_ends_at_its_borders(word, low, high, kind, next_mode):
    """Going down at the fold, going up at the period doubling, each within a step."""
    inside, outside, spin, mode = drift_ends(word, low, high, 0.0025)
    border = orbits.border(kind, "Gamma", over={"e": [0.6]}, spin=spin)["Gamma"].item()
    print(f"{word}: drift at {inside:.4f}, {mode} at {outside:.4f}; {kind} at spin {spin:.1f} rad/s: {border:.6f}")
    assert min(inside, outside) <= border <= max(inside, outside)
    assert mode == next_mode


def test_the_loop_of_rest_and_drift_begins_at_the_fold():
    """Located by halving to 1e-5, where the border is known to that from its own equations, at the spin that was left."""
    cube = sweep({"Gamma": np.linspace(0.7, 1.25, 12)}, periods=300, carry="both", progress=False)
    coarse, fine = loops(cube), loops(cube, within=1e-5)
    spins = cube["spin"].isel(direction=1).values
    fold = orbits.border("fold", "Gamma", over={"e": [0.6]}, spin=np.nanmin(spins[spins > 0]))["Gamma"].item()
    assert abs(coarse["low"].item() - fold) <= coarse["low_error"].item() == pytest.approx(0.025)
    assert fine["low_error"].item() <= 1e-5
    assert coarse.attrs["cost"] == 0 < fine.attrs["cost"]
    turned = loops(cube.isel(direction=[1, 0], Gamma=slice(None, None, -1)), within=1e-5)
    assert turned.equals(fine)
    assert abs(fine["low"].item() - fold) < 2e-5
    assert np.isnan(fine["high"].item())  # it goes on beyond the axis
    assert [names(fine[f"mode_{word}_low"]).item() for word in ("up", "down")] == ["rest", "drift"]


def loops_of(up, down, periods=1):
    """The loops of modes that are made up, at Gamma = 1, 2, ..."""
    n = len(up)
    codes = [[dimersweep.kernel.model.layout.MODES.index(word) for word in each] for each in (up, down)]
    made = sweep({"Gamma": np.arange(1.0, n + 1)}, {"beta0": 0.0}, carry="both", periods=1, progress=False)
    made["mode"] = made["mode"].copy(data=np.array(codes, dtype=np.int8))
    made["mode_period"] = made["mode_period"].copy(data=np.full((2, n), periods))
    return loops(made)


def test_loops_are_between_values_at_which_both_motions_are_known():
    found = loops_of(
        ["rest", "rest", "rest", "failed", "jump", "jump", "drift"],
        ["rest", "jump", "jump", "jump", "unresolved", "jump", "jump"],
    )
    assert found["low"].values.tolist() == [1.5, 6.5]
    assert found["low_error"].values.tolist() == [0.5, 0.5]
    assert found["high"].values[0] == 4.5 and found["high_error"].values[0] == 1.5
    assert np.isnan(found["high"].values[1])
    assert loops_of(["rest"] * 3, ["rest"] * 3).sizes["loop"] == 0


def test_loops_need_both_ways(both):
    for cube in (way(both, "up"), both.isel(direction=0), 7):
        with pytest.raises(ParameterError, match="loops: the cube has not both directions"):
            loops(cube)
    with pytest.raises(ParameterError, match="within = 0: must be > 0"):
        loops(both, within=0)


def test_a_part_of_a_cube_has_the_loops_of_that_part(both):
    whole, part = (loops(each, within=1e-3) for each in (both, both.sel(e=0.6)))
    for name in ("low", "high", "low_error"):
        np.testing.assert_array_equal(part[name], whole[name].values[whole["e"].values == 0.6])


def test_another_kernel_is_told_of(both, monkeypatch):
    another_version(monkeypatch)
    with pytest.warns(RuntimeWarning, match="made by another version of the kernel; the ends may lie elsewhere"):
        loops(both, within=0.1)


def test_loops_tell_the_other_axes(both):
    found = loops(both)
    assert set(found["e"].values.tolist()) <= {0.55, 0.6}
    assert found.attrs["parameter"] == "Gamma" and found["low"].attrs["units"] == "1"


# --- the work -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [1, 3])
def test_any_number_of_workers_gives_the_same_bits(both, workers):
    assert same_bits(sweep(GRID, carry="both", workers=workers, out="cube.nc", **QUIET), both)
    xr.testing.assert_equal(open_cube("cube.nc"), both)


@pytest.mark.parametrize("length", [1, 3, 7, 100])
def test_lines_are_never_cut(length):
    made = list(chunks([Tile(0, 6), Tile(9, 21)], lambda: length, 3))
    assert all((each.reshape(-1, 3) % 3 == [0, 1, 2]).all() for each in made)
    assert np.concatenate(made).tolist() == [*range(6), *range(9, 21)]
    assert all(each.size <= max(3, length) for each in made)


def test_a_window_for_a_worker_has_whole_lines():
    spec = study_of(GRID, carry="both", periods=10)
    for start in range(0, 40, 10):
        points = np.arange(start, start + 10)
        narrow, there = spec.narrowed(points)
        assert narrow.line == spec.line == 10
        np.testing.assert_array_equal(narrow.grid.rows_at(there), spec.grid.rows_at(points))
        (direction,) = set(narrow.grid.values(there)["direction"].tolist())
        assert direction == start // 10 % 2


def test_what_was_finished_is_not_run_again(both, asked, monkeypatch):
    """Two lines raise; the others are kept, and the sweep goes on with the two."""
    whole, broken = carrying.carried, []

    def breaks(rows, *how, **more):
        if len(broken) < 2 and rows[0][0] == 0.55:
            broken.append(rows)
            raise MemoryError("no room")
        return whole(rows, *how, **more)

    monkeypatch.setattr(carrying, "carried", breaks)
    with pytest.raises(
        UnfinishedError, match=r"20 points could not be run, such as point 0 \(e = 0.55, direction = up, Gamma"
    ):
        sweep(GRID, carry="both", out="cube.nc", workers=1, **QUIET)
    asked.clear()
    assert same_bits(sweep(GRID, carry="both", out="cube.nc", **QUIET), both)
    assert asked == [10, 10]
    assert not Path("cube.nc.tiles").exists()


def test_a_retry_makes_whole_lines_again(both, asked, monkeypatch):
    whole, failed = carrying.carried, []

    def fails(rows, *how, **more):
        for k, solved in enumerate(whole(rows, *how, **more)):
            if k == 4 and not failed:
                failed.append(k)
                solved.codes[:2] = JAMMED, 1
            yield solved

    monkeypatch.setattr(carrying, "carried", fails)
    cube = sweep(GRID, carry="both", out="cube.nc", workers=1, **QUIET)
    assert (names(cube["status"]) == "jammed").sum() == 1
    asked.clear()
    assert same_bits(sweep(GRID, carry="both", out="cube.nc", retry=True, **QUIET), both)
    assert asked == [10]


@pytest.mark.parametrize(
    ("grid", "carry", "new"),
    [
        (GRID, "both", 2),  # the other way
        ({"e": [0.55, 0.58, 0.6], "Gamma": GAMMA}, "up", 1),
        ({"Gamma": GAMMA}, "up", 0),  # e = 0.6, which was an axis
        ({"e": [0.5, 0.6], "Gamma": GAMMA}, "both", 3),
    ],
)
def test_lines_of_another_cube_are_taken_over(asked, grid, carry, new):
    sweep(GRID, carry="up", out="old.nc", **QUIET)
    expected = sweep(grid, carry=carry, **QUIET)
    asked.clear()
    assert same_bits(sweep(grid, carry=carry, extend="old.nc", **QUIET), expected)
    assert asked == [10] * new


@pytest.mark.parametrize(
    ("grid", "carry", "message"),
    [
        (
            {"e": [0.55, 0.6], "Gamma": GAMMA[:-1]},
            "up",
            "cannot be extended along Gamma, along which it carries the state",
        ),
        ({"Gamma": GAMMA, "e": [0.55, 0.6]}, "up", "it carries the state along Gamma, not e"),
        (GRID, None, "parameters: direction in one of them only"),
    ],
)
def test_lines_that_would_be_others_are_not_taken_over(grid, carry, message):
    sweep(GRID, carry="up", out="old.nc", **QUIET)
    with pytest.raises(StoreError, match=message):
        sweep(grid, carry=carry, extend="old.nc", **QUIET)


def test_blocks_of_another_cube_are_whole_lines(monkeypatch, both):
    monkeypatch.setattr("dimersweep.studies.reuse.BLOCK", 4)
    spec = study_of(GRID, carry="both", periods=100)
    found = points_in(both, "both", spec, lambda codes: np.zeros(len(codes), bool))([Tile(0, 40)], spec.stands)
    assert [piece.tile for piece in found] == [Tile(k, k + 10) for k in range(0, 40, 10)]


def test_a_plan_times_lines():
    told = plan(study_of(GRID, carry="both", periods=30), workers=2)
    assert (told.to_run, told.study.grid.size, told.study.line) == (40, 40, 10)
    lines = told.lines()
    assert lines[0] == "points: 40" and "4 random lines" in lines[-1]
    assert told.tile_points % 10 == 0
    long = plan(study_of({"Gamma": np.linspace(0.7, 1.2, 2001)}, carry="up", periods=5), workers=2)
    assert (long.to_run, long.study.line, long.times.size) == (2001, 2001, 1)


def test_a_cube_may_be_written_block_by_block(both):
    pytest.importorskip("zarr")
    cube = sweep(GRID, carry="both", out="cube.zarr", **QUIET)
    assert same_bits(cube, both)
    assert names(open_cube("cube.zarr")["direction"]).values.tolist() == ["up", "down"]


# --- what is asked --------------------------------------------------------------------------------------------------------


def test_a_file_declares_it(both):
    Path("sweep.toml").write_text(
        f'[sweep]\nperiods = 100\ncarry = "both"\noutput = "x.nc"\n[grid]\ne = [0.55, 0.6]\nGamma = {GAMMA.tolist()}\n'
    )
    spec = read_declaration("sweep.toml").study()
    assert type(spec) is Study
    assert spec.configuration() == json.loads(both.attrs["configuration"])
    text = Path("sweep.toml").read_text()
    Path("search.toml").write_text(text + '[search]\nover = "Gamma"\n')
    with pytest.raises(ParameterError, match="carry = 'both': is for sweeps of a whole grid"):
        read_declaration("search.toml").study()
    Path("wrong.toml").write_text(text.replace('"both"', '"left"'))
    with pytest.raises(ParameterError, match=r"wrong\.toml: sweep\.carry = 'left': must be 'up', 'down' or 'both'"):
        read_declaration("wrong.toml")


def test_pictures_have_both_ways(both):
    def shown(figure):
        figure.canvas.draw()
        told = [axes.get_title() for axes in figure.axes]
        plt.close("all")
        return told

    assert shown(plots.mode_map(both))[:2] == ["going up", "going down"]
    assert shown(plots.quantity_map(both, "radius"))[:2] == ["going up", "going down"]
    one = both.sel(e=0.6)
    (axes,) = plots.mode_map(one).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["going up", "going down"]
    (axes,) = plots.quantity_map(one, "radius").axes
    assert [text.get_text() for text in axes.figure.legends[0].get_texts()] == ["going up", "going down"]
    diagram = bifurcation({"Gamma": GAMMA}, carry="both", strobes=2, **QUIET)
    titles = [title for title in shown(plots.draw(diagram)) if title]
    assert titles == ["going up", "going down"]


def test_each_way_can_be_explored(both):
    from dimersweep.exploring.page import LivePage

    page = LivePage(both)
    assert page.map.description()["fixed"]["direction"]["values"] == ["up", "down"]
    part = page.map.part({"direction": "1"})
    assert (part["x"]["name"], part["y"]["name"]) == ("Gamma", "e")
    words = names(both["mode"]).isel(direction=1).transpose("e", "Gamma")
    assert part["modes"] == words.values.ravel().tolist()
    for place in ((0, 1, 2), (1, 0, 1)):
        point = both.isel(dict(zip(both["mode"].dims, place, strict=True)))
        told = page.run({"at": ",".join(map(str, place))})
        assert told["mode"].split(",")[0] == names(point["mode"]).item()
