"""Studies of many runs: sweeps, searches, refined maps and loops, and the files that declare them."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "declared")
