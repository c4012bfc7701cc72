"""One simulation as labelled data: its outcome, its events, and its state at any time."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from math import pi
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.kernel.batch import run_recorded
from dimersweep.kernel.engine import WORK_COLUMNS, WORK_ROWS
from dimersweep.kernel.impact import N_LOG
from dimersweep.kernel.layout import (
    BETA,
    CA,
    CAUSES,
    CB,
    CODES,
    CONTACT_STATES,
    D1,
    D2,
    DI_ENDS,
    GAMMA,
    IMPACT,
    MODES,
    N1,
    N2,
    N_CODES,
    N_OUT,
    N_STATE,
    OK,
    OUT,
    PERIOD,
    PHASE,
    SPIN,
    STATUS_MESSAGES,
    STATUSES,
    THETA,
    WB,
    WP,
    X1,
    Y1,
)
from dimersweep.kernel.record import EVENT, N_EVENT, N_SEGMENT
from dimersweep.kernel.sample import sample
from dimersweep.parameters import Parameters, check_count, check_rtol
from dimersweep.symbols import BASE, EVENTS, STATES, Quantity

LOG_ROWS = 64  # phases of one impact that are kept
FIRST_ROWS, ROWS_PER_PERIOD, GROWTH = 500, 100, 4  # capacity of a record: about twice what a drift takes
BOUNDARY = 1e-12  # a time this far below the end of a forcing period counts as that end, in periods


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


class Record(NamedTuple):
    """Rows that the kernel wrote of one run (columns in ``kernel.record``), with the parameters that they belong to."""

    row: np.ndarray
    events: np.ndarray
    segments: np.ndarray


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
        Every parameter of the model; `e_1` and `e_2` where they were given.
    rtol : float
        Accuracy [1].
    n_events, n_periods : int
        Events and completed forcing periods.
    orbit : Orbit or None
        None unless the mode is drift.
    down_share_1, down_share_2 : float
        Share of the last (at most 12) periods that each end is closed or in hops shorter than half a period [1].
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

    def _recorded(self, wanted: str) -> Record:
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
        record = self._recorded("events")
        return _events(record.events, self.parameters)

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
        record = self._recorded("states")
        if not len(record.segments):
            raise ParameterError(f"states: there are none, the run failed at its first impact ({self.message})")
        times = np.atleast_1d(np.asarray(t, dtype=float))
        if times.ndim != 1:
            raise ParameterError(f"t: has shape {times.shape}; must be one time or a list of times")
        periods, phases = _places(times, record.segments, self.parameters["f"])
        kernel_states, modes = np.zeros((times.size, N_STATE)), np.zeros((times.size, 2))
        work = np.zeros((WORK_ROWS, WORK_COLUMNS))
        status = sample(record.row, record.segments, periods, phases, self.rtol, work, kernel_states, modes)
        if status != OK:
            raise RuntimeError(STATUS_MESSAGES[status])
        return _states(times, kernel_states, modes, self.parameters)


def _times(periods: np.ndarray, phases: np.ndarray, f: float) -> np.ndarray:
    """Times [s] of completed forcing periods and plate phases since then [rad]."""
    return (periods + phases / (2 * pi)) / f


def _dataset(columns: dict[str, np.ndarray], quantities: dict[str, Quantity], dim: str) -> xr.Dataset:
    """Columns of one length with their units and meanings, in the order of `quantities`."""
    return xr.Dataset({name: (dim, columns[name], quantity._asdict()) for name, quantity in quantities.items()})


def _events(rows: np.ndarray, parameters: dict[str, float]) -> xr.Dataset:
    columns = dict(zip(EVENT, rows.T, strict=True))
    columns["time"] = _times(columns["period"], columns["phase"], parameters["f"])
    columns["phase"] = np.mod(columns["phase"] + parameters["phi0"], 2 * pi)
    ends = np.array(divmod(columns["kind"].astype(int), 5))
    columns["cause"] = np.array(CAUSES)[columns["cause"].astype(int)]
    for name in ("kind", "contact_before", "contact_after"):
        columns[name] = np.array(CONTACT_STATES)[columns[name].astype(int)]
    for own, other in ((0, 1), (1, 0)):
        bystander = (ends[own] == 0) & (ends[other] > IMPACT)
        for way in ("a", "b"):
            name = f"slip_{own + 1}_{way}"
            columns[name] = np.where(bystander, np.nan, columns[name])
    return _dataset(columns, EVENTS, "event")


def _places(times: np.ndarray, segments: np.ndarray, f: float) -> tuple[np.ndarray, np.ndarray]:
    """Completed forcing periods and plate phase since then [rad] of each time, counted from the event before it.

    Counted from there, the time of an event gives that event's phase to the last bit, and no time falls before it.

    Raises
    ------
    ParameterError
        If a time is outside the run.
    """
    starts = _times(segments[:, PERIOD], segments[:, PHASE], f)
    end = starts[-1]
    outside = ~((times >= 0) & (times <= end * (1 + 1e-15) + BOUNDARY / f))  # in this form true for a NaN as well
    if outside.any():
        raise ParameterError(f"t = {times[outside][0]}: must be in [0, {end:.10g}] s, the length of the run")
    cycles = times * f
    ends = np.rint(cycles)
    just_below = (cycles < ends) & (ends - cycles <= BOUNDARY + 1e-15 * ends)
    times = np.where(just_below, ends / f, times)
    last = np.searchsorted(starts, times, side="right") - 1
    return segments[last, PERIOD], segments[last, PHASE] + 2 * pi * f * (times - starts[last])


def _states(
    times: np.ndarray, kernel_states: np.ndarray, modes: np.ndarray, parameters: dict[str, float]
) -> xr.Dataset:
    """The kernel's closed state in the coordinates of the paper."""
    s = kernel_states.T
    h = parameters["r"] * (parameters["A_r"] - 1)  # half the distance of the ball centres
    omega = 2 * pi * parameters["f"]
    A_z = parameters["Gamma"] * parameters["g"] / omega**2
    phase = s[PHASE] + parameters["phi0"]
    plate, plate_rate = A_z * np.sin(phase), A_z * omega * np.cos(phase)
    sin_b, cos_b, sin_t, cos_t = np.sin(s[BETA]), np.cos(s[BETA]), np.sin(s[THETA]), np.cos(s[THETA])
    theta_rate = s[WP] / cos_b
    v_a, v_b = s[CA] + h * sin_b * s[WB], s[CB] + h * s[WP]  # of ball 1, along the heading and across it
    z1 = parameters["r"] + s[D1] + plate
    columns = {
        "x1": s[X1],
        "y1": s[Y1],
        "z1": z1,
        "theta": s[THETA],
        "beta": s[BETA],
        "spin": s[GAMMA],
        "x1_rate": v_b * cos_t - v_a * sin_t,
        "y1_rate": v_a * cos_t + v_b * sin_t,
        "z1_rate": s[N1] + plate_rate,
        "theta_rate": theta_rate,
        "beta_rate": s[WB],
        "spin_rate": s[SPIN] - theta_rate * sin_b,
        "gap_1": s[D1],
        "gap_2": s[D2],
        "gap_1_rate": s[N1],
        "gap_2_rate": s[N2],
        "x": s[X1] - h * cos_b * sin_t,
        "y": s[Y1] + h * cos_b * cos_t,
        "z": z1 + h * sin_b,
        "plate": plate,
        "contact_state": (5 * modes[:, 0] + modes[:, 1]).astype(np.int8),
    }
    states = _dataset(columns, STATES, "time").assign_coords(time=("time", times, EVENTS["time"]._asdict()))
    states["contact_state"].attrs |= {
        "flag_values": np.arange(len(CONTACT_STATES), dtype=np.int8),
        "flag_meanings": " ".join(CONTACT_STATES),
    }
    return states


