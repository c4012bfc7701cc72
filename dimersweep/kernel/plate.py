"""The vibrating plate: effective gravity and displacement in the plate's own frame."""

from math import cos, sin

from dimersweep.kernel.jit import compiled


@compiled
def effective_gravity(dm, phase):
    """g_e = g + z_p'' = g - A_z omega^2 sin(phase) [m s-2]."""
    return dm.g - dm.A_z * dm.omega * dm.omega * sin(phase)


@compiled
def plate_height(dm, phase):
    """z_p = A_z sin(phase) [m]."""
    return dm.A_z * sin(phase)


@compiled
def plate_speed(dm, phase):
    """z_p' = A_z omega cos(phase) [m s-1]."""
    return dm.A_z * dm.omega * cos(phase)
