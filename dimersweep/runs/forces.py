"""Kinetic and potential energy of kernel states, and the forces of their contacts."""

import numpy as np

from dimersweep.kernel.compiler.jit import plain
from dimersweep.kernel.contact.forces import A1, A2, F1, F2, L1, L2, N_F
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.body import dimer_of, rise_of_centre, slip_at
from dimersweep.kernel.model.layout import FREE, SLIP, Dimer, State
from dimersweep.kernel.model.plate import motion, motion_along
from dimersweep.kernel.sample import forces_at


def energies(dm: Dimer, states: np.ndarray, phi0: float) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy in the room of kernel states, shape (n, N_STATE) [J].

    The potential energy is zero with the centre of mass at the origin of the room: the plate's mean place.
    """
    s = State(*states.T)
    phase = s.phase + phi0
    height, rise, _ = motion(dm, phase)
    beta, sin_t, cos_t = dm.beta_0 + s.dip, np.sin(s.theta), np.cos(s.theta)
    away_x, away_y, v_x, v_y = motion_along(dm, phase)
    c_n = plain(rise_of_centre)(dm, s.n1, s.n2) + rise
    c_a, c_b = s.ca + v_y * cos_t - v_x * sin_t, s.cb + v_x * cos_t + v_y * sin_t
    turning = dm.J_t * (s.wb**2 + s.wp**2) + dm.J_a * s.spin**2
    kinetic = 0.5 * (dm.m * (c_a**2 + c_b**2 + c_n**2) + turning)
    h = dm.p1.h * np.cos(beta)
    x = s.x1 + h * sin_t + away_x
    y = s.y1 - h * cos_t + away_y
    z = height + dm.p1.r + s.d1 - dm.p1.h * np.sin(beta)
    return kinetic, dm.m * (dm.g * z - dm.fall_x * x - dm.fall_y * y)


def forces(row: np.ndarray, states: np.ndarray, modes: np.ndarray, rtol: float) -> dict[str, np.ndarray]:
    """Forces of the plate on both ends, by the names of `symbols.FORCES` [N].

    Two ends on the plate share one axial velocity. Where one of them sticks, only the sum of their axial forces is determined.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
    states, modes : ndarray, shapes (n, N_STATE), (n, 2)
        Kernel states, and the friction modes of their ends.
    rtol : float
        Accuracy of the run.
    """
    F = np.zeros((len(states), N_F))
    forces_at(row, states, modes, rtol, new_workspace(), F)
    dm = dimer_of(row)
    axial = np.array([F[:, A1], F[:, A2]])
    both = (modes != FREE).all(1)
    axial[:, both] = np.nan
    slide = both & (modes == SLIP).all(1)
    for i, p in enumerate((dm.p1, dm.p2)):
        along, across = slip_at(dm, states[slide].T, i)
        with np.errstate(invalid="ignore"):  # a slip that just turns back has no direction
            axial[i, slide] = -p.mu * F[slide, F1 + i * (F2 - F1)] * along / np.hypot(along, across)
    return {
        "normal_force_1": F[:, F1],
        "normal_force_2": F[:, F2],
        "axial_force": F[:, A1] + F[:, A2],
        "axial_force_1": axial[0],
        "axial_force_2": axial[1],
        "lateral_force_1": F[:, L1],
        "lateral_force_2": F[:, L2],
    }
