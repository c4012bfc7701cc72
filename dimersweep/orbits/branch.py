"""A branch of orbits in one parameter or the spin: pseudo-arclength steps, and where its stability or its word changes.

A point of a branch is y = (section point, parameter over its scale). Two points that follow one another are in the same
section, so that what lies between them is found on planes across the line from one to the other.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from dimersweep.errors import ParameterError
from dimersweep.orbits.manifold import lag
from dimersweep.orbits.return_map import Image, OrbitLost, ReturnMap
from dimersweep.orbits.solving import TOLERANCE, Fixed, defect, fixed_at, newton, system
from dimersweep.orbits.word import change_of, word_of
from dimersweep.parameters import check

LOCATED = 1e-9  # how well a special point is known, in the parameter over its scale
CHANGES = 12  # word changes within one step
JOINED = 0.1  # distance of points on both sides of a change of word that belong to one branch, in units of the section
SHORTEST = 1e-10  # share of a step to which a change of word is located where the parameter hardly changes
COMPLEX = 1e-7  # imaginary part from which on a pair of multipliers is complex
BORN = 2e-3  # distance from a flip at which the doubled branch is taken up, in units of the section


class Axis(NamedTuple):
    """What changes along a branch: the name of a parameter, or "spin", its scale, and the spin where that is fixed."""

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
        if self.name == "spin":
            return m
        if value == m.parameters.get(self.name):
            return m
        try:
            parameters = m.parameters | {self.name: value}
            check(parameters)
        except ParameterError as error:
            raise OrbitLost(str(error)) from error
        return m.with_value(self.name, value)

    def spin_at(self, value: float) -> float:
        """The spin asked for."""
        return value if self.name == "spin" else self.spin


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
        Of length one, in the sense of the branch.
    """

    fixed: Fixed
    value: float
    slope: np.ndarray
    tangent: np.ndarray

    @property
    def map(self) -> ReturnMap:
        """The map of its section."""
        return self.fixed.map

    def y(self, axis: Axis) -> np.ndarray:
        """The point with the parameter over its scale."""
        return np.append(self.fixed.z, self.value / axis.scale)

    def matrix(self) -> np.ndarray:
        """Derivative of `defect` by y, shape (n, n + 1)."""
        fixed = self.fixed
        return np.column_stack([system(fixed.map, fixed.matrix, fixed.gradient), self.slope])


def slope_of(axis: Axis, m: ReturnMap, z: np.ndarray, value: float) -> np.ndarray:
    """Derivative of `defect` by the parameter over its scale, by central differences."""
    if axis.name == "spin":
        slope = np.zeros(z.size)
        slope[m.slow] = -axis.scale / m.unit
        return slope
    step = m.step * axis.scale

    def at(value: float) -> np.ndarray:
        there = axis.map_at(m, value)
        return defect(there, z, there.image(z), axis.spin)

    try:
        return (at(value + step) - at(value - step)) / (2 * m.step)
    except OrbitLost:  # at the edge of what the parameter allows
        here = at(value)
        try:
            return (at(value + step) - here) / m.step
        except OrbitLost:
            return (here - at(value - step)) / m.step


def point_of(axis: Axis, fixed: Fixed, value: float, along: np.ndarray | None) -> Point:
    """A point of the branch with its tangent, in the sense of `along` (without: of a growing parameter)."""
    slope = slope_of(axis, fixed.map, fixed.z, value)
    matrix = np.column_stack([system(fixed.map, fixed.matrix, fixed.gradient), slope])
    tangent = np.linalg.svd(matrix)[2][-1]
    sense = tangent[-1] if along is None else tangent @ along
    return Point(fixed, value, slope, tangent if sense >= 0 else -tangent)


def corrected(axis: Axis, near: Point, y: np.ndarray, normal: np.ndarray, known: np.ndarray | None = None) -> Point:
    """The point of the branch on the plane through `y` across `normal`; `near` lends the section and the derivative.

    Raises
    ------
    OrbitLost
        If there is none nearby.
    """
    return with_derivatives(axis, lent(axis, near, y, normal, known), near.tangent)


def with_derivatives(axis: Axis, point: Point, along: np.ndarray) -> Point:
    """The same point with its own derivatives and tangent."""
    fixed = point.fixed
    return point_of(axis, fixed_at(fixed.map, fixed.z, fixed.image, fixed.residual), point.value, along)


def lent(
    axis: Axis, near: Point, y: np.ndarray, normal: np.ndarray, known: np.ndarray | None = None, anew: bool = True
) -> Point:
    """As `corrected`, with the derivatives and the tangent of `near` still; `anew`: whether Newton's method may take others."""
    m = near.fixed.map

    def derivative(there: np.ndarray) -> np.ndarray:
        p = there[-1] * axis.scale
        own = axis.map_at(m, p)
        A = system(own, *own.jacobian(there[:-1]))
        return np.vstack([np.column_stack([A, slope_of(axis, own, there[:-1], p)]), normal])

    begin = np.vstack([near.matrix() if known is None else known, normal])
    return closed_where(
        axis, near, y, lambda there, _: normal @ (there - y), derivative if anew else lambda _: begin, begin
    )


