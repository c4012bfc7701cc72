"""What code and results are made of, as two hashes: one names the folder of compiled code, the other is compared.

The first holds the sources of the kernel, the compiler with its settings, and the processor that code is made for. The second
holds the sources of all modules that a number comes through on its way into a cube, and nothing else: how sums of products are
rounded stands in them (``fusing.py``), and that a compiler and a processor do so is proven (``work.proving``).
"""

import hashlib
import platform
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

# code is made for a processor that many others are, so that the nodes of a cluster share it
COMMON = "x86-64-v3"  # Intel since 2013, AMD since 2015
INSTRUCTIONS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
ARM = ("aarch64", "arm64")  # machines whose least processor has all that counts
# of numba.config: those that change what machine code is made
SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "ENABLE_AVX", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE", "USING_SVML")
BESIDE = ("cli", "exploring", "plots")  # rooms of the package that read cubes, and make none
KERNEL = Path(__file__).parents[1]


def sources(folder: Path, beside: Collection[str] = ()) -> list[Path]:
    """The Python sources below `folder`, in order, but for those in the rooms `beside`."""
    return [path for path in sorted(folder.rglob("*.py")) if path.relative_to(folder).parts[0] not in beside]


def sources_digest(folder: Path, beside: Collection[str] = ()) -> bytes:
    """Hash of these sources, with their paths in it."""
    digest = hashlib.sha256()
    for path in sources(folder, beside):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.digest()


@cache
def take_digests() -> tuple[bytes, bytes]:
    """Hashes of the sources of the kernel, and of all that cubes come through, to be taken before these are imported."""
    return sources_digest(KERNEL), sources_digest(KERNEL.parent, BESIDE)


def target(common: bool = True) -> tuple[str, str]:
    """Name and features of the processor that code is made for, as LLVM has them; imports Numba.

    `COMMON`, or any with arm64, if it may be, where this processor has the instructions, and the user's settings of Numba ask
    for nothing else; or that for which Numba itself makes code.
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
    """Return what makes machine code of the kernel, how, and for what; imports Numba."""
    import llvmlite
    import numba
    import numpy as np

    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = way
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["target"] = " ".join(target(common=way != "plain"))  # numba.njit makes code for what it finds
    return parts | {name: str(getattr(numba.config, name, None)) for name in SETTINGS}


@cache
def code_version(way: str) -> str:
    """Return the version of code that is compiled this way, by the kernel's sources and the compiler; 16 hexadecimal digits."""
    return hashlib.sha256(take_digests()[0] + str(compiler(way)).encode()).hexdigest()[:16]


def kernel_version() -> str:
    """Return the version that results are compared by, with those of workers and of former sweeps; 16 hexadecimal digits."""
    return take_digests()[1].hex()[:16]
