"""The slow manifold: the points of motions whose spin drifts slowly along the family.

At a fixed point of the fast part the spin alone does not return to its value. This point depends on the section: in a
contact that slips, another coordinate takes up the change of the spin. A motion that drifts slowly lies beside the
fixed point, and moves along the manifold evenly. So the third difference of its points is the third derivative along
the manifold times the cube of the spin's change in a period. The points at which this difference is zero are the same
in all sections, to second order in the change (the zero-derivative principle of Gear, Kaper, Kevrekidis and Zagaris,
doi 10.1137/040608295).
"""

import numpy as np

from dimersweep.analysis.orbits.map.lost import attempt, singular_lost
from dimersweep.analysis.orbits.map.passage import Passage
from dimersweep.analysis.orbits.map.solution import (
    TOLERANCE,
    SlowMotion,
    Solution,
    multipliers_of,
    newton,
    slow_direction,
    slow_motion_at,
    solve,
)

# least distance of the multipliers of the fast part from 1: nearer, the fast part is as slow as the spin, and a slow
# manifold means nothing
APART = 0.05
NEAR = 0.05  # longest distance of a slow motion from its fixed point, in units of the section
SMALL_SPIN = 5e-3  # spin at which its growth beside a plane is measured, in the unit of the section
WEIGHTS = 8.0  # sum of the weights of the points in a third difference, 1 + 3 + 3 + 1: their errors add up


def eigenvector(matrix: np.ndarray, value: float) -> np.ndarray:
    """Return the real part of the eigenvector to the multiplier nearest to a value."""
    values, vectors = np.linalg.eig(matrix)
    return vectors[:, int(np.argmin(np.abs(values - value)))].real


@singular_lost()
def lag(fixed: Solution) -> np.ndarray:
    """Return the vector from the fixed point to the slow manifold at the same spin, shape (n,).

    The vector, in units of the section, is of first order in the drift of the spin. It is zero without a fast part,
    see `has_fast_part`, and where an entry would exceed `NEAR`: the first order does not reach so far.
    """
    m = fixed.map
    if not has_fast_part(fixed):
        return np.zeros(fixed.z.size)
    along, rate = slow_direction(fixed)
    fast = np.delete(np.arange(fixed.z.size), m.slow)
    away = np.zeros(fixed.z.size)
    J = fixed.matrix[np.ix_(fast, fast)]
    away[fast] = -np.linalg.solve(np.eye(fast.size) - J, along[fast] * rate / m.unit)
    return away if np.abs(away).max() <= NEAR else np.zeros(fixed.z.size)


def has_fast_part(fixed: Solution) -> bool:
    """Return True if there are multipliers beside the slow one, and all of them are away from 1."""
    fast, _ = multipliers_of(fixed)
    return bool(fast.size > 0 and np.abs(fast - 1).min() >= APART)


def growth_in_plane(fixed: Solution) -> tuple[float, bool]:
    """Return the growth of a small spin in a period beside a motion in a plane, and True if the drift is smooth there.

    The growth is the drift over the spin s, in the limit of no spin. The drift is odd in s. If it is smooth, the growth
    has even powers of s alone, which the growths at three spins show. It is not smooth where an end slips while its
    slip in the plane reverses. There friction turns round in a time proportional to s, which adds a part like s log s
    to the drift.
    """
    m, along = fixed.map, slow_direction(fixed)[0]

    def growth(share: float) -> float:
        spin = share * m.unit
        return slow_direction(solve(m, fixed.z + share * along, spin))[1] / spin

    first, second, third = (growth(times * SMALL_SPIN) for times in (1, 2, 4))
    return (4 * first - second) / 3, bool(abs(third - second - 4 * (second - first)) < TOLERANCE * m.rtol)


def slow_motion_of(fixed: Solution) -> SlowMotion:
    """Return the motion on the manifold at the spin of a fixed point.

    The fixed point itself is returned without a fast part, or where no motion on the manifold is found within `NEAR`.
    """
    if has_fast_part(fixed):
        slow_motion = attempt(lambda: slow_motion_near(fixed, fixed.z + lag(fixed), fixed.passage.spin))
        if slow_motion and np.abs(slow_motion.z - fixed.z).max() <= NEAR:
            return slow_motion
    return slow_motion_at(fixed)


def slow_motion_near(fixed: Solution, z: np.ndarray, spin: float) -> SlowMotion:
    """Find the motion on the manifold with a spin after the last impact [rad/s] that passes near a point `z`.

    The map and the derivatives are those of a fixed point nearby.
    """
    m = fixed.map

    def value(begin: np.ndarray) -> tuple[np.ndarray, list[Passage]]:
        images = m.chain(begin, 3)
        a, b, c = (passage.point for passage in images)
        r = c - 3 * b + 3 * a - begin
        r[m.slow] = (images[1].spin - spin) / m.unit
        return r, images

    def derivative(matrix: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        A = np.linalg.matrix_power(matrix - np.eye(len(matrix)), 3)
        A[m.slow] = gradient @ matrix
        return A

    begin = 2 * z - m.passage(z).point  # one period before `z`, at an even pace: `z` is the second of the points
    target, known = WEIGHTS * TOLERANCE * m.rtol, derivative(fixed.matrix, fixed.gradient)
    _, (before, here, after), left, _ = newton(value, begin, lambda z: derivative(*m.jacobian(z)), target, known)
    turn, next_turn = (one.theta - one.read.turned + two.read.turned for one, two in ((before, here), (here, after)))
    return SlowMotion(before.point, here, turn, after.spin - here.spin, next_turn - turn, float(np.abs(left).max()))
