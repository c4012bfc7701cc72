"""The fast way of compiling, given up: it takes what is private in Numba, and a later version may have that no more.

A process learns it in two ways: by the import of what the fast way takes, or by a note that a process has left which saw
the fast way fail and the plain way work (``jit.py``). The note lies with the code of the fast way, so it holds for one version
of the kernel and of Numba.
"""

import warnings
from importlib import import_module

from dimersweep.kernel.compiler.cache import load, save
from dimersweep.kernel.compiler.versions import FAST, code_version

NOTE = "fast-way-fails"
LONGEST = 200  # characters of an error that are told


def is_known_to_fail() -> bool:
    """Whether the fast way cannot be had, or is noted to fail, before anything is compiled; a line says so."""
    reason = lack()
    if not reason:
        note = load(NOTE, code_version(FAST))
        reason = note.decode(errors="replace") if note else ""
    if reason:
        _tell(reason)
    return bool(reason)


def lack() -> str:
    """Why the fast way cannot be had, as it takes what this Numba has not; "" if nothing is missing."""
    try:
        import_module("dimersweep.kernel.compiler.compiling")
    except Exception as error:  # of a Numba that is not known yet
        return _words(error)
    return ""


def give_up(error: Exception) -> None:
    """Note for later processes that the fast way fails with this error, and say so."""
    save(NOTE, _words(error).encode(), code_version(FAST))
    _tell(_words(error))


def _words(error: Exception) -> str:
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def _tell(reason: str) -> None:
    import numba

    warnings.warn(
        f"numba {numba.__version__}: the fast way of compiling fails ({reason}); the kernel is compiled the plain way, which "
        "takes some minutes, once for each version",
        RuntimeWarning,
        stacklevel=2,
    )
