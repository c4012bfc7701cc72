"""Parts are merged into the kernels that call them, and are nothing that Python can call by mistake."""

import math

import numba
import pytest

from dimersweep.kernel.jit import compiled, exported


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


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="parts are plain functions with the JIT off")
def test_python_cannot_call_a_part():
    root(4.0)
    with pytest.raises(TypeError):
        leaf(4.0)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="needs the JIT")
def test_a_part_is_never_made_machine_code():
    root(4.0)
    (overload,) = leaf.overloads.values()
    assert not overload.library._finalized
