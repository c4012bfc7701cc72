"""Points of a branch of orbits in one parameter or the spin, with their equations and derivatives.

The unknowns of a point are y = (section point, parameter over its scale). Two points that follow one another are in the
same section, so that points between them are found on planes across the line from one to the other.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.continuation.steps import SAME_WAY
from dimersweep.analysis.orbits.map.lost import all_found, attempt, first_found, require, singular_lost
from dimersweep.analysis.orbits.map.manifold import lag
from dimersweep.analysis.orbits.map.passage import TURN, Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import (
    NEWTON_STEPS,
    Fixed,
    defect,
    fixed_at,
    multipliers_of,
    newton,
    solve,
    system,
    target,
)

# entry of the parameter in a tangent (of length 1) below which the branch is near a fold: two points may then have one
# value of the parameter, which does not tell them apart
NEAR_TURN = 0.05

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

    def taken_up(self, fixed: Fixed) -> Fixed:
        """Return the fixed point with which a branch begins: `fixed` or, for a free spin, one nearby without drift."""
        if self.spin is not None:
            return fixed
        places = chain([(fixed.map, fixed.z)], fixed.map.sections(fixed.passage))
        return first_found(partial(solve, *place, None) for place in places)

    def spin_at(self, value: float) -> float | None:
        """Return the axial spin at a value of the quantity [rad/s]; None if it is free."""
        return value if self.name == "spin" else self.spin


class Point(NamedTuple):
    """A point of a branch of orbits, for steps along it (`steps.OnCurve`)."""

    axis: Axis
    fixed: Fixed
    value: float  # value of the parameter
    slope: np.ndarray  # derivative of `defect` by the parameter over its scale, shape (n,)
    # tangent of length 1 in the sense of the branch, shape (n + 1,); where an end grazes, the direction in which its
    # gap opens
    tangent: np.ndarray
    # at a zero of a mark: derivative of the mark by the section point and the parameter over its scale, shape (n + 1,)
    mark_slope: np.ndarray | None = None
    grazes: bool = False  # True if an end just misses the plate

    @property
    def map(self) -> ReturnMap:
        """Map whose section the point lies in."""
        return self.fixed.map

    @property
    def sequence(self) -> str:
        """Symbol sequence of the motion."""
        return self.fixed.passage.sequence

    @property
    def y(self) -> np.ndarray:
        """Unknowns: the section point, and the parameter over its scale, shape (n + 1,)."""
        return np.array([*self.fixed.z, self.value / self.axis.scale])

    @property
    def multipliers(self) -> np.ndarray:
        """Multipliers of the fast part and, if the spin is free, of the slow direction."""
        fast, slow = multipliers_of(self.fixed)
        return np.append(fast, slow) if self.axis.spin is None else fast

    def matrix(self) -> np.ndarray:
        """Return the derivative of `defect` by y, shape (n, n + 1)."""
        fixed = self.fixed
        return np.column_stack([system(fixed.map, fixed.matrix, fixed.gradient, self.axis.spin is None), self.slope])

    def towards(self, along: np.ndarray | float) -> "Point":
        """Return the point with its tangent in the sense of a vector, or of a change of the parameter (1 or -1)."""
        onward = self.tangent[-1] * along if np.ndim(along) == 0 else self.tangent @ along
        return self if onward >= 0 else self._replace(tangent=-self.tangent)

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> "Point":
        """Find the point of the branch on the plane through `y` across `normal`, with its own derivatives."""
        return with_derivatives(lent(self, y, normal))

    def side(self) -> float:
        """Return a sign, 1.0 or -1.0, that stays the same along a branch in one section, through folds and kinks.

        A change of the sign shows that the tangent has lost the sense of the branch.
        """
        return float(np.linalg.slogdet(np.vstack([self.matrix(), self.tangent]))[0])

    def judge(self, to: "Point", step: float) -> None:
        """Require that the branch turns little over a step and, if the spin is free, does not turn back at a kink."""
        require(self.tangent @ to.tangent >= SAME_WAY, "the branch turns too sharply")
        if self.axis.spin is None:
            back = self.side() != to.side() and self.fixed.passage.spin * to.fixed.passage.spin > 0
            far = np.linalg.norm(to.y - self.y) > step / SAME_WAY
            require(not back and not far, "the branch turns back at a kink")

    def settled(self, simplest: bool = True) -> "Point":
        """Return the point in another section if that suits it better, as `ReturnMap.in_own_section` decides.

        The point stays in its own section where no orbit is found in another one, and where an end grazes.
        """
        if self.grazes:
            return self
        return self.map.in_own_section(self, self.fixed.passage, partial(_moved, self), simplest)

    def elsewhere(self) -> "Iterator[Point]":
        """Yield the point in the section of each smooth phase of its motion in which Newton's method finds it."""
        yield from all_found(partial(_moved, self, *place) for place in self.map.sections(self.fixed.passage))


