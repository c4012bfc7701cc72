"""How the kernel is compiled: free of the GIL, strict about floating point, and kept for later processes.

There are two ways. The plain one is ``numba.njit``, which works with every Numba. The fast one takes a fifth of its time, by
what is private in Numba (``linking.py``), and may fail on any other Numba: then the plain way takes over in the same process.
"""

import functools
import linecache
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numba
from numba import types
from numba.extending import lower_builtin, lower_cast, typeof_impl

from dimersweep.kernel.compiler.cache import kept
from dimersweep.kernel.compiler.fusing import fused
from dimersweep.kernel.compiler.versions import code_version
from dimersweep.kernel.compiler.ways import FAST, PLAIN, PYTHON, asked_way, give_up, take, way

# no fastmath: it would break the ordering of events and the meaning of nan, and have each compiler round as it likes (see
# ``fusing.py``); error_model "numpy" spares a branch per division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
# no reference counts: nothing is allocated, and a part returns no array to code that counts
_SPARED: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True}
_njit: Any = numba.njit
# has an attribute for each setting that this Numba knows
_known: Any = getattr(getattr(_njit(lambda: None), "targetdescr", None), "options", None)
_changing = threading.Lock()
_OF_OTHERS = (MemoryError, TimeoutError, numba.TypingError)  # errors of the machine, of a signal, of a call


class Part:
    """A function that is compiled, in the way that is gone by the time when that is done, into those that call it: for Python
    nothing is made of it.
    """

    def __init__(self, function: Callable[..., Any], lines: Sequence[str] = (), **settings: Any) -> None:
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        self.py_func = function
        self._lines = lines  # of its file, where its sums of products are fused
        spared = {name: value for name, value in (_SPARED | settings).items() if hasattr(_known, name)}
        self._settings = _SETTINGS | spared
        self._made: dict[str, Any] = {}

    @property
    def dispatcher(self) -> Any:
        """What Numba has for this function."""
        chosen = way()
        if chosen not in self._made:
            self._made[chosen] = self._make(chosen)
        return self._made[chosen]

    def _make(self, chosen: str) -> Any:
        settings = self._settings
        if chosen == FAST:
            from dimersweep.kernel.compiler import linking

            settings = settings | {"pipeline_class": getattr(linking, f"{type(self).__name__}Compiler")}
        function = fused(self.py_func, self._lines) if self._lines else self.py_func
        return _without_literals(_njit(**settings)(function))

    def __call__(self, *_: Any) -> Any:
        raise TypeError(f"{self.py_func.__qualname__}: called by compiled code only")

    def __reduce__(self) -> str:
        return self.py_func.__qualname__


class Kernel(Part):
    """A function that Python calls."""

    def _make(self, chosen: str) -> Any:
        return kept(super()._make(chosen), code_version(chosen))

    def __call__(self, *given: Any) -> Any:
        """What the kernel returns.

        One that cannot be compiled the fast way is compiled the plain way, as all others from now on. Where that raises, too,
        the fault is in the call, the sources or the machine, and all is as before.
        """
        try:
            return self.dispatcher(*given)
        except Exception as error:  # while it is compiled: a kernel raises nothing
            if asked_way() or isinstance(error, _OF_OTHERS):
                raise
            with _changing:
                if way() == FAST:  # no other thread was here meanwhile
                    take(PLAIN)
                    try:
                        found = self.dispatcher(*given)
                    except BaseException as other:
                        take(FAST)
                        raise other from None
                    give_up(error)
                    return found
            return self.dispatcher(*given)


@typeof_impl.register(Part)
def _type_of(function: Part, _: Any) -> Any:
    """What compiled code takes a function for: what stands for it now."""
    return numba.typeof(function.dispatcher)


@lower_cast(types.NestedArray, types.Array)
def _as_plain(context: Any, builder: Any, nested: Any, array: Any, value: Any) -> Any:
    """An array within a record is held as any other."""
    return value


@lower_builtin("__array__", types.Array)
def _as_it_is(context: Any, builder: Any, signature: Any, given: Any) -> Any:
    """An array is one as it is: unless that is said, Numba looks through all that it knows at each access."""
    return given[0]


def _plain_type(kind: Any) -> Any:
    if isinstance(kind, types.NestedArray):
        return types.Array(kind.dtype, kind.ndim, "C")
    return types.unliteral(kind)


def _without_literals(function: Any) -> Any:
    """Have constants in calls typed as plain numbers, and arrays within records as plain arrays: else each of them compiles
    the function once more. A call is typed once.
    """
    typed = getattr(function, "get_call_template", None)
    if typed is None:  # Numba has changed
        return function

    once = functools.cache(lambda *args, **kws: typed(args, kws))
    function.get_call_template = lambda args, kws: once(
        *map(_plain_type, args), **{k: _plain_type(v) for k, v in kws.items()}
    )
    return function


def exported(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls."""
    return function if way() == PYTHON else Kernel(function)


def plain(function: Any) -> Any:
    """The Python function of a compiled one: what is only arithmetic takes arrays there."""
    return getattr(function, "py_func", function)


def compiled(function: Callable[..., Any] | None = None, *, fuse: bool = False, inline: bool = False) -> Any:
    """Compile what only other kernels call.

    Parameters
    ----------
    fuse : bool
        Round sums of products once instead of twice, by the rule of ``fusing.py``. Not for what treats the ends of the dimer
        by different expressions, which must agree exactly where they move alike.
    inline : bool
        Write the code into what calls it, however long: for what is called so often that passing its arrays counts.
    """
    if function is None:
        return functools.partial(compiled, fuse=fuse, inline=inline)
    lines = linecache.getlines(function.__code__.co_filename) if fuse else []  # as they are now: later they may differ
    if way() == PYTHON:
        return fused(function, lines) if fuse else function
    # where forceinline is not set, that of the first caller would hold
    return Part(function, lines, forceinline=inline, no_cpython_wrapper=True)
