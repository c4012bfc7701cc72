"""Newton's method, and the fixed points of the return map that it finds, with their multipliers and slow drift."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.lost import OrbitLost, first_found, require, singular_lost
from dimersweep.analysis.orbits.map.passage import Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap

TOLERANCE = 10.0  # largest residual of an orbit, over the rtol of the map, by which images are in error
# most steps of Newton's method; ratio of a residual to the one before above which the derivative is computed anew
NEWTON_STEPS, QUICK_FALL = 25, 0.2
STEP_HALVINGS = 6  # lengths that are tried for a step: all of it, its half, its quarter ...
# largest residual, over the target, that is accepted where no step comes nearer: there rounding bounds the accuracy
NEAR_ENOUGH = 1e3


Mark = Callable[[ReturnMap, Passage], float]  # function of an orbit that is zero at a border


class Axis(NamedTuple):
    """The quantity that changes along a branch."""

    name: str  # name of a parameter, or "spin"
    scale: float  # its unit in y: values are divided by it
    spin: float | None  # axial spin along a branch in a parameter [rad/s]; None if it is free, without drift

    def map_at(self, m: ReturnMap, share: float) -> ReturnMap:
        """Return the map at a value of the parameter over its scale, if that value is allowed."""
        return m if self.name == "spin" else m.at(self.name, float(share * self.scale))

    def passage(self, m: ReturnMap, y: np.ndarray) -> Passage:
        """Return the passage from a section point, which is followed in `y` by the parameter over its scale."""
        return self.map_at(m, y[-1]).passage(y[:-1])

    def spin_at(self, value: float) -> float | None:
        """Return the axial spin at a value of the quantity [rad/s]; None if it is free."""
        return value if self.name == "spin" else self.spin


FAMILY = Axis("spin", 1.0, 0.0)  # quantity along the slow family, on which each orbit lies


class Orbits(NamedTuple):
    """The problem of an orbit: a point of the section is its own image, at a value of the quantity along an axis.

    On a border a function of the orbit, its mark, is zero as well.
    """

    map: ReturnMap  # map at the value of the quantity
    axis: Axis = FAMILY
    mark: Mark | None = None


class Solution(NamedTuple):
    """An orbit: the unknowns that solve a problem, the motion, and the derivatives there; a point for `continuation.steps`."""

    problem: Any  # `Orbits`, or the kind of them along which `continuation.steps` leads
    z: np.ndarray  # point of the section, shape (n,)
    value: float  # value of the quantity along the axis
    passage: Passage  # motion from the point to its image
    # derivatives of the image, of its spin in its unit and, if there is one, of the mark, by the section point:
    # shape (n + 1, n) or (n + 2, n)
    rows: np.ndarray
    residual: float  # largest entry of `defect`, in units of the section
    # derivative of `defect` and of the mark by the value over its scale, shape (n,) or (n + 1,); empty off a branch
    slope: np.ndarray = np.empty(0)
    # tangent of the branch, of length 1, in its sense, shape (n + 1,); empty off a branch. Where an end grazes, the
    # direction in which its gap opens
    tangent: np.ndarray = np.empty(0)

    @property
    def map(self) -> ReturnMap:
        """Map whose section the point lies in."""
        return self.problem.map

    @property
    def axis(self) -> Axis:
        """Quantity that changes along the branch."""
        return self.problem.axis

    @property
    def matrix(self) -> np.ndarray:
        """Derivative of the map, shape (n, n)."""
        return self.rows[: self.z.size]

    @property
    def gradient(self) -> np.ndarray:
        """Derivative of the spin after the last impact, in its unit, shape (n,)."""
        return self.rows[self.z.size]

    @property
    def mark_slope(self) -> np.ndarray | None:
        """Derivative of the mark by `y`, shape (n + 1,); None without a mark."""
        return None if self.problem.mark is None else np.append(self.rows[-1], self.slope[-1])

    @property
    def y(self) -> np.ndarray:
        """Unknowns: the section point, and the value over its scale, shape (n + 1,)."""
        return np.array([*self.z, self.value / self.axis.scale])

    @property
    def sequence(self) -> str:
        """Symbol sequence of the motion."""
        return self.passage.sequence

    @property
    def multipliers(self) -> np.ndarray:
        """Multipliers of the fast part and, if the spin is free, of the slow direction."""
        fast, slow = multipliers_of(self)
        return np.append(fast, slow) if self.axis.spin is None else fast

    def on_map(self, m: ReturnMap) -> "Solution":
        """Return the unknowns and derivatives with another map, for a search that begins there."""
        return self._replace(problem=self.problem._replace(map=m))

    def unmarked(self) -> "Solution":
        """Return the orbit as a point of its branch, without a mark."""
        n = self.z.size
        return self._replace(problem=self.problem._replace(mark=None), rows=self.rows[: n + 1], slope=self.slope[:n])

    def derivative(self) -> np.ndarray:
        """Return the derivative of `defect` by `y`, shape (n, n + 1)."""
        A = system(self.map, self.matrix, self.gradient, self.axis.spin is None)
        return np.column_stack([A, self.slope[: self.z.size]])

    def towards(self, along: np.ndarray | float) -> "Solution":
        """Return the point with its tangent in the sense of a vector, or of a change of the parameter (1 or -1)."""
        onward = self.tangent[-1] * along if np.ndim(along) == 0 else self.tangent @ along
        return self if onward >= 0 else self._replace(tangent=-self.tangent)

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> "Solution":
        """Find the point of the branch on the plane through `y` across `normal`, with its own derivatives."""
        return self.problem.on_plane(self, y, normal)

    def judge(self, to: "Solution", step: float) -> None:
        """Require that a step to another point is not too long."""
        self.problem.judge(self, to, step)

    def settled(self, simplest: bool = True) -> "Solution":
        """Return the point in another section if that suits it better."""
        return self.problem.settled(self, simplest)

    def elsewhere(self) -> "Iterator[Solution]":
        """Yield the point in other sections."""
        return self.problem.elsewhere(self)


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


def defect(m: ReturnMap, z: np.ndarray, passage: Passage, spin: float | None) -> np.ndarray:
    """Return how far a point and its image are apart, in units of the section, shape (n,).

    The entry of the spin is the distance of the spin after the last impact from `spin` [rad/s]. If `spin` is None, the
    spin is free: its entry is its change, as for the other coordinates.
    """
    r = passage.point - z
    if spin is not None:
        r[m.slow] = (passage.spin - spin) / m.unit
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


def newton(
    f: Callable[[np.ndarray], tuple[np.ndarray, Any]],
    y: np.ndarray,
    derivative: Callable[[np.ndarray], np.ndarray] | None,
    target: float,
    known: np.ndarray | None = None,
    most: int = NEWTON_STEPS,
) -> tuple[np.ndarray, Any, np.ndarray, np.ndarray | None]:
    """Find a zero of `f` near `y`.

    Return the zero, the object that `f` passes on with it, the value there, and the derivative with which the next step
    would be taken; None if that would be computed anew. A derivative is kept up to date by Broyden's formula, and
    computed anew only where the steps then converge too slowly.

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
            return y, extra, r, A
        if A is None and derivative is not None:
            most -= 1
            require(most >= 0, "Newton's method asks for one derivative after the other")
            A, fresh = derivative(y), True
        assert A is not None
        try:
            y_next, r_next, extra_next = _nearer(f, y, -np.linalg.solve(A, r), size, STEP_HALVINGS if derivative else 1)
        except (np.linalg.LinAlgError, OrbitLost) as error:
            if size <= NEAR_ENOUGH * target:
                return y, extra, r, A  # the rounding of the map allows no better
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


