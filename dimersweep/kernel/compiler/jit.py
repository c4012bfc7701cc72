"""How the kernel is compiled: free of the GIL, strict about floating point, and kept for later processes.

There are two ways. The plain one is ``numba.njit``, which works with every Numba. The fast one takes a quarter of its time,
by what is private in Numba. Numba makes machine code of every function on its own, and LLVM optimises what a function calls
once more with each of its callers. The fast way keeps the functions that only other kernels call as unoptimised parts
(``linking.py``); an exported kernel links all the parts it needs, and they are optimised and made machine code once, together.
What Numba does on the way that a kernel has no need of is left out (``compiling.py``).

The fast way is tried on any Numba. Where it raises, and the plain way does not, that takes over in the same process.
"""

import functools
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numba
from numba import types

from dimersweep.kernel.compiler.giving_up import give_up
from dimersweep.kernel.compiler.keeping import kept
from dimersweep.kernel.compiler.versions import FAST, PLAIN, asked_way, take, way

# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_njit: Any = numba.njit


@functools.cache
def _known_settings() -> Any:
    """What has an attribute for each setting that this Numba knows."""
    return getattr(getattr(_njit(_nothing), "targetdescr", None), "options", None)


def _nothing() -> None:
    pass


class _Function:
    """A function that is compiled: what Python has, and the dispatcher of Numba that stands for it."""

    def __init__(self, function: Callable[..., Any], part: bool, inline: bool, fuse: bool) -> None:
        self.function, self.part = function, part
        # no reference counts: nothing is allocated, and a part returns no array to code that counts
        spared: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True}
        if part:  # where forceinline is not set, that of the first caller would hold
            spared |= {"forceinline": inline}
        self._settings = _SETTINGS | {name: value for name, value in spared.items() if hasattr(_known_settings(), name)}
        self._settings["fastmath"] = {"contract"} if fuse else False
        self.dispatcher = self.made(way())

    def made(self, chosen: str) -> Any:
        """A dispatcher that compiles one of the two ways."""
        settings = self._settings
        if chosen == FAST:
            from dimersweep.kernel.compiler.compiling import fast_settings

            settings = settings | fast_settings(self.part)
        dispatcher = _without_literals(_njit(**settings)(self.function))
        return dispatcher if self.part else kept(dispatcher)


class _Kernel:
    """A kernel that Python calls, as long as it is compiled the fast way, which may have to be given up."""

    def __init__(self, made: _Function) -> None:
        self._made = made
        functools.update_wrapper(self, made.function)

    def __call__(self, *given: Any) -> Any:
        try:
            return self._made.dispatcher(*given)
        except MemoryError:
            raise
        except Exception as error:  # while it is compiled: a kernel raises nothing
            return _called_plainly(self._made, given, error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._made.dispatcher, name)

    def __reduce__(self) -> str:
        return self._made.function.__qualname__


_may_change: list[_Function] = []  # all that is compiled the fast way, unless that was asked for
_changing = threading.Lock()


def _called_plainly(made: _Function, given: Sequence[Any], error: Exception) -> Any:
    """What a kernel returns that cannot be compiled the fast way, compiled the plain way as all others from now on.

    Raises
    ------
    Exception
        If it cannot be compiled the plain way either: then the fault is in the call or the sources, and all is as before.
    """
    with _changing:
        if way() == FAST:  # no other thread was here meanwhile
            take(PLAIN)
            former = _exchange([each.made(PLAIN) for each in _may_change])
            try:
                found = made.dispatcher(*given)
            except BaseException as other:
                take(FAST)
                _exchange(former)
                raise other from None
            give_up(error)
            return found
    return made.dispatcher(*given)


def _exchange(dispatchers: Sequence[Any]) -> list[Any]:
    """Have other dispatchers stand for all functions, wherever these find each other; returns the former ones."""
    former = [made.dispatcher for made in _may_change]
    instead = {id(one): other for one, other in zip(former, dispatchers, strict=True)}
    for made, dispatcher in zip(_may_change, dispatchers, strict=True):
        made.dispatcher = dispatcher
        for cell in made.function.__closure__ or ():
            with suppress(ValueError):  # it is empty
                cell.cell_contents = instead.get(id(cell.cell_contents), cell.cell_contents)
    for names in {id(made.function.__globals__): made.function.__globals__ for made in _may_change}.values():
        names.update({name: instead[id(value)] for name, value in names.items() if id(value) in instead})
    return former


def _compile(function: Callable[..., Any], part: bool, inline: bool = False, fuse: bool = False) -> Any:
    made = _Function(function, part, inline, fuse)
    if way() != FAST or asked_way():
        return made.dispatcher
    _may_change.append(made)
    return made.dispatcher if part else _Kernel(made)


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
    return _compile(function, part=False)


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
    """
    if function is None:
        return lambda wrapped: compiled(wrapped, fuse=fuse, inline=inline)
    return _compile(function, part=True, inline=inline, fuse=fuse)
