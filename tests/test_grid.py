"""Axes become points in C order, whatever range is asked for, and a bad axis is refused in one line."""

import re
import sys
from decimal import Decimal
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dimersweep.cubes.grid import MAX_POINTS, axis_values, check_fits, evenly, finer, make_grid
from dimersweep.errors import ParameterError
from dimersweep.inputs import number
from dimersweep.kernel.model.layout import ROW


def test_a_grid_too_large_for_one_cube_is_refused_at_once():
    many = {"start": 0.1, "stop": 0.9, "num": 10**5}
    grid = make_grid({"e": many, "Gamma": many})
    with pytest.raises(ParameterError, match=rf"^grid: {10**10} points; one cube in memory may hold {MAX_POINTS} \("):
        check_fits(grid, by_blocks=True)


def test_a_range_holds_its_stop_and_angles_may_be_degrees():
    beta0 = axis_values("beta0", {"start": 0.1, "stop": 89.9, "step": 0.1, "unit": "deg"})
    assert beta0.size == 899
    np.testing.assert_allclose(np.rad2deg(beta0[[0, -1]]), [0.1, 89.9])
    np.testing.assert_array_equal(axis_values("f", {"start": 15, "stop": 25, "num": 3}), [15, 20, 25])
    np.testing.assert_array_equal(axis_values("f", 15), [15])


hundredths = st.integers(1, 100_000)


@given(hundredths, hundredths, st.integers(0, 10_000))
def test_a_range_of_whole_steps_ends_at_its_stop(start, step, n):
    values = axis_values("f", {"start": start / 100, "stop": (start + n * step) / 100, "step": step / 100})
    assert values.size == n + 1
    assert values[-1] == pytest.approx((start + n * step) / 100, rel=1e-12)


@given(hundredths, hundredths, st.integers(0, 1000), st.floats(0.01, 0.99))
def test_what_is_said_of_a_stop_between_two_steps_is_taken(start, step, n, part):
    start, step = start / 100, step / 100
    declared = {"start": start, "stop": start + (n + part) * step, "step": step}
    with pytest.raises(ParameterError, match=r"^f.step = .*: no whole steps from ") as caught:
        axis_values("f", declared)
    stops, nums = re.search(r"give stop = (.*), or num = (.*) in place of step$", str(caught.value)).groups()
    for stop, num in zip(stops.split(" or "), nums.split(" or "), strict=True):
        assert axis_values("f", declared | {"stop": float(stop)}).size == int(num)
        del declared["step"]
        assert axis_values("f", declared | {"num": int(num)}).size == int(num)
        declared["step"] = step


def test_points_are_numbered_in_c_order():
    grid = make_grid({"f": [15, 20], "beta0": [0.1, 0.2, 0.3]}, {"mu": 0.1})
    assert grid.shape == (2, 3)
    f, beta0, mu = (grid.rows_at(np.arange(6))[:, ROW.index(name)] for name in ("f", "beta0", "mu_1"))
    np.testing.assert_array_equal(f, [15, 15, 15, 20, 20, 20])
    np.testing.assert_array_equal(beta0, [0.1, 0.2, 0.3] * 2)
    assert (mu == 0.1).all()


def test_one_end_of_its_own_leaves_the_other_at_e():
    grid = make_grid({"e_1": [0.3, 0.5]})
    assert "e" not in grid.fixed
    np.testing.assert_array_equal(grid.rows_at(np.arange(2))[:, :2], [[0.3, 0.6], [0.5, 0.6]])


@pytest.mark.parametrize(
    ("axes", "fixed", "expected"),
    [
        ({"e_1": [0.3, 0.5]}, {"e": 0.7}, [[0.3, 0.7], [0.5, 0.7]]),
        ({"e": [0.3, 0.5]}, {"e_1": 0.7}, [[0.7, 0.3], [0.7, 0.5]]),
        ({"e": [0.3, 0.5], "e_1": [0.7]}, {}, [[0.7, 0.3], [0.7, 0.5]]),
        ({"f": [15]}, {"e": 0.3, "e_2": 0.4}, [[0.3, 0.4]]),
    ],
)
def test_each_end_has_its_own_value_or_that_of_both(axes, fixed, expected):
    grid = make_grid(axes, fixed)
    np.testing.assert_array_equal(grid.rows_at(np.arange(grid.size))[:, :2], expected)


def test_what_is_the_same_at_the_ends_is_told_alike():
    told = [
        make_grid({"f": [15]}, fixed).configuration()
        for fixed in ({"e_1": 0.5}, {"e_1": 0.5, "e": 0.6}, {"e_1": 0.5, "e_2": 0.6})
    ]
    assert told[0] == told[1] == told[2]


@given(st.integers(0, 24), st.integers(0, 24))
def test_any_range_of_points_is_the_same_slice_of_the_grid(start, stop):
    grid = make_grid({"e": [0.5, 0.6], "f": [15, 20, 25], "A_r": [4, 5, 6, 7]})
    start, stop = min(start, stop), max(start, stop)
    np.testing.assert_array_equal(grid.rows_at(np.arange(start, stop)), grid.rows_at(np.arange(24))[start:stop])


