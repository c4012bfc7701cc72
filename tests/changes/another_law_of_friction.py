"""A flat dimer that slides along its axis slows down by the friction of its speed, and the energy of a walk closes."""

import numpy as np
from scipy.integrate import quad

from dimersweep import simulate

FLAT = {"Gamma": 0.0, "beta0": 0.0, "xdot0": 0.0, "ydot0": 0.8, "mu": 0.2, "mu_s": 0.4}

run = simulate(**FLAT, periods=3, rtol=1e-10)
speed = np.hypot(run.states([0.0, 0.15])["x1_rate"], run.states([0.0, 0.15])["y1_rate"]).values
took, _ = quad(lambda v: 1 / (9.81 * 0.2 * (1 + 0.5 / (1 + v / 0.1))), speed[1], speed[0])
assert speed[0] == 0.8
assert abs(took - 0.15) < 1e-9
assert run.energy().closure < 1e-9

walk = simulate(periods=2, rtol=1e-9)
assert walk.energy().closure < 1e-8
