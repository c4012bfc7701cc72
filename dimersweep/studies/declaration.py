"""Former place of what reads files of sweeps, which are at the top of the package now."""

from dimersweep.faces import former

__getattr__ = former(__name__, "read_declaration")
