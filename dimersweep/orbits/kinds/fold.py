"""The fold: two orbits meet and vanish."""

from dataclasses import dataclass

from dimersweep.orbits.ball import ball_fold
from dimersweep.orbits.branch import Point
from dimersweep.orbits.kinds.kind import RealMultiplier


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold(RealMultiplier):
    """A multiplier is 1, and the branch turns back in the parameter."""

    def test(self, point: Point) -> float:
        """The parameter's part in the tangent of the branch."""
        return float(point.tangent[-1])


FOLD = Fold(
    name="fold",
    meaning="a multiplier is 1: two orbits meet and vanish",
    color="#0072b2",
    marker="s",
    at=1.0,
    ball=ball_fold,
    senses=(-1.0, 1.0),
    shares=(0.05, 0.3, 0.6, 0.1, 0.2),
)
