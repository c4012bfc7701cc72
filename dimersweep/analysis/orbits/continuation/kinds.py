"""Kinds of borders: their names, their conditions on an orbit, and how they are drawn.

A kind in `BORDER_KINDS` is known to curves, branches, files, pictures and pages.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import ClassVar

import numpy as np

from dimersweep.analysis.orbits.continuation.branch import Mark, Point
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.analysis.orbits.map.manifold import growth_in_plane
from dimersweep.analysis.orbits.map.newton import fixed_at
from dimersweep.analysis.orbits.map.passage import TURN, Sides
from dimersweep.analysis.orbits.map.poincare import Image, OrbitLost, ReturnMap
from dimersweep.kernel.verdict.past import HOP_LINE

COMPLEX = 1e-7  # imaginary part from which on a pair of multipliers is complex
HOP_ASIDE = 1e-9  # how far on this side of a hop of half a period its orbit lies, in forcing periods


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """A kind of border; `curves.CURVES` has the curve of each class of kinds."""

    name: str  # as `orbits.border` takes it
    meaning: str  # what happens to the orbit there
    color: str  # of its curves, and of its points on branches, in pictures
    marker: str
    ball: Callable[[float], float] | None = None  # Gamma of this border for a ball that bounces once a period, from e
    senses: tuple[float, ...] = (1.0, -1.0)  # of the parameter, in which the border is looked for from an orbit
    # of the way from the ball's fold to its flip, where those orbits are looked for
    shares: tuple[float, ...] = (0.3, 0.1, 0.6, 0.8, 0.2, 0.05)
    rows: ClassVar[int] = 0  # real vectors that make the eigenvector there: 1 or 2; 0 where multipliers say nothing
    of_sequence: ClassVar[bool] = False  # whether the sequence changes there
    doubles: bool = False  # whether the period is doubled there
    # from the sides of a change of sequence, the function of the orbit that is zero there, if one is known
    zero: Callable[[Sides], Mark | None] | None = None

    @property
    def has_equation(self) -> bool:
        """Whether it is where a function of the orbit is zero."""
        return self.rows > 0 or self.zero is not None

    def test(self, point: Point) -> float:
        """A function of a point of a branch that changes its sign at the border; NaN if there is none."""
        return float("nan")

    def holds(self, point: Point) -> bool:
        """Whether the border is at a point where its test function is zero."""
        return True

    def others(self, values: np.ndarray) -> np.ndarray:
        """Of multipliers at the border, those that it does not concern."""
        return values

    def is_all(self, values: np.ndarray) -> bool:
        """Whether nothing but this border takes stability away: of multipliers there, all others are below 1 in size."""
        return bool((np.abs(self.others(values)) < 1).all())

    def crossing(self, real: np.ndarray) -> float:
        """A function of the real multipliers on another border, less its own, that changes its sign where it meets this one."""
        return float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bifurcation(Kind, ABC):
    """A border at which a multiplier of the orbit, or a pair of them, has a certain value.

    The derivative J of the map has an eigenvector to the multiplier there: one real vector, or the real and the imaginary
    part of a complex one.
    """

    @abstractmethod
    def multiplier(self, unknown: np.ndarray) -> complex:
        """The multiplier at the border, from what is not known of it (nothing, or one number)."""

    def slope(self, unknown: np.ndarray) -> complex:
        """Derivative of the multiplier by what is not known of it."""
        raise NotImplementedError

    @abstractmethod
    def away(self, values: np.ndarray) -> np.ndarray:
        """How far multipliers are from the border."""

    @abstractmethod
    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rows of the eigenvector, as nearly as J has them, and what is not known of the multiplier; lost without one."""

    def others(self, values: np.ndarray) -> np.ndarray:
        mine = np.arange(values.size) if self.rows == 1 else np.flatnonzero(values.imag != 0)
        return np.delete(values, mine[np.argsort(np.abs(self.away(values[mine])))[: self.rows]])


@dataclass(frozen=True, kw_only=True, eq=False)
class RealMultiplier(Bifurcation):
    """A border at which a multiplier is `at`, 1 or -1."""

    at: float
    rows = 1

    def test(self, point: Point) -> float:
        """The product of all multipliers less `at`."""
        return float(np.linalg.det(point.fixed.matrix - self.at * np.eye(len(point.fixed.matrix))))

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
    """A border at which one number that makes up a complex pair of multipliers is given, and the other is not known."""

    rows = 2

    @abstractmethod
    def unknown(self, value: complex) -> float:
        """What is not known of the multiplier, if it is about `value`."""

    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eig(J)
        pairs = np.flatnonzero(values.imag > 0)
        if not pairs.size:
            raise OrbitLost("the multipliers have no complex pair")
        k = pairs[int(np.argmin(np.abs(self.away(values[pairs]))))]
        q = vectors[:, k]
        q = q * np.exp(-0.5j * np.angle(q @ q))  # its real part is then across its imaginary part
        return np.array([q.real, q.imag]), np.array([self.unknown(values[k])])


