"""With a third harmonic the plate carries a dimer at rest as it should, no ball goes into it, and the energy closes."""

from math import pi

import numpy as np

from dimersweep import simulate

run = simulate(Gamma=0.9, periods=2, rtol=1e-9)
states = run.states(np.linspace(0, run.duration, 100))
assert min(states["gap_1"].min(), states["gap_2"].min()) >= -1e-14
assert run.energy().closure < 1e-8

rest = simulate(Gamma=0.4, beta0=0.0, xdot0=0.0, periods=3)
angle = np.linspace(0.3, 6.0, 30)
states = rest.states((2 * 2 * pi + angle) / (2 * pi * 15))
weight = (states["normal_force_1"] + states["normal_force_2"]).values
felt = 9.81 * (1 - 0.4 * (np.sin(angle) + 9 * 0.05 * np.sin(3 * angle)))
assert np.ptp(weight / felt) < 1e-9 * weight.max() / 9.81
heights = states["plate"].values
assert np.allclose(heights, 0.4 * 9.81 / (2 * pi * 15) ** 2 * (np.sin(angle) + 0.05 * np.sin(3 * angle)), rtol=1e-12)
