"""Newton's method, and the fixed points of the return map that it finds, with their multipliers and slow drift."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.lost import OrbitLost, require, singular_lost
from dimersweep.analysis.orbits.map.passage import Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap

TOLERANCE = 10.0  # largest residual of an orbit, over the rtol of the map, by which images are in error
# most steps of Newton's method; ratio of a residual to the one before above which the derivative is computed anew
NEWTON_STEPS, QUICK_FALL = 25, 0.2
STEP_HALVINGS = 6  # lengths that are tried for a step: all of it, its half, its quarter ...
# largest residual, over the target, that is accepted where no step comes nearer: there rounding bounds the accuracy
NEAR_ENOUGH = 1e3


class Fixed(NamedTuple):
    """A fixed point of the fast part of the return map at its spin, with the derivatives there."""

    map: ReturnMap
    z: np.ndarray  # point of the section, the spin there included, shape (n,)
    passage: Passage  # motion from `z` to its image
    matrix: np.ndarray  # derivative of the map, shape (n, n)
    gradient: np.ndarray  # derivative of the spin after the last impact, in its unit, shape (n,)
    residual: float  # largest entry of `defect`, in units of the section


class SlowMotion(NamedTuple):
    """A motion on the slow manifold, over a period."""

    z: np.ndarray  # point of the section, shape (n,)
    passage: Passage  # motion from that point to its image; its spin is the one asked for
    # change of theta over a period, from the last impact of the bouncer before `z` to its last impact before the image
    # [rad]
    turn: float
    drift: float  # change of the spin in the next period [rad/s]
    turn_drift: float  # change of the turn from this period to the next one [rad]
    residual: float  # largest error of the equations that it solves, in units of the section


def defect(m: ReturnMap, z: np.ndarray, image: Passage, spin: float | None) -> np.ndarray:
    """Return how far a point and its image are apart, in units of the section, shape (n,).

    The entry of the spin is the distance of the spin after the last impact from `spin` [rad/s]. If `spin` is None, the
    spin is free: its entry is its change, as for the other coordinates.
    """
    r = image.point - z
    if spin is not None:
        r[m.slow] = (image.spin - spin) / m.unit
    return r


def system(m: ReturnMap, matrix: np.ndarray, gradient: np.ndarray, free: bool = False) -> np.ndarray:
    """Return the derivative of `defect` by the point, shape (n, n), at a given spin or, with `free`, at a free one."""
    A = matrix - np.eye(len(matrix))
    if not free:
        A[m.slow] = gradient
    return A


def target(m: ReturnMap, free: bool) -> float:
    """Return the largest entry of `defect` that counts as zero.

    It is smaller where the spin is free: the drift changes little with the spin, so a small error of it moves the spin
    far.
    """
    return m.rtol / TOLERANCE if free else TOLERANCE * m.rtol


class Root(NamedTuple):
    """A zero that Newton's method has found."""

    y: np.ndarray  # zero, shape (n,)
    extra: Any  # object that the function returned there beside its value
    value: np.ndarray  # value of the function there, shape (n,)
    # derivative with which the next step would be taken, shape (n, n); None if it would be computed anew
    derivative: np.ndarray | None


