"""One simulation: parameters in, its outcome out, with its events and its state at any time where it was recorded."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.kernel.batch import Workspace, run_recorded
from dimersweep.kernel.impact.impact import N_LOG
from dimersweep.kernel.model.layout import (
    CODES,
    DI_ENDS,
    MODES,
    N_CODES,
    N_OUT,
    OUT,
    STATUS_MESSAGES,
    STATUSES,
)
from dimersweep.kernel.record import N_EVENT, N_SEGMENT
from dimersweep.parameters import Parameters, check_count, check_rtol, check_seconds
from dimersweep.runs.error_bounds import (
    NUDGE,
    bounds,
    nudged,
    shadow_rtol,
)
from dimersweep.runs.proving import is_proven, prove
from dimersweep.runs.recorded import Record, events_of, states_of
from dimersweep.runs.stopping import StopFlag, stoppable
from dimersweep.symbols import BASE

LOG_ROWS = 64  # phases of one impact that are kept
FIRST_ROWS, ROWS_PER_PERIOD, GROWTH = 500, 100, 4  # capacity of a record: about twice what a drift takes


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """The orbit of a drift: values of its last full period, and the change of each per period, fitted over the last 20.

    Attributes
    ----------
    radius : float
        Radius of the circle, speed over precession rate [m].
    period : float
        Time once round [s].
    zeta : float
        Angle from the axis (from the ball that is down to the one that bounces) to the velocity [rad].
    speed : float
        Speed of the centre of mass at the end of the double impact [m s-1].
    precession_rate : float
        Mean rate of theta, signed [rad s-1].
    impact_phase : float
        Phase of the double impact in cycles of the plate, in [0, 1) [1].
    di_end : str
        Friction of p1 and p2 when the double impact ends: sp_sp, sp_sk, sk_sp or sk_sk.
    spin_rate, beta_rate_after : float
        Axial spin, and rate of the dip angle, after the double impact [rad s-1].
    radius_drift, period_drift, zeta_drift, speed_drift, precession_rate_drift, impact_phase_drift : float
        Change per forcing period, in the unit of the quantity.
    """

    radius: float
    period: float
    zeta: float
    speed: float
    precession_rate: float
    impact_phase: float
    di_end: str
    spin_rate: float
    beta_rate_after: float
    radius_drift: float
    period_drift: float
    zeta_drift: float
    speed_drift: float
    precession_rate_drift: float
    impact_phase_drift: float


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Run:
    """One simulation.

    Attributes
    ----------
    status, message : str
        "ok", or the name of the reason why the run stopped early; the same in words.
    mode : str
        What the motion became: rest, drift, jump, flutter, period_n, aperiodic, unresolved or, without "ok", failed.
    mode_period : int
        Forcing periods after which it repeats, 0 if it does not.
    parameters : dict
        Every parameter of the model; those that may be left out (`symbols.LEFT_OUT`) where they were not.
    rtol : float
        Accuracy [1].
    n_events, n_periods : int
        Events and completed forcing periods.
    orbit : Orbit or None
        None unless the mode is drift.
    down_share_1, down_share_2 : float
        Share of the last (at most 12) periods that each end is down [1]: closed, or in hops shorter than half a period. A
        longer flight, or one that goes on at the end, counts from the start of those periods on.
    settled_after : float
        Forcing periods until the motion had settled; NaN if it has not.
    """

    status: str
    message: str
    mode: str
    mode_period: int
    parameters: dict[str, float]
    rtol: float
    n_events: int
    n_periods: int
    orbit: Orbit | None
    down_share_1: float
    down_share_2: float
    settled_after: float
    _record: Record | None = field(default=None)

    def __repr__(self) -> str:
        orbit = f", radius {self.orbit.radius:.4g} m, zeta {self.orbit.zeta:.4g} rad" if self.orbit else ""
        kept = "" if self._record else ", not recorded"
        return f"<Run: {self.status}, {self.mode}{orbit}, {self.n_periods} periods, {self.n_events} events{kept}>"

    def record(self, wanted: str) -> Record:
        """The kernel's rows of this run, for what is `wanted` of them.

        Raises
        ------
        ParameterError
            If nothing was recorded.
        """
        if self._record is None:
            raise ParameterError(f"{wanted}: nothing was recorded; run simulate with record=True")
        return self._record

    @cached_property
    def events(self) -> xr.Dataset:
        """What happened, along `event`, in order of time.

        An impact has one row for each of its contact states, all at the same time, with its own share of the impulses.
        The velocity of a contact point that takes no part in an impact is NaN.

        Raises
        ------
        ParameterError
            If nothing was recorded.
        """
        record = self.record("events")
        return events_of(record, self.parameters)

    def states(self, t: Any) -> xr.Dataset:
        """The state at any times: moved in closed form, or integrated to `rtol`, from the event before each of them.

        At the time of an event it is the state right after it, and so at t = 0, where the plate hits p1.

        Parameters
        ----------
        t : float or array_like, shape (n,)
            Times since the start [s], in any order.

        Returns
        -------
        xarray.Dataset
            Along `time`.

        Raises
        ------
        ParameterError
            If nothing was recorded, or a time is outside the run.
        """
        record = self.record("states")
        if not len(record.segments):
            raise ParameterError(f"states: there are none, the run failed at its first impact ({self.message})")
        times = np.atleast_1d(np.asarray(t, dtype=float))
        if times.ndim != 1:
            raise ParameterError(f"t: has shape {times.shape}; must be one time or a list of times")
        return states_of(record, times, self.rtol, self.parameters)

    def error(self, t: Any = None) -> xr.Dataset:
        """Bounds on the errors of this run, estimated with two more runs that shadow it (docs/trust.md).

        Parameters
        ----------
        t : float or array_like, shape (n,), optional
            Times since the start [s]; the ends of all forcing periods are added.

        Returns
        -------
        xarray.Dataset
            Along `time`, for each quantity of `states`, a bound on its error up to then, in its unit, and `scaled`, the
            largest of those of the closed state in units of 1 cm, 0.1 m/s, 1 rad and 1 rad/s (spin: 10 and 100 of them).
            Along `event`, the bound on the error of its time [s]; NaN for an event that a shadow lacks.

        Raises
        ------
        ParameterError
            If nothing was recorded, the run did not reach its end, or a time is outside the run.
        """
        self.record("error")
        if self.status != "ok":
            raise ParameterError(f"error: the run did not reach its end ({self.message})")
        T = 1 / self.parameters["f"]
        times = np.union1d(np.arange(self.n_periods + 1) * T, [] if t is None else t)
        rtol = shadow_rtol(self.rtol)
        starts: tuple[dict[str, Any], ...] = (self.parameters, nudged(self.parameters, NUDGE * self.rtol))
        shadows = [simulate(**start, periods=self.n_periods, rtol=rtol) for start in starts]
        return bounds(self, shadows, times, T)


def _solve(
    row: np.ndarray, periods: int, rtol: float, settle: bool, record: bool, space: Workspace
) -> tuple[np.ndarray, np.ndarray, Record | None]:
    """One run of the kernel; a record that turns out too small is taken again with more rows (a run is deterministic).

    Returns
    -------
    out : ndarray, shape (N_OUT,), float64
    codes : ndarray, shape (N_CODES,), int64
    record : Record or None
    """
    out, codes, counts = np.full((1, N_OUT), np.nan), np.zeros((1, N_CODES), dtype=np.int64), np.zeros(3, np.int64)
    rows = FIRST_ROWS + ROWS_PER_PERIOD * periods if record else 0
    log = np.zeros((LOG_ROWS if record else 0, N_LOG))
    while True:
        events, segments = np.zeros((rows, N_EVENT if record else N_LOG)), np.zeros((rows, N_SEGMENT))
        run_recorded(row[None], periods, rtol, settle, record, out, codes, log, events, segments, counts, space)
        if not record:
            return out[0], codes[0], None
        if max(counts[1], counts[2]) <= rows:
            kept = Record(row, events[: counts[1]].copy(), segments[: counts[2]].copy())
            return out[0], codes[0], kept
        rows *= GROWTH


def _orbit(out: dict[str, float], di_end: int) -> Orbit:
    names = {entry.name for entry in fields(Orbit)} - {"di_end"}
    return Orbit(di_end=DI_ENDS[di_end], **{name: out[name] for name in names})


def simulate(
    *,
    e: float = BASE["e"],
    Gamma: float = BASE["Gamma"],
    f: float = BASE["f"],
    A_r: float = BASE["A_r"],
    mu: float = BASE["mu"],
    mu_s: float = BASE["mu_s"],
    beta0: float = BASE["beta0"],
    xdot0: float = BASE["xdot0"],
    phi0: float = BASE["phi0"],
    r: float = BASE["r"],
    rho_b: float = BASE["rho_b"],
    rho_r: float = BASE["rho_r"],
    D_r: float = BASE["D_r"],
    g: float = BASE["g"],
    e_1: float | None = None,
    e_2: float | None = None,
    Gamma_2: float = 0.0,
    phi_2: float = 0.0,
    mu_h: float | None = None,
    periods: int = 100,
    rtol: float = 1e-8,
    stop_when_settled: bool = False,
    record: bool = True,
    max_seconds: float | None = None,
) -> Run:
    """Run one dimer on its vibrating plate; the defaults are the paper's base case (Sect. 3).

    Parameters
    ----------
    e, e_1, e_2 : float
        Energetic coefficients of restitution [1], in [0, 1]; `e_1`, `e_2` of one end, None for `e`.
    Gamma, f, phi0 : float
        Vibration intensity A_z omega^2/g [1], frequency [Hz] and phase at the start [rad] of the plate.
    Gamma_2, phi_2 : float
        Intensity A_2 (2 omega)^2/g [1] of the plate's second harmonic A_2 sin(2 omega t + phi_2), and its phase [rad].
    A_r, r, D_r : float
        Aspect ratio (l + 2r)/(2r) [1], at least 2; ball radius and rod diameter [m].
    mu, mu_s, mu_h : float
        Slip and stick friction coefficients [1]. `mu_h` holds an end in lasting contact, None for `mu_s`; `mu_s` then holds
        it inside impacts only.
    beta0, xdot0 : float
        Initial dip angle [rad], in [0, pi/2), and lateral velocity of ball 1 [m s-1].
    rho_b, rho_r : float
        Densities of balls and rod [kg m-3]; the rod may be without mass.
    g : float
        Gravity [m s-2].
    periods : int
        Forcing periods to run.
    rtol : float
        Accuracy of everything at once [1], 1e-13 to 1e-2.
    stop_when_settled : bool
        Whether the run ends as soon as its motion is known.
    record : bool
        Whether events and states are kept; without them a run takes no memory and less time.
    max_seconds : float, optional
        Bound on the time that the run takes [s]. One that is stopped so has the status "stopped", the `n_periods` that it
        came to, and the events and states up to there.

    Returns
    -------
    Run

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed.
    KernelError
        If the compiled kernel cannot run here.
    """
    parameters = Parameters(
        e=e, Gamma=Gamma, f=f, A_r=A_r, mu=mu, mu_s=mu_s, beta0=beta0, xdot0=xdot0, phi0=phi0,
        r=r, rho_b=rho_b, rho_r=rho_r, D_r=D_r, g=g, e_1=e_1, e_2=e_2, Gamma_2=Gamma_2, phi_2=phi_2, mu_h=mu_h,
    )  # fmt: skip
    how = check_count("periods", periods), check_rtol(rtol), bool(stop_when_settled), bool(record)
    seconds = check_seconds("max_seconds", max_seconds)
    if not is_proven():
        stoppable(lambda stop: prove())  # to compile is no part of the run's time

    def call(stop: StopFlag) -> Run:
        with stop.space() as space:
            return follow(parameters, *how, space)

    return stoppable(call, seconds)


def follow(parameters: Parameters, periods: int, rtol: float, settle: bool, record: bool, space: Workspace) -> Run:
    """The run that `simulate` gives for what it has judged, on scratch arrays that may be stopped."""
    out, codes, kept = _solve(parameters.row(), periods, rtol, settle, record, space)
    return _as_run(parameters.given(), rtol, dict(zip(OUT, out.tolist(), strict=True)), codes, kept)


def _as_run(
    parameters: dict[str, float], rtol: float, out: dict[str, float], codes: np.ndarray, record: Record | None
) -> Run:
    code = dict(zip(CODES, codes.tolist(), strict=True))
    return Run(
        status=STATUSES[code["status"]],
        message=STATUS_MESSAGES[code["status"]],
        mode=MODES[code["mode"]],
        mode_period=code["mode_period"],
        parameters=parameters,
        rtol=rtol,
        n_events=code["n_events"],
        n_periods=code["n_periods"],
        orbit=_orbit(out, code["di_end"]) if MODES[code["mode"]] == "drift" else None,
        down_share_1=out["down_share_1"],
        down_share_2=out["down_share_2"],
        settled_after=out["settled_after"],
        _record=record,
    )
