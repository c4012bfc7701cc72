"""The slow flow: how the spin drifts from orbit to orbit, and the spins at which it stands still.

A *sheet* is a stretch of the slow family over which the motion changes steadily with the spin, kinks where the symbol sequence
changes among it. It ends where the motion leaps to another one, ceases to be stable, or ceases. Where the drift leads over an
end, a run goes on from there, to another sheet or another motion. Two sheets may lead to one another: then the spin goes to and
fro between their ends for good.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from dimersweep.kernel.model.layout import FREE, PERIOD, PHASE
from dimersweep.kernel.record import SEGMENT_MODES
from dimersweep.orbits.continuation import LOCATED
from dimersweep.orbits.families import flow_along, on_family, step_along
from dimersweep.orbits.manifold import slow_motion_near, slow_motion_of
from dimersweep.orbits.newton import solve
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost, first_found

# steps of the spin, as shares of it or of `SLOW_SPIN`: the first, the longest, that after a change of sequence; their growth
FIRST, WIDEST_STEP, AFTER_CHANGE, GROWTH = 0.02, 0.05, 3e-4, 1.5
SLOW_SPIN = 0.1  # spin below which steps are no shorter, in units of the section
LEAPT = 3.0  # way of a motion over a step, in units of that which the step before leads to expect, beyond which it has leapt
ROUNDED = 1e-4  # of such a way, in units of the section, that rounding may add
SLOPE_OVER = (0.05, 0.2, 0.01)  # shares of a step over which the slope of the drift is taken, in the order of trial
ON_SHEET, NEAR_SHEET = 1e-4, 1e-3  # shares by which numbers of one orbit may differ; from those between its neighbours
MOST_POINTS = 1000  # of a sheet to either side
LANDS_AFTER = (100, 300, 1000, 3000)  # forcing periods of a run over the end of a sheet, one after the other
LANDED = 0.02  # distance of such a run from an orbit, in units of the section, below which it has come to it


@dataclass
class Sheet:
    """Orbits of a stretch of the slow family, by ascending spin, and why it ends below and above; none where it goes on."""

    orbits: list[PeriodicOrbit]
    low_end: str
    high_end: str

    @cached_property
    def spins(self) -> np.ndarray:
        """Of the orbits [rad/s]."""
        return np.array([one.spin for one in self.orbits])

    def at(self, spin: float) -> PeriodicOrbit:
        """The orbit of a spin; lost if it is found from neither of the two nearest ones."""
        near = [self.orbits[k] for k in np.argsort(np.abs(self.spins - spin))[:2]]
        return near[0] if near[0].spin == spin else first_found(partial(step_along, [one], spin) for one in near)

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Whether an orbit is one of the sheet."""
        if not self.spins[0] <= orbit.spin <= self.spins[-1] or orbit.periods != self.orbits[0].periods:
            return False
        told, columns = [orbit.impact_phase, orbit.speed], [(one.impact_phase, one.speed) for one in self.orbits]
        try:
            there = self.at(orbit.spin)
        except OrbitLost:  # there the map has no derivatives that are of use
            return np.allclose(
                told, [np.interp(orbit.spin, self.spins, each) for each in np.array(columns).T], rtol=NEAR_SHEET
            )
        return np.allclose(told, [there.impact_phase, there.speed], rtol=ON_SHEET)


def onward(first: PeriodicOrbit, to: float) -> Iterator[PeriodicOrbit]:
    """The orbits of a sheet from one on, up to a spin; lost where it ends before, once it is known where.

    On both sides of a change of sequence there is one.
    """
    last, sense, unit = [first], np.sign(to - first.spin), SLOW_SPIN * first.fixed.map.unit
    step = FIRST * max(abs(first.spin), unit)
    spin = first.spin
    for _ in range(MOST_POINTS):
        if spin == to:
            return
        here, scale = last[0].spin, max(abs(last[0].spin), unit)
        step = min(step, WIDEST_STEP * scale)
        whole = unit if to == 0 and step == WIDEST_STEP * scale else 1.01 * step
        spin = to if (to - here) * sense <= whole else here + sense * step
        short = step <= LOCATED * scale or spin == 0  # what moves in a plane has a sequence of its own
        try:
            nxt = _steadily(last, spin, over_change=short)
        except OrbitLost:
            if step <= LOCATED * scale:
                raise
            step, spin = max(0.5 * min(abs(spin - here), step), LOCATED * scale), here
            continue
        yield nxt
        step = AFTER_CHANGE * scale if nxt.sequence != last[0].sequence else GROWTH * step
        last = [nxt, *last[:2]]
    raise OrbitLost(f"more than {MOST_POINTS} steps lead on")


def _steadily(last: list[PeriodicOrbit], spin: float, over_change: bool) -> PeriodicOrbit:
    """The orbit at another spin; lost if the motion has leapt, is unstable, or (unless `over_change`) of another sequence."""
    here, nxt = last[0], step_along(last, spin)
    if not nxt.stable:
        raise OrbitLost("the orbit becomes unstable")
    if nxt.sequence != here.sequence and not over_change:
        raise OrbitLost("the sequence changes")
    if len(last) > 1:
        points = [one.fixed for one in (nxt, here, last[1])]
        if len({(one.map.phase, one.z.size) for one in points}) == 1:
            b, a, before = (one.z for one in points)
            pace = np.abs(a - before).max() / abs(here.spin - last[1].spin)
            if np.abs(b - a).max() > LEAPT * pace * abs(spin - here.spin) + ROUNDED:
                raise OrbitLost("the motion leaps")
    return nxt


