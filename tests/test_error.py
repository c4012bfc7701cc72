"""The error that a run tells of itself, against finer runs and closed forms."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dimersweep import cli, simulate
from dimersweep.errors import ParameterError
from dimersweep.runs.shadows import CLOSED_STATE, ERROR_SCALES, bounds, delays, difference, pairs, scaled


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
    assert set(ERROR_SCALES) | {"scaled", "event_time"} == set(bound.data_vars)
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
    last = int(np.flatnonzero(events["cause"].values == "chatter_end")[0]) - 1  # the bounce after which hops are summed
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


def test_the_command_line_tells_it(monkeypatch, capsys, coarse):
    for more in ([], ["--json"]):
        monkeypatch.setattr(
            sys, "argv", ["dimersweep", "simulate", "--periods", "4", "--rtol", "1e-6", "--error", *more]
        )
        cli.main()
    table, _, told = capsys.readouterr().out.partition("{")
    assert "state error" in table
    assert json.loads("{" + told)["state_error"] == pytest.approx(float(coarse.error()["scaled"][-1]))


def test_the_examples_of_the_page_run(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[1] / "docs" / "trust.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "trust.md", "exec"), names)
    assert "certain" in capsys.readouterr().out
