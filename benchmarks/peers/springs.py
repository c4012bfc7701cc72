"""Molecular dynamics: the dimer on stiff hysteretic Hertz springs (tests/limits), which tend to the impact law."""

from typing import NamedTuple

from tests.limits.hertz import contact_time, march
from tests.oracle.body import dimer

SPEED = 0.3  # approach speed of a double impact, for the duration of a contact [m/s]


class Spring(NamedTuple):
    """A stiffness [N m^-1.5] and how many time steps the time scale of a contact has."""

    stiffness: float
    steps: int

    def __str__(self):
        return f"k={self.stiffness:.0e} dt=tau/{self.steps}"


class Springs:
    """The springs at one stiffness and time step."""

    copies = 1

    def __init__(self, scene, spring):
        self.scene, self.stiffness = scene, spring.stiffness
        self.dt = contact_time(dimer(scene), spring.stiffness, SPEED) / spring.steps

    def follow(self, times):
        """States and times of double impacts."""
        return march(self.scene, times, self.stiffness, self.dt)

    def run(self, end):
        """One run that keeps its last state only."""
        march(self.scene, [end], self.stiffness, self.dt)
