"""The data: grids of points, their results, labelled cubes and what is read off them."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "findings")
