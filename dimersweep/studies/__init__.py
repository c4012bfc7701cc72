"""What is asked of many runs: sweeps, searches, refined maps, and their declarations."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "declared")
