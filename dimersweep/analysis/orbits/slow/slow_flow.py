"""The slow flow: the sheets along which the spin drifts, one after the other, and its limit after a long time.

Where the drift leads over the end of a sheet, a run goes on from there: to another sheet, or to a motion that is on no
sheet. Sheets may lead to one another: then the spin goes to and fro between their ends for good.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.finding import MOST_TURNS, of_run, orbit_through
from dimersweep.analysis.orbits.map.lost import OrbitLost, all_found, attempt, require
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.slow.sheets import (
    NEUTRAL,
    Sheet,
    Standing,
    sheet_through,
    standing,
    taken_up,
    time_between,
)
from dimersweep.errors import OrbitError
from dimersweep.kernel.model.layout import DOWN_WORDS
from dimersweep.runs.run import Run

# forcing periods of the stages of a run over the end of a sheet: it stops after the first stage by which it has settled
LANDS_AFTER = (100, 300, 1000, 3000)
# distance of such a run from an orbit, in units of the section, below which it has come to it: Newton's
# method may find another
LANDED = 0.02
MOST_SHEETS = 16  # greatest number of sheets that are followed: none of 40 random dimers has more
# the ends of a sheet: its last orbit there is `orbits[-end]`, which is `orbits[0]` below
BELOW, ABOVE = False, True
SPIN_KINDS = ("spin", "end", "cycle", NEUTRAL, "plane")  # kinds of limits of the spin after a long time


def landing(end: PeriodicOrbit) -> tuple[PeriodicOrbit | Standing | str, float]:
    """Find the orbit that a run reaches which drifts over the end of a sheet, and the forcing periods that it takes.

    Without such an orbit, the mode of the run stands in its place. Where motions alternate at the end, the run does not
    settle. Then the drift of an orbit beyond decides: if it leads back, the spin stays at the end, a `Standing`.
    """
    led, periods = _landed(end, any_period=False)
    if isinstance(led, PeriodicOrbit):
        return led, periods
    beyond = attempt(taken_up, end, np.sign(end.spin_drift), np.inf)
    if beyond is None:
        return _landed(end, any_period=True)
    way = abs(beyond.spin - end.spin)
    back = beyond.spin_drift * end.spin_drift < 0
    return (Standing(end, -np.inf, way), np.inf) if back else (beyond, way / abs(end.spin_drift))


def _landed(end: PeriodicOrbit, any_period: bool) -> tuple[PeriodicOrbit | str, float]:
    """Return the stable orbit that a run from the end of a sheet reaches, or its mode without one, and its periods.

    The orbit must have the period of the orbit `end`, unless `any_period`. The run goes on in stages of
    `LANDS_AFTER` forcing periods, and is tested after each of them.
    """
    m = end.fixed.map
    run = end.run(LANDS_AFTER[0], m.rtol)
    for more in (0, *LANDS_AFTER[1:]):
        run = run.go_on(more) if more else run
        if run.mode in DOWN_WORDS or not (run.mode_period if any_period else run.mode_period == m.periods):
            continue
        if orbit := attempt(_orbit_near, run, replace(m, periods=run.mode_period)):
            return orbit, run.n_periods
    return run.mode, run.n_periods


def _orbit_near(run: Run, m: ReturnMap) -> PeriodicOrbit:
    """Find the stable orbit that a run has come to."""
    own, z = of_run(run, m)
    orbit = orbit_through(own, z)
    require(orbit.stable and np.abs(orbit.slow_motion.z - z).max() < LANDED, "the run has come to no stable orbit")
    return orbit


class DriftLeg(NamedTuple):
    """A drift of the spin along one sheet, from an orbit to a spin at which nothing drifts, or to the sheet's end."""

    sheet: Sheet
    begin: PeriodicOrbit
    to: float  # spin at its end [rad/s]
    periods: float  # forcing periods up to there; infinite if nothing drifts there
    then: PeriodicOrbit | Standing | str  # spin at which nothing drifts or, at an end of the sheet, where a run leads
    landing: float = np.inf  # forcing periods of that run: see the function `landing`


