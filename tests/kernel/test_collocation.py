"""The coefficients of the implicit steps, from their definition, to the last digit."""

from math import comb

import numpy as np
from mpmath import findroot, fprod, mp, mpf, workdps

from dimersweep.kernel.numerics.collocation import NEXT, NODES, RADAU_A, RADAU_C, TOP


def nodes():
    """Zeros of d^(n-1)/dx^(n-1) of x^(n-1) (x - 1)^n."""
    powers = {NODES - 1 + k: comb(NODES, k) * (-1) ** (NODES - k) for k in range(NODES + 1)}
    for _ in range(NODES - 1):
        powers = {power - 1: factor * power for power, factor in powers.items() if power}
    return [findroot(lambda x: sum(factor * x**power for power, factor in powers.items()), c) for c in RADAU_C]


def weight(x, k, end):
    """Integral from 0 to `end` of the polynomial that is 1 at the k-th of x and 0 at the others."""
    factors, height = [mpf(1)], mpf(1)  # of rising powers
    for zero in x[:k] + x[k + 1 :]:
        factors = [low - zero * high for low, high in zip([mpf(0), *factors], [*factors, mpf(0)], strict=True)]
        height *= x[k] - zero
    return sum(factor * end ** (n + 1) / (n + 1) for n, factor in enumerate(factors)) / height


def leading(x):
    """Weights of the amplitude of the highest Chebyshev polynomial of what is interpolated at x in [0, 1]."""
    others = [[x[k] - zero for zero in x[:k] + x[k + 1 :]] for k in range(len(x))]
    return [1 / fprod(2 * gap for gap in gaps) / 2 ** (len(x) - 2) for gaps in others]


def test_all_are_rounded_from_their_definition():
    with workdps(60):
        x = nodes()
        assert abs(x[-1] - 1) < mpf(10) ** -50
        assert RADAU_C.tolist() == [float(c) for c in x]
        assert RADAU_A.tolist() == [[float(weight(x, k, end)) for k in range(NODES)] for end in x]
        assert TOP.tolist() == [float(value) for value in leading([mp.zero, *x])]
        assert NEXT.tolist() == [float(value) for value in leading(x)]


def test_the_weights_integrate_powers():
    """Of order 2 n - 1 at the end, of order n at each node."""
    for power in range(NODES):
        np.testing.assert_allclose(RADAU_A @ RADAU_C**power, RADAU_C ** (power + 1) / (power + 1), atol=1e-16)
    for power in range(2 * NODES - 1):
        np.testing.assert_allclose(RADAU_A[-1] @ RADAU_C**power, 1 / (power + 1), rtol=1e-15)
