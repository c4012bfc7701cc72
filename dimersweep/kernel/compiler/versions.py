"""What code and results are made of, as two hashes: one names the folder of compiled code, the other is compared.

Both hold the compiler and its settings. The first holds the sources of the kernel besides, and the processor that code is
made for. The second holds the sources of all modules that a number comes through on its way into a cube, and how code rounds.
"""

import hashlib
import os
import platform
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from dimersweep.kernel.compiler.target import numba_target, rounding, target

# the least Numba that the package allows. The compiler of 0.61 (LLVM 15) rounds otherwise than all those after it: last digits
# differ, and so do modes near a border.
OLDEST = (0, 62, 1)
FAST, PLAIN, PYTHON = "fast", "plain", "python"
# of numba.config: those that change what machine code is made
SETTINGS = (
    "BOUNDSCHECK",
    "DEBUGINFO_DEFAULT",
    "DISABLE_INTEL_SVML",
    "DISABLE_JIT",
    "ENABLE_AVX",
    "LOOP_VECTORIZE",
    "OPT",
    "SLP_VECTORIZE",
    "USING_SVML",
)
BESIDE = ("cli", "exploring", "plots")  # rooms of the package that read cubes, and make none
KERNEL = __name__.rpartition(".kernel.")[0] + ".kernel"


def sources(folder: Path) -> Iterator[Path]:
    """The Python sources below `folder`, in order."""
    return (path for path in sorted(folder.rglob("*.py")) if path.is_file())


def sources_digest(folder: Path, files: Iterable[Path] | None = None) -> bytes:
    """Hash of source files below `folder`, by default all of them, with their paths in it."""
    digest = hashlib.sha256()
    for path in sources(folder) if files is None else files:
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.digest()


def way() -> str:
    """How the kernel is compiled: FAST, PLAIN or, with the JIT off, PYTHON.

    DIMERSWEEP_COMPILER chooses. Without it the fast way is taken, until it fails where the plain way works (``giving_up.py``).
    """
    return _taken[-1] if _taken else take(first_way())


def take(chosen: str) -> str:
    """Compile this way from now on; returns it."""
    _taken[:] = [chosen]
    return chosen


_taken: list[str] = []  # the way that is gone


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
    """The way that a process begins with.

    Raises
    ------
    ImportError
        See `asked_way`; or if the fast way is asked for, and this Numba lacks what it takes.
    """
    from dimersweep.kernel.compiler import giving_up

    asked = asked_way()
    if asked == FAST and (lack := giving_up.lack()):
        raise ImportError(f"DIMERSWEEP_COMPILER = {FAST}: cannot be had ({lack})")
    return asked or (PLAIN if giving_up.is_known_to_fail() else FAST)


def compiler(chosen: str | None = None) -> dict[str, str]:
    """What makes machine code of the kernel, how, and how that rounds; imports Numba."""
    import llvmlite
    import numba
    import numpy as np

    config: Any = numba.config
    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = chosen or way()
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["rounding"] = rounding()
    return parts | {name: str(getattr(config, name, None)) for name in SETTINGS}


def _short(digest: bytes, chosen: str, **more: str) -> str:
    lines = "\n".join(f"{name} = {value}" for name, value in (compiler(chosen) | more).items())
    return hashlib.sha256(digest + lines.encode()).hexdigest()[:16]


def result_sources(package: Path) -> list[Path]:
    """The modules of the package that a number may come through on its way into a cube."""
    return [path for path in sources(package) if path.relative_to(package).parts[0] not in BESIDE]


@cache
def take_digests() -> tuple[bytes, bytes]:
    """Hashes of the kernel's sources, and of those of results; to be taken when these are imported: later, files may differ."""
    kernel, package = (Path(str(sys.modules[name].__file__)).parent for name in (KERNEL, __name__.partition(".")[0]))
    return sources_digest(kernel), sources_digest(package, result_sources(package))


def code_version(chosen: str | None = None) -> str:
    """Of code that is compiled this way: the kernel's sources and the compiler; 16 hexadecimal digits."""
    return _code_version(chosen or way())


def kernel_version() -> str:
    """Of results: what is compared between a sweep and its workers, or the one it goes on with; 16 hexadecimal digits."""
    return _kernel_version(way())


@cache
def _code_version(chosen: str) -> str:
    made_for = numba_target() if chosen == PLAIN else target()
    return _short(take_digests()[0], chosen, target=" ".join(made_for))


@cache
def _kernel_version(chosen: str) -> str:
    return _short(take_digests()[1], chosen)
