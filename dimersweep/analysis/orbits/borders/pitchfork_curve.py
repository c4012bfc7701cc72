"""Curves of pitchforks: where a motion in a plane begins or ceases to attract motions with a spin.

All points of such a curve have spin 0. Beside the equations of the orbit, one more holds: a small spin does not grow.
"""

from dataclasses import replace
from functools import partial
from typing import ClassVar

import numpy as np

from dimersweep.analysis.orbits.borders.curve import Curve, Found
from dimersweep.analysis.orbits.continuation.branch import Equations, with_derivatives
from dimersweep.analysis.orbits.map.lost import first_found, require
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.passage import Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import Solution


class PitchforkCurve(Curve):
    """A curve along which a motion in a plane begins or ceases to attract motions with a spin: see `Curve`."""

    in_plane: ClassVar = True

    def _from(self, orbit: PeriodicOrbit) -> Found:
        ways = self._ways(orbit)
        self._check_smooth(ways[0])
        return self._found(first_found(partial(self._met, way) for way in ways).solution)

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        old: Solution = near[0].begin
        equations = self.system(replace(old.map, parameters=given | {self.parameter: old.value}), near[0])

        def found(u: np.ndarray) -> Found:
            return self._found(with_derivatives(equations.solved(u, equations.derivative)[0]))

        guesses = (self.extrapolated(near), old.y)
        return first_found((partial(found, u) for u in guesses), "no pitchfork is found from its neighbour")

    def _check_smooth(self, at: Solution) -> None:
        uneven = "an end slips through the turn of its slip: beside the plane the drift is not smooth"
        require(self.kind.holds(at), uneven)

    def _found(self, at: Solution) -> Found:
        self._check_smooth(at)
        return Found(orbit_of(at), at.value, at.settled(), loses=self.kind.is_all(at.multipliers))

    def system(self, m: ReturnMap, near: Found) -> Equations:
        at = near.begin
        return Equations(at.on_map(m), lambda _, m, passage: self.kind.mark(m, passage))

    def made(self, u: np.ndarray, extra: tuple[ReturnMap, Passage], near: Found) -> Found:
        return self._found(with_derivatives(self.system(extra[0], near).point(u, extra)))
