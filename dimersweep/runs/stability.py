"""What a small change of a motion grows to: the largest Lyapunov exponent of a run, the multipliers of a settled one.

Both use the map from one start of a forcing period to the next, in coordinates that leave out the cyclic ones (place,
heading and spin angle). They are the gaps and their rates, theta' cos(beta), the axial spin, and the velocity of the centre
of mass along and across the axis, in units of g/omega^2, g/omega, and g/omega over h and r.
"""

from typing import NamedTuple

import numpy as np

from dimersweep.errors import ParameterError
from dimersweep.kernel.course import Workspace, new_workspace
from dimersweep.kernel.model.body import dimer_of, dip_of
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    N1,
    N2,
    N_STATE,
    OK,
    SPIN,
    STATUS_MESSAGES,
    STICK,
    WB,
    WP,
)
from dimersweep.kernel.record import HOP_TIME, MODES, no_record
from dimersweep.kernel.return_map import advance
from dimersweep.parameters import check_count
from dimersweep.runs.recorded import Record
from dimersweep.runs.run import Run

NAMES = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "turn_rate", "spin", "along", "across")
_SLOTS = (D1, D2, N1, N2, WP, SPIN, CA, CB)
MAP_RTOL = 1e-11  # of the map, where the run was coarser: differences are taken of it
SETTLING = 10  # one in so many periods goes before the count begins, so that the twin has found its direction
BLOCKS = 20  # of periods, whose spread tells the error of a mean


class Multipliers(NamedTuple):
    """Eigenvalues of the return map of a settled motion.

    Attributes
    ----------
    values : ndarray, shape (n,), complex
        By size, the largest first: by what a small change is multiplied in one period of the motion. The motion is stable
        where all are below 1 in size.
    matrix : ndarray, shape (n, n)
        The derivative of the map.
    coordinates : tuple of str
        Its rows and columns: those of `NAMES` that are free in the contact at the start of the period.
    closure : float
        How far the motion fails to close after its period, in units of the coordinates.
    """

    values: np.ndarray
    matrix: np.ndarray
    coordinates: tuple[str, ...]
    closure: float


class Lyapunov(NamedTuple):
    """Largest Lyapunov exponent.

    Attributes
    ----------
    exponent, error : float
        Mean growth rate of a small difference, and the standard error of that mean [s-1].
    per_period : float
        The same growth per forcing period [1].
    """

    exponent: float
    error: float
    per_period: float


