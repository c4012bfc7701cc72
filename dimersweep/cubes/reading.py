"""Former place of what is read off cubes, which are at the top of the package now."""

from dimersweep.faces import former

__getattr__ = former(
    __name__,
    "drift_intervals",
    "drift_lengths",
    "runs_of",
    "boundary",
    "exponents",
    "PowerLaw",
    "minimum",
    "Minimum",
    "circle_through",
    "stick_ratio",
)
