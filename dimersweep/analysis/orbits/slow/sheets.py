"""Sheets of the slow family: the drift of the spin on each of them, and the spins at which nothing drifts.

A *sheet* is a stretch of the family over which the motion changes continuously with the spin. It may have kinks where
the symbol sequence changes. It ends where the motion leaps to another one, becomes unstable, or ceases to exist.
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
from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, first_found, in_steps, require
from dimersweep.analysis.orbits.map.manifold import slow_motion_near
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import JOINED
from dimersweep.analysis.orbits.slow.families import SHORTEST, on_family, run_onto, step_along
from dimersweep.errors import ParameterError

# steps of the spin, relative to it or to `SLOW_SPIN`: the first, the longest, the one after a change of sequence
# (short, since the extrapolation leads over no kink); their growth from one to the next
FIRST, WIDEST_STEP, AFTER_CHANGE, GROWTH = 0.02, 0.05, 3e-4, 1.5
# spin below which steps do not shorten with it, in units of the section: with it they would never come to 0
SLOW_SPIN = 0.1
# displacement of a motion over a step, relative to the extrapolation of the step before, above which
# the motion has leapt
LEAPT = 3.0
ROUNDED = 1e-4  # displacement that rounding may add, in units of the section
SLOPE_OVER = (0.05, 0.2, 0.01)  # parts of a step over which the slope of the drift is taken, in the order of trial
# relative change by which a change of sequence may bend the course of the drift without a new stretch: with 0, a
# bouncing motion costs nine times the periods
UNSEEN_BEND = 0.01
# relative difference of the numbers of one orbit: found twice at its spin; found once, and
# interpolated between neighbours
ON_SHEET, NEAR_SHEET = 1e-4, 1e-3
# relative difference of the drift of one motion; two motions that slip for different times have drifts
# that differ by more
SAME_DRIFT = 0.5
MOST_POINTS = 1000  # points of a sheet to either side of its first one at most
# parts of the spin by which a run is made beyond an orbit to find the next one, in the order of trial
TAKEN_UP = (1e-3, 5e-3, 0.02)
# greatest slope of the drift (change per period) over the spin: near an end, as beside a fold, it is
# steeper, and not slow
STEEPEST = 0.1
# part of the greatest value by which a spline may lie outside of two neighbouring values: beside a
# fold it swings by 2 %
SWING = 5e-3
NEUTRAL = "kept"  # kind of a spin at which the drift is zero for all spins nearby
OVER_THE_END = 1e-7  # part of the greatest spin by which rounding may lead over an end of a family


class Stretch(NamedTuple):
    """A part of a family over which the rate of the spin is smooth."""

    low: float  # least spin [rad/s]
    high: float  # greatest spin [rad/s]
    rate: CubicSpline | Akima1DInterpolator  # ds/dn per forcing period, over the spin


def stretch_of(points: np.ndarray, periods: int = 1) -> Stretch:
    """Return the stretch through points (spin, drift), shape (n, 2), of ascending spin.

    The drift d is the change of the spin per forcing period [rad/s], the mean over the `periods` after which the motion
    repeats. The map s(n + 1) = s(n) + d(s(n)) is to second order one step of the flow ds/dn = d - d d'/2.
    """
    spins, drift = points.T
    slope = np.clip(_along(spins, drift).derivative()(spins), -STEEPEST, STEEPEST)
    rate = _along(spins, drift * (1 - periods * slope / 2))
    return Stretch(float(spins[0]), float(spins[-1]), rate)


def _along(spins: np.ndarray, values: np.ndarray) -> CubicSpline | Akima1DInterpolator:
    """Interpolate values over the spin: by a cubic spline, or by Akima's if the spline overshoots, as beside an end."""
    spline = CubicSpline(spins, values)
    middle = spline(0.5 * (spins[1:] + spins[:-1]))
    beyond = np.abs(middle - np.clip(middle, np.minimum(values[1:], values[:-1]), np.maximum(values[1:], values[:-1])))
    if (beyond > SWING * np.abs(values).max()).any():
        return Akima1DInterpolator(spins, values, method="makima", extrapolate=True)
    return spline


