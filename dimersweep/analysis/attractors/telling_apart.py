"""Which motions are one: the attractors of drawn starts at one set of parameters, and which of them are those of another."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dimersweep.analysis.orbits.map.finding import RTOL, at_end, find, orbit_through, settled_on
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import OrbitLost, Recorder
from dimersweep.analysis.orbits.slow.features import ALIKE_WITHIN, Carried, Features, Mirrors, apart, features_from
from dimersweep.analysis.orbits.slow.sheets import NEUTRAL
from dimersweep.analysis.orbits.slow.slow_flow import Cycle, SlowFlow, flow_of
from dimersweep.cubes.grid import Grid
from dimersweep.errors import OrbitError
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import CODE_MODE, CODE_MODE_PERIOD, MODES, SPIN
from dimersweep.runs.carrying import run_in_line
from dimersweep.runs.solving import RunSettings, exactly, run_row

ONE_FATE = 1e-3  # by which spins, speeds and impact phases of one may differ, as a share and in their units


class Fate(NamedTuple):
    """Where the spin comes to in the end.

    Attributes
    ----------
    kind : str
        As of `orbits.sustained`; "kept" where nothing changes the spin; the mode of a run that has left the family.
    low, high : float
        Spins between which it is there [rad/s]; NaN without an orbit.
    orbit : PeriodicOrbit or None
        That of the least.
    """

    kind: str
    low: float
    high: float
    orbit: PeriodicOrbit | None


def alike(a: Fate | None, b: Fate | None) -> bool:
    """Whether two fates are one, or both unknown."""
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
        The starts that lead there.
    representative : int
        One of them, in the middle of their spins.
    features : Features or None
        What it looks like; none for rest and for motions that do not repeat.
    carried : Carried or None
        Its orbit, with the family; none where no orbit was found.
    fate : Fate or None
        Where its spin comes to in the end, if that was asked for and could be told.
    """

    mode: str
    members: np.ndarray
    representative: int
    features: Features | None = None
    carried: Carried | None = None
    fate: Fate | None = None

    @property
    def orbit(self) -> PeriodicOrbit | None:
        """The one orbit that was found of it, or that its spin comes to in the end."""
        if self.fate is not None:
            return self.fate.orbit
        return None if self.carried is None else self.carried.orbit

    def joined_by(self, other: "Attractor") -> "Attractor":
        """The attractor with the starts of another one, and the orbit of the first that has one."""
        shown = other if self.carried is None else self
        return shown._replace(members=np.union1d(self.members, other.members))

    def views(self) -> list[Features]:
        """What it looks like, at all spins at which that is known."""
        if self.carried is not None:
            return list(self.carried.views)
        return [] if self.features is None else [self.features]


def one_family(a: Attractor, b: Attractor) -> bool:
    """Whether the family of one of two attractors leads to the other one."""
    return any(
        one.carried is not None and any(one.carried.apart(view) < ALIKE_WITHIN for view in other.views())
        for one, other in ((a, b), (b, a))
    )


def matched(costs: np.ndarray) -> dict[int, int]:
    """Which column goes with which row, each once, at the least sum of costs; infinite costs never go together."""
    allowed = np.isfinite(costs)
    if not allowed.any():
        return {}
    dear = 1.0 + costs[allowed].sum()
    rows, columns = linear_sum_assignment(np.where(allowed, costs, dear))
    return {int(a): int(b) for a, b in zip(rows, columns, strict=True) if allowed[a, b]}


