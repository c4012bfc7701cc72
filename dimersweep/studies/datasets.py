"""Former place of what makes their cubes, which are at the top of the package now."""

from dimersweep.faces import former

__getattr__ = former(__name__, "make")
