"""The orbit that a run has come to, as labelled numbers."""

from dataclasses import dataclass, fields
from math import nan
from typing import Any

from dimersweep.kernel.model.layout import DI_ENDS


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """The orbit of a drift: values of its last full period, and the change of each per period, fitted over the last 20.

    Attributes
    ----------
    radius : float
        Radius of the circle, speed over precession rate [m]; NaN for a straight path, which has none.
    period : float
        Time once round [s]; NaN for a straight path.
    zeta : float
        Angle from the axis (from the ball that is down to the one that bounces) to the velocity [rad].
    speed : float
        Speed of the centre of mass at the end of the double impact [m s-1].
    precession_rate : float
        Mean rate of theta, signed [rad s-1].
    impact_phase : float
        Phase of the double impact in cycles of the plate, in [0, 1) [1].
    di_end : str
        Friction of p1 and p2 when the double impact ends: sp_sp, sp_sk, sk_sp or sk_sk.
    spin_rate, beta_rate_after : float
        Axial spin, and rate of the dip angle, after the double impact [rad s-1].
    radius_drift, period_drift, zeta_drift, speed_drift, precession_rate_drift, impact_phase_drift : float
        Change per forcing period, in the unit of the quantity.
    spin_drift : float
        The same of `spin_rate`: the creep along the family of orbits that the drift goes through [rad s-1].

    Examples
    --------
    >>> from dimersweep import simulate
    >>> orbit = simulate(periods=200).orbit
    >>> round(orbit.radius, 3), round(orbit.period, 2), orbit.di_end
    (4.245, 36.9, 'sp_sk')
    """

    radius: float
    period: float
    zeta: float
    speed: float
    precession_rate: float
    impact_phase: float
    di_end: str
    spin_rate: float
    beta_rate_after: float
    radius_drift: float
    period_drift: float
    zeta_drift: float
    speed_drift: float
    precession_rate_drift: float
    impact_phase_drift: float
    spin_drift: float = nan


def orbit_from(out: dict[str, float], di_end: int) -> Orbit:
    """The orbit of a drift from the outcome of the kernel, by the names of ``layout.OUT``, and the code of its end."""
    return Orbit(di_end=DI_ENDS[di_end], **{name: out[name] for name in columns_of(Orbit, *out)})


def columns_of(kind: type[Any], *names: str) -> list[str]:
    """Those of `names`, the kernel's columns, that a dataclass has as fields."""
    return [entry.name for entry in fields(kind) if entry.name in names]
