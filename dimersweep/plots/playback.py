"""Compute what a movie and a page show of a run: which times, and where balls and plate are at these times."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dimersweep.cubes.cube import names
from dimersweep.cubes.seen_run import SeenRun, check_shown
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count
from dimersweep.parameters import dimer_from

BALLS = ("#d62728", "#0072b2")  # colours of p1, p2
ROD, PLATE, PATH_COLOR = "#444444", "#56b4e9", "#999999"
MARKS = ("#f0e442", "#222222")  # colours of a ball's two marks, on opposite sides, from pole to pole of its axis
SLOWED = 20.0  # factor by which time is slower around double impacts
NEAR_IMPACT = 0.04  # time on either side of a double impact that is slowed [forcing periods]
MOST_FRAMES = 2000
ROUND_OFF = 1e-6  # excess over a whole number of frames that is round-off, and no further frame


@dataclass(frozen=True)
class Playback:
    """Times of a run that are shown, and their speed.

    Parameters
    ----------
    start, stop : float
        Times since the start of the run [s].
    speed : float
        Seconds of the run in a second of the movie.
    fps : int
        Frames a second.
    slow_impacts : bool
        True if time runs slower around double impacts.
    """

    start: float
    stop: float
    speed: float
    fps: int
    slow_impacts: bool

    def times(self, impacts: np.ndarray, T: float) -> np.ndarray:
        """Return the times of the run that the frames show [s], increasing; frames are 1/fps apart.

        Parameters
        ----------
        impacts : ndarray, shape (n,)
            Times of the double impacts [s], increasing.
        T : float
            Forcing period [s].

        Raises
        ------
        ParameterError
            If there are more than `MOST_FRAMES` frames.
        """
        reach = NEAR_IMPACT * T
        begin, end = (np.clip(impacts + by, self.start, self.stop) for by in (-reach, reach))
        edges = np.unique(np.concatenate([[self.start, self.stop], *((begin, end) if self.slow_impacts else ())]))
        middles = (edges[1:] + edges[:-1]) / 2
        slow = np.searchsorted(begin, middles) > np.searchsorted(end, middles)  # more have begun than have ended
        lasts = np.diff(edges) * np.where(slow & self.slow_impacts, SLOWED, 1.0) / self.speed
        shown = np.concatenate([[0.0], np.cumsum(lasts)])
        n = int(np.ceil(shown[-1] * self.fps - ROUND_OFF))
        if n > MOST_FRAMES:
            less = "give fewer periods or more speed" + (", or no slow impacts" if self.slow_impacts else "")
            raise ParameterError(f"animate: {n} frames; at most {MOST_FRAMES}: {less}")
        return np.interp(np.arange(n) / self.fps, shown, edges)


def playback_of(
    run: SeenRun, periods: int, speed: float = 0.1, fps: int = 25, *, last: bool = True, slow_impacts: bool = False
) -> Playback:
    """Return the playback of the last or first `periods` of a run, checked.

    Raises
    ------
    ParameterError
    """
    check_shown(run, "animate")
    periods, fps, speed = check_count("periods", periods), check_count("fps", fps), as_number("speed", speed)
    if speed <= 0:
        raise ParameterError(f"speed = {speed}: must be > 0")
    length = min(periods / run.parameters["f"], run.duration)
    start = run.duration - length if last else 0.0
    return Playback(start, start + length, speed, fps, slow_impacts)


class Frames(NamedTuple):
    """Places of the dimer in each of n frames, relative to the plate as it tilts and moves along itself [mm]."""

    cycles: np.ndarray  # shape (n,), time in forcing periods
    balls: np.ndarray  # shape (n, 2, 3), centres of p1 and p2
    centre: np.ndarray  # shape (n, 3), centre of mass
    along: np.ndarray  # shape (n, 2), unit vector from p1 to p2 as seen from above
    mark: np.ndarray  # shape (n, 3), unit vector square to the axis, which turns with the dimer
    plate: np.ndarray  # shape (n,), height of the plate
    away: np.ndarray  # shape (n, 3), displacement of the plate along itself
    radii: np.ndarray  # shape (2,), radii of the balls
    room: Rotation  # rotation from the axes of the plate to those of the room, where up is up


def frames(run: SeenRun, playback: Playback) -> Frames:
    """Return the frames of the part of a run that `playback` shows."""
    from dimersweep.kernel.model.plate import motion_along  # imports Numba, which pictures of cubes do not need

    dm, f = dimer_from(run.parameters), run.parameters["f"]
    impacts = np.array([])
    if playback.slow_impacts:
        impacts = np.unique(run.events["time"].values[names(run.events["kind"]).str.startswith("DI")])
    states = run.states(playback.times(impacts, 1 / f))
    first, centre = (1e3 * np.column_stack([states[axis + of] for axis in "xyz"]) for of in ("1", ""))
    beta, theta, gamma = (states[angle].values for angle in ("beta", "theta", "gamma"))
    along, across = (
        np.column_stack([-np.sin(theta), np.cos(theta)]),
        np.column_stack([np.cos(theta), np.sin(theta), 0 * theta]),
    )
    axis = np.column_stack([np.cos(beta)[:, None] * along, np.sin(beta)])
    rod = 1e3 * dm.l * axis
    away_x, away_y, _, _ = motion_along(dm, states["phase"].values)
    slope = np.hypot(dm.fall_x, dm.fall_y)
    turn = np.arctan2(slope, dm.g) / (slope or 1.0) * np.array([-dm.fall_y, dm.fall_x, 0.0])  # about its level line
    return Frames(
        cycles=states["time"].values * f,
        balls=np.stack([first, first + rod], axis=1),
        centre=centre,
        along=along,
        mark=np.cos(gamma)[:, None] * across + np.sin(gamma)[:, None] * np.cross(axis, across),
        plate=1e3 * states["plate"].values,
        away=1e3 * np.column_stack([away_x, away_y, np.zeros(beta.size)]),
        radii=1e3 * np.array([dm.p1.r, dm.p2.r]),
        room=Rotation.from_rotvec(turn),
    )