def closed_where(
    axis: Axis,
    near: Point,
    y: np.ndarray,
    last: Callable[[np.ndarray, Image], float],
    derivative: Callable[[np.ndarray], np.ndarray] | None = None,
    known: np.ndarray | None = None,
) -> Point:
    """The point near `y` at which the orbit closes and `last` of it and its image is zero; all else is still that of `near`.

    Parameters
    ----------
    axis, near, y
        As by `corrected`.
    last : callable
    derivative : callable, optional
        Of both equations, shape (n + 1, n + 1); by default by central differences.
    known : ndarray, optional
        The same nearby.

    Raises
    ------
    OrbitLost
        If there is none nearby.
    """
    m = near.fixed.map

    def value(there: np.ndarray) -> tuple[np.ndarray, tuple[ReturnMap, Image]]:
        p = there[-1] * axis.scale
        own = axis.map_at(m, p)
        image = own.image(there[:-1])
        return np.append(defect(own, there[:-1], image, axis.spin_at(p)), last(there, image)), (own, image)

    def differences(there: np.ndarray) -> np.ndarray:
        steps = m.step * np.eye(there.size)
        return np.array([(value(there + d)[0] - value(there - d)[0]) / (2 * m.step) for d in steps]).T

    root = newton(value, y, derivative or differences, TOLERANCE * m.rtol, known)
    own, image = root.told
    residual = float(np.abs(root.value[:-1]).max())
    fixed = near.fixed._replace(map=own, z=root.y[:-1], image=image, residual=residual)
    return near._replace(fixed=fixed, value=float(root.y[-1] * axis.scale))


def in_own_section(axis: Axis, point: Point, simplest: bool = True) -> Point:
    """The same point at a section of its own, if events have come near, or (where asked for) simpler contact lasts.

    Where that cannot be had, the point stays in its section as long as it lasts.
    """
    fixed = point.fixed
    return fixed.map.in_own_section(point, fixed.image.passage, partial(_moved, axis, point), simplest)


def in_each_section(axis: Axis, point: Point) -> Iterator[Point]:
    """The same point in the sections of its smooth phases, as far as it can be had there."""
    m = point.fixed.map
    for moved, z in m.sections(point.fixed.image.passage):
        with suppress(OrbitLost):
            yield _moved(axis, point, moved, z)


def _moved(axis: Axis, point: Point, moved: ReturnMap, z: np.ndarray) -> Point:
    """The same point in another section."""
    fixed = fixed_at(moved, z)
    fixed = fixed._replace(z=z - lag(fixed))  # what is a fixed point in one section is one that creeps in another
    near = Point(fixed, point.value, slope_of(axis, moved, z, point.value), np.zeros(z.size + 1))
    forward = 1.0 if point.tangent[-1] >= 0 else -1.0
    normal = np.append(np.zeros(z.size), 1.0)
    if abs(point.tangent[-1]) < 0.05:  # near a fold the parameter says nothing of where one is
        normal = np.linalg.svd(near.matrix())[2][-1]
    again = corrected(axis, near, near.y(axis), normal)
    tangent = again.tangent
    if point.fixed.z.size == z.size and abs(tangent[:-1] @ point.tangent[:-1]) > abs(tangent[-1] * point.tangent[-1]):
        flipped = tangent @ point.tangent < 0
    else:
        flipped = tangent[-1] * forward < 0
    return again._replace(tangent=-tangent if flipped else tangent)


# --- special points -------------------------------------------------------------------------------------------------


def fold_test(point: Point) -> float:
    """Zero at a fold."""
    return float(point.tangent[-1])


def flip_test(point: Point) -> float:
    """Zero where a multiplier is -1."""
    return float(np.linalg.det(point.fixed.matrix + np.eye(len(point.fixed.matrix))))


def torus_test(point: Point) -> float:
    """Zero where a complex pair of multipliers has size 1."""
    values = np.linalg.eigvals(point.fixed.matrix)
    pairs = values[np.abs(values.imag) > COMPLEX]
    return float((np.abs(pairs) ** 2 - 1).max()) if pairs.size else -1.0


TESTS: dict[str, Callable[[Point], float]] = {"fold": fold_test, "flip": flip_test, "torus": torus_test}


class Special(NamedTuple):
    """A special point: fold, flip, torus or word, and the share of the step it lies at.

    Of a word, what changes in it, and by how much the orbit jumps there, in units of the section.
    """

    kind: str
    change: str
    point: Point
    share: float
    jump: float = 0.0


