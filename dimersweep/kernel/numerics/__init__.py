"""Numerical tools that know nothing of the dimer."""