class Cycle(NamedTuple):
    """Stretches of sheets that lead to one another over their ends: the spin goes to and fro for good."""

    orbits: list[PeriodicOrbit]  # all orbits of one round
    periods: float  # forcing periods of one round
    kind: str = "cycle"


class SlowFlow:
    """The sheets of one set of parameters between two spins, followed when they are asked for, and where they lead.

    Parameters
    ----------
    low, high : float
        Least and greatest spin [rad/s].
    whole : bool
        Whether sheets are followed to both of their ends, or along the drift alone, up to a spin at
        which nothing drifts.
    """

    def __init__(self, low: float, high: float, whole: bool) -> None:
        self.low, self.high, self.whole = low, high, whole
        self.sheets: list[Sheet] = []
        self.standing: list[list[Standing]] = []  # the spins at which nothing drifts, of each sheet
        # results of `landing`, by number of the sheet and end
        self.leads: dict[tuple[int, bool], tuple[PeriodicOrbit | Standing | str, float]] = {}

    def sheet_of(self, orbit: PeriodicOrbit) -> int:
        """Return the number of the sheet that a stable orbit is on; a new sheet is followed, up to `MOST_SHEETS`."""
        for number, sheet in enumerate(self.sheets):
            if sheet.holds(orbit):
                return number
        require(len(self.sheets) < MOST_SHEETS, f"the drift leads over more than {MOST_SHEETS} sheets")
        sheet = sheet_through(orbit, self.low, self.high, self.whole)
        ends = f"the family does not go on from spin = {orbit.spin:.6g} rad/s: {sheet.high_end}"
        require(sheet.spins.size > 1, ends)
        stands = list(standing(sheet))
        known = {one.spin: one for one in (*sheet.orbits, *(one.orbit for one in stands))}
        sheet = replace(sheet, orbits=[known[spin] for spin in sorted(known)])
        for number, part in enumerate(self.sheets):
            # a known sheet is a part of the new one: followed from another orbit, it ended sooner
            if sheet.holds(part.orbits[len(part.orbits) // 2]):
                return self._grow(number, sheet)
        self.sheets.append(sheet)
        self.standing.append(stands)
        return len(self.sheets) - 1

    def _grow(self, number: int, longer: Sheet) -> int:
        """Add to a sheet the orbits that a longer one has beyond its ends; return the number of the sheet."""
        part = self.sheets[number]
        below = [one for one in longer.orbits if one.spin < part.spins[0]]
        above = [one for one in longer.orbits if one.spin > part.spins[-1]]
        ends = (longer.low_end if below else part.low_end, longer.high_end if above else part.high_end)
        self.sheets[number] = Sheet([*below, *part.orbits, *above], *ends)
        self.standing[number] = list(standing(self.sheets[number]))
        for end, more in ((BELOW, below), (ABOVE, above)):
            if more:
                self.leads.pop((number, end), None)
        return number

    def drifts_over(self, number: int, end: bool) -> bool:
        """Return True if a motion drifts over an end of a sheet."""
        sheet = self.sheets[number]
        return bool(sheet.high_end if end else sheet.low_end) and sheet.orbits[-end].spin_drift * (1 if end else -1) > 0

    def lead(self, number: int, end: bool) -> tuple[PeriodicOrbit | Standing | str, float]:
        """Return the result of `landing` at an end of a sheet; the run is made once."""
        if (number, end) not in self.leads:
            self.leads[number, end] = landing(self.sheets[number].orbits[-end])
        return self.leads[number, end]

    def explore(self, first: PeriodicOrbit) -> None:
        """Follow the sheet of an orbit, all sheets to which its ends lead, and so on."""
        waiting, seen = [first], 0
        while waiting:
            try:
                self.sheet_of(waiting.pop(0))
            except OrbitLost:
                if not self.sheets:
                    raise
            while seen < len(self.sheets):
                waiting += self._led_to(seen)
                seen += 1

    def _led_to(self, number: int) -> Iterator[PeriodicOrbit]:
        """Yield the orbits to which the ends of a sheet lead."""
        sheet = self.sheets[number]
        for end, sense, why in ((BELOW, -1.0, sheet.low_end), (ABOVE, 1.0, sheet.high_end)):
            last = sheet.orbits[-end]
            if self.drifts_over(number, end):
                led, _ = self.lead(number, end)
                if isinstance(led, PeriodicOrbit):
                    yield led
            elif why:  # no motion drifts over this end, but the family may go on beyond it
                yield from all_found([partial(taken_up, last, sense, np.inf)])

    def leg(self, begin: PeriodicOrbit) -> DriftLeg:
        """Return the drift from an orbit on."""
        if begin.spin_drift == 0.0:  # both ends stick in every contact: friction changes no spin
            return DriftLeg(Sheet([begin], "", ""), begin, begin.spin, np.inf, Standing(begin, 0.0, 0.0))
        number, drift = self.sheet_of(begin), begin.spin_drift
        sheet, end = self.sheets[number], drift > 0
        ahead = [one for one in self.standing[number] if (one.spin - begin.spin) * drift >= 0]
        if ahead:
            stands = min(ahead, key=lambda one: abs(one.spin - begin.spin))
            return DriftLeg(sheet, begin, stands.spin, np.inf, stands)
        last = sheet.orbits[-end]
        require(self.drifts_over(number, end), f"the drift leads beyond spin = {last.spin:.6g} rad/s")
        periods = time_between(sheet.stretches, begin.spin, last.spin)
        return DriftLeg(sheet, begin, last.spin, periods, *self.lead(number, end))

    def way(self, begin: PeriodicOrbit) -> Iterator[DriftLeg]:
        """Yield the drifts from an orbit on, one after the other; a cycle is repeated without end."""
        while True:
            leg = self.leg(begin)
            yield leg
            if not isinstance(leg.then, PeriodicOrbit):
                return
            begin = leg.then

    def fate(self, begin: PeriodicOrbit) -> Standing | Cycle | str:
        """Return the limit of the spin of an orbit: a spin without drift, a cycle, or the mode of the last run."""
        legs: list[DriftLeg] = []
        for leg in self.way(begin):
            if not isinstance(leg.then, PeriodicOrbit):
                return leg.then
            same = [k for k, one in enumerate(legs) if one.then is leg.then]
            if same:
                return self._cycle([*legs[same[0] + 1 :], leg])
            legs.append(leg)
        raise AssertionError("a way ends with a leg that leads to no orbit")

    def cycles(self) -> list[Cycle]:
        """Return the cycles between the sheets, each once."""
        found: dict[frozenset[float], Cycle] = {}
        for led, _ in list(self.leads.values()):  # to follow the flow may find more of them
            try:
                fate = self.fate(led) if isinstance(led, PeriodicOrbit) else ""
            except OrbitError:
                continue
            if isinstance(fate, Cycle):
                found.setdefault(frozenset(one.spin for one in fate.orbits), fate)
        return list(found.values())

    def held(self) -> list[Standing]:
        """Return the ends of sheets at which the spin stays, since the drift beyond leads back."""
        return [led for led, _ in self.leads.values() if isinstance(led, Standing)]

    def _cycle(self, legs: list[DriftLeg]) -> Cycle:
        """Return the cycle of the drifts of one round."""
        orbits: list[PeriodicOrbit] = []
        for leg in legs:
            low, high = sorted((leg.begin.spin, leg.to))
            orbits += [leg.begin, *(one for one in leg.sheet.orbits if low <= one.spin <= high)]
        return Cycle(orbits, sum(leg.periods + leg.landing for leg in legs))


def flow_of(orbit: PeriodicOrbit, whole: bool = False) -> SlowFlow:
    """Return the slow flow of all spins with the sign of an orbit's spin: a drift does not change the sign."""
    most = MOST_TURNS * TURN * orbit.parameters["f"]
    return SlowFlow(0.0, most, whole) if orbit.spin >= 0 else SlowFlow(-most, 0.0, whole)