@dataclass
class Sheet:
    """A sheet of the slow family: its orbits, and why it ends."""

    orbits: list[PeriodicOrbit]  # by ascending spin
    low_end: str  # why it ends at its least spin; "" if it goes on
    high_end: str  # why it ends at its greatest spin; "" if it goes on

    @cached_property
    def stretches(self) -> list[Stretch]:
        """Stretches with a smooth rate, by ascending spin: between changes of sequence, and over each change."""
        points = np.array([(one.spin, one.spin_drift) for one in self.orbits])
        changes = [k for k in range(1, len(self.orbits)) if self._bends(k)]
        parts = np.split(points, changes)
        between = [np.array([a[-1], b[0]]) for a, b in pairwise(parts)]
        found = [one for pair in zip_longest(parts, between) for one in pair if one is not None]
        return [stretch_of(one, self.orbits[0].periods) for one in found if len(one) > 1]

    def _bends(self, k: int) -> bool:
        """Return True if the rate leaps, or bends with the sequence, between orbit `k` and the one before."""
        a, b = self.orbits[k - 1 : k + 1]
        if _leaps(a, b):
            return True
        near = b.spin - a.spin <= AFTER_CHANGE * max(abs(a.spin), abs(b.spin))
        return a.sequence != b.sequence and (near or _unforeseen(self.orbits[max(0, k - 2) : k], b) > UNSEEN_BEND)

    @cached_property
    def spins(self) -> np.ndarray:
        """Spins of the orbits, ascending [rad/s]."""
        return np.array([one.spin for one in self.orbits])

    def at(self, spin: float) -> PeriodicOrbit:
        """Return the orbit at a spin, to which one of its neighbours leads."""
        above = int(np.clip(np.searchsorted(self.spins, spin), 1, self.spins.size - 1))
        near = sorted(self.orbits[above - 1 : above + 1], key=lambda one: abs(one.spin - spin))
        return near[0] if near[0].spin == spin else first_found(partial(step_along, [one], spin) for one in near)

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Return True if an orbit is on the sheet."""
        if not self.spins[0] <= orbit.spin <= self.spins[-1] or orbit.periods != self.orbits[0].periods:
            return False
        own, columns = _looks(orbit), np.array([_looks(one) for one in self.orbits]).T
        between = [np.interp(orbit.spin, self.spins, each) for each in columns]
        if not np.isclose(own[-1], between[-1], rtol=SAME_DRIFT, atol=LOCATED):
            return False
        # where derivatives are of no use, compare with the interpolation between neighbours
        there = attempt(self.at, orbit.spin)
        return _alike(own, _looks(there), ON_SHEET) if there else _alike(own, between, NEAR_SHEET)


def _looks(orbit: PeriodicOrbit) -> tuple[float, float, float, float]:
    """Return the numbers that distinguish motions of one spin: phase of impact, speed, precession, drift over its unit.

    Mirror images have the same numbers.
    """
    drift = orbit.spin_drift * np.sign(orbit.spin) / orbit.fixed.map.unit
    return orbit.impact_phase, orbit.speed, abs(orbit.precession_rate), drift


def _alike(one: Sequence[float], other: Sequence[float], share: float) -> bool:
    """Return True if the numbers of two motions (`_looks`) differ by less than a relative `share`."""
    return np.allclose(one, other, rtol=(share, share, share, SAME_DRIFT), atol=LOCATED)


def onward(first: PeriodicOrbit, to: float) -> Iterator[PeriodicOrbit]:
    """Yield the orbits of a sheet from one on, up to a spin; the next one is lost where the sheet ends before.

    The end, and each change of sequence, is located to `LOCATED`: the change has an orbit on both sides. Where no orbit
    is found beyond a change, a run finds the motion with which the sheet goes on.

    This is no curve for `continuation.steps`: the last step is 1 % longer or leads to spin 0 at once, a change of
    sequence decides the next step, and the orbit that a run finds is a row of its own.
    """
    last, sense, unit = [first], np.sign(to - first.spin), SLOW_SPIN * first.fixed.map.unit
    step = FIRST * max(abs(first.spin), unit)
    spin = first.spin
    for _ in range(MOST_POINTS):
        if spin == to:
            return
        here, scale = last[0].spin, max(abs(last[0].spin), unit)
        step = min(step, WIDEST_STEP * scale)
        # the last step may be 1 % longer, so that no tiny one is left; spin 0 is reached from the
        # slow spins in one step
        whole = unit if to == 0 and step == WIDEST_STEP * scale else 1.01 * step
        spin = to if (to - here) * sense <= whole else here + sense * step
        short = step <= LOCATED * scale or spin == 0  # a motion in a plane, of spin 0, has a sequence of its own
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
    """Return the orbit at another spin, if the motion neither leaps nor becomes unstable on the way.

    Unless `over_change`, the drift may differ from its extrapolation by no more than `SAME_DRIFT`, and by `UNSEEN_BEND`
    where the sequence changes.
    """
    here, nxt = last[0], step_along(last, spin)
    require(nxt.stable, "the orbit becomes unstable")
    allowed = SAME_DRIFT if nxt.sequence == here.sequence else UNSEEN_BEND
    require(over_change or _unforeseen(last[1::-1], nxt) <= allowed, "the sequence or the drift changes")
    require(not _leaps(here, nxt), "the drift leaps")
    if len(last) > 1:
        points = [one.fixed for one in (nxt, here, last[1])]
        if len({(one.map.phase, one.z.size) for one in points}) == 1:
            b, a, before = (one.z for one in points)
            pace = np.abs(a - before).max() / abs(here.spin - last[1].spin)
            require(np.abs(b - a).max() <= LEAPT * pace * abs(spin - here.spin) + ROUNDED, "the motion leaps")
    return nxt


def _joined(end: PeriodicOrbit, sense: float) -> PeriodicOrbit:
    """Find by a run the orbit with which a sheet goes on beyond the orbit `end`, in the `sense` of the spin (1 or -1).

    It must not be on another sheet, which reaches back to the spin of `end`.
    """
    nxt = taken_up(end, sense, JOINED)
    back = attempt(in_steps, lambda one, to: step_along([one], nxt.spin + to * (end.spin - nxt.spin)), nxt, SHORTEST)
    same = back is None or not back.stable or _alike(_looks(back), _looks(end), ON_SHEET)
    require(same, "the motion leaps")
    return nxt


def taken_up(end: PeriodicOrbit, sense: float, most: float) -> PeriodicOrbit:
    """Find by a run the stable motion beyond an orbit in the `sense` of the spin, over spins without one.

    It lies at most `most` from where the orbit leads, as for `run_onto`.
    """

    def at(share: float) -> PeriodicOrbit:
        orbit = run_onto(end, end.spin + sense * share * abs(end.spin), most)
        require(orbit.stable, "the orbit becomes unstable")
        return orbit

    return first_found(partial(at, share) for share in TAKEN_UP)


def _leaps(one: PeriodicOrbit, other: PeriodicOrbit) -> bool:
    """Return True if the drift changes faster from one orbit to the other than it may along a sheet."""
    return abs(other.spin_drift - one.spin_drift) > STEEPEST * abs(other.spin - one.spin)


def _unforeseen(before: Sequence[PeriodicOrbit], nxt: PeriodicOrbit) -> float:
    """Return the relative difference between the drift of an orbit and its extrapolation from the two orbits before.

    With less than two orbits before, return the greatest difference that one motion may have.
    """
    if len(before) < 2:
        return SAME_DRIFT
    a, b = before
    expected = b.spin_drift + (b.spin_drift - a.spin_drift) * (nxt.spin - b.spin) / (b.spin - a.spin)
    greatest = max(abs(one.spin_drift) for one in (a, b, nxt))
    return abs(nxt.spin_drift - expected) / greatest if greatest else 0.0


def sheet_through(orbit: PeriodicOrbit, low: float, high: float, whole: bool) -> Sheet:
    """Follow the sheet of an orbit between two spins; if not `whole`, only along its drift, to where nothing drifts."""
    begin = on_family(orbit.fixed.map, orbit.slow_motion)
    ways = [
        _as_far_as(begin, to, whole) if whole or (to - begin.spin) * begin.spin_drift > 0 else ([], "")
        for to in (low, high)
    ]
    (below, low_end), (above, high_end) = ways
    return Sheet([*below[::-1], begin, *above], low_end, high_end)


def _as_far_as(begin: PeriodicOrbit, to: float, whole: bool) -> tuple[list[PeriodicOrbit], str]:
    """Return the orbits of a sheet after `begin`, up to the spin `to`, and why the sheet ends before ("" if not).

    If not `whole`, stop after the first orbit whose drift is zero or has the other sign.
    """
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
    """Return the forcing periods that the spin takes between two values; the rate must not be zero between them."""
    low, high = sorted((begin, end))
    spans = [(max(one.low, low), min(one.high, high), one.rate) for one in stretches]
    return sum(abs(quad(lambda s, rate=rate: 1 / rate(s), a, b, limit=200)[0]) for a, b, rate in spans if a < b)


def drifted(stretches: Sequence[Stretch], spin: float, periods: float) -> tuple[float, float]:
    """Return the spin after some forcing periods (before, if negative), and the periods left where the stretches end.

    The spin does not pass a value at which nothing drifts.
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
    """Return the rate at a spin, or at the nearest spin of all stretches [rad/s per forcing period]."""
    one = min(stretches, key=lambda one: max(one.low - spin, spin - one.high))
    return float(one.rate(np.clip(spin, one.low, one.high)))


