"""One run as labelled data: closed forms, invariants of the record, sampling at any time, and the reference runs."""

import copy
import dataclasses
import json
import os
import re
from functools import partial
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import dimersweep
from dimersweep import load_run, lyapunov, multipliers, names, simulate
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.contact_code import CONTACT_STATES
from dimersweep.kernel.model.event_row import E_CAUSE, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import C_CHATTER_END, OUT, PERIOD, PHASE
from dimersweep.kernel.record import SEGMENT_HOP_TIME
from dimersweep.plots import energy_budget, last_cycle
from dimersweep.runs import run as run_module
from dimersweep.runs import solving
from dimersweep.runs.recorded import events_of
from tests.checks.scenes import SCALE, UNITS, engine_states, started_scene
from tests.seams import begin_when_stopped, stop_runs

SHARED = Path(os.environ.get("DIMERSWEEP_SHARED", Path(__file__).parents[2] / "shared")) / "reference"
REFERENCE = {name: SHARED / f"{name}.json" for name in ("states", "orbits")}
CASES = json.loads(REFERENCE["states"].read_text())["cases"] if REFERENCE["states"].exists() else []
ORBITS = json.loads(REFERENCE["orbits"].read_text())["orbits"] if REFERENCE["orbits"].exists() else {}
needs_reference = pytest.mark.skipif(not (CASES and ORBITS), reason="the reference runs are not at hand")
LONG_CHATTER = 13

R, F, G, GAMMA, A_R = 5e-3, 15.0, 9.81, 0.9, 6.0  # the base case
LENGTH, OMEGA = 2 * R * (A_R - 1), 2 * pi * F
A_Z = GAMMA * G / OMEGA**2
M, J_T, J_A = 8.813633469891e-3, 5.299695485087e-6, 8.339127315493e-8
RATES = ("x1", "y1", "z1", "theta", "beta", "gamma", "gap_1", "gap_2")


@pytest.fixture(scope="module")
def base():
    return simulate(periods=60)


def first_flight(run, n=50):
    """The states of a run before its second event."""
    end = run.events["time"].values[run.events["time"].values > 0][0]
    return run.states(np.linspace(0, end, n, endpoint=False))


def angular_momentum(states):
    """About the centre of mass, from the axis e1, its rate and the axial spin; shape (3, n)."""
    theta, beta = states["theta"].values, states["beta"].values
    axis = np.array([-np.cos(beta) * np.sin(theta), np.cos(beta) * np.cos(theta), np.sin(beta)])
    by_beta = np.array([np.sin(beta) * np.sin(theta), -np.sin(beta) * np.cos(theta), np.cos(beta)])
    by_theta = np.array([-np.cos(beta) * np.cos(theta), -np.cos(beta) * np.sin(theta), 0 * beta])
    rate = by_beta * states["beta_rate"].values + by_theta * states["theta_rate"].values
    axial = states["gamma_rate"].values + states["theta_rate"].values * np.sin(beta)
    return J_T * np.cross(axis.T, rate.T).T + J_A * axial * axis


def test_the_first_flight_is_ballistic_and_keeps_its_angular_momentum(base):
    states = first_flight(base)
    t = states["time"].values
    assert set(names(states["contact_state"]).values) == {"FM"}
    assert states["x1"][0] == states["y1"][0] == states["theta"][0] == 0
    start = states.isel(time=0)
    np.testing.assert_allclose(start["beta"], 4 * pi / 45, rtol=1e-15)
    half = LENGTH / 2
    fall = start["z1_rate"] + half * np.cos(start["beta"]) * start["beta_rate"]
    np.testing.assert_allclose(states["z"], start["z"].item() + fall.item() * t - G * t**2 / 2, atol=1e-16)
    for name in ("x", "y"):
        value = states[name].values
        np.testing.assert_allclose(value, value[0] + (value[-1] - value[0]) * t / t[-1], atol=1e-16)
    momentum = angular_momentum(states)
    np.testing.assert_allclose(momentum, momentum[:, :1] * np.ones(t.size), atol=1e-13 * np.abs(momentum).max())


