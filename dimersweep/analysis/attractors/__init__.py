"""Attractors: the motions that starts come to, the share of the starts of each, and their picture."""