class Section:
    """The return map of one dimer on one plate, between points of shape (8,) in the order of `NAMES`.

    Parameters
    ----------
    parameters : dict
        Of the run.
    row : ndarray, shape (N_ROW,)
        The same as the kernel takes them.
    rtol : float
        Accuracy of the map [1].
    space : Workspace, optional
        Scratch arrays to share.
    """

    def __init__(
        self, parameters: dict[str, float], row: np.ndarray, rtol: float, space: Workspace | None = None
    ) -> None:
        self.row, self.rtol = row, rtol
        self.dm = dimer_of(row)
        omega = 2 * np.pi * parameters["f"]
        v = parameters["g"] / omega
        self.units = np.array([v / omega, v / omega, v, v, v / (0.5 * self.dm.l), v / parameters["r"], v, v])
        self.space, self.record = space or new_workspace(), no_record()

    def point(self, state: np.ndarray) -> np.ndarray:
        """The point of the section that a kernel state is at."""
        return state[list(_SLOTS)] / self.units

    def state(self, point: np.ndarray) -> np.ndarray:
        """The kernel's state at a point; a gap that is below zero by a rounding of the point is closed."""
        state = np.zeros(N_STATE)
        state[list(_SLOTS)] = point * self.units
        state[D1], state[D2] = max(0.0, state[D1]), max(0.0, state[D2])
        state[DIP] = dip_of(self.dm, state[D2] - state[D1])
        state[WB] = (state[N2] - state[N1]) / (self.dm.l * np.cos(self.dm.beta_0 + state[DIP]))
        return state

    def held(self, state: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """The state with the ends that stick at rest: the motion of the centre of mass follows from the other rates."""
        beta = self.dm.beta_0 + state[DIP]
        sin_b, cos_b = np.sin(beta), np.cos(beta)
        if (modes == STICK).all():
            state[WP] = -state[SPIN] * sin_b / cos_b  # it rolls straight on, or as a cone
        for i, p in enumerate((self.dm.p1, self.dm.p2)):
            if modes[i] == STICK:
                state[CA] = -(p.r - p.h * sin_b) * state[WB]
                state[CB] = p.r * cos_b * state[SPIN] - (p.r * sin_b - p.h) * state[WP]
        return state

    def after(self, state: np.ndarray, periods: int) -> tuple[np.ndarray, np.ndarray]:
        """The point after whole periods, and the friction modes of the ends there.

        Raises
        ------
        RuntimeError
            If the kernel cannot go on.
        """
        modes = np.zeros(2)
        status = advance(self.row, state, modes, periods, self.rtol, False, self.space, self.record)
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


def _end(run: Run, wanted: str) -> tuple[Record, np.ndarray, np.ndarray]:
    """The record of a run, with its last state and friction modes."""
    record = run.record(wanted)
    if run.status != "ok":
        raise ParameterError(f"{wanted}: the run did not reach its end ({run.message})")
    last = record.segments[-1]
    return record, last[:N_STATE].copy(), last[MODES:HOP_TIME].copy()


def multipliers(run: Run) -> Multipliers:
    """Multipliers of the motion that a run has settled to, from central differences of its return map.

    Parameters
    ----------
    run : Run
        Recorded, and settled: its mode has a period. Give it time: the multipliers are those of its last state.

    Returns
    -------
    Multipliers
        The directions that contact takes away in each period (gap and rate of an end on the plate, slip of one that sticks)
        are left out; their multipliers are zero.

    Raises
    ------
    ParameterError
        If the motion has no period, or a neighbouring one meets the section in another contact: then the section lies at an
        event of the motion; shift it with `phi0`.
    """
    record, state, modes = _end(run, "multipliers")
    if run.mode_period == 0:
        raise ParameterError(f"multipliers: the motion does not repeat (mode {run.mode}); give it more periods")
    return of_orbit(Section(run.parameters, record.row, min(run.rtol, MAP_RTOL)), state, modes, run.mode_period)


def of_orbit(section: Section, state: np.ndarray, modes: np.ndarray, periods: int) -> Multipliers:
    """Multipliers of the motion that comes back to `state`, in contact `modes`, after whole periods; see `multipliers`."""
    point, free = section.point(state), free_coordinates(modes)
    step = section.rtol ** (1 / 3)  # balances the error of the differences, step^2, with that of the map, rtol/step
    close = any(modes[end] == FREE and point[end] <= 2 * step for end in (0, 1))

    def mapped(by: float, k: int) -> np.ndarray:
        moved = point.copy()
        moved[k] += by
        image, contact = section.after(section.held(section.state(moved), modes), periods)
        if close or (contact != modes).any():
            raise ParameterError("multipliers: the section lies at an event of the motion; shift it with phi0")
        return image[free]

    columns = [(mapped(step, k) - mapped(-step, k)) / (2 * step) for k in free]
    matrix = np.array(columns).T
    values = np.linalg.eigvals(matrix).astype(complex)
    order = np.argsort(-np.abs(values), kind="stable")
    closure = float(np.abs(mapped(0.0, 0) - point[free]).max())
    return Multipliers(values[order], matrix, tuple(NAMES[k] for k in free), closure)


def lyapunov(run: Run, periods: int = 1000) -> Lyapunov:
    """Largest Lyapunov exponent of the motion that a run has come to.

    A twin starts beside the last state of the run; after each forcing period the growth of their difference is noted, and
    the twin put back to its first distance along the direction it has taken (Benettin's method).

    Parameters
    ----------
    run : Run
        Recorded; its transients are over.
    periods : int
        Forcing periods over which the growth is averaged; a tenth more go before.

    Returns
    -------
    Lyapunov
        -inf if the two become one, as at rest.

    Raises
    ------
    ParameterError
        If nothing was recorded, or the run did not reach its end.
    """
    record, state, _ = _end(run, "lyapunov")
    periods = check_count("periods", periods)
    section = Section(run.parameters, record.row, min(run.rtol, MAP_RTOL))
    apart = section.rtol**0.5  # far above the errors of the map, far below the size of the motion
    point = section.point(state)
    away = np.random.default_rng(0).normal(size=point.size)
    growth = []
    for _ in range(periods + periods // SETTLING):
        twin = section.state(point + away * (apart / np.linalg.norm(away)))
        started = np.linalg.norm(section.point(twin) - point)
        other, _ = section.after(twin, 1)
        point, _ = section.after(section.state(point), 1)
        away = other - point
        distance = np.linalg.norm(away)
        if distance == 0.0:
            return Lyapunov(-np.inf, 0.0, -np.inf)
        growth.append(np.log(distance / started))
    kept = np.array(growth[periods // SETTLING :])
    blocks = [block.mean() for block in np.array_split(kept, min(BLOCKS, kept.size))]
    f = run.parameters["f"]
    error = float(np.std(blocks, ddof=1) / len(blocks) ** 0.5) if len(blocks) > 1 else float("nan")
    return Lyapunov(float(kept.mean()) * f, error * f, float(kept.mean()))