def test_the_first_impact_follows_from_the_law_of_restitution():
    # without friction a single impact turns the gap rate by -e; the plate rises at A_z omega at the start
    states = simulate(mu=0, mu_s=0, xdot0=0, periods=1).states(0)
    np.testing.assert_allclose(states["gap_1_rate"], 0.6 * A_Z * OMEGA, rtol=1e-14)


def test_coordinates_are_consistent(base):
    states = base.states(np.linspace(0, 4, 5001))
    half = LENGTH / 2 * np.cos(states["beta"])
    np.testing.assert_allclose(states["plate"], A_Z * np.sin(OMEGA * states["time"]), atol=1e-15)
    np.testing.assert_allclose(states["z1"], R + states["gap_1"] + states["plate"], rtol=1e-15)
    np.testing.assert_allclose(states["z"], states["z1"] + LENGTH / 2 * np.sin(states["beta"]), rtol=1e-15)
    np.testing.assert_allclose(states["gap_2"], states["gap_1"] + LENGTH * np.sin(states["beta"]), atol=1e-16)
    np.testing.assert_allclose(states["x"], states["x1"] - half * np.sin(states["theta"]), rtol=1e-14)
    np.testing.assert_allclose(states["y"], states["y1"] + half * np.cos(states["theta"]), rtol=1e-14)
    np.testing.assert_allclose(states["gap_2_rate"], states["gap_1_rate"] + 2 * half * states["beta_rate"], atol=1e-14)
    assert states["gap_1"].min() >= 0
    assert states["gap_2"].min() > -1e-14


def test_rates_are_the_derivatives_of_what_they_belong_to():
    fine = simulate(periods=60, rtol=1e-12)
    step = 1e-6
    times = np.linspace(0.01, 3.9, 400)
    events = fine.events["time"].values
    nearest = np.abs(times[:, None] - events).min(axis=1)
    times = times[nearest > 2 * step]
    middle, later, sooner = (fine.states(times + shift) for shift in (0, step, -step))
    for name in RATES:
        slope = (later[name].values - sooner[name].values) / (2 * step)
        expected = middle[f"{name}_rate"].values
        np.testing.assert_allclose(slope, expected, atol=1e-6 * np.abs(expected).max(), err_msg=name)


def test_events_are_in_order_and_tell_what_happened(base):
    events = names(base.events)
    time, cause = events["time"].values, events["cause"].values
    assert (np.diff(time) >= 0).all()
    assert (cause[-1], time[-1]) == ("end", 4.0)
    np.testing.assert_allclose(np.sin(events["phase"]), np.sin(OMEGA * events["time"]), atol=1e-11)
    assert 0 <= events["phase"].min() <= events["phase"].max() < 2 * pi
    impact = cause == "impact"
    assert all(kind[:2] in ("SI", "DI") for kind in events["kind"].values[impact])
    assert all(kind[:2] in ("FM", "SC", "DC") for kind in events["kind"].values[~impact])
    impulse = events["impulse_1"] + events["impulse_2"]
    assert (impulse.values[impact] > 0).all()
    assert (impulse.values[~impact] == 0).all()
    for dimer_end in (1, 2):
        # an end that is down but hardly hit: its event makes exact what is zero to the tolerance
        assert (events[f"impulse_{dimer_end}"] >= -np.minimum(base.rtol * impulse, 1e-14)).all()
    alone = np.char.startswith(events["kind"].values, "SI")
    assert (np.isnan(events["slip_1_a"].values) ^ np.isnan(events["slip_2_a"].values))[alone].all()
    assert not np.isnan(events["slip_1_a"].values + events["slip_2_a"].values)[~alone].any()


