"""What the kernel recorded of one run as labelled data: the events in their order, and the state at any time."""

from math import pi
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import (
    CA,
    CAUSES,
    CB,
    CONTACT_STATES,
    D1,
    D2,
    DIP,
    FREE,
    GAMMA,
    IMPACT,
    N1,
    N2,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    ROW,
    SLIP,
    SPIN,
    STATUS_MESSAGES,
    STICK,
    THETA,
    WB,
    WP,
    X1,
    Y1,
)
from dimersweep.kernel.model.plate import motion
from dimersweep.kernel.record import EVENT, HOP_TIME, MODES, no_record
from dimersweep.kernel.sample import HOPS_LAST, sample
from dimersweep.symbols import EVENTS, STATES, Quantity

BETWEEN_IMPACTS = [5 * first + second for first in (FREE, STICK, SLIP) for second in (FREE, STICK, SLIP)]
BOUNDARY = 1e-12  # a time this far below the end of a forcing period counts as that end, in periods


class Record(NamedTuple):
    """Rows that the kernel wrote of one run (columns in ``kernel.record``), with the parameters that they belong to.

    `cut` says that there was no room for all of them.
    """

    row: np.ndarray
    events: np.ndarray
    segments: np.ndarray
    cut: bool = False


def _times(periods: np.ndarray, phases: np.ndarray, f: float) -> np.ndarray:
    """Times [s] of completed forcing periods and plate phases since then [rad]."""
    return (periods + phases / (2 * pi)) / f


def _dataset(columns: dict[str, np.ndarray], quantities: dict[str, Quantity], dim: str) -> xr.Dataset:
    """Columns of one length with their units and meanings, in the order of `quantities`."""
    return xr.Dataset({name: (dim, columns[name], quantity.attributes()) for name, quantity in quantities.items()})


def events_of(record: Record, parameters: dict[str, float]) -> xr.Dataset:
    """What happened, along `event`; see `Run.events`."""
    columns = dict(zip(EVENT, record.events.T, strict=True))
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


def _places(times: np.ndarray, segments: np.ndarray, f: float, cut: bool) -> tuple[np.ndarray, np.ndarray]:
    """Number of the segment in whose phase each time lies, and the plate phase [rad] of the time, counted as there.

    A time within the hops that the close of a chatter sums belongs to the segment that starts from it.
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
        length = "where the record was cut" if cut else "the length of the run"
        raise ParameterError(f"t = {times[outside][0]}: must be in [0, {end:.10g}] s, {length}")
    cycles = times * f
    ends = np.rint(cycles)
    just_below = (cycles < ends) & (ends - cycles <= BOUNDARY + 1e-15 * ends)
    times = np.where(just_below, ends / f, times)
    last = np.searchsorted(starts, times, side="right") - 1
    (closes,) = np.nonzero(segments[:, HOP_TIME] > 0)
    if closes.size:
        close = closes[np.searchsorted(starts[closes], times, side="right") - 1]
        hops = (starts[close] <= times) & (times < starts[close] + HOPS_LAST * segments[close, HOP_TIME])
        last = np.where(hops, close, last)
    return last, segments[last, PHASE] + 2 * pi * f * (times - starts[last])


def _states(
    record: Record, times: np.ndarray, kernel_states: np.ndarray, modes: np.ndarray, parameters: dict[str, float]
) -> xr.Dataset:
    """The kernel's closed state in the coordinates of the paper."""
    s = kernel_states.T
    dm = dimer_of(record.row)
    plate, plate_rate, _ = motion(dm, s[PHASE] + parameters["phi0"])
    beta = dm.beta_0 + s[DIP]
    sin_b, cos_b, sin_t, cos_t = np.sin(beta), np.cos(beta), np.sin(s[THETA]), np.cos(s[THETA])
    theta_rate = s[WP] / cos_b
    h_1 = dm.p1.h
    v_a, v_b = s[CA] - h_1 * sin_b * s[WB], s[CB] - h_1 * s[WP]  # of ball 1, along the heading and across it
    z1 = dm.p1.r + s[D1] + plate
    columns = {
        "phase": np.mod(s[PHASE] + parameters["phi0"], 2 * pi),
        "x1": s[X1],
        "y1": s[Y1],
        "z1": z1,
        "theta": s[THETA],
        "beta": beta,
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
        "x": s[X1] + h_1 * cos_b * sin_t,
        "y": s[Y1] - h_1 * cos_b * cos_t,
        "z": z1 - h_1 * sin_b,
        "plate": plate,
        "contact_state": (5 * modes[:, 0] + modes[:, 1]).astype(np.int8),
    }
    states = _dataset(columns, STATES, "time").assign_coords(time=("time", times, EVENTS["time"].attributes()))
    states["contact_state"].attrs |= {
        "flag_values": np.array(BETWEEN_IMPACTS, dtype=np.int8),
        "flag_meanings": " ".join(CONTACT_STATES[code] for code in BETWEEN_IMPACTS),
    }
    return states


def states_of(record: Record, times: np.ndarray, rtol: float, parameters: dict[str, float]) -> xr.Dataset:
    """The state at `times` [s], shape (n,), along `time`; see `Run.states`.

    Raises
    ------
    ParameterError
        If a time is outside the run.
    """
    which, phases = _places(times, record.segments, parameters["f"], record.cut)
    kernel_states, modes = np.zeros((times.size, N_STATE)), np.zeros((times.size, 2))
    status = sample(
        record.row,
        record.segments,
        which,
        phases,
        rtol,
        new_workspace(),
        no_record(),
        kernel_states,
        modes,
    )
    if status != OK:
        raise RuntimeError(STATUS_MESSAGES[status])
    return _states(record, times, kernel_states, modes, parameters)


def period_rows(segments: np.ndarray) -> np.ndarray:
    """Numbers of the rows of `segments` that forcing periods start with, and of the row that ends the last one."""
    rows = np.flatnonzero(segments[:, PHASE] == 0.0)
    return rows[np.unique(segments[rows, PERIOD], return_index=True)[1]]


def states_of_segments(record: Record, periods: np.ndarray) -> xr.Dataset:
    """The states at the ends of forcing periods, which the record holds, shape (n,): numbers of completed periods."""
    segments = record.segments
    rows = period_rows(segments)
    rows = rows[np.isin(segments[rows, PERIOD], periods)]
    parameters = dict(zip(ROW, record.row.tolist(), strict=True))
    times = segments[rows, PERIOD] / parameters["f"]
    return _states(record, times, segments[rows, :N_STATE], segments[rows, MODES : MODES + 2], parameters)