@dataclass(frozen=True, kw_only=True, eq=False)
class Change(Kind):
    """A border at which the sequence of the orbit changes."""

    leads: Callable[[str, str], bool]  # whether a change from one sequence to another one is of this kind
    begins: str = ""  # only symbols that begin so are compared
    # numbers of a motion of which one changes its sign wherever such a change is, if they are known
    lines: Callable[[Image], np.ndarray] | None = None
    color: str = "#009e73"
    marker: str = "|"
    of_sequence = True

    def mark(self, sides: Sides) -> Mark | None:
        """The function of the orbit that is zero where the sequences on both sides change into one another, if one is known."""
        return self.zero(sides) if self.zero else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold(RealMultiplier):
    """A multiplier is 1, and the branch turns back in the parameter."""

    def test(self, point: Point) -> float:
        """The parameter's part in the tangent of the branch."""
        return float(point.tangent[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Torus(ComplexPair):
    """A complex pair of multipliers has size 1; its angle is not known."""

    def test(self, point: Point) -> float:
        """The size of the largest complex pair, squared, less 1."""
        values = np.linalg.eigvals(point.fixed.matrix)
        pairs = values[np.abs(values.imag) > COMPLEX]
        return float((np.abs(pairs) ** 2 - 1).max()) if pairs.size else -1.0

    def multiplier(self, unknown: np.ndarray) -> complex:
        return complex(np.exp(1j * unknown[0]))

    def slope(self, unknown: np.ndarray) -> complex:
        return 1j * self.multiplier(unknown)

    def away(self, values: np.ndarray) -> np.ndarray:
        """Sizes less 1."""
        return np.abs(values) - 1

    def unknown(self, value: complex) -> float:
        """The angle [rad]."""
        return float(np.angle(value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Pitchfork(Kind):
    """What moves in a plane begins or ceases to attract motions with a spin: two of them, mirror images, part from it."""

    @property
    def has_equation(self) -> bool:
        """Always."""
        return True

    def test(self, point: Point) -> float:
        """How a small spin grows; NaN but on branches in a plane."""
        return growth_in_plane(point.fixed)[0] if point.axis.spin == 0.0 else float("nan")

    def holds(self, point: Point) -> bool:
        """Whether the drift is smooth there: else a spin that is small enough grows, or falls, on both sides."""
        return growth_in_plane(point.fixed)[1]

    def mark(self, m: ReturnMap, image: Image) -> float:
        """How a small spin grows beside the motion of an image, in a unit that makes it as large as other equations."""
        return growth_in_plane(fixed_at(m, image.point))[0] / m.one_sided


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityEnd(Kind):
    """Where a stable orbit ceases to be stable, or to be, whatever the kind of border there."""

    def others(self, values: np.ndarray) -> np.ndarray:
        """None."""
        return values[:0]


def _changed(old: str, new: str) -> set[str]:
    """Symbols that only one of two sequences has."""
    return set(old.split()) ^ set(new.split())


def _over_line(image: Image, end: int) -> float:
    """How much longer than half a period the longest hop of an end is, in forcing periods."""
    return image.passage.hops[end] / TURN - HOP_LINE


def _hop_over_line(sides: Sides) -> Mark | None:
    """How much longer than half a period the longest hop of an end is; none if the hops of both ends change."""
    if len(sides.least) != 1:
        return None
    (symbol,) = sides.least
    end, aside = int(symbol[-1]) - 1, HOP_ASIDE if sides.more[symbol] else -HOP_ASIDE
    return lambda _, image: _over_line(image, end) - aside


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
    lines=lambda image: np.array([_over_line(image, end) for end in (0, 1)]),
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
CHANGES = (HOP, CHATTER, DOUBLE_IMPACT, LIFT_OFFS, STICK_SLIP)  # a change is of the first kind that leads to it


def change_of(old: str, new: str) -> Change:
    """The kind of change that leads from one sequence to another one."""
    return next(kind for kind in CHANGES if kind.leads(old, new))


BORDER_KINDS: dict[str, Kind] = {
    kind.name: kind for kind in (FOLD, FLIP, TORUS, PITCHFORK, STABLE_FROM, STABLE_TO, ANY_CHANGE, *CHANGES[::-1])
}


def kind_words() -> tuple[str, ...]:
    """What a kind of border may be in a table: none, or one of those that are registered."""
    return ("none", *BORDER_KINDS)
