"""Choose the pipeline that compiles the whole kernel: the fast one until it fails, the plain one, or none.

DIMERSWEEP_COMPILER chooses. Without it the fast pipeline is tried on any Numba. If it raises, and the plain pipeline
does not, the plain one takes over. A note of this is left beside the code of the fast one, so it holds for one version
of the kernel and of Numba.
"""

import os
import textwrap
from typing import Any

from dimersweep.kernel.compiler import cache, versions

FAST, PLAIN, PYTHON = "fast", "plain", "python"
NOTE = "fast-way-fails"  # name of the note in the cache of code

_taken: list[str] = []  # present pipeline of this process, once it is chosen


def pipeline() -> str:
    """Return the present pipeline, FAST, PLAIN or, with the JIT off, PYTHON; choose it at the first call."""
    return _taken[-1] if _taken else take(first_pipeline())


def take(chosen: str) -> str:
    """Set the pipeline from now on, and return it."""
    _taken[:] = [chosen]
    return chosen


def requested_pipeline() -> str | None:
    """Return the pipeline that DIMERSWEEP_COMPILER requests, or None; with the JIT off, PYTHON.

    Raises
    ------
    ImportError
        If DIMERSWEEP_COMPILER requests another one.
    """
    import numba

    asked = os.environ.get("DIMERSWEEP_COMPILER") or None
    if asked not in (FAST, PLAIN, None):
        raise ImportError(f"DIMERSWEEP_COMPILER = {asked}: must be {FAST} or {PLAIN}")
    config: Any = numba.config
    return PYTHON if config.DISABLE_JIT else asked


def first_pipeline() -> str:
    """Return the pipeline that a process begins with.

    It is the one requested, else the fast one or, with a warning, the plain one if a note says that the fast one fails.
    """
    if asked := requested_pipeline():
        return asked
    note = cache.load(versions.code_version(FAST), NOTE)
    if note:
        _tell(note.decode(errors="replace"))
    return PLAIN if note else FAST


def give_up(error: Exception) -> None:
    """Note for later processes that the fast pipeline fails with this error, and warn the user."""
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
    """Return True if compiled code of this version of the kernel is at hand or not needed: the next call is quick."""
    return pipeline() == PYTHON or bool(cache.files(versions.code_version(pipeline())))
