"""The processor that the kernel is compiled for: one for all that have its instructions, so that all give the same bits.

Code differs in its last digits where one processor rounds a product and a sum at once, and another one each by itself. All
that have the instructions of `COMMON` do the former.
"""

import platform
from functools import cache
from typing import Any

COMMON = "x86-64-v3"  # Intel since 2013, AMD since 2015
INSTRUCTIONS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")


def target() -> tuple[str, str]:
    """Name and features of the processor that code is made for, as LLVM has them; imports Numba.

    `COMMON` where this processor has its instructions, and the user's settings of Numba ask for nothing else.
    """
    import numba
    from llvmlite import binding

    config: Any = numba.config
    has = binding.get_host_cpu_features()
    asked = config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX
    if not asked and all(has.get(name) for name in INSTRUCTIONS):
        return COMMON, ""
    return numba_target()


def numba_target() -> tuple[str, str]:
    """Name and features of the processor that Numba itself makes code for, as kernels that are compiled the plain way."""
    import numba
    from llvmlite import binding

    config: Any = numba.config
    features = binding.get_host_cpu_features().flatten() if config.CPU_FEATURES is None else str(config.CPU_FEATURES)
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
