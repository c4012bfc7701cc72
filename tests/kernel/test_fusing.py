"""Which products of sums are not rounded is what the sources say, on every processor and without the compiler, to the bit."""

import ctypes
import linecache
import math
import re
import textwrap
from fractions import Fraction

import numba
import numpy as np
import pytest

from dimersweep.kernel.batch import run_rows
from dimersweep.kernel.compiler.fusing import NAME, fma, fused
from dimersweep.kernel.compiler.jit import Part, compiled, exported
from dimersweep.kernel.compiler.pipelines import PYTHON, pipeline
from dimersweep.work.proving import outcomes

GIVEN = np.random.default_rng(4).uniform(-2.0, 2.0, (60, 5)).tolist()


def once(a, b, c):
    """a * b + c, rounded once."""
    return float(Fraction(a) * Fraction(b) + Fraction(c))


# an expression of five numbers, and what its sums and products are by the rule
RULE = {
    "a * b + c": lambda a, b, c, d, e: once(a, b, c),
    "c + a * b": lambda a, b, c, d, e: once(a, b, c),
    "a * b - c": lambda a, b, c, d, e: once(a, b, -c),
    "c - a * b": lambda a, b, c, d, e: once(-a, b, c),
    "-a * b + c": lambda a, b, c, d, e: once(-a, b, c),
    "-(a * b) - c": lambda a, b, c, d, e: -(a * b) - c,
    "c - -a * b": lambda a, b, c, d, e: once(a, b, c),
    "c - -(a * b)": lambda a, b, c, d, e: c + a * b,
    "a * b + c * d": lambda a, b, c, d, e: once(a, b, c * d),
    "a * b - c * d": lambda a, b, c, d, e: once(a, b, -(c * d)),
    "a * b + c * d + e * a": lambda a, b, c, d, e: once(e, a, once(a, b, c * d)),
    "a + b * c + d": lambda a, b, c, d, e: once(b, c, a) + d,
    "a + (b * c + d)": lambda a, b, c, d, e: a + once(b, c, d),
    "a * (b + c * d) + e": lambda a, b, c, d, e: once(a, once(c, d, b), e),
    "a * b * c + d": lambda a, b, c, d, e: once(a * b, c, d),
    "d - a * b * c": lambda a, b, c, d, e: once(-(a * b), c, d),
    "a + b * (c * d)": lambda a, b, c, d, e: once(b, c * d, a),
    "a * b / c + d": lambda a, b, c, d, e: a * b / c + d,
    "a / b * c + d": lambda a, b, c, d, e: once(a / b, c, d),
    "-(a * b + c)": lambda a, b, c, d, e: -once(a, b, c),
    "abs(a * b - c) + d": lambda a, b, c, d, e: abs(once(a, b, -c)) + d,
    "math.sqrt(a * a + b * b)": lambda a, b, c, d, e: math.sqrt(once(a, a, b * b)),
    "(a * b + c) * d - e": lambda a, b, c, d, e: once(once(a, b, c), d, -e),
    "a * b + c if d * e - 1 < 0 else c * d": lambda a, b, c, d, e: once(a, b, c) if once(d, e, -1) < 0 else c * d,
    "2 * a + 1": lambda a, b, c, d, e: once(2.0, a, 1.0),
}
# of several lines; they give x
BLOCKS = {
    "x = a * b\nx = x + c": lambda a, b, c, d, e: a * b + c,
    "x = a\nx += b * c": lambda a, b, c, d, e: once(b, c, a),
    "x = a\nx -= b * c": lambda a, b, c, d, e: once(-b, c, a),
    "x = a\nx += b * c - d * e": lambda a, b, c, d, e: a + once(b, c, -(d * e)),
    "x = a\nx *= b * c + d": lambda a, b, c, d, e: a * once(b, c, d),
    "x = a\nx += b": lambda a, b, c, d, e: a + b,
    "x, y = a * b + c, a * d\nx = x - y": lambda a, b, c, d, e: once(a, b, c) - a * d,
    "x = a\nfor i in range(3):\n    x = x * b + i": lambda a, b, c, d, e: once(once(once(a, b, 0.0), b, 1.0), b, 2.0),
}


def function_of(body, name, **settings):
    """A compiled function of five numbers, and what Python calls it by."""
    file = f"<{name}>"
    text = f"def part(a, b, c, d, e):\n{textwrap.indent(body, '    ')}\n    return x\n"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    names = {"math": math, "np": np}
    exec(compile(text, file, "exec"), names)
    part = compiled(names["part"], **settings)

    def above(a, b, c, d, e):
        return part(a, b, c, d, e)

    return exported(above)


@pytest.mark.parametrize("body", [*RULE, *BLOCKS])
def test_what_is_rounded_once_is_what_the_rule_says(body):
    expected = (RULE | BLOCKS)[body]
    text = f"x = {body}" if body in RULE else body
    ours = function_of(text, body, fuse=True)
    assert [ours(*given) for given in GIVEN] == [expected(*given) for given in GIVEN]


@compiled(fuse=True)
def written_in_place(line, a, b):
    for i in range(2):
        line[2 * i + 1] -= a * b
    line[0] += a
    return line[1 * 1 + 0]


