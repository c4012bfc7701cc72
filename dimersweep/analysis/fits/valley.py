"""Valley: all values that give the data, where these leave something open, and what they tell of each parameter."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

FEW_ERRORS = 12**0.5  # to a range, below which a direction is open: a uniform density there has as small a deviation
ONE_ERROR = 0.6827  # of a normal density, within a standard deviation
BEYOND = 10.0  # standard deviations within which all of it lies
AS_GOOD = 1.0  # of the misfit above the least, for values within a standard deviation of the best ones


@dataclass(frozen=True, eq=False)
class Valley:
    """Points that cover all values which give the data about as well as the best ones, evenly in the ranges.

    Their density is the likelihood, with each parameter as likely anywhere in its range. About a point it is normal across the
    valley, by the slopes there, and even along it.

    Attributes
    ----------
    values : ndarray, shape (p, n)
        Of the free parameters.
    rises : ndarray, shape (p,)
        Of the misfit above its least: the profile of each parameter, since the other ones are the best for it.
    shares : ndarray, shape (p,)
        Of the density, in the parts around the points; their sum is 1.
    across, along : ndarray, shape (p, n, n)
        Covariances of these parts, across the valley and along it.
    step : float
        From point to point, in ranges.
    """

    values: np.ndarray
    rises: np.ndarray
    shares: np.ndarray
    across: np.ndarray
    along: np.ndarray
    step: float

    @classmethod
    def of(cls, places: np.ndarray, residuals: np.ndarray, slopes: np.ndarray, n_open: int, step: float) -> "Valley":
        """From points of the ranges, each from 0 to 1, that lie a step apart along what is open."""
        ways, found, directions = np.linalg.svd(slopes, full_matrices=True)
        n_seen = places.shape[1] - n_open
        left = np.einsum("pmk,pm->pk", ways[:, :, :n_seen], residuals)  # by the solver, at a kink
        misfits = (residuals**2).sum(axis=1) - (left**2).sum(axis=1)
        seen, rises = np.maximum(found[:, :n_seen], FEW_ERRORS), misfits - misfits.min()
        shares = np.exp(-0.5 * rises) / np.prod(seen / seen.max(axis=0), axis=1)  # a narrow part holds less
        steps = directions[:, :n_seen] / seen[..., None], directions[:, n_seen:] * step / 12**0.5
        across, along = (each.swapaxes(1, 2) @ each for each in steps)
        return cls(places, rises, shares / shares.sum(), across, along, step)

    def scaled(self, low: np.ndarray, width: np.ndarray) -> "Valley":
        """In the units of the parameters, whose ranges begin at `low`."""
        across, along = (each * np.outer(width, width) for each in (self.across, self.along))
        return replace(self, values=low + self.values * width, across=across, along=along)

    @property
    def middle(self) -> int:
        """Number of the point that is nearest to all."""
        return int(np.argmin(np.linalg.norm(self.values[:, None] - self.values, axis=2) @ self.shares))

    @property
    def extent(self) -> np.ndarray:
        """Least and greatest values of those that give the data as well as the best ones, shape (2, n)."""
        good = self.values[self.rises < AS_GOOD]
        return np.array([good.min(axis=0), good.max(axis=0)])

    def within(self, values: np.ndarray, share: float) -> np.ndarray:
        """Distances from some values within which a share of the density of each parameter lies, shape (n,)."""
        apart = self.values - values
        spreads = np.sqrt(np.diagonal(self.across + self.along, axis1=1, axis2=2))

        def missing(distance: float, k: int) -> float:
            ends = (np.array([[distance], [-distance]]) - apart[:, k]) / spreads[:, k]
            return float(-np.diff(norm.cdf(ends), axis=0)[0] @ self.shares) - share

        far = (np.abs(apart) + BEYOND * spreads).max(axis=0)
        return np.array([brentq(missing, 0.0, end, args=(k,), xtol=1e-6 * end) for k, end in enumerate(far)])

    def covariance(self, values: np.ndarray) -> np.ndarray:
        """About some values in ranges from 0 to 1: within its error 68.27 % of the density of a parameter lie.

        The error is inf, and nan beside it, where all of the range, up to a step, gives the data as well as the best values do.
        """
        apart = self.values - values
        parts = self.across + self.along + apart[:, :, None] * apart[:, None]
        moments = np.einsum("p,pij->ij", self.shares, parts)
        scale = self.within(values, ONE_ERROR) / np.sqrt(np.diag(moments))
        covariance = np.asarray(moments * np.outer(scale, scale))
        least, most = self.extent
        lost = (least < self.step) & (most > 1 - self.step)
        covariance[lost], covariance[:, lost] = np.nan, np.nan
        covariance[lost, lost] = np.inf
        return covariance
