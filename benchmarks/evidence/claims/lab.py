"""The runs, cubes, orbits and borders that the claims are tried on, each made once, when it is first needed."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from dimersweep import Run, orbits, search, simulate, sweep
from dimersweep.analysis.orbits import PeriodicOrbit
from dimersweep.errors import OrbitError
from dimersweep.kernel.model.layout import M_DRIFT, M_NOT_RUN
from dimersweep.runs.outcomes import MissingValue, Orbit
from dimersweep.symbols import BASE

READINGS = {"mu_s": "an end at rest is held by mu_s", "mu": "in lasting contact it is held by mu"}
LOW_FRICTION: dict[str, Any] = {"mu": 0.05, "mu_s": 0.1}  # the paper's small friction
CLAIMS_RTOL = 1e-8
BORDER_SPIN = 100.0  # rad/s, at which borders are drawn; they hardly depend on it
SHARES = (0.02, 0.25, 0.5, 0.75, 0.98)  # of the way from fold to flip
UNDER, ABOVE = (0.5, 0.9, 0.99), (0.01, 0.05, 0.2)  # of Gamma at the top of the dead zone, beyond the flip
SPIN_STEP = 1e-3  # share of the spin by which orbits of a family are compared


def degrees(start: float, stop: float, step: float) -> dict[str, Any]:
    """An axis of angles."""
    return {"start": start, "stop": stop, "step": step, "unit": "deg"}


def drift_orbit(run: Run) -> Orbit:
    """The orbit of a run that is known to drift.

    Raises
    ------
    RuntimeError
        If it does not.
    """
    if isinstance(run.orbit, MissingValue):
        raise RuntimeError(f"{run!r} was expected to drift")
    return run.orbit


class Lab:
    """Runs, cubes, orbits and borders under one reading, kept once they are made.

    Parameters
    ----------
    reading : str
        One of `READINGS`.
    small : bool
        Whether grids are coarse and runs short, for a check in about a minute.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        Whether to show how far a sweep is.
    """

    def __init__(
        self, reading: str = "mu_s", *, small: bool, workers: int | None = None, progress: bool = True
    ) -> None:
        self.reading, self.small = reading, small
        self.how: dict[str, Any] = {"workers": workers, "progress": progress}
        self.starts = degrees(2, 60, 2 if small else 0.5)  # where a first drift is looked for
        self.late = 200 if small else 400  # forcing periods after which a run is read

    def held(self, **given: Any) -> dict[str, Any]:
        """Parameters with the hold of a lasting contact as it is read."""
        return given | ({"mu_h": given.get("mu", BASE["mu"])} if self.reading == "mu" else {})

    def _first(self, grid: dict[str, Any], fixed: Mapping[str, Any] | None = None, **more: Any) -> xr.Dataset:
        """The orbit at each point, from the least initial dip angle that drifts; `more` is how, if otherwise than usual."""
        whole = grid if "beta0" in grid else grid | {"beta0": self.starts}
        how: dict[str, Any] = {"periods": 300, "orbit_periods": self.late} | self.how | more
        return search(whole, self.held(**(fixed or {})), over="beta0", ask="first", **how)

    def _fates(self, e: np.ndarray, Gamma: np.ndarray, periods: int) -> xr.Dataset:
        """What becomes of starts all over the dip angle, at pairs of e and Gamma."""
        starts = np.deg2rad(np.arange(5, 86, 20 if self.small else 8))
        columns = {"e": np.repeat(e, starts.size), "Gamma": np.repeat(Gamma, starts.size)}
        columns["beta0"] = np.tile(starts, e.size)
        return sweep(points=columns, fixed=self.held(), periods=periods, rtol=CLAIMS_RTOL, **self.how)

    # --- runs ---------------------------------------------------------------------------------------------------

    @cached_property
    def base(self) -> Run:
        """The paper's base case, recorded."""
        return simulate(periods=self.late, **self.held())

    @cached_property
    def low(self) -> Run:
        """The paper's base case with small friction, recorded."""
        return simulate(periods=self.late, **self.held(**LOW_FRICTION))

    def run(self, **given: float) -> Run:
        """A recorded run."""
        return simulate(periods=self.late, **self.held(**given))

    # --- cubes of runs ------------------------------------------------------------------------------------------

    @cached_property
    def dips(self) -> xr.Dataset:
        """Modes over initial dip angle and frequency (Fig. 7)."""
        beta0 = degrees(1, 89, 1) if self.small else degrees(0.1, 89.9, 0.1)
        return sweep({"f": [15, 20, 25], "beta0": beta0}, self.held(), periods=300, **self.how)

    @cached_property
    def speeds(self) -> xr.Dataset:
        """Modes over initial dip angle and initial velocity."""
        grid = {"xdot0": [0.5, 1, 1.5, 2, 2.5], "beta0": degrees(1, 89, 2 if self.small else 0.5)}
        return sweep(grid, self.held(), periods=300, **self.how)

    @cached_property
    def below(self) -> xr.Dataset:
        """Modes below R_1: below the fold, and below Gamma = 1, from which on the plate throws off what rests on it."""
        top = np.minimum(self.fold["Gamma"].values, 1.0)
        at = [k for k in range(top.size) if np.isfinite(top[k])]
        e, share = np.repeat(self.fold["e"].values[at], len(UNDER)), np.tile(UNDER, len(at))
        return self._fates(e, np.repeat(top[at], len(UNDER)) * share, 300)

    @cached_property
    def above(self) -> xr.Dataset:
        """Modes above R_1: beyond the flip."""
        flip = self.flip["Gamma"].values
        at = [k for k in range(flip.size) if np.isfinite(flip[k])]
        e, beyond = np.repeat(self.flip["e"].values[at], len(ABOVE)), np.tile(ABOVE, len(at))
        return self._fates(e, np.repeat(flip[at], len(ABOVE)) + beyond, 200)

    @cached_property
    def short(self) -> xr.Dataset:
        """How many initial dip angles drift, for each aspect ratio."""
        grid = {
            "Gamma": [0.9],
            "A_r": {"start": 2, "stop": 8, "step": 0.5 if self.small else 0.2},
            "beta0": degrees(1, 89, 8 if self.small else 4),
        }
        return search(grid, self.held(), over="beta0", ask="fraction", periods=300, **self.how)

    @cached_property
    def fast(self) -> xr.Dataset:
        """Orbits over the initial velocity and the aspect ratio (Fig. 17), up to past the first minimum."""
        speeds = {"start": 0.5, "stop": 6.5, "step": 0.25 if self.small else 0.125}
        periods = 300 if self.small else 1000
        return self._first({"A_r": [5, 6, 7], "xdot0": speeds}, periods=periods, orbit_periods=periods)

    @cached_property
    def reached(self) -> xr.Dataset:
        """The least initial dip angle that drifts, for each frequency."""
        return self._first({"f": [15, 20, 25, 30, 35]})

    @cached_property
    def planar(self) -> xr.Dataset:
        """Drift of the planar dimer over the aspect ratio, with its mean velocity."""
        grid = {"A_r": {"start": 3, "stop": 12, "step": 1 if self.small else 0.5}}
        return self._first(grid, {"xdot0": 0}, paths={"periods": self.late, "per_period": 1})

    @cached_property
    def small_dimer(self) -> xr.Dataset:
        """The small dimer for an experiment (Sect. 5.2): A_r = 4, r = 2 mm, over friction and frequency."""
        grid = {"f": [15, 20], "beta0": degrees(1, 88, 3 if self.small else 1)}
        parts = []
        for mu in (0.4, 0.6, 0.8):  # one search each, as what holds a lasting contact may go with mu
            cube = self._first(grid, {"A_r": 4, "r": 2e-3, "mu": mu, "mu_s": 0.8})
            parts.append(cube[["radius", "mode", "di_end"]])
        return xr.concat([part.drop_vars("mu", errors="ignore") for part in parts], "mu", combine_attrs="override")

    # --- orbits -------------------------------------------------------------------------------------------------

    def _orbit(self, **parameters: float) -> PeriodicOrbit | None:
        """The stable orbit at the spin that a start rolls up to, if there is one."""
        try:
            orbit = orbits.find(**self.held(**parameters))
        except OrbitError:
            return None
        return orbit if orbit.stable else None

    def table(self, axes: Mapping[str, Sequence[float] | np.ndarray]) -> xr.Dataset:
        """Orbits over axes, labelled as a cube is, with the growth of the radius a period, over the radius."""
        shape = tuple(len(values) for values in axes.values())
        numbers = ("radius", "period", "zeta", "speed", "impact_phase", "spin_drift", "growth")
        columns: dict[str, np.ndarray] = {name: np.full(shape, np.nan) for name in numbers}
        columns |= {"di_end": np.full(shape, "none", dtype=object), "mode": np.full(shape, M_NOT_RUN)}
        for index in np.ndindex(shape):
            at = {name: float(values[k]) for (name, values), k in zip(axes.items(), index, strict=True)}
            if at.get("mu_s", 1.0) < at.get("mu", 0.0):
                continue
            orbit = self._orbit(**at)
            if orbit is None:
                continue
            for name in numbers[:-1]:
                columns[name][index] = getattr(orbit, name)
            columns["growth"][index] = growth(orbit)
            columns["di_end"][index], columns["mode"][index] = orbit.di_end, M_DRIFT
        coords = {name: np.asarray(values, dtype=float) for name, values in axes.items()}
        return xr.Dataset({name: (tuple(axes), values) for name, values in columns.items()}, coords)

    @cached_property
    def orbits(self) -> xr.Dataset:
        """Orbits over aspect ratio and frequency (Fig. 14 to 16)."""
        return self.table(
            {"A_r": np.linspace(5, 7, 3 if self.small else 9), "f": np.linspace(15, 35, 3 if self.small else 5)}
        )

    @cached_property
    def slow(self) -> xr.Dataset:
        """Orbits for the initial velocities of Fig. 13."""
        return self.table({"xdot0": [0.5, 1, 1.5, 2, 2.5]})

    @cached_property
    def frictions(self) -> xr.Dataset:
        """Orbits for the two pairs of friction coefficients of the paper."""
        pairs = [self.table({"mu": [mu], "mu_s": [mu_s]}).squeeze() for mu, mu_s in ((0.2, 0.4), (0.05, 0.1))]
        return xr.concat([pair.drop_vars(["mu", "mu_s"]) for pair in pairs], "pair")

    @cached_property
    def friction(self) -> xr.Dataset:
        """Orbits over aspect ratio and both friction coefficients."""
        mu = [0.05, 0.2, 0.3] if self.small else [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5]
        mu_s = [0.1, 0.4] if self.small else [0.1, 0.2, 0.3, 0.4, 0.6, 0.8]
        return self.table({"A_r": [4, 5, 6, 7], "mu": mu, "mu_s": mu_s})

    @cached_property
    def intensity(self) -> xr.Dataset:
        """Orbits over vibration intensity."""
        return self.table({"Gamma": np.linspace(0.85, 1.15, 4 if self.small else 7)})

    @cached_property
    def restitution(self) -> xr.Dataset:
        """Orbits over restitution."""
        return self.table({"e": np.linspace(0.58, 0.7, 4 if self.small else 7)})

    # --- borders ------------------------------------------------------------------------------------------------

    def _border(self, kind: str, **over: Any) -> xr.Dataset:
        return orbits.border(kind, "Gamma", over=over, spin=BORDER_SPIN, **self.held())

    @cached_property
    def fold(self) -> xr.Dataset:
        """Where the drift begins, over restitution."""
        return self._border("fold", e=np.linspace(0.35, 0.8, 7 if self.small else 19))

    @cached_property
    def flip(self) -> xr.Dataset:
        """Where it doubles its period, over restitution."""
        return self._border("flip", e=np.linspace(0.35, 0.8, 7 if self.small else 19))

    @cached_property
    def inside(self) -> list[tuple[float, float, PeriodicOrbit | None]]:
        """Pairs of e and Gamma between fold and flip, with the stable orbit there."""
        between: list[tuple[float, float, PeriodicOrbit | None]] = []
        for e, low, high in zip(
            *(x.values for x in (self.fold["e"], self.fold["Gamma"], self.flip["Gamma"])), strict=True
        ):
            for share in SHARES:
                Gamma = float(low + share * (high - low))
                try:
                    orbit = orbits.find(spin=BORDER_SPIN, **self.held(e=float(e), Gamma=Gamma))
                except OrbitError:
                    between.append((float(e), Gamma, None))
                    continue
                between.append((float(e), Gamma, orbit if orbit.stable else None))
        return between


def growth(orbit: PeriodicOrbit) -> float:
    """Change of the radius per forcing period along the family, over the radius: R'(s) ds/dn / R; NaN if it is not known."""
    try:
        two = [orbits.find(guess=orbit, spin=orbit.spin * (1 + side * SPIN_STEP)) for side in (-1, 1)]
    except OrbitError:
        return float("nan")
    slope = (two[1].radius - two[0].radius) / (two[1].spin - two[0].spin)
    return slope * orbit.spin_drift / orbit.radius
