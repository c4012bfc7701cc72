"""The mean path of an orbit: the circle that the centre of mass goes round, and its swing about it within a period."""

from typing import NamedTuple

import numpy as np

from dimersweep.kernel.model.layout import DIP, THETA, X1, Y1
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import ReturnMap

CIRCLE = 1e-12  # turn of a period [rad] that is none
CHORDS = 16  # parts of a forcing period: with these the radius of the base case's path is known to 1e-6 m


class MeanPath(NamedTuple):
    """The circle about which the centre of mass swings.

    Attributes
    ----------
    radius, speed : float
        inf for a straight path [m]; along the circle or the line [m s-1].
    bend : complex
        Change of the mean velocity over itself, seen from the heading (real part: it grows; imaginary part: it turns in the
        sense of the path) [s-1].
    phases : ndarray, shape (n,)
        Of the plate, in each forcing period the same [rad].
    swing : ndarray of complex, shape (n,)
        There, how far the centre of mass is out of the circle (real part), and ahead on it (imaginary part) [1]: in radii.
    """

    radius: float
    speed: float
    bend: complex
    phases: np.ndarray
    swing: np.ndarray


def path_of(m: ReturnMap, z: np.ndarray) -> MeanPath:
    """The mean path of a motion over its period from a point of the section on.

    The chords of the parts of the period are summed as in `kernel.mean_path`; those of the next one give the bend.

    Raises
    ------
    OrbitLost
        If the kernel cannot go on.
    """
    count = CHORDS * m.periods
    parts = np.arange(2 * count + 1) / count
    at = TURN * m.periods * parts
    _, _, passage = m.tape.run(m.row, m.state(z), 2 * m.periods, m.rtol, path=True)
    states, _ = m.states(passage, np.searchsorted(passage.times, at, side="right") - 1, at)
    heading = np.exp(1j * states[:, THETA])
    places = states[:, X1] + 1j * states[:, Y1] - 1j * m.dimer.p1.h * np.cos(m.dimer.beta_0 + states[:, DIP]) * heading
    turn, later = np.diff(states[::count, THETA]).tolist()
    step = np.repeat([turn, later], count) / count
    chords = np.exp(-1j * (np.cumsum(step) - 0.5 * step)) * np.diff(places)
    way, next_way = chords.reshape(2, count).sum(axis=1)
    time = m.periods / m.parameters["f"]
    speed = float(abs(way) / time / np.sinc(step[0] / TURN))
    phases = np.mod(m.phase + at[:count], TURN)
    if abs(turn) <= CIRCLE:
        return MeanPath(np.inf, speed, 0j, phases, np.zeros(count, complex))
    bend = complex(next_way / way - 1) / time
    middle = places[0] - (places[count] - places[0]) / np.expm1(1j * turn)
    radii = (places[:count] - middle) * np.exp(-1j * turn * parts[:count])
    swing = radii / radii.mean() - 1
    if turn < 0:
        bend, swing = bend.conjugate(), swing.conj()
    return MeanPath(speed * time / abs(turn), speed, bend, phases, swing)
