"""The vibrating plate: effective gravity in the plate's own frame."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.numerics.sincos import sincos


@compiled
def effective_gravity(dm, phase):
    """g_e = g + z_p'' = g - A_z omega^2 sin(phase) [m s-2]."""
    sine, _ = sincos(phase)
    return dm.g - dm.A_z * dm.omega * dm.omega * sine
