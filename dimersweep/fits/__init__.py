"""Fits: which parameters give the orbit that was measured, what the data leave open, and what no parameters give.

Examples
--------
>>> from dimersweep import fits
>>> fit = fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)})
>>> fit.possible, round(fit.values["e"], 2)
(True, 0.65)
"""

from dimersweep.fits.fitting import Fit, fit
from dimersweep.fits.likelihood import Likelihood
from dimersweep.fits.measured import Measured
from dimersweep.fits.tracks import Track, circle, cycloid
from dimersweep.fits.waveform import Waveform

__all__ = ["Fit", "Likelihood", "Measured", "Track", "Waveform", "circle", "cycloid", "fit"]
