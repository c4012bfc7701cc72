"""Curves of bifurcations: folds, flips, tori, pitchforks.

At a point of such a curve the orbit closes, and the derivative J of its map has an eigenvector to the multiplier of the
bifurcation. At a fold J v = v, at a flip J v = -v, at a torus J (v + i w) = exp(i angle) (v + i w) with an unknown
angle (Kuznetsov, Elements of Applied Bifurcation Theory, doi 10.1007/978-3-031-22007-4, section 10.3). Only products of
J with vectors are needed. Each product is a difference of two images, whatever the number of coordinates. From one
point of a curve to the next the equations change little: each point begins with the derivative of the last one.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import ClassVar

import numpy as np

from dimersweep.analysis.orbits.borders.curve import REACH, Curve, Found
from dimersweep.analysis.orbits.continuation.branch import Equations, with_derivatives
from dimersweep.analysis.orbits.continuation.events import Event, on_its_border
from dimersweep.analysis.orbits.continuation.kinds import Bifurcation, change_of
from dimersweep.analysis.orbits.continuation.stability_end import stability_end
from dimersweep.analysis.orbits.map.lost import attempt, first_found, require, singular_lost
from dimersweep.analysis.orbits.map.manifold import eigenvector
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.passage import TURN, Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import TOLERANCE, Axis, Solution, fixed_at, newton, target

# largest residual of the equation of an eigenvector that counts as zero: the products with J are differences over a
# step of rtol^(1/3), which for an rtol of 1e-12 are right to about 1e-8
SINGULAR = 3e-8
# phases of the plate at which the spin is put back [rad], in the order of trial: at a fold an end may strike just at 0
BACK = (0.0, 1e-3 * TURN)
DOUBLED_FOLD = "flip-doubled_fold"  # meeting at which the fold of the orbit of twice the period ends on the flip
# distance of the nearest multiplier from that of the border, beyond which the map has a kink between both
KINK = 1e-2
# widths of the differences for the coefficient of a flip, in units of the section: with them differences of the third
# order are right to about 1e-3
WIDTHS = (3e-3, 1e-3)
# greatest relative difference of the coefficients of both widths: more where a change of sequence lies between them
AGREE = 0.02


@dataclass(frozen=True, eq=False)
class OnBorder:
    """A point of a border, with the map, the unknowns and the derivative from which the next point is looked for.

    It is a type of its own, beside `Solution`, since the eigenvector is among its unknowns.
    """

    map: ReturnMap  # puts the spin back in each forcing period, unless the spin is free
    # section point, rows of the eigenvector, unknown of the multiplier (the angle at a torus), parameter over its scale
    y: np.ndarray
    normal: np.ndarray  # its product with the first row of the eigenvector is 1, with the second 0; shape (n,)
    derivative: np.ndarray | None = None  # of all equations by y; None where it is of no use to the next point
    residual: float = 0.0  # largest difference between the section point and its image, in units of the section
    matrix: np.ndarray | None = None  # derivative J of the map, shape (n, n)

    @property
    def z(self) -> np.ndarray:
        """Section point, shape (n,)."""
        return self.y[: self.normal.size]

    @cached_property
    def doubling(self) -> float:
        """Coefficient of a flip, see the function `doubling`; NaN if an image beside the point is not found."""
        found = attempt(doubling, self.map, self.z, self.matrix)
        return float("nan") if found is None else found


def rotation(value: complex, rows: int) -> np.ndarray:
    """Return the matrix that turns the rows of an eigenvector (real, imaginary part) as J does, shape (rows, rows)."""
    return np.array([[value.real, -value.imag], [value.imag, value.real]])[:rows, :rows]


class BorderEquations:
    """The equations of a bifurcation: the orbit closes, J multiplies the eigenvector, which is normalised.

    The product of the eigenvector with the vector `normal` is 1.
    """

    def __init__(self, kind: Bifurcation, axis: Axis, m: ReturnMap, normal: np.ndarray) -> None:
        self.kind, self.axis, self.m, self.normal = kind, axis, m, normal
        self.n, self.rows = normal.size, kind.rows
        # of the equations of the eigenvector: scales their residual so that one target serves all equations
        self.weight = TOLERANCE * m.rtol / SINGULAR

    def parts(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, ReturnMap]:
        """Split `u` into section point, rows of the eigenvector, and unknown of the multiplier; add the map there."""
        n, end = self.n, self.n * (1 + self.rows)
        return u[:n], u[n:end].reshape(self.rows, n), u[end:-1], self.axis.map_at(self.m, u[-1])

    def value(self, u: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
        """Return the residuals of all equations at the unknowns `u`, and the map there."""
        z, V, unknown, m = self.parts(u)
        *along, here = m.images(np.array([*(z + m.step * V), *(z - m.step * V), z]))[:, : self.n]
        products = (np.array(along[: self.rows]) - along[self.rows :]) / (2 * m.step)
        turned = products - rotation(self.kind.multiplier(unknown), self.rows) @ V
        normal = V @ self.normal - np.eye(self.rows)[0]
        return np.concatenate([here - z, self.weight * turned.ravel(), normal]), m

    def derivative(self, u: np.ndarray, seen: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """Return the derivative of all equations by `u`; what is `seen` around the section point is reused if given."""
        z, V, unknown, m = self.parts(u)
        here, beside, J = around(m, z) if seen is None else seen
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
        """Return the point of the border near the guess `u` by Newton's method, which begins with a derivative nearby.

        It goes no further than `REACH`.
        """

        def residual(there: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
            far = np.abs(there - u)[[*range(self.n), -1]].max()
            require(far <= REACH, f"Newton's method for the {self.kind.name} goes too far")
            return self.value(there)

        free = self.axis.spin is None
        u, m, left, latest = newton(residual, u, self.derivative, target(self.m, free), derivative)
        return OnBorder(m, u, self.normal, latest, float(np.abs(left[: self.n]).max()))


def around(m: ReturnMap, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the images of a point, shape (n,), and of its neighbours a step ahead along each coordinate, and J.

    The neighbours have a row each. J is taken to one side, which is enough for steps of Newton's method.
    """
    here, *beside = m.images(np.array([z, *(z + m.step * np.eye(z.size))]))[:, : z.size]
    return here, np.array(beside), (np.array(beside) - here).T / m.step


