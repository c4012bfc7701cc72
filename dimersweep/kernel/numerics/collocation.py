"""Radau IIA nodes and weights, and how fast what they integrate converges: computed from their definition.

Hairer, Wanner, Solving Ordinary Differential Equations II (doi 10.1007/978-3-642-05221-7), Sect. IV.5: stiffly accurate,
L-stable, of order 2 n - 1 with n nodes.
"""

import numpy as np
from numpy.polynomial import Polynomial

NODES = 5


def _nodes(n):
    """Zeros of d^(n-1)/dx^(n-1) of x^(n-1) (x - 1)^n, the last of which is 1."""
    x = np.sort((Polynomial([0.0, 1.0]) ** (n - 1) * Polynomial([-1.0, 1.0]) ** n).deriv(n - 1).roots().real)
    x[-1] = 1.0
    return x


def _weights(c):
    """Integrals from 0 to each node of the polynomials that are 1 at one node and 0 at the others."""
    powers = np.vander(c, increasing=True)
    integrals = c[:, None] ** np.arange(1, c.size + 1) / np.arange(1, c.size + 1)
    return np.linalg.solve(powers.T, integrals.T).T


def _leading(x):
    """Weights of the amplitude of the highest Chebyshev polynomial of what is interpolated at x in [0, 1]."""
    return np.array([1.0 / np.prod(2.0 * (x[k] - np.delete(x, k))) for k in range(x.size)]) / 2.0 ** (x.size - 2)


RADAU_C = _nodes(NODES)
RADAU_A = _weights(RADAU_C)
# amplitudes of the two highest Chebyshev polynomials, from the start and the nodes, and from the nodes alone
TOP = _leading(np.concatenate([[0.0], RADAU_C]))
NEXT = _leading(RADAU_C)
