"""Hold the orbit of a run as labelled numbers, and an object in place of an orbit that a run does not have."""

from dataclasses import dataclass
from math import nan
from typing import Any

from dimersweep.errors import AbsentError
from dimersweep.kernel.model.layout import OrbitNumbers
from dimersweep.symbols import QUANTITIES, units_shown


class MissingValue:
    """Placeholder of something that a run does not have.

    It is false and equal to None. Every attribute and item raises an `AbsentError` that says why it is missing.

    Parameters
    ----------
    why : str
        What the run has instead, in one line.
    """

    def __init__(self, why: str) -> None:
        self._why = why

    def __bool__(self) -> bool:
        return False

    def __eq__(self, other: object) -> bool:
        return other is None or (isinstance(other, MissingValue) and other._why == self._why)

    def __hash__(self) -> int:
        return hash(self._why)

    def __repr__(self) -> str:
        return f"<none: {self._why}>"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)  # Python itself looks for such names, for a copy for example
        raise AbsentError(f"{name}: {self._why}")

    def __getitem__(self, name: Any) -> Any:
        raise AbsentError(f"{name}: {self._why}")


@dataclass(frozen=True, kw_only=True, repr=False)
class Orbit(OrbitNumbers):
    """Orbit of a drift: values of its last full period, and the change of each per period, fitted over the last 20.

    Attributes
    ----------
    radius : float
        Equivalent radius (11), speed over precession rate [m]; NaN for a straight path, which has none.
    path_radius : float
        Radius of the mean path of the centre of mass, as a camera sees it [m]; NaN for a straight path. It is computed
        in the forcing period after the run, as is `path_speed`.
    period : float
        Time for one whole turn [s], the same for both radii; NaN for a straight path.
    zeta : float
        Angle from the axis, which points from the ball that is down to the ball that bounces, to the velocity [rad].
    speed : float
        Speed of the centre of mass at the end of the double impact [m s-1].
    path_speed : float
        Speed along the mean path [m s-1]: 2 pi path_radius / period.
    precession_rate : float
        Mean rate of theta, signed [rad s-1].
    impact_phase : float
        Phase of the double impact in cycles of the plate, in [0, 1) [1].
    di_end : str
        Friction of the end that stays down, then of the other one, when the double impact ends: sp_sp, sp_sk, sk_sp or
        sk_sk.
    spin, beta_rate_after : float
        Axial spin, and rate of the dip angle, after the double impact [rad s-1].
    radius_drift, period_drift, zeta_drift, speed_drift, precession_rate_drift, impact_phase_drift : float
        Change per forcing period, in the unit of the quantity.
    spin_drift : float
        Change of `spin` per forcing period [rad s-1]: the slow drift along the family of orbits that the motion passes.

    Examples
    --------
    >>> from dimersweep import simulate
    >>> orbit = simulate(periods=200).orbit
    >>> round(orbit.radius, 3), round(orbit.period, 2), orbit.di_end
    (4.245, 36.9, 'sp_sk')
    """

    di_end: str
    spin_drift: float = nan

    def __repr__(self) -> str:
        shown = {name: QUANTITIES[name].units for name in ("radius", "period", "zeta", "speed", "impact_phase", "spin")}
        numbers = [f"{name} {getattr(self, name):.6g} {units_shown(units)}".strip() for name, units in shown.items()]
        return f"<Orbit: {', '.join(numbers)}, di_end {self.di_end}>"


def no_orbit(mode: str) -> MissingValue:
    """Return the placeholder for the orbit of a motion of another mode than drift."""
    return MissingValue(f"the motion is {mode}, and only a drift has an orbit")
