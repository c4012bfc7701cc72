"""The compiler settings of the kernel: cached, free of the GIL, strict about floating point."""

import numba

# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
_SETTINGS = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

exported = numba.njit(**_SETTINGS)
# what only other compiled code calls goes without a wrapper for Python: a third of the compile time
compiled = numba.njit(no_cpython_wrapper=True, **_SETTINGS)