def slope_of(
    axis: Axis, m: ReturnMap, z: np.ndarray, share: float, sense: float = 0.0, mark: Mark | None = None
) -> np.ndarray:
    """Return the derivative of `defect` by the parameter over its scale, as a quotient of differences, shape (n,).

    With a mark, the derivative of the mark is appended: shape (n + 1,).

    Parameters
    ----------
    axis : Axis
        Parameter of the branch. For the spin, the derivative is exact, and that of a mark is zero.
    m : ReturnMap
    z : ndarray, shape (n,)
        Point of the section.
    share : float
        Value of the parameter over its scale.
    sense : float
        Side, 1 or -1, to which the difference is taken; 0 for a central difference or, where it fails, one to either
        side.
    mark : callable, optional
        Function of an orbit whose zero is sought along the branch, see `Mark`.
    """
    if axis.name == "spin":
        slope = np.zeros(z.size if mark is None else z.size + 1)
        slope[m.slow] = -axis.scale / m.unit
        return slope

    def at(by: float) -> np.ndarray:
        there = axis.map_at(m, share + by)
        image = there.passage(z)
        fails = defect(there, z, image, axis.spin)
        return fails if mark is None else np.append(fails, mark(there, image))

    def between(ahead: float, back: float) -> np.ndarray:
        return (at(ahead) - at(back)) / (ahead - back)

    # a central difference is not to be had at a bound of the parameter: then one to either side is tried
    ways = [(sense * m.one_sided, 0.0)] if sense else [(m.step, -m.step), (m.step, 0.0), (0.0, -m.step)]
    return first_found(partial(between, *way) for way in ways)


@singular_lost()
def point_of(
    axis: Axis, fixed: Fixed, value: float, along: np.ndarray | float = 1.0, slope: np.ndarray | None = None
) -> Point:
    """Return the point of a branch at a fixed point, with its tangent in the sense of `along`, see `Point.towards`."""
    if slope is None:
        slope = slope_of(axis, fixed.map, fixed.z, value / axis.scale)
    point = Point(axis, fixed, value, slope, np.empty(0))
    return point._replace(tangent=np.linalg.svd(point.matrix())[2][-1]).towards(along)


def with_derivatives(point: Point, senses: np.ndarray | None = None, mark: Mark | None = None) -> Point:
    """Return a point with its derivatives and its tangent computed anew, and with the derivative of a mark.

    With `senses`, shape (n + 1,), the differences are taken to one side only, 1 or -1 for each entry of y.
    """
    axis, fixed, m = point.axis, point.fixed, point.map
    rows = m.differences(fixed.z, None if senses is None else senses[:-1], mark)
    slope = slope_of(axis, m, fixed.z, point.value / axis.scale, 0.0 if senses is None else senses[-1], mark)
    n = fixed.z.size
    again = point_of(axis, fixed._replace(matrix=rows[:n], gradient=rows[n]), point.value, point.tangent, slope[:n])
    return again if mark is None else again._replace(mark_slope=np.append(rows[-1], slope[-1]))


def lent(near: Point, y: np.ndarray, normal: np.ndarray, most: int = NEWTON_STEPS) -> Point:
    """Find the point of a branch on the plane through `y` across `normal`, with the derivatives of `near`.

    Its tangent is that of `near`, too. Newton's method may compute `most` new derivatives on its way.
    """
    axis = near.axis

    def derivative(there: np.ndarray) -> np.ndarray:
        own = axis.map_at(near.map, there[-1])
        A = system(own, *own.jacobian(there[:-1]), axis.spin is None)
        return np.vstack([np.column_stack([A, slope_of(axis, own, there[:-1], there[-1])]), normal])

    equations = Equations(near, lambda there, *_: normal @ (there - y))
    return equations.solved(y, derivative if most else None, np.vstack([near.matrix(), normal]), most)[0]


