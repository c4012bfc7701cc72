"""The one compiler setting of the kernel: cached, free of the GIL, and strict about floating point."""

import numba

# no fastmath: it would break the ordering of events and the meaning of nan; error_model "numpy" spares a branch
# per division (a kernel never raises)
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
