"""Grazing: an end that comes down, turns in the air and just misses the plate.

Where the gap at which it turns is zero an impact begins, and the map has a square root there (Nordmark, doi
10.1016/0022-460X(91)90592-8): on the side of the impact no derivative is of use. On the other side the map is smooth, and so is
that gap. A branch may turn back there, so that both orbits exist on one side of the parameter.
"""

import numpy as np
from scipy.optimize import brentq

from dimersweep.kernel.model.layout import D1, FREE, N1
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.orbits.branch import Axis, Equations, Point, one_sided
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import Image, OrbitLost, ReturnMap

GAP_SAMPLES = 64  # in a forcing period, of an end in the air
TURN_KNOWN = 1e-7  # how well the time is known at which an end turns [rad]: the gap does not change to first order
WIDE, NO_GAP = 0.05, 1e-9  # gap beyond which no impact is near; gap that counts as none, in units of the section
CLOSER, LEAST_CLOSER = 0.02, 0.7  # gap that is aimed at, over the one before: a step must not lead across
ACROSS = 1e-6  # distance to which a point across is taken, in units of the section


def least_gap(m: ReturnMap, image: Image) -> float:
    """The least gap at which an end turns in the air, in units of the section; infinite where none does."""
    passage = image.passage
    lengths, segments = np.diff(passage.times), passage.segments
    least = np.inf
    for end in (0, 1):
        free = (segments[:-1, SEGMENT_MODES + end] == FREE) & (segments[:-1, SEGMENT_HOP_TIME] == 0)
        for k in np.flatnonzero(free & (lengths > TURN / GAP_SAMPLES)).tolist():

            def of_end(phases: np.ndarray, k: int = k, end: int = end) -> tuple[np.ndarray, np.ndarray]:
                states, _ = m.states(passage, k, phases)
                return states[:, D1 + end], states[:, N1 + end]

            phases = np.linspace(passage.times[k], passage.times[k + 1], int(GAP_SAMPLES * lengths[k] / TURN) + 2)
            rates = of_end(phases)[1]
            for j in np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0)):
                try:
                    turns = brentq(lambda at: of_end(np.array([at]))[1][0], phases[j], phases[j + 1], xtol=TURN_KNOWN)
                except ValueError as error:  # a rate by the rounding of which one end has the other's sign
                    raise OrbitLost(f"no time is found at which an end turns ({error})") from error
                least = min(least, float(of_end(np.array([turns]))[0][0] / m.section.units[0]))
    return least


def graze(axis: Axis, near: Point) -> tuple[Point, str]:
    """The orbit near one at which an end just misses the plate, and the word beyond, where it strikes.

    Parameters
    ----------
    axis : Axis
    near : Point
        At which an end turns near the plate.

    Raises
    ------
    OrbitLost
        If no end does, or none is found.
    """
    aim = gap = least_gap(near.map, near.fixed.image)
    if not NO_GAP < gap < WIDE:
        raise OrbitLost("no end turns near the plate")

    equations = Equations(axis, near, lambda _, m, image: least_gap(m, image) - aim)
    first = equations.derivative(near.y(axis), min(near.fixed.map.step, 0.1 * gap))
    if not np.isfinite(first).all():
        raise OrbitLost("the end strikes beside the orbit already")
    at, known, closer = near, first, CLOSER
    while gap > NO_GAP:
        aim = max(closer * gap, NO_GAP)
        try:
            at, latest = equations.solved(at.y(axis), known=known)
        except OrbitLost:  # the step led across, or too far
            closer **= 0.5
            if closer > LEAST_CLOSER:
                raise
            continue
        gap, known, closer = aim, first if latest is None else latest, CLOSER
    opens = first[-1]
    at = one_sided(axis, at, np.where(opens >= 0, 1.0, -1.0), opens)
    return at._replace(mark_slope=opens, grazes=True), _word_beyond(axis, at, opens)


def _word_beyond(axis: Axis, at: Point, gap_slope: np.ndarray) -> str:
    beyond = at.y(axis) - ACROSS * gap_slope / np.abs(gap_slope).max()
    m = axis.map_at(at.fixed.map, beyond[-1] * axis.scale)
    return m.image(beyond[:-1]).passage.word