class Equations:
    """The equations of a point near another one: `defect` is zero, and so is one more function, `last`.

    The arguments of `last` are y, the map and the image.
    """

    def __init__(self, near: Point, last: Callable[[np.ndarray, ReturnMap, Passage], float]) -> None:
        self.axis, self.near, self.last = near.axis, near, last

    def value(self, there: np.ndarray) -> tuple[np.ndarray, tuple[ReturnMap, Passage]]:
        """Return the values of the functions to be zero, shape (n + 1,), and the map and image they come from."""
        own = self.axis.map_at(self.near.map, there[-1])
        image = own.passage(there[:-1])
        fails = defect(own, there[:-1], image, self.axis.spin_at(there[-1] * self.axis.scale))
        return np.array([*fails, self.last(there, own, image)]), (own, image)

    def derivative(self, there: np.ndarray, step: float | None = None) -> np.ndarray:
        """Return the derivative of `value` by y, shape (n + 1, n + 1), by central differences."""
        step = self.near.map.step if step is None else step
        steps = step * np.eye(there.size)
        return np.array([(self.value(there + d)[0] - self.value(there - d)[0]) / (2 * step) for d in steps]).T

    def solved(
        self,
        y: np.ndarray,
        derivative: Callable[[np.ndarray], np.ndarray] | None = None,
        known: np.ndarray | None = None,
        most: int = NEWTON_STEPS,
    ) -> tuple[Point, np.ndarray | None]:
        """Find the point near `y` at which the equations hold, and return it with the last derivative used.

        The point has the derivatives and the tangent of `near`. `derivative`, `known` and `most` are those of `newton`.
        """
        root = newton(self.value, y, derivative, target(self.near.map, self.axis.spin is None), known, most)
        return self.point(root.y, root.extra, float(np.abs(root.value[:-1]).max())), root.derivative

    def point(self, y: np.ndarray, extra: tuple[ReturnMap, Passage], residual: float = 0.0) -> Point:
        """Return the point at a solution `y`, from the map and image that `value` returned there."""
        own, image = extra
        fixed = self.near.fixed._replace(map=own, z=y[:-1], passage=image, residual=residual)
        return self.near._replace(fixed=fixed, value=float(y[-1] * self.axis.scale), mark_slope=None, grazes=False)


def _moved(point: Point, moved: ReturnMap, z: np.ndarray) -> Point:
    """Find the point of a branch in another section, where its motion passes `z`."""
    axis = point.axis
    fixed = fixed_at(moved, z)
    # the motion of a fixed point in one section drifts slowly in another, so it lies beside the fixed point there
    fixed = fixed._replace(z=z - lag(fixed))
    slope = slope_of(axis, moved, z, point.value / axis.scale)
    near = Point(axis, fixed, point.value, slope, np.zeros(z.size + 1))
    # the point keeps its value of the parameter, but near a fold, where another point of the branch has that value, too
    turns = abs(point.tangent[-1]) < NEAR_TURN
    normal = np.linalg.svd(near.matrix())[2][-1] if turns else np.eye(z.size + 1)[-1]
    return near.on_plane(near.y, normal).towards(_ahead(point, moved, z))


def _ahead(point: Point, moved: ReturnMap, z: np.ndarray) -> np.ndarray:
    """Return the sense of a branch in another section, shape (n + 1,), for `Point.towards`.

    It is the way from the motion of the point, which passes `z` there, to a motion a little ahead.
    """
    m = point.map
    phases = (moved.phase - m.phase) % TURN + TURN * np.arange(m.periods)

    def way() -> np.ndarray:
        later = point.y + m.step * point.tangent
        own = point.axis.map_at(m, later[-1])
        passage = own.passage(later[:-1])
        places = [own.moved_to(passage, phase) for phase in phases]
        same = [there for map_, there in places if map_.free.size == z.size]
        return (min(same, key=lambda there: float(np.abs(there - z).max()), default=z) - z) / m.step

    found = attempt(way)
    return np.append(np.zeros(z.size) if found is None else found, point.tangent[-1])