def sheet_through(orbit: PeriodicOrbit, low: float, high: float) -> Sheet:
    """The sheet of an orbit between two spins."""
    begin = on_family(orbit.fixed.map, orbit.slow_motion)
    below, low_end = _as_far_as(begin, low)
    above, high_end = _as_far_as(begin, high)
    return Sheet([*below[::-1], begin, *above], low_end, high_end)


def _as_far_as(begin: PeriodicOrbit, to: float) -> tuple[list[PeriodicOrbit], str]:
    """The orbits of a sheet from one on, and why it ends; nothing if it goes on."""
    found: list[PeriodicOrbit] = []
    try:
        for one in onward(begin, to):
            found.append(one)
    except OrbitLost as reason:
        return found, str(reason)
    return found, ""


class Arrival(NamedTuple):
    """Where a run comes to that drifts over the end of a sheet."""

    orbit: PeriodicOrbit
    periods: float  # forcing periods on the way


def landing(end: PeriodicOrbit) -> Arrival:
    """Where a run comes to that drifts over the end of a sheet; lost, with what it does, if it comes to no orbit."""
    m = end.fixed.map
    state, why, begun = m.state(end.slow_motion.z), OrbitLost("the run comes to no orbit"), m.recorder.periods
    for periods in LANDS_AFTER:
        for _ in range(periods):
            state[[PHASE, PERIOD]] = 0.0
            state, _, passage = m.recorder.run(m.row, state, m.periods, m.rtol)
        if (passage.segments[:, SEGMENT_MODES : SEGMENT_MODES + 2] != FREE).all():
            raise OrbitLost("the motion dies: both ends stay on the plate")
        taken = m.recorder.periods - begun
        try:
            own, z = m.moved(passage)
            fixed = solve(own, z, own.image(z).spin)
            orbit = orbit_of(fixed, slow_motion_of(fixed))
        except OrbitLost as reason:
            why = reason
            continue
        if orbit.stable and np.abs(orbit.slow_motion.z - z).max() < LANDED:
            return Arrival(orbit, taken)
    raise why


def rates(sheet: Sheet) -> Iterator[tuple[float, float, CubicSpline]]:
    """The rate ds/dn along a sheet, from one change of sequence to the next: least and greatest spin there, and a spline."""
    for _, stretch in groupby(sheet.orbits, key=lambda one: one.sequence):
        spins, drifts = np.array([(one.spin, one.spin_drift) for one in stretch]).T
        if spins.size > 1:
            yield spins[0], spins[-1], flow_along(spins, drifts)


def time_between(sheet: Sheet, begin: float, end: float) -> float:
    """Forcing periods that the spin takes from one value to another one on a sheet, between which it does not stand still."""
    low, high = sorted((begin, end))
    spans = [(max(a, low), min(b, high), rate) for a, b, rate in rates(sheet)]
    return sum(abs(quad(lambda s, rate=rate: 1 / rate(s), a, b, limit=200)[0]) for a, b, rate in spans if a < b)


class Standing(NamedTuple):
    """A spin at which nothing drifts."""

    orbit: PeriodicOrbit
    rate: float  # of what is off it, per forcing period and in units of itself: it attracts below zero
    error: float  # of the spin, by that of the map [rad/s]


def standing(sheet: Sheet) -> Iterator[Standing]:
    """The spins of a sheet at which nothing drifts, each located to `LOCATED`."""
    still = SLOW_SPIN * sheet.orbits[0].fixed.map.unit
    for a, b in pairwise(sheet.orbits):
        if abs(a.spin) <= LOCATED * still:  # what moves in a plane has no spin, and beside it the drift is odd
            yield Standing(a, b.spin_drift / b.spin, 0.0)
        elif abs(b.spin) > LOCATED * still and a.spin_drift * b.spin_drift < 0:
            yield _located(Sheet([a, b], "", ""), LOCATED * max(abs(a.spin), still))


def _located(between: Sheet, within: float) -> Standing:
    """The spin between two orbits at which nothing drifts, so well known."""
    low, high = between.spins.tolist()
    spin = float(brentq(lambda s: between.at(s).spin_drift, low, high, xtol=within, rtol=8.9e-16))
    orbit = between.at(spin)

    def slope(share: float) -> float:
        ahead, back = (step_along([orbit], spin + by * share * (high - low)) for by in (1, -1))
        return (ahead.spin_drift - back.spin_drift) / (ahead.spin - back.spin)

    rate = first_found(partial(slope, share) for share in SLOPE_OVER)
    return Standing(orbit, rate, within + _error(orbit, rate))


def _error(orbit: PeriodicOrbit, rate: float) -> float:
    """How far the spin may lie off [rad/s]: by what is left of the motion's equations, and by what changes where the map is ten
    times less accurate; NaN if there is none there.
    """
    fixed = orbit.fixed
    m = replace(fixed.map, rtol=10 * fixed.map.rtol)
    try:
        other = slow_motion_near(m, fixed.z, orbit.spin, fixed.matrix, fixed.gradient)
    except OrbitLost:
        return float("nan")
    left = max(other.residual, orbit.slow_motion.residual) * m.unit
    return (left + abs(other.drift - orbit.slow_motion.drift)) / (m.periods * abs(rate))
