"""Exponential, logarithm, powers, arctangent, sine and cosine: against 40 digits or more, at their borders, and beyond them."""

import pickle
import struct
import sys
from math import atan2, copysign, inf, isnan, nan, nextafter, pi

import mpmath
import numpy as np
import pytest

import dimersweep
from dimersweep import orbits
from dimersweep.kernel import batch, return_map, sample
from dimersweep.kernel.compiler.cache import load
from dimersweep.kernel.compiler.pipelines import FAST, pipeline
from dimersweep.kernel.compiler.versions import code_version
from dimersweep.kernel.model import body
from dimersweep.parameters import Parameters
from dimersweep.runs.period_map import Section
from dimersweep.work.proving import outcomes
from tests.checks import verbs
from tests.checks.verbs import sincos

UNITS = 1.3  # greatest error, in units in the last place
EXPONENTS = [1 / 15, 1 / 14, 0.2, 1 / 3, 0.4, 0.5, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 6.0]  # as the kernel has
EXACT = {"fmod", "floor", "ceil", "rint", "memcpy", "memmove", "memset"}  # what code may ask the system for


def sizes(low, high, n, seed=3):
    """Random numbers of both signs and of all sizes between two powers of ten."""
    rng = np.random.default_rng(seed)
    return 10.0 ** rng.uniform(low, high, n) * rng.choice([-1.0, 1.0], n)


def assert_right(told, true, units=UNITS):
    assert abs(mpmath.mpf(told) - true) <= units * np.spacing(abs(float(true)))


@pytest.fixture(autouse=True)
def digits():
    with mpmath.workdps(50):
        yield


NEAR = np.concatenate([sizes(-300, 0, 500), np.random.default_rng(4).uniform(-3, 3, 3000), [0.7, -0.7]])
STEPS = np.log(2.0) * (np.arange(-60, 60) + 0.5)  # where the reduction goes on to the next power of two


@pytest.mark.parametrize(
    "x", [NEAR, np.random.default_rng(5).uniform(-708, 709, 2000), STEPS], ids=["near", "far", "steps"]
)
def test_exponential(x):
    for number in x:
        assert_right(verbs.exp(number), mpmath.exp(number))


def test_logarithm():
    for x in np.concatenate([abs(NEAR), abs(sizes(-1, 300, 500)), 2.0 ** np.arange(30), [5e-324, 1e-310]]):
        assert_right(verbs.log(x), mpmath.log(x), 1.7)  # it gives the sizes of steps only


@pytest.mark.parametrize("scale", [1e-200, 1e-3, 1.0, 1e3])
def test_arctangent(scale):
    vectors = np.random.default_rng(7).normal(size=(3000, 2)) * [1.0, scale]
    borders = np.concatenate([[(7.0, 16.0), (11.0, 16.0), (1.0, 1.0)], np.nextafter([(7.0, 16.0), (11.0, 16.0)], 20.0)])
    for y, x in np.concatenate([vectors, borders, borders[:, ::-1], -borders]):
        assert_right(verbs.atan2(y, x), mpmath.atan2(y, x))
        assert verbs.atan2(-y, x) == -verbs.atan2(y, x)


@pytest.mark.parametrize("y", EXPONENTS)
def test_powers(y):
    for x in np.concatenate([abs(sizes(-45, 20, 700)), np.random.default_rng(8).uniform(0.5, 2.0, 300)]):
        assert_right(verbs.raised(x, y), mpmath.mpf(x) ** mpmath.mpf(y))


def test_powers_that_are_exact():
    for n in map(float, range(1, 500)):
        assert verbs.raised(0.1 * n, 1.0) == 0.1 * n
        assert verbs.raised(n, 2.0) == n * n
        assert verbs.raised(n * n, 0.5) == n
        assert verbs.raised(n * n * n, 1 / 3) == pytest.approx(n, rel=3e-16)
    assert [verbs.multiplied(3.0, n) for n in range(8)] == [3.0**n for n in range(8)]


