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

from dimersweep.kernel.compiler.target import rounding, target

# of Numba: the least one that the package allows, and the last one that the fast way was tested with. The compiler of 0.61
# (LLVM 15) rounds otherwise than all those after it: last digits differ, and so do modes near a border.
OLDEST, NEWEST = (0, 62, 1), (0, 68)
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
BESIDE = ("claims", "cli", "exploring", "plots")  # rooms of the package that read cubes, and make none
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


@cache
def way() -> str:
    """How the kernel is compiled: FAST, PLAIN or, with the JIT off, PYTHON.

    Raises
    ------
    ImportError
        If Numba is too old, or DIMERSWEEP_COMPILER asks for what there is not.
    """
    import numba

    version: str = numba.__version__
    found = tuple(map(int, re.findall(r"\d+", version)[:3]))
    if found < OLDEST:
        raise ImportError(f"numba = {version}: must be >= {'.'.join(map(str, OLDEST))}")
    asked = os.environ.get("DIMERSWEEP_COMPILER") or (FAST if found[:2] <= NEWEST else PLAIN)
    if asked not in (FAST, PLAIN):
        raise ImportError(f"DIMERSWEEP_COMPILER = {asked}: must be {FAST} or {PLAIN}")
    config: Any = numba.config
    return PYTHON if config.DISABLE_JIT else asked


def compiler() -> dict[str, str]:
    """What makes machine code of the kernel, how, and how that rounds; imports Numba."""
    import llvmlite
    import numba
    import numpy as np

    config: Any = numba.config
    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = way()
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["rounding"] = rounding()
    return parts | {name: str(getattr(config, name, None)) for name in SETTINGS}


def _short(digest: bytes, **more: str) -> str:
    lines = "\n".join(f"{name} = {value}" for name, value in (compiler() | more).items())
    return hashlib.sha256(digest + lines.encode()).hexdigest()[:16]


def result_sources(package: Path) -> list[Path]:
    """The modules of the package that a number may come through on its way into a cube."""
    return [path for path in sources(package) if path.relative_to(package).parts[0] not in BESIDE]


@cache
def take_digests() -> tuple[bytes, bytes]:
    """Hashes of the kernel's sources, and of those of results; to be taken when these are imported: later, files may differ."""
    kernel, package = (Path(str(sys.modules[name].__file__)).parent for name in (KERNEL, __name__.partition(".")[0]))
    return sources_digest(kernel), sources_digest(package, result_sources(package))


@cache
def code_version() -> str:
    """Of compiled code: the kernel's sources and the compiler; 16 hexadecimal digits."""
    return _short(take_digests()[0], target=" ".join(target()))


@cache
def kernel_version() -> str:
    """Of results: what is compared between a sweep and its workers, or the one it goes on with; 16 hexadecimal digits."""
    return _short(take_digests()[1])
