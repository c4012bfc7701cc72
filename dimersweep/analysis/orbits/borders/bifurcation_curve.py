"""Curves of bifurcations: folds, flips, tori.

At a point of one the orbit closes, and the derivative J of its map has an eigenvector to a multiplier of the kind. At a fold
J v = v, at a flip J v = -v, at a torus J (v + i w) = exp(i angle) (v + i w) with an unknown angle (Kuznetsov, Elements of
Applied Bifurcation Theory, doi 10.1007/978-3-031-22007-4, section 10.3). Only the product of J with a vector is needed: a
difference of two images, whatever the number of coordinates. From one point of a curve to the next the equations change little.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.borders.curve import REACH, Curve, Found
from dimersweep.analysis.orbits.continuation.branch import Axis
from dimersweep.analysis.orbits.continuation.kinds import Bifurcation, change_of
from dimersweep.analysis.orbits.continuation.specials import Special, on_its_border
from dimersweep.analysis.orbits.continuation.stability_end import stability_end
from dimersweep.analysis.orbits.map.manifold import eigenvector
from dimersweep.analysis.orbits.map.newton import TOLERANCE, fixed_at, newton, target
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.poincare import TURN, OrbitLost, ReturnMap, first_found, singular_lost

SINGULAR = 3e-8  # residual of an eigenvector that counts as none: what differences know
BACK = (0.0, 1e-3 * TURN)  # phases of the plate at which the spin is put back [rad], as they are tried
DOUBLED_FOLD = "flip-doubled_fold"  # where the orbit of twice the period has its fold on the flip itself
KINK = 1e-2  # distance of all multipliers from the border's beyond which they are those of another map
# of the differences for the coefficient of a flip, in units of the section: those of the third order are right to about 1e-3
WIDTHS = (3e-3, 1e-3)
# part in which the coefficients of both widths differ at most; more where a change of sequence lies between
AGREE = 0.02


@dataclass(frozen=True, eq=False)
class OnBorder:
    """A point of a border, and what the next one begins with."""

    map: ReturnMap  # of the fast part alone
    # section point, rows of the eigenvector, what is not known of the multiplier, parameter over its scale
    y: np.ndarray
    normal: np.ndarray  # the eigenvector's product with it is 1, shape (n,)
    derivative: np.ndarray | None = None  # of the system by y, where it is still of use
    residual: float = 0.0  # how far the orbit fails to close, in units of the section
    matrix: np.ndarray | None = None  # J, shape (n, n)

    @property
    def z(self) -> np.ndarray:
        """Section point."""
        return self.y[: self.normal.size]

    @cached_property
    def doubling(self) -> float:
        """Of a flip, its coefficient, see `doubling`; NaN if the map cannot be taken beside the point."""
        assert self.matrix is not None
        with suppress(OrbitLost):
            return doubling(self.map, self.z, self.matrix)
        return float("nan")


def rotation(value: complex, rows: int) -> np.ndarray:
    """What J does to the rows of the eigenvector of a multiplier."""
    return np.array([[value.real, -value.imag], [value.imag, value.real]])[:rows, :rows]


class BorderEquations:
    """The equations of a border, near a point of it."""

    def __init__(self, kind: Bifurcation, axis: Axis, m: ReturnMap, normal: np.ndarray) -> None:
        self.kind, self.axis, self.m, self.normal = kind, axis, m, normal
        self.n, self.rows = normal.size, kind.rows
        self.weight = TOLERANCE * m.rtol / SINGULAR  # so that one target serves all equations

    def parts(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, ReturnMap]:
        """Section point, rows of the eigenvector, what is not known of the multiplier, and the map."""
        n, end = self.n, self.n * (1 + self.rows)
        return u[:n], u[n:end].reshape(self.rows, n), u[end:-1], self.axis.map_at(self.m, u[-1])

    def value(self, u: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
        """How far all equations fail to hold, and the map there."""
        z, V, unknown, m = self.parts(u)
        *along, here = m.images(np.array([*(z + m.step * V), *(z - m.step * V), z]))[:, : self.n]
        products = (np.array(along[: self.rows]) - along[self.rows :]) / (2 * m.step)
        turned = products - rotation(self.kind.multiplier(unknown), self.rows) @ V
        normal = V @ self.normal - np.eye(self.rows)[0]
        return np.concatenate([here - z, self.weight * turned.ravel(), normal]), m

    def derivative(self, u: np.ndarray, around: "Around | None" = None) -> np.ndarray:
        """Return the derivative of all equations by u; from what is around the point, if it is known."""
        z, V, unknown, m = self.parts(u)
        here, beside, J = Around.of(m, z) if around is None else around
        n, end, step, one = self.n, self.n * (1 + self.rows), m.step, np.eye(self.rows)
        moved, *moved_along = self.axis.map_at(m, u[-1] + step).images(np.array([z, *(z + step * V)]))[:, :n]
        places = z + step * np.eye(n)[:, None] + step * V  # from each neighbour along each row of the eigenvector
        along = m.images(np.array([*places.reshape(-1, n), *(z + step * V)]))[:, :n].reshape(n + 1, self.rows, n)
        bent = [*(along[:-1] - beside[:, None]), np.array(moved_along) - moved]
        A = np.zeros((u.size, u.size))
        A[:n, :n] = J - np.eye(n)
        A[:n, -1] = (moved - here) / step
        A[n:end, [*range(n), -1]] = (np.array(bent) - (along[-1] - here)).reshape(n + 1, -1).T / step**2
        A[n:end, n:end] = np.kron(one, J) - np.kron(rotation(self.kind.multiplier(unknown), self.rows), np.eye(n))
        if unknown.size:
            A[n:end, end] = -(rotation(self.kind.slope(unknown), self.rows) @ V).ravel()
        A[n:end] *= self.weight
        A[end : end + self.rows, n:end] = np.kron(one, self.normal)
        return A

    def solved(self, u: np.ndarray, derivative: np.ndarray | None) -> OnBorder:
        """The point of the border near a guess, from a derivative nearby; lost if Newton's method does not come to one."""

        def residual(there: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
            if np.abs(there - u)[[*range(self.n), -1]].max() > REACH:
                raise OrbitLost(f"Newton's method for the {self.kind.name} goes too far")
            return self.value(there)

        root = newton(residual, u, self.derivative, target(self.m, self.axis.spin is None), derivative)
        return OnBorder(root.extra, root.y, self.normal, root.derivative, float(np.abs(root.value[: self.n]).max()))


class Around(NamedTuple):
    """The images of a point and of those a step ahead along each coordinate, shape (n, n), and the derivative J of the map."""

    here: np.ndarray
    beside: np.ndarray
    J: np.ndarray

    @classmethod
    def of(cls, m: ReturnMap, z: np.ndarray) -> "Around":
        """That of a point; the derivative is to one side, which is enough for steps of Newton's method."""
        here, *beside = m.images(np.array([z, *(z + m.step * np.eye(z.size))]))[:, : z.size]
        return cls(here, np.array(beside), (np.array(beside) - here).T / m.step)


@singular_lost()
def on_border(kind: Bifurcation, axis: Axis, m: ReturnMap, y: np.ndarray) -> OnBorder:
    """The point of a border near an orbit, given by its section point and the parameter over its scale.

    It is lost if Newton's method does not come to one.
    """
    around = Around.of(axis.map_at(m, y[-1]), y[:-1])
    V, unknown = kind.begin(around.J)
    u = np.concatenate([y[:-1], V.ravel(), unknown, y[-1:]])
    system = BorderEquations(kind, axis, m, V[0] / (V[0] @ V[0]))
    return system.solved(u, system.derivative(u, around))


@singular_lost()
def doubling(m: ReturnMap, z: np.ndarray, matrix: np.ndarray) -> float:
    """The coefficient c of a flip: on its centre manifold the map is x -> -x + c x^3.

    With J v = -v, w J = -w, w v = 1 and the derivatives B and C of second and third order of the map it is

        c = w C(v, v, v)/6 + w B(v, (1 - J)^-1 B(v, v))/2

    (Kuznetsov, doi 10.1007/978-3-031-22007-4, section 5.4). Where c > 0 a stable orbit of twice the period begins beyond the
    flip, where c < 0 an unstable one ends there. NaN where contacts change so near that the map has no such derivatives; lost
    if the map cannot be taken beside the point. Of `m` all fixed points close, as of the map of the fast part alone; `z` is the
    fixed point at the flip, shape (n,), and `matrix` is J.
    """
    v, w = (eigenvector(J, -1) for J in (matrix, matrix.T))
    v = v / np.linalg.norm(v)
    w = w / (w @ v)
    wide, narrow = (_coefficient(m, z, matrix, v, w, width) for width in WIDTHS)
    return wide if abs(wide - narrow) < AGREE * (abs(wide) + abs(narrow)) else float("nan")


def _coefficient(m: ReturnMap, z: np.ndarray, matrix: np.ndarray, v: np.ndarray, w: np.ndarray, width: float) -> float:
    def at(*away: np.ndarray) -> np.ndarray:
        return m.images(z + width * np.array(away))[:, : z.size]

    far_back, back, here, ahead, far_ahead = at(-2 * v, -v, 0 * v, v, 2 * v)
    second = (ahead - 2 * here + back) / width**2
    third = (far_ahead - 2 * ahead + 2 * back - far_back) / (2 * width**3)
    bent = np.linalg.solve(np.eye(z.size) - matrix, second)
    size = np.linalg.norm(bent) or 1.0
    u = bent / size
    mixed = size * (np.array([1, -1, -1, 1]) @ at(v + u, v - u, u - v, -u - v)) / (4 * width**2)
    return float(w @ third / 6 + w @ mixed / 2)


class BifurcationCurve(Curve):
    """A curve along which multipliers of the orbit have the value that its kind asks for: see `Curve`."""

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        old: OnBorder = near[0].begin
        m = replace(old.map, parameters=given)
        for back in (m.back, *(other for other in BACK if other != m.back)):
            for u in (self.extrapolated(near), old.y)[: len(near)]:
                with suppress(OrbitLost):
                    return self.at(self.system(replace(m, back=back), near[0]).solved(u, old.derivative))
        raise OrbitLost(f"no {self.kind.name} is found from its neighbour")

    def between(self, a: Found, b: Found, part: float) -> Found:
        """With the unknowns on the line between both, if they are those of one section."""
        if not a.alike(b) or a.begin.y.size != b.begin.y.size:
            return a
        return a._replace(begin=replace(a.begin, y=a.begin.y + part * (b.begin.y - a.begin.y)))

    def _from(self, orbit: PeriodicOrbit) -> Found:
        """The first point of the border on the branch, to either side; one that ends stability goes before."""
        ways = self._ways(orbit)
        for way in ways if orbit.stable else ():
            with suppress(OrbitLost):
                if (end := stability_end(way)).kind is self.kind:
                    return self.taken_up(end)
        return first_found(partial(lambda way: self.taken_up(self._met(way)), way) for way in ways)

    def taken_up(self, special: Special) -> Found:
        """The point of the border at a special point of a branch.

        At a fold the bouncer strikes about where the spin is put back; where it is just there, that is done beside it.
        """

        def with_back(back: float) -> Found:
            m = replace(special.point.map, spin=self.axis.spin, back=back)
            return self.at(on_border(self.kind, self.axis, m, special.point.y))

        return first_found(partial(with_back, back) for back in BACK)

    @singular_lost()
    def at(self, at: OnBorder) -> Found:
        """A point of the border, in a section that suits the next one."""

        def make(own: ReturnMap, z: np.ndarray) -> OnBorder:
            same_spin = replace(own, spin=self.axis.spin, back=at.map.back)
            return on_border(self.kind, self.axis, same_spin, np.append(z, at.y[-1]))

        plain = replace(at.map, spin=None)
        image = plain.image(at.z)
        moved = plain.in_own_section(at, image.passage, make)
        if moved is not at:
            at, plain = moved, replace(moved.map, spin=None)
            image = plain.image(at.z)
        matrix, _ = at.map.jacobian(at.z)
        orbit = orbit_of(fixed_at(plain, at.z, image, at.residual))
        if not self.sustained:
            fast = np.linalg.eigvals(matrix).astype(complex)
            fast = fast[np.argsort(-np.abs(fast), kind="stable")][:-1]  # without that of the spin, which is put back
            orbit = replace(orbit, multipliers=fast)
        values = self.multipliers(orbit)
        if not values.size or np.abs(self.kind.away(values)).min() > KINK:
            raise OrbitLost(f"the map has a kink where a {self.kind.name} is looked for")
        value = float(at.y[-1] * self.axis.scale)
        orbit = on_its_border(self.kind, orbit, self.sustained)
        return Found(orbit, value, replace(at, matrix=matrix), loses=self.kind.is_all(values))

    def system(self, m: ReturnMap, near: Found) -> BorderEquations:
        return BorderEquations(self.kind, self.axis, m, near.begin.normal)

    def made(self, u: np.ndarray, extra: ReturnMap, near: Found) -> Found:
        return self.at(OnBorder(extra, u, near.begin.normal))

    def state(self, found: Found) -> str:
        return found.orbit.sequence

    def passed(self, before: str, after: str) -> str:
        return f"{self.kind.name}-{change_of(before, after).name}"

    def tests(self, found: Found) -> dict[str, float]:
        return super().tests(found) | ({DOUBLED_FOLD: found.begin.doubling} if self.kind.doubles else {})

    def is_sure(self, found: Found) -> bool:
        """Where a stable orbit loses its stability."""
        return found.loses
