"""Measured values of an orbit, with the covariance of their errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, Protocol

import numpy as np

from dimersweep.errors import ParameterError, unknown
from dimersweep.inputs import as_number, as_numbers, columns_of, pair_of
from dimersweep.symbols import QUANTITIES, Quantity

# attributes of an orbit that an experiment can measure
MEASURABLE: dict[str, Quantity] = {
    "spin": QUANTITIES["spin"],
    **{
        name: QUANTITIES[name]
        for name in ("path_radius", "period", "path_speed", "zeta", "impact_phase", "radius", "speed")
    },
}
ABOVE_ZERO = ("path_radius", "radius", "period")  # quantities of a circle, which must be above 0
SYMMETRIC = 1e-9  # asymmetry of a covariance that counts as rounding, relative to its errors


class Foretelling(Protocol):
    """A `Track`: predicts its radius and period for an orbit, and has sentences about itself."""

    @property
    def notes(self) -> tuple[str, ...]: ...

    def of(self, orbit: Any) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Measured:
    """Measured quantities of an orbit, with the covariance of their errors.

    Attributes
    ----------
    names : tuple of str
        Names among `path_radius`, `period`, `path_speed`, `zeta`, `spin`, `impact_phase`, `radius` and `speed`, as a
        `PeriodicOrbit` has them. The radius of an observed circle is `path_radius`.
    values : ndarray, shape (n,)
        Values in SI units; the phase in cycles.
    covariance : ndarray, shape (n, n)
        Covariance of the errors of the values.
    track : Track, optional
        Track from which the first two values, `path_radius` and `period`, were read.

    Raises
    ------
    ParameterError
        For an unknown name, or a covariance that is not symmetric and positive definite.

    Examples
    --------
    >>> from dimersweep.analysis.fits import Measured
    >>> Measured.of({"path_radius": (4.24, 0.02), "zeta": ("91.9 deg", "0.1 deg")})
    <Measured: path_radius 4.24 ± 0.02 m, zeta 1.60396 ± 0.00175 rad>
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    track: Foretelling | None = None

    def __post_init__(self) -> None:
        names = (self.names,) if isinstance(self.names, str) else tuple(self.names)
        for name in names:
            if name not in MEASURABLE:
                raise ParameterError(unknown(name, "measured quantity", MEASURABLE))
        words, n = f"measured = {', '.join(names)}", len(set(names))
        if n != len(names) or np.shape(self.values) != (n,) or np.shape(self.covariance) != (n, n):
            raise ParameterError(f"{words}: must be one value and one row of errors each")
        values = np.array([_measured(name, value) for name, value in zip(names, self.values, strict=True)])
        covariance = np.array([as_numbers(f"{words}: covariance", row) for row in columns_of(self.covariance)])
        variances = np.abs(np.diag(covariance))
        if (np.abs(covariance - covariance.T) > SYMMETRIC * np.sqrt(np.outer(variances, variances))).any():
            raise ParameterError(f"{words}: the covariance must be symmetric")
        try:
            np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            raise ParameterError(f"{words}: the errors must be > 0, and no combination of values without one") from None
        for name, value in (("names", names), ("values", values), ("covariance", covariance)):
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, measured: Mapping[str, tuple[float, float]]) -> "Measured":
        """Return measured values whose errors are independent.

        Parameters
        ----------
        measured : mapping of str to (float, float)
            Value of each quantity, and the standard deviation of its error.

        Raises
        ------
        ParameterError
            For an unknown name, a value that no orbit can have, or an error that is not above 0.
        """
        if not isinstance(measured, Mapping) or not measured:
            raise ParameterError(f"measured = {measured!r}: must be pairs such as {{'path_radius': (4.24, 0.02)}}")
        pairs = []
        for name, pair in measured.items():
            if name not in MEASURABLE:
                raise ParameterError(unknown(name, "measured quantity", MEASURABLE))
            value, error = pair_of(name, pair, "a value and its error, such as (4.24, 0.02)")
            pairs.append((_measured(name, value), as_number(f"error of {name}", error, MEASURABLE[name].units)))
            if pairs[-1][1] <= 0:
                raise ParameterError(f"error of {name} = {pairs[-1][1]:g}: must be > 0")
        values, errors = np.array(pairs).T
        return cls(tuple(measured), values, np.diag(errors**2))

    def also(self, **measured: tuple[float, float]) -> "Measured":
        """Return these values and further ones with independent errors, such as `zeta=(1.604, 0.002)`."""
        more = Measured.of(measured)
        n = len(self.names)
        covariance = np.zeros((n + len(more.names),) * 2)
        covariance[:n, :n], covariance[n:, n:] = self.covariance, more.covariance
        return Measured((*self.names, *more.names), np.concatenate([self.values, more.values]), covariance, self.track)

    @property
    def errors(self) -> np.ndarray:
        """Standard deviations of the errors, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def __repr__(self) -> str:
        rows = zip(self.names, self.values, self.errors, strict=True)
        words = (
            f"{name} {value:.6g} ± {error:.3g} {MEASURABLE[name].units}".removesuffix(" 1")
            for name, value, error in rows
        )
        return f"<Measured: {', '.join(words)}>"


def _measured(name: str, value: Any) -> float:
    """Return a measured value as a number in SI units, if an orbit can have it.

    Raises
    ------
    ParameterError
        If no orbit can have the value.
    """
    units, _, least, most = MEASURABLE[name]
    value = as_number(name, value, units)
    if name in ABOVE_ZERO and value <= 0:
        raise ParameterError(f"{name} = {value:g}: must be > 0")
    if not least <= value <= most:
        raise ParameterError(f"{name} = {value:g}: must be {f'in [{least:g}, {most:g}]' if isfinite(most) else '>= 0'}")
    return value
