"""Sustained spins: where friction neither gives spin nor takes it, and the circle that a dimer chooses by itself."""

from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.map.finding import MOST_TURNS, RTOL, checked, orbit_at
from dimersweep.analysis.orbits.map.orbit import Column, PeriodicOrbit, dataset
from dimersweep.analysis.orbits.map.poincare import TURN, OrbitLost, Recorder, first_found
from dimersweep.analysis.orbits.slow.families import BEGIN_AT, spin_range
from dimersweep.analysis.orbits.slow.slow_flow import ABOVE, BELOW, SPIN_KINDS, SlowFlow
from dimersweep.cubes.cube import column, finished, fixed_coordinates
from dimersweep.errors import OrbitError
from dimersweep.inputs import check_rtol
from dimersweep.runs.run import Run
from dimersweep.symbols import Quantity


def sustained(
    *,
    spin: tuple[float, float] | None = None,
    guess: Run | PeriodicOrbit | None = None,
    rtol: float = RTOL,
    **parameters: float,
) -> xr.Dataset:
    """The spins at which friction neither gives spin nor takes it, and those between which the spin goes to and fro.

    The slow family is followed over its changes of sequence, to where the motion leaps, becomes unstable or ceases; beyond, a
    run tells where it leads. Only stable orbits count: no motion drifts along others.

    Parameters
    ----------
    spin : tuple of float, optional
        Least and greatest axial spin after the double impact [rad s-1]; by default from 0 to where the family ends. On a level
        plate the mirror image of a motion has the opposite spin.
    guess : Run or PeriodicOrbit, optional
        A recorded run or an orbit of the family that is meant, as for `find`: of unlike ends, whichever end is down.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Of the model.

    Returns
    -------
    xarray.Dataset
        Along `sustained`, by ascending spin: `kind`: "spin"; "plane", which has spin 0 and no radius; "end" where the drift
        leads to an end of a sheet, and back to it from beyond; or "cycle". `spin_low` and `spin_high`, between which the spin
        goes to and fro, and `radius_low` and `radius_high`, else both alike; whether it `attracts`; `slow_rate`, of what is
        off the spin, per forcing period and in units of itself (1 + it is the multiplier of the slow direction; -inf at an
        end, NaN for a cycle); `slow_periods` and `slow_time`, in which that falls or grows by a factor of 2.718, or once
        round a cycle; `spin_error`, by that of the map, or where the drift is found to lead back to an end; and the
        attributes of a `PeriodicOrbit`, for a cycle those at its least spin.
        Along `sheet`: `sheet_low` and `sheet_high`, least and greatest spin of a stretch of the family, why it ends there
        (empty if it does not), and where it leads: to which spin, or what the run does.
        The attribute `cost` says how many forcing periods of the map it took.

    Raises
    ------
    ParameterError
        For an unknown parameter or a range that is none.
    OrbitError
        If there is no stable orbit.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> found = orbits.sustained(A_r=5, f=22, e=0.65, mu=0.1, mu_s=0.15, Gamma=0.9)
    >>> found["spin"].values.round(2).tolist(), found["attracts"].values.tolist()
    ([0.0, 87.11], [False, True])
    """
    given, rtol = checked(parameters, guess), check_rtol(rtol)
    low, high = (0.0, MOST_TURNS * TURN * given["f"]) if spin is None else spin_range(spin, given)
    begins = [None] if spin is None or guess is not None else [low + share * (high - low) for share in BEGIN_AT]
    recorder = Recorder()

    def begun(at: float | None) -> PeriodicOrbit:
        one = orbit_at(given, at, guess=guess, rtol=rtol, recorder=recorder)
        if not (one.stable and low <= one.spin <= high):
            why = "beyond the range" if one.stable else "unstable"
            raise OrbitLost(f"the orbit of spin = {one.spin:.6g} rad/s is {why}")
        return one

    try:
        first = first_found(partial(begun, at) for at in begins)
    except OrbitError as reason:
        raise OrbitError(f"no sustained spin: {reason}") from None
    flow = SlowFlow(low, high, whole=True)
    flow.explore(first)
    return _dataset(flow, given, recorder, rtol)


