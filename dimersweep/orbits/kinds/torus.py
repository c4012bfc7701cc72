"""The torus, or Neimark-Sacker bifurcation: a motion with two periods begins."""

from dataclasses import dataclass

import numpy as np

from dimersweep.orbits.branch import Point
from dimersweep.orbits.kinds.kind import COMPLEX, ComplexPair


@dataclass(frozen=True, kw_only=True, eq=False)
class Torus(ComplexPair):
    """A complex pair of multipliers has size 1; its angle is not known."""

    def test(self, point: Point) -> float:
        """The size of the largest complex pair, squared, less 1."""
        values = np.linalg.eigvals(point.fixed.matrix)
        pairs = values[np.abs(values.imag) > COMPLEX]
        return float((np.abs(pairs) ** 2 - 1).max()) if pairs.size else -1.0

    def multiplier(self, unknown: np.ndarray) -> complex:
        """exp(i angle)."""
        return complex(np.exp(1j * unknown[0]))

    def slope(self, unknown: np.ndarray) -> complex:
        """i exp(i angle)."""
        return 1j * self.multiplier(unknown)

    def away(self, values: np.ndarray) -> np.ndarray:
        """Sizes less 1."""
        return np.abs(values) - 1

    def unknown(self, value: complex) -> float:
        """The angle [rad]."""
        return float(np.angle(value))


TORUS = Torus(
    name="torus",
    meaning="a complex pair of multipliers has size 1: a motion with two periods begins (Neimark-Sacker)",
    color="#e69f00",
    marker="o",
)
