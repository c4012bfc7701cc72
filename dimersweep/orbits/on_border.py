"""A point of a bifurcation: the orbit closes, and the derivative J of its map has an eigenvector to a multiplier of the kind.

At a fold J v = v, at a flip J v = -v, at a torus J (v + i w) = exp(i angle) (v + i w) with an unknown angle (Kuznetsov,
Elements of Applied Bifurcation Theory, doi 10.1007/978-3-031-22007-4, section 10.3). Only the product of J with a vector is
needed: a difference of two images, whatever the number of coordinates. From one point of a curve to the next the equations
change little.
"""

from typing import NamedTuple

import numpy as np

from dimersweep.orbits.branch import Axis
from dimersweep.orbits.kinds.kind import Bifurcation
from dimersweep.orbits.newton import TOLERANCE, newton
from dimersweep.orbits.poincare import OrbitLost, ReturnMap, singular_lost

SINGULAR = 3e-8  # residual of an eigenvector that counts as none: what differences know
GUESS_REACH = 0.5  # distance from the first guess, in units of the section


class OnBorder(NamedTuple):
    """A point of a border, and what the next one begins with.

    Attributes
    ----------
    map : ReturnMap
        Of the fast part alone.
    u : ndarray
        Section point, rows of the eigenvector, what is not known of the multiplier, parameter over its scale.
    normal : ndarray, shape (n,)
        The eigenvector's product with it is 1.
    derivative : ndarray, optional
        Of the system by u, where it is still of use.
    residual : float
        How far the orbit fails to close, in units of the section.
    """

    map: ReturnMap
    u: np.ndarray
    normal: np.ndarray
    derivative: np.ndarray | None
    residual: float

    def y(self, _: Axis) -> np.ndarray:
        """All that is solved for, the parameter over its scale last."""
        return self.u

    @property
    def z(self) -> np.ndarray:
        """Section point."""
        return self.u[: self.normal.size]


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
        m = self.axis.map_at(self.m, u[-1] * self.axis.scale)
        return u[:n], u[n:end].reshape(self.rows, n), u[end:-1], m

    def value(self, u: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
        """How far all equations fail to hold, and the map there."""
        z, V, unknown, m = self.parts(u)
        products = [(m.image(z + m.step * v).point - m.image(z - m.step * v).point) / (2 * m.step) for v in V]
        turned = np.array(products) - rotation(self.kind.multiplier(unknown), self.rows) @ V
        normal = V @ self.normal - np.eye(self.rows)[0]
        return np.concatenate([m.image(z).point - z, self.weight * turned.ravel(), normal]), m

    def derivative(self, u: np.ndarray, around: "Around | None" = None) -> np.ndarray:
        """Of all equations by u; from the images around the point, if they are known."""
        z, V, unknown, m = self.parts(u)
        around = images_around(m, z) if around is None else around
        J, n, step = around.jacobian(), self.n, m.step
        value = u[-1] * self.axis.scale
        ahead, back = (self.axis.map_at(m, value + by * step * self.axis.scale) for by in (1, -1))
        here, moved = m.image(z).point, ahead.image(z).point
        A = np.zeros((u.size, u.size))
        A[:n, :n] = J - np.eye(n)
        A[:n, -1] = (moved - back.image(z).point) / (2 * step)
        for k, v in enumerate(V):
            rows = slice(n * (1 + k), n * (2 + k))
            along = m.image(z + step * v).point - here
            for i, d in enumerate(step * np.eye(n)):
                A[rows, i] = (m.image(z + d + step * v).point - around.ahead[i] - along) / step**2
            A[rows, -1] = (ahead.image(z + step * v).point - moved - along) / step**2
            A[rows, rows] = J
            A[n * (1 + self.rows) + k, rows] = self.normal
        A[n : n * (1 + self.rows), n : n * (1 + self.rows)] -= np.kron(
            rotation(self.kind.multiplier(unknown), self.rows), np.eye(n)
        )
        if unknown.size:
            A[n : 3 * n, 3 * n] = -(rotation(self.kind.slope(unknown), self.rows) @ V).ravel()
        A[n : n * (1 + self.rows)] *= self.weight
        return A


class Around(NamedTuple):
    """Images of the points a step ahead and back along each coordinate, shape (n, n)."""

    ahead: np.ndarray
    back: np.ndarray
    step: float

    def jacobian(self) -> np.ndarray:
        """Derivative of the map."""
        return (self.ahead - self.back).T / (2 * self.step)


def images_around(m: ReturnMap, z: np.ndarray) -> Around:
    """The images from which the derivative at a point is taken."""
    steps = m.step * np.eye(z.size)
    ahead, back = (np.array([m.image(z + by * d).point for d in steps]) for by in (1, -1))
    return Around(ahead, back, m.step)


@singular_lost()
def on_border(kind: Bifurcation, axis: Axis, m: ReturnMap, y: np.ndarray) -> OnBorder:
    """The point of a border near an orbit.

    Parameters
    ----------
    kind : Bifurcation
    axis : Axis
        The parameter that is solved for.
    m : ReturnMap
        At the other parameters.
    y : ndarray, shape (n + 1,)
        Section point and parameter over its scale.

    Raises
    ------
    OrbitLost
        If Newton's method does not come to one.
    """
    z, there = y[:-1], axis.map_at(m, y[-1] * axis.scale)
    around = images_around(there, z)
    V, unknown = kind.begin(around.jacobian())
    normal = V[0] / (V[0] @ V[0])
    u = np.concatenate([z, V.ravel(), unknown, y[-1:]])
    system = BorderEquations(kind, axis, m, normal)
    return _solved(system, u, system.derivative(u, around))


def next_on_border(kind: Bifurcation, axis: Axis, m: ReturnMap, near: OnBorder, u: np.ndarray) -> OnBorder:
    """The point of a border near a guess `u`, from the derivative at a neighbour in the same section.

    Raises
    ------
    OrbitLost
        If Newton's method does not come to one.
    """
    return _solved(BorderEquations(kind, axis, m, near.normal), u, near.derivative)


def _solved(system: BorderEquations, u: np.ndarray, derivative: np.ndarray | None) -> OnBorder:
    n = system.n

    def residual(there: np.ndarray) -> tuple[np.ndarray, ReturnMap]:
        if np.abs(there - u)[[*range(n), -1]].max() > GUESS_REACH:
            raise OrbitLost(f"Newton's method for the {system.kind.name} goes too far")
        return system.value(there)

    root = newton(residual, u, system.derivative, TOLERANCE * system.m.rtol, derivative)
    return OnBorder(root.extra, root.y, system.normal, root.derivative, float(np.abs(root.value[:n]).max()))
