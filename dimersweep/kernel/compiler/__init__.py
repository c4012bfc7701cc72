"""What is done to Numba, and where compiled code is kept."""
