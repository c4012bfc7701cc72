"""Curves of bifurcations: folds, flips, tori."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from dimersweep.orbits.branch import Point
from dimersweep.orbits.continuation import SEARCHING, steps
from dimersweep.orbits.curve import FollowedCurve, Found, crossings
from dimersweep.orbits.doubling import doubling
from dimersweep.orbits.kinds.kind import Bifurcation
from dimersweep.orbits.newton import fixed_at
from dimersweep.orbits.on_border import BorderEquations, OnBorder, next_on_border, on_border
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import OrbitLost, ReturnMap, singular_lost
from dimersweep.orbits.specials import Special, specials
from dimersweep.orbits.stability_end import stability_end

BACK = (0.0, 1e-3 * TURN, -1e-3 * TURN)  # phases of the plate at which the spin is put back [rad], as they are tried
DOUBLED_FOLD = "flip-doubled_fold"  # where the orbit of twice the period has its fold on the flip itself
KINK = 1e-2  # distance of all multipliers from the border's beyond which they are those of another map


class BifurcationCurve(FollowedCurve, of=Bifurcation):
    """A curve along which multipliers of the orbit have the value that its kind asks for: see `Curve`."""

    kind: Bifurcation

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        old: OnBorder = near[0].begin
        m = replace(old.map, parameters=given)
        for back in (m.back, *(other for other in BACK if other != m.back)):
            for u in (self.extrapolated(near), old.u):
                with suppress(OrbitLost):
                    return self.at(next_on_border(self.kind, self.axis, replace(m, back=back), old, u))
        raise OrbitLost(f"no {self.kind.name} is found from its neighbour")

    def _from(self, orbit: PeriodicOrbit) -> Found:
        """The first point of the border on the branch, to either side; one that ends stability goes before."""
        begin, reasons = self._begun(orbit), []
        ways = [begin._replace(tangent=sense * begin.tangent) for sense in self.kind.senses]
        if orbit.stable:
            for way in ways:
                with suppress(OrbitLost):
                    end = stability_end(self.axis, way)
                    if end.kind is self.kind:
                        return self.taken_up(end)
        for way in ways:
            try:
                return self.taken_up(self._met(way))
            except OrbitLost as reason:
                reasons.append(str(reason))
        raise OrbitLost(f"along {self.parameter}: {'; '.join(reasons)}")

    def _met(self, point: Point) -> Special:
        for a, b, _ in steps(self.axis, point, SEARCHING):
            for special in specials(self.axis, a, b, words=False)[0]:
                if special.kind is self.kind:
                    return special
        raise OrbitLost(f"none within {SEARCHING.tries} points of the branch")

    def taken_up(self, special: Special) -> Found:
        """The point of the border at a special point of a branch.

        At a fold the bouncer strikes about where the spin is put back; where it is just there, that is done beside it.
        """
        reason = OrbitLost("")
        for back in BACK:
            try:
                m = replace(special.point.map, spin=self.spin, back=back)
                return self.at(on_border(self.kind, self.axis, m, special.point.y(self.axis)))
            except OrbitLost as lost:
                reason = lost
        raise reason

    @singular_lost()
    def at(self, at: OnBorder) -> Found:
        """A point of the border, in a section that suits the next one."""

        def make(own: ReturnMap, z: np.ndarray) -> OnBorder:
            held = replace(own, spin=self.spin, back=at.map.back)
            return on_border(self.kind, self.axis, held, np.append(z, at.u[-1]))

        plain = replace(at.map, spin=None)
        image = plain.image(at.z)
        moved = plain.in_own_section(at, image.passage, make)
        if moved is not at:
            at, plain = moved, replace(moved.map, spin=None)
            image = plain.image(at.z)
        matrix, _ = at.map.jacobian(at.z)
        fast = np.linalg.eigvals(matrix).astype(complex)
        fast = fast[np.argsort(-np.abs(fast), kind="stable")][:-1]  # without that of the spin, which is put back
        orbit = orbit_of(fixed_at(plain, at.z, image, at.residual))
        if not fast.size or np.abs(self.kind.away(fast)).min() > KINK:
            raise OrbitLost(f"the map has a kink where a {self.kind.name} is looked for")
        orbit = replace(orbit, multipliers=fast, stable=bool((np.abs(fast) < 1).all()))
        found = Found(orbit, float(at.u[-1] * self.axis.scale), at, loses=self.kind.is_all(fast))
        if self.kind.doubles:
            with suppress(OrbitLost):
                return found._replace(doubling=doubling(at.map, at.z, matrix))
        return found

    def system(self, m: ReturnMap, near: Found) -> BorderEquations:
        return BorderEquations(self.kind, self.axis, m, near.begin.normal)

    def made(self, u: np.ndarray, extra: ReturnMap, near: Found) -> Found:
        return self.at(OnBorder(extra, u, near.begin.normal, None, 0.0))

    def tests(self, found: Found) -> dict[str, float]:
        return crossings(self.kind, found.orbit) | ({DOUBLED_FOLD: found.doubling} if self.kind.doubles else {})

    def is_sure(self, found: Found) -> bool:
        """Where a stable orbit loses its stability."""
        return found.loses
