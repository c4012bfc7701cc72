"""The error that a run tells of itself, against finer runs and closed forms; its bounds never fall."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dimersweep import Parameters, names, simulate
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import N_OUT
from dimersweep.runs.shadows import (
    CLOSED_STATE,
    ERROR_SCALES,
    LEAST_ERROR,
    SAFETY,
    bounds,
    delays,
    difference,
    nudged,
    nudged_state,
    orbit_difference,
    pairs,
    scaled,
    shadow_rtol,
)


@pytest.fixture(scope="module")
def runs():
    return [simulate(periods=4, rtol=rtol) for rtol in (1e-6, 1e-8, 1e-9)]


def test_bounds_are_ten_times_the_largest_difference_so_far_and_never_fall(runs):
    run, *shadows = runs
    times = np.linspace(0, 4 / 15, 60)
    told = bounds(run, shadows, times, 1 / 15)
    apart = [difference(run, shadow, times) for shadow in shadows]
    fell = 0
    for name, scale in ERROR_SCALES.items():
        worst = np.max([errors[name] for errors in apart], axis=0)
        so_far = np.array([worst[: k + 1].max() for k in range(times.size)])
        np.testing.assert_allclose(told[name], 10 * so_far + 1e-12 * scale, rtol=1e-12)
        fell += int((np.diff(worst) < 0).any())
    assert fell > len(ERROR_SCALES) / 2  # the differences themselves do fall
    assert (SAFETY, LEAST_ERROR) == (10.0, 1e-12)
    units = {"x1": 0.01, "y1": 0.01, "gap_1": 0.01, "theta": 1.0, "beta": 1.0, "gamma": 10.0}
    units |= {f"{name}_rate": 10 * unit if unit == 0.01 else unit for name, unit in units.items()}
    units |= {"gamma_rate": 100.0}
    assert set(units) == set(CLOSED_STATE)
    largest = np.max([told[name].values / unit for name, unit in units.items()], axis=0)
    np.testing.assert_allclose(told["scaled"], largest, rtol=1e-12)
    np.testing.assert_allclose(scaled({name: told[name].values for name in units}), largest, rtol=1e-12)


def test_bounds_on_times_of_events_never_fall(runs):
    run, *shadows = runs
    told = bounds(run, shadows, np.array([0.0]), 1 / 15)["event_time"].values
    known = told[~np.isnan(told)]
    late = np.max([delays(run, shadow) for shadow in shadows], axis=0)
    assert (np.diff(late[~np.isnan(late)]) < 0).any()
    assert (np.diff(known) >= 0).all()
    assert known[-1] == pytest.approx(10 * np.nanmax(late) + 1e-12 / 15)


@pytest.mark.parametrize(("rtol", "shadow"), [(1e-6, 1e-8), (1e-9, 1e-11), (1e-12, 1e-11)])
def test_a_shadow_is_a_hundred_times_as_fine_or_ten_times_coarser_where_there_is_nothing_finer(rtol, shadow):
    assert shadow_rtol(rtol) == pytest.approx(shadow)


def test_a_nudged_start_lies_beside_the_given_one_and_is_allowed_wherever_that_is():
    """The plate is later, both harmonics of it; an angle at the end of its range comes back into it."""
    by = 1e-4
    steep = {"beta0": -np.pi / 2, "xdot0": 1.0, "phi0": 0.3, "Gamma_2": 0.2, "phi_2": 0.5, "theta0": 1.0, "ydot0": -2.0}
    moved = nudged(steep, by)
    Parameters(**moved)
    assert moved["beta0"] == pytest.approx(-np.pi / 2 * (1 - by), rel=1e-15)
    assert (moved["phi0"], moved["phi_2"]) == pytest.approx((0.3 + by, 0.5 + 2 * by), rel=1e-15)
    assert (moved["xdot0"], moved["ydot0"]) == pytest.approx((1 + by, -2 * (1 + by)), rel=1e-15)
    assert (moved["theta0"], moved["Gamma_2"]) == (1.0, 0.2)
    assert "phi_2" not in nudged({"beta0": 0.1, "phi0": 0.0}, by)
    state = {"x1": 1.0, "x1_rate": 2.0, "gap_1_rate": 3.0, "gamma_rate": -4.0}
    assert nudged_state(state, by) == {
        "x1": 1.0,
        "x1_rate": 2 * (1 + by),
        "gap_1_rate": 3.0,
        "gamma_rate": -4 * (1 + by),
    }


def moments(*times):
    """Events of one sort."""
    same = {name: ("event", np.full(len(times), "impact")) for name in ("cause", "kind")}
    return xr.Dataset({"time": ("event", np.array(times, dtype=float))} | same)


@pytest.mark.parametrize(("apart", "same"), [(0.49, True), (0.51, False), (-0.49, True), (-0.51, False)])
def test_events_further_apart_than_half_the_way_to_the_next_are_not_the_same(apart, same):
    """Of two events a second apart one has gone; the other one has its partner within half a second only."""
    rows, others = pairs(moments(10.0, 11.0, 30.0), moments(11.0 + apart, 30.0), 5.0)
    assert (1 in rows) == same
    assert rows[-1] == 2 and others[-1] == 1


def test_zeta_and_the_phase_count_absolutely_and_all_else_relative_to_itself():
    orbit = np.zeros((6, N_OUT))
    orbit[:, :6] = [4.0, 30.0, 0.02, 0.7, -0.2, 0.5]
    other = orbit.copy()
    other[np.arange(6), np.arange(6)] += [0.004, 0.03, 0.001, 0.0007, -0.0002, 0.001]
    assert orbit_difference(orbit, other) == pytest.approx(np.full(6, 1e-3))


@pytest.fixture(scope="module")
def coarse():
    return simulate(periods=4, rtol=1e-6)


@pytest.fixture(scope="module")
def fine():
    return simulate(periods=4, rtol=1e-12)


def test_the_bounds_hold_and_are_no_wider_than_they_must_be(coarse, fine):
    bound = coarse.error(np.linspace(0, coarse.n_periods / 15, 33))
    times = bound["time"].values
    true = difference(coarse, fine, times)
    for name in ERROR_SCALES:
        assert (true[name] <= bound[name].values).all(), name
    assert (scaled(true) <= bound["scaled"].values).all()
    assert bound["scaled"].values[-1] < 10 * scaled(true).max()
    late = delays(coarse, fine)
    told = bound["event_time"].values
    found = ~np.isnan(late + told)
    assert found.mean() > 0.9
    assert (late[found] <= told[found]).all()


def test_the_bounds_follow_the_accuracy(coarse, fine):
    ends = [run.error()["scaled"].values[-1] for run in (coarse, simulate(periods=4, rtol=1e-9), fine)]
    assert ends[0] > 100 * ends[1] > 1000 * ends[2]
    assert ends[2] > 0


def test_units_and_meanings_are_those_of_the_states(coarse):
    bound, states = coarse.error(), coarse.states(0.0)
    assert set(ERROR_SCALES) | {"scaled", "event_time", "slip_undecided"} == set(bound.data_vars)
    for name in ERROR_SCALES:
        assert bound[name].attrs["units"] == states[name].attrs["units"]
        assert states[name].attrs["long_name"] in bound[name].attrs["long_name"]
    assert bound.sizes["time"] == 5
    assert bound.sizes["event"] == coarse.events.sizes["event"]
    assert list(bound["kind"].values) == list(coarse.events["kind"].values)


def test_what_closed_forms_give_is_known_to_the_nudge_of_the_start():
    """Without friction the first impact and the flight after it have closed forms: the centre of mass goes on at its speed."""
    run = simulate(mu=0.0, mu_s=0.0, periods=1, f=200)
    times = np.linspace(0, 0.35 / 200, 9)
    bound, states = run.error(times).sel(time=times), run.states(times)
    x = states["x"].values
    assert (np.abs(x - x[0] - times * (x[-1] - x[0]) / times[-1]) <= bound["x"].values).all()
    assert bound["scaled"].values.max() < 1e-9


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_a_sample_in_the_summed_end_of_a_chatter_follows_its_hops(rtol):
    """Hops that a run sums are there when it is sampled: a run that follows them longer says the same."""
    run, longer = (simulate(periods=1, rtol=accuracy, Gamma=0.5, beta0=0.2) for accuracy in (rtol, 1e-3 * rtol))
    events = run.events
    last = int(np.flatnonzero(names(events["cause"]) == "chatter_end")[0]) - 1  # the bounce after which hops are summed
    since = np.geomspace(1e-8, 1e-2, 60)
    true = difference(run, longer, float(events["time"][last]) + since)
    hops = run.states(float(events["time"][last]) + since)["gap_1"].values
    assert hops[0] > 0.0 == hops[-1]
    assert scaled(true).max() < 100 * rtol


def test_events_are_paired_by_kind_and_time(coarse, fine):
    rows, others = pairs(coarse.events, fine.events, 1 / 15)
    for name in ("cause", "kind"):
        assert (coarse.events[name].values[rows] == fine.events[name].values[others]).all()
    assert (np.diff(rows) > 0).all()
    assert len(rows) == len(set(others.tolist()))
    assert np.array_equal(
        np.stack(pairs(fine.events, fine.events, 1 / 15)), np.tile(np.arange(fine.events.sizes["event"]), (2, 1))
    )
    assert coarse.events.sizes["event"] < fine.events.sizes["event"]  # whose chatter goes on for longer
    late = np.abs(coarse.events["time"].values[rows] - fine.events["time"].values[others])
    assert np.median(late) < 1e-6 / 15
    assert late.max() < 1e-4 / 15


def test_an_event_that_a_shadow_lacks_is_told(coarse, fine):
    bound = bounds(fine, [coarse], np.array([0.0]), 1 / 15)
    assert np.isnan(bound["event_time"].values).any()
    assert not np.isnan(bound["event_time"].values).all()


def test_a_shadow_that_fails_bounds_nothing(coarse, fine):
    class Failed:
        status, events, parameters = "jammed", fine.events, fine.parameters

    bound = bounds(coarse, [fine, Failed()], np.array([0.0, 0.1]), 1 / 15)
    assert np.isinf([bound[name].values for name in (*CLOSED_STATE, "scaled")]).all()


def test_chaos_is_told():
    run = simulate(Gamma=3.0, f=25.0, e=0.8, beta0=0.3, periods=60)
    grown = run.error()["scaled"].values
    assert grown[3] < 1e-5
    assert grown[-1] > 0.1


def test_what_cannot_be_bounded_is_refused(coarse, monkeypatch):
    with pytest.raises(ParameterError, match="nothing was recorded"):
        simulate(periods=1, record=False).error()
    monkeypatch.setattr("dimersweep.runs.simulating.simulate", lambda **given: pytest.fail("work was done"))
    with pytest.raises(ParameterError, match="must be in"):
        coarse.error(1.0)
    with pytest.raises(ParameterError, match=r"^t = 'abc': must be a number$"):
        coarse.error("abc")
    with pytest.raises(ParameterError, match="did not reach its end"):
        replace(coarse, status="max_events").error()


def test_the_command_line_tells_it(call, coarse):
    command = ("simulate", "--periods", "4", "--rtol", "1e-6", "--error")
    assert "state error" in call(*command)[0]
    told = json.loads(call(*command, "--json")[0])
    assert told["state_error"] == pytest.approx(float(coarse.error()["scaled"][-1]))


def test_the_examples_of_the_page_run(empty_folder, capsys):
    page = (Path(__file__).parents[1] / "docs" / "trust.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```\{code-cell\} ipython3\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "trust.md", "exec"), names)
    assert "certain" in capsys.readouterr().out


HESITANT = {"r": 0.005465, "A_r": 7.437, "f": 33.19, "mu": 0.1407, "mu_s": 0.1848, "e": 0.6346, "Gamma": 0.7155}
HESITANT |= {"beta0": 0.3, "phi0": 2.5, "xdot0": 0.75}


@pytest.mark.parametrize(("rtol", "time"), [(1e-8, 0.65143), (1e-9, 0.71179), (1e-10, None)])
def test_a_slip_that_passes_zero_where_rtol_decides_is_told(rtol, time):
    """At 1e-10 the shadows slip on, as the run does."""
    run = simulate(**HESITANT, periods=60, rtol=rtol)
    told = float(run.error()["slip_undecided"])
    assert np.isnan(told) if time is None else told == pytest.approx(time, abs=1e-5)
    if time is not None:
        kinds = names(run.events)["kind"].values[run.events["time"].values == told]
        assert all(kind.startswith("DI") for kind in kinds) and any("sk" in kind for kind in kinds)


def test_chaos_alone_is_no_such_slip():
    assert np.isnan(simulate(Gamma=3.0, periods=40).error()["slip_undecided"])
