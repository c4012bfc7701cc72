"""The compiled core: the paper's model over flat arrays. It imports numpy, numba and the standard library only."""

from dimersweep.kernel.compiler.versions import kernel_version

__all__ = ["kernel_version"]
