"""The return map of a dimer from one start of a forcing period to the next, in coordinates that leave out the cyclic ones.

The cyclic ones are place, heading and spin angle. The others are the gaps and their rates, theta' cos(beta), the axial spin,
and the velocity of the centre of mass along and across the axis, in units of g/omega^2, g/omega, and g/omega over h and r.
"""

import numpy as np

from dimersweep.kernel.batch import ask_for
from dimersweep.kernel.compiler.records import as_object
from dimersweep.kernel.course import Workspace, new_workspace
from dimersweep.kernel.model.body import dimer_of, dip_of, slip_at
from dimersweep.kernel.model.layout import CA, CB, FREE, OK, SPIN, STATUS_MESSAGES, STICK, WP, State
from dimersweep.kernel.record import no_record
from dimersweep.kernel.return_map import advance

NAMES = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "turn_rate", "spin", "along", "across")


class Section:
    """The return map of one dimer on one plate, between points of shape (8,) in the order of `NAMES`.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
        Their parameters.
    rtol : float
        Accuracy of the map [1].
    space : Workspace, optional
        Scratch arrays to share.
    """

    def __init__(self, row: np.ndarray, rtol: float, space: Workspace | None = None) -> None:
        self.row, self.rtol = row, rtol
        self.dm = as_object(dimer_of(row))
        omega = self.dm.omega
        v = self.dm.g / omega
        self.units = np.array(
            [v / omega, v / omega, v, v, v / (0.5 * self.dm.l), v / max(self.dm.p1.r, self.dm.p2.r), v, v]
        )
        self.space, self.record = space or new_workspace(), no_record()

    def point(self, state: np.ndarray) -> np.ndarray:
        """The point of the section that a kernel state is at."""
        s = State(*state)
        return np.array([s.d1, s.d2, s.n1, s.n2, s.wp, s.spin, s.ca, s.cb]) / self.units

    def state(self, point: np.ndarray) -> np.ndarray:
        """The kernel's state at a point; a gap that is below zero by a rounding of the point is closed."""
        d1, d2, n1, n2, wp, spin, ca, cb = point * self.units
        d1, d2 = max(0.0, d1), max(0.0, d2)
        dip = dip_of(self.dm, d2 - d1)
        wb = (n2 - n1) / (self.dm.l * np.cos(self.dm.beta_0 + dip))
        return np.array(State(d1=d1, d2=d2, n1=n1, n2=n2, dip=dip, wb=wb, wp=wp, spin=spin, ca=ca, cb=cb))

    def held(self, state: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """The state with the ends that stick at rest: the motion of the centre of mass follows from the other rates."""
        if (modes == STICK).all():
            state[WP] = -state[SPIN] * self.dm.sin_0 / self.dm.cos_0  # it rolls straight on, or as a cone
        for i in np.flatnonzero(modes == STICK):
            along, across = slip_at(self.dm, state, i)
            state[CA] -= along
            state[CB] -= across
        return state

    def after(self, state: np.ndarray, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """The point after whole periods, and the friction modes of the ends there.

        Raises
        ------
        RuntimeError
            If the kernel cannot go on.
        """
        modes = np.zeros(2)
        status = advance(self.row, state, modes, ask_for(periods, self.rtol), self.space, self.record)
        if status != OK:
            raise RuntimeError(STATUS_MESSAGES[status])
        return self.point(state), modes


def free_coordinates(modes: np.ndarray) -> list[int]:
    """Numbers of the coordinates that contact leaves free.

    An end on the plate has neither gap nor rate. Where one sticks, the centre of mass moves as it must; where both do, only
    the spin is left.
    """
    free = [k for k in range(4) if modes[k % 2] == FREE]
    if not (modes == STICK).all():
        free.append(4)
    free.append(5)
    return free if (modes == STICK).any() else [*free, 6, 7]
