"""What a movie and a page show of a run: which times, and where the balls and the plate are then."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count
from dimersweep.parameters import dimer_from

BALLS = ("#d62728", "#0072b2")  # p1, p2
ROD, PLATE, TRACK = "#444444", "#56b4e9", "#999999"
SLOWED = 20.0  # how much slower the double impacts are shown
NEAR_IMPACT = 0.04  # of a double impact, in forcing periods on either side
MOST_FRAMES = 2000
ROUND_OFF = 1e-6  # of a number of frames


@dataclass(frozen=True)
class Playback:
    """Which times of a run are shown.

    Parameters
    ----------
    start, stop : float
        Times since the start of the run [s].
    speed : float
        Seconds of the run in a second of the movie.
    fps : int
        Frames a second.
    slow_impacts : bool
        Whether time runs slower around double impacts.
    """

    start: float
    stop: float
    speed: float
    fps: int
    slow_impacts: bool

    def times(self, impacts: np.ndarray, T: float) -> np.ndarray:
        """Times of the frames [s], increasing: what is shown at each of the moments 1/fps apart.

        Parameters
        ----------
        impacts : ndarray, shape (n,)
            Of the double impacts [s], increasing.
        T : float
            Forcing period [s].

        Raises
        ------
        ParameterError
            If there are too many.
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
    run: SeenRun,
    periods: int,
    speed: float = 0.1,
    fps: int = 25,
    *,
    last: bool = True,
    slow_impacts: bool = False,
) -> Playback:
    """The stretch of the run that is shown, judged.

    Raises
    ------
    ParameterError
    """
    run.record("animate")
    periods, fps, speed = check_count("periods", periods), check_count("fps", fps), as_number("speed", speed)
    if speed <= 0:
        raise ParameterError(f"speed = {speed}: must be > 0")
    length = min(periods / run.parameters["f"], run.duration)
    start = run.duration - length if last else 0.0
    return Playback(start, start + length, speed, fps, slow_impacts)


def frames(run: SeenRun, playback: Playback) -> xr.Dataset:
    """The states of the frames relative to the plate, with the centres of both balls, and how far the plate is away [m]."""
    from dimersweep.kernel.model.plate import motion_along  # Numba: pictures of cubes do without

    p = run.parameters
    kinds = run.events["kind"].values
    impacts = np.unique(run.events["time"].values[np.char.startswith(kinds, "DI")])
    states = run.states(playback.times(impacts, 1 / p["f"]))
    dm = dimer_from(p)
    length, (away_x, away_y, _, _) = dm.l, motion_along(dm, states["phase"])
    across = length * np.cos(states["beta"])
    return states.assign(
        x2=states["x1"] - across * np.sin(states["theta"]),
        y2=states["y1"] + across * np.cos(states["theta"]),
        z2=states["z1"] + length * np.sin(states["beta"]),
        away_x=away_x,
        away_y=away_y,
    )


def radii_of(run: SeenRun) -> tuple[float, float]:
    """Radii of p1 and p2 [mm]."""
    dimer = dimer_from(run.parameters)
    return 1e3 * dimer.p1.r, 1e3 * dimer.p2.r
