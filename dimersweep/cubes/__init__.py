"""Hold the data: grids of points, their results, labelled cubes, and what is computed from cubes."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "findings")
