"""The way that the kernel is compiled, the same for all of it: the fast one, until it fails; the plain one; or none.

DIMERSWEEP_COMPILER chooses. Without it the fast way is tried on any Numba. Where it raises, and the plain way does not, that
takes over, and a note of it is left beside the code of the fast way: so it holds for one version of the kernel and of Numba.
"""

import os
import textwrap
from typing import Any

from dimersweep.kernel.compiler import cache, versions

FAST, PLAIN, PYTHON = "fast", "plain", "python"
NOTE = "fast-way-fails"

_taken: list[str] = []  # the way that is gone


def way() -> str:
    """How the kernel is compiled: FAST, PLAIN or, with the JIT off, PYTHON."""
    return _taken[-1] if _taken else take(first_way())


def take(chosen: str) -> str:
    """Compile this way from now on; returns it."""
    _taken[:] = [chosen]
    return chosen


def asked_way() -> str | None:
    """What DIMERSWEEP_COMPILER asks for, PYTHON with the JIT off, or None.

    Raises
    ------
    ImportError
        If DIMERSWEEP_COMPILER asks for what there is not.
    """
    import numba

    asked = os.environ.get("DIMERSWEEP_COMPILER") or None
    if asked not in (FAST, PLAIN, None):
        raise ImportError(f"DIMERSWEEP_COMPILER = {asked}: must be {FAST} or {PLAIN}")
    config: Any = numba.config
    return PYTHON if config.DISABLE_JIT else asked


def first_way() -> str:
    """The way that a process begins with; a line says so where the fast one is known to fail."""
    if asked := asked_way():
        return asked
    note = cache.load(versions.code_version(FAST), NOTE)
    if note:
        _tell(note.decode(errors="replace"))
    return PLAIN if note else FAST


def give_up(error: Exception) -> None:
    """Note for later processes that the fast way fails with this error, and say so."""
    text = textwrap.shorten(f"{type(error).__name__}: {error}", width=200, placeholder="...")
    cache.save(versions.code_version(FAST), NOTE, text.encode())
    _tell(text)


def _tell(reason: str) -> None:
    import numba

    cache.warn(
        f"numba {numba.__version__}: the fast way of compiling fails ({reason}); the kernel is compiled the plain way, which "
        "takes some minutes, once for each version"
    )


def is_compiled() -> bool:
    """Whether compiled code of this version of the kernel is at hand, or none is needed, so that the next call is quick."""
    return way() == PYTHON or bool(cache.files(versions.code_version(way())))
