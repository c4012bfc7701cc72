"""The compiler settings of the kernel: cached, free of the GIL, strict about floating point."""

from collections.abc import Callable
from typing import Any

import numba
from numba.core import types

# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_njit: Any = numba.njit
_config: Any = numba.config


def _without_literals(function: Any) -> Any:
    """Have constants in calls typed as plain numbers: else each of them compiles the function once more."""
    if _config.DISABLE_JIT:
        return function
    typed = function.get_call_template

    def get_call_template(args: Any, kws: Any) -> Any:
        return typed(tuple(types.unliteral(a) for a in args), {k: types.unliteral(v) for k, v in kws.items()})

    function.get_call_template = get_call_template
    return function


def exported(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls."""
    return _without_literals(_njit(**_SETTINGS)(function))


def compiled(function: Callable[..., Any]) -> Any:
    """Compile what only other kernels call: without a wrapper for Python, a third of the compile time."""
    return _without_literals(_njit(no_cpython_wrapper=True, **_SETTINGS)(function))


def inlined(function: Callable[..., Any]) -> Any:
    """Merge into its one caller what is large and called from one place: else LLVM would optimise it twice."""
    return _without_literals(_njit(inline="always", no_cpython_wrapper=True, **_SETTINGS)(function))
