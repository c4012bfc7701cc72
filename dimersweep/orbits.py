"""Give `dimersweep.analysis.orbits`, and the edges of basins beside it, their public names."""

from dimersweep.analysis import orbits
from dimersweep.analysis.attractors.edges import Edge, edge
from dimersweep.analysis.orbits import *  # noqa: F403 - all that is public there

__all__ = orbits.__all__ + ["Edge", "edge"]  # noqa: RUF005 - of names only
