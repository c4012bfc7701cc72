"""The slow manifold: where a motion is while its spin creeps along the family.

At a fixed point of the fast part the spin alone does not close. A motion that creeps lies beside it, by what the fast part
lags behind: it moves along the slow direction as a whole. What runs show, and their multipliers, are those there.
"""

import numpy as np

from dimersweep.orbits.return_map import Image, OrbitLost
from dimersweep.orbits.solving import TOLERANCE, Fixed, defect, fixed_at, newton, system

APART = 0.05  # distance of the multipliers of the fast part from 1 below which it is no slower than the spin
FARTHEST = 0.05  # of the manifold from the fixed point, in units of the section


def slow_direction(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Derivative of the section point by the spin (in its unit) along the family, and the spin's change a period [rad/s].

    What the map adds to a point is split by the left eigenvector of the slow multiplier: only the part along the manifold
    counts.
    """
    m = fixed.map
    values, left = np.linalg.eig(fixed.matrix.T)
    row = left[:, int(np.argmin(np.abs(values - 1)))].real
    along = np.linalg.solve(system(m, fixed.matrix, fixed.gradient), np.eye(len(values))[m.slow])
    return along, float(row @ (fixed.image.point - fixed.z) / (row @ along)) * m.unit


def multipliers_of(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Multipliers of the fast part, over the period of the motion, the largest first, and that of the slow direction."""
    values = np.linalg.eigvals(fixed.matrix)
    slow = int(np.argmin(np.abs(values - 1)))
    fast = np.delete(values, slow).astype(complex)
    return fast[np.argsort(-np.abs(fast), kind="stable")], float(values[slow].real)


def lag(fixed: Fixed) -> np.ndarray:
    """How far the manifold lies from the fixed point, to first order in the change of the spin; 0 where nothing is fast."""
    m = fixed.map
    if not has_fast_part(fixed):
        return np.zeros(fixed.z.size)
    along, rate = slow_direction(fixed)
    fast = np.delete(np.arange(fixed.z.size), m.slow)
    away = np.zeros(fixed.z.size)
    J = fixed.matrix[np.ix_(fast, fast)]
    away[fast] = -np.linalg.solve(np.eye(fast.size) - J, along[fast] * rate / m.unit)
    return away if np.abs(away).max() <= FARTHEST else np.zeros(fixed.z.size)


def has_fast_part(fixed: Fixed) -> bool:
    """Whether all multipliers but the slow one are away from 1."""
    fast, _ = multipliers_of(fixed)
    return bool(fast.size > 0 and np.abs(fast - 1).min() >= APART)


def on_manifold(fixed: Fixed) -> Fixed:
    """The point of the slow manifold at the spin of a fixed point; the fixed point itself where the fast part is not fast."""
    m = fixed.map
    if not has_fast_part(fixed):
        return fixed
    values, vectors = np.linalg.eig(fixed.matrix)
    v = vectors[:, int(np.argmin(np.abs(values - 1)))].real
    lean = v / v[m.slow]
    others = np.arange(fixed.z.size) != m.slow

    def value(z: np.ndarray) -> tuple[np.ndarray, Image]:
        image = m.image(z)
        r = defect(m, z, image, fixed.image.spin)
        r[others] -= (image.point - z)[m.slow] * lean[others]
        return r, image

    def derivative(matrix: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        A = system(m, matrix, gradient)
        creep = (matrix - np.eye(len(matrix)))[m.slow]
        A[others] -= np.outer(lean[others], creep)
        return A

    known = derivative(fixed.matrix, fixed.gradient)
    try:
        root = newton(value, fixed.z, lambda z: derivative(*m.jacobian(z)), TOLERANCE * m.rtol, known)
        if np.abs(root.y - fixed.z).max() > FARTHEST:
            return fixed
        return fixed_at(m, root.y, root.told, float(np.abs(root.value).max()))
    except OrbitLost:
        return fixed
