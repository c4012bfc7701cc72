"""The slow program with another end of a chatter, as a program that has stored runs must have it."""

from . import body
from .simulate import Run


class Dropping(Run):
    """A run in which what is left of the gap rate of an end at rest is dropped: beta' stays as it is, without an impulse."""

    def collide(self) -> None:
        """Resolve an impact, and drop the gap rate of an end that rests afterwards."""
        super().collide()
        if len(self.resting) == 1:
            self.qdot[2] -= body.gap_rates(self.d, self.q, self.qdot)[min(self.resting)]
