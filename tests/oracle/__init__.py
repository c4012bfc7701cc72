"""Slow and independent implementation of the dimer, in the paper's own coordinates, to test the fast engine against."""

from .impact import impact, three_balls
from .simulate import simulate

__all__ = ["impact", "simulate", "three_balls"]