def fixed_at(m: ReturnMap, z: np.ndarray, passage: Passage | None = None, residual: float = 0.0) -> Solution:
    """Return the fixed point `z` with its derivatives, and its passage if that is not known, computed there."""
    passage = m.passage(z) if passage is None else passage
    return Solution(Orbits(m), z, passage.spin, passage, m.differences(z), residual)


def solve(m: ReturnMap, z: np.ndarray, spin: float | None, known: np.ndarray | None = None) -> Solution:
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
        passage = m.passage(z)
        return defect(m, z, passage, spin), passage

    free = spin is None
    z, passage, left, _ = newton(value, z, lambda z: system(m, *m.jacobian(z), free), target(m, free), known)
    return fixed_at(m, z, passage, float(np.abs(left).max()))


def without_drift(fixed: Solution, axis: Axis) -> Solution:
    """Return the fixed point with which a branch begins: `fixed` or, for a free spin, one nearby without drift."""
    if axis.spin is not None:
        return fixed
    places = chain([(fixed.map, fixed.z)], fixed.map.sections(fixed.passage))
    return first_found(partial(solve, *place, None) for place in places)


@singular_lost()
def slow_direction(fixed: Solution) -> tuple[np.ndarray, float]:
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
def multipliers_of(fixed: Solution) -> tuple[np.ndarray, float]:
    """Return the multipliers of the fast part, the largest first, and the multiplier of the slow direction.

    They are those over the period of the motion. The slow one is nearest to 1.
    """
    values = np.linalg.eigvals(fixed.matrix)
    slow = int(np.argmin(np.abs(values - 1)))
    fast = np.delete(values, slow).astype(complex)
    return fast[np.argsort(-np.abs(fast), kind="stable")], float(values[slow].real)


def slow_motion_at(fixed: Solution) -> SlowMotion:
    """Return the fixed point as a motion on the manifold, with a turn proportional to its spin, as in rolling."""
    passage, drift = fixed.passage, slow_direction(fixed)[1]
    turn_drift = passage.theta * drift / passage.spin if passage.spin else 0.0
    return SlowMotion(fixed.z, passage, passage.theta, drift, turn_drift, fixed.residual)
