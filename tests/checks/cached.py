"""Compiled functions of the tests, with their code kept as that of the kernel is."""

from numba import njit

from dimersweep.kernel.compiler.keeping import kept


def compiled(function):
    """Compile a function."""
    return kept(njit(error_model="numpy")(function))
