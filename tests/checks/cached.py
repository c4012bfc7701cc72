"""Compiled functions of the tests, with their code kept as that of the kernel is."""

from numba import njit

from dimersweep.kernel.compiler.cache import kept
from dimersweep.kernel.compiler.pipelines import PYTHON, pipeline
from dimersweep.kernel.compiler.versions import code_version


def compiled(function):
    """Compile a function."""
    made = njit(error_model="numpy")(function)
    return made if pipeline() == PYTHON else kept(made, code_version(pipeline()))
