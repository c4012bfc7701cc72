"""Kinds of borders: their names, their conditions on an orbit, and how they are drawn.

A kind in `BORDER_KINDS` is known to curves, branches, files, pictures and pages.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import ClassVar

import numpy as np

from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.analysis.orbits.map.lost import require
from dimersweep.analysis.orbits.map.manifold import growth_in_plane
from dimersweep.analysis.orbits.map.passage import TURN, Passage, Sides
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import Mark, Solution, fixed_at
from dimersweep.kernel.verdict.past import HOP_LINE

COMPLEX = 1e-7  # imaginary part from which on a pair of multipliers counts as complex: a smaller one may be round-off
# distance of the longest hop at the border of hops from half a period, in forcing periods, towards this side: there the
# sequence is that of this side for certain
HOP_ASIDE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """A kind of border; `curves.CURVE_OF_KIND` has the curve of each class of kinds."""

    name: str  # name that `orbits.border` takes
    meaning: str  # event of the orbit at the border, in words
    color: str  # colour of its curves, and of its points on branches, in pictures
    marker: str
    # Gamma of this border, as a function of e, for a ball that bounces once a period
    ball: Callable[[float], float] | None = None
    # senses of the parameter in which the border is looked for from an orbit, in the order of trial
    senses: tuple[float, ...] = (1.0, -1.0)
    # shares of the way in Gamma from the ball's fold to its flip at which these orbits begin, in the order of trial
    shares: tuple[float, ...] = (0.3, 0.1, 0.6, 0.8, 0.2, 0.05)
    # number of real vectors that make up the eigenvector at the border, 1 or 2; 0 if it is no border of multipliers
    rows: ClassVar[int] = 0
    of_sequence: ClassVar[bool] = False  # True if the sequence changes at the border
    doubles: bool = False  # True if the period doubles at the border
    # makes, from the sides of a change of sequence, the function of the orbit that is zero at the change, if there is
    # one
    zero: Callable[[Sides], Mark | None] | None = None

    @property
    def has_equation(self) -> bool:
        """True if the border lies at the zero of a function of the orbit."""
        return self.rows > 0 or self.zero is not None

    def test(self, point: Solution) -> float:
        """Return a function of a point of a branch that changes its sign at the border; NaN if there is none."""
        return float("nan")

    def holds(self, point: Solution) -> bool:
        """Return True if a point where the test function is zero is a point of the border."""
        return True

    def others(self, values: np.ndarray) -> np.ndarray:
        """Return the multipliers without those whose value the border fixes: from all multipliers of an orbit on it."""
        return values

    def is_all(self, values: np.ndarray) -> bool:
        """Return True if the `others` of an orbit on the border are below 1 in size: no other border ends stability."""
        return bool((np.abs(self.others(values)) < 1).all())

    def crossing(self, real: np.ndarray) -> float:
        """Return a function that changes its sign where another border meets this one.

        Its argument has the real multipliers on the other border, without those that the other border fixes.
        """
        return float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bifurcation(Kind, ABC):
    """A border at which a multiplier of the orbit, or a pair of multipliers, has a certain value.

    The derivative J of the map has an eigenvector to this multiplier: one real vector, or the real and the imaginary
    part of a complex vector.
    """

    @abstractmethod
    def multiplier(self, unknown: np.ndarray) -> complex:
        """Return the multiplier at the border from its unknown number, shape (1,), or (0,) if the border fixes all."""

    def slope(self, unknown: np.ndarray) -> complex:
        """Return the derivative of the multiplier by its unknown number."""
        raise NotImplementedError

    @abstractmethod
    def away(self, values: np.ndarray) -> np.ndarray:
        """Return the distances of multipliers from their value at the border, each 0 on it."""

    @abstractmethod
    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the eigenvector, shape (rows, n), and the unknown number of the multiplier, from J.

        J is the derivative of the map near the border.
        """

    def others(self, values: np.ndarray) -> np.ndarray:
        mine = np.arange(values.size) if self.rows == 1 else np.flatnonzero(values.imag != 0)
        return np.delete(values, mine[np.argsort(np.abs(self.away(values[mine])))[: self.rows]])


