"""Sustained spins: friction neither gives spin nor takes it there, so that a dimer chooses its circle by itself."""

from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.map.finding import MOST_TURNS, RTOL, checked, orbit_at
from dimersweep.analysis.orbits.map.lost import first_found, require
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, dataset
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import Recorder
from dimersweep.analysis.orbits.slow.families import BEGIN_AT, spin_range
from dimersweep.analysis.orbits.slow.slow_flow import ABOVE, BELOW, SPIN_KINDS, SlowFlow
from dimersweep.cubes.cube import Column, finished, fixed_coordinates, table
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
    """Find the spins at which friction neither gives nor takes spin, and those between which the spin goes to and fro.

    The slow family is followed over its changes of sequence, to where the motion leaps, becomes unstable or ceases to
    exist. A run shows where the drift leads beyond. Only stable orbits count: no motion drifts along unstable ones.

    Parameters
    ----------
    spin : tuple of float, optional
        Least and greatest axial spin after the double impact [rad s-1]; by default from 0 to the end of the family. On
        a level plate the mirror image of a motion has the opposite spin.
    guess : Run or PeriodicOrbit, optional
        A recorded run, or an orbit, of the family that is meant, as for `find`. If the ends are not alike, it
        decides which end is down.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along `sustained`, by ascending spin, the following, and the attributes of a `PeriodicOrbit` (of a cycle,
        those at its least spin):

        * `kind`: "spin"; "plane", which has spin 0 and no radius; "end", where the drift leads to an end of a sheet,
          and back to it from beyond; "cycle"; or "kept", where no spin drifts.
        * `spin_low`, `spin_high`, `radius_low`, `radius_high`: the spins and radii between which a cycle goes to and
          fro; else both are the same.
        * `attracts`: whether the spin of motions nearby comes to it.
        * `slow_rate`: relative growth of a small deviation of the spin in a forcing period. The multiplier of the slow
          direction is 1 + `slow_rate`. It is -inf at an end, NaN for a cycle.
        * `slow_periods` and `slow_time`: forcing periods and time [s] in which the deviation changes by a factor of
          2.718, or of one round of a cycle.
        * `spin_error`: error of the spin by the accuracy of the map; at an end, the distance to the orbit beyond from
          which the drift leads back.

        Along `sheet`: `sheet_low` and `sheet_high`, least and greatest spin of a stretch of the family; `low_end` and
        `high_end`, why it ends there (empty if it does not); `low_leads` and `high_leads`, the spin or the mode to
        which a run leads from there. The attribute `cost` says how many forcing periods of the map were run.

    Raises
    ------
    ParameterError
        For an unknown parameter, or if the first spin is not below the second.
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
        why = "beyond the range" if one.stable else "unstable"
        require(one.stable and low <= one.spin <= high, f"the orbit of spin = {one.spin:.6g} rad/s is {why}")
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
    """Yield the orbit of each sustained spin and each cycle (at its least spin), with the values of `MEANINGS`."""
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
    """Return the sustained spins, the cycles and the sheets as labelled data."""

    def leads(number: int, end: bool) -> str:
        led = flow.lead(number, end)[0] if flow.drifts_over(number, end) else ""
        return led if isinstance(led, str) else f"spin = {led.spin:.6g} rad/s"

    found, sheets = sorted(_rows(flow, given["f"]), key=lambda one: one[0].spin), flow.sheets
    columns = [
        Column(name, said, [row[k] for _, row in found], SPIN_KINDS if name == "kind" else ())
        for k, (name, said) in enumerate(MEANINGS.items())
    ]
    said = "of a stretch of the family"
    ends = [
        Column("sheet_low", Quantity("rad s-1", f"least spin {said}"), [one.spins[0] for one in sheets]),
        Column("sheet_high", Quantity("rad s-1", f"greatest spin {said}"), [one.spins[-1] for one in sheets]),
        Column("low_end", "why it ends below", [one.low_end for one in sheets]),
        Column("high_end", "why it ends above", [one.high_end for one in sheets]),
        Column("low_leads", "where its lower end leads", [leads(k, BELOW) for k in range(len(sheets))]),
        Column("high_leads", "where its upper end leads", [leads(k, ABOVE) for k in range(len(sheets))]),
    ]
    made = dataset([orbit for orbit, _ in found], "sustained", columns).drop_vars("cost")
    made = made.assign(table((), ends, "sheet").data_vars)
    made = made.assign_coords(fixed_coordinates(given)).assign_attrs(rtol=rtol, cost=recorder.periods)
    return finished(made, "Axial spins at which nothing drifts")
