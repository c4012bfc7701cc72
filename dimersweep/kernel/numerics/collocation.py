"""Radau IIA nodes and weights, and a measure of how fast they converge: rounded from 60 digits, the same everywhere.

Hairer, Wanner, Solving Ordinary Differential Equations II (doi 10.1007/978-3-642-05221-7), Sect. IV.5: stiffly
accurate, L-stable, of order 2 n - 1 with n nodes. `tests/kernel/test_collocation.py` computes them from their
definition.
"""

import numpy as np

NODES = 5

# zeros of d^(n-1)/dx^(n-1) of x^(n-1) (x - 1)^n
RADAU_C = np.array([0.05710419611451768, 0.2768430136381238, 0.5835904323689168, 0.8602401356562195, 1.0])
# integrals from 0 to each node (rows) of the polynomials that are 1 at one node (columns) and 0 at the others
RADAU_A = np.array(
    [
        [0.07299886431790333, -0.02673533110794557, 0.018676929763984353, -0.01287910609330644, 0.005042839233882015],
        [0.15377523147918246, 0.14621486784749352, -0.03644456890512809, 0.02123306311930472, -0.007935579902728777],
        [0.14006304568480987, 0.29896712949128346, 0.16758507013524895, -0.03396910168661774, 0.010944288744192253],
        [0.14489430810953477, 0.2765000687601592, 0.32579792291042103, 0.12875675325490976, -0.015708917378805327],
        [0.14371356079122594, 0.28135601514946207, 0.31182652297574126, 0.22310390108357075, 0.04],
    ]
)
# weights of the values at the start and the nodes that give the amplitude of the highest Chebyshev polynomial of what
# is interpolated (TOP); the same from the nodes alone (NEXT, one degree lower)
TOP = np.array(
    [-0.24609375, 0.3904050691864792, -0.24809150989999024, 0.17988834596901018, -0.1253269052554992, 0.04921875]
)
NEXT = np.array([0.08917507053970622, -0.2747296050349829, 0.4199244704087358, -0.43124493591345914, 0.196875])
