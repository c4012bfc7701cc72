"""Sustained spins: where friction neither gives spin nor takes it, and the circle that a dimer chooses by itself."""

from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import OrbitError
from dimersweep.inputs import check_rtol
from dimersweep.orbits.families import BEGIN_AT, run_onto, spin_range
from dimersweep.orbits.finding import MOST_TURNS, RTOL, checked, orbit_at
from dimersweep.orbits.orbit import Column, PeriodicOrbit, dataset
from dimersweep.orbits.poincare import TURN, OrbitLost, Recorder, first_found
from dimersweep.orbits.slow_flow import Arrival, Sheet, Standing, landing, sheet_through, standing, time_between
from dimersweep.runs.run import Run
from dimersweep.symbols import Quantity

MOST_SHEETS = 16  # that are followed
BEYOND = 1e-3  # share of the spin beyond an end of a sheet at which another one is looked for
RUN_ON = 1000  # forcing periods of a run over the end of a sheet that comes to no orbit
BELOW, ABOVE = False, True  # the ends of a sheet


class Cycle(NamedTuple):
    """Stretches of sheets that lead to one another over their ends: the spin goes to and fro for good."""

    orbits: list[PeriodicOrbit]
    periods: float  # forcing periods of one round


class SlowFlow:
    """The sheets of one set of parameters between two spins, and where they lead."""

    def __init__(self, first: PeriodicOrbit, low: float, high: float) -> None:
        self.sheets: list[Sheet] = []
        self.standing: list[list[Standing]] = []
        self.leads: dict[tuple[int, bool], Arrival | str] = {}  # over which end of which sheet
        waiting = [first]
        while waiting and len(self.sheets) < MOST_SHEETS:
            orbit = waiting.pop(0)
            if self.of(orbit) is None:
                sheet = sheet_through(orbit, low, high)
                waiting += self._add(sheet) if sheet.spins.size > 1 else []

    def of(self, orbit: PeriodicOrbit) -> int | None:
        """The number of the sheet that an orbit is on, if it is known."""
        return next((k for k, sheet in enumerate(self.sheets) if sheet.holds(orbit)), None)

    def _add(self, sheet: Sheet) -> Iterator[PeriodicOrbit]:
        """Add a sheet; the orbits of others, as far as its ends lead to any."""
        number = len(self.sheets)
        self.sheets.append(sheet)
        self.standing.append(list(standing(sheet)))
        for end, sense, why in ((BELOW, -1.0, sheet.low_end), (ABOVE, 1.0, sheet.high_end)):
            last = sheet.orbits[-end]
            if not why:
                continue
            try:
                if sense * last.spin_drift > 0:
                    self.leads[number, end] = found = landing(last)
                    yield found.orbit
                else:  # no motion drifts over it, but the family may go on
                    yield run_onto(last, last.spin + sense * BEYOND * abs(last.spin), np.inf)
            except OrbitLost:
                if sense * last.spin_drift > 0:
                    self.leads[number, end] = last.run(RUN_ON).mode

    def cycles(self) -> list[Cycle]:
        """Those between the sheets, each once."""
        found: dict[frozenset[tuple[int, bool]], Cycle] = {}
        for begin in self.leads:
            path: list[tuple[int, bool]] = []
            at: tuple[int, bool] | None = begin
            while at is not None and at not in path:
                path.append(at)
                at = self._next(at)
            if at is not None:
                around = path[path.index(at) :]
                found.setdefault(frozenset(around), self._cycle(around))
        return list(found.values())

    def _next(self, at: tuple[int, bool]) -> tuple[int, bool] | None:
        """The end of a sheet over which the spin goes next, after one; None if it comes to stand, or leaves what is known."""
        led = self.leads.get(at)
        number = self.of(led.orbit) if isinstance(led, Arrival) else None
        if not isinstance(led, Arrival) or number is None:
            return None
        drift = led.orbit.spin_drift
        stands = any((one.orbit.spin - led.orbit.spin) * drift > 0 for one in self.standing[number])
        return None if stands or drift == 0 else (number, drift > 0)

    def _cycle(self, around: list[tuple[int, bool]]) -> Cycle:
        orbits, periods = [], 0.0
        for (number, end), before in zip(around, [around[-1], *around[:-1]], strict=True):
            led = self.leads[before]
            assert isinstance(led, Arrival)
            sheet = self.sheets[number]
            last, spin = float(sheet.spins[-end]), led.orbit.spin
            orbits += [led.orbit, *(one for one in sheet.orbits if min(spin, last) <= one.spin <= max(spin, last))]
            periods += led.periods + time_between(sheet, spin, last)
        return Cycle(orbits, periods)


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
        Along `sustained`, by ascending spin: `kind`, "spin" or "cycle"; `spin_low` and `spin_high`, between which the spin
        goes to and fro, and `radius_low` and `radius_high` (both alike for a spin); whether it `attracts`; `slow_rate`, of the
        distance from the spin per forcing period and in units of itself (1 + it is the multiplier of the slow direction), NaN
        for a cycle; `slow_periods` and `slow_time`, in which that falls or grows by e, or once round a cycle; `spin_error`, by
        that of the map; and the attributes of a `PeriodicOrbit`, for a cycle those at its least spin.
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
    return _dataset(SlowFlow(first, low, high), given, recorder, rtol)


