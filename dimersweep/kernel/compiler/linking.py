"""The code of a function that only kernels call, kept to be linked into them before it is optimised and made machine code."""

import ctypes
from functools import cache
from importlib import import_module
from typing import Any

from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

from dimersweep.kernel.compiler.target import target

_Library: Any = JITCodeLibrary
_Codegen: Any = JITCPUCodegen
_BAD_ARGUMENT = ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value


def _needed(library: Any, seen: dict[int, Any]) -> dict[int, Any]:
    """What this library calls, each once, with what the parts among it call."""
    for each in library._linking_libraries:
        if id(each) not in seen:
            seen[id(each)] = each
            if isinstance(each, Part):
                _needed(each, seen)
    return seen


class _Kernel(_Library):
    """The code of an exported kernel with all that it calls, which nothing else may call.

    So LLVM passes on what a function uses of its arguments, and not the seven words of each array. Such a function has no
    name in the object code: the loader would take it for another one of that name.
    """

    def finalize(self) -> None:
        needed = _needed(self, {}).values()
        for part in needed:
            if isinstance(part, Part):
                self._final_module.link_in(part.alone(), preserve=True)
        self._linking_libraries = [each for each in needed if not isinstance(each, Part)]
        super().finalize()

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "linkonce_odr":
                function.linkage = "private"
        super()._optimize_final_module()


class _KernelCodegen(_Codegen):
    """Numba's maker of machine code, for the kernel's own target: other code of the process is compiled as before."""

    _library_class = _Kernel

    def _get_host_cpu_name(self) -> str:
        return target()[0]

    def _get_host_cpu_features(self) -> str:
        return target()[1]


@cache
def kernel_codegen() -> Any:
    """The one that all kernels share."""
    return _KernelCodegen("dimersweep")


class Part(_Library):
    """The code of one function, as Numba lowers it: neither optimised with what it calls nor made machine code."""

    _shared_module: Any

    def _optimize_functions(self, module: Any) -> None:
        """Optimise each function by itself, as Numba does, but lightly: all of them are optimised together later."""
        module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager(opt=1)
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _ensure_finalized(self) -> None:
        """Never: only what links it is finalized."""

    def alone(self) -> Any:
        """This function without what it calls, for a kernel, which links each part that it needs once."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        return self._final_module

    def _get_module_for_linking(self) -> Any:
        """This function with all that it calls, for a function that Numba itself compiles."""
        if self._shared_module is None:
            shared = self.alone().clone()
            for each in _needed(self, {}).values():
                if each is not self:
                    module = each.alone() if isinstance(each, Part) else each._get_module_for_linking()
                    shared.link_in(module, preserve=True)
            self._shared_module = shared
        return self._shared_module


def refusal(library: Any, fndesc: Any, env: Any) -> Any:
    """What Python gets hold of in place of a part: a function that raises a TypeError."""
    make_function = import_module("numba._dynfunc").make_function
    return make_function(fndesc.lookup_module(), fndesc.qualname, "no wrapper", _BAD_ARGUMENT, env, (library,))
