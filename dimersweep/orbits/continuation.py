"""Curves of solutions: steps along them in pseudo-arclength, and where something is zero or changes in a step.

What is followed is a problem: a branch of orbits (`branch.Axis`) or a border in the plane of two parameters
(`plane_curve.Plane`). A step goes along the tangent, and back to the curve on the plane across it (Keller; Kuznetsov, doi
10.1007/978-3-031-22007-4, section 10.2).
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.optimize import brentq

from dimersweep.errors import OrbitError
from dimersweep.orbits.poincare import OrbitLost

LOCATED = 1e-9  # how well a zero is known, in the parameter over its scale, or as a share of a step
LEAP = 1e-3  # part of a test function at the ends of a step, below which it does not leap over zero
SAME_WAY = 0.7  # product of the tangents at both ends of a step, below which it is too long


class StepLengths(NamedTuple):
    """Lengths of steps in the unknowns: of the first, the longest and the shortest; how much longer the next one may be.

    `tries` bounds the number of steps, those that fail among them.
    """

    first: float
    longest: float
    shortest: float
    growth: float
    tries: int


FOLLOWING = StepLengths(0.02, 0.25, 1e-6, 1.3, 1_000_000)  # its points are what is asked for
SEARCHING = StepLengths(0.1, 0.1, 1e-5, 1.5, 120)  # what is asked for lies between its points


P = TypeVar("P", bound=Any)  # a point of a curve, with its `tangent`: of length one, in the sense of the curve


class Problem(Protocol[P]):
    """What a curve is followed for: one equation less than unknowns, the last of which is a parameter over its scale."""

    def y(self, point: P) -> np.ndarray:
        """All unknowns at a point."""

    def on_plane(self, near: P, y: np.ndarray, normal: np.ndarray) -> P:
        """The point on the plane through `y` across `normal`, in the section of a point nearby.

        Raises
        ------
        OrbitLost
            If there is none nearby.
        """

    def judge(self, a: P, b: P, step: float) -> None:
        """Refuse a step from one point to another one, as `on_plane` does, that is too long for what lies between."""

    def settled(self, point: P, simplest: bool) -> P:
        """The point in the section that suits the next step; (`simplest`) if simpler contact lasts elsewhere, there."""

    def elsewhere(self, point: P) -> Iterable[P]:
        """The point in other sections, where its own does not go on."""


def steps(
    problem: Problem[P], begin: P, lengths: StepLengths, window: tuple[float, ...] = ()
) -> Iterator[tuple[P, P, float | None]]:
    """Steps of a curve, in the sense of the tangent of the point that it begins with.

    Parameters
    ----------
    problem : Problem
    begin : point
    lengths : StepLengths
    window : tuple of float
        Values of the last unknown at which the curve ends.

    Yields
    ------
    a, b : point
        Both ends of a step, in one section.
    edge : float or None
        The end of the window that `b` lies at; that step is the last one.

    Raises
    ------
    OrbitLost
        Where the curve does not go on.
    """
    point, step = begin, lengths.first
    others: list[P] | None = None  # the point in other sections, where the curve is lost in its own
    for _ in range(lengths.tries):
        try:
            nxt, edge = _stepped(problem, point, step, window)
        except OrbitLost:
            step *= 0.5
            if step < lengths.shortest:  # the contact at the section may be all that does not go on
                others = list(problem.elsewhere(point)) if others is None else others
                if not others:
                    raise
                point, step = others.pop(0), lengths.first
            continue
        yield point, nxt, edge
        if edge is not None:
            return
        point = problem.settled(nxt, others is None)
        step = min(lengths.growth * step, lengths.longest)
        others = [] if others else None


def _stepped(problem: Problem[P], point: P, step: float, window: tuple[float, ...]) -> tuple[P, float | None]:
    """The point a step further, or the one at an edge of the window that lies before it, and that edge."""
    y = problem.y(point)
    ahead = y + step * point.tangent
    for edge in window:
        if (ahead[-1] - edge) * (y[-1] - edge) < 0:
            last = _at_edge(problem, point, y, ahead, edge)
            problem.judge(point, last, step)
            return last, edge
    nxt = problem.on_plane(point, ahead, point.tangent)
    problem.judge(point, nxt, step)
    ahead = problem.y(nxt)
    for edge in window:
        if (ahead[-1] - edge) * (y[-1] - edge) < 0:
            return _at_edge(problem, nxt, y, ahead, edge), edge
    return nxt, None


def _at_edge(problem: Problem[P], near: P, y: np.ndarray, ahead: np.ndarray, edge: float) -> P:
    """The point at a value of the last unknown that lies between those of `y` and `ahead`."""
    at = y + (edge - y[-1]) / (ahead[-1] - y[-1]) * (ahead - y)
    at[-1] = edge
    return problem.on_plane(near, at, np.append(np.zeros(at.size - 1), 1.0))


def between(problem: Problem[P], a: P, b: P, share: float) -> P:
    """The point of the curve on the plane at a share of the way from `a` to `b`."""
    start, way = problem.y(a), problem.y(b) - problem.y(a)
    return problem.on_plane(a if share < 0.5 else b, start + share * way, way / np.linalg.norm(way))


class Between(dict[float, P]):
    """The points of a step by their share of the way, each of them found once."""

    def __init__(self, problem: Problem[P], a: P, b: P) -> None:
        super().__init__({0.0: a, 1.0: b})
        self.problem, self.a, self.b = problem, a, b
        self.length = float(np.linalg.norm(problem.y(b) - problem.y(a)))

    def __missing__(self, share: float) -> P:
        self[share] = between(self.problem, self.a, self.b, share)
        return self[share]


def zero(at: "Between[P]", test: Callable[[P], float], known: float) -> float | None:
    """The share of a step, so well `known`, at which a test function that changes its sign is zero.

    None if it leaps over zero, or a point is not found.
    """
    try:
        first, last = test(at[0.0]), test(at[1.0])
        if not first * last < 0:
            return None
        share = brentq(lambda share: test(at[share]), 0.0, 1.0, xtol=known, rtol=8.9e-16)
        small = abs(test(at[share])) < LEAP * max(abs(first), abs(last))
    except (OrbitLost, np.linalg.LinAlgError):
        return None
    return float(share) if small else None


def halved(read: Callable[[float], Any], low: float, high: float, within: float) -> tuple[float, float]:
    """Two numbers no further apart than `within`: of the first is read what is read of `low`, of the second something else.

    Where nothing can be read between them they are as far apart as they have come.
    """
    first = read(low)
    while abs(high - low) > within:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        try:
            low, high = (middle, high) if read(middle) == first else (low, middle)
        except (OrbitLost, OrbitError):
            break
    return low, high
