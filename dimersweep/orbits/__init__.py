"""Orbits as objects: fixed points of the return map's fast part, their branches and borders, and the slow family they form.

Examples
--------
>>> from dimersweep import orbits
>>> orbit = orbits.find(Gamma=0.9, spin=100.0)  # the drift of that axial spin [rad/s]
>>> orbit.stable, round(orbit.radius, 3)
(True, 4.259)
"""

from importlib import import_module

from dimersweep.orbits.border_grid import border
from dimersweep.orbits.centre import centre_drift
from dimersweep.orbits.edges import Edge, edge
from dimersweep.orbits.families import family
from dimersweep.orbits.fate import later
from dimersweep.orbits.finding import find
from dimersweep.orbits.following import follow
from dimersweep.orbits.kinds import BORDER_KINDS
from dimersweep.orbits.orbit import PeriodicOrbit
from dimersweep.orbits.plane_curve import border_curve
from dimersweep.orbits.sustained import sustained
from dimersweep.runs.accessor import DRAW_TABLE

__all__ = [
    "BORDER_KINDS",
    "Edge",
    "PeriodicOrbit",
    "border",
    "border_curve",
    "centre_drift",
    "edge",
    "family",
    "find",
    "follow",
    "later",
    "sustained",
]

# matplotlib is loaded with the first picture
DRAW_TABLE.append(lambda *table, **look: import_module("dimersweep.orbits.pictures").draw_borders(*table, **look))
