"""Tell the motions of drawn starts apart, at one set of parameters, and match them with those of another set."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dimersweep.analysis.orbits.map.finding import RTOL, at_end, find, orbit_through, settled_on
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import Recorder
from dimersweep.analysis.orbits.slow.features import ALIKE_WITHIN, Carried, Features, Mirrors, apart, features_from
from dimersweep.analysis.orbits.slow.sheets import NEUTRAL
from dimersweep.analysis.orbits.slow.slow_flow import Cycle, SlowFlow, flow_of
from dimersweep.cubes.grid import Grid
from dimersweep.errors import OrbitError
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import CODE_MODE, CODE_MODE_PERIOD, MODES, SPIN
from dimersweep.runs.carrying import run_in_line
from dimersweep.runs.solving import RunSettings, exactly, run_row

# difference (relative, and absolute) up to which spins [rad/s], speeds [m/s] and impact phases [cycles] are the same
ONE_FATE = 1e-3


class Fate(NamedTuple):
    """The motion of a start after infinite time: the spin that it comes to, or the motion to which it leaves its
    family.

    Attributes
    ----------
    kind : str
        Kind as in `orbits.sustained`; "kept" if nothing changes the spin; the mode of a run that has left the family.
    low, high : float
        Least and greatest spin in the end [rad/s], equal for a steady one; NaN without an orbit.
    orbit : PeriodicOrbit or None
        Orbit with the least of these spins.
    """

    kind: str
    low: float
    high: float
    orbit: PeriodicOrbit | None


def alike(a: Fate | None, b: Fate | None) -> bool:
    """Return True if two fates are the same, or both are unknown."""
    if a is None or b is None:
        return a is b
    if a.orbit is None or b.orbit is None or a.kind == NEUTRAL:
        return a.kind == b.kind
    here, there = ((one.low, one.high, orbit.speed, orbit.impact_phase) for one, orbit in ((a, a.orbit), (b, b.orbit)))
    return a.kind == b.kind and np.allclose(here, there, rtol=ONE_FATE, atol=ONE_FATE)


class Attractor(NamedTuple):
    """One attractor at one set of parameters.

    Attributes
    ----------
    mode : str
        Mode of its representative.
    members : ndarray of int
        Numbers of the starts that lead there.
    representative : int
        Number of one of these starts, in the middle of their spins.
    features : Features or None
        Features of the motion; None for rest and for motions that do not repeat.
    carried : Carried or None
        Its orbit, with the features along the slow family; None if no orbit was found.
    fate : Fate or None
        Its motion after infinite time, if that was asked for and is known.
    """

    mode: str
    members: np.ndarray
    representative: int
    features: Features | None = None
    carried: Carried | None = None
    fate: Fate | None = None

    @property
    def orbit(self) -> PeriodicOrbit | None:
        """Orbit of the attractor: after infinite time, if its fate is known, else of its representative."""
        if self.fate is not None:
            return self.fate.orbit
        return None if self.carried is None else self.carried.orbit

    def joined_by(self, other: "Attractor") -> "Attractor":
        """Return the attractor with the starts of another one added, and the orbit of the first that has one."""
        shown = other if self.carried is None else self
        return shown._replace(members=np.union1d(self.members, other.members))

    def views(self) -> list[Features]:
        """Return the features of the attractor at all spins at which they are known."""
        if self.carried is not None:
            return list(self.carried.views)
        return [] if self.features is None else [self.features]


def one_family(a: Attractor, b: Attractor) -> bool:
    """Return True if the slow family of one of two attractors contains the other one."""
    return any(
        one.carried is not None and any(one.carried.apart(view) < ALIKE_WITHIN for view in other.views())
        for one, other in ((a, b), (b, a))
    )


def matched(costs: np.ndarray) -> dict[int, int]:
    """Return the column that belongs to each row, each used once, with the least sum of costs.

    Rows and columns with an infinite cost are not matched.
    """
    allowed = np.isfinite(costs)
    if not allowed.any():
        return {}
    dear = 1.0 + costs[allowed].sum()  # above any sum of allowed costs, so that a forbidden pair is the last resort
    rows, columns = linear_sum_assignment(np.where(allowed, costs, dear))
    return {int(a): int(b) for a, b in zip(rows, columns, strict=True) if allowed[a, b]}


class Classifier:
    """A classifier of the motions of drawn starts at one set of parameters.

    Parameters
    ----------
    points : Grid
        The starts.
    how : RunSettings
        Settings of the runs.
    results : ndarray, shape (n,)
        Results of the runs from the starts, with the states at their ends.
    mirrors : Mirrors
        Mirror images that count as one motion.
    """

    def __init__(self, points: Grid, how: RunSettings, results: np.ndarray, mirrors: Mirrors) -> None:
        self.points, self.how, self.results, self.mirrors = points, how, results, mirrors
        self.modes, self.periods = (results["codes"][:, slot] for slot in (CODE_MODE, CODE_MODE_PERIOD))
        self.recorder = Recorder()

    def parameters(self, start: int) -> dict[str, float]:
        """Return the parameters of the run from a start."""
        return self.points.fixed | {name: float(value) for name, value in self.points.values(start).items()}

    def features(self, start: int, end: np.ndarray, periods: int) -> Features | None:
        """Return the features of the motion that a start has come to; None if the motion does not repeat."""
        try:
            return features_from(self.parameters(start), end, periods, self.how.rtol, self.recorder, self.mirrors)
        except OrbitError:
            return None

    def attractors(self) -> list[Attractor]:
        """Return the attractors, in order of the number of their starts, the most frequent first."""
        left: dict[int, Features] = {}
        for start in np.flatnonzero(self.periods > 0):
            features = self.features(int(start), self.results["end"][start], int(self.periods[start]))
            if features is not None:
                left[int(start)] = features
        others = [start for start in range(self.modes.size) if start not in left]
        attractors = []
        for mode in sorted({int(self.modes[start]) for start in others}):
            members = np.array([start for start in others if self.modes[start] == mode])
            attractors.append(Attractor(MODES[mode], members, int(members[0])))
        while left:
            attractor = self._one(left, [one.features for one in attractors if one.features is not None])
            for start in attractor.members:
                del left[int(start)]
            home = next((k for k, one in enumerate(attractors) if one_family(one, attractor)), None)
            if home is not None:
                attractors[home] = attractors[home].joined_by(attractor)
            else:
                attractors.append(attractor)
        return sorted(attractors, key=lambda one: (-one.members.size, int(one.members[0])))

    def by_fate(self, attractors: Sequence[Attractor]) -> list[Attractor]:
        """Return the attractors anew, by the spin that their starts come to after infinite time.

        Starts whose fate is unknown stay attractors of their family.
        """
        flows: dict[bool, SlowFlow] = {}
        found: list[Attractor] = []
        spins = np.abs(self.results["end"][:, SPIN])
        for attractor in attractors:
            parts: list[tuple[Fate | None, list[int]]] = []
            middle = np.median(spins[attractor.members])
            # starts with the most and the least spin first: others drift along parts of their ways, known by then
            for start in sorted(attractor.members.tolist(), key=lambda start: -abs(spins[start] - middle)):
                fate = self._fate(attractor, start, flows)
                members = next((members for known, members in parts if alike(known, fate)), None)
                if members is None:
                    parts.append((fate, [start]))
                else:
                    members.append(start)
            for fate, members in parts:
                part = self._of_fate(attractor, fate, members)
                # an unknown fate, or a spin that is kept, cannot be the fate of another attractor
                own = fate is None or fate.kind == NEUTRAL
                home = [] if own else [k for k, one in enumerate(found) if alike(one.fate, fate)]
                if home:
                    found[home[0]] = found[home[0]].joined_by(part)
                else:
                    found.append(part)
        return sorted(found, key=lambda one: (-one.members.size, int(one.members[0])))

    def _fate(self, attractor: Attractor, start: int, flows: dict[bool, SlowFlow]) -> Fate | None:
        """Return the fate of a start, None if it is unknown; `flows` caches the slow flow of each sign of the spin."""
        if attractor.features is None:
            return Fate(attractor.mode, np.nan, np.nan, None)
        if attractor.carried is None:
            return None
        try:
            periods = attractor.features.periods
            m, state = at_end(self.parameters(start), self.results["end"][start], periods, RTOL, self.recorder)
            orbit = orbit_through(*settled_on(m, state, periods))
            if (orbit.spin < 0) not in flows:
                flows[orbit.spin < 0] = flow_of(orbit)
            fate = flows[orbit.spin < 0].fate(orbit)
        except OrbitError:
            return None
        if isinstance(fate, str):
            return Fate(fate, np.nan, np.nan, None)
        if fate.kind == NEUTRAL:
            return Fate(NEUTRAL, 0.0 if self.mirrors.plane else -np.inf, np.inf, orbit)
        orbits = fate.orbits if isinstance(fate, Cycle) else [fate.orbit]
        spins = [abs(one.spin) if self.mirrors.plane else one.spin for one in orbits]
        return Fate(fate.kind, min(spins), max(spins), orbits[int(np.argmin(spins))])

    def _of_fate(self, attractor: Attractor, fate: Fate | None, members: list[int]) -> Attractor:
        """Return the starts of an attractor that have one fate, as an attractor of its own."""
        first = attractor.representative if attractor.representative in members else members[len(members) // 2]
        if fate is not None and fate.orbit is None:
            return Attractor(fate.kind, np.array(sorted(members)), first, fate=fate)
        features = attractor.features
        if features is not None and first != attractor.representative:
            features = self.features(first, self.results["end"][first], features.periods)
        return attractor._replace(members=np.array(sorted(members)), representative=first, features=features, fate=fate)

    def _one(self, left: Mapping[int, Features], known: Sequence[Features]) -> Attractor:
        """Return the attractor of one of the motions in `left`, with all motions of `left` that show it.

        `known` are features of other attractors, whose spins the family of the orbit is followed to.
        """
        representative = _typical(left)
        own = left[representative]
        near = {start: other for start, other in left.items() if other.periods == own.periods}
        spins = [other.spin for other in (*near.values(), *known) if other.periods == own.periods]
        carried = self._carried(representative, own, spins)
        if carried is not None:
            members = [start for start, other in near.items() if carried.apart(other) < ALIKE_WITHIN]
        else:
            members = _linked(representative, near, self.mirrors)
        mode = MODES[self.modes[representative]]
        return Attractor(mode, np.array(sorted(members)), representative, own, carried)

    def _carried(self, start: int, own: Features, spins: Sequence[float]) -> Carried | None:
        """Return the orbit of a start, with its family over the spins of motions that may lie on it.

        None if there is no orbit, or the orbit does not have the features of the start.
        """
        try:
            orbit = find(guess=run_in_line(self.parameters(start), self.how), periods=own.periods)
            carried = Carried(orbit, spins, self.mirrors)
        except OrbitError:
            return None
        return carried if carried.apart(own) < ALIKE_WITHIN else None

    def confirmed(self, attractor: Attractor, periods: int) -> bool:
        """Return True if the representative is still at its attractor after this number of forcing periods."""
        row = self.points.rows_at(np.array([attractor.representative]))[0]
        solved = run_row(row, None, exactly(periods, self.how.rtol), new_workspace())
        if attractor.features is None:
            return MODES[solved.codes[CODE_MODE]] == attractor.mode
        later = self.features(attractor.representative, solved.end.start[0], attractor.features.periods)
        if later is None or solved.codes[CODE_MODE_PERIOD] != attractor.features.periods:
            return False
        if attractor.carried is None:
            return apart(attractor.features, later, self.mirrors) < ALIKE_WITHIN
        return Carried(attractor.carried.orbit, [later.spin], self.mirrors).apart(later) < ALIKE_WITHIN


def _typical(left: Mapping[int, Features]) -> int:
    """Return the start in the middle of the spins, among those with the most frequent period and sequence."""
    kinds: dict[tuple[int, str], list[int]] = {}
    for start, features in left.items():
        kinds.setdefault((features.periods, features.sequence), []).append(start)
    most = max(kinds.values(), key=len)
    return sorted(most, key=lambda start: left[start].spin)[len(most) // 2]


def _linked(first: int, near: Mapping[int, Features], mirrors: Mirrors) -> list[int]:
    """Return the starts that a chain of like motions with one sequence joins to the first start.

    This stands in where no orbit is found that could be followed over the spin.
    """
    sequence = near[first].sequence
    left = {start for start, features in near.items() if features.sequence == sequence} - {first}
    chain, joined = [first], [first]
    while joined:
        here = near[joined.pop()]
        found = [start for start in sorted(left) if apart(here, near[start], mirrors) < ALIKE_WITHIN]
        left -= set(found)
        joined += found
        chain += found
    return chain


def distance(former: Attractor, later: Attractor, name: str, value: float, mirrors: Mirrors) -> float:
    """Return how far an attractor is from a former one that is followed to `value` of a parameter; inf if it is
    another.

    The orbit of the former one is followed to the value, and to the spin there. Without an orbit, period and sequence
    decide.
    """
    if former.features is None or later.features is None:
        return 0.0 if former.features is later.features and former.mode == later.mode else float("inf")
    if former.features.periods != later.features.periods:
        return float("inf")
    if former.carried is not None:
        try:
            orbit = former.carried.orbit
            there = find(guess=orbit, periods=orbit.periods, **{name: value})
            far = Carried(there, [later.features.spin], mirrors).apart(later.features)
            return far if far < ALIKE_WITHIN else float("inf")
        except OrbitError:
            pass
    same = former.features.sequence == later.features.sequence
    return 1.0 + apart(former.features, later.features, mirrors) if same else float("inf")