@pytest.mark.parametrize(
    ("low", "high", "count"), [(0.3, 7.1, 1001), (1.0, 1e6, 7), (1e-3, 1e3, 7), (1e-300, 1e300, 50), (0.1, 0.2, 2)]
)
def test_values_in_a_fixed_ratio_are_the_nearest_floats(low, high, count):
    """So no processor gives others; powers of numpy are off by a last digit here and there, and where depends on it."""
    declared = {"start": low, "stop": high, "num": count, "spacing": "log"}
    with mpmath.workdps(60):
        share = [mpmath.mpf(k) / (count - 1) for k in range(count)]
        nearest = [float(mpmath.mpf(str(low)) * (mpmath.mpf(str(high)) / mpmath.mpf(str(low))) ** x) for x in share]
    assert axis_values("f", declared).tolist() == nearest


def test_one_value_in_a_fixed_ratio_is_the_first():
    assert axis_values("f", {"start": 2.0, "stop": 3.0, "num": 1, "spacing": "log"}).tolist() == [2.0]


# --- values of a range are the decimal numbers that were meant -------------------------------------------------------------


def meant(low, high, count):
    """Evenly spaced numbers between two decimals: each the nearest float."""
    first, last = Fraction(str(low)), Fraction(str(high))
    return [float(first + (last - first) * k / max(1, count - 1)) for k in range(count)]


@pytest.mark.parametrize("step", ["0.1", "0.05", "0.02", "0.01", "0.3", "0.007", "1e-5", "2.5"])
def test_steps_give_the_decimal_numbers_that_one_would_write(step):
    written = [float(Decimal(step) * k) for k in range(1, 300)]
    declared = {"start": float(step), "stop": written[-1], "step": float(step)}
    assert axis_values("xdot0", declared).tolist() == written
    assert axis_values("xdot0", {**declared, "start": -written[-1]}).tolist() == [-x for x in written[::-1]] + [
        0.0,
        *written,
    ]


@given(st.integers(-(10**6), 10**6), st.integers(1, 10**6), st.integers(0, 8), st.integers(2, 60))
def test_ends_are_exact_and_what_is_between_is_nearest(low, width, digits, count):
    low, high = float(Decimal(low).scaleb(-digits)), float(Decimal(low + width).scaleb(-digits))
    assert axis_values("xdot0", {"start": low, "stop": high, "num": count}).tolist() == meant(low, high, count)


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300), st.integers(2, 20))
def test_ends_are_exact_whatever_they_are(one, other, count):
    low, high = sorted((one, other))
    values = evenly(low, high, count)
    assert (values[0], values[-1]) == (low, high) and (np.diff(values) >= 0).all()


def test_all_shares_of_a_whole_end_at_it():
    """Each of these ranges is allowed: none ends above 1, as one in seventy did."""
    for start in np.arange(11) / 10:
        for num in range(2, 121):
            values = axis_values("e", {"start": float(start), "stop": 1.0, "num": num}) if start < 1 else np.ones(1)
            assert values[-1] == 1.0
            make_grid({"e": values})


@pytest.mark.parametrize("ends", [(0.1, 89.9, 0.1), (5, 85, 5), (-12, 12, 1.5), (0, 7.2, 0.01)])
def test_angles_of_a_range_are_those_that_their_texts_give(ends):
    start, stop, step = ends
    texts = [f"{float(x)!r} deg" for x in meant(start, stop, round((stop - start) / step) + 1)]
    written = [number("theta0", text) for text in texts]
    names = ("start", "stop", "step")
    assert axis_values("theta0", dict(zip(names, ends, strict=True)) | {"unit": "deg"}).tolist() == written
    told = dict(zip(names, (f"{x} deg" for x in ends), strict=True))
    assert axis_values("theta0", told).tolist() == written
    assert axis_values("theta0", texts).tolist() == written
    if start == 0:
        assert axis_values("theta0", told | {"start": 0}).tolist() == written


def test_an_angle_in_degrees_may_end_a_range_in_radians():
    values = axis_values("theta0", {"start": 0.5, "stop": "90 deg", "num": 3})
    assert values.tolist() == meant(0.5, np.pi / 2, 3)


def test_halves_are_decimal():
    assert finer(np.array([0.1, 0.5, 0.9]), 1).tolist() == [0.1, 0.3, 0.5, 0.7, 0.9]
    assert finer(np.array([0.1, 0.2, 0.4]), 2).tolist() == [0.1, 0.125, 0.15, 0.175, 0.2, 0.25, 0.3, 0.35, 0.4]


def test_a_long_range_is_made_in_a_few_calls():
    calls = []
    sys.setprofile(lambda *_: calls.append(1))
    try:
        values = axis_values("f", {"start": 0.1, "stop": 50_000, "step": 0.1})
    finally:
        sys.setprofile(None)
    assert values.size == 500_000 and values[2] == 0.3 and len(calls) < 10_000
