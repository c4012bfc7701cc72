"""Former place of the numbers of an orbit, which are at the top of the package now."""

from dimersweep.faces import former

__getattr__ = former(__name__, "Orbit")
