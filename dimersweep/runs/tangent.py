"""Small changes of a motion over forcing periods, in coordinates that are regular where the dimer stands upright.

A place has ten of them: the height of the centre of mass over the plate, its velocity, the angular velocity and the unit
vector along the axis, with the components of all vectors along the plate's axes, in units of g/omega^2, g/omega, and these
over l/2. A free flight keeps the volume of changes in them (Liouville), and so does a plate that moves as the time tells.

A turn of everything about the vertical is no change of the motion: what a change has along it is taken out. Volumes of what
is left grow with the inverse of the size of that turn. As long as none of the eight directions is lost, lengths are scaled by
its eighth root, so that a flight keeps the volume again.
"""

from math import atan2, cos, hypot, sin

import numpy as np

from dimersweep.kernel.model.body import rise_at
from dimersweep.kernel.model.layout import FREE, State
from dimersweep.runs.period_map import Section, free_coordinates

N_PLACE, N_MOST = 10, 8  # coordinates of a place, and how many changes matter where both ends are in the air
# of differences: the greatest step, by how much the next one is less, and how many are tried at most
STEP, FINER_STEP, STEPS_TRIED = 1e-3, 4.0, 8
GOOD = 1e-8  # change of a derivative with the next step, over its size, below which no further step is tried
BY_CHANCE = 10.0  # bound on an error over that change: two can be alike by chance


class Tangents:
    """Changes of the motions of one dimer on one plate, in the coordinates of a place.

    Parameters
    ----------
    section : Section
        Its return map.
    """

    def __init__(self, section: Section) -> None:
        self.section, self.dm = section, section.dm
        omega, g, arm = self.dm.omega, self.dm.g, 0.5 * self.dm.l
        length, speed = g / omega**2, g / omega
        self.units = np.repeat([length, speed, speed / arm, length / arm], [1, 3, 3, 3])

    def place(self, state: np.ndarray) -> np.ndarray:
        """The place of a kernel state, shape (10,)."""
        s = State(*state.tolist())
        h, beta = self.dm.p1.h, self.dm.beta_0 + s.dip
        sb, cb, st, ct = sin(beta), cos(beta), sin(s.theta), cos(s.theta)
        place = (
            s.d1 - h * sb,
            s.cb * ct - s.ca * st,
            s.ca * ct + s.cb * st,
            s.n1 - h * cb * s.wb,
            s.wb * ct + s.wp * sb * st - s.spin * cb * st,
            s.wb * st - s.wp * sb * ct + s.spin * cb * ct,
            s.wp * cb + s.spin * sb,
            -cb * st,
            cb * ct,
            sb,
        )
        return np.array(place) / self.units

    def state(self, place: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """The kernel state at a place; ends that are down by their friction modes stay so, and those that stick at rest."""
        dm, h, down = self.dm, self.dm.p1.h, modes != FREE
        height, u, v, w, p, q, r, *axis = (place * self.units).tolist()
        theta, beta = atan2(-axis[0], axis[1]), atan2(axis[2], hypot(axis[0], axis[1]))
        if down.all():
            beta = float(dm.beta_0)
        sb, cb, st, ct = sin(beta), cos(beta), sin(theta), cos(theta)
        wb = 0.0 if down.all() else p * ct + q * st
        rise, apart = float(rise_at(dm, beta)), dm.l * cb * wb
        gap, rate = height + h * sb, w + h * cb * wb
        if down.any():
            gap, rate = (0.0, 0.0) if down[0] else (-rise, -apart)
        else:
            gap = max(gap, 0.0, -rise)  # no end is below the plate
        gap_2, rate_2 = (0.0, 0.0) if down[1] else (gap + rise, rate + apart)
        state = State(
            d1=gap,
            d2=gap_2,
            n1=rate,
            n2=rate_2,
            dip=beta - dm.beta_0,
            wb=wb,
            wp=p * sb * st - q * sb * ct + r * cb,
            spin=q * cb * ct - p * cb * st + r * sb,
            ca=v * ct - u * st,
            cb=u * ct + v * st,
            theta=theta,
        )
        return self.section.held(np.array(state), modes)

    def after(self, state: np.ndarray) -> np.ndarray:
        """The place a forcing period after a kernel state."""
        later = state.copy()
        self.section.after(later, 1)
        return self.place(later)

    def basis(self, place: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """Orthogonal changes of a place that contact leaves free, shape (n, 10)."""
        step = 1e-4
        ways = [[self.place(self.state(place + by * d, modes)) for by in (step, -step)] for d in np.eye(N_PLACE)]
        changes = np.array([ahead - back for ahead, back in ways]).T
        _, _, found = np.linalg.svd(_less_turn(changes, place).T)
        return found[: len(free_coordinates(modes))]

    def grown(
        self, place: np.ndarray, modes: np.ndarray, image: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What changes of a place become in one forcing period, which leads to the place `image`.

        Parameters
        ----------
        place, image : ndarray, shape (10,)
        modes : ndarray, shape (2,)
            Friction modes at `place`.
        directions : ndarray, shape (n, 10)
            Changes of unit length.

        Returns
        -------
        columns : ndarray, shape (10, n)
        errors : ndarray, shape (n,)
            Bounds on their lengths' errors.
        """
        pairs = [self._derivative(place, modes, direction) for direction in directions]
        scale = _density(image) / _density(place) if len(directions) == N_MOST else 1.0
        columns = np.array([column for column, _ in pairs]).reshape(-1, N_PLACE).T  # there may be none
        columns = _less_turn(columns, image)
        return scale * columns, BY_CHANCE * scale * np.array([error for _, error in pairs])

    def _derivative(self, place: np.ndarray, modes: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, float]:
        """The derivative of the map in a direction, and its change with the step, the least of all.

        From central differences of two steps, so that the error goes with the fourth power of them (Richardson).
        """
        best, least, step = np.zeros(N_PLACE), np.inf, STEP
        coarse = before = None
        for _ in range(STEPS_TRIED):
            ahead, back = (self.after(self.state(place + by * direction, modes)) for by in (step, -step))
            fine, step = (ahead - back) / (2 * step), step / FINER_STEP
            if coarse is not None:
                now = fine + (fine - coarse) / (FINER_STEP**2 - 1)
                change = np.inf if before is None else float(np.linalg.norm(now - before))
                if change < least:
                    best, least = now, change
                if least <= GOOD * np.linalg.norm(best):
                    break
                before = now
            coarse = fine
        return best, least


def _turn(place: np.ndarray) -> np.ndarray:
    """How a place changes with a turn of everything about the vertical."""
    turn = np.zeros(N_PLACE)
    turn[[1, 4, 7]], turn[[2, 5, 8]] = -place[[2, 5, 8]], place[[1, 4, 7]]
    return turn


def _less_turn(columns: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Changes of a place, shape (10, n), less what they have along the turn."""
    turn = _turn(place)
    size = turn @ turn
    return columns - np.outer(turn, turn @ columns) / size if size > 0 else columns


def _density(place: np.ndarray) -> float:
    """What lengths at a place are scaled by; its power of the number of changes is the size of the turn there."""
    size = float(np.linalg.norm(_turn(place)))
    return size ** (1 / N_MOST) if size > 0 else 1.0
