"""The compiler settings of the kernel: cached, free of the GIL, strict about floating point, optimised once.

Numba makes machine code of every function on its own, and LLVM optimises what a function calls once more with each of its
callers. Here the functions that only other kernels call stay unoptimised parts; an exported kernel links all the parts it
needs, and they are optimised and made machine code once, together. That saves half of the time to compile.
"""

import ctypes
import gc
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numba
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder

# no reference counts: nothing is allocated, and a part returns no array to code that counts
# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS = {"_nrt": False, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
# what Numba would look for in every function, and a kernel has not
_ABSENT = (
    "with_lifting",
    "inline_closure_likes",
    "make_function_op_code_to_jit_function",
    "inline_inlinables",
    "inline_overloads",
    "find_literally",
    "literal_unroll",
    "LiteralPropagation",
    "nopython_rewrites",
)
_njit: Any = numba.njit
_config: Any = numba.config
_Library: Any = JITCodeLibrary
_Base: Any = CompilerBase
_BAD_ARGUMENT = ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value


class _Part(_Library):
    """The code of one function, as Numba lowers it: neither optimised nor made machine code."""

    _shared_module: Any

    def _ensure_finalized(self) -> None:
        """Never: only what links it is finalized."""

    def _all(self, seen: dict[int, Any]) -> dict[int, Any]:
        """This part and those below it."""
        if id(self) not in seen:
            seen[id(self)] = self
            for library in self._linking_libraries:
                if isinstance(library, _Part):
                    library._all(seen)
                else:
                    seen[id(library)] = library
        return seen

    def _get_module_for_linking(self) -> Any:
        """The part with all that it calls, for an exported kernel to link."""
        if self._shared_module is None:
            shared = self._final_module.clone()
            for library in self._all({}).values():
                if library is not self:
                    part = isinstance(library, _Part)
                    module = library._final_module if part else library._get_module_for_linking()
                    shared.link_in(module, preserve=True)
            for function in shared.functions:
                if not function.is_declaration and function.linkage.name == "external":
                    function.linkage = "linkonce_odr"
            self._shared_module = shared
        return self._shared_module


class _Compiler(_Base):
    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [p for p in passes.passes if p[0].name() not in _ABSENT]
        return [passes]

    def compile_extra(self, func: Any) -> Any:
        collects = gc.isenabled()
        gc.disable()  # looking for cycles among millions of objects takes a seventh of the time
        try:
            return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()


def _refusal(library: Any, fndesc: Any, env: Any) -> Any:
    """What Python gets hold of in place of a part: a function that raises a TypeError."""
    make_function = import_module("numba._dynfunc").make_function
    return make_function(fndesc.lookup_module(), fndesc.qualname, "no wrapper", _BAD_ARGUMENT, env, (library,))


class _PartCompiler(_Compiler):
    def compile_extra(self, func: Any) -> Any:
        state = self.state
        state.library = _Part(state.targetctx.codegen(), func.__qualname__)
        state.targetctx.get_executable = _refusal
        return super().compile_extra(func)


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
    return _without_literals(_njit(cache=True, pipeline_class=_Compiler, **_SETTINGS)(function))


def compiled(function: Callable[..., Any]) -> Any:
    """Compile what only other kernels call."""
    return _without_literals(_njit(no_cpython_wrapper=True, pipeline_class=_PartCompiler, **_SETTINGS)(function))
