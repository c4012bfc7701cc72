"""What code and results are made of, as two hashes: one names the folder of compiled code, the other is compared.

Both hold the compiler and its settings. The first holds the sources of the kernel besides, and the processor that code is
made for. The second holds the sources of all modules that a number comes through on its way into a cube, and how code rounds.
"""

import hashlib
import platform
import sys
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

# code differs in its last digits where one processor rounds a product and a sum at once, and another one each by itself; all
# that have these instructions do the former, and run the code that is made for COMMON
COMMON = "x86-64-v3"  # Intel since 2013, AMD since 2015
INSTRUCTIONS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
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
    """Hashes of the kernel's sources, and of those that a number may come through on its way into a cube; to be taken when
    these are imported: later, files may differ.
    """
    kernel, package = (Path(str(sys.modules[name].__file__)).parent for name in (KERNEL, __name__.partition(".")[0]))
    return sources_digest(kernel), sources_digest(package, BESIDE)


def target(common: bool = True) -> tuple[str, str]:
    """Name and features of the processor that code is made for, as LLVM has them; imports Numba.

    `COMMON`, if it may be, where this processor has its instructions, and the user's settings of Numba ask for nothing else;
    or that for which Numba itself makes code.
    """
    import numba
    from llvmlite import binding

    config: Any = numba.config
    has = binding.get_host_cpu_features()
    asked = config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX
    if common and not asked and all(has.get(name) for name in INSTRUCTIONS):
        return COMMON, ""
    features = has.flatten() if config.CPU_FEATURES is None else str(config.CPU_FEATURES)
    return str(config.CPU_NAME or binding.get_host_cpu_name()), features


@cache
def _rounds_once(name: str, features: str) -> bool:
    """Whether code for an x86-64 processor rounds a product and a sum at once."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(cpu=name, features=features)
    code = """
        declare double @llvm.fma.f64(double, double, double)
        define double @f(double %a, double %b, double %c) {
            %d = call double @llvm.fma.f64(double %a, double %b, double %c)
            ret double %d
        }"""
    return "vfmadd" in machine.emit_assembly(binding.parse_assembly(code))


def rounding() -> str:
    """What the last digits depend on: `COMMON` for all processors that have its bits, else name and features of the target."""
    name, features = target()
    if platform.machine() in ("x86_64", "AMD64") and _rounds_once(name, features):
        return COMMON
    return f"{platform.machine()} {name} {features}"


def compiler(way: str) -> dict[str, str]:
    """What makes machine code of the kernel, how, and how that rounds; imports Numba."""
    import llvmlite
    import numba
    import numpy as np

    parts = {module.__name__: module.__version__ for module in (numba, llvmlite, np)}
    parts["way"] = way
    parts["python"] = f"{platform.python_implementation()} {platform.python_version()}"
    parts["rounding"] = rounding()
    return parts | {name: str(getattr(numba.config, name, None)) for name in SETTINGS}


def _short(digest: bytes, parts: dict[str, str]) -> str:
    lines = "\n".join(f"{name} = {value}" for name, value in parts.items())
    return hashlib.sha256(digest + lines.encode()).hexdigest()[:16]


@cache
def code_version(way: str) -> str:
    """Of code that is compiled this way: the kernel's sources and the compiler; 16 hexadecimal digits."""
    made_for = target(common=way != "plain")  # numba.njit makes code for what it finds
    return _short(take_digests()[0], compiler(way) | {"target": " ".join(made_for)})


@cache
def kernel_version(way: str) -> str:
    """Of results: the sources that they come through and the compiler; 16 hexadecimal digits."""
    return _short(take_digests()[1], compiler(way))
