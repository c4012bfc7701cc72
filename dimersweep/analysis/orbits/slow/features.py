"""Features of a periodic motion, from a run or an orbit: its period, its sequence, and its place at a spin.

The place has quantities that do not jump at an event: the gaps of both ends at eight phases of the plate in
each period, and the mean turn of the heading in a period. Where these agree at the same axial spin, so do
all other coordinates.

On a level plate the mirror image of a motion is a motion: a mirror in the vertical plane of the dimer's axis changes
the signs of the spin and of the heading's turn. If the ends are alike, they may also change places. With mirrors, of a
motion and its image in that plane the one with a spin that is not negative stands for both. The other image, with both
changes, is compared in `shifted`.
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

VIEWS = TURN * np.arange(8) / 8  # phases of the plate at which the gaps are taken [rad]
ALIKE_WITHIN = 0.02  # distance below which two places at the same spin are one motion, in units of g/omega^2
REPEATS_WITHIN = 1e-3  # distance below which the places in two periods of the plate are the same, in the same units
MOST_BENT = 0.2  # greatest distance of a family from its interpolation, in the same units: beyond lies another motion
CARRIED_TO = 9  # number of spins at which the orbits of a family are found; its place is interpolated between them


class Mirrors(NamedTuple):
    """The mirror images that count as the same motion."""

    plane: bool  # whether the image in the vertical plane of its axis does
    ends: bool  # whether the image with exchanged ends does


class Features(NamedTuple):
    """The features by which periodic motions are compared."""

    periods: int  # forcing periods after which it repeats
    sequence: str  # symbol sequence, see `passage`; with mirrors of the ends, that of both images which sorts first
    spin: float  # mean axial spin at the times of the gaps [rad/s]
    gaps: np.ndarray  # gaps of both ends at `VIEWS` of each plate period, in units of g/omega^2, shape (periods, 8, 2)
    turn: float  # mean turn of the heading in a forcing period, times half the length, in units of g/omega^2

    def least_period(self) -> int:
        """Return the fewest forcing periods after which the place repeats.

        They are fewer than `periods` where a branch of longer period has joined one of a shorter period.
        """
        for n in range(1, self.periods):
            if self.periods % n == 0 and np.abs(self.gaps - np.roll(self.gaps, n, axis=0)).max() < REPEATS_WITHIN:
                return n
        return self.periods


def mirrors_of(parameters: Mapping[str, float], wanted: bool) -> Mirrors:
    """Return the images that count as one motion: none unless `wanted`, that of the ends only if these are alike."""
    alike = all(value_of(one, parameters) == value_of(two, parameters) for one, two in ENDS.values())
    return Mirrors(wanted, bool(wanted and alike and value_of("k_ratio", parameters) == 1))


def features_of(m: ReturnMap, passage: Passage, mirrors: Mirrors) -> Features:
    """Return the features of a motion from its record over one period, which begins at the section of `m`."""
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
    """Return the features of the motion at the end of a run, which repeats after `periods` forcing periods.

    `start` is that end, as for `at_end`.
    """
    m, state = at_end(parameters, start, periods, rtol, recorder)
    _, _, passage = recorder.run(m.row, state, periods, rtol)
    return features_of(m, passage, mirrors)


def features_of_orbit(orbit: PeriodicOrbit, mirrors: Mirrors) -> Features:
    """Return the features of an orbit, at its spin."""
    return features_of(orbit.fixed.map, orbit.slow_motion.passage, mirrors)


def apart(a: Features, b: Features, mirrors: Mirrors) -> float:
    """Return the distance of two places, in units of g/omega^2; inf if the motions have different periods.

    The spins are not compared. A motion of period n may begin with any of its n periods.
    """
    return shifted(a, b, mirrors)[0]


def shifted(a: Features, b: Features, mirrors: Mirrors) -> tuple[float, Features]:
    """Return the distance of two places, see `apart`, and the image of `b` that lies nearest to `a`."""
    if a.periods != b.periods:
        return float("inf"), b
    images = [b, b._replace(gaps=b.gaps[..., ::-1], turn=-b.turn)] if mirrors.ends else [b]
    turned = [image._replace(gaps=np.roll(image.gaps, k, axis=0)) for image in images for k in range(b.periods)]
    far = [float(max(np.abs(a.gaps - image.gaps).max(), abs(a.turn - image.turn))) for image in turned]
    nearest = int(np.argmin(far))
    return far[nearest], turned[nearest]


class Carried:
    """The place of an orbit along its slow family: motions are compared with the orbit at their own spin.

    The family is followed from the orbit as far as it goes between the least and the greatest of `spins`. These are
    mean axial spins, as in `Features` [rad/s].
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
        """Follow the family from a known orbit through mean `spins`; return each orbit with its features."""
        after = begin.spin / view.spin if view.spin else 1.0  # spin after the impact over the mean spin
        found = []
        for one in walk(begin, after * spins, runs=True)[0].values():
            view = shifted(view, features_of_orbit(one, self.mirrors), self.mirrors)[1]
            found.append((one, view))
        return found

    def at(self, spin: float) -> Features | None:
        """Return the features of the family, interpolated at a mean spin [rad/s], or None where it was not found."""
        one, slack = self.views[0], MISSING_OVER * max(1.0, abs(spin))
        spins = [view.spin for view in self.views]
        if not spins[0] - slack <= spin <= spins[-1] + slack:
            return None
        places = np.array([[*view.gaps.ravel(), view.turn] for view in self.views])
        *gaps, turn = (float(np.interp(spin, spins, column)) for column in places.T)
        return one._replace(spin=spin, gaps=np.reshape(gaps, one.gaps.shape), turn=turn)

    def apart(self, motion: Features) -> float:
        """Return the distance of a motion from the family at its own spin, see `apart`; inf where no family was found.

        Where the family bends or leaps it may lie far from its interpolation: there it is followed to
        the spin of the motion.
        """
        here = self.at(motion.spin)
        far = float("inf") if here is None else apart(here, motion, self.mirrors)
        if ALIKE_WITHIN <= far < MOST_BENT:
            beside = np.argsort([abs(view.spin - motion.spin) for view in self.views])[:2]
            for k in beside:
                there = self._followed(self.orbits[k], self.views[k], np.array([motion.spin]))
                far = min([far, *(apart(view, motion, self.mirrors) for _, view in there)])
        return far
