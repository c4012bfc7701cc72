"""Bounds on the errors of a run: they never fall, whatever two runs happen to share for a moment."""

import numpy as np
import pytest

from dimersweep import simulate
from dimersweep.runs.shadows import (
    CLOSED_STATE,
    ERROR_SCALES,
    LEAST_ERROR,
    SAFETY,
    bounds,
    delays,
    difference,
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
    units = {"x1": 0.01, "y1": 0.01, "gap_1": 0.01, "theta": 1.0, "beta": 1.0, "spin": 10.0}
    units |= {f"{name}_rate": 10 * unit if unit == 0.01 else unit for name, unit in units.items()}
    units |= {"spin_rate": 100.0}
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
