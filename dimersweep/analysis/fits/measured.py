"""What was measured of an orbit: some of its quantities, with their errors."""

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
ABOVE_ZERO = ("path_radius", "radius", "period")  # what a circle has
SYMMETRIC = 1e-9  # how well a covariance must be, relative to its errors


class Foretelling(Protocol):
    """A `Track`: it says what an orbit would have been measured as, and what is to be known of it."""

    @property
    def notes(self) -> tuple[str, ...]: ...

    def of(self, orbit: Any) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Measured:
    """Measured quantities of an orbit, with the covariance of their errors.

    Attributes
    ----------
    names : tuple of str
        Among `path_radius`, `period`, `path_speed`, `zeta`, `spin`, `impact_phase`, `radius` and `speed`, as a `PeriodicOrbit`
        has them: a circle that was seen is that of `path_radius`.
    values : ndarray, shape (n,)
        In SI units; the phase in cycles.
    covariance : ndarray, shape (n, n)
    track : Track, optional
        That the first two values, `path_radius` and `period`, are read off.

    Raises
    ------
    ParameterError
        For an unknown name, or a covariance that is none.

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
        """Quantities whose errors are independent.

        Parameters
        ----------
        measured : mapping of str to (float, float)
            Of each quantity its value and the standard deviation of its error.

        Raises
        ------
        ParameterError
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
        """These, and others with independent errors, such as `zeta=(1.604, 0.002)`."""
        more = Measured.of(measured)
        n = len(self.names)
        covariance = np.zeros((n + len(more.names),) * 2)
        covariance[:n, :n], covariance[n:, n:] = self.covariance, more.covariance
        return Measured((*self.names, *more.names), np.concatenate([self.values, more.values]), covariance, self.track)

    @property
    def errors(self) -> np.ndarray:
        """Standard deviations, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def __repr__(self) -> str:
        rows = zip(self.names, self.values, self.errors, strict=True)
        words = (
            f"{name} {value:.6g} ± {error:.3g} {MEASURABLE[name].units}".removesuffix(" 1")
            for name, value, error in rows
        )
        return f"<Measured: {', '.join(words)}>"


def _measured(name: str, value: Any) -> float:
    """A measured value, which an orbit can have.

    Raises
    ------
    ParameterError
    """
    units, _, least, most = MEASURABLE[name]
    value = as_number(name, value, units)
    if name in ABOVE_ZERO and value <= 0:
        raise ParameterError(f"{name} = {value:g}: must be > 0")
    if not least <= value <= most:
        raise ParameterError(f"{name} = {value:g}: must be {f'in [{least:g}, {most:g}]' if isfinite(most) else '>= 0'}")
    return value
