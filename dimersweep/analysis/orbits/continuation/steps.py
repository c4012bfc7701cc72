"""Steps along curves of solutions in pseudo-arclength, and search within a step for a zero or a change.

The points of a curve find their neighbours themselves. They are points of a branch of orbits (`solution.Solution`), or of a
border in the plane of two parameters (`plane_curve.InPlane`). A step goes along the tangent, and back to the curve on
the plane across it (Keller; Kuznetsov, doi 10.1007/978-3-031-22007-4, section 10.2).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from scipy.optimize import brentq

from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, require, singular_lost
from dimersweep.errors import OrbitError

LOCATED = 1e-9  # accuracy of a zero, in the parameter over its scale, or as a share of a step
# value of a test function at its zero, over its values at the ends of the step, above which it leaps over zero instead.
# The second is for a free spin, where the function is less accurate
LEAP, SLOW_LEAP = 1e-3, 1e-2
# least product of the tangents (of length 1) at both ends of a step, at 46 degrees: a longer step could go over to
# another curve
SAME_WAY = 0.7


class StepLengths(NamedTuple):
    """Lengths of the steps along a curve, in its unknowns."""

    first: float
    longest: float
    shortest: float
    growth: float  # largest ratio of a step to the one before
    tries: int  # largest number of steps, with those that fail


# for a curve whose points are wanted themselves; whoever asks bounds their number
FOLLOWING = StepLengths(first=0.02, longest=0.25, shortest=1e-6, growth=1.3, tries=1_000_000)
# for a curve along which an event is looked for: points in between are not wanted
SEARCHING = StepLengths(first=0.1, longest=0.1, shortest=1e-5, growth=1.5, tries=120)


class OnCurve(Protocol):
    """A point of a curve, which has one equation less than unknowns; the last unknown is a parameter over its scale."""

    @property
    def y(self) -> np.ndarray:
        """Unknowns, shape (n + 1,)."""

    @property
    def tangent(self) -> np.ndarray:
        """Tangent of length 1 in the sense of the curve, shape (n + 1,)."""

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> Self:
        """Find the point of the curve on the plane through `y` across `normal`, in the section of this point."""

    def judge(self, to: Self, step: float) -> None:
        """Require that a step to another point is not too long: the curve may turn between the two."""

    def settled(self, simplest: bool = True) -> Self:
        """Return the point in the section that suits the next step.

        With `simplest`, a section in which fewer coordinates are free suits better.
        """

    def elsewhere(self) -> Iterable[Self]:
        """Return the point in other sections, for a curve that does not go on in its own."""


P = TypeVar("P", bound=OnCurve)
T = TypeVar("T")


def steps(begin: P, lengths: StepLengths, window: tuple[float, ...] = ()) -> Iterator[tuple[P, P, float | None]]:
    """Yield the steps of a curve from a point on, in the sense of its tangent; the orbit is lost where the curve ends.

    Parameters
    ----------
    begin : OnCurve
        First point.
    lengths : StepLengths
    window : tuple of float
        Values of the last unknown at which to stop.

    Yields
    ------
    a, b : OnCurve
        Both ends of a step, in one section.
    edge : float or None
        Value of the window that `b` lies at, which makes the step the last one; else None.
    """
    point, step = begin, lengths.first
    others: list[P] | None = None  # the point in other sections, once the curve does not go on in its own
    for _ in range(lengths.tries):
        try:
            nxt, edge = _stepped(point, step, window)
        except OrbitLost:
            step *= 0.5
            if step < lengths.shortest:  # the contact at the section may end here, while the curve goes on
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
    """Return the point a step further and None, or the point at an edge of the window on the way, and the edge."""
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
    """Find the point at which the last unknown is `edge`, a value between `y` and `ahead`, from a point nearby."""
    at = y + (edge - y[-1]) / (ahead[-1] - y[-1]) * (ahead - y)
    at[-1] = edge
    return near.on_plane(at, np.eye(at.size)[-1])


class Between(dict[float, T]):
    """Points of a step by their share of the way from `a` to `b`, each found once.

    ``found(before, after, part, share)`` returns the point at a share of the way, which lies a `part` of the way from
    one known point to the next.
    """

    def __init__(self, a: T, b: T, found: Callable[[T, T, float, float], T]) -> None:
        super().__init__({0.0: a, 1.0: b})
        self.found = found

    def __missing__(self, share: float) -> T:
        low, high = max(known for known in self if known < share), min(known for known in self if known > share)
        self[share] = self.found(self[low], self[high], (share - low) / (high - low), share)
        return self[share]


def on_line(a: P, b: P) -> Between[P]:
    """Return the points of a step on planes across the way from `a` to `b`, each found from the nearer end."""
    way = b.y - a.y
    normal = way / float(np.linalg.norm(way))
    return Between(a, b, lambda _a, _b, _part, share: (a if share < 0.5 else b).on_plane(a.y + share * way, normal))


def zero(at: Mapping[float, T], test: Callable[[T], float], known: float, leap: float = LEAP) -> float | None:
    """Find the share of a step at which a test function is zero, with an error of at most `known`.

    Return None if the function does not change its sign, if it leaps over zero, or if a point is not found, or without
    value. It leaps if its size at the change of sign is at least `leap` times the larger one of its sizes at the ends.
    """

    def value(share: float) -> float:
        found = test(at[share])
        require(not np.isnan(found), "a function of the orbit has no value there")
        return found

    @singular_lost()
    def share_of_zero() -> float | None:
        first, last = test(at[0.0]), test(at[1.0])
        if not first * last < 0:
            return None
        # rtol is the least that brentq takes: `known` decides
        share = float(brentq(value, 0.0, 1.0, xtol=known, rtol=8.9e-16))
        return share if abs(test(at[share])) < leap * max(abs(first), abs(last)) else None

    return attempt(share_of_zero)


def halved(read: Callable[[float], Any], low: float, high: float, within: float) -> tuple[float, float]:
    """Halve the interval from `low` to `high` down to a width of `within`, and return its ends around a change.

    `read` returns the same at the first end as at `low`, and something else at the second. The interval stays wider
    where `read` raises an OrbitError, or where no number lies between the ends.
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
