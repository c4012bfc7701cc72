"""A branch of orbits in one parameter or the spin: its points, and steps along it in pseudo-arclength.

A point of a branch is y = (section point, parameter over its scale). Two points that follow one another are in the same
section, so that what lies between them is found on planes across the line from one to the other.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np

from dimersweep.orbits.continuation import SAME_WAY
from dimersweep.orbits.manifold import lag
from dimersweep.orbits.newton import NEWTON_STEPS, TOLERANCE, Fixed, defect, fixed_at, newton, system
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import Image, OrbitLost, ReturnMap, singular_lost

Mark = Callable[[ReturnMap, Image], float]  # what is zero at a border, beside the equations of an orbit


class Axis(NamedTuple):
    """The quantity that changes along a branch, and the branch as a problem for `continuation`.

    Attributes
    ----------
    name : str
        Of a parameter, or "spin".
    scale : float
        By which its values are divided.
    spin : float
        Axial spin along a branch in a parameter [rad/s].
    """

    name: str
    scale: float
    spin: float

    def map_at(self, m: ReturnMap, value: float) -> ReturnMap:
        """The map at a value of the parameter.

        Raises
        ------
        OrbitLost
            If the parameter does not allow it.
        """
        return m if self.name == "spin" else m.at(self.name, value)

    def spin_at(self, value: float) -> float:
        """The axial spin at a value of the quantity [rad/s]."""
        return value if self.name == "spin" else self.spin

    def y(self, point: "Point") -> np.ndarray:
        """The section point with the parameter over its scale."""
        return np.append(point.fixed.z, point.value / self.scale)

    def on_plane(self, near: "Point", y: np.ndarray, normal: np.ndarray) -> "Point":
        """The point of the branch on the plane through `y` across `normal`, with its own derivatives; see `Problem`."""
        return with_derivatives(self, lent(self, near, y, normal), near.tangent)

    def judge(self, a: "Point", b: "Point", step: float) -> None:
        """Refuse a step over which the branch turns too far."""
        if a.tangent @ b.tangent < SAME_WAY:
            raise OrbitLost("the branch turns too sharply")

    def settled(self, point: "Point", simplest: bool = True) -> "Point":
        """The point in another section, if events have come near its own, or (`simplest`) if simpler contact lasts elsewhere.

        Where no orbit is found in another section, and where an end grazes, the point stays in its own.
        """
        fixed = point.fixed
        if point.grazes:
            return point
        return fixed.map.in_own_section(point, fixed.image.passage, partial(_moved, self, point), simplest)

    def elsewhere(self, point: "Point") -> "Iterator[Point]":
        """The point in the section of each smooth phase of its motion in which Newton's method finds it."""
        m = point.fixed.map
        for moved, z in m.sections(point.fixed.image.passage):
            with suppress(OrbitLost):
                yield _moved(self, point, moved, z)


class Point(NamedTuple):
    """A point of a branch.

    Attributes
    ----------
    fixed : Fixed
    value : float
        Of the parameter.
    slope : ndarray, shape (n,)
        Derivative of `defect` by the parameter over its scale.
    tangent : ndarray, shape (n + 1,)
        Of length one, in the sense of the branch; where an end grazes, that in which the gap opens.
    mark_slope : ndarray, shape (n + 1,), optional
        Where a mark is zero: its derivative by the section point and the parameter over its scale.
    grazes : bool
        Whether an end just misses the plate.
    """

    fixed: Fixed
    value: float
    slope: np.ndarray
    tangent: np.ndarray
    mark_slope: np.ndarray | None = None
    grazes: bool = False

    @property
    def map(self) -> ReturnMap:
        """The map of its section."""
        return self.fixed.map

    @property
    def word(self) -> str:
        """The word of its motion."""
        return self.fixed.image.passage.word

    def y(self, axis: Axis) -> np.ndarray:
        """The point with the parameter over its scale."""
        return axis.y(self)

    def matrix(self) -> np.ndarray:
        """Derivative of `defect` by y, shape (n, n + 1)."""
        fixed = self.fixed
        return np.column_stack([system(fixed.map, fixed.matrix, fixed.gradient), self.slope])