def _within(stretch: Stretch, spin: float, periods: float) -> tuple[float, float]:
    """Follow the spin within one stretch; return the same two numbers as `drifted`."""
    low, high, rate = stretch
    scale = max(abs(low), abs(high))
    aside = OVER_THE_END * scale  # so that a spin at an end does not leave the stretch by rounding

    def inside(_: float, s: np.ndarray) -> float:
        return float(min(s[0] - low, high - s[0]) + aside)

    inside.terminal = True  # type: ignore[attr-defined]
    way = solve_ivp(lambda _, s: rate(s), (0.0, periods), [spin], "LSODA", events=inside, rtol=RTOL, atol=RTOL * scale)
    if way.status < 0:
        raise ParameterError(f"periods = {periods:g}: the spin cannot be followed so far ({way.message})")
    return float(np.clip(way.y[0, -1], low, high)), float(periods - way.t[-1]) if way.status == 1 else 0.0


class Standing(NamedTuple):
    """A spin at which nothing drifts, or an end of a sheet at which the drift changes its sign.

    It is a type of its own, beside `Event`, since no branch is followed there: it has the rate at which the spin settles.
    """

    orbit: PeriodicOrbit
    # relative growth of a small deviation from the spin per forcing period: negative if the spin
    # attracts, infinite at an end
    rate: float
    # error of the spin, from the accuracy of the map [rad/s]; at an end, the distance to the orbit
    # with the opposite drift
    error: float

    @property
    def spin(self) -> float:
        """Axial spin [rad/s]."""
        return self.orbit.spin

    @property
    def kind(self) -> str:
        """Kind of the spin: "spin" (on a circle), "plane" (spin 0), "end" (of a sheet) or "kept" (no drift nearby)."""
        if self.rate == 0 or np.isinf(self.rate):
            return "end" if self.rate else NEUTRAL
        return "spin" if self.orbit.precession_rate else "plane"


