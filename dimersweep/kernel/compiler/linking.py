"""The fast way of compiling: functions that only kernels call are kept as parts, and linked before they are optimised.

Numba makes machine code of every function on its own, and LLVM optimises what a function calls once more with each of its
callers. Here an exported kernel links all the parts it needs, each once, and they are optimised and made machine code together.
What Numba does on the way that a kernel has no need of is left out: it has no closures, no ``with``, no tuples of mixed types
and no array expressions, but the same few operations on the same few types a thousand times.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompilerBase, PassManager
from numba.core.typed_passes import NativeLowering, NoPythonBackend, NopythonTypeInference, PreLowerStripPhis
from numba.core.types.functions import BaseFunction
from numba.core.untyped_passes import FixupArgs, ReconstructSSA, TranslateByteCode

from dimersweep.kernel.compiler.versions import target

_PASSES: tuple[Any, ...] = (
    TranslateByteCode,
    FixupArgs,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
    NativeLowering,
    NoPythonBackend,
)
_Function: Any = BaseFunction  # it is patched
_type: Callable[..., Any] = BaseFunction.get_call_type


class _Part(JITCodeLibrary):
    """The code of one function, as Numba lowers it: neither optimised with what it calls nor made machine code."""

    def _optimize_functions(self, module: Any) -> None:
        """Optimise each function by itself, as Numba does, but lightly: all of them are optimised together later."""
        module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager(opt=1)
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _ensure_finalized(self) -> None:
        """Never: only what links it is finalized, which takes this function without what it calls."""


def _needed(library: Any, seen: dict[int, Any]) -> dict[int, Any]:
    """What this library calls, each once, with what the parts among it call."""
    for each in library._linking_libraries:
        if id(each) not in seen:
            seen[id(each)] = each
            if isinstance(each, _Part):
                _needed(each, seen)
    return seen


class _Kernel(JITCodeLibrary):
    """The code of an exported kernel with all that it calls, which nothing else may call.

    So LLVM passes on what a function uses of its arguments, and not the seven words of each array. Such a function has no
    name in the object code: the loader would take it for another one of that name.
    """

    def finalize(self) -> None:
        self._linking_libraries = list(_needed(self, {}).values())
        super().finalize()

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "linkonce_odr":
                function.linkage = "private"
        super()._optimize_final_module()


class _KernelCodegen(JITCPUCodegen):
    """Numba's maker of machine code, for the kernel's own target: other code of the process is compiled as before."""

    _library_class = _Kernel

    def _get_host_cpu_name(self) -> str:
        return target()[0]

    def _get_host_cpu_features(self) -> str:
        return target()[1]


@cache
def _codegen() -> Any:
    """The one that all kernels share."""
    return _KernelCodegen("dimersweep")


_size = cache(lambda kind: kind.get_abi_size(_codegen().target_data))  # of a type: LLVM parses a module to tell it


_typed = cache(lambda function, context, args, kws: _type(function, context, args, dict(kws)))


def _type_once(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of an operation for types of arguments: Numba looks through all that it knows every time."""
    return _typed(function, context, tuple(args), tuple(kws.items()))


@contextmanager
def _in_a_hurry() -> Iterator[None]:
    """Type each operation once, and look for no garbage; Numba's lock keeps other threads from compiling.

    The former takes a sixth off the time, the latter a seventh.
    """
    before, collects = _Function.get_call_type, gc.isenabled()
    try:
        _Function.get_call_type = _type_once
        gc.disable()
        yield
    finally:
        _Function.get_call_type = before
        if collects:
            gc.enable()


class KernelCompiler(CompilerBase):
    """Compiles a kernel that Python calls, with those of Numba's passes that it needs."""

    def define_pipelines(self) -> list[Any]:
        passes = PassManager("kernel")
        for each in _PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]

    def compile_extra(self, func: Any) -> Any:
        context = self.state.targetctx  # a copy for this function only
        context._internal_codegen, context.get_abi_sizeof = _codegen(), _size
        with _in_a_hurry():
            return super().compile_extra(func)


class PartCompiler(KernelCompiler):
    """Compiles a function that only other kernels call: it becomes a part, not machine code."""

    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Part(_codegen(), func.__qualname__)
        # the entry from Python, by which Numba knows a function: one of its own that is never called (``jit.py``)
        self.state.targetctx.get_executable = lambda *_: {}.popitem
        return super().compile_extra(func)
