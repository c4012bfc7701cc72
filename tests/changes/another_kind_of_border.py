"""The border is found over values of a parameter, and is where it says."""

from dimersweep import orbits
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS

SPIN = 100.0

assert BORDER_KINDS["halved"].marker == "h"
border = orbits.border("halved", "Gamma", {"mu": [0.15]}, spin=SPIN)
assert border["status"].values.tolist() == ["ok"]
orbit = orbits.find(Gamma=float(border["Gamma"][0]), mu=0.15, spin=SPIN)
# of the border the spin is put back at each period, of the orbit it goes on
assert abs(orbit.multipliers - 0.5).min() < 5e-3
