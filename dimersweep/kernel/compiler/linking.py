"""The fast way of compiling: device functions are kept as parts, and linked into a kernel before they are optimised.

Numba makes machine code of every function on its own, and LLVM optimises a function once more with each of its callers.
Here an exported kernel links all the parts it needs, each once. Then they are optimised, and made machine code,
together. Passes of Numba that a kernel does not need are left out: it has no closures, no ``with``, no tuples of mixed
types and no array expressions, but the same few operations on the same few types a thousand times.
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

# passes of Numba that a kernel needs, in their order
_PASSES: tuple[Any, ...] = (
    TranslateByteCode,
    FixupArgs,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
    NativeLowering,
    NoPythonBackend,
)
_Function: Any = BaseFunction  # typed as Any, since `_in_a_hurry` patches it
_type: Callable[..., Any] = BaseFunction.get_call_type


class _Part(JITCodeLibrary):
    """The code of one function, as Numba lowers it: not optimised with its callees, and not made machine code."""

    def _optimize_functions(self, module: Any) -> None:
        """Optimise each function by itself, as Numba does, but lightly: all functions are optimised together later."""
        module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager(opt=1)
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _ensure_finalized(self) -> None:
        """Do nothing: the kernel that links the part is finalized, and takes the part without its callees."""


def _needed(library: Any, seen: dict[int, Any]) -> dict[int, Any]:
    """Add to `seen`, and return, the libraries that a library calls, directly or through parts, by their `id`."""
    for each in library._linking_libraries:
        if id(each) not in seen:
            seen[id(each)] = each
            if isinstance(each, _Part):
                _needed(each, seen)
    return seen


class _Kernel(JITCodeLibrary):
    """The code of an exported kernel with all functions that it calls, which nothing else may call.

    So LLVM passes only the parts of arguments that a function uses, and not the seven words of each array. Such a
    function has no name in the object code: the loader would take it for the function of that name in another kernel.
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
    """Numba's code generator for the kernel's own target: other code of the process is compiled as before."""

    _library_class = _Kernel

    def _get_host_cpu_name(self) -> str:
        return target()[0]

    def _get_host_cpu_features(self) -> str:
        return target()[1]


@cache
def _codegen() -> Any:
    """Return the code generator that all kernels share."""
    return _KernelCodegen("dimersweep")


_size = cache(lambda kind: kind.get_abi_size(_codegen().target_data))  # size of a type, for which LLVM parses a module


_typed = cache(lambda function, context, args, kws: _type(function, context, args, dict(kws)))


def _type_once(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return the signature of an operation for types of arguments, looked up once: Numba's search takes long."""
    return _typed(function, context, tuple(args), tuple(kws.items()))


@contextmanager
def _in_a_hurry() -> Iterator[None]:
    """Look up each signature once, and collect no garbage, while the context lasts.

    The first saves a sixth of the time, the second a seventh. Numba's lock keeps other threads from compiling
    meanwhile.
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
    """A compiler of kernels that Python calls, with the passes of Numba that they need."""

    def define_pipelines(self) -> list[Any]:
        passes = PassManager("kernel")
        for each in _PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]

    def compile_extra(self, func: Any) -> Any:
        context = self.state.targetctx  # a copy for this function, so that the change concerns no other one
        context._internal_codegen, context.get_abi_sizeof = _codegen(), _size
        with _in_a_hurry():
            return super().compile_extra(func)


class PartCompiler(KernelCompiler):
    """A compiler of functions that only other kernels call: they become parts, not machine code."""

    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Part(_codegen(), func.__qualname__)
        # Numba knows a function by its entry point from Python: each part has a new one, which is never called
        # (``jit.py``)
        self.state.targetctx.get_executable = lambda *_: {}.popitem
        return super().compile_extra(func)
