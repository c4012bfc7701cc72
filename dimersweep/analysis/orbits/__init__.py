"""Orbits as objects: fixed points of the return map's fast part, their branches and borders, and the slow family they form.

Examples
--------
>>> from dimersweep import orbits
>>> orbit = orbits.find(Gamma=0.9, spin=100.0)  # the drift of that axial spin [rad/s]
>>> orbit.stable, round(orbit.radius, 3)
(True, 4.259)
"""

from dimersweep.analysis.orbits.borders.border_grid import border
from dimersweep.analysis.orbits.borders.plane_curve import border_curve
from dimersweep.analysis.orbits.continuation.following import follow
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.analysis.orbits.map.finding import find
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.slow.centre import centre_drift
from dimersweep.analysis.orbits.slow.families import family
from dimersweep.analysis.orbits.slow.fate import later
from dimersweep.analysis.orbits.slow.sustained import sustained

__all__ = [
    "BORDER_KINDS",
    "PeriodicOrbit",
    "border",
    "border_curve",
    "centre_drift",
    "family",
    "find",
    "follow",
    "later",
    "sustained",
]
