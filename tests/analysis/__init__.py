"""Tests of the analysis: orbits, borders, attractors, fits."""