@singular_lost()
def on_border(kind: Bifurcation, axis: Axis, m: ReturnMap, y: np.ndarray) -> OnBorder:
    """Return the point of a border near an orbit, whose section point and parameter over its scale are in `y`."""
    seen = around(axis.map_at(m, y[-1]), y[:-1])
    V, unknown = kind.begin(seen[2])
    u = np.concatenate([y[:-1], V.ravel(), unknown, y[-1:]])
    system = BorderEquations(kind, axis, m, V[0] / (V[0] @ V[0]))
    return system.solved(u, system.derivative(u, seen))


@singular_lost()
def doubling(m: ReturnMap, z: np.ndarray, matrix: np.ndarray) -> float:
    """Compute the coefficient c of a flip: on its centre manifold the map is x -> -x + c x^3.

    With J v = -v, w J = -w, w v = 1 and the derivatives B and C of second and third order of the map it is

        c = w C(v, v, v)/6 + w B(v, (1 - J)^-1 B(v, v))/2

    (Kuznetsov, doi 10.1007/978-3-031-22007-4, section 5.4). Where c > 0 a stable orbit of twice the period begins
    beyond the flip, where c < 0 an unstable orbit of twice the period ends there.

    All fixed points of `m` must close, as those of the map of the fast part alone do. `z` is the fixed point at the
    flip, shape (n,), and `matrix` is J there. Return NaN where contacts change so near that the map has no such
    derivatives.
    """
    v, w = (eigenvector(J, -1) for J in (matrix, matrix.T))
    v = v / np.linalg.norm(v)
    w = w / (w @ v)
    wide, narrow = (_coefficient(m, z, matrix, v, w, width) for width in WIDTHS)
    return wide if abs(wide - narrow) < AGREE * (abs(wide) + abs(narrow)) else float("nan")


