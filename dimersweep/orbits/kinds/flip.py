"""The flip: an orbit doubles its period."""

from dimersweep.orbits.ball import ball_flip
from dimersweep.orbits.kinds.kind import RealMultiplier

FLIP = RealMultiplier(
    name="flip",
    meaning="a multiplier is -1: a motion of twice the period begins",
    color="#d62728",
    marker="D",
    at=-1.0,
    doubles=True,
    ball=ball_flip,
)