def slope_of(
    axis: Axis, m: ReturnMap, z: np.ndarray, value: float, sense: float = 0.0, mark: Mark | None = None
) -> np.ndarray:
    """Derivative of `defect`, and of a mark, by the parameter over its scale; with a `sense` of 1 or -1, to that side only."""
    if axis.name == "spin":
        slope = np.zeros(z.size if mark is None else z.size + 1)
        slope[m.slow] = -axis.scale / m.unit
        return slope

    def at(by: float) -> np.ndarray:
        there = axis.map_at(m, value + by * axis.scale)
        image = there.image(z)
        fails = defect(there, z, image, axis.spin)
        return fails if mark is None else np.append(fails, mark(there, image))

    if sense:
        return (at(sense * m.one_sided) - at(0.0)) / (sense * m.one_sided)
    step = m.step
    try:
        return (at(step) - at(-step)) / (2 * step)
    except OrbitLost:  # at the edge of what the parameter allows
        here = at(0.0)
        try:
            return (at(step) - here) / step
        except OrbitLost:
            return (here - at(-step)) / step


def point_of(axis: Axis, fixed: Fixed, value: float, along: np.ndarray | None) -> Point:
    """A point of the branch with its tangent, in the sense of `along` (without: of a growing parameter)."""
    return _pointed(fixed, value, slope_of(axis, fixed.map, fixed.z, value), along)


@singular_lost()
def _pointed(fixed: Fixed, value: float, slope: np.ndarray, along: np.ndarray | None) -> Point:
    """A point with the tangent that follows from its derivatives."""
    tangent = np.linalg.svd(np.column_stack([system(fixed.map, fixed.matrix, fixed.gradient), slope]))[2][-1]
    sense = tangent[-1] if along is None else tangent @ along
    return Point(fixed, value, slope, tangent if sense >= 0 else -tangent)


def with_mark(axis: Axis, point: Point, mark: Mark) -> Point:
    """A point with its derivatives taken anew, and that of a mark."""
    fixed, m = point.fixed, point.map
    rows = m.differences(fixed.z, lambda image: np.append(image.point, [image.spin / m.unit, mark(m, image)]))
    *matrix, gradient, of_mark = rows
    slope = slope_of(axis, m, fixed.z, point.value, mark=mark)
    fixed = fixed._replace(matrix=np.array(matrix), gradient=gradient)
    return _pointed(fixed, point.value, slope[:-1], point.tangent)._replace(mark_slope=np.append(of_mark, slope[-1]))


def one_sided(axis: Axis, point: Point, senses: np.ndarray, along: np.ndarray) -> Point:
    """A point with its derivatives taken anew, to one side only, and its tangent in the sense of `along`.

    `senses` holds 1 or -1 for the section point and the parameter.
    """
    fixed = point.fixed
    matrix, gradient = fixed.map.jacobian(fixed.z, fixed.image, senses[:-1])
    slope = slope_of(axis, fixed.map, fixed.z, point.value, senses[-1])
    return _pointed(fixed._replace(matrix=matrix, gradient=gradient), point.value, slope, along)


def with_derivatives(axis: Axis, point: Point, along: np.ndarray) -> Point:
    """A point with its derivatives and tangent taken anew."""
    fixed = point.fixed
    return point_of(axis, fixed_at(fixed.map, fixed.z, fixed.image, fixed.residual), point.value, along)


def lent(axis: Axis, near: Point, y: np.ndarray, normal: np.ndarray, most: int = NEWTON_STEPS) -> Point:
    """The point of the branch on the plane through `y` across `normal`, with the derivatives and the tangent of `near`.

    Newton's method may take `most` new derivatives on its way.

    Raises
    ------
    OrbitLost
        If there is none nearby.
    """
    m = near.fixed.map

    def derivative(there: np.ndarray) -> np.ndarray:
        p = there[-1] * axis.scale
        own = axis.map_at(m, p)
        A = system(own, *own.jacobian(there[:-1]))
        return np.vstack([np.column_stack([A, slope_of(axis, own, there[:-1], p)]), normal])

    begin = np.vstack([near.matrix(), normal])
    equations = Equations(axis, near, lambda there, *_: normal @ (there - y))
    return equations.solved(y, derivative if most else None, begin, most)[0]