PLANAR = {"beta0": 0.2, "mu": 0.0, "mu_s": 0.0}


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-12])
def test_a_chatter_ends_at_its_accumulation_point(rtol):
    """The rod rocks from end to end, each time with a chatter, and comes to rest after infinitely many of these."""
    run, fine = (simulate(**PLANAR, periods=4, rtol=accuracy) for accuracy in (rtol, 1e-13))
    events, bounces = names(run.events), fine.events["time"].values[names(fine.events["cause"]) == "impact"]
    assert (np.diff(events["time"].values) >= 0).all()
    ends = events.isel(event=events["cause"].values == "chatter_end")
    assert ends["contact_after"].values[-1] == "DC_sp_sp"
    for end, limit in ((ends["time"].values[-1], bounces[-1]), (ends["time"].values[0], bounces[bounces < 0.0385][-1])):
        assert -rtol / F < end - limit < rtol / F + 2e-6  # what the fine run still sums
    states = run.states(ends["time"].values)
    kinds = [CONTACT_STATES[code] for code in states["contact_state"].values]
    assert kinds == list(ends["contact_after"].values)
    assert not states["gap_1"].values.any()
    for name in ("beta", "gap_2_rate"):
        row = ends[name if name == "beta" else f"{name}_after"].values
        np.testing.assert_allclose(states[name].values, row, atol=10 * rtol)
    hops = run.states((ends["time"] - 1e-3 * rtol ** (1 / 3)).values)
    assert (hops["gap_1"].values > 0).sum() > 0.5 * ends.sizes["event"]


def test_no_end_of_a_slip_is_a_stick_where_nothing_holds():
    """Without friction the slip of a planar run goes through zero."""
    events = names(simulate(**PLANAR, xdot0=0.0, periods=4).events)
    turned = (events["contact_before"] == "SC1_sp") & (events["contact_after"] == "SC1_sp")
    assert turned.sum() > 5
    assert set(events["cause"].values[turned]) == {"slip"}
    assert "stick" not in events["cause"].values


def test_impulses_change_the_motion_of_the_centre_of_mass(base):
    cause, time = names(base.events["cause"]).values, base.events["time"].values
    # the last bounce of a chatter is summed with those that would have followed
    summed = time[np.flatnonzero(cause == "chatter_end") - 1]
    times = np.setdiff1d(np.unique(time[cause == "impact"])[1:], summed)
    assert times.size > 100
    before, after = base.states(times - 1e-13), base.states(times)

    def fall(states):
        return states["z1_rate"].values + LENGTH / 2 * np.cos(states["beta"].values) * states["beta_rate"].values

    events = base.events.to_dataframe()
    impulse = (events["impulse_1"] + events["impulse_2"]).groupby(events["time"]).sum()[times]
    np.testing.assert_allclose(M * (fall(after) - fall(before)), impulse, atol=1e-11)


def test_states_at_the_times_of_events_are_those_right_after(base):
    events = base.events.to_dataframe().groupby("time", as_index=False).last()
    states = base.states(events["time"])
    for name in ("beta", "theta"):
        np.testing.assert_array_equal(states[name], events[name], err_msg=name)
    for name in ("gap_1_rate", "gap_2_rate"):
        np.testing.assert_array_equal(states[name], events[f"{name}_after"], err_msg=name)
    np.testing.assert_array_equal(states["contact_state"], events["contact_after"])


@pytest.mark.jit
@pytest.mark.parametrize("rtol", [1e-8, 1e-10])
def test_states_just_before_an_event_come_to_it(rtol):
    """Places and angles do not jump at events, in scenes of the whole model: a sample follows the run, not a motion near it.

    Slips of both ends that set out from rest are the hard ones: rounding decides whether they end at once.
    """
    for seed in (0, 56, 108, 296, 458, 512, 589, 592, 762, 779):
        rng = np.random.default_rng([20240306, seed])
        scene = started_scene(seed) | {"D_r": 1e-3, "phi0": float(rng.uniform(0, 2 * pi))}
        run = simulate(**scene, periods=3, rtol=rtol)
        times = np.unique(run.events.time.values)
        times = times[times > 0]
        before, after = run.states(times * (1 - 1e-12)), run.states(times)
        for name in ("x", "y", "z", "theta", "beta", "gamma"):
            off = np.abs(before[name].values - after[name].values).max() / UNITS.get(name, 0.01)
            assert off < 100 * rtol, (seed, name)


