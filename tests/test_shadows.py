"""Bounds on the errors of a run: they never fall, whatever two runs happen to share for a moment."""

import numpy as np
import pytest
import xarray as xr

from dimersweep import Parameters, simulate
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
