"""The ends of a stretch of a parameter over which the orbit that runs come to is stable."""

from dataclasses import dataclass

from dimersweep.orbits.kinds.kind import Kind


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityEnd(Kind):
    """Where a stable orbit ceases to be stable, or to be, whatever the kind of border there.

    Attributes
    ----------
    sense : float
        Of the parameter, in which the orbit is followed: 1 or -1.
    """

    sense: float


STABLE_FROM = StabilityEnd(
    name="stable_from",
    meaning="the least value to which the orbit that runs come to stays stable, whatever happens to it there",
    color="#56b4e9",
    marker="^",
    sense=-1.0,
)
STABLE_TO = StabilityEnd(
    name="stable_to",
    meaning="the greatest value to which the orbit that runs come to stays stable, whatever happens to it there",
    color="#56b4e9",
    marker="v",
    sense=1.0,
)