def _solve(
    row: np.ndarray, periods: int, rtol: float, settle: bool, record: bool
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
        run_recorded(row[None], periods, rtol, settle, record, out, codes, log, events, segments, counts)
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
    periods: int = 100,
    rtol: float = 1e-8,
    stop_when_settled: bool = False,
    record: bool = True,
) -> Run:
    """Run one dimer on its vibrating plate; the defaults are the paper's base case (Sect. 3).

    Parameters
    ----------
    e, e_1, e_2 : float
        Energetic coefficients of restitution [1], in [0, 1]; `e_1`, `e_2` of one end, None for `e`.
    Gamma, f, phi0 : float
        Vibration intensity A_z omega^2/g [1], frequency [Hz] and phase at the start [rad] of the plate.
    A_r, r, D_r : float
        Aspect ratio (l + 2r)/(2r) [1], at least 2; ball radius and rod diameter [m].
    mu, mu_s : float
        Slip and stick friction coefficients [1].
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

    Returns
    -------
    Run

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed.
    """
    parameters = Parameters(
        e=e, Gamma=Gamma, f=f, A_r=A_r, mu=mu, mu_s=mu_s, beta0=beta0, xdot0=xdot0, phi0=phi0,
        r=r, rho_b=rho_b, rho_r=rho_r, D_r=D_r, g=g, e_1=e_1, e_2=e_2,
    )  # fmt: skip
    periods, rtol = check_count("periods", periods), check_rtol(rtol)
    out, codes, kept = _solve(parameters.row(), periods, rtol, bool(stop_when_settled), bool(record))
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
