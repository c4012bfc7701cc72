"""Parts are merged into the kernels that call them; what the compiler leaves out changes no result, and no other code."""

import contextlib
import gc
import math
import operator

import numba
import numpy as np
import pytest

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.compiler.pipelines import FAST, PYTHON, pipeline

fast_only = pytest.mark.skipif(pipeline() != FAST, reason="for the fast way of compiling")


@compiled
def leaf(x):
    return math.sqrt(x)


@compiled
def left(x):
    return leaf(x) + 1.0


@compiled
def right(x):
    return leaf(x) + left(x)


@exported
def root(x):
    return left(x) * right(x)


@exported
def other_root(x):
    return right(x)


def test_parts_shared_by_several_kernels_are_linked_once_into_each():
    assert root(4.0) == 15.0
    assert other_root(4.0) == 5.0


@pytest.mark.skipif(pipeline() == PYTHON, reason="it is a function of Python then")
def test_python_cannot_call_a_part():
    root(4.0)
    with pytest.raises(TypeError, match=r"^leaf: called by compiled code only$"):
        leaf(4.0)


@fast_only
def test_a_part_is_never_made_machine_code():
    @compiled
    def part(x):
        return x + 1.0

    @exported
    def above(x):
        return part(x)

    assert above(4.0) == 5.0
    (overload,) = part.dispatcher.overloads.values()
    assert not overload.library._finalized


@exported
def indexed(line, grid, whole, table):
    """Elements by plain, negative, narrow and paired indices, rows, slices and other layouts, read and written."""
    found = 0.0
    for n in range(-len(line), len(line)):
        found = 10.0 * found + line[n] - whole[n]
        grid[n, n % 2] = n
        found += grid[n, n % 2 - 2] - grid[-1, n % 2] + grid[n][1] + table[n, -1]
    line[-1], line[np.int8(1)] = whole[0], True
    whole[2] = 7.9
    shape = grid.shape
    return found + line[-2:][0] + grid[np.int32(1), 0] + shape[1]


def test_elements_are_those_of_python():
    def arrays():
        grid, table = np.arange(10.0, 16.0).reshape(3, 2), np.asfortranarray(np.arange(6.0).reshape(3, 2))
        return np.array([1.5, -2.0, 4.0]), grid, np.array([3, 1, -5]), table

    here, there = arrays(), arrays()
    assert indexed(*here) == getattr(indexed, "py_func", indexed)(*there)
    for ours, of_python in zip(here, there, strict=True):
        np.testing.assert_array_equal(ours, of_python)


@fast_only
@pytest.mark.parametrize("argument", [3.0, "not a number"], ids=["compiles", "fails to compile"])
def test_the_compiler_is_as_before_for_other_code(argument):
    from numba.core.types.functions import BaseFunction

    @exported
    def above(x):
        return leaf(x)

    before = BaseFunction.get_call_type
    with contextlib.suppress(numba.TypingError):
        above(argument)
    assert len(above.dispatcher.overloads) == (argument == 3.0)
    assert BaseFunction.get_call_type is before
    assert gc.isenabled()


@fast_only
def test_an_operation_is_typed_once_for_all_functions(monkeypatch):
    from dimersweep.kernel.compiler import linking

    asked = []
    typed = linking._type
    linking._typed.cache_clear()
    monkeypatch.setattr(linking, "_type", lambda *given: asked.append(given[0].key[0]) or typed(*given))

    @compiled
    def first(x):
        return x * x - x * x * x

    @exported
    def second(x):
        return first(x) * x

    assert second(2.0) == -8.0
    assert asked.count(operator.mul) == 1


@fast_only
@pytest.mark.parametrize("inline", [False, True])
def test_what_is_called_often_is_written_into_its_callers(inline):
    @compiled(inline=inline)
    def long(x):
        for n in range(3):
            x += math.sin(x) * math.cos(x + n) / (1.0 + math.sqrt(x * x + math.exp(x)))
            if x > 4.0:
                x -= math.log(x) + math.atan2(x, n + 1.0)
            elif x < 2.0:
                x *= math.hypot(x, math.tan(n + 0.5)) + math.pow(x, 0.3)
        return x

    @exported
    def caller(x):
        return long(x) + long(x + 1.0) * long(x + 2.0) - long(x - 1.0)

    assert caller(1.0) == pytest.approx(expected(long.py_func))
    assert ("call" in calls_of(caller, "long")) is not inline


def expected(long):
    return long(1.0) + long(2.0) * long(3.0) - long(0.0)


def calls_of(function, name):
    """The calls of what bears a name in the machine-independent code of a compiled function."""
    (code,) = function.dispatcher.inspect_llvm().values()
    return " ".join(line for line in code.splitlines() if " call " in line and f"{name}B" in line)
