"""The motion after any time: its spin drifts along the slow family, to a sustained spin or over an end of it."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import count
from math import isnan
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, circle_of
from dimersweep.analysis.orbits.slow.sheets import Sheet, Standing, Stretch, drifted, stretch_of
from dimersweep.analysis.orbits.slow.slow_flow import DriftLeg, SlowFlow, flow_of
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number


class Leap(NamedTuple):
    """A leap of the motion over the end of a sheet of the slow family.

    Attributes
    ----------
    after : float
        Forcing periods from the start to the leap.
    spin, radius : tuple of float
        Spin and radius before and after the leap [rad s-1], [m].
    """

    after: float
    spin: tuple[float, float]
    radius: tuple[float, float]


class Later(NamedTuple):
    """The motion some time after a given one, as `later` returns it.

    Attributes
    ----------
    spin : float
        Axial spin after the double impact [rad s-1].
    radius, period, zeta : float
        Radius, period and angle of the orbit [m, s, rad]. Radius and period are NaN in a plane, where the spin is 0.
    mode : str
        Mode of the run where the motion has left the slow family; the numbers are then NaN unless the mode is a
        drift. Empty on the family.
    leaps : tuple of Leap
        Leaps on the way; in a cycle those of the first round.
    """

    spin: float
    radius: float
    period: float
    zeta: float
    mode: str = ""
    leaps: tuple[Leap, ...] = ()

    def __repr__(self) -> str:
        kept = f"spin {self.spin:.6g} rad/s, {circle_of(self.radius)}, period {self.period:.6g} s, zeta {self.zeta:.6g} rad"
        parts = [kept.replace(", period nan s", "")] if not isnan(self.spin) else []
        parts += [f"mode {self.mode}"] if self.mode else []
        parts += [f"{len(self.leaps)} leaps on the way"] if self.leaps else []
        return f"<Later: {', '.join(parts)}>"


def later(
    family: xr.Dataset | PeriodicOrbit,
    *,
    spin: float | str | None = None,
    periods: float | None = None,
    seconds: float | str | None = None,
) -> Later:
    """Return the motion some time after it had a given spin, by integration of the slow rate.

    The spin obeys s(n + 1) = s(n) + d(s(n)); the flow ds/dn = d - d d'/2 has this map to second order. Where d falls
    through zero as the spin grows, the motion comes to that spin and keeps it. From an orbit the motion is followed for
    any time, over changes of the symbol sequence. A run leads over the end of the family, to another family or to a
    motion that is on none.

    Parameters
    ----------
    family : PeriodicOrbit or xarray.Dataset
        Stable orbit that the motion is on, or a table from `family`, within which the motion stays.
    spin : float, optional
        Only with a table: axial spin after the double impact, as in `Run.orbit.spin` [rad s-1]. An
        orbit has its own spin.
    periods : float, optional
        Time in forcing periods. A negative time leads backwards, as far as the family goes. From an orbit it may be
        inf: the limit of the spin after a long time.
    seconds : float or str, optional
        In place of `periods`: time [s], or a text with its unit, such as "3 h".

    Returns
    -------
    Later

    Raises
    ------
    ParameterError
        If the spin is outside the family, or the motion reaches an end of the family before; for an infinite time, if
        the spin goes to and fro for good; if both or neither of `periods` and `seconds` are given.
    OrbitError
        For an infinite time, if the limit of the motion is not found.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> orbit = orbits.find(spin=110.0)
    >>> round(orbits.later(orbit, periods=10_000).radius, 3)
    4.256
    >>> orbits.later(orbit, seconds="3 h")
    <Later: spin 82.9209 rad/s, radius 4.26405 m, period 64.511 s, zeta 1.62886 rad>
    >>> family = orbits.family(spin=(100.0, 110.0), points=5)
    >>> round(orbits.later(family, spin=110.0, periods=10_000).radius, 3)
    4.256
    """
    if isinstance(family, PeriodicOrbit):
        if spin is not None:
            raise ParameterError(f"spin = {spin!r}: the orbit has its own; give it with a table only")
        if not family.stable:
            raise ParameterError("family: is an unstable orbit, along which no motion drifts")
        return _after(family, _time(periods, seconds, family.parameters, endless=True))
    spin, periods = as_number("spin", spin, "rad s-1"), _time(periods, seconds, family)
    family = family.sortby("spin").isel(spin=np.isfinite(family.sortby("spin")["spin_drift"].values))
    spins = family["spin"].values
    # a cubic spline needs four points
    if spins.size < 4 or (np.diff(spins) == 0).any():
        raise ParameterError(f"family: has {np.unique(spins).size} points; needs at least 4, each spin once")
    if not spins[0] <= spin <= spins[-1]:
        raise ParameterError(f"spin = {spin:g}: the family goes from {spins[0]:g} to {spins[-1]:g} rad/s")
    at_end = _within_family([stretch_of(np.stack([spins, family["spin_drift"].values], axis=1))], spin, periods)

    def read(name: str) -> float:
        known = np.isfinite(family[name].values)  # in a plane there is no circle
        return float(CubicSpline(spins[known], family[name].values[known])(at_end)) if known.sum() > 1 else np.nan

    return Later(at_end, read("radius"), read("period"), read("zeta"))


def _time(periods: Any, seconds: Any, known: Mapping[Any, Any], *, endless: bool = False) -> float:
    """Return a time in forcing periods; raise ParameterError unless just one of `periods` and `seconds` is given.

    The forcing frequency is `known["f"]`. An infinite time is allowed if it may be `endless`.
    """
    if (periods is None) == (seconds is None):
        raise ParameterError("periods: give either periods or seconds, such as seconds='3 h'")
    name, time, units = ("periods", periods, "1") if seconds is None else ("seconds", seconds, "s")
    if endless and str(time) == "inf":
        return np.inf
    return as_number(name, time, units) * (1.0 if seconds is None else float(known["f"]))


def _within_family(stretches: list[Stretch], spin: float, periods: float) -> float:
    """Return the spin after some periods; raise ParameterError if the motion reaches an end of the family before."""
    at_end, left = drifted(stretches, spin, periods)
    if left:
        ends = f"the motion comes to the end of the family after {abs(periods - left):.0f}"
        raise ParameterError(f"periods = {periods:g}: {ends}")
    return at_end


def _after(orbit: PeriodicOrbit, periods: float) -> Later:
    """Return the motion some forcing periods after it was on an orbit."""
    if periods < 0 and orbit.spin_drift:
        flow = flow_of(orbit, whole=True)
        sheet = flow.sheets[flow.sheet_of(orbit)]
        return _at(sheet, _within_family(sheet.stretches, orbit.spin, periods))
    left, begin = periods, orbit
    leaps: list[Leap] = []
    seen: dict[int, float] = {}  # periods left when the motion first came to each arrival, by its identity
    way = _way(orbit)
    while True:
        try:
            leg = next(way)
        except OrbitLost:
            if left == np.inf:
                raise
            return _by_run(begin, left, leaps)
        sheet, stands = leg.sheet, isinstance(leg.then, Standing)
        if stands and (left == np.inf or leg.to == begin.spin):
            return _at(sheet, leg.to, leaps)
        if stands or leg.periods > left:
            return _at(sheet, drifted(sheet.stretches, begin.spin, left)[0], leaps)
        left, end = left - leg.periods, sheet.at(leg.to)
        if not isinstance(leg.then, PeriodicOrbit) or leg.landing > left:
            if left == np.inf:
                return Later(np.nan, np.nan, np.nan, np.nan, str(leg.then), tuple(leaps))
            return _by_run(end, left, leaps)
        left, begin = left - leg.landing, leg.then
        number = id(leg.then)
        if number not in seen:
            leaps.append(Leap(periods - left - leg.landing, (leg.to, begin.spin), (end.radius, begin.radius)))
        elif left == np.inf:
            raise ParameterError(
                f"periods = inf: the spin goes to and fro, from {leg.begin.spin:.6g} to {leg.to:.6g} rad/s"
            )
        else:
            left %= seen[number] - left  # whole rounds of the cycle are left out
        seen.setdefault(number, left)


@lru_cache(maxsize=8)  # of an orbit one asks for the motion at many times, or of a few orbits in turn
def _followed(orbit: PeriodicOrbit) -> tuple[SlowFlow, list[DriftLeg]]:
    """Return the slow flow of an orbit and the drifts that have been followed from it, none at first.

    The iterator of `SlowFlow.way` cannot be kept in their place: once it has raised an error, it is at its end.
    """
    return flow_of(orbit), []


def _way(orbit: PeriodicOrbit) -> Iterator[DriftLeg]:
    """Yield the drifts from an orbit on as `SlowFlow.way` does; each is followed once for all times that are asked for."""
    flow, legs = _followed(orbit)
    for k in count():
        if k == len(legs):
            begin = legs[-1].then if legs else orbit
            assert isinstance(begin, PeriodicOrbit)  # else nobody asks for a drift from there
            legs.append(flow.leg(begin))
        yield legs[k]


def _at(sheet: Sheet, spin: float, leaps: Sequence[Leap] = ()) -> Later:
    """Return the motion at a spin of a sheet; where no orbit is found, with the circle of the nearest orbit."""
    orbit = attempt(sheet.at, spin) or min(sheet.orbits, key=lambda one: abs(one.spin - spin))
    return Later(spin, orbit.radius, orbit.period, orbit.zeta, leaps=tuple(leaps))


def _by_run(orbit: PeriodicOrbit, periods: float, leaps: list[Leap]) -> Later:
    """Return the motion after a run of some forcing periods from an orbit."""
    run = orbit.run(max(1, round(periods)), record=False)
    if not run.orbit:
        return Later(np.nan, np.nan, np.nan, np.nan, run.mode, tuple(leaps))
    return Later(run.orbit.spin, run.orbit.radius, run.orbit.period, run.orbit.zeta, run.mode, tuple(leaps))
