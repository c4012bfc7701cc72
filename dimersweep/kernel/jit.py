"""The compiler settings of the kernel: cached, free of the GIL, strict about floating point, optimised once.

Numba makes machine code of every function on its own, and LLVM optimises what a function calls once more with each of its
callers. Here the functions that only other kernels call stay unoptimised parts (``linking.py``); an exported kernel links
all the parts it needs, and they are optimised and made machine code once, together. What Numba does on the way that a
kernel has no need of is left out (``compiling.py``). Both together save two thirds of the time to compile.
"""

from collections.abc import Callable
from typing import Any

import numba
from numba.core import types

from dimersweep.kernel.compiling import KernelCompiler
from dimersweep.kernel.linking import InlinedPart, Part, refusal

# no reference counts: nothing is allocated, and a part returns no array to code that counts
# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"_nrt": False, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_njit: Any = numba.njit
_config: Any = numba.config


class _PartCompiler(KernelCompiler):
    part = Part

    def compile_extra(self, func: Any) -> Any:
        state = self.state
        state.library = self.part(state.targetctx.codegen(), func.__qualname__)
        state.targetctx.get_executable = refusal
        return super().compile_extra(func)


class _InlinedCompiler(_PartCompiler):
    part = InlinedPart


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
    return _without_literals(_njit(cache=True, pipeline_class=KernelCompiler, **_SETTINGS)(function))


def compiled(function: Callable[..., Any] | None = None, *, fuse: bool = False, inline: bool = False) -> Any:
    """Compile what only other kernels call.

    Parameters
    ----------
    fuse : bool
        Round sums of products once instead of twice. Not for what treats the ends of the dimer by different expressions,
        which must agree exactly where they move alike.
    inline : bool
        Write the code into what calls it, however long: for what is called so often that passing its arrays counts.
    """
    if function is None:
        return lambda wrapped: compiled(wrapped, fuse=fuse, inline=inline)
    settings = _SETTINGS | {"pipeline_class": _InlinedCompiler if inline else _PartCompiler, "no_cpython_wrapper": True}
    settings["fastmath"] = {"contract"} if fuse else False  # where it is not set, that of the first caller would hold
    return _without_literals(_njit(**settings)(function))
