import numpy as np
from scipy.stats import qmc

import dimersweep

run = dimersweep.simulate(Gamma=0.9, f=15, beta0="16 deg", periods=200)
run.save("walk.nc", force=True)
print(dimersweep.load_run("walk.nc").orbit.radius)  # in m

low, high = {"e": 0.5, "Gamma": 0.6, "beta0": 0.1}, {"e": 0.8, "Gamma": 1.4, "beta0": 1.4}
unit = qmc.LatinHypercube(d=3, seed=1).random(500)
table = dict(zip(low, qmc.scale(unit, list(low.values()), list(high.values())).T, strict=True))
cube = dimersweep.sweep(points=table, periods=200, out="sample.nc")
drifts = cube.dimersweep.drifts()
print(f"{100 * drifts.mean().item():.0f} % of the points drift")

clicked = int(np.flatnonzero(drifts)[0])
behind = cube.dimersweep.run(point=clicked)
print(behind)
behind.animate("walk.gif", force=True)

diagram = dimersweep.bifurcation({"Gamma": np.linspace(0.9, 1.6, 141)}, periods=400, strobes=40)
diagram.dimersweep.plot("bifurcation", "bifurcation.png", force=True)