class Classifier:
    """Tells the motions of drawn starts apart at one set of parameters.

    Parameters
    ----------
    points : Grid
        The starts.
    how : RunSettings
        Of the runs.
    results : ndarray, shape (n,)
        Of `Drawn`.
    mirrors : Mirrors
    """

    def __init__(self, points: Grid, how: RunSettings, results: np.ndarray, mirrors: Mirrors) -> None:
        self.points, self.how, self.results, self.mirrors = points, how, results, mirrors
        self.modes, self.periods = (results["codes"][:, slot] for slot in (CODE_MODE, CODE_MODE_PERIOD))
        self.recorder = Recorder()

    def parameters(self, start: int) -> dict[str, float]:
        """Of the run from a start."""
        return self.points.fixed | {name: float(value) for name, value in self.points.values(start).items()}

    def features(self, start: int, end: np.ndarray, periods: int) -> Features | None:
        """The features of the motion that a start has come to; none where it does not repeat."""
        try:
            return features_from(self.parameters(start), end, periods, self.how.rtol, self.recorder, self.mirrors)
        except OrbitLost:
            return None

    def attractors(self) -> list[Attractor]:
        """The attractors, those that most starts lead to first."""
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
        """Attractors anew, by where the spin of their starts comes to; those of which that is not known stay as they are."""
        flows: dict[bool, SlowFlow] = {}
        found: list[Attractor] = []
        spins = np.abs(self.results["end"][:, SPIN])
        for attractor in attractors:
            parts: list[tuple[Fate | None, list[int]]] = []
            middle = np.median(spins[attractor.members])
            # those of the most and the least spin first: the ways of all others are parts of theirs
            for start in sorted(attractor.members.tolist(), key=lambda start: -abs(spins[start] - middle)):
                fate = self._fate(attractor, start, flows)
                members = next((members for known, members in parts if alike(known, fate)), None)
                if members is None:
                    parts.append((fate, [start]))
                else:
                    members.append(start)
            for fate, members in parts:
                part = self._of_fate(attractor, fate, members)
                own = fate is None or fate.kind == NEUTRAL  # what is known of no other attractor's
                home = [] if own else [k for k, one in enumerate(found) if alike(one.fate, fate)]
                if home:
                    found[home[0]] = found[home[0]].joined_by(part)
                else:
                    found.append(part)
        return sorted(found, key=lambda one: (-one.members.size, int(one.members[0])))

    def _fate(self, attractor: Attractor, start: int, flows: dict[bool, SlowFlow]) -> Fate | None:
        """Where the spin of a start comes to; `flows` are those of both senses of the spin."""
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
        """The starts of an attractor whose spin comes to one end, as one."""
        first = attractor.representative if attractor.representative in members else members[len(members) // 2]
        if fate is not None and fate.orbit is None:
            return Attractor(fate.kind, np.array(sorted(members)), first, fate=fate)
        features = attractor.features
        if features is not None and first != attractor.representative:
            features = self.features(first, self.results["end"][first], features.periods)
        return attractor._replace(members=np.array(sorted(members)), representative=first, features=features, fate=fate)

    def _one(self, left: Mapping[int, Features], known: Sequence[Features]) -> Attractor:
        """The attractor of one of the motions that are left, with all of these that show it; `known` are those of others."""
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
        """The orbit of a start, with its family over the spins of the motions that may lie on it."""
        try:
            orbit = find(guess=run_in_line(self.parameters(start), self.how), periods=own.periods)
            carried = Carried(orbit, spins, self.mirrors)
        except (OrbitError, OrbitLost):
            return None
        return carried if carried.apart(own) < ALIKE_WITHIN else None

    def confirmed(self, attractor: Attractor, periods: int) -> bool:
        """Whether the representative is still at its attractor after so many forcing periods."""
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
    """The start in the middle of the spins of those with the period and sequence that occur most often."""
    kinds: dict[tuple[int, str], list[int]] = {}
    for start, features in left.items():
        kinds.setdefault((features.periods, features.sequence), []).append(start)
    most = max(kinds.values(), key=len)
    return sorted(most, key=lambda start: left[start].spin)[len(most) // 2]


def _linked(first: int, near: Mapping[int, Features], mirrors: Mirrors) -> list[int]:
    """The starts that a chain of like motions of one sequence joins to the first, where no orbit carries the spin."""
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
    """How far an attractor is from a former one that is carried to `value` of the parameter `name`; inf if it is another.

    The orbit of the former one is followed to the value, and to the spin there. Without one, period and sequence decide.
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
        except (OrbitError, OrbitLost):
            pass
    same = former.features.sequence == later.features.sequence
    return 1.0 + apart(former.features, later.features, mirrors) if same else float("inf")
