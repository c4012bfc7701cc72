"""Sheets of the slow family: how the spin drifts on each of them, and where it stands still.

A *sheet* is a stretch of the family over which the motion changes steadily with the spin, kinks where the symbol sequence
changes among it. It ends where the motion leaps to another one, ceases to be stable, or ceases.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import Akima1DInterpolator, CubicSpline
from scipy.optimize import brentq

from dimersweep.analysis.orbits.continuation.steps import LOCATED
from dimersweep.analysis.orbits.map.finding import RTOL
from dimersweep.analysis.orbits.map.manifold import slow_motion_near
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import JOINED, OrbitLost, first_found, in_steps
from dimersweep.analysis.orbits.slow.families import SHORTEST, on_family, run_onto, step_along
from dimersweep.errors import ParameterError

# steps of the spin, as shares of it or of `SLOW_SPIN`: the first, the longest, that after a change of sequence; their growth
FIRST, WIDEST_STEP, AFTER_CHANGE, GROWTH = 0.02, 0.05, 3e-4, 1.5
SLOW_SPIN = 0.1  # spin below which steps are no shorter, in units of the section
LEAPT = 3.0  # way of a motion over a step, in units of that which the step before leads to expect, beyond which it has leapt
ROUNDED = 1e-4  # of such a way, in units of the section, that rounding may add
SLOPE_OVER = (0.05, 0.2, 0.01)  # shares of a step over which the slope of the drift is taken, in the order of trial
UNSEEN_BEND = 0.01  # share of the drift by which a change of sequence may bend its course unseen
ON_SHEET, NEAR_SHEET = 1e-4, 1e-3  # shares by which numbers of one orbit may differ; from those between its neighbours
SAME_DRIFT = 0.5  # share by which the drift of one motion may differ; of two that slip for other times it is a multiple
MOST_POINTS = 1000  # of a sheet to either side
TAKEN_UP = (1e-3, 5e-3, 0.02)  # shares of the spin beyond an orbit at which one is looked for by a run, in this order
STEEPEST = 0.1  # change of the drift with the spin in a period, beyond which it is no slow one, as at an end
SWING = 5e-3  # of the greatest value, by which a spline may lie beyond those between which it goes
NEUTRAL = "kept"  # the kind of a spin that nothing changes
OVER_THE_END = 1e-7  # of the greatest spin, by which rounding may lead over an end of a family


class Stretch(NamedTuple):
    """A part of a family over which the rate of the spin is smooth."""

    low: float  # least spin [rad/s]
    high: float
    rate: CubicSpline | Akima1DInterpolator  # ds/dn per forcing period, over the spin


def stretch_of(points: np.ndarray, periods: int = 1) -> Stretch:
    """The stretch through points of ascending spin and its change per forcing period, of a motion that repeats after some.

    s(n + 1) = s(n) + d(s(n)) is to second order what the flow ds/dn = d - d d'/2 does in one step.
    """
    spins, drift = points.T
    slope = np.clip(_along(spins, drift).derivative()(spins), -STEEPEST, STEEPEST)
    rate = _along(spins, drift * (1 - periods * slope / 2))
    return Stretch(float(spins[0]), float(spins[-1]), rate)


def _along(spins: np.ndarray, values: np.ndarray) -> CubicSpline | Akima1DInterpolator:
    """Values over the spin: a spline, unless it swings, as beside an end, where they bend sharply."""
    spline = CubicSpline(spins, values)
    middle = spline(0.5 * (spins[1:] + spins[:-1]))
    beyond = np.abs(middle - np.clip(middle, np.minimum(values[1:], values[:-1]), np.maximum(values[1:], values[:-1])))
    if (beyond > SWING * np.abs(values).max()).any():
        return Akima1DInterpolator(spins, values, method="makima", extrapolate=True)
    return spline


@dataclass
class Sheet:
    """Orbits of a stretch of the slow family, by ascending spin, and why it ends below and above; none where it goes on."""

    orbits: list[PeriodicOrbit]
    low_end: str
    high_end: str

    @cached_property
    def stretches(self) -> list[Stretch]:
        """From one change of sequence to the next, and over the changes, by ascending spin."""
        points = np.array([(one.spin, one.spin_drift) for one in self.orbits])
        changes = [k for k in range(1, len(self.orbits)) if self._bends(k)]
        parts = np.split(points, changes)
        between = [np.array([a[-1], b[0]]) for a, b in pairwise(parts)]
        found = [one for pair in zip_longest(parts, between) for one in pair if one is not None]
        return [stretch_of(one, self.orbits[0].periods) for one in found if len(one) > 1]

    def _bends(self, k: int) -> bool:
        """Whether the rate is not smooth between an orbit and the one before: it leaps, or bends with the sequence."""
        a, b = self.orbits[k - 1 : k + 1]
        if _leaps(a, b):
            return True
        near = b.spin - a.spin <= AFTER_CHANGE * max(abs(a.spin), abs(b.spin))
        return a.sequence != b.sequence and (near or _unforeseen(self.orbits[max(0, k - 2) : k], b) > UNSEEN_BEND)

    @cached_property
    def spins(self) -> np.ndarray:
        """Of the orbits [rad/s]."""
        return np.array([one.spin for one in self.orbits])

    def at(self, spin: float) -> PeriodicOrbit:
        """The orbit of a spin; lost if it is found from neither of the two that it lies between."""
        above = int(np.clip(np.searchsorted(self.spins, spin), 1, self.spins.size - 1))
        near = sorted(self.orbits[above - 1 : above + 1], key=lambda one: abs(one.spin - spin))
        return near[0] if near[0].spin == spin else first_found(partial(step_along, [one], spin) for one in near)

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Whether an orbit is one of the sheet."""
        if not self.spins[0] <= orbit.spin <= self.spins[-1] or orbit.periods != self.orbits[0].periods:
            return False
        own, columns = _looks(orbit), np.array([_looks(one) for one in self.orbits]).T
        between = [np.interp(orbit.spin, self.spins, each) for each in columns]
        if not np.isclose(own[-1], between[-1], rtol=SAME_DRIFT, atol=LOCATED):
            return False
        try:
            return _alike(own, _looks(self.at(orbit.spin)), ON_SHEET)
        except OrbitLost:  # there the map has no derivatives that are of use
            return _alike(own, between, NEAR_SHEET)


