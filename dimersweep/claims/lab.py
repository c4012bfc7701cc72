"""The runs and cubes that the claims are tried on, each made once, when it is first needed."""

from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.runs.run import Orbit, Run
from dimersweep.runs.simulating import simulate
from dimersweep.studies.refine import refine
from dimersweep.studies.search import search
from dimersweep.studies.sweep import sweep

LOW: dict[str, Any] = {"mu": 0.05, "mu_s": 0.1}  # the paper's small friction
RTOL = 1e-8


def degrees(start: float, stop: float, step: float) -> dict[str, Any]:
    """An axis of angles."""
    return {"start": start, "stop": stop, "step": step, "unit": "deg"}


def orbit_of(run: Run) -> Orbit:
    """The orbit of a run that is known to drift.

    Raises
    ------
    RuntimeError
        If it does not.
    """
    if run.orbit is None:
        raise RuntimeError(f"{run!r} was expected to drift")
    return run.orbit


class Lab:
    """Runs and cubes, kept once they are made.

    Parameters
    ----------
    small : bool
        Whether grids are coarse and runs short, for a check in about a minute.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        Whether to show how far a sweep is.
    """

    def __init__(self, *, small: bool, workers: int | None = None, progress: bool = True) -> None:
        self.small = small
        self.how: dict[str, Any] = {"workers": workers, "progress": progress}
        self.starts = degrees(2, 60, 2 if small else 0.5)  # where a first drift is looked for
        self.late = 200 if small else 400  # forcing periods after which an orbit is read

    def _first(self, grid: dict[str, Any], fixed: dict[str, Any] | None = None, **more: Any) -> xr.Dataset:
        """The orbit at each point, from the least initial dip angle that drifts."""
        return search(
            grid | {"beta0": self.starts},
            fixed,
            over="beta0",
            ask="first",
            periods=300,
            orbit_periods=self.late,
            **more,
            **self.how,
        )

    @cached_property
    def base(self) -> Run:
        """The paper's base case, recorded."""
        return simulate(periods=self.late)

    @cached_property
    def low(self) -> Run:
        """The same with small friction."""
        return simulate(periods=self.late, **LOW)

    @cached_property
    def dips(self) -> xr.Dataset:
        """Modes over initial dip angle and frequency (Fig. 7)."""
        grid = {"f": [15, 20, 25], "beta0": degrees(1, 89, 1) if self.small else degrees(0.05, 89.95, 0.05)}
        return sweep(grid, periods=300, **self.how)

    @cached_property
    def speeds(self) -> xr.Dataset:
        """Modes over initial dip angle and initial velocity."""
        step = 2 if self.small else 0.25
        return sweep({"xdot0": [0.5, 1, 1.5, 2, 2.5], "beta0": degrees(1, 89, step)}, periods=300, **self.how)

    @cached_property
    def plane(self) -> xr.Dataset:
        """Regions of the e-Gamma plane (Fig. 8)."""
        grid: dict[str, Any] = {
            "e": {"start": 1 / 3, "stop": 0.8, "num": 3 if self.small else 8},
            "Gamma": {"start": 0.4, "stop": 1.6, "num": 4 if self.small else 13},
            "beta0": degrees(4, 84, 5) if self.small else degrees(3, 87, 3),
        }
        halvings = {"e": 1, "Gamma": 3 if self.small else 5}
        periods, rtol = (100, 1e-6) if self.small else (200, RTOL)
        between = ["drift", "rest"]
        return refine(grid, over="beta0", halvings=halvings, between=between, periods=periods, rtol=rtol, **self.how)

    @cached_property
    def short(self) -> xr.Dataset:
        """How many initial dip angles drift, for each aspect ratio."""
        grid = {
            "Gamma": [0.9],
            "A_r": {"start": 2, "stop": 8, "step": 0.5 if self.small else 0.1},
            "beta0": degrees(1, 89, 8 if self.small else 2),
        }
        return search(grid, over="beta0", ask="fraction", periods=300, **self.how)

    @cached_property
    def friction(self) -> xr.Dataset:
        """Orbits over aspect ratio and both friction coefficients."""
        mu = [0.05, 0.1, 0.2, 0.3] if self.small else np.arange(0.05, 0.51, 0.05)
        mu_s = [0.1, 0.2, 0.4, 0.6] if self.small else np.arange(0.05, 0.81, 0.05)
        return self._first({"A_r": [4, 5, 6, 7], "mu": mu, "mu_s": mu_s})

    @cached_property
    def orbits(self) -> xr.Dataset:
        """Orbits over aspect ratio and frequency (Fig. 14 to 16)."""
        A_r = {"start": 5, "stop": 7, "step": 1 if self.small else 0.25}
        f = {"start": 15, "stop": 35, "step": 10 if self.small else 5}
        return self._first({"A_r": A_r, "f": f})

    @cached_property
    def slow(self) -> xr.Dataset:
        """Orbits for the initial velocities of Fig. 13."""
        return self._first({"xdot0": [0.5, 1, 1.5, 2, 2.5]})

    @cached_property
    def fast(self) -> xr.Dataset:
        """Orbits over the initial velocity and the aspect ratio (Fig. 17), up to past the first minimum."""
        xdot0 = {"start": 0.5, "stop": 6.5, "step": 0.25 if self.small else 0.125}
        grid = {"A_r": [5, 6, 7], "xdot0": xdot0, "beta0": self.starts}
        periods = 300 if self.small else 1000
        return search(grid, over="beta0", ask="first", periods=periods, orbit_periods=periods, **self.how)

    @cached_property
    def planar(self) -> xr.Dataset:
        """Drift of the planar dimer over the aspect ratio, with its mean velocity."""
        grid = {"A_r": {"start": 3, "stop": 12, "step": 1 if self.small else 0.25}}
        return self._first(grid, {"xdot0": 0}, paths={"periods": self.late, "per_period": 1})

    @cached_property
    def intensity(self) -> xr.Dataset:
        """Orbits over vibration intensity."""
        return self._first({"Gamma": {"start": 0.85, "stop": 1.15, "step": 0.1 if self.small else 0.025}})

    @cached_property
    def restitution(self) -> xr.Dataset:
        """Orbits over restitution."""
        return self._first({"e": {"start": 0.58, "stop": 0.7, "step": 0.04 if self.small else 0.01}})

    @cached_property
    def small_dimer(self) -> xr.Dataset:
        """The small dimer for an experiment (Sect. 5.2): A_r = 4, r = 2 mm, over friction and frequency."""
        grid: dict[str, Any] = {"f": [15, 20], "mu": [0.3, 0.4, 0.5, 0.6, 0.7, 0.8], "beta0": degrees(1, 88, 1)}
        fixed = {"A_r": 4, "r": 2e-3, "mu_s": 0.8}
        return search(grid, fixed, over="beta0", ask="first", periods=300, orbit_periods=self.late, **self.how)
