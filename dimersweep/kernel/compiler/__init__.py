"""The compiler of the kernel: two pipelines to compile with Numba, fused sums, and the cache of compiled code."""