@pytest.mark.parametrize("scene", [{}, {"Gamma": 0.5}, {"Gamma": 3.0}, {"Gamma": 1.2, "beta0": 0.8}])
def test_events_are_counted_as_the_page_says(scene):
    """Each impact but the one that starts the run has a landing before it, which has no row."""
    run = simulate(**scene, periods=60)
    causes = names(run.events["cause"]).values
    impacts = np.unique(run.events["time"].values[causes == "impact"]).size
    assert run.n_events == 2 * impacts - 1 + np.isin(causes, ("lift_off", "stick", "slip")).sum()


def test_times_may_come_in_any_order_and_number(base):
    times = np.linspace(0, 4, 301)
    states = base.states(times)
    shuffled = np.random.default_rng(1).permutation(301)
    assert base.states(times[shuffled]).identical(states.isel(time=shuffled))
    assert base.states(float(times[7])).identical(states.isel(time=7))
    assert base.states(times[7]).sizes == {}
    assert base.states([times[7]]).sizes == {"time": 1}
    assert base.states([]).sizes == {"time": 0}


def test_boundaries_of_periods_are_met_however_they_are_rounded(base):
    period = 1 / F
    exact = base.states(np.arange(61) / F)
    np.testing.assert_array_equal(exact["plate"], 0)
    for times in (np.arange(61) * period, np.cumsum([0] + 60 * [period]), np.arange(61) / F * (1 - 1e-15)):
        near = base.states(times)
        for name in ("gap_2", "x1", "theta", "beta"):
            np.testing.assert_allclose(near[name], exact[name], atol=1e-13, err_msg=name)


def test_a_run_that_fails_at_its_first_impact_has_no_states():
    record = run_module.RunRecord(np.zeros(0), 1e-8, np.zeros((0, 18)), np.zeros((0, 18)))
    failed = dataclasses.replace(simulate(periods=1), message="too many steps", _record=record)
    with pytest.raises(ParameterError, match=r"^states: there are none, .* \(too many steps\)$"):
        failed.states(0)


@pytest.mark.parametrize("time", [-1e-9, 4.0 + 1e-9])
def test_times_outside_the_run_are_refused(base, time):
    with pytest.raises(ValueError, match=rf"^t = {time}: must be in \[0, 4\] s, the length of the run$"):
        base.states([1.0, time])


def test_times_must_be_a_list(base):
    with pytest.raises(ParameterError, match=r"^t = \[1.0, 2.0\]: must be a number$"):
        base.states([[1.0, 2.0]])
    with pytest.raises(ParameterError, match=r"^t = 'soon': must be a number$"):
        base.states("soon")
    for time in (np.inf, np.nan):
        with pytest.raises(ParameterError, match=rf"^t = {time}: must be finite$"):
            base.states([1.0, time])
    with pytest.raises(ParameterError, match=r"has masked values; give numbers only$"):
        base.states(np.ma.array([1.0, 2.0], mask=[0, 1]))


def test_without_a_record_the_outcome_is_the_same():
    kept, bare = simulate(periods=60), simulate(periods=60, record=False)
    for name in ("status", "mode", "mode_period", "n_events", "n_periods", "parameters"):
        assert getattr(kept, name) == getattr(bare, name)
    # a recorded run follows the path as well, and so steps a little differently
    for name in ("radius", "zeta", "period", "speed", "impact_phase"):
        assert getattr(kept.orbit, name) == pytest.approx(getattr(bare.orbit, name), rel=1e-6)
    assert repr(kept).startswith("<Run: ok, drift, radius 4.245 m, zeta 1.604 rad, 60 periods, ")
    assert repr(bare).endswith(" events, not recorded>")
    for ask in (lambda: bare.events, lambda: bare.states(0.1)):
        with pytest.raises(ParameterError, match=r"nothing was recorded; run simulate with record=True$"):
            ask()


def test_a_record_grows_until_it_holds_the_run(monkeypatch):
    expected = simulate(periods=10)
    monkeypatch.setattr(solving, "RECORD_ROWS", 3)
    monkeypatch.setattr(solving, "ROWS_PER_PERIOD", 0)
    grown = simulate(periods=10)
    assert grown.events.identical(expected.events)
    assert grown.states(np.linspace(0, 10 / F, 99)).identical(expected.states(np.linspace(0, 10 / F, 99)))


