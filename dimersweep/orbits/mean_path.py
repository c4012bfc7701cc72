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
    phases : ndarray, shape (n,)
        Of the plate, in each forcing period the same [rad].
    swing : ndarray of complex, shape (n,)
        There, how far the centre of mass is out of the circle (real part), and ahead on it (imaginary part) [1]: in radii.
    """

    radius: float
    speed: float
    phases: np.ndarray
    swing: np.ndarray


def path_of(m: ReturnMap, z: np.ndarray) -> MeanPath:
    """The mean path of a motion over its period from a point of the section on.

    The chords of the parts of the period are summed as in `kernel.mean_path`.

    Raises
    ------
    OrbitLost
        If the kernel cannot go on.
    """
    count = CHORDS * m.periods
    parts = np.arange(count + 1) / count
    at = TURN * m.periods * parts
    _, _, passage = m.tape.run(m.row, m.state(z), m.periods, m.rtol, path=True)
    states, _ = m.states(passage, np.searchsorted(passage.times, at, side="right") - 1, at)
    heading = np.exp(1j * states[:, THETA])
    places = states[:, X1] + 1j * states[:, Y1] - 1j * m.dimer.p1.h * np.cos(m.dimer.beta_0 + states[:, DIP]) * heading
    turn = states[-1, THETA] - states[0, THETA]
    step = turn / count
    chords = np.exp(-1j * step * (np.arange(count) + 0.5)) * np.diff(places)
    time = m.periods / m.parameters["f"]
    speed = float(abs(chords.sum()) / time / np.sinc(step / TURN))
    phases = np.mod(m.phase + at[:-1], TURN)
    if abs(turn) <= CIRCLE:
        return MeanPath(np.inf, speed, phases, np.zeros(count, complex))
    middle = places[0] - (places[-1] - places[0]) / np.expm1(1j * turn)
    radii = (places[:-1] - middle) * np.exp(-1j * turn * parts[:-1])
    swing = radii / radii.mean() - 1
    return MeanPath(speed * time / abs(turn), speed, phases, swing if turn > 0 else swing.conj())
