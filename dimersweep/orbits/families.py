"""The slow family: the orbits of all spins, and how a motion creeps along them.

A dimer on a circular orbit loses spin, so slowly that all else follows: it goes through the orbits of the family one after
the other. The motion is that of the slow manifold, which lies beside the fixed points of the fast part by what the fast part
lags behind: the change of the spin per period, carried through (1 - J)^-1. The family tells what a run tells there.
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.finding import RTOL, centred, checked, orbit_at
from dimersweep.orbits.following import Trace, traced
from dimersweep.orbits.manifold import lag, slow_direction
from dimersweep.orbits.orbit import Orbit, as_seen, orbit_of
from dimersweep.orbits.return_map import OrbitLost
from dimersweep.orbits.solving import Fixed, solve, system
from dimersweep.orbits.tables import dataset
from dimersweep.parameters import as_number, check_count, check_rtol

ASIDE = 0.05  # distance from where the family leads, in units of the section
STEPS = 60  # of a branch from one spin to the next, where Newton's method does not get there at once
SHOWN = ("radius", "period", "zeta", "speed", "precession_rate", "impact_phase", "di_end")
TOLD = ("radius", "period", "zeta")


class Seen(NamedTuple):
    """A point of the family: the fixed point, and the orbit as a run shows it."""

    fixed: Fixed
    orbit: Orbit


def family(*, spin: tuple[float, float], points: int = 50, rtol: float = RTOL, **parameters: float) -> xr.Dataset:
    """The orbits of one set of parameters at all spins.

    Parameters
    ----------
    spin : tuple of float
        Least and greatest axial spin after the double impact [rad s-1].
    points : int
        Number of spins, evenly spaced.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Of the model.

    Returns
    -------
    xarray.Dataset
        Along `spin`: what an `Orbit` tells, as far as the family goes. The attributes `low_end` and `high_end` say why
        it ends ("asked for" where it does not), `cost` how many forcing periods of the map it took.

    Raises
    ------
    ParameterError
        For an unknown parameter or a range that is none.
    OrbitError
        If there is no orbit at any of the spins.
    """
    spins = np.linspace(*_range(spin), check_count("points", points))
    given = checked(parameters)
    first, begin = _anywhere(spins, given, check_rtol(rtol))
    tape = first.fixed.map.tape
    start = tape.spent.periods
    seen = {begin: seen_at(first.fixed)}
    ends = {}
    for name, order in (("high_end", range(begin + 1, spins.size)), ("low_end", range(begin - 1, -1, -1))):
        ends[name] = _along(seen, spins, order)
    kept = sorted(seen)
    table = dataset([seen[k].orbit for k in kept], "spin_")
    table = table.drop_vars("spin").rename_dims({"spin_": "spin"}).assign_coords(spin=("spin", spins[kept]))
    table["spin"].attrs = {"units": "rad s-1", "long_name": "axial spin after the double impact"}
    table = table.drop_vars("cost")
    del table.attrs["units_of"]
    table.attrs |= ends | {"cost": tape.spent.periods - start + first.cost, "rtol": rtol}
    return table


def _range(spin: tuple[float, float]) -> tuple[float, float]:
    try:
        low, high = spin
    except (TypeError, ValueError):
        raise ParameterError(f"spin = {spin!r}: must be the least and the greatest spin") from None
    low, high = as_number("spin", low), as_number("spin", high)
    if low >= high:
        raise ParameterError(f"spin = ({low:g}, {high:g}): the first must be below the second")
    return low, high


def _anywhere(spins: np.ndarray, given: dict[str, float], rtol: float) -> tuple[Orbit, int]:
    """An orbit at one of the spins: the middle one, or one of a few others."""
    reason = OrbitError("")
    for share in (0.5, 0.25, 0.75, 0.0, 1.0):
        k = round(share * (spins.size - 1))
        try:
            return orbit_at(given, float(spins[k]), rtol=rtol), k
        except OrbitError as error:
            reason = error
    raise OrbitError(f"spin = ({spins[0]:g}, {spins[-1]:g}): no orbit found; {reason}")


def _along(seen: dict[int, Seen], spins: np.ndarray, order: range) -> str:
    """Solve at one spin after the other, until there is no orbit; why the family ends."""
    fixed = seen[order.start - order.step].fixed
    for k in order:
        spin = float(spins[k])
        try:
            fixed = _next(fixed, spin)
        except OrbitLost:
            branch = traced(orbit_of(fixed, 0.0), "spin", spin, STEPS)
            if not branch.end.startswith("to:"):
                return _why(branch)
            fixed = branch.entries[-1].orbit.fixed
        seen[k] = seen_at(fixed)
    return "asked for"


def _next(fixed: Fixed, spin: float) -> Fixed:
    """The orbit at another spin, along the family.

    Raises
    ------
    OrbitLost
        If there is none nearby, or one so far from where the family leads that it may be another one's.
    """
    m = fixed.map
    along, _ = slow_direction(fixed)
    z = fixed.z + along * (spin - fixed.image.spin) / m.unit
    nxt = solve(m, z, spin, system(m, fixed.matrix, fixed.gradient))
    if np.abs(nxt.z - z).max() > ASIDE:
        raise OrbitLost("the next orbit lies aside of the family")
    return centred(nxt)


def _why(branch: Trace) -> str:
    """Where and why the family ends."""
    special = [entry for entry in branch.entries if entry.special]
    for entry in reversed(special):
        if entry.special == "fold":
            return f"fold at spin = {entry.value:.6g} rad/s"
    return f"{branch.end}, at spin = {branch.entries[-1].value:.6g} rad/s"


def seen_at(fixed: Fixed) -> Seen:
    """A fixed point, and the orbit of a motion that passes its spin on the slow manifold."""
    m, away = fixed.map, lag(fixed)
    told = orbit_of(fixed, 0.0)
    try:
        image = m.image(fixed.z + away)
    except OrbitLost:
        return Seen(fixed, told)
    moved = orbit_of(as_seen(fixed._replace(image=image, z=fixed.z + away)), 0.0)
    return Seen(fixed, replace(told, **{name: getattr(moved, name) for name in SHOWN}))


class Later(NamedTuple):
    """A motion some periods on.

    Attributes
    ----------
    spin : float
        After the double impact [rad s-1].
    radius, period, zeta : float
        Of the orbit [m, s, rad].
    """

    spin: float
    radius: float
    period: float
    zeta: float


def later(family: xr.Dataset, *, spin: float, periods: float) -> Later:
    """The motion so many forcing periods after it had a spin, by quadrature of the slow rate.

    The spin obeys s(n + 1) = s(n) + d(s(n)); the flow ds/dn = d - d d'/2 has this map to second order.

    Parameters
    ----------
    family : xarray.Dataset
        From `family`.
    spin : float
        Axial spin after the double impact, as `Run.orbit.spin_rate` tells it [rad s-1].
    periods : float
        Forcing periods, forwards; backwards if negative.

    Returns
    -------
    Later

    Raises
    ------
    ParameterError
        If the spin is beyond the family, or the motion comes to its end before.
    """
    spin, periods = as_number("spin", spin), as_number("periods", periods)
    spins = family["spin"].values
    if spins.size < 4:
        raise ParameterError(f"family: has {spins.size} points; needs at least 4")
    if not spins[0] <= spin <= spins[-1]:
        raise ParameterError(f"spin = {spin:g}: the family goes from {spins[0]:g} to {spins[-1]:g} rad/s")
    at_end = _spin_after(spins, family["spin_drift"].values, spin, periods)
    told = {}
    for name in TOLD:
        values = family[name].values
        known = np.isfinite(values)  # in a plane there is no circle
        told[name] = float(CubicSpline(spins[known], values[known])(at_end))
    return Later(spin=at_end, **told)


def _spin_after(spins: np.ndarray, drift: np.ndarray, spin: float, periods: float) -> float:
    """The spin after some periods."""
    rate = CubicSpline(spins, drift)
    flow = CubicSpline(spins, drift * (1 - rate.derivative()(spins) / 2))

    def needed(to: float) -> float:
        inner = [s for s in spins if min(spin, to) < s < max(spin, to)]
        edges = [spin, *(inner if to > spin else inner[::-1]), to]
        return sum(quad(lambda s: 1 / flow(s), a, b)[0] for a, b in pairwise(edges))

    falls = (flow(spin) < 0) == (periods > 0)
    edge = float(spins[0] if falls else spins[-1])
    if periods == 0:
        return spin
    most = needed(edge) if edge != spin else 0.0
    if abs(periods) > abs(most):
        raise ParameterError(f"periods = {periods:g}: the motion comes to the end of the family after {abs(most):.0f}")
    return float(brentq(lambda to: needed(to) - periods, spin, edge, xtol=1e-12 * abs(spin)))
