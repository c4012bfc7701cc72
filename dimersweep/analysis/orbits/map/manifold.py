"""The slow manifold: where a motion is while its spin drifts slowly along the family.

At a fixed point of the fast part the spin alone does not close. Which point that is depends on the section: in a contact
that slips, another coordinate takes up what the spin has lost. A motion that drifts slowly lies beside it, and moves along the
manifold evenly. So the third difference of its points is the third derivative along the manifold times the cube of the
spin's change in a period: where it is zero is the same in all sections, to second order in that change (the
zero-derivative principle of Gear, Kaper, Kevrekidis and Zagaris, doi 10.1137/040608295).
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.newton import TOLERANCE, Fixed, newton, solve, system
from dimersweep.analysis.orbits.map.poincare import Image, OrbitLost, ReturnMap, singular_lost

APART = 0.05  # distance of the multipliers of the fast part from 1 below which it is no slower than the spin
NEAR = 0.05  # of the manifold from the fixed point, in units of the section
SMALL_SPIN = 5e-3  # at which it is seen how a spin grows beside a plane, in the unit of the section
WEIGHTS = 8.0  # of the points in a third difference, all together: the rounding of each counts so often


class SlowMotion(NamedTuple):
    """A motion on the slow manifold."""

    z: np.ndarray  # point of the section, shape (n,)
    image: Image  # of that point; its spin is the one asked for
    turn: float  # change of theta from the last impact of the bouncer to that in the image [rad]
    drift: float  # change of the spin in the period that follows [rad/s]
    turn_drift: float  # change of the turn from that period to the one that follows [rad]
    residual: float  # in units of the section


def eigenvector(matrix: np.ndarray, value: float) -> np.ndarray:
    """The eigenvector, real part, of the multiplier nearest to a value."""
    values, vectors = np.linalg.eig(matrix)
    return vectors[:, int(np.argmin(np.abs(values - value)))].real


@singular_lost()
def slow_direction(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Derivative of the section point by the spin (in its unit) along the family, and the spin's change a period [rad/s].

    The change of a point over a period is projected with the left eigenvector of the slow multiplier: only its part along the
    manifold counts. Those of all other multipliers, of which one is 1 at a fold, are across the family.
    """
    m = fixed.map
    along = np.linalg.solve(system(m, fixed.matrix, fixed.gradient), np.eye(fixed.z.size)[m.slow])
    row = max(np.linalg.eig(fixed.matrix.T)[1].real.T, key=lambda each: abs(each @ along))
    return along, float(row @ (fixed.image.point - fixed.z) / (row @ along)) * m.unit


@singular_lost()
def multipliers_of(fixed: Fixed) -> tuple[np.ndarray, float]:
    """Multipliers of the fast part, over the period of the motion, the largest first, and that of the slow direction."""
    values = np.linalg.eigvals(fixed.matrix)
    slow = int(np.argmin(np.abs(values - 1)))
    fast = np.delete(values, slow).astype(complex)
    return fast[np.argsort(-np.abs(fast), kind="stable")], float(values[slow].real)


@singular_lost()
def lag(fixed: Fixed) -> np.ndarray:
    """How far the manifold lies from the fixed point, to first order in the change of the spin; 0 without a fast part."""
    m = fixed.map
    if not has_fast_part(fixed):
        return np.zeros(fixed.z.size)
    along, rate = slow_direction(fixed)
    fast = np.delete(np.arange(fixed.z.size), m.slow)
    away = np.zeros(fixed.z.size)
    J = fixed.matrix[np.ix_(fast, fast)]
    away[fast] = -np.linalg.solve(np.eye(fast.size) - J, along[fast] * rate / m.unit)
    return away if np.abs(away).max() <= NEAR else np.zeros(fixed.z.size)


def has_fast_part(fixed: Fixed) -> bool:
    """Whether all multipliers but the slow one are away from 1."""
    fast, _ = multipliers_of(fixed)
    return bool(fast.size > 0 and np.abs(fast - 1).min() >= APART)


def slow_motion_at(fixed: Fixed) -> SlowMotion:
    """The fixed point itself, taken for a motion on the manifold; its turn goes with its spin, as where a dimer rolls."""
    image, drift = fixed.image, slow_direction(fixed)[1]
    turn_drift = image.theta * drift / image.spin if image.spin else 0.0
    return SlowMotion(fixed.z, image, image.theta, drift, turn_drift, fixed.residual)


def growth_in_plane(fixed: Fixed) -> tuple[float, bool]:
    """How a small spin grows in a period beside a motion in a plane, in units of itself, and whether the drift is smooth there.

    The drift is odd in the spin. If it is smooth, its ratio to the spin has even powers alone. It is not where an end slips, at
    any spin, through the turn of its slip in the plane: there friction turns round in a time that goes with the spin, which
    gives the drift a part like s log s.
    """
    m, along = fixed.map, slow_direction(fixed)[0]

    def growth(share: float) -> float:
        spin = share * m.unit
        return slow_direction(solve(m, fixed.z + share * along, spin))[1] / spin

    first, second, third = (growth(times * SMALL_SPIN) for times in (1, 2, 4))
    return (4 * first - second) / 3, bool(abs(third - second - 4 * (second - first)) < TOLERANCE * m.rtol)


def slow_motion_of(fixed: Fixed) -> SlowMotion:
    """The motion on the manifold at the spin of a fixed point; the fixed point itself without a fast part."""
    still = slow_motion_at(fixed)
    if not has_fast_part(fixed):
        return still
    try:
        slow_motion = slow_motion_near(fixed, fixed.z + lag(fixed), fixed.image.spin)
    except OrbitLost:
        return still
    return slow_motion if np.abs(slow_motion.z - fixed.z).max() <= NEAR else still


def slow_motion_near(fixed: Fixed, z: np.ndarray, spin: float) -> SlowMotion:
    """The motion on the manifold that passes near a point with a spin after its last impact [rad/s]; lost if there is none.

    It is found with the map and the derivatives of a fixed point nearby.
    """
    m = fixed.map

    def value(begin: np.ndarray, m: ReturnMap = m) -> tuple[np.ndarray, list[Image]]:
        images = m.chain(begin, 3)
        a, b, c = (image.point for image in images)
        r = c - 3 * b + 3 * a - begin
        r[m.slow] = (images[1].spin - spin) / m.unit
        return r, images

    def derivative(matrix: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        A = np.linalg.matrix_power(matrix - np.eye(len(matrix)), 3)
        A[m.slow] = gradient @ matrix
        return A

    begin = 2 * z - m.loosely.image(z).point  # one period before, at an even pace
    target, known = WEIGHTS * TOLERANCE * m.rtol, derivative(fixed.matrix, fixed.gradient)
    loosely = partial(value, m=m.loosely)
    root = newton(value, begin, lambda z: derivative(*m.jacobian(z, roughly=True)), target, known, loosely=loosely)
    before, here, after = root.extra
    turn, next_turn = (
        one.theta - one.passage.read.turned + two.passage.read.turned for one, two in ((before, here), (here, after))
    )
    return SlowMotion(
        before.point, here, turn, after.spin - here.spin, next_turn - turn, float(np.abs(root.value).max())
    )
