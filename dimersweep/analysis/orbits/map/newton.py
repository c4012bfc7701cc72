"""Newton's method, and the fixed points of the fast part at a given spin that it finds."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.poincare import Image, OrbitLost, ReturnMap

TOLERANCE = 10.0  # residual of an orbit over the rtol of the map
NEWTON_STEPS, QUICK_FALL = 25, 0.2  # Newton steps at most; a residual that falls by less asks for a new derivative
STEP_HALVINGS = 6  # tries to come nearer: a step, its half, its quarter ...
FAR = 1e-4  # value beyond which the accuracy of runs does not count
NEAR_ENOUGH = 1e3  # residual, over the target, of steps that come no nearer but are near enough


class Fixed(NamedTuple):
    """A fixed point of the fast part."""

    map: ReturnMap
    z: np.ndarray  # point of the section, the spin there included, shape (n,)
    image: Image
    matrix: np.ndarray  # derivative of the map, shape (n, n)
    gradient: np.ndarray  # of the spin after the last impact, in its unit, shape (n,)
    residual: float  # in units of the section


def defect(m: ReturnMap, z: np.ndarray, image: Image, spin: float | None) -> np.ndarray:
    """How far the fast part fails to close; in the place of the spin, how far it is from `spin` [rad/s], or closes if None."""
    r = image.point - z
    if spin is not None:
        r[m.slow] = (image.spin - spin) / m.unit
    return r


def system(m: ReturnMap, matrix: np.ndarray, gradient: np.ndarray, free: bool = False) -> np.ndarray:
    """Derivative of `defect` at a given spin, or where it is `free`."""
    A = matrix - np.eye(len(matrix))
    if not free:
        A[m.slow] = gradient
    return A


def target(m: ReturnMap, free: bool) -> float:
    """Largest entry of `defect` that counts as none: less where the spin is free, which drifts so little."""
    return m.rtol / TOLERANCE if free else TOLERANCE * m.rtol


class Root(NamedTuple):
    """A zero that Newton's method has found."""

    y: np.ndarray  # shape (n,)
    extra: Any  # what the function returned there beside its value
    value: np.ndarray  # of the function there, shape (n,)
    derivative: np.ndarray | None  # the last one that was used; none if no step was needed, shape (n, n)


def newton(
    f: Callable[[np.ndarray], tuple[np.ndarray, Any]],
    y: np.ndarray,
    derivative: Callable[[np.ndarray], np.ndarray] | None,
    target: float,
    known: np.ndarray | None = None,
    most: int = NEWTON_STEPS,
    loosely: Callable[[np.ndarray], tuple[np.ndarray, Any]] | None = None,
) -> Root:
    """A zero of `f` near `y`; lost if the steps do not come to one.

    A known derivative is kept by Broyden's update, and taken anew only where the steps then converge too slowly.

    Parameters
    ----------
    f : callable
        Returns its value, shape (n,), and an object that is kept of the last point.
    derivative : callable, optional
        Shape (n, n). Without it only the known one and its updates are used, which is enough where the steps are short: a
        step that does not come nearer at once is an error.
    target : float
        Largest entry of the value that counts as none.
    known : ndarray, shape (n, n), optional
        Derivative nearby.
    most : int
        How many new derivatives may be taken.
    loosely : callable, optional
        As `f`, from runs that are less accurate: it serves where the value is large.
    """

    def far(y: np.ndarray) -> tuple[np.ndarray, Any]:
        seen = (loosely or f)(y)
        return seen if loosely is None or np.abs(seen[0]).max() > FAR else f(y)

    r, extra = far(y) if known is None else f(y)
    A, fresh, size = known, False, np.abs(r).max()
    for _ in range(NEWTON_STEPS):
        if size <= target:
            return Root(y, extra, r, A)
        if A is None and derivative is not None:
            most -= 1
            if most < 0:
                raise OrbitLost("Newton's method asks for one derivative after the other")
            A, fresh = derivative(y), True
        assert A is not None
        try:
            see, step = far if size > FAR else f, -np.linalg.solve(A, r)
            y_next, r_next, extra_next = _nearer(see, y, step, size, STEP_HALVINGS if derivative else 1)
        except (np.linalg.LinAlgError, OrbitLost) as error:
            if size <= NEAR_ENOUGH * target:
                return Root(y, extra, r, A)  # as near as the rounding of the map allows
            if fresh or not derivative:
                raise OrbitLost(str(error)) from error
            A = None
            continue
        taken, size_next = y_next - y, np.abs(r_next).max()
        quick = size_next < QUICK_FALL * size
        A = A + np.outer(r_next - r - A @ taken, taken) / (taken @ taken) if quick or not derivative else None
        y, r, extra, fresh, size = y_next, r_next, extra_next, False, size_next
    raise OrbitLost(f"Newton's method stays {size:.1e} away")


def _nearer(
    f: Callable[[np.ndarray], tuple[np.ndarray, Any]], y: np.ndarray, step: np.ndarray, size: float, tries: int
) -> tuple[np.ndarray, np.ndarray, Any]:
    """The point after the step, or after the first of its halves, quarters ... that leads to a smaller value."""
    lost = OrbitLost("Newton's method finds no step that comes nearer")
    for _ in range(tries):
        try:
            r, extra = f(y + step)
            if np.abs(r).max() < size:
                return y + step, r, extra
        except OrbitLost as error:
            lost = error
        step = 0.5 * step
    raise lost


def fixed_at(m: ReturnMap, z: np.ndarray, image: Image | None = None, residual: float = 0.0) -> Fixed:
    """A fixed point with the derivatives there."""
    image = m.image(z) if image is None else image
    matrix, gradient = m.jacobian(z)
    return Fixed(m, z, image, matrix, gradient, residual)


def solve(m: ReturnMap, z: np.ndarray, spin: float | None, known: np.ndarray | None = None) -> Fixed:
    """The fixed point near a point, at a spin after the last impact of a period [rad/s]; lost if the steps do not come to one.

    Without a spin, that at which nothing drifts.

    A `known` derivative of `defect` nearby is what the steps begin with.
    """

    def value(z: np.ndarray, m: ReturnMap = m) -> tuple[np.ndarray, Image]:
        image = m.image(z)
        return defect(m, z, image, spin), image

    def derivative(z: np.ndarray) -> np.ndarray:
        return system(m, *m.jacobian(z, roughly=True), free)

    free = spin is None
    root = newton(value, z, derivative, target(m, free), known, loosely=partial(value, m=m.loosely))
    return fixed_at(m, root.y, root.extra, float(np.abs(root.value).max()))
