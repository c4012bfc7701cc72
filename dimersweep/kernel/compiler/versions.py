"""Versions of code and of results, as two hashes.

The version of code names the files of compiled code. It covers the sources of the kernel, the compiler with its
settings, and the processor that code is made for. The version of results is compared between workers, and with former
sweeps. It covers the sources of all modules that a number passes on its way into a cube, and nothing else. They say how
sums of products are rounded (``fusing.py``), and ``work.proving`` proves that the compiler and the processor keep to
it.
"""

import hashlib
import platform
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

# level of processors for which code is made, so that the nodes of a cluster share it: Intel since 2013, AMD since 2015
COMMON = "x86-64-v3"
INSTRUCTIONS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")  # instructions of that level
ARM = ("aarch64", "arm64")  # machines of which every processor has the instructions that matter, such as fma
# settings in numba.config that change the machine code
SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "ENABLE_AVX", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE", "USING_SVML")
BESIDE = ("cli", "exploring", "plots")  # rooms of the package that read cubes, and have no part in their numbers
KERNEL = Path(__file__).parents[1]


def sources(folder: Path, beside: Collection[str] = ()) -> list[Path]:
    """Return the Python sources below `folder`, in order, without those in the rooms `beside`."""
    return [path for path in sorted(folder.rglob("*.py")) if path.relative_to(folder).parts[0] not in beside]


def sources_digest(folder: Path, beside: Collection[str] = ()) -> bytes:
    """Return a hash of the sources below `folder`, with their paths, without those in the rooms `beside`."""
    digest = hashlib.sha256()
    for path in sources(folder, beside):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.digest()


@cache
def take_digests() -> tuple[bytes, bytes]:
    """Return hashes of the sources of the kernel, and of all modules that numbers pass on their way into a cube.

    They are to be taken before these modules are imported, since a file may be edited after that.
    """
    return sources_digest(KERNEL), sources_digest(KERNEL.parent, BESIDE)


def target(common: bool = True) -> tuple[str, str]:
    """Return the name and features of the processor that code is made for, in LLVM's words; import Numba.

    It is `COMMON`, or with ARM any processor, if `common` is set, this processor has the instructions, and the user's
    settings of Numba ask for nothing else. Otherwise it is the processor for which Numba itself makes code.
    """
    import numba
    from llvmlite import binding

    config: Any = numba.config
    has = binding.get_host_cpu_features()
    if common and config.CPU_NAME is None and config.CPU_FEATURES is None and config.ENABLE_AVX:
        if platform.machine() in ARM:
            return "generic", ""
        if all(has.get(name) for name in INSTRUCTIONS):
            return COMMON, ""
    features = has.flatten() if config.CPU_FEATURES is None else str(config.CPU_FEATURES)
    return str(config.CPU_NAME or binding.get_host_cpu_name()), features


def compiler(way: str) -> dict[str, str]:
    """Return versions, way, target and settings of the compiler of the kernel, by name; import Numba."""
    import llvmlite
    import numba
    import numpy as np

    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = way
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["target"] = " ".join(target(common=way != "plain"))  # numba.njit makes code for the processor it runs on
    return parts | {name: str(getattr(numba.config, name, None)) for name in SETTINGS}


@cache
def code_version(way: str) -> str:
    """Return the version of code compiled this way, by the kernel's sources and the compiler: 16 hexadecimal digits."""
    return hashlib.sha256(take_digests()[0] + str(compiler(way)).encode()).hexdigest()[:16]


def kernel_version() -> str:
    """Return the version of results, by all sources that their numbers pass: 16 hexadecimal digits."""
    return take_digests()[1].hex()[:16]