MEANINGS = {
    "kind": Quantity(
        "1",
        "whether the spin stands still, on a circle or in a plane, is held at an end, or goes to and fro on a cycle",
    ),
    "spin_low": Quantity("rad s-1", "least axial spin after the double impact"),
    "spin_high": Quantity("rad s-1", "greatest axial spin after the double impact"),
    "radius_low": Quantity("m", "least radius"),
    "radius_high": Quantity("m", "greatest radius"),
    "attracts": Quantity("1", "whether the spin of motions nearby comes to it"),
    "slow_rate": Quantity("1", "growth per forcing period of what the spin is off, in units of itself"),
    "slow_periods": Quantity(
        "1", "forcing periods in which that changes by a factor of 2.718, or once round the cycle"
    ),
    "slow_time": Quantity("s", "the same as a time"),
    "spin_error": Quantity("rad s-1", "how well the spin is known, by the accuracy of the map"),
}


def _rows(flow: SlowFlow, f: float) -> Iterator[tuple[PeriodicOrbit, tuple[Any, ...]]]:
    """The orbit of each spin and each cycle, of a cycle that of the least spin, and what `MEANINGS` has of it."""
    for one in (*chain.from_iterable(flow.standing), *flow.held()):
        spin, radius, rate = one.orbit.spin, one.orbit.radius, one.rate
        slow = 1 / abs(rate) if rate else np.inf
        yield one.orbit, (one.kind, spin, spin, radius, radius, rate < 0, rate, slow, slow / f, one.error)
    for cycle in flow.cycles():
        spins, radii = zip(*((one.spin, one.radius) for one in cycle.orbits), strict=True)
        between = (min(spins), max(spins), min(radii), max(radii))
        yield (
            cycle.orbits[spins.index(between[0])],
            (cycle.kind, *between, True, np.nan, cycle.periods, cycle.periods / f, np.nan),
        )


def _dataset(flow: SlowFlow, given: dict[str, float], recorder: Recorder, rtol: float) -> xr.Dataset:
    """What was found, as labelled data."""
    found = sorted(_rows(flow, given["f"]), key=lambda one: one[0].spin)
    columns: dict[str, Column] = {
        name: ([row[k] for _, row in found], said, SPIN_KINDS if name == "kind" else ())
        for k, (name, said) in enumerate(MEANINGS.items())
    }
    table = dataset([orbit for orbit, _ in found], "sustained", columns).drop_vars("cost")
    for name, (values, said) in _sheets(flow).items():
        table[name] = column("sheet", values, said)
    table = table.assign_coords(fixed_coordinates(given)).assign_attrs(rtol=rtol, cost=recorder.periods)
    return finished(table, "Axial spins at which nothing drifts")


def _sheets(flow: SlowFlow) -> dict[str, tuple[np.ndarray, Quantity]]:
    def leads(number: int, end: bool) -> str:
        led = flow.lead(number, end) if flow.drifts_over(number, end) else ""
        return led if isinstance(led, str) else f"spin = {led.orbit.spin:.6g} rad/s"

    numbers = range(len(flow.sheets))
    said = "of a stretch of the family"
    return {
        "sheet_low": (np.array([one.spins[0] for one in flow.sheets]), Quantity("rad s-1", f"least spin {said}")),
        "sheet_high": (np.array([one.spins[-1] for one in flow.sheets]), Quantity("rad s-1", f"greatest spin {said}")),
        "low_end": (np.array([one.low_end for one in flow.sheets]), Quantity("1", "why it ends below")),
        "high_end": (np.array([one.high_end for one in flow.sheets]), Quantity("1", "why it ends above")),
        "low_leads": (np.array([leads(k, BELOW) for k in numbers]), Quantity("1", "where its lower end leads")),
        "high_leads": (np.array([leads(k, ABOVE) for k in numbers]), Quantity("1", "where its upper end leads")),
    }
