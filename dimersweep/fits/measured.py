"""What was measured of an orbit: some of its quantities, with their errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dimersweep.errors import ParameterError, unknown
from dimersweep.inputs import number
from dimersweep.symbols import QUANTITIES

if TYPE_CHECKING:
    from dimersweep.fits.tracks import Track

# attributes of an orbit that an experiment can measure, with their units
MEASURABLE = {
    "spin": QUANTITIES["spin_rate"].units,
    **{
        name: QUANTITIES[name].units
        for name in ("path_radius", "period", "path_speed", "zeta", "impact_phase", "radius", "speed")
    },
}


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
    >>> from dimersweep.fits import Measured
    >>> Measured.of({"path_radius": (4.24, 0.02), "zeta": ("91.9 deg", "0.1 deg")})
    <Measured: path_radius 4.24 ± 0.02 m, zeta 1.60396 ± 0.00175 rad>
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    track: "Track | None" = None

    def __post_init__(self) -> None:
        for name in self.names:
            if name not in MEASURABLE:
                raise ParameterError(unknown(name, "measured quantity", MEASURABLE))
        n = len(set(self.names))
        if n != len(self.names) or np.shape(self.values) != (n,) or np.shape(self.covariance) != (n, n):
            raise ParameterError(f"measured = {', '.join(self.names)}: must be one value and one row of errors each")
        try:
            np.linalg.cholesky(self.covariance)
        except np.linalg.LinAlgError:
            raise ParameterError(f"measured = {', '.join(self.names)}: the errors must be > 0") from None

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
        pairs = [_value_and_error(name, pair) for name, pair in measured.items()]
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
            f"{name} {value:.6g} ± {error:.3g} {MEASURABLE[name]}".removesuffix(" 1") for name, value, error in rows
        )
        return f"<Measured: {', '.join(words)}>"


def _value_and_error(name: str, pair: Any) -> tuple[float, float]:
    if name not in MEASURABLE:
        raise ParameterError(unknown(name, "measured quantity", MEASURABLE))
    try:
        value, error = pair
    except (TypeError, ValueError):
        raise ParameterError(f"{name} = {pair!r}: must be a value and its error, such as (4.24, 0.02)") from None
    units = MEASURABLE[name]
    value, error = number(name, value, units), number(f"error of {name}", error, units)
    if error <= 0:
        raise ParameterError(f"error of {name} = {error:g}: must be > 0")
    return value, error
