"""The compiled core: the paper's model over flat arrays, importing numpy, numba and the standard library only."""

from dimersweep.kernel.cache import kernel_version, use_cache_folder

use_cache_folder()

__all__ = ["kernel_version"]
