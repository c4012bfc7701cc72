"""Compiled functions of the tests, with their code kept as that of the kernel is."""

from numba import njit

from dimersweep.kernel.compiler.cache import kept
from dimersweep.kernel.compiler.versions import code_version
from dimersweep.kernel.compiler.ways import PYTHON, way


def compiled(function):
    """Compile a function."""
    made = njit(error_model="numpy")(function)
    return made if way() == PYTHON else kept(made, code_version(way()))