def test_a_record_is_bounded_and_says_where_it_is_cut(monkeypatch):
    whole, bare = simulate(periods=30), simulate(periods=30, record=False)
    monkeypatch.setattr(solving, "MAX_ROWS", 200)
    with pytest.warns(
        RuntimeWarning, match=r"^record: is full; events and states end after (\d+) of 30 forcing periods$"
    ):
        cut = simulate(periods=30)
    assert (cut.status, cut.mode, cut.n_periods, cut.n_events) == ("ok", whole.mode, 30, whole.n_events)
    assert cut.orbit == whole.orbit and cut.mode == bare.mode
    assert cut.events.sizes["event"] <= 200 and cut.events.attrs["comment"].startswith("cut: events and states end")
    assert cut.events.drop_attrs().equals(whole.events.isel(event=slice(cut.events.sizes["event"])).drop_attrs())
    assert cut.states(0.3).identical(whole.states(0.3))
    assert repr(cut).endswith(", record cut>")
    with pytest.raises(ParameterError, match=r"^t = 1.9: must be in \[0, .*\] s, where the record was cut$"):
        cut.states(1.9)
    with pytest.raises(ParameterError, match=r"^error: needs the whole record, but events and states end after"):
        cut.error()


def test_a_run_whose_time_is_up_is_stopped(monkeypatch):
    begin_when_stopped(monkeypatch)
    run = simulate(periods=3, max_seconds=1e-9)
    assert (run.status, run.mode, run.orbit, run.n_events, run.n_periods) == ("stopped", "failed", None, 0, 0)


# before the first event, in the first smooth phase, in those after it, in a chatter, in the second and the third period
STOPS = {"base": [0, 1, 8, 13, 30], "rest": [1, 13], "jumps": [0, 2, 3, 9]}
SCENES = {"base": {}, "rest": {"Gamma": 0.5, "xdot0": 0.0, "beta0": 0.0}, "jumps": {"Gamma": 3.0}}


@pytest.mark.parametrize(("scene", "phases"), [(scene, phases) for scene in STOPS for phases in STOPS[scene]])
def test_a_run_that_is_stopped_is_recorded_up_to_there(scene, phases, monkeypatch):
    whole = simulate(periods=3, **SCENES[scene])
    stop_runs(monkeypatch, phases)
    run = simulate(periods=3, **SCENES[scene])
    assert (run.status, run.mode, run.orbit) == ("stopped", "failed", None)
    assert "stopped" in repr(run) and "stopped from outside" in run._repr_html_()
    rows = run.events.sizes["event"]
    assert run.events.equals(whole.events.isel(event=slice(rows)))
    ended = "the run did not reach its end (the run was stopped from outside"
    for refused in (run.error, partial(run.go_on, 1), partial(multipliers, run), partial(lyapunov, run)):
        with pytest.raises(ParameterError, match=re.escape(ended)):
            refused()
    monkeypatch.undo()
    if not phases:
        for part in (partial(run.states, 0.0), run.section, run.energy, partial(simulate, start=run)):
            with pytest.raises(
                ParameterError, match=r"none, the run ended before its first smooth phase \(the run was st"
            ):
                part()
    else:
        assert run.states(0.0).identical(whole.states(0.0))
        assert run.section().sizes["n"] == run.n_periods + 1
        assert simulate(start=run, periods=1).status == "ok"
    if phases > 1:
        assert run.energy().sizes["n"] == run.n_periods
        parts = run.energy("event").sizes["part"]
        assert run.energy("event").drop_attrs().equals(whole.energy("event").isel(part=slice(parts)).drop_attrs())


