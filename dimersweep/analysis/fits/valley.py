"""Valleys of the misfit: all values that give the data, where these leave something open, and the errors from them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

# change of the data over a range, in errors, below which a direction is open: the standard deviation would be greater
# than 1 / 12**0.5 ranges, which a uniform density over the range has without any data
FEW_ERRORS = 12**0.5
ONE_ERROR = 0.6827  # share of a normal density within one standard deviation
BEYOND = 10.0  # standard deviations beyond which a normal density is nothing
AS_GOOD = 1.0  # misfit above the least one that is one standard deviation from the best values


@dataclass(frozen=True, eq=False)
class Valley:
    """Points that cover all values which give the data about as well as the best ones, evenly in the ranges.

    Together they stand for the likelihood, with each parameter as likely anywhere in its range. Around a point the
    density is normal across the valley, by the slopes there, and uniform along it.

    Attributes
    ----------
    values : ndarray, shape (p, n)
        Free parameters at the points.
    rises : ndarray, shape (p,)
        Misfit above the least one. It is the profile of each parameter, since the other parameters are the best for it.
    shares : ndarray, shape (p,)
        Share of the density in the part around each point; the sum is 1.
    across, along : ndarray, shape (p, n, n)
        Covariances of these parts, across the valley and along it.
    step : float
        Distance from point to point, in ranges.
    """

    values: np.ndarray
    rises: np.ndarray
    shares: np.ndarray
    across: np.ndarray
    along: np.ndarray
    step: float

    @classmethod
    def of(cls, places: np.ndarray, residuals: np.ndarray, slopes: np.ndarray, n_open: int, step: float) -> "Valley":
        """Return the valley of points (each range from 0 to 1) that lie one step apart along the open directions."""
        left_vectors, found, directions = np.linalg.svd(slopes, full_matrices=True)
        n_seen = places.shape[1] - n_open
        # residuals that the solver has left across the valley, at a kink: the misfit below it is without them
        left = np.einsum("pmk,pm->pk", left_vectors[:, :, :n_seen], residuals)
        misfits = (residuals**2).sum(axis=1) - (left**2).sum(axis=1)
        seen, rises = np.maximum(found[:, :n_seen], FEW_ERRORS), misfits - misfits.min()
        # a narrow part of the valley (large singular values across it) has a smaller share
        shares = np.exp(-0.5 * rises) / np.prod(seen / seen.max(axis=0), axis=1)
        # a part is uniform along the valley, over one step: its standard deviation is step / 12**0.5
        steps = directions[:, :n_seen] / seen[..., None], directions[:, n_seen:] * step / 12**0.5
        across, along = (each.swapaxes(1, 2) @ each for each in steps)
        return cls(places, rises, shares / shares.sum(), across, along, step)

    def scaled(self, low: np.ndarray, width: np.ndarray) -> "Valley":
        """Return the valley in the units of the parameters, whose ranges begin at `low` and have the size `width`."""
        across, along = (each * np.outer(width, width) for each in (self.across, self.along))
        return replace(self, values=low + self.values * width, across=across, along=along)

    @property
    def middle(self) -> int:
        """Index of the point with the least mean distance to all others, weighted by their shares."""
        return int(np.argmin(np.linalg.norm(self.values[:, None] - self.values, axis=2) @ self.shares))

    @property
    def extent(self) -> np.ndarray:
        """Least and greatest values of the points that are as good as the best one, shape (2, n)."""
        good = self.values[self.rises < AS_GOOD]
        return np.array([good.min(axis=0), good.max(axis=0)])

    def within(self, values: np.ndarray, share: float) -> np.ndarray:
        """Return the distances from `values` within which a share of the density of each parameter lies, shape (n,)."""
        apart = self.values - values
        spreads = np.sqrt(np.diagonal(self.across + self.along, axis1=1, axis2=2))

        def missing(distance: float, k: int) -> float:
            ends = (np.array([[distance], [-distance]]) - apart[:, k]) / spreads[:, k]
            return float(-np.diff(norm.cdf(ends), axis=0)[0] @ self.shares) - share

        far = (np.abs(apart) + BEYOND * spreads).max(axis=0)
        return np.array([brentq(missing, 0.0, end, args=(k,), xtol=1e-6 * end) for k, end in enumerate(far)])

    def covariance(self, values: np.ndarray) -> np.ndarray:
        """Return the covariance about `values` (ranges from 0 to 1), shape (n, n).

        It is scaled so that 68.27 % of the density of each parameter lie within its error. A parameter has the variance
        inf, and nan off the diagonal, if all of its range, up to a step, gives the data as well as the best values do.
        """
        apart = self.values - values
        parts = self.across + self.along + apart[:, :, None] * apart[:, None]
        moments = np.einsum("p,pij->ij", self.shares, parts)
        scale = self.within(values, ONE_ERROR) / np.sqrt(np.diag(moments))
        covariance = np.asarray(moments * np.outer(scale, scale))
        least, most = self.extent
        undetermined = (least < self.step) & (most > 1 - self.step)
        covariance[undetermined], covariance[:, undetermined] = np.nan, np.nan
        covariance[undetermined, undetermined] = np.inf
        return covariance
