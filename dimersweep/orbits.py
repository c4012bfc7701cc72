"""Give `dimersweep.analysis.orbits` its public name."""

from dimersweep.analysis.orbits import *  # noqa: F403 - all that is public there
from dimersweep.analysis.orbits import __all__  # noqa: F401 - of `import *`, too
