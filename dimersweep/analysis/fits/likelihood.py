"""The likelihood of parameters within ranges: the probability density of the measured values."""

from collections.abc import Mapping

import numpy as np

from dimersweep.analysis.fits.measured import Measured
from dimersweep.analysis.fits.tracks import Track
from dimersweep.analysis.orbits.map.finding import RTOL, checked, checked_spin, orbit_at, units_along
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import Recorder
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import as_number, as_numbers, check_rtol, number, pair_of
from dimersweep.parameters import check, check_effect, check_level, check_names, spelt_out
from dimersweep.symbols import BASE


class Likelihood:
    """The logarithm of the probability density of the data, as a function of the free parameters, for any sampler.

    Calling it with a point, shape (n,), returns a float: -inf outside the ranges and where there is no stable orbit.
    The value depends on the point alone. A call costs about 40 forcing periods. The object can be pickled.

    Parameters
    ----------
    measured : mapping, Measured or Track
        Measured values, as in `fit`.
    free : mapping of str to (float, float)
        Least and greatest value of each free parameter.
    spin : float, optional
        Axial spin [rad s-1] if it is not free, as in `fit`.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Parameters of the model that are not free.

    Attributes
    ----------
    names : tuple of str
        The free parameters, in the order of a point.
    low, high : ndarray, shape (n,)
        Least and greatest values of the free parameters.

    Raises
    ------
    ParameterError
        As `fit`.

    Examples
    --------
    >>> from dimersweep import fits
    >>> log_likelihood = fits.Likelihood({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)})
    >>> log_likelihood([0.65]) > log_likelihood([0.6]) > log_likelihood([0.8])
    True
    """

    def __init__(
        self,
        measured: Mapping[str, tuple[float, float]] | Measured | Track,
        free: Mapping[str, tuple[float, float]],
        *,
        spin: float | str | None = None,
        rtol: float = RTOL,
        **parameters: float,
    ) -> None:
        if isinstance(measured, Track):
            measured = measured.measured
        self.measured = measured if isinstance(measured, Measured) else Measured.of(measured)
        self.names, self.low, self.high = _ranges(free)
        self.rtol = check_rtol(rtol)
        check_names(parameters)
        spelt = spelt_out(parameters, dict.fromkeys(self.names))
        self.fixed = {name: number(name, value) for name, value in spelt.items()}
        for name, value in self.fixed.items():
            if name in self.names:
                raise ParameterError(f"{name}: is given and free; leave one of the two out")
            check({name: value})
        check_effect([*self.fixed, *(name for name in self.names if name != "spin")])
        if spin is not None and "spin" in self.names:
            raise ParameterError("spin: is given and free; leave one of the two out")
        self.spin = None if spin is None else as_number("spin", spin, units_along("spin"))
        spins = [] if self.spin is None else [self.spin]
        for names, *columns in ((self.names, self.low, self.high), (self.measured.names, self.measured.values)):
            spins += [float(column[names.index("spin")]) for column in columns if "spin" in names]
        f = self.high[self.names.index("f")] if "f" in self.names else self.fixed.get("f", BASE["f"])
        for value in spins:
            checked_spin(value, {"f": float(f)})  # at the greatest frequency, where the greatest spin is highest
        lower = np.linalg.cholesky(self.measured.covariance)
        self.whitening = np.linalg.inv(lower)
        self.constant = -float(np.log(np.diag(lower)).sum()) - 0.5 * len(lower) * float(np.log(2 * np.pi))

    def values(self, point: np.ndarray) -> dict[str, float]:
        """Return the free parameters at a point, by name."""
        return dict(zip(self.names, map(float, point), strict=True))

    def orbit(
        self, point: np.ndarray, guess: PeriodicOrbit | None = None, recorder: Recorder | None = None
    ) -> PeriodicOrbit:
        """Return the stable orbit at a point; unstable orbits are refused, since they cannot be measured.

        Raises
        ------
        OrbitError
            If there is no stable orbit.
        ParameterError
            If the parameters do not go together, such as mu above mu_s.
        """
        values = self.values(point)
        spin = values.pop("spin", self.spin)
        given = checked({**self.fixed, **values})
        orbit = orbit_at(given, checked_spin(spin, given), guess=guess, rtol=self.rtol, recorder=recorder)
        if not orbit.stable:
            raise OrbitError(f"the orbit is unstable, with a multiplier of size {abs(orbit.multipliers[0]):.4g}")
        return orbit

    def predicted(self, orbit: PeriodicOrbit) -> np.ndarray:
        """Return the values that would be measured of an orbit, shape (m,).

        Radius and period of a track are those that the track would show of it. Phases are the nearest to the measured
        ones.
        """
        values = np.array([getattr(orbit, name) for name in self.measured.names])
        if self.measured.track is not None and orbit.precession_rate:
            values[:2] = self.measured.track.of(orbit)
        for k, name in enumerate(self.measured.names):
            if name == "impact_phase":
                values[k] -= np.round(values[k] - self.measured.values[k])
        return values

    def residuals(self, orbit: PeriodicOrbit) -> np.ndarray:
        """Return the differences between an orbit and the measured values, uncorrelated and in errors, shape (m,)."""
        return self.whitening @ (self.predicted(orbit) - self.measured.values)

    def __call__(self, point: np.ndarray) -> float:
        point = as_numbers("point", point, result=True)
        if point.shape != self.low.shape:
            raise ParameterError(f"point: must have {self.low.size} values: {', '.join(self.names)}")
        if not ((self.low <= point) & (point <= self.high)).all():
            return -float("inf")
        try:
            residuals = self.residuals(self.orbit(point))
        except (OrbitError, ParameterError):
            return -float("inf")
        value = self.constant - 0.5 * float(residuals @ residuals)
        return value if np.isfinite(value) else -float("inf")


def _ranges(free: Mapping[str, tuple[float, float]]) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Return names, least and greatest values of the free parameters, checked."""
    if not isinstance(free, Mapping) or not free:
        raise ParameterError(f"free = {free!r}: must be ranges such as {{'e': (0.5, 0.7)}}")
    rows = []
    for name, pair in free.items():
        units = units_along(name)
        both = pair_of(name, pair, "the least and the greatest value")
        low, high = ends = tuple(as_number(name, end, units) for end in both)
        if low >= high:
            raise ParameterError(f"{name} = ({low:g}, {high:g}): the first must be below the second")
        if name != "spin":
            check({name: np.array(ends)})
            check_level({name: low or high}, "orbits")
        rows.append(ends)
    lows, highs = np.array(rows).T
    return tuple(free), lows, highs
