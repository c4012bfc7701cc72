"""Sine and cosine at once: against 40 digits, at the borders of the reduction, and beyond it."""

from math import inf, isnan, nan, nextafter, pi

import mpmath
import numpy as np
import pytest

from tests.checks.verbs import sincos


@pytest.mark.parametrize("size", [1e-300, 1e-9, 1e-3, 0.8, 10.0, 1e3, 1e5])
def test_both_are_right_to_rounding(size):
    rng = np.random.default_rng(5)
    whole = (pi / 4) * np.arange(-20.0, 21.0)
    angles = np.concatenate([size * rng.uniform(-1, 1, 300), whole[abs(whole) <= size], [size, -size]])
    with mpmath.workdps(40):
        for x in angles:
            exact = [float(mpmath.sin(mpmath.mpf(x))), float(mpmath.cos(mpmath.mpf(x)))]
            for told, true in zip(sincos(x), exact, strict=True):
                # next to a zero the error is that of the angle, reduced by a pi of 86 bits
                assert abs(told - true) <= 1.5 * np.spacing(abs(true)) + 1e-26 * max(1.0, abs(x))


def test_opposite_angles_have_the_same_digits():
    for x in np.random.default_rng(6).uniform(0, 50, 1000):
        s, c = sincos(x)
        assert sincos(-x) == (-s, c)


@pytest.mark.parametrize("x", [nextafter(1e5, inf), -3e7, 2e15, 1e300])
def test_large_angles_are_right_within_what_rounds_them(x):
    with mpmath.workdps(400):
        true = mpmath.mpf(x)
        s, c = sincos(x)
        told = mpmath.atan2(mpmath.mpf(s), mpmath.mpf(c))
        off = abs(mpmath.fmod(true - told + mpmath.pi, 2 * mpmath.pi) - mpmath.pi)
        assert min(off, 2 * mpmath.pi - off) <= 0.5 * np.spacing(abs(x)) + 4e-16
    assert sincos(-x) == (-s, c)


@pytest.mark.parametrize("x", [inf, -inf, nan])
def test_no_angle_gives_no_number(x):
    assert all(map(isnan, sincos(x)))
