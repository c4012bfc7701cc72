"""Curves of solutions: steps along them in pseudo-arclength, and where something is zero or changes in a step.

What is followed has points that know their neighbours: those of a branch of orbits (`branch.Point`), or of a border in the
plane of two parameters (`plane_curve.InPlane`). A step goes along the tangent, and back to the curve on the plane across it
(Keller; Kuznetsov, doi 10.1007/978-3-031-22007-4, section 10.2).
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from scipy.optimize import brentq

from dimersweep.analysis.orbits.map.poincare import OrbitLost
from dimersweep.errors import OrbitError

LOCATED = 1e-9  # how well a zero is known, in the parameter over its scale, or as a share of a step
# part of a test function at the ends of a step, below which it does not leap over zero; where the spin is free, and the
# function known less well
LEAP, SLOW_LEAP = 1e-3, 1e-2
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


# of a curve whose points are what is asked for
FOLLOWING = StepLengths(first=0.02, longest=0.25, shortest=1e-6, growth=1.3, tries=1_000_000)
# of one between whose points lies what is asked for
SEARCHING = StepLengths(first=0.1, longest=0.1, shortest=1e-5, growth=1.5, tries=120)


class OnPlanes(Protocol):
    """A point of a curve from which others nearby are found; `y` has all unknowns, shape (n + 1,)."""

    @property
    def y(self) -> np.ndarray: ...

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> Self:
        """The point on the plane through `y` across `normal`, in the section of this one; lost if there is none nearby."""


class OnCurve(OnPlanes, Protocol):
    """A point of a curve: one equation less than unknowns, the last of which is a parameter over its scale."""

    @property
    def tangent(self) -> np.ndarray:
        """Of length one, in the sense of the curve, shape (n + 1,)."""

    def judge(self, to: Self, step: float) -> None:
        """Refuse a step to another point, as `on_plane` does, that is too long for what lies between."""

    def settled(self, simplest: bool = True) -> Self:
        """The point in the section that suits the next step; (`simplest`) if simpler contact lasts elsewhere, there."""

    def elsewhere(self) -> Iterable[Self]:
        """The point in other sections, where its own does not go on."""


P = TypeVar("P", bound=OnCurve)
Q = TypeVar("Q", bound=OnPlanes)


def steps(begin: P, lengths: StepLengths, window: tuple[float, ...] = ()) -> Iterator[tuple[P, P, float | None]]:
    """Steps of a curve from a point on, in the sense of its tangent; it is lost where the curve does not go on.

    Parameters
    ----------
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
    """
    point, step = begin, lengths.first
    others: list[P] | None = None  # the point in other sections, where the curve is lost in its own
    for _ in range(lengths.tries):
        try:
            nxt, edge = _stepped(point, step, window)
        except OrbitLost:
            step *= 0.5
            if step < lengths.shortest:  # the contact at the section may be all that does not go on
                others = list(point.elsewhere()) if others is None else others
                if not others:
                    raise
                point, step = others.pop(0), lengths.first
            continue
        yield point, nxt, edge
        if edge is not None:
            return
        point = nxt.settled(others is None)
        step = min(lengths.growth * step, lengths.longest)
        others = [] if others else None


def _stepped(point: P, step: float, window: tuple[float, ...]) -> tuple[P, float | None]:
    """The point a step further, or the one at an edge of the window that lies before it, and that edge."""
    ahead = point.y + step * point.tangent
    for edge in window:
        if (ahead[-1] - edge) * (point.y[-1] - edge) < 0:
            last = _at_edge(point, point.y, ahead, edge)
            point.judge(last, step)
            return last, edge
    nxt = point.on_plane(ahead, point.tangent)
    point.judge(nxt, step)
    for edge in window:
        if (nxt.y[-1] - edge) * (point.y[-1] - edge) < 0:
            return _at_edge(nxt, point.y, nxt.y, edge), edge
    return nxt, None


def _at_edge(near: P, y: np.ndarray, ahead: np.ndarray, edge: float) -> P:
    """The point at a value of the last unknown that lies between those of `y` and `ahead`."""
    at = y + (edge - y[-1]) / (ahead[-1] - y[-1]) * (ahead - y)
    at[-1] = edge
    return near.on_plane(at, np.eye(at.size)[-1])


class Between(dict[float, Q]):
    """The points of a step by their share of the way, on planes across it, each found once, from the nearer end."""

    def __init__(self, a: Q, b: Q) -> None:
        super().__init__({0.0: a, 1.0: b})
        self.way = b.y - a.y
        self.length = float(np.linalg.norm(self.way))

    def __missing__(self, share: float) -> Q:
        self[share] = self.near(share).on_plane(self[0.0].y + share * self.way, self.way / self.length)
        return self[share]

    def near(self, share: float) -> Q:
        """The point from which that at a share is found."""
        return self[0.0] if share < 0.5 else self[1.0]


def zero(at: Between[Q], test: Callable[[Q], float], known: float, leap: float = LEAP) -> float | None:
    """The share of a step, so well `known`, at which a test function that changes its sign is zero.

    None if it leaps over zero, by `leap` or more of what it is at the ends, or a point is not found.
    """
    try:
        first, last = test(at[0.0]), test(at[1.0])
        if not first * last < 0:
            return None
        share = brentq(lambda share: test(at[share]), 0.0, 1.0, xtol=known, rtol=8.9e-16)
        small = abs(test(at[share])) < leap * max(abs(first), abs(last))
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
        except OrbitError:
            break
    return low, high
