"""Attractors: which motions there are, the share of starts that comes to each, and their picture."""