class Equations:
    """The equations of a point: the orbit closes, and one more equation holds.

    Parameters
    ----------
    axis : Axis
    near : Point
    last : callable
        Of section point with parameter, map and image: zero where the other equation holds.
    """

    def __init__(self, axis: Axis, near: Point, last: Callable[[np.ndarray, ReturnMap, Image], float]) -> None:
        self.axis, self.near, self.last = axis, near, last

    def value(self, there: np.ndarray) -> tuple[np.ndarray, tuple[ReturnMap, Image]]:
        """How far the equations fail to hold, and the map and image from which this is known."""
        p = there[-1] * self.axis.scale
        own = self.axis.map_at(self.near.fixed.map, p)
        image = own.image(there[:-1])
        fails = defect(own, there[:-1], image, self.axis.spin_at(p))
        return np.append(fails, self.last(there, own, image)), (own, image)

    def derivative(self, there: np.ndarray, step: float | None = None) -> np.ndarray:
        """Derivative of all equations, by central differences."""
        step = self.near.fixed.map.step if step is None else step
        steps = step * np.eye(there.size)
        return np.array([(self.value(there + d)[0] - self.value(there - d)[0]) / (2 * step) for d in steps]).T

    def solved(
        self,
        y: np.ndarray,
        derivative: Callable[[np.ndarray], np.ndarray] | None = None,
        known: np.ndarray | None = None,
        most: int = NEWTON_STEPS,
    ) -> tuple[Point, np.ndarray | None]:
        """The point near `y` at which they hold, with the derivatives and the tangent of `near`, and the last derivative used.

        `derivative`, `known` and `most` are those of `newton`.

        Raises
        ------
        OrbitLost
            If there is none nearby.
        """
        m = self.near.fixed.map
        root = newton(self.value, y, derivative, TOLERANCE * m.rtol, known, most)
        own, image = root.extra
        residual = float(np.abs(root.value[:-1]).max())
        fixed = self.near.fixed._replace(map=own, z=root.y[:-1], image=image, residual=residual)
        point = self.near._replace(
            fixed=fixed, value=float(root.y[-1] * self.axis.scale), mark_slope=None, grazes=False
        )
        return point, root.derivative


def _moved(axis: Axis, point: Point, moved: ReturnMap, z: np.ndarray) -> Point:
    """A point of a branch in another section; `z` is that of its motion there."""
    fixed = fixed_at(moved, z)
    fixed = fixed._replace(z=z - lag(fixed))  # what is a fixed point in one section is one that creeps in another
    near = Point(fixed, point.value, slope_of(axis, moved, z, point.value), np.zeros(z.size + 1))
    normal = np.append(np.zeros(z.size), 1.0)
    if abs(point.tangent[-1]) < 0.05:  # near a fold the parameter says nothing of where one is
        normal = np.linalg.svd(near.matrix())[2][-1]
    again = axis.on_plane(near, near.y(axis), normal)
    tangent = again.tangent
    return again._replace(tangent=tangent if tangent @ _ahead(axis, point, moved, z) >= 0 else -tangent)


def _ahead(axis: Axis, point: Point, moved: ReturnMap, z: np.ndarray) -> np.ndarray:
    """Where a branch leads from a point, in another section: the way that a motion a little ahead has there."""
    m, y = point.map, point.y(axis)
    onward = np.append(np.zeros(z.size), point.tangent[-1])
    with suppress(OrbitLost):
        later = y + m.step * point.tangent
        own = axis.map_at(m, later[-1] * axis.scale)
        passage = own.image(later[:-1]).passage
        phases = (moved.phase - m.phase) % TURN + TURN * np.arange(m.periods)
        places = [own.moved_to(passage, phase) for phase in phases]
        same = [there for map_, there in places if map_.free.size == z.size]
        if same:
            there = min(same, key=lambda there: float(np.abs(there - z).max()))
            onward[:-1] = (there - z) / m.step
    return onward
