"""How the kernel is compiled: free of the GIL, strict about floating point, and kept for later processes.

There are two ways. The plain one is ``numba.njit``, which works with every Numba. The fast one takes a sixth of its time, by
means that only the versions it was tested with are known to have. Numba makes machine code of every function on its own, and
LLVM optimises what a function calls once more with each of its callers. The fast way keeps the functions that only other
kernels call as unoptimised parts (``linking.py``); an exported kernel links all the parts it needs, and they are optimised and
made machine code once, together. What Numba does on the way that a kernel has no need of is left out (``compiling.py``).
"""

from collections.abc import Callable
from typing import Any

import numba
from numba import types

from dimersweep.kernel.compiler.keeping import kept
from dimersweep.kernel.compiler.target import target
from dimersweep.kernel.compiler.versions import FAST, PLAIN, way

# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_njit: Any = numba.njit
_config: Any = numba.config
if way() == PLAIN:  # the settings of the whole process: other code is compiled for the same target, if it comes later
    _config.CPU_NAME, _config.CPU_FEATURES = target()


def _compile(function: Callable[..., Any], part: bool, inline: bool, **settings: Any) -> Any:
    if way() == FAST:
        from dimersweep.kernel.compiler.compiling import fast_settings

        settings |= fast_settings(part, inline)
    return _without_literals(_njit(**_SETTINGS, **settings)(function))


def _without_literals(function: Any) -> Any:
    """Have constants in calls typed as plain numbers: else each of them compiles the function once more."""
    typed = getattr(function, "get_call_template", None)
    if typed is None:  # the JIT is off, or Numba has changed
        return function

    def get_call_template(args: Any, kws: Any) -> Any:
        return typed(tuple(types.unliteral(a) for a in args), {k: types.unliteral(v) for k, v in kws.items()})

    function.get_call_template = get_call_template
    return function


def exported(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls."""
    return kept(_compile(function, part=False, inline=False))


def plain(function: Any) -> Any:
    """The Python function of a compiled one: what is only arithmetic takes arrays there."""
    return getattr(function, "py_func", function)


def compiled(function: Callable[..., Any] | None = None, *, fuse: bool = False, inline: bool = False) -> Any:
    """Compile what only other kernels call.

    Parameters
    ----------
    fuse : bool
        Round sums of products once instead of twice. Not for what treats the ends of the dimer by different expressions,
        which must agree exactly where they move alike.
    inline : bool
        Write the code into what calls it, however long: for what is called so often that passing its arrays counts.
        LLVM decides by itself where the kernel is compiled the plain way.
    """
    if function is None:
        return lambda wrapped: compiled(wrapped, fuse=fuse, inline=inline)
    # where it is not set, that of the first caller would hold
    return _compile(function, part=True, inline=inline, fastmath={"contract"} if fuse else False)
