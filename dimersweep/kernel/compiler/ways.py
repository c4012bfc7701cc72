"""The way that the kernel is compiled, the same for all of it: the fast one, until it fails; the plain one; or none.

DIMERSWEEP_COMPILER chooses. Without it the fast way is tried on any Numba. Where it raises, and the plain way does not, that
takes over, and a note of it is left beside the code of the fast way: so it holds for one version of the kernel and of Numba.
"""

import os
import re
import warnings
from typing import Any

from dimersweep.kernel.compiler import cache, versions

FAST, PLAIN, PYTHON = "fast", "plain", "python"
# the least Numba that the package allows. The compiler of 0.61 (LLVM 15) rounds otherwise than all those after it: last digits
# differ, and so do modes near a border.
OLDEST = (0, 62, 1)
NOTE = "fast-way-fails"
LONGEST = 200  # characters of an error that are told

_taken: list[str] = []  # the way that is gone


def way() -> str:
    """How the kernel is compiled: FAST, PLAIN or, with the JIT off, PYTHON.

    Raises
    ------
    ImportError
        See `asked_way`.
    """
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
        If Numba is too old, or DIMERSWEEP_COMPILER asks for what there is not.
    """
    import numba

    if tuple(map(int, re.findall(r"\d+", numba.__version__)[:3])) < OLDEST:
        raise ImportError(f"numba = {numba.__version__}: must be >= {'.'.join(map(str, OLDEST))}")
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
    text = " ".join(f"{type(error).__name__}: {error}".split())
    text = text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
    cache.save(versions.code_version(FAST), NOTE, text.encode())
    _tell(text)


def _tell(reason: str) -> None:
    import numba

    warnings.warn(
        f"numba {numba.__version__}: the fast way of compiling fails ({reason}); the kernel is compiled the plain way, which "
        "takes some minutes, once for each version",
        RuntimeWarning,
        stacklevel=2,
    )


def is_compiled() -> bool:
    """Whether compiled code of this version of the kernel is at hand, or none is needed, so that the next call is quick."""
    return way() == PYTHON or cache.holds(versions.code_version(way()))
