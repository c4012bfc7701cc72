"""Orbits as objects: fixed points of the return map's fast part, their branches and borders, and the slow family they form."""

from dimersweep.orbits.finding import find
from dimersweep.orbits.following import follow
from dimersweep.orbits.orbit import Orbit

__all__ = ["Orbit", "find", "follow"]
