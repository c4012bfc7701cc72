"""Borders of a ball that bounces on a shaking plate once a period: a good guess for a dimer whose end hops."""

from math import hypot, pi


def ball_fold(e: float) -> float:
    """Return the least Gamma at which a ball can bounce once a period: pi (1 - e)/(1 + e)."""
    return pi * (1 - e) / (1 + e)


def ball_flip(e: float) -> float:
    """Return the Gamma at which a ball that bounces once a period doubles its period."""
    return hypot(ball_fold(e), 2 * (1 + e**2) / (1 + e) ** 2)
