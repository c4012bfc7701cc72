"""A border as a curve: its first points are found on branches of orbits, the others by steps from point to point."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import takewhile
from math import pi
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.continuation.branch import point_of
from dimersweep.analysis.orbits.continuation.events import MOST_CHANGES, Event, events_in
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS, COMPLEX
from dimersweep.analysis.orbits.continuation.steps import SEARCHING, Between, halved, steps, zero
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.analysis.orbits.map.finding import orbit_at
from dimersweep.analysis.orbits.map.lost import OrbitLost, in_steps
from dimersweep.analysis.orbits.map.orbit import DOUBLING, PeriodicOrbit, dataset
from dimersweep.analysis.orbits.map.passage import Sides, far_ends
from dimersweep.analysis.orbits.map.poincare import Recorder, ReturnMap
from dimersweep.analysis.orbits.map.solution import Axis, Solution, without_drift
from dimersweep.cubes.cube import Column
from dimersweep.errors import OrbitError
from dimersweep.parameters import value_of
from dimersweep.symbols import PARAMETERS

STATUS_LENGTH = 100  # greatest length of a status, in characters: it fits into one line of a table
# greatest distance of a point of a curve from its guess, in units of the section: further off lies another motion
REACH = 0.3
LEAST_SHARE = 1 / 32  # shortest step from one point of a curve to the next, as a share of the way


T = TypeVar("T")


class Found(NamedTuple):
    """A point of a border: its orbit, the value of the parameter, and the start of the search for the next point.

    It is a type of its own, beside `Solution` and `Event`, since it is a row: one point may stand for several changes.
    """

    orbit: PeriodicOrbit
    value: float  # value of the parameter that is solved for
    begin: Any  # from which the next point is looked for: `map` and unknowns `y`, of a class of the kind of curve
    # of a change of sequence: how the sequences on its two sides differ; None where the branch falls to pieces
    sides: Sides | None = None
    loses: bool = False  # whether a stable orbit loses its stability there
    by: str = ""  # of an end of stability: the kind of border that ends it
    # of a change of sequence: the same change of the same motion at other values of the parameter
    others: "tuple[Found, ...]" = ()
    cost: float = 0.0  # forcing periods of the map that were run for the point

    @property
    def several(self) -> list[float]:
        """Values of the parameter at all such changes of the motion, ascending; empty if there is only one."""
        return sorted([self.value, *(other.value for other in self.others)]) if self.others else []

    def alike(self, other: "Found") -> bool:
        """Return True if both points are in one section, and the sequence changes alike at both."""
        m, n = self.begin.map, other.begin.map
        return m.phase == n.phase and m.free.size == n.free.size and self.sides == other.sides


def shortened(reason: str) -> str:
    """Shorten a reason to its first two parts (between semicolons) and to `STATUS_LENGTH` characters, for a table."""
    said = "; ".join(reason.split("; ")[:2])
    return said if len(said) <= STATUS_LENGTH else said[: STATUS_LENGTH - 3] + "..."


@dataclass(eq=False)
class Curve(ABC):
    """A border of one kind, whose points are found over other parameters."""

    # whether each point is looked for by itself; else only the first one is, on a branch, the others from neighbours
    alone: ClassVar = False
    # whether a motion may have several such borders, so that points that were followed must be confirmed
    many: ClassVar = False
    # whether its motions are in a plane, without spin
    in_plane: ClassVar = False
    kind: Any
    parameter: str  # parameter that is solved for
    given: dict[str, float]  # all parameters, at the first of the values that are asked for
    spin: float  # axial spin [rad/s]
    rtol: float  # accuracy of the map
    recorder: Recorder = field(default_factory=Recorder)
    over: dict[str, np.ndarray] = field(default_factory=dict)  # values of the other parameters that are asked for
    sustained: bool = False  # whether the spin is free: `spin` is then only where the search begins

    def __post_init__(self) -> None:
        if self.in_plane:
            self.spin, self.sustained = 0.0, False

    @cached_property
    def axis(self) -> Axis:
        """The quantity along branches: the parameter that is solved for, with its scale and the spin."""
        spin = None if self.sustained else self.spin
        return Axis(self.parameter, abs(value_of(self.parameter, self.given)) or 1.0, spin)

    def multipliers(self, orbit: PeriodicOrbit) -> np.ndarray:
        """Return the multipliers of the fast part of an orbit; where the spin is free, with the slow one at the end."""
        return np.append(orbit.multipliers, orbit.slow_multiplier) if self.sustained else orbit.multipliers

    def point(self, values: dict[str, float], near: list[Found], start: PeriodicOrbit | None) -> Found:
        """Find the point of the border at values of the other parameters.

        The neighbours in `near` lie at equal distances, the nearest first. Without neighbours the border is looked for
        on a branch: that of `start`, or else of orbits at these values. Raise OrbitError if there is no such point.
        """
        spent, given = self.recorder.periods, self.given | values
        if near and not self.alone:
            found = self._stepped(given, near)
        else:
            found = self._first(given, start)
            there = found.orbit.parameters  # a start may have other parameters than the point
            if any(there.get(name, value) != value for name, value in given.items() if name != self.parameter):
                found = self._stepped(given, [found])
        return found._replace(cost=self.recorder.periods - spent)

    def status(self, found: Found) -> str:
        """Return the status of a point that is found: ok, or why there may be other such points."""
        return "ok"

    def is_sure(self, found: Found) -> bool:
        """Return True if a point that was found from a neighbour would be found by itself, too."""
        return True

    def state(self, found: Found) -> str:
        """Return the property of a point that changes at once where the curve meets another border, or ""."""
        return found.by

    def passed(self, before: str, after: str) -> str:
        """Return the names of the borders that meet where the state changes from `before` to `after`."""
        return f"{before}-{after}"

    def table(self, found: Collection[Found], dim: str, more: Iterable[Column]) -> xr.Dataset:
        """Return a table of points along the dimension `dim`, with `more` columns."""
        solved = Column(self.parameter, PARAMETERS[self.parameter], [one.value for one in found])
        table = dataset([one.orbit for one in found], dim, (solved, *more))
        spin = "sustained" if self.sustained else self.spin
        about = {"kind": self.kind.name, "parameter": self.parameter, "spin": spin}
        return table.assign_attrs(about | {"cost": self.recorder.periods})

    def columns(self, found: Collection[Found]) -> list[Column]:
        """Return the columns of this kind: whether a stable orbit loses its stability; the coefficient of a flip."""
        loses = [one.loses for one in found]
        columns = [Column("loses_stability", "whether a stable orbit loses its stability there", loses)]
        if self.kind.doubles:
            columns.append(Column("doubling", DOUBLING, [one.begin.doubling for one in found]))
        return columns

    # --- in the plane of two parameters: see `plane_curve` ----------------------------------------------------------

    def system(self, m: ReturnMap, near: Found) -> Any:
        """Return the equations of the border near a point, with a map at other parameters.

        They have the methods `value` and `derivative`.
        """
        raise NotImplementedError

    def made(self, u: np.ndarray, extra: Any, near: Found) -> Found:
        """Return the point of the border at a solution `u` of the equations of `system`.

        `extra` is what their `value` returned there beside the residuals.
        """
        raise NotImplementedError

    def tests(self, found: Found) -> dict[str, float]:
        """Return functions of a point that change their sign where the curve meets another border, by both names."""
        values = self.kind.others(self.multipliers(found.orbit))
        real = values[np.abs(values.imag) < COMPLEX].real
        return {f"{self.kind.name}-{other.name}": other.crossing(real) for other in BORDER_KINDS.values()}

    # --- from one point to the next --------------------------------------------------------------------------------

    def _next(self, given: dict[str, float], near: list[Found]) -> Found:
        """Find the point one step from neighbours, which are in one section."""
        raise NotImplementedError

    def _stepped(self, given: dict[str, float], near: list[Found]) -> Found:
        """Find the point from neighbours in one step, or from the nearest one in shorter steps."""
        old = near[0].orbit.parameters

        def step(here: list[Found], to: float) -> list[Found]:
            values = {name: value + (1 - to) * (old.get(name, value) - value) for name, value in given.items()}
            # several neighbours extrapolate over a whole step only: they are as far apart
            return [self._next(values, here if to == 1.0 else here[:1])]

        return in_steps(step, list(takewhile(near[0].alike, near)), LEAST_SHARE)[0]

    def between(self, a: Found, b: Found, part: float) -> Found:
        """Return a neighbour of the point that lies a `part` of the way from `a` to `b`: by default `a`."""
        return a

    def extrapolated(self, near: list[Found]) -> np.ndarray:
        """Extrapolate the unknowns to the next point, by the line or parabola through neighbours at equal distances."""
        weights = ((1.0,), (2.0, -1.0), (3.0, -3.0, 1.0))[len(near) - 1]
        return sum(weight * one.begin.y for weight, one in zip(weights, near, strict=True))

    # --- the first point: on a branch ------------------------------------------------------------------------------

    def _first(self, given: dict[str, float], start: PeriodicOrbit | None) -> Found:
        """Find a point of the curve on the branch through the start, or through an orbit at the given parameters."""
        reasons: list[str] = []
        stable = False
        for orbit in self._starts(given, start, reasons):
            stable = stable or orbit.stable
            try:
                return self._from(orbit)
            except OrbitError as reason:
                reasons.append(str(reason))
        raise OrbitError(self._lacking(stable, reasons))

    def _lacking(self, stable: bool, reasons: list[str]) -> str:
        """Return the message that no point was found, with the reasons; `stable` if one of the orbits was stable."""
        return shortened(f"no {self.kind.name} was met; {'; '.join(dict.fromkeys(reasons))}")

    @abstractmethod
    def _from(self, orbit: PeriodicOrbit) -> Found:
        """Return the point of the border on the branch through an orbit."""

    def _met(self, way: Solution) -> Event:
        """Return the first special point of this kind along a branch."""
        for a, b, _ in steps(way, SEARCHING):
            for event in self._events(a, b)[0]:
                if self._is_met(event):
                    return event
        raise OrbitLost(f"none within {SEARCHING.tries} points of the branch")

    def _events(self, a: Solution, b: Solution) -> tuple[list[Event], Any]:
        """Return the special points of a step of a branch, and the change of sequence at which it leaps, if it does."""
        return events_in(a, b, sequences=False)

    def _is_met(self, event: Event) -> bool:
        """Return True if a special point of a branch is a point of this border."""
        return event.kind is self.kind

    def _ways(self, orbit: PeriodicOrbit) -> list[Solution]:
        """Return the first point of the branch through an orbit, once for each sense in which to search."""
        fixed = orbit.fixed.on_map(replace(orbit.fixed.map, recorder=self.recorder))
        begin = point_of(self.axis, without_drift(fixed, self.axis), value_of(self.parameter, orbit.parameters))
        return [begin._replace(tangent=sense * begin.tangent) for sense in self.kind.senses]

    def _starts(
        self, given: dict[str, float], start: PeriodicOrbit | None, reasons: list[str]
    ) -> Iterator[PeriodicOrbit]:
        """Yield the orbits from which the border is looked for: first stable walks, last other motions.

        In a walk one end is far from the plate at a time; in other motions both ends are, or none. Why an orbit was not
        found is added to `reasons`.
        """
        if start is not None:
            yield start
            return
        later = []
        for at in self._places(given):
            try:
                orbit = orbit_at(given | at, self.spin, rtol=self.rtol)
                without_drift(orbit.fixed, self.axis)
            except OrbitError as reason:
                reasons.append(str(reason))
                continue
            if orbit.stable and far_ends(orbit.sequence) == 1:
                yield orbit
                if self.sustained:  # where the spin is free, branches of other orbits lead to the same sustained spins
                    return
            else:
                later.append(orbit)
        yield from sorted(later, key=lambda orbit: (far_ends(orbit.sequence) != 1, not orbit.stable))

    def _places(self, given: dict[str, float]) -> Iterator[dict[str, float]]:
        """Yield values of the parameter at which an orbit is looked for: between the ball's fold and flip."""
        if self.parameter == "Gamma":
            e = value_of("e_2", given)
            low, wide = ball_fold(e), ball_flip(e) - ball_fold(e)
        elif self.parameter == "e":
            low = max(0.0, (pi - given["Gamma"]) / (pi + given["Gamma"]))  # the ball's fold
            wide = 0.5 * (1 - low)
        else:
            yield {}
            return
        for share in self.kind.shares:
            yield {self.parameter: low + share * wide}


def meetings(
    curve: Curve, at: Between[T], tests: Callable[[T], dict[str, float]], state: Callable[[T], str], known: float
) -> list[tuple[T, str]]:
    """Return the points of a step at which the curve meets other borders or turns round, in their order, each with its name.

    There a function of `tests` changes its sign, or the `state` changes. A point is located to `known`, a share of
    the way; one that cannot be located so well is left out.
    """
    low = 0.0

    def zero_of(name: str) -> float | None:
        return zero(at, lambda point: tests(point)[name], known)

    def state_at(share: float) -> str:
        return state(at[share])

    found = [(share, name) for name in tests(at[0.0]) if (share := zero_of(name)) is not None]
    while (before := state_at(low)) != state_at(1.0) and len(found) < MOST_CHANGES:
        beyond = min(share for share in at if share > low and state_at(share) != before)
        last, low = halved(state_at, low, beyond, known)
        if low - last > known:
            break
        found.append((last, curve.passed(before, state_at(low))))
    return [(at[share], name) for share, name in sorted(found)]