def _coefficient(m: ReturnMap, z: np.ndarray, matrix: np.ndarray, v: np.ndarray, w: np.ndarray, width: float) -> float:
    """Compute the coefficient of `doubling` from differences of one width; v and w are eigenvectors of J and J^T."""

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
    """A curve of folds, flips or tori: along it a multiplier of the orbit has the value of that kind. See `Curve`."""

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        old: OnBorder = near[0].begin
        m = replace(old.map, parameters=given)

        def found(back: float, u: np.ndarray) -> Found:
            return self.at(self.system(replace(m, back=back), near[0]).solved(u, old.derivative))

        backs = (m.back, *(other for other in BACK if other != m.back))
        guesses = (self.extrapolated(near), old.y)[: len(near)]
        ways = (partial(found, *each) for each in product(backs, guesses))
        return first_found(ways, f"no {self.kind.name} is found from its neighbour")

    def between(self, a: Found, b: Found, part: float) -> Found:
        """Return a neighbour of the point that lies a `part` of the way from `a` to `b`.

        Its unknowns lie on the line between both if these are in one section; else it is `a`.
        """
        if not a.alike(b) or a.begin.y.size != b.begin.y.size:
            return a
        return a._replace(begin=replace(a.begin, y=a.begin.y + part * (b.begin.y - a.begin.y)))

    def _from(self, orbit: PeriodicOrbit) -> Found:
        """Return the first point of the border met along the branch through an orbit, to either side.

        If the orbit is stable, a point at which its stability ends is preferred.
        """
        ways = self._ways(orbit)

        def at_end(way: Solution) -> Found:
            end = stability_end(way)
            require(end.kind is self.kind, "another kind ends the stability")
            return self.taken_up(end)

        def on_way(way: Solution) -> Found:
            return self.taken_up(self._met(way))

        tried = (at_end, on_way) if orbit.stable else (on_way,)
        return first_found(partial(each, way) for each in tried for way in ways)

    def taken_up(self, event: Event) -> Found:
        """Return the point of the border at a special point of a branch.

        At a fold the bouncer strikes at about the phase at which the spin is put back. If both coincide, the next phase
        of `BACK` is taken.
        """

        def with_back(back: float) -> Found:
            m = replace(event.solution.map, spin=self.axis.spin, back=back)
            return self.at(on_border(self.kind, self.axis, m, event.solution.y))

        return first_found(partial(with_back, back) for back in BACK)

    @singular_lost()
    def at(self, at: OnBorder) -> Found:
        """Return a point of the border in a section that suits the next point."""

        def make(own: ReturnMap, z: np.ndarray) -> OnBorder:
            same_spin = replace(own, spin=self.axis.spin, back=at.map.back)
            return on_border(self.kind, self.axis, same_spin, np.append(z, at.y[-1]))

        plain = replace(at.map, spin=None)
        passage = plain.passage(at.z)
        moved = plain.in_own_section(at, passage, make)
        if moved is not at:
            at, plain = moved, replace(moved.map, spin=None)
            passage = plain.passage(at.z)
        matrix, _ = at.map.jacobian(at.z)
        orbit = orbit_of(fixed_at(plain, at.z, passage, at.residual))
        if not self.sustained:
            fast = np.linalg.eigvals(matrix).astype(complex)
            # the last one is 0: that of the spin, which is put back
            fast = fast[np.argsort(-np.abs(fast), kind="stable")][:-1]
            orbit = replace(orbit, multipliers=fast)
        values = self.multipliers(orbit)
        smooth = values.size and np.abs(self.kind.away(values)).min() <= KINK
        require(smooth, f"the map has a kink where a {self.kind.name} is looked for")
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
        """Return True where a stable orbit loses its stability: a search along a branch prefers such a point, too."""
        return found.loses


class PitchforkCurve(Curve):
    """A curve along which a motion in a plane begins or ceases to attract motions with a spin: see `Curve`.

    All its points have spin 0. Beside the equations of the orbit, one more holds: a small spin does not grow.
    """

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
