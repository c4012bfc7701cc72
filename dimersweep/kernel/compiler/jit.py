"""Compile the kernel: without the GIL, strict about floating point, and with its code saved for later processes.

There are two pipelines. The plain one is ``numba.njit``, which works with every Numba. The fast one takes a fifth of its
time, by private parts of Numba (``linking.py``), and may fail on any other Numba: then the plain one takes over in the
same process.
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
from dimersweep.kernel.compiler.pipelines import FAST, PLAIN, PYTHON, give_up, pipeline, requested_pipeline, take
from dimersweep.kernel.compiler.versions import code_version

# no fastmath: it would break the ordering of events and the meaning of nan, and let each compiler round as it likes
# (see ``fusing.py``); error_model "numpy" spares a branch for each division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
# settings of device functions: no reference counts, since nothing is allocated, and no array is returned to code that
# counts
_SPARED: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True}
_njit: Any = numba.njit
# object with an attribute for each setting that this Numba knows
_known: Any = getattr(getattr(_njit(lambda: None), "targetdescr", None), "options", None)
_changing = threading.Lock()
# errors for which the fast pipeline is not to blame, but the machine, a signal, or the call
_OF_OTHERS = (MemoryError, TimeoutError, numba.TypingError)


class Part:
    """A device function: compiled into its callers, without an entry point from Python.

    The pipeline is looked up at the first compilation.
    """

    def __init__(self, function: Callable[..., Any], lines: Sequence[str] = (), **settings: Any) -> None:
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        self.py_func = function
        self._lines = lines  # lines of its file, if its sums of products are fused; else none
        spared = {name: value for name, value in (_SPARED | settings).items() if hasattr(_known, name)}
        self._settings = _SETTINGS | spared
        self._made: dict[str, Any] = {}

    @property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function for the present pipeline, made at the first use."""
        chosen = pipeline()
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
    """A compiled function that Python calls."""

    def _make(self, chosen: str) -> Any:
        return kept(super()._make(chosen), code_version(chosen))

    def __call__(self, *given: Any) -> Any:
        """Call the kernel, and return its result.

        If the fast pipeline cannot compile it, the plain one does, as it does all other kernels from now on. If the
        plain one raises, too, the fault is in the call, the sources or the machine, and the fast pipeline stays.
        """
        try:
            return self.dispatcher(*given)
        except Exception as error:  # from compiling it: the kernel itself raises nothing
            if requested_pipeline() or isinstance(error, _OF_OTHERS):
                raise
            with _changing:
                if pipeline() == FAST:  # else another thread has changed it meanwhile
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
    """Return the type of a device function in compiled code: that of its dispatcher for the present pipeline."""
    return numba.typeof(function.dispatcher)


@lower_cast(types.NestedArray, types.Array)
def _as_plain(context: Any, builder: Any, nested: Any, array: Any, value: Any) -> Any:
    """Cast an array within a record to a plain array: its value stays as it is."""
    return value


@lower_builtin("__array__", types.Array)
def _as_it_is(context: Any, builder: Any, signature: Any, given: Any) -> Any:
    """Convert an array to an array by doing nothing: else Numba looks through all its conversions at each access."""
    return given[0]


def _plain_type(kind: Any) -> Any:
    """Return the plain type of an argument: a number's for a constant, an array's for an array within a record."""
    if isinstance(kind, types.NestedArray):
        return types.Array(kind.dtype, kind.ndim, "C")
    return types.unliteral(kind)


def _without_literals(function: Any) -> Any:
    """Make a function take constants in calls for plain numbers, and arrays within records for plain arrays.

    Otherwise each constant, and each such array, compiles the function once more. The type of each call is looked up
    once.
    """
    typed = getattr(function, "get_call_template", None)
    if typed is None:  # Numba has changed inside
        return function

    once = functools.cache(lambda *args, **kws: typed(args, kws))
    function.get_call_template = lambda args, kws: once(
        *map(_plain_type, args), **{k: _plain_type(v) for k, v in kws.items()}
    )
    return function


def exported(function: Callable[..., Any]) -> Any:
    """Compile a kernel that Python calls."""
    return function if pipeline() == PYTHON else Kernel(function)


def plain(function: Any) -> Any:
    """Return the Python function of a compiled one; if it is only arithmetic, it takes arrays, too."""
    return getattr(function, "py_func", function)


def compiled(function: Callable[..., Any] | None = None, *, fuse: bool = False, inline: bool = False) -> Any:
    """Compile a function that only other kernels call; a decorator, with or without options.

    Parameters
    ----------
    fuse : bool
        Round sums of products once instead of twice, by the rule of ``fusing.py``. Not for a function that has
        different expressions for the two ends of the dimer: these must agree exactly where the ends move alike.
    inline : bool
        Write the code into its callers, however long it is: for a function called so often that passing its arrays
        counts.
    """
    if function is None:
        return functools.partial(compiled, fuse=fuse, inline=inline)
    # the lines are read at once, since the file may be edited before the function is compiled
    lines = linecache.getlines(function.__code__.co_filename) if fuse else []
    if pipeline() == PYTHON:
        return fused(function, lines) if fuse else function
    # forceinline is set for all: without it, Numba takes the setting of the first caller
    return Part(function, lines, forceinline=inline, no_cpython_wrapper=True)