@pytest.mark.parametrize(
    ("y", "x"), [(0.0, 1.0), (-0.0, 1.0), (0.0, -1.0), (-0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)]
)
def test_arctangent_along_the_axes(y, x):
    told = verbs.atan2(y, x)
    assert told == atan2(y, x)
    assert copysign(1.0, told) == copysign(1.0, y)


def test_beyond_all_borders():
    assert (verbs.exp(-inf), verbs.exp(-709.0), verbs.exp(0.0), verbs.exp(710.0), verbs.exp(inf)) == (0, 0, 1, inf, inf)
    powers = [(0.0, 0.4), (inf, 0.4), (1e-200, 2.5), (1e200, 2.5)]
    assert [verbs.raised(x, y) for x, y in powers] == [0, inf, 0, inf]
    assert verbs.raised(5e-324, 0.5) == pytest.approx(5e-324**0.5)
    assert all(map(isnan, [verbs.exp(nan), verbs.raised(nan, 0.4)]))
    assert all(map(isnan, [verbs.atan2(nan, 1.0), verbs.atan2(1.0, nan), verbs.atan2(nan, 0.0), verbs.atan2(0.0, nan)]))


def symbols(code):
    """Names in an object file for x86-64 or arm64 Linux, with the section where each is found: 0 for those of others."""
    (at,), (count,) = struct.unpack_from("<Q", code, 40), struct.unpack_from("<H", code, 60)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, at + 64 * k) for k in range(count)]
    for _, kind, _, _, start, size, strings, *_ in sections:
        if kind == 2:  # a table of symbols
            for entry in range(start + 24, start + size, 24):  # the first one is empty
                name, info, _, section = struct.unpack_from("<IBBH", code, entry)
                first = sections[strings][4] + name
                yield code[first : code.index(b"\0", first)].decode(), section, info & 15


def object_codes():
    """Object code of every exported kernel in use."""
    outcomes()
    dimersweep.simulate(periods=3).states([0.01, 0.02])
    section = Section(Parameters().row(), 1e-8)
    section.after(section.state(np.zeros(8), np.zeros(2)), 1)
    orbits.find(spin=100.0)
    for kernel in (batch.run_rows, sample.sample, return_map.advance, return_map.images, body.fill_dimer):
        assert kernel.dispatcher.overloads
        for signature in kernel.dispatcher.overloads:
            parts = pickle.loads(load(code_version(pipeline()), kernel.dispatcher._cache._name(signature)))
            yield kernel.__name__, next(part[2][0] for part in parts if isinstance(part, tuple) and "object" in part)


@pytest.mark.jit
@pytest.mark.skipif(sys.platform != "linux", reason="reads object files of Linux")
def test_compiled_code_calls_no_function_of_the_mathematical_library():
    for _, code in object_codes():
        others = {name for name, section, _ in symbols(code) if section == 0}
        names = {name for name in others if not name.startswith(("Py", "_Py", "numba_", "NRT_"))}
        assert names <= EXACT
        assert "fmod" in names  # the table was read


@pytest.mark.jit
@pytest.mark.skipif(
    sys.platform != "linux" or pipeline() != FAST, reason="reads object files of Linux, linked the fast way"
)
def test_functions_that_a_kernel_links_have_no_name():
    """The loader would take a function of one kernel for that of another, which has other arguments left."""
    function = 2
    for kernel, code in object_codes():
        names = [name for name, section, kind in symbols(code) if section and kind == function]
        assert names
        assert all(f"{len(kernel)}{kernel}" in name for name in names), names


# --- sine and cosine at once ------------------------------------------------------------------------------------------


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


def test_whole_numbers_are_made_without_integers():
    """An integer of a number that has none is the processor's choice."""
    rng = np.random.default_rng(3)
    given = [*rng.uniform(-9, 9, 300), *rng.uniform(-(2.0**50), 2.0**50, 300), *np.arange(-4.5, 5.0), 0.0, -0.0]
    assert [verbs.nearest(x) for x in given] == [float(round(x)) for x in given]
    assert [verbs.nearest(x) for x in (1e300, -1e300, inf)] == [1e300, -1e300, inf]
    assert isnan(verbs.nearest(nan))
