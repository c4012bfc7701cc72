"""A dimer that falls flat leaves the plate with the restitution of its speed; the energy of a walk closes."""

import numpy as np

from dimersweep import simulate

fall = simulate(Gamma=0.0, beta0=0.0, xdot0=0.0, gap0=0.02, e=0.8, periods=4, rtol=1e-10)
speed = np.sqrt(2 * 9.81 * 0.02)
after = np.sqrt(2 * 9.81 * fall.states(np.linspace(0.07, 0.2, 400))["gap_1"].max())
assert abs(after / speed - 0.8 / (1 + speed)) < 1e-3
assert fall.energy().closure < 1e-9
assert simulate(periods=2, rtol=1e-9).energy().closure < 1e-8
