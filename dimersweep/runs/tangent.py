"""Follow small changes of a motion over forcing periods, in coordinates that are regular even for an upright dimer.

A place has ten coordinates: the height of the centre of mass over the plate, its velocity, the angular velocity, and
the unit vector along the axis. Vectors have their components along the plate's axes. The units are g/omega^2 for the
height and g/omega for the velocity; for the angular velocity and the unit vector g/omega and g/omega^2 over l/2.

A free flight preserves the volume of changes in these coordinates (Liouville), and so does a plate whose motion depends
on time alone.

A turn of everything about the vertical does not change the motion: the part of a change along this turn is removed.
Volumes of the rest grow with the inverse of the size of the turn. As long as none of the eight directions is lost,
lengths are scaled by the eighth root of that size, so that a flight preserves the volume again.
"""

from math import atan2, cos, hypot, sin

import numpy as np

from dimersweep.kernel.model.body import rise_at
from dimersweep.kernel.model.layout import FREE, State
from dimersweep.runs.period_map import Section, free_coordinates

# coordinates of a place, and directions of change where both ends are in the air: two less, for the length of the axis
# and the turn about the vertical
N_PLACE, N_MOST = 10, 8
# steps of differences: the greatest, the ratio of one to the next, and the most that are tried
STEP, FINER_STEP, STEPS_TRIED = 1e-3, 4.0, 8
GOOD = 1e-8  # relative change of a derivative from step to step below which no further step is tried
BY_CHANCE = 10.0  # bound on the error over that change: two derivatives can be alike by chance


class Tangents:
    """Changes of the motions of one dimer on one plate, in the coordinates of a place (see the module).

    Parameters
    ----------
    section : Section
        Return map of the dimer.
    """

    def __init__(self, section: Section) -> None:
        self.section, self.dm = section, section.dm
        omega, g, arm = self.dm.omega, self.dm.g, 0.5 * self.dm.l
        length, speed = g / omega**2, g / omega
        self.units = np.repeat([length, speed, speed / arm, length / arm], [1, 3, 3, 3])

    def place(self, state: np.ndarray) -> np.ndarray:
        """Return the place of a kernel state, shape (10,)."""
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
        """Return the kernel state at a place, with the friction modes of the ends in `modes`.

        Ends that are down by their friction modes stay down, and ends that stick are at rest.
        """
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
        return self.section.with_ends_at_rest(np.array(state), modes)

    def after(self, state: np.ndarray) -> np.ndarray:
        """Return the place one forcing period after a kernel state."""
        later = state.copy()
        self.section.after(later, 1)
        return self.place(later)

    def basis(self, place: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """Return orthogonal changes of a place that span the changes that contact leaves free, shape (n, 10)."""
        step = 1e-4
        sides = [[self.place(self.state(place + by * d, modes)) for by in (step, -step)] for d in np.eye(N_PLACE)]
        changes = np.array([ahead - back for ahead, back in sides]).T
        _, _, found = np.linalg.svd(_less_turn(changes, place).T)
        return found[: len(free_coordinates(modes))]

    def grown(
        self, place: np.ndarray, modes: np.ndarray, image: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the images of changes of a place after one forcing period, which leads to the place `image`.

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
            Images of the changes.
        errors : ndarray, shape (n,)
            Bounds on the errors of the columns' lengths.
        """
        pairs = [self._derivative(place, modes, direction) for direction in directions]
        scale = _density(image) / _density(place) if len(directions) == N_MOST else 1.0
        columns = np.array([column for column, _ in pairs]).reshape(-1, N_PLACE).T  # there may be none
        columns = _less_turn(columns, image)
        return scale * columns, BY_CHANCE * scale * np.array([error for _, error in pairs])

    def _derivative(self, place: np.ndarray, modes: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the derivative of the map in a direction, and its least change from step to step.

        It comes from central differences of two steps, so that its error is of the fourth power of the step
        (Richardson).
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
    """Return the change of a place with a turn of everything about the vertical, per radian."""
    turn = np.zeros(N_PLACE)
    turn[[1, 4, 7]], turn[[2, 5, 8]] = -place[[2, 5, 8]], place[[1, 4, 7]]
    return turn


def _less_turn(columns: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return changes of a place, shape (10, n), without their parts along the turn about the vertical."""
    turn = _turn(place)
    size = turn @ turn
    return columns - np.outer(turn, turn @ columns) / size if size > 0 else columns


def _density(place: np.ndarray) -> float:
    """Return the scale of lengths at a place: the eighth root of the size of the turn there, 1 where there is none."""
    size = float(np.linalg.norm(_turn(place)))
    return size ** (1 / N_MOST) if size > 0 else 1.0
