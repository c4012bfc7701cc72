"""Versions of code and of results, as two hashes.

The version of code names the files of compiled code. It covers the sources of the kernel, the compiler with its
settings, and the processor that code is made for. The version of results is compared between workers, and with former
sweeps. It covers the code that a number passes on its way into the result of a point (`POINT_CODE`), and nothing else:
neither comments, docstrings and blank lines, nor what stores, draws and reports results. Code says how sums of products
are rounded (``fusing.py``), and ``work.proving`` proves that the compiler and the processor keep to it.
"""

import hashlib
import platform
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

# level of processors for which code is made, so that the nodes of a cluster share it: Intel since 2013, AMD since 2015
COMMON = "x86-64-v3"
INSTRUCTIONS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")  # instructions of that level
ARM = ("aarch64", "arm64")  # machines of which every processor has the instructions that matter, such as fma
# settings in numba.config that change the machine code
SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "ENABLE_AVX", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE", "USING_SVML")
PACKAGE = Path(__file__).parents[2]
# folders and modules of the package that decide the results of points: the model; parameters to rows of the kernel, and
# points to parameters; runs, with what is observed of them; searches and refined maps, which choose their runs
POINT_CODE = (
    *("kernel", "symbols.py", "parameters.py", "cubes/grid.py", "cubes/results.py", "runs"),
    *(f"studies/{name}.py" for name in ("study", "search", "deciding", "refine", "observers", "observing")),
)
_TRIPLE = r'"""[^"\\]*(?:(?:\\.|"(?!""))[^"\\]*)*"""'
_COMMENT = r"\#[^\n]*"
# what is read of a source: a docstring, of which the colon before it is kept; another string, which is kept; or the
# spaces and the comment that end a line. Each begins with one of a few characters, so that the search is quick
_STRIPPED = re.compile(
    rf"""(:)[ ]*(?:{_COMMENT})?\s*\n(?:\s*{_COMMENT}\n)*\s*{_TRIPLE}(?=\s*(?:\#|\n|\Z))
    |({_TRIPLE} | '''.*?''' | "(?:[^"\\\n]|\\.)*" | '(?:[^'\\\n]|\\.)*')
    |(?:\s+(?:{_COMMENT})? | {_COMMENT})(?=\n|\Z)""".encode(),
    re.DOTALL | re.VERBOSE,
)


def sources(folder: Path) -> dict[str, bytes]:
    """Return the texts of the Python sources below a folder by their paths there, in order."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*.py"))}


def digest_of(texts: Mapping[str, bytes]) -> bytes:
    """Return a hash of texts with their paths."""
    return hashlib.sha256(b"".join(b"%b\0%b\0" % (path.encode(), text) for path, text in texts.items())).digest()


@cache
def take_sources() -> dict[str, bytes]:
    """Return the texts of all sources of the package, by their paths in it.

    They are to be taken before these modules are imported, since a file may be edited after that.
    """
    return sources(PACKAGE)


def bare(source: bytes) -> bytes:
    """Return a source without its comments, docstrings and blank lines."""
    # a module's docstring stands behind no colon: it gets one, too
    return _STRIPPED.sub(lambda read: read[1] or read[2] or b"", b":\n" + source)


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


def compiler(pipeline: str) -> dict[str, str]:
    """Return versions, pipeline, target and settings of the compiler of the kernel, by name; import Numba."""
    import llvmlite
    import numba
    import numpy as np

    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = pipeline
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["target"] = " ".join(target(common=pipeline != "plain"))  # numba.njit makes code for the processor it runs on
    return parts | {name: str(getattr(numba.config, name, None)) for name in SETTINGS}


@cache
def code_version(pipeline: str) -> str:
    """Return the version of code from a pipeline, by the kernel's sources and the compiler: 16 hexadecimal digits."""
    kernel = {path: text for path, text in take_sources().items() if path.startswith("kernel/")}
    return hashlib.sha256(digest_of(kernel) + str(compiler(pipeline)).encode()).hexdigest()[:16]


@cache
def kernel_version(*more: str) -> str:
    """Return the version of results, by the code that their numbers pass: 16 hexadecimal digits.

    The code is that of `POINT_CODE` and of `more` folders and modules of the package. All versions of Python have the same.
    """
    places = tuple(place if place.endswith(".py") else f"{place}/" for place in (*POINT_CODE, *more))
    passed = {path: bare(text) for path, text in take_sources().items() if path.startswith(places)}
    return digest_of(passed).hex()[:16]
