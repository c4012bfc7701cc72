"""The compiler settings of the kernel: cached, free of the GIL, strict about floating point, optimised once.

Numba makes machine code of every function on its own, and LLVM optimises what a function calls once more with each of its
callers. Here the functions that only other kernels call stay unoptimised parts (``linking.py``); an exported kernel links
all the parts it needs, and they are optimised and made machine code once, together. What Numba does on the way that a
kernel has no need of is left out (``compiling.py``). Both together save two thirds of the time to compile.
"""

import hashlib
import inspect
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from dimersweep.kernel.compiler.cache import load, save
from dimersweep.kernel.compiler.compiling import KernelCompiler
from dimersweep.kernel.compiler.linking import Part, refusal
from dimersweep.kernel.compiler.versions import sources_digest

OLDEST = (0, 61)  # of Numba, as in pyproject.toml
# no reference counts: nothing is allocated, and a part returns no array to code that counts
# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"_nrt": False, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_njit: Any = numba.njit
_config: Any = numba.config
_NoCache: Any = NullCache
_Result: Any = CompileResult
_version = numba.__version__
if tuple(map(int, _version.split(".")[:2])) < OLDEST:
    raise ImportError(f"numba = {_version}: must be >= {'.'.join(map(str, OLDEST))}")
_folder_digest = cache(sources_digest)


class _Kept(_NoCache):
    """The cache of one compiled function, in the place of the one that Numba makes by the settings of the process."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._digest = hashlib.sha256(
            _folder_digest(folder) + f"{function.__module__}.{function.__qualname__}".encode()
        )
        self._function = function.__name__

    def _name(self, signature: Any) -> str:
        digest = self._digest.copy()
        digest.update(f" {signature}".encode())
        return f"{self._function}-{digest.hexdigest()[:16]}"

    def load_overload(self, signature: Any, context: Any) -> Any:
        context.refresh()  # what the code refers to must be known
        code = load(self._name(signature))
        return None if code is None else _Result._rebuild(context, *pickle.loads(code))

    def save_overload(self, signature: Any, result: Any) -> None:
        if not result.library.has_dynamic_globals:  # addresses of this process
            save(self._name(signature), dumps(result._reduce()))


def kept(function: Any) -> Any:
    """Keep the code of a compiled function for later processes: by the kernel's version and all sources of its own folder."""
    if not _config.DISABLE_JIT:
        path = Path(inspect.getfile(function.py_func))
        if path.is_file() and not function.py_func.__closure__:  # no prompt, and nothing that sources do not tell
            function._cache = _Kept(function.py_func, path.parent)
    return function


class _PartCompiler(KernelCompiler):
    def compile_extra(self, func: Any) -> Any:
        state = self.state
        state.library = Part(state.targetctx.codegen(), func.__qualname__)
        state.targetctx.get_executable = refusal
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
    return kept(_without_literals(_njit(pipeline_class=KernelCompiler, **_SETTINGS)(function)))


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
    settings = _SETTINGS | {"pipeline_class": _PartCompiler, "no_cpython_wrapper": True}
    # where these two are not set, those of the first caller would hold
    settings |= {"fastmath": {"contract"} if fuse else False, "forceinline": inline}
    return _without_literals(_njit(**settings)(function))
