"""Give `dimersweep.analysis.fits` its public name."""

from dimersweep.analysis.fits import *  # noqa: F403 - all that is public there
from dimersweep.analysis.fits import __all__  # noqa: F401 - of `import *`, too