def between(axis: Axis, a: Point, b: Point, share: float) -> Point:
    """The point of the branch on the plane at a share of the way from `a` to `b`."""
    start, way = a.y(axis), b.y(axis) - a.y(axis)
    near = a if share < 0.5 else b
    return corrected(axis, near, start + share * way, way / np.linalg.norm(way))


def specials(axis: Axis, a: Point, b: Point, words: bool = True) -> list[Special]:
    """Special points between two points of a branch, in their order."""
    found = []
    for kind, test in TESTS.items():
        if test(a) * test(b) < 0:
            special = _located(axis, kind, a, b)
            if special is not None:
                found.append(special)
    if words:
        found.extend(word_changes(axis, a, b))
    return sorted(found, key=lambda special: special.share)


def _located(axis: Axis, kind: str, a: Point, b: Point) -> Special | None:
    """The zero of a test function, unless it leaps over zero there."""
    test = TESTS[kind]
    length = abs(a.value - b.value) / axis.scale or float(np.linalg.norm(a.y(axis) - b.y(axis)))
    reached: dict[float, Point] = {0.0: a, 1.0: b}

    def value(share: float) -> float:
        if share not in reached:
            reached[share] = between(axis, a, b, share)
        return test(reached[share])

    try:
        share = brentq(value, 0.0, 1.0, xtol=max(LOCATED / length, 1e-14), rtol=8.9e-16)
        point = reached.get(share) or between(axis, a, b, share)
    except OrbitLost:
        return None
    scale = max(abs(test(a)), abs(test(b)))
    return Special(kind, "", point, share) if abs(test(point)) < 1e-3 * scale else None


class Leap(Exception):
    """The branch does not lead on from a point: beyond it there is another one.

    Parameters
    ----------
    found : list of Special
        Word changes before it.
    last : Point
    word : str
        Of what lies beyond.
    """

    def __init__(self, found: list[Special], last: Point, word: str) -> None:
        super().__init__(f"the orbit does not go on beyond its word; the next one found has the word {word}")
        self.found, self.last = found, last


def word_changes(axis: Axis, a: Point, b: Point) -> list[Special]:
    """Where the word changes between two points, by halving.

    Raises
    ------
    Leap
        If the points on both sides of a change are not those of one branch.
    """
    found: list[Special] = []
    low, left = 0.0, a
    last = word_of(b.fixed.image.passage)
    while (word := word_of(left.fixed.image.passage)) != last:
        low, left, right = last_with(axis, word.__eq__, low, left, b)
        beyond = word_of(right.fixed.image.passage)
        jump = float(np.abs(left.y(axis) - right.y(axis)).max())
        if jump > JOINED:
            raise Leap(found, left, beyond)
        found.append(Special("word", change_of(word, beyond), left, low, jump))
        if len(found) > CHANGES:
            raise Leap(found, left, beyond)
        left = right
    return found


def last_with(
    axis: Axis, holds: Callable[[str], bool], low: float, left: Point, b: Point
) -> tuple[float, Point, Point]:
    """The last point whose word obeys, with its share of the step that ends in `b`, and the first one found after it.

    Where the hold of an end that sticks is lost, friction falls from mu_s to mu, and the map leaps. So there may be no orbit
    for a little way: that counts as after the word.
    """
    high, right, right_at = 1.0, b, 1.0
    length = max(abs(left.y(axis) - b.y(axis))[-1] / (1 - low), LOCATED)
    while (high - low) * length > LOCATED and high - low > SHORTEST:
        middle = 0.5 * (low + high)
        try:
            point = bracketed(axis, left, right, (middle - low) / (right_at - low))
        except OrbitLost:
            high = middle
            continue
        if holds(word_of(point.fixed.image.passage)):
            low, left = middle, point
        else:
            high, right, right_at = middle, point, middle
    return low, left, right


def bracketed(axis: Axis, a: Point, b: Point, share: float) -> Point:
    """As `between`, but without new derivatives: for points so near that one end's will do."""
    start, way = a.y(axis), b.y(axis) - a.y(axis)
    return lent(axis, a, start + share * way, way / np.linalg.norm(way), anew=False)


def doubled(axis: Axis, flip: Point) -> Point:
    """The branch of twice the period that leaves a flip, a little way along it.

    Raises
    ------
    OrbitLost
        If none is found.
    """
    old = flip.fixed.map
    values, vectors = np.linalg.eig(flip.fixed.matrix)
    direction = vectors[:, int(np.argmin(np.abs(values + 1)))].real
    tangent = np.append(direction / np.linalg.norm(direction), 0.0)
    m = ReturnMap(old.parameters, old.phase, old.modes, 2 * old.periods, old.rtol, old.tape)
    y = flip.y(axis) + BORN * tangent
    z = y[:-1]
    near = Point(fixed_at(m, z), flip.value, slope_of(axis, m, z, flip.value), tangent)
    return corrected(axis, near, y, tangent)
