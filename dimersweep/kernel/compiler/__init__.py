"""The compiler of the kernel: two ways to compile with Numba, fused sums, and the cache of compiled code."""
