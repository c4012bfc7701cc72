"""What a periodic motion looks like, whoever came to it: its period, its sequence, and its place at the same spin.

The place is taken where no event can make it jump: the gaps of both ends at eight phases of the plate in each of its
periods, and the turn of the heading in one of them. Where these agree at the same axial spin, so do all other coordinates.

On a level plate the mirror image of a motion is a motion: in the vertical plane of its axis the heading's turn and the spin
change their signs. If the ends are alike, the two may also change places. With mirrors the spin of a motion is not
negative; what is left is the image with both.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.finding import at_end
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.passage import TURN, Passage
from dimersweep.analysis.orbits.map.poincare import Recorder, ReturnMap
from dimersweep.analysis.orbits.slow.families import MISSING_OVER, on_family, walk
from dimersweep.kernel.model.layout import D1, D2, SPIN, THETA
from dimersweep.parameters import value_of
from dimersweep.symbols import ENDS

VIEWS = TURN * np.arange(8) / 8  # phases of the plate at which the gaps are taken
ALIKE_WITHIN = 0.02  # places at the same spin that are one, in units of g/omega^2
REPEATS_WITHIN = 1e-3  # places in two periods of the plate that are one, in the same units
MOST_BENT = 0.2  # place of a family beside its interpolation at most, in the same units
CARRIED_TO = 9  # spins at which the orbits of a family are found; between them its place is interpolated


class Mirrors(NamedTuple):
    """Which images of a motion count as the motion."""

    plane: bool  # that in the vertical plane of its axis
    ends: bool  # that with both ends in each other's place


class Features(NamedTuple):
    """What a periodic motion looks like."""

    periods: int  # forcing periods after which it repeats
    sequence: str  # see `passage`; with mirrors of the ends the one of both sequences that sorts first
    spin: float  # mean axial spin at the times of the gaps [rad/s]
    gaps: np.ndarray  # gaps of both ends at `VIEWS` of each plate period, in units of g/omega^2, shape (periods, 8, 2)
    turn: float  # turn of the heading in a forcing period, as the way of an end in units of g/omega^2

    def least_period(self) -> int:
        """The fewest forcing periods after which the place repeats: fewer than `periods` on a branch that has joined one."""
        for n in range(1, self.periods):
            if self.periods % n == 0 and np.abs(self.gaps - np.roll(self.gaps, n, axis=0)).max() < REPEATS_WITHIN:
                return n
        return self.periods


def mirrors_of(parameters: Mapping[str, float], wanted: bool) -> Mirrors:
    """The images that count as one, if they are wanted: that of the ends only where these are alike."""
    alike = all(value_of(one, parameters) == value_of(two, parameters) for one, two in ENDS.values())
    return Mirrors(wanted, bool(wanted and alike and value_of("k_ratio", parameters) == 1))


def features_of(m: ReturnMap, passage: Passage, mirrors: Mirrors) -> Features:
    """The features of a motion from its record over one of its periods, which begins at the section of `m`."""
    whole = TURN * m.periods
    times = np.mod(VIEWS - m.phase + TURN * np.arange(m.periods)[:, None], whole)
    states, _ = m.states(passage, times.ravel())
    gaps = states[:, [D1, D2]].reshape(m.periods, VIEWS.size, 2)
    spin = float(states[:, SPIN].mean())
    first, last = passage.segments[0], passage.segments[-1]
    turn = (last[THETA] - first[THETA]) / m.periods * 0.5 * m.dimer.l
    sequence = passage.sequence
    if mirrors.ends:
        sequence = min(sequence, passage.mirrored_sequence)
    back = -1.0 if mirrors.plane and spin < 0 else 1.0
    unit = m.section.units[0]
    return Features(m.periods, sequence, back * spin, gaps / unit, float(back * turn / unit))


def features_from(
    parameters: Mapping[str, float], start: np.ndarray, periods: int, rtol: float, recorder: Recorder, mirrors: Mirrors
) -> Features:
    """The features of the motion that a run has come to, and that repeats after so many forcing periods; see `at_end`."""
    m, state = at_end(parameters, start, periods, rtol, recorder)
    _, _, passage = recorder.run(m.row, state, periods, rtol)
    return features_of(m, passage, mirrors)


def features_of_orbit(orbit: PeriodicOrbit, mirrors: Mirrors) -> Features:
    """The features of an orbit, at its spin."""
    return features_of(orbit.fixed.map, orbit.slow_motion.image.passage, mirrors)


def apart(a: Features, b: Features, mirrors: Mirrors) -> float:
    """How far two places are apart, in units of g/omega^2, whatever the spin; inf for other periods.

    Which of its periods a motion of period n begins with does not count.
    """
    return shifted(a, b, mirrors)[0]


def shifted(a: Features, b: Features, mirrors: Mirrors) -> tuple[float, Features]:
    """How far two places are apart, see `apart`, and the image of `b` that lies nearest."""
    if a.periods != b.periods:
        return float("inf"), b
    images = [b, b._replace(gaps=b.gaps[..., ::-1], turn=-b.turn)] if mirrors.ends else [b]
    turned = [image._replace(gaps=np.roll(image.gaps, k, axis=0)) for image in images for k in range(b.periods)]
    far = [float(max(np.abs(a.gaps - image.gaps).max(), abs(a.turn - image.turn))) for image in turned]
    nearest = int(np.argmin(far))
    return far[nearest], turned[nearest]


class Carried:
    """The place of an orbit along its slow family, so that motions are compared with it at their own spin.

    The family is entered at the orbit, and followed as far as it goes between the least and the greatest of `spins`, as
    features have them.
    """

    def __init__(self, orbit: PeriodicOrbit, spins: Sequence[float], mirrors: Mirrors) -> None:
        self.orbit, self.mirrors = orbit, mirrors
        here = features_of_orbit(orbit, mirrors)
        known = [(on_family(orbit.fixed.map, orbit.slow_motion), here)]
        least, greatest = min(here.spin, *spins), max(here.spin, *spins)
        grid = np.linspace(least - MISSING_OVER * abs(least), greatest + MISSING_OVER * abs(greatest), CARRIED_TO)
        for part in (grid[grid < here.spin][::-1], grid[grid > here.spin]):
            known += self._followed(*known[0], part)
        known.sort(key=lambda one: one[1].spin)
        self.orbits, self.views = (list(column) for column in zip(*known, strict=True))

    def _followed(
        self, begin: PeriodicOrbit, view: Features, spins: np.ndarray
    ) -> list[tuple[PeriodicOrbit, Features]]:
        """The family at `spins`, as far as it goes from one that is known, and what it looks like there."""
        after = begin.spin / view.spin if view.spin else 1.0  # spin after the impact over the mean
        found = []
        for one in walk(begin, after * spins, runs=True)[0].values():
            view = shifted(view, features_of_orbit(one, self.mirrors), self.mirrors)[1]
            found.append((one, view))
        return found

    def at(self, spin: float) -> Features | None:
        """The family at a spin, or None where it was not found."""
        one, slack = self.views[0], MISSING_OVER * max(1.0, abs(spin))
        spins = [view.spin for view in self.views]
        if not spins[0] - slack <= spin <= spins[-1] + slack:
            return None
        places = np.array([[*view.gaps.ravel(), view.turn] for view in self.views])
        *gaps, turn = (float(np.interp(spin, spins, column)) for column in places.T)
        return one._replace(spin=spin, gaps=np.reshape(gaps, one.gaps.shape), turn=turn)

    def apart(self, motion: Features) -> float:
        """How far a motion is from the family at its own spin, see `apart`; inf where the family was not found.

        Where the family bends or leaps it may be far from its interpolation: there it is followed to that spin.
        """
        here = self.at(motion.spin)
        far = float("inf") if here is None else apart(here, motion, self.mirrors)
        if ALIKE_WITHIN <= far < MOST_BENT:
            beside = np.argsort([abs(view.spin - motion.spin) for view in self.views])[:2]
            for k in beside:
                there = self._followed(self.orbits[k], self.views[k], np.array([motion.spin]))
                far = min([far, *(apart(view, motion, self.mirrors) for _, view in there)])
        return far
