"""Curves along which the orbit that runs come to ceases to be stable, each point found by itself."""

from collections.abc import Collection
from contextlib import suppress

from dimersweep.errors import OrbitError
from dimersweep.orbits.curve import Curve, Found
from dimersweep.orbits.finding import orbit_at
from dimersweep.orbits.kinds.stability import StabilityEnd
from dimersweep.orbits.labelling import Column
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost
from dimersweep.orbits.specials import Special
from dimersweep.orbits.stability_end import stability_end


class StabilityCurve(Curve, of=StabilityEnd):
    """An end of the stretch of the parameter over which an orbit is stable: see `Curve`."""

    kind: StabilityEnd
    alone = True

    def point(self, values: dict[str, float], near: list[Found], start: PeriodicOrbit | None) -> Found:
        spent, reasons = self.tape.periods, list[str]()
        given = self.given | values
        starts = self._starts(given, reasons)
        if start is not None:
            starts = iter([orbit_at(given, self.spin, guess=start, rtol=self.rtol)])
        lacking = "no stable orbit"
        for orbit in starts:
            begin = self._begun(orbit)
            if orbit.stable:
                lacking = "no end of stability"
            try:
                special = stability_end(self.axis, begin._replace(tangent=self.kind.sense * begin.tangent))
            except OrbitLost as reason:
                reasons.append(str(reason))
                continue
            found = self._found(special)
            return found._replace(loses=True, by=special.kind, cost=self.tape.periods - spent)
        raise OrbitError(f"{lacking} was found; {'; '.join(reasons)}")

    def _found(self, special: Special) -> Found:
        """The point of the end, with the spin put back where it is a bifurcation, as on curves of those."""
        if special.kind.rows:
            own = special.kind.curve(special.kind, self.parameter, special.point.map.parameters, self.spin, self.rtol)
            own.tape = self.tape
            with suppress(OrbitLost):
                return own.taken_up(special)
        return Found(orbit_of(special.point.fixed), special.point.value, special.point)

    def columns(self, found: Collection[Found]) -> dict[str, Column]:
        kinds = [one.by.name if one.by else "" for one in found]
        return {"ends_by": (kinds, "kind of border by which the stability ends")}
