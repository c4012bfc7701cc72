"""Coulomb's law at the one closed end: the force that keeps it closed, and how near it is to a jam, in the heading frame."""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import STICK


@compiled
def length(a, b):
    """Length of a vector whose square neither vanishes nor overflows, as none here does (``hypot`` takes ten times as long)."""
    return sqrt(a * a + b * b)


@compiled
def direction(a, b):
    """Cosine and sine of a slip's direction, 0 and 0 for none (no slip is so small that its square vanishes)."""
    v2 = a * a + b * b
    k = 1.0 / sqrt(v2) if v2 > 0.0 else 0.0
    return k * a, k * b


@compiled
def single_forces(dm, mode, w, u_a, u_b, n, a, b):
    """Normal, axial and lateral force at the one closed end with the slip (u_a, u_b), and its compliance, from the
    accelerations that its contact point has without them and its Delassus operator w; the normal force may come out negative.

    The compliance is the normal acceleration per normal force, with the friction that goes with it, in units of 1/m (one for
    an end that sticks). At zero the force is infinite, and below it presses the end into the plate the more, the greater it is.
    """
    if mode == STICK:
        det = w.nn * w.aa - w.na * w.na
        return (w.na * a - w.aa * n) / det, (w.na * n - w.nn * a) / det, -b / w.bb, 1.0
    c, s = direction(u_a, u_b)
    yields = w.nn - dm.mu * w.na * c
    F = -n / yields
    return F, -dm.mu * F * c, -dm.mu * F * s, yields * dm.m