@exported
def in_place(line, a, b):
    return written_in_place(line, a, b)


def test_elements_are_written_in_place_at_places_that_are_whole_numbers():
    line = np.array([0.1, 0.2, 0.3, 0.4])
    assert in_place(line, 0.7, 0.3) == line[1]
    assert line.tolist() == [0.1 + 0.7, once(-0.7, 0.3, 0.2), 0.3, once(-0.7, 0.3, 0.4)]


def test_without_fuse_each_product_is_rounded():
    ours = function_of("x = a * b + c", "plain sum")
    found = [ours(*given) for given in GIVEN]
    assert found == [a * b + c for a, b, c, *_ in GIVEN] != [once(a, b, c) for a, b, c, *_ in GIVEN]


@compiled(fuse=True)
def multiplied(a, b, c):
    return a * b + c


@exported
def of_numbers(a, b, c):
    return multiplied(a, b, c)


TINY, HUGE = 5e-324, 1.7976931348623157e308
ENDS = [
    (TINY, 0.5, 0.0),
    (TINY, -0.5, 0.0),
    (TINY, 0.5, TINY),
    (1e-200, 1e-200, 0.0),
    (-1e-200, 1e-200, 0.0),
    (-1e-200, 1e-200, 1.0),
    (HUGE, 2.0, -HUGE),
    (HUGE, 2.0, 0.0),
    (HUGE, -2.0, 0.0),
    (HUGE, 2.0, -math.inf),
    (math.inf, 1.0, -math.inf),
    (math.inf, 0.0, 1.0),
    (math.nan, 1.0, 1.0),
    (0.0, -1.0, 0.0),
    (0.0, -1.0, -0.0),
    (-0.0, 1.0, -0.0),
    (3.0, 2.0, -6.0),
    (0.1, 10.0, -1.0),
    (1e16, 1.0, 1.0),
    (134217729.0, 134217729.0, -18014398777917440.0),
]


@pytest.mark.parametrize("given", ENDS, ids=str)
def test_at_the_ends_of_floats_and_without_the_compiler(given):
    """Where it can, mathematics of its own tells; the compiled code and Python have the same bits."""
    found, here = of_numbers(*given), fma(*given)
    if math.isnan(here):
        assert math.isnan(found)
        return
    assert math.copysign(1.0, found) == math.copysign(1.0, here) and found == here
    if all(map(math.isfinite, given)) and abs(here) <= HUGE:
        exact = Fraction(given[0]) * Fraction(given[1]) + Fraction(given[2])
        assert found == float(exact)


def test_random_floats_are_the_same_in_both_arithmetics():
    rng = np.random.default_rng(7)
    bits = rng.integers(0, 2**63, (3000, 3), dtype=np.uint64) | rng.integers(0, 2, (3000, 3), dtype=np.uint64) << 63
    given = bits.view(np.float64)
    close = rng.uniform(-1, 1, (3000, 2))
    given = np.vstack([given, np.column_stack([close, -close[:, 0] * close[:, 1]])])
    given = given[np.isfinite(given).all(axis=1)]
    for a, b, c in given.tolist():
        assert of_numbers(a, b, c).hex() == fma(a, b, c).hex()


@pytest.mark.skipif(pipeline() == PYTHON, reason="nothing is compiled")
def test_sums_of_whole_numbers_alone_are_refused():
    """They would become floats; beside a float they are taken for such."""
    assert of_numbers(3, 4.0, 5) == of_numbers(3.0, 4, 5) == of_numbers(3, 4, 5.0) == 17.0
    with pytest.raises(numba.TypingError):
        of_numbers(3, 4, 5)


@compiled(fuse=True)
def beside_a_name(a, b):
    return a * b + MIDDLE


MIDDLE = 0.3


def test_names_and_lines_of_a_function_stay():
    function = beside_a_name.py_func if isinstance(beside_a_name, Part) else beside_a_name
    lines = linecache.getlines(__file__)
    written = fused(function, lines)
    assert written(0.1, 0.7) == once(0.1, 0.7, 0.3)
    assert (written.__name__, written.__module__) == ("beside_a_name", __name__)
    place = next(number for number, line in enumerate(lines, 1) if "return a * b + MIDDLE" in line)
    assert place in {line for *_, line in written.__code__.co_lines()}
    with pytest.raises(ctypes.ArgumentError) as error:
        written(None, 1.0)
    assert error.traceback[1].lineno + 1 == place
    assert NAME in written.__globals__ and not NAME.isidentifier()


@pytest.mark.skipif(pipeline() == PYTHON, reason="nothing is compiled")
def test_no_compiler_is_left_to_fuse():
    """Neither in the code of a function, nor in the linked code of a kernel, has an operation leave to round otherwise."""
    outcomes()
    for overload in run_rows.dispatcher.overloads.values():
        code = str(overload.library._get_module_for_linking())  # of a cached one, too
        assert code.count("call double @llvm.fma.f64(") > 1000
        words = set(re.findall(r"[a-z_.0-9]+", code))
        assert {"fmul", "fadd", "fdiv"} <= words
        assert not words & {"contract", "fast", "reassoc", "afn", "arcp", "nnan", "ninf", "nsz", "llvm.fmuladd.f64"}