@dataclass(frozen=True, kw_only=True, eq=False)
class RealMultiplier(Bifurcation):
    """A border at which a multiplier has the value `at`, 1 or -1."""

    at: float
    rows = 1

    def test(self, point: Solution) -> float:
        """Return the product of (multiplier - `at`) over all multipliers."""
        return float(np.linalg.det(point.matrix - self.at * np.eye(len(point.matrix))))

    def crossing(self, real: np.ndarray) -> float:
        return float(prod(1 - self.at * real))

    def multiplier(self, unknown: np.ndarray) -> complex:
        return complex(self.at)

    def away(self, values: np.ndarray) -> np.ndarray:
        return values - self.at

    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.linalg.svd(J - self.at * np.eye(len(J)))[2][-1:], np.empty(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComplexPair(Bifurcation):
    """A border at which one of the two numbers of a complex pair of multipliers is fixed, and the other is unknown."""

    rows = 2

    @abstractmethod
    def unknown(self, value: complex) -> float:
        """Return the unknown number of a multiplier near the border from its value."""

    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eig(J)
        pairs = np.flatnonzero(values.imag > 0)
        require(pairs.size, "the multipliers have no complex pair")
        k = pairs[int(np.argmin(np.abs(self.away(values[pairs]))))]
        q = vectors[:, k]
        q = q * np.exp(-0.5j * np.angle(q @ q))  # this makes its real part orthogonal to its imaginary part
        return np.array([q.real, q.imag]), np.array([self.unknown(values[k])])


@dataclass(frozen=True, kw_only=True, eq=False)
class Change(Kind):
    """A border at which the sequence of the orbit changes."""

    leads: Callable[[str, str], bool]  # returns True if a change from one sequence to another is of this kind
    begins: str = ""  # first letters of the symbols that are compared
    # returns numbers of a motion, of which one changes its sign at each change of this kind, if such numbers are known
    lines: Callable[[Passage], np.ndarray] | None = None
    color: str = "#009e73"
    marker: str = "|"
    of_sequence = True

    def mark(self, sides: Sides) -> Mark | None:
        """Return the function of the orbit that is zero at a change with these sides, or None if none is known."""
        return self.zero(sides) if self.zero else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold(RealMultiplier):
    """A border at which a multiplier is 1, and the branch turns back in the parameter."""

    def test(self, point: Solution) -> float:
        """Return the entry of the parameter in the tangent of the branch."""
        return float(point.tangent[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Torus(ComplexPair):
    """A border at which a complex pair of multipliers has size 1; the unknown number is its angle."""

    def test(self, point: Solution) -> float:
        """Return the squared size of the largest complex pair less 1; -1.0 without a complex pair."""
        values = np.linalg.eigvals(point.matrix)
        pairs = values[np.abs(values.imag) > COMPLEX]
        return float((np.abs(pairs) ** 2 - 1).max()) if pairs.size else -1.0

    def multiplier(self, unknown: np.ndarray) -> complex:
        return complex(np.exp(1j * unknown[0]))

    def slope(self, unknown: np.ndarray) -> complex:
        return 1j * self.multiplier(unknown)

    def away(self, values: np.ndarray) -> np.ndarray:
        """Return the sizes of multipliers less 1."""
        return np.abs(values) - 1

    def unknown(self, value: complex) -> float:
        """Return the angle of the multiplier [rad]."""
        return float(np.angle(value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Pitchfork(Kind):
    """A border at which a motion in a plane begins or ceases to attract motions with a spin.

    Two sustained spins, mirror images of each other, part from the motion there.
    """

    @property
    def has_equation(self) -> bool:
        """True: the growth of a small spin is zero."""
        return True

    def test(self, point: Solution) -> float:
        """Return the growth of a small spin in a period; NaN on branches that are not in a plane."""
        return growth_in_plane(point)[0] if point.axis.spin == 0.0 else float("nan")

    def holds(self, point: Solution) -> bool:
        """Return True if the drift is smooth: if it is not, a small enough spin grows, or falls, on both sides."""
        return growth_in_plane(point)[1]

    def mark(self, m: ReturnMap, passage: Passage) -> float:
        """Return the growth of a small spin beside the motion of an image.

        It is scaled up, so that it counts as much in Newton's method as the other equations.
        """
        return growth_in_plane(fixed_at(m, passage.point))[0] / m.one_sided


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityEnd(Kind):
    """The end of the stability or of the existence of a stable orbit, whatever the kind of border there."""

    def others(self, values: np.ndarray) -> np.ndarray:
        """Return no multipliers: each of them may be the one that reaches size 1."""
        return values[:0]


def _changed(old: str, new: str) -> set[str]:
    """Return the symbols that only one of two sequences has."""
    return set(old.split()) ^ set(new.split())


def _over_line(passage: Passage, end: int) -> float:
    """Return the length of the longest hop of an end less half a period, in forcing periods."""
    return passage.hops[end] / TURN - HOP_LINE


def _hop_over_line(sides: Sides) -> Mark | None:
    """Return the function of the longest hop that is zero at a change of hops; None if the hops of both ends change."""
    if len(sides.least) != 1:
        return None
    (symbol,) = sides.least
    end, aside = int(symbol[-1]) - 1, HOP_ASIDE if sides.more[symbol] else -HOP_ASIDE
    return lambda _, passage: _over_line(passage, end) - aside


FOLD = Fold(
    name="fold",
    meaning="a multiplier is 1: two orbits meet and vanish",
    color="#0072b2",
    marker="s",
    at=1.0,
    ball=ball_fold,
    senses=(-1.0, 1.0),
    shares=(0.05, 0.3, 0.6, 0.1, 0.2),
)
FLIP = RealMultiplier(
    name="flip",
    meaning="a multiplier is -1: a motion of twice the period begins",
    color="#d62728",
    marker="D",
    at=-1.0,
    doubles=True,
    ball=ball_flip,
)
TORUS = Torus(
    name="torus",
    meaning="a complex pair of multipliers has size 1: a motion with two periods begins (Neimark-Sacker)",
    color="#e69f00",
    marker="o",
)
PITCHFORK = Pitchfork(
    name="pitchfork",
    meaning="a motion in a plane begins or ceases to attract motions with a spin: two sustained spins part from it",
    color="#cc79a7",
    marker="P",
)
STABLE_FROM = StabilityEnd(
    name="stable_from",
    meaning="the least value to which the orbit that runs come to stays stable, whatever happens to it there",
    color="#56b4e9",
    marker="^",
    senses=(-1.0,),
)
STABLE_TO = StabilityEnd(
    name="stable_to",
    meaning="the greatest value to which the orbit that runs come to stays stable, whatever happens to it there",
    color="#56b4e9",
    marker="v",
    senses=(1.0,),
)
HOP = Change(
    name="hop",
    meaning="the longest hop of an end passes half a forcing period",
    leads=lambda old, new: {symbol[:3] for symbol in _changed(old, new)} == {"far"},
    begins="far",
    zero=_hop_over_line,
    lines=lambda passage: np.array([_over_line(passage, end) for end in (0, 1)]),
)
CHATTER = Change(
    name="chatter",
    meaning="the hops of an end begin or cease to die out",
    leads=lambda old, new: any(symbol.startswith(("chatter", "bounces")) for symbol in _changed(old, new)),
)
DOUBLE_IMPACT = Change(
    name="double_impact",
    meaning="the phases of the double impact change",
    leads=lambda old, new: any(symbol.startswith("DI") for symbol in _changed(old, new)),
)
LIFT_OFFS = Change(
    name="lift_off",
    meaning="the number of lift-offs changes",
    leads=lambda old, new: old.split().count("FM") != new.split().count("FM"),
)
STICK_SLIP = Change(
    name="stick_slip",
    meaning="the order of sticking and slipping changes",
    leads=lambda old, new: old != new,
)
ANY_CHANGE = Change(name="word", meaning="any of the changes of sequence", leads=lambda old, new: old != new)
# kinds of changes in the order in which they are asked: a change is of the first kind whose `leads` is true, and the
# last one takes them all
CHANGES = (HOP, CHATTER, DOUBLE_IMPACT, LIFT_OFFS, STICK_SLIP)


def change_of(old: str, new: str) -> Change:
    """Return the kind of change that leads from one sequence to another."""
    return next(kind for kind in CHANGES if kind.leads(old, new))


BORDER_KINDS: dict[str, Kind] = {
    kind.name: kind for kind in (FOLD, FLIP, TORUS, PITCHFORK, STABLE_FROM, STABLE_TO, ANY_CHANGE, *CHANGES[::-1])
}


def kind_words() -> tuple[str, ...]:
    """Return the words for kinds of borders in a table: "none", and the names of `BORDER_KINDS`."""
    return ("none", *BORDER_KINDS)