def standing(sheet: Sheet) -> Iterator[Standing]:
    """Yield the spins of a sheet at which nothing drifts, each located to `LOCATED`."""
    still = SLOW_SPIN * sheet.orbits[0].fixed.map.unit
    # a motion in a plane has spin 0 and no drift; the drift beside it is odd in the spin, so its ratio to
    # the spin is the rate
    planes = [k for k, one in enumerate(sheet.orbits) if abs(one.spin) <= LOCATED * still]
    if 0 < len(planes) < len(sheet.orbits):
        beside = sheet.orbits[planes[-1] + 1 if planes[-1] + 1 < len(sheet.orbits) else planes[0] - 1]
        yield Standing(sheet.orbits[planes[0]], beside.spin_drift / beside.spin, 0.0)
    # an orbit may have a drift of exactly zero: its neighbours then enclose the spin
    moving = [one for k, one in enumerate(sheet.orbits) if k in planes or one.spin_drift != 0]
    for a, b in pairwise(moving):
        if a.spin_drift * b.spin_drift < 0 and min(abs(a.spin), abs(b.spin)) > LOCATED * still:
            stands = attempt(_located, Sheet([a, b], "", ""), LOCATED * max(abs(a.spin), still))
            # if none is found, the drift changes its sign over spins that have no orbit
            yield stands or Standing(a, np.copysign(np.inf, b.spin_drift), b.spin - a.spin)


def _located(between: Sheet, within: float) -> Standing:
    """Locate the spin between the two orbits of a sheet at which nothing drifts, to `within` [rad/s]."""
    low, high = between.spins.tolist()
    # this rtol is the least that `brentq` accepts: `within` decides
    spin = float(brentq(lambda s: between.at(s).spin_drift, low, high, xtol=within, rtol=8.9e-16))
    orbit = between.at(spin)

    def slope(share: float) -> float:
        ahead, back = (step_along([orbit], spin + by * share * (high - low)) for by in (1, -1))
        return (ahead.spin_drift - back.spin_drift) / (ahead.spin - back.spin)

    rate = first_found(partial(slope, share) for share in SLOPE_OVER)
    return Standing(orbit, rate, within + _error(orbit, rate))


def _error(orbit: PeriodicOrbit, rate: float) -> float:
    """Estimate the error of a spin at which nothing drifts [rad/s]; NaN if a less accurate map has no motion there.

    It is the residual of the motion plus the change of its drift with a map ten times less accurate, over the rate.
    """
    fixed = orbit.fixed
    m = replace(fixed.map, rtol=10 * fixed.map.rtol)
    other = attempt(slow_motion_near, fixed.on_map(m), fixed.z, orbit.spin)
    if other is None:
        return float("nan")
    left = max(other.residual, orbit.slow_motion.residual) * m.unit
    return (left + abs(other.drift - orbit.slow_motion.drift)) / (m.periods * abs(rate))
