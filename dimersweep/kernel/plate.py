"""The vibrating plate: effective gravity in the plate's own frame."""

from math import sin

from dimersweep.kernel.jit import compiled


@compiled
def effective_gravity(dm, phase):
    """g_e = g + z_p'' = g - A_z omega^2 sin(phase) [m s-2]."""
    return dm.g - dm.A_z * dm.omega * dm.omega * sin(phase)