def _looks(orbit: PeriodicOrbit) -> tuple[float, float, float, float]:
    """By what motions of one spin are told apart, but for mirror images."""
    drift = orbit.spin_drift * np.sign(orbit.spin) / orbit.fixed.map.unit
    return orbit.impact_phase, orbit.speed, abs(orbit.precession_rate), drift


def _alike(one: Sequence[float], other: Sequence[float], share: float) -> bool:
    """Whether two motions of about one spin look alike, to a share."""
    return np.allclose(one, other, rtol=(share, share, share, SAME_DRIFT), atol=LOCATED)


def onward(first: PeriodicOrbit, to: float) -> Iterator[PeriodicOrbit]:
    """The orbits of a sheet from one on, up to a spin; lost where it ends before, once it is known where.

    On both sides of a change of sequence there is one, unless there is none nearby: then a run finds where the family goes on.
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
            if step > LOCATED * scale:
                step, spin = max(0.5 * min(abs(spin - here), step), LOCATED * scale), here
                continue
            nxt = _joined(last[0], sense)
            spin = nxt.spin
        yield nxt
        step = AFTER_CHANGE * scale if nxt.sequence != last[0].sequence else GROWTH * step
        last = [nxt, *last[:2]]
    raise OrbitLost(f"more than {MOST_POINTS} steps lead on")


def _steadily(last: list[PeriodicOrbit], spin: float, over_change: bool) -> PeriodicOrbit:
    """The orbit at another spin; lost if the motion has leapt, is unstable, or (unless `over_change`) of another sequence."""
    here, nxt = last[0], step_along(last, spin)
    if not nxt.stable:
        raise OrbitLost("the orbit becomes unstable")
    allowed = SAME_DRIFT if nxt.sequence == here.sequence else UNSEEN_BEND
    if not over_change and _unforeseen(last[1::-1], nxt) > allowed:
        raise OrbitLost("the sequence or the drift changes")
    if _leaps(here, nxt):
        raise OrbitLost("the drift leaps")
    if len(last) > 1:
        points = [one.fixed for one in (nxt, here, last[1])]
        if len({(one.map.phase, one.z.size) for one in points}) == 1:
            b, a, before = (one.z for one in points)
            pace = np.abs(a - before).max() / abs(here.spin - last[1].spin)
            if np.abs(b - a).max() > LEAPT * pace * abs(spin - here.spin) + ROUNDED:
                raise OrbitLost("the motion leaps")
    return nxt


def _joined(end: PeriodicOrbit, sense: float) -> PeriodicOrbit:
    """Where a sheet goes on that is lost at an orbit; lost if that is another sheet, which goes on there, too."""
    nxt = taken_up(end, sense, JOINED)
    try:
        beside = in_steps(lambda one, share: step_along([one], nxt.spin + share * (end.spin - nxt.spin)), nxt, SHORTEST)
    except OrbitLost:
        return nxt
    if beside.stable and not _alike(_looks(beside), _looks(end), ON_SHEET):
        raise OrbitLost("the motion leaps")
    return nxt


def taken_up(end: PeriodicOrbit, sense: float, most: float) -> PeriodicOrbit:
    """The stable motion that a run finds beside an orbit, beyond spins that just have none; see `run_onto` for `most`."""

    def at(share: float) -> PeriodicOrbit:
        orbit = run_onto(end, end.spin + sense * share * abs(end.spin), most)
        if not orbit.stable:
            raise OrbitLost("the orbit becomes unstable")
        return orbit

    return first_found(partial(at, share) for share in TAKEN_UP)


def _leaps(one: PeriodicOrbit, other: PeriodicOrbit) -> bool:
    """Whether the drift changes faster from an orbit to the next than along a sheet."""
    return abs(other.spin_drift - one.spin_drift) > STEEPEST * abs(other.spin - one.spin)


def _unforeseen(before: Sequence[PeriodicOrbit], nxt: PeriodicOrbit) -> float:
    """Share of the drift by which that of an orbit differs from what a line through the two before leads to expect.

    Where there are not two, as much as that of one motion may.
    """
    if len(before) < 2:
        return SAME_DRIFT
    a, b = before
    expected = b.spin_drift + (b.spin_drift - a.spin_drift) * (nxt.spin - b.spin) / (b.spin - a.spin)
    greatest = max(abs(one.spin_drift) for one in (a, b, nxt))
    return abs(nxt.spin_drift - expected) / greatest if greatest else 0.0


def sheet_through(orbit: PeriodicOrbit, low: float, high: float, whole: bool) -> Sheet:
    """The sheet of an orbit between two spins; if not `whole`, the way of its drift up to where the spin stands still."""
    begin = on_family(orbit.fixed.map, orbit.slow_motion)
    ways = [
        _as_far_as(begin, to, whole) if whole or (to - begin.spin) * begin.spin_drift > 0 else ([], "")
        for to in (low, high)
    ]
    (below, low_end), (above, high_end) = ways
    return Sheet([*below[::-1], begin, *above], low_end, high_end)


def _as_far_as(begin: PeriodicOrbit, to: float, whole: bool) -> tuple[list[PeriodicOrbit], str]:
    """The orbits of a sheet from one on, and why it ends; nothing if it goes on."""
    found: list[PeriodicOrbit] = []
    try:
        for one in onward(begin, to):
            found.append(one)
            if not whole and one.spin_drift * begin.spin_drift <= 0:
                break
    except OrbitLost as reason:
        return found, str(reason)
    return found, ""


def time_between(stretches: Sequence[Stretch], begin: float, end: float) -> float:
    """Forcing periods that the spin takes from one value to another one between which it does not stand still."""
    low, high = sorted((begin, end))
    spans = [(max(one.low, low), min(one.high, high), one.rate) for one in stretches]
    return sum(abs(quad(lambda s, rate=rate: 1 / rate(s), a, b, limit=200)[0]) for a, b, rate in spans if a < b)


def drifted(stretches: Sequence[Stretch], spin: float, periods: float) -> tuple[float, float]:
    """The spin after some forcing periods, or before them if they are negative; those that are left where it comes to an end.

    A spin at which nothing drifts is not passed.
    """
    upward = _rate_at(stretches, spin) * periods > 0
    for one in stretches if upward else stretches[::-1]:
        if (one.high <= spin if upward else one.low >= spin) and len(stretches) > 1:
            continue
        spin = float(np.clip(spin, one.low, one.high))
        if one.rate(spin) * periods == 0 or (one.rate(spin) * periods > 0) != upward:
            return spin, 0.0
        spin, periods = _within(one, spin, periods)
        if periods == 0:
            break
    return spin, periods


def _rate_at(stretches: Sequence[Stretch], spin: float) -> float:
    one = min(stretches, key=lambda one: max(one.low - spin, spin - one.high))
    return float(one.rate(np.clip(spin, one.low, one.high)))


def _within(stretch: Stretch, spin: float, periods: float) -> tuple[float, float]:
    """As `drifted`, within one stretch."""
    low, high, rate = stretch
    scale = max(abs(low), abs(high))
    aside = OVER_THE_END * scale  # what drifts by rounding alone does not leave it

    def inside(_: float, s: np.ndarray) -> float:
        return float(min(s[0] - low, high - s[0]) + aside)

    inside.terminal = True  # type: ignore[attr-defined]
    way = solve_ivp(lambda _, s: rate(s), (0.0, periods), [spin], "LSODA", events=inside, rtol=RTOL, atol=RTOL * scale)
    if way.status < 0:
        raise ParameterError(f"periods = {periods:g}: the spin cannot be followed so far ({way.message})")
    return float(np.clip(way.y[0, -1], low, high)), float(periods - way.t[-1]) if way.status == 1 else 0.0


class Standing(NamedTuple):
    """A spin at which nothing drifts."""

    orbit: PeriodicOrbit
    rate: float  # of what is off it, per forcing period and in units of itself: it attracts below zero; infinite at an end
    error: float  # of the spin, by that of the map [rad/s]; at an end, the way to where the drift is the other one

    @property
    def kind(self) -> str:
        """Whether the drift falls through zero, on a circle or in a plane, changes its sign at an end, or is none at all."""
        if self.rate == 0 or np.isinf(self.rate):
            return "end" if self.rate else NEUTRAL
        return "spin" if self.orbit.precession_rate else "plane"


def standing(sheet: Sheet) -> Iterator[Standing]:
    """The spins of a sheet at which nothing drifts, each located to `LOCATED`."""
    still = SLOW_SPIN * sheet.orbits[0].fixed.map.unit
    # what moves in a plane has no spin, and beside it the drift is odd
    planes = [k for k, one in enumerate(sheet.orbits) if abs(one.spin) <= LOCATED * still]
    if 0 < len(planes) < len(sheet.orbits):
        beside = sheet.orbits[planes[-1] + 1 if planes[-1] + 1 < len(sheet.orbits) else planes[0] - 1]
        yield Standing(sheet.orbits[planes[0]], beside.spin_drift / beside.spin, 0.0)
    # one may stand still exactly, and then its neighbours tell
    moving = [one for k, one in enumerate(sheet.orbits) if k in planes or one.spin_drift != 0]
    for a, b in pairwise(moving):
        if a.spin_drift * b.spin_drift < 0 and min(abs(a.spin), abs(b.spin)) > LOCATED * still:
            try:
                yield _located(Sheet([a, b], "", ""), LOCATED * max(abs(a.spin), still))
            except OrbitLost:  # the drift changes its sign over spins that have no orbit
                yield Standing(a, np.copysign(np.inf, b.spin_drift), b.spin - a.spin)


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
        other = slow_motion_near(fixed._replace(map=m), fixed.z, orbit.spin)
    except OrbitLost:
        return float("nan")
    left = max(other.residual, orbit.slow_motion.residual) * m.unit
    return (left + abs(other.drift - orbit.slow_motion.drift)) / (m.periods * abs(rate))
