"""Borders: curves of folds, flips, tori and changes of word, one point for each value of other parameters.

A fold, a flip or a torus is solved for by bordering (Govaerts, doi 10.1137/1.9780898719543): the orbit closes, and a matrix
that is singular there has a bordered solution whose last entry is zero. The derivative of that entry is taken by differences
once; from one point of a curve to the next Broyden's update keeps it.
"""

from itertools import combinations
from typing import NamedTuple, cast

import numpy as np

from dimersweep.orbits.branch import Axis
from dimersweep.orbits.held import HeldMap
from dimersweep.orbits.return_map import Image, OrbitLost, ReturnMap, Tape
from dimersweep.orbits.solving import TOLERANCE, Fixed

STEPS = 14
SINGULAR = 3e-8  # last entry of the bordered solution that counts as none: what differences know
NEAR = 1e-4  # residual from which on derivatives are exact
STEP = 1e-3  # of the differences of that entry
LARGEST = 0.5  # step of Newton's method, in units of the section


class Frame(NamedTuple):
    """What is kept along a curve: the borders of the matrix, and the derivative of all equations."""

    left: np.ndarray
    right: np.ndarray
    derivative: np.ndarray


class OnBorder(NamedTuple):
    """A point of a border: the orbit, the parameter, and what the next point begins with."""

    fixed: Fixed
    value: float
    frame: Frame

    def y(self, axis: Axis) -> np.ndarray:
        """The section point and the parameter over its scale."""
        return np.append(self.fixed.z, self.value / axis.scale)


def compound(J: np.ndarray) -> np.ndarray:
    """Second compound matrix: its eigenvalues are the products of two eigenvalues."""
    pairs = np.array(list(combinations(range(len(J)), 2)))
    a, b = pairs[:, 0], pairs[:, 1]
    return J[np.ix_(a, a)] * J[np.ix_(b, b)] - J[np.ix_(a, b)] * J[np.ix_(b, a)]


def held(m: ReturnMap, parameters: dict[str, float], spin: float, tape: Tape) -> HeldMap:
    """The map that tells a border, in the section of another map."""
    return HeldMap(parameters, m.phase, m.modes, m.periods, m.rtol, tape, spin)


class Told(NamedTuple):
    """The image of a point, the derivatives of the map, whether they are exact, and what is singular on the border."""

    image: Image
    exact: bool
    matrix: np.ndarray
    gradient: np.ndarray
    singular: np.ndarray


def tell(kind: str, m: HeldMap, z: np.ndarray, near: float = 0.0) -> Told:
    """All that the equations of a border take at a point.

    Derivatives are exact where it closes to `near`. Else they are one-sided, which costs half as many periods.
    """
    image = m.image(z)
    exact = bool(np.abs(image.point - z).max() <= near)
    J, gradient = m.jacobian(z, None if exact else image)
    singular = {"fold": J - np.eye(len(J)), "flip": J + np.eye(len(J))}.get(kind)
    if singular is None:
        singular = compound(J) - np.eye(len(J) * (len(J) - 1) // 2)
    return Told(image, exact, J, gradient, singular)


def at_value(axis: Axis, m: HeldMap, value: float) -> HeldMap:
    """The map at a value of the parameter."""
    return cast(HeldMap, axis.map_at(m, value))


def slope_of(axis: Axis, m: HeldMap, z: np.ndarray, value: float) -> np.ndarray:
    """Derivative of the image by the parameter over its scale, by central differences."""
    ahead, back = (at_value(axis, m, value + by * m.step * axis.scale).image(z).point for by in (1, -1))
    return (ahead - back) / (2 * m.step)


def last_entry(M: np.ndarray, left: np.ndarray, right: np.ndarray) -> float:
    """Zero where M is singular: the last entry of the solution of [[M, left], [right, 0]] x = (0, 1)."""
    n = len(M)
    bordered = np.zeros((n + 1, n + 1))
    bordered[:n, :n], bordered[:n, n], bordered[n, :n] = M, left, right
    return float(np.linalg.solve(bordered, np.eye(n + 1)[n])[n])


def framed(kind: str, axis: Axis, m: HeldMap, z: np.ndarray, value: float) -> Frame:
    """Borders from the least singular value, and the derivative of all equations by differences."""
    here = tell(kind, m, z)
    U, _, V = np.linalg.svd(here.singular)
    left, right = U[:, -1], V[-1]
    base = last_entry(here.singular, left, right)

    def slope(m: HeldMap, z: np.ndarray) -> float:
        return (last_entry(tell(kind, m, z).singular, left, right) - base) / STEP

    row = [slope(m, z + d) for d in STEP * np.eye(z.size)]
    row.append(slope(at_value(axis, m, value + STEP * axis.scale), z))
    top = np.column_stack([here.matrix - np.eye(z.size), slope_of(axis, m, z, value)])
    return Frame(left, right, np.vstack([top, row]))


def on_border(kind: str, axis: Axis, m: HeldMap, y: np.ndarray, frame: Frame | None = None) -> OnBorder:
    """The point of a border near `y`, at the parameters of `m`.

    Parameters
    ----------
    kind : str
        fold, flip or torus.
    axis : Axis
        The parameter that is solved for.
    m : HeldMap
    y : ndarray, shape (n + 1,)
        Section point and parameter over its scale.
    frame : Frame, optional
        Of a point nearby.

    Raises
    ------
    OrbitLost
        If Newton's method does not come to one.
    """
    if frame is None:
        frame = framed(kind, axis, at_value(axis, m, y[-1] * axis.scale), y[:-1], y[-1] * axis.scale)
    A, old_r, taken = frame.derivative.copy(), None, None
    A[:-1, -1] = slope_of(axis, at_value(axis, m, y[-1] * axis.scale), y[:-1], y[-1] * axis.scale)
    best, exact = np.inf, False
    for _ in range(STEPS):
        value = y[-1] * axis.scale
        there = at_value(axis, m, value)
        told = tell(kind, there, y[:-1], NEAR)
        r = np.append(told.image.point - y[:-1], last_entry(told.singular, frame.left, frame.right))
        if taken is not None and told.exact == exact:  # else the change is also that of the derivatives
            A = A + np.outer(r - old_r - A @ taken, taken) / (taken @ taken)
        A[:-1, :-1] = told.matrix - np.eye(y.size - 1)
        if np.abs(r[:-1]).max() <= TOLERANCE * m.rtol and abs(r[-1]) <= SINGULAR:
            fixed = Fixed(there, y[:-1], told.image, told.matrix, told.gradient, float(np.abs(r[:-1]).max()))
            return OnBorder(fixed, value, Frame(frame.left, frame.right, A))
        best = min(best, np.abs(r).max())
        try:
            taken = -np.linalg.solve(A, r)
        except np.linalg.LinAlgError as error:
            raise OrbitLost(f"the equations of the {kind} are singular") from error
        if np.abs(taken).max() > LARGEST:
            raise OrbitLost(f"Newton's method for the {kind} goes too far")
        y, old_r, exact = y + taken, r, told.exact
    raise OrbitLost(f"Newton's method for the {kind} stays {best:.1e} away")
