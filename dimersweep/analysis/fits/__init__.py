"""Fit parameters to a measured orbit: the best values, what the data leave open, and whether any parameters give the
data.

Examples
--------
>>> from dimersweep import fits
>>> fit = fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)})
>>> fit.possible, round(fit.values["e"], 2)
(True, 0.65)
"""

from dimersweep.analysis.fits.fitting import Fit, fit
from dimersweep.analysis.fits.likelihood import Likelihood
from dimersweep.analysis.fits.measured import Measured
from dimersweep.analysis.fits.tracks import Track, circle, cycloid
from dimersweep.analysis.fits.waveform import Waveform

__all__ = ["Fit", "Likelihood", "Measured", "Track", "Waveform", "circle", "cycloid", "fit"]
