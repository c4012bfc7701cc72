"""Ends of stability as borders over other parameters: where an orbit ceases to be stable or to exist."""

from collections.abc import Collection, Iterator
from typing import ClassVar

from dimersweep.analysis.orbits.borders.bifurcation_curve import BifurcationCurve
from dimersweep.analysis.orbits.borders.curve import Curve, Found
from dimersweep.analysis.orbits.continuation.events import Event, on_its_border
from dimersweep.analysis.orbits.continuation.kinds import kind_words
from dimersweep.analysis.orbits.continuation.stability_end import stability_end
from dimersweep.analysis.orbits.map.finding import orbit_at
from dimersweep.analysis.orbits.map.lost import attempt
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.cubes.cube import Column
from dimersweep.parameters import value_of


class StabilityCurve(Curve):
    """A curve of least or greatest values of a parameter at which an orbit is stable, whatever ends it: see `Curve`."""

    alone: ClassVar = True

    def _starts(
        self, given: dict[str, float], start: PeriodicOrbit | None, reasons: list[str]
    ) -> Iterator[PeriodicOrbit]:
        """Yield the orbits from which a point is looked for; a given start is first carried to the point's parameters.

        Each point of such a curve is found by itself, and not from its neighbours.
        """
        if start is not None:
            there = given | {self.parameter: value_of(self.parameter, start.parameters)}
            start = orbit_at(there, start.spin if self.sustained else self.spin, guess=start, rtol=self.rtol)
        return super()._starts(given, start, reasons)

    def _lacking(self, stable: bool, reasons: list[str]) -> str:
        return f"no {'end of stability' if stable else 'stable orbit'} was found; {'; '.join(reasons)}"

    def _from(self, orbit: PeriodicOrbit) -> Found:
        (way,) = self._ways(orbit)
        event = stability_end(way)
        return self._found(event)._replace(loses=True, by=event.kind.name)

    def _found(self, event: Event) -> Found:
        """Return the point at an end of stability; at a bifurcation it has the spin put back, as its curve."""
        at = event.solution
        if event.kind.rows:
            given = (self.parameter, self.given, self.spin, self.rtol, self.recorder)
            own = BifurcationCurve(event.kind, *given, sustained=self.sustained)
            if found := attempt(own.taken_up, event):
                return found
        return Found(on_its_border(event.kind, orbit_of(at), self.sustained), at.value, at)

    def columns(self, found: Collection[Found]) -> list[Column]:
        ends = [one.by for one in found]
        return [
            *super().columns(found),
            Column("ends_by", "kind of border by which the stability ends", ends, kind_words()),
        ]