class Row(NamedTuple):
    """A row of the result, beside its orbit."""

    kind: str
    spin_low: float
    spin_high: float
    radius_low: float
    radius_high: float
    attracts: bool
    slow_rate: float
    slow_periods: float
    slow_time: float
    spin_error: float


MEANINGS: dict[str, Quantity | str] = {
    "kind": "whether the spin stands still, or goes to and fro on a cycle",
    "spin_low": Quantity("rad s-1", "least axial spin after the double impact"),
    "spin_high": Quantity("rad s-1", "greatest axial spin after the double impact"),
    "radius_low": Quantity("m", "least radius"),
    "radius_high": Quantity("m", "greatest radius"),
    "attracts": "whether the spin of motions nearby comes to it",
    "slow_rate": Quantity("1", "growth per forcing period of what the spin is off, in units of itself"),
    "slow_periods": Quantity("1", "forcing periods in which that changes by a factor of e, or once round the cycle"),
    "slow_time": Quantity("s", "the same as a time"),
    "spin_error": Quantity("rad s-1", "how well the spin is known, by the accuracy of the map"),
}


def _rows(flow: SlowFlow, f: float) -> Iterator[tuple[PeriodicOrbit, Row]]:
    """The orbit and the row of each spin and each cycle; of a cycle the orbit of the least spin."""
    for one in chain.from_iterable(flow.standing):
        spin, radius, rate = one.orbit.spin, one.orbit.radius, one.rate
        slow = 1 / abs(rate) if rate else np.inf
        yield one.orbit, Row("spin", spin, spin, radius, radius, rate < 0, rate, slow, slow / f, one.error)
    for cycle in flow.cycles():
        (low, high), (near, far) = (
            (min(each), max(each)) for each in zip(*((one.spin, one.radius) for one in cycle.orbits), strict=True)
        )
        least = min(cycle.orbits, key=lambda one: one.spin)
        yield least, Row("cycle", low, high, near, far, True, np.nan, cycle.periods, cycle.periods / f, np.nan)


def _dataset(flow: SlowFlow, given: dict[str, float], recorder: Recorder, rtol: float) -> xr.Dataset:
    """What was found, as labelled data."""
    found = sorted(_rows(flow, given["f"]), key=lambda one: one[0].spin)
    columns: dict[str, Column] = {
        name: ([getattr(row, name) for _, row in found], said) for name, said in MEANINGS.items()
    }
    table = dataset([orbit for orbit, _ in found], "sustained", columns).drop_vars("cost")
    for name, (values, said) in _sheets(flow).items():
        table[name] = ("sheet", values, said.attributes())
    return table.assign_attrs(given | {"rtol": rtol, "cost": recorder.periods})


def _sheets(flow: SlowFlow) -> dict[str, tuple[np.ndarray, Quantity]]:
    def leads(number: int, end: bool) -> str:
        led = flow.leads.get((number, end), "")
        return f"spin = {led.orbit.spin:.6g} rad/s" if isinstance(led, Arrival) else led

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
