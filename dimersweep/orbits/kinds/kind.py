"""What a kind of border is: its name, its condition on an orbit, and how it is drawn."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import numpy as np

from dimersweep.orbits.branch import Mark, Point
from dimersweep.orbits.poincare import Image, OrbitLost
from dimersweep.orbits.word import Sides

COMPLEX = 1e-7  # imaginary part from which on a pair of multipliers is complex


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """A kind of border.

    `curve` makes the curve of a kind, from the parameter that is solved for, all parameters, the spin and the accuracy of the
    map (`curve.Curve`); the class of the curve enters itself.

    Attributes
    ----------
    name : str
        As `orbits.border` takes it.
    meaning : str
        What happens to the orbit there.
    color, marker : str
        Of its curves, and of its points on branches, in pictures.
    ball : callable, optional
        Gamma of this border for a ball that bounces once a period, from e.
    senses : tuple of float
        Of the parameter, in which the border is looked for from an orbit.
    shares : tuple of float
        Of the way from the ball's fold to its flip, where those orbits are looked for.
    doubles : bool
        Whether the period is doubled there.
    """

    name: str
    meaning: str
    color: str
    marker: str
    ball: Callable[[float], float] | None = None
    senses: tuple[float, float] = (1.0, -1.0)
    shares: tuple[float, ...] = (0.3, 0.1, 0.6, 0.8, 0.2, 0.05)
    curve: ClassVar[Callable[..., Any]]
    rows: ClassVar[int] = 0  # real vectors that make the eigenvector there: 1 or 2; 0 where multipliers say nothing
    of_word: ClassVar[bool] = False  # whether the word changes there
    doubles: bool = False

    @property
    def has_equation(self) -> bool:
        """Whether it is where a function of the orbit is zero."""
        return self.rows > 0

    def test(self, point: Point) -> float:
        """A function of a point of a branch that changes its sign at the border; NaN if there is none."""
        return float("nan")

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
    def test(self, point: Point) -> float:
        """A function of a point of a branch that changes its sign at the border."""

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
        """The rows of the eigenvector, as nearly as J has them, and what is not known of the multiplier.

        Raises
        ------
        OrbitLost
            If J has no multiplier of this kind.
        """


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

    def others(self, values: np.ndarray) -> np.ndarray:
        return np.delete(values, np.argmin(np.abs(self.away(values)))) if values.size else values

    def begin(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.linalg.svd(J - self.at * np.eye(len(J)))[2][-1:], np.empty(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComplexPair(Bifurcation):
    """A border at which one number that makes up a complex pair of multipliers is given, and the other is not known."""

    rows = 2

    @abstractmethod
    def unknown(self, value: complex) -> float:
        """What is not known of the multiplier, if it is about `value`."""

    def others(self, values: np.ndarray) -> np.ndarray:
        pairs = np.flatnonzero(values.imag != 0)
        return np.delete(values, pairs[np.argsort(np.abs(self.away(values[pairs])))[:2]])

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
    """A border at which the word of the orbit changes.

    Attributes
    ----------
    leads : callable
        Whether a change from one word to another one is of this kind.
    begins : str
        Only symbols that begin so are compared.
    zero : callable, optional
        From the sides of a change, the function of the orbit that is zero there, if one is known.
    lines : callable, optional
        Numbers of a motion of which one changes its sign wherever such a change is, if they are known.
    """

    leads: Callable[[str, str], bool]
    begins: str = ""
    zero: Callable[[Sides], Mark | None] | None = None
    lines: Callable[[Image], np.ndarray] | None = None
    color: str = "#009e73"
    marker: str = "|"
    of_word = True

    @property
    def has_equation(self) -> bool:
        return self.zero is not None

    def mark(self, sides: Sides) -> Mark | None:
        """The function of the orbit that is zero where the words on both sides change into one another, if one is known."""
        return self.zero(sides) if self.zero else None