def newton(
    f: Callable[[np.ndarray], tuple[np.ndarray, Any]],
    y: np.ndarray,
    derivative: Callable[[np.ndarray], np.ndarray] | None,
    target: float,
    known: np.ndarray | None = None,
    most: int = NEWTON_STEPS,
) -> Root:
    """Find a zero of `f` near `y`.

    A derivative is kept up to date by Broyden's formula, and computed anew only where the steps then converge too
    slowly.

    Parameters
    ----------
    f : callable
        Function; returns its value, shape (n,), and an object that is passed on with the zero.
    derivative : callable, optional
        Computes the derivative, shape (n, n). Without it only the known one and its updates are used, which is enough
        where the steps are short. The zero is then lost at the first step that comes no nearer.
    target : float
        Largest entry of the value that counts as zero.
    known : ndarray, shape (n, n), optional
        Derivative nearby.
    most : int
        Number of derivatives that may be computed anew.
    """
    r, extra = f(y)
    A, fresh, size = known, False, np.abs(r).max()
    for _ in range(NEWTON_STEPS):
        if size <= target:
            return Root(y, extra, r, A)
        if A is None and derivative is not None:
            most -= 1
            require(most >= 0, "Newton's method asks for one derivative after the other")
            A, fresh = derivative(y), True
        assert A is not None
        try:
            y_next, r_next, extra_next = _nearer(f, y, -np.linalg.solve(A, r), size, STEP_HALVINGS if derivative else 1)
        except (np.linalg.LinAlgError, OrbitLost) as error:
            if size <= NEAR_ENOUGH * target:
                return Root(y, extra, r, A)  # the rounding of the map allows no better
            require(derivative and not fresh, str(error))
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
    """Shorten a step by halves, in `tries` lengths, until its end has a smaller value than `size`.

    Return the end, its value and its object.
    """
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


def fixed_at(m: ReturnMap, z: np.ndarray, image: Passage | None = None, residual: float = 0.0) -> Fixed:
    """Return the fixed point `z` with its derivatives, and its image if that is not known, computed there."""
    image = m.passage(z) if image is None else image
    matrix, gradient = m.jacobian(z)
    return Fixed(m, z, image, matrix, gradient, residual)


def solve(m: ReturnMap, z: np.ndarray, spin: float | None, known: np.ndarray | None = None) -> Fixed:
    """Find the fixed point near `z` by Newton's method.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Point of the section.
    spin : float or None
        Spin after the last impact of a period [rad/s]. If it is None, the spin is free, and found such that it does not
        drift.
    known : ndarray, shape (n, n), optional
        Derivative of `defect` nearby, with which the steps begin.
    """

    def value(z: np.ndarray) -> tuple[np.ndarray, Passage]:
        image = m.passage(z)
        return defect(m, z, image, spin), image

    free = spin is None
    root = newton(value, z, lambda z: system(m, *m.jacobian(z), free), target(m, free), known)
    return fixed_at(m, root.y, root.extra, float(np.abs(root.value).max()))


@singular_lost()
def slow_direction(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Return the derivative of the point by the spin (in its unit) along the family, and the drift of the spin [rad/s].

    The drift is the change of the spin in a period of the motion. For it the change of the point over a period is
    projected with the left eigenvector of the slow multiplier, since only its part along the manifold counts. The left
    eigenvectors of all other multipliers, of which one is 1 at a fold, are across the family.
    """
    m = fixed.map
    along = np.linalg.solve(system(m, fixed.matrix, fixed.gradient), np.eye(fixed.z.size)[m.slow])
    row = max(np.linalg.eig(fixed.matrix.T)[1].real.T, key=lambda each: abs(each @ along))
    return along, float(row @ (fixed.passage.point - fixed.z) / (row @ along)) * m.unit


@singular_lost()
def multipliers_of(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Return the multipliers of the fast part, the largest first, and the multiplier of the slow direction.

    They are those over the period of the motion. The slow one is nearest to 1.
    """
    values = np.linalg.eigvals(fixed.matrix)
    slow = int(np.argmin(np.abs(values - 1)))
    fast = np.delete(values, slow).astype(complex)
    return fast[np.argsort(-np.abs(fast), kind="stable")], float(values[slow].real)


def slow_motion_at(fixed: Fixed) -> SlowMotion:
    """Return the fixed point as a motion on the manifold, with a turn proportional to its spin, as in rolling."""
    image, drift = fixed.passage, slow_direction(fixed)[1]
    turn_drift = image.theta * drift / image.spin if image.spin else 0.0
    return SlowMotion(fixed.z, image, image.theta, drift, turn_drift, fixed.residual)
