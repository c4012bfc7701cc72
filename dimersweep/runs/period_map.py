"""Map a dimer from one start of a forcing period to the next, in coordinates that leave out the cyclic ones.

Cyclic are place, heading and spinning angle. The eight coordinates are the gaps and their rates, theta' cos(beta), the
axial spin, and the velocity of the centre of mass along and across the axis.

Their units are g/omega^2 for gaps and g/omega for velocities, with g the gravity along the plate's normal. Those of
theta' cos(beta) and of the spin are g/omega over half the distance of the balls, and over the larger radius.
"""

from functools import cached_property
from math import cos
from typing import Any

import numpy as np

from dimersweep.kernel.batch import run_request
from dimersweep.kernel.compiler.records import as_object
from dimersweep.kernel.course import Workspace, new_workspace
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import FREE, OK, ROW, STATUS_MESSAGES, STICK, State
from dimersweep.kernel.numerics.sincos import TWO_PI
from dimersweep.kernel.passage import new_reading
from dimersweep.kernel.record import no_record
from dimersweep.kernel.return_map import advance
from dimersweep.kernel.section import SLOTS, state_at

NAMES = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "turn_rate", "spin", "along", "across")
_UNIT_SLOTS = [ROW.index(name) for name in ("f", "g", "tilt", "A_r", "r_1", "r_2")]
_SLOTS = list(SLOTS)
_NO_POINT, _NO_READING = np.empty(0), new_reading(0, 0)


class Section:
    """Return map of one dimer on one plate, between points of shape (8,) in the order of `NAMES`.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
        Parameters of dimer and plate.
    rtol : float
        Accuracy of the map [1].
    space : Workspace, optional
        Scratch arrays; by default the section has its own.
    """

    def __init__(self, row: np.ndarray, rtol: float, space: Workspace | None = None) -> None:
        self.row, self.rtol = row, rtol
        f, g, tilt, A_r, r_1, r_2 = row[_UNIT_SLOTS].tolist()
        omega = TWO_PI * f
        v, length = g * cos(tilt) / omega, (A_r - 1.0) * (r_1 + r_2)
        self.units = np.array([v / omega, v / omega, v, v, v / (0.5 * length), v / max(r_1, r_2), v, v])
        self.space = space or new_workspace()

    @cached_property
    def dm(self) -> Any:
        """Dimer of the kernel as a Python object."""
        return as_object(dimer_of(self.row))

    def point(self, state: np.ndarray) -> np.ndarray:
        """Return the point of the section for a kernel state."""
        return state[_SLOTS] / self.units

    def state(self, point: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """Return the kernel's state at a point, with the ends in their friction modes.

        A gap that is below zero by a rounding of the point is closed. Ends that stick are at rest, so that the velocity
        of the centre of mass follows from the other rates.
        """
        return self.judged_state(point, modes)[0]

    def judged_state(self, point: np.ndarray, modes: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the kernel's state at a point as `state` does, and OK or the status that says why there is none."""
        state = np.array(State())
        return state, state_at(self.row, self.units, point, modes, self.space.dimer, state)

    def with_ends_at_rest(self, state: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """Set the ends that stick at rest in `state`, which is modified and returned."""
        state_at(self.row, self.units, _NO_POINT, modes, self.space.dimer, state)
        return state

    def after(self, state: np.ndarray, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the point after whole forcing periods, and the friction modes of the ends there; `state` is modified.

        Raises
        ------
        RuntimeError
            If the kernel cannot go on.
        """
        modes = np.zeros(2)
        status = advance(self.row, state, modes, run_request(periods, self.rtol), self.space, no_record(), _NO_READING)
        if status != OK:
            raise RuntimeError(STATUS_MESSAGES[status])
        return self.point(state), modes


def free_coordinates(modes: np.ndarray) -> list[int]:
    """Return the numbers of the coordinates that contact leaves free.

    An end on the plate has neither gap nor gap rate. Where one end sticks, the velocity of the centre of mass follows
    from the other coordinates; where both stick, only the spin is left.
    """
    first, second = modes.tolist()
    free = [k for k in range(4) if (first, second)[k % 2] == FREE]
    if not first == second == STICK:
        free.append(4)
    free.append(5)
    return free if STICK in (first, second) else [*free, 6, 7]