@pytest.mark.parametrize(("scene", "phases"), [(scene, phases) for scene in STOPS for phases in STOPS[scene]])
def test_a_run_that_is_stopped_is_kept_and_shown_or_says_that_there_is_nothing_to_show(
    scene, phases, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    stop_runs(monkeypatch, phases)
    run = simulate(periods=3, **SCENES[scene])
    again = load_run(run.save("run.nc"))
    assert again.events.identical(run.events) and (again.status, again.n_events) == (run.status, run.n_events)
    shown = {"plot": run.plot, "view": run.view, "animate": partial(run.animate, "run.gif", periods=1, fps=4, dpi=20)}
    shown |= {"energy_budget": partial(energy_budget, Figure().subplots(), run), "last_cycle": partial(last_cycle, run)}
    for name, draw in shown.items():
        if run.n_periods:
            draw()
        else:
            line = (
                f"{name}: there is nothing to show, the run ended before a forcing period (the run was stopped from o"
            )
            with pytest.raises(ParameterError, match=f"^{re.escape(line)}"):
                draw()


def test_a_chatter_that_has_not_ended_where_a_record_ends_has_no_row(base):
    record, events = base.record("its events"), base.events
    causes, closes = record.events[:, E_CAUSE], np.flatnonzero(record.segments[:, SEGMENT_HOP_TIME] > 0)
    for n, k in zip(np.flatnonzero(causes == C_CHATTER_END)[:20], closes[:20], strict=True):
        ended = record._replace(events=record.events[: n + 1], segments=record.segments[: k + 1])
        assert events_of(ended).equals(events.isel(event=slice(n)))


def test_a_run_that_failed_has_states_up_to_its_last_event(base):
    """It fails by an impact that no phase follows: the record has that event, and the start of the phase before it."""
    record = base.record("its events")
    n = np.flatnonzero(np.diff(record.segments[:, PERIOD]) == 0)[20]
    start = record.segments[n, [PERIOD, PHASE]]
    after = (record.events[:, [E_PERIOD, E_PHASE]] >= start).all(1)
    m = np.flatnonzero(after & (record.events[:, E_PHASE] > start[1]))[0]
    record = record._replace(segments=record.segments[: n + 1], events=record.events[: m + 1])
    failed, last = dataclasses.replace(base, _record=record), base.events["time"].values[m]
    assert failed.states(np.nextafter(last, 0.0)).identical(base.states(np.nextafter(last, 0.0)))
    with pytest.raises(ParameterError, match="length of the run"):
        failed.states(last * (1 + 1e-6))


def test_data_have_units_and_meanings(base):
    for dataset in (base.events, base.states([0.0, 1.0])):
        for name, variable in dataset.variables.items():
            assert ("units" in variable.attrs) == ("flag_meanings" not in variable.attrs), name
            assert variable.attrs["long_name"], name
    contact = base.states(0.0)["contact_state"]
    assert contact.dtype == np.int8
    words = list(dict.fromkeys(CONTACT_STATES))  # each has one code: that of the first state that it stands for
    assert contact.attrs["flag_meanings"].split() == words
    assert contact.attrs["flag_values"].tolist() == [CONTACT_STATES.index(word) for word in words]


def test_a_run_stops_when_settled():
    run = simulate(periods=300, stop_when_settled=True)
    assert (run.status, run.mode) == ("ok", "drift")
    assert run.n_periods < 100
    assert run.states(run.n_periods / F)["time"].item() == run.n_periods / F


def test_parameters_are_kept():
    run = simulate(e_1=0.5, periods=3)
    assert run.parameters["e_1"] == 0.5
    assert "e_2" not in run.parameters
    assert simulate(**run.parameters, periods=3).events.identical(run.events)


def test_the_phase_of_the_plate_counts_from_phi0():
    run = simulate(phi0=5.0, periods=3)
    states = run.states(np.linspace(0, 0.2, 11))
    np.testing.assert_allclose(states["plate"], A_Z * np.sin(OMEGA * states["time"] + 5), atol=1e-16)
    np.testing.assert_allclose(np.sin(run.events["phase"]), np.sin(OMEGA * run.events["time"] + 5), atol=1e-12)
    assert run.events["phase"].values[0] == pytest.approx(5.0)


@pytest.mark.parametrize("more", [{}, {"mu": 0.05, "mu_s": 0.1}, {"Gamma": 1.3, "beta0": 0.7}, {"A_r": 4, "phi0": 2}])
def test_a_planar_scene_stays_exactly_planar(more):
    run = simulate(xdot0=0, periods=60, **more)
    states = run.states(np.linspace(0, 4, 2001))
    for name in ("theta", "gamma", "x", "x1"):
        assert not states[name].values.any(), name
    for name in ("theta", "gamma", "x1"):
        assert not states[f"{name}_rate"].values.any(), name
    assert not np.nan_to_num(run.events["slip_1_b"]).any()


@needs_reference
@pytest.mark.parametrize("number", range(len(CASES)))
def test_reference_runs(number):
    samples, expected = np.array(CASES[number]["samples"]), CASES[number]["t_double"]
    (states, double), (coarse, _) = (
        engine_states(CASES[number]["params"], samples[:, 0], rtol) for rtol in (1e-10, 1e-8)
    )
    assert np.abs((states - samples[:, 1:]) / SCALE).max() < 1e-6
    np.testing.assert_allclose(double[: len(expected)], expected, rtol=0, atol=1e-7)
    assert np.abs((coarse - samples[:, 1:]) / SCALE).max() < 1e-4


@needs_reference
def test_the_reference_run_with_the_longest_chatter_has_converged():
    case = CASES[LONG_CHATTER]
    times = np.array(case["samples"])[:, 0]
    fine, finest = (engine_states(case["params"], times, rtol)[0] for rtol in (1e-10, 1e-12))
    assert np.abs((fine - finest) / SCALE).max() < 1e-6


@needs_reference
@pytest.mark.parametrize("name", ORBITS)
def test_reference_orbits(name):
    expected = ORBITS[name]
    run = simulate(**expected["params"], periods=100, record=False)
    assert (run.status, run.mode) == ("ok", expected["mode"])
    assert run.orbit.di_end == "_".join(expected["end_of_DI"])
    for quantity, accuracy in {
        "radius": 1e-4,
        "zeta": 1e-4,
        "impact_phase": 1e-3,
        "period": 1e-3,
        "speed": 1e-3,
    }.items():
        assert getattr(run.orbit, quantity) == pytest.approx(expected[quantity], rel=accuracy), quantity
    assert run.orbit.spin == pytest.approx(expected["spin_rate"], rel=1e-3)
    assert run.orbit.beta_rate_after == pytest.approx(expected["beta_rate_after"], rel=1e-3)


def test_every_number_of_a_cube_is_one_of_the_run_there_and_of_its_file(tmp_path):
    point = dimersweep.sweep({"Gamma": [0.9]}, periods=60, progress=False).isel(Gamma=0)
    run = simulate(periods=60, stop_when_settled=True)
    for each in (run, dimersweep.load_run(run.save(tmp_path / "run.nc", force=True))):
        numbers = dataclasses.asdict(each.orbit) | vars(each)
        np.testing.assert_equal({name: numbers[name] for name in OUT}, {name: point[name].item() for name in OUT})


def test_public_names():
    assert dimersweep.simulate is simulate
    assert dimersweep.Run is type(simulate(periods=1))
    assert all(a < b for a, b in pairwise(sorted(dimersweep.__all__)))


def test_a_straight_path_has_no_circle():
    """Without friction nothing turns the dimer."""
    run = simulate(mu=0, mu_s=0, periods=60, record=False)
    assert (run.status, run.mode, run.orbit.precession_rate) == ("ok", "drift", 0)
    for name in ("radius", "period", "radius_drift", "period_drift"):
        assert np.isnan(getattr(run.orbit, name)), name
    assert repr(run).startswith("<Run: ok, drift, straight, zeta 1.571 rad, ")


@pytest.mark.parametrize(("given", "mode"), [({"Gamma": 0.5}, "rest"), ({"Gamma": 1.5}, None), ({"e": 0.3}, None)])
def test_an_orbit_that_is_none_says_which_mode_there_is(given, mode, tmp_path):
    run = simulate(**given, periods=100)
    mode = run.mode if mode is None else mode
    assert run.mode == mode != "drift"
    for again in (run, copy.deepcopy(run), load_run(run.save(tmp_path / "run.nc", force=True))):
        assert not again.orbit
        assert again.orbit == run.orbit
        assert not hasattr(again.orbit, "radius")
        for name in ("radius", "period", "di_end"):
            with pytest.raises(ParameterError, match=f"{name}: the motion is {mode}, and only a drift has an orbit"):
                getattr(again.orbit, name)
    assert mode in repr(run.orbit)
