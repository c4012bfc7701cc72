"""Compute labelled data from the kernel's record of one run: events in order, states at any time, energies, forces."""

import json
from collections.abc import Mapping
from math import pi
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import OF_A_RUN, Column, column, finished, number_of, same_number, table
from dimersweep.errors import ParameterError
from dimersweep.kernel.compiler.jit import plain
from dimersweep.kernel.contact.forces import A1, A2, F1, F2, L1, L2, N_F
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.body import dimer_of, rise_of_centre, slip_at
from dimersweep.kernel.model.contact_code import CONTACT_STATES, code_of, digits_of
from dimersweep.kernel.model.event_row import E_CAUSE, E_KIND, E_PERIOD, E_PHASE, EVENT
from dimersweep.kernel.model.friction import slip_mu
from dimersweep.kernel.model.layout import (
    C_CHATTER_END,
    CAUSES,
    FREE,
    IMPACT,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    RECORD_FULL,
    ROW,
    SLIP,
    STATUS_MESSAGES,
    Dimer,
    State,
)
from dimersweep.kernel.model.plate import motion, motion_along
from dimersweep.kernel.record import (
    SEGMENT_HOP_TIME,
    SEGMENT_MODES,
    Record,
    new_record,
    no_record,
    rows_of,
    with_one_nan,
)
from dimersweep.kernel.sample import HOPS_LAST, sample
from dimersweep.symbols import EVENT_QUANTITIES, FORCES, START, STATE_QUANTITIES, Quantity

# words of columns that are flags
EVENT_WORDS = dict.fromkeys(("kind", "contact_before", "contact_after", "contact_state"), CONTACT_STATES)
EVENT_WORDS |= {"cause": CAUSES}
HOP_ROWS, HOP_ROWS_GROWTH = 500, 4  # rows for the hops that the end of one chatter sums, and their growth where too few
# share of the time over which the kernel follows these hops (`HOPS_LAST`): clear of the end of that time
FOLLOWED = 0.95
# quantities of a state that give a start; the others follow from these
STARTED = tuple(
    name for name in STATE_QUANTITIES if name not in ("phase", "z1", "z1_rate", "x", "y", "z", "plate", "contact_state")
)
# a time this little below the end of a forcing period counts as that end [periods]: times in s are rounded products
BOUNDARY = 1e-12


class RunRecord(NamedTuple):
    """Record that the kernel wrote of one run (columns in ``kernel.record``), with its parameters and its accuracy.

    `cut` is True if there was no room for all rows. `start` has the state from which the run started, in one row of
    N_START numbers; it has no row if the parameters give the start, and is None if it is unknown.
    """

    row: np.ndarray
    rtol: float
    events: np.ndarray
    segments: np.ndarray
    cut: bool = False
    start: np.ndarray | None = None

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the run by name, from the row."""
        return dict(zip(ROW, self.row.tolist(), strict=True))


def times_of(periods: np.ndarray, phases: np.ndarray, f: float) -> np.ndarray:
    """Return the times [s] of completed forcing periods and plate phases since then [rad]."""
    return (periods + phases / (2 * pi)) / f


def _dataset(columns: dict[str, np.ndarray], quantities: dict[str, Quantity], dim: str) -> xr.Dataset:
    """Return columns of one length with their units and meanings, in the order of `quantities`."""
    for numbers in columns.values():
        if numbers.dtype == float:
            with_one_nan(numbers)
    variables = [Column(name, said, columns[name], EVENT_WORDS.get(name, ())) for name, said in quantities.items()]
    return table((), variables, dim)


def events_of(record: RunRecord) -> xr.Dataset:
    """Return the events of a run in order of time, along `event`; see `Run.events`."""
    columns, parameters = dict(zip(EVENT, record.events.T.copy(), strict=True)), record.parameters
    ended = _move_to_ends_of_hops(record, columns)
    columns["time"] = times_of(columns["period"], columns["phase"], parameters["f"])
    if ended.size:
        _, states, _, _ = _sampled(record, *_places(columns["time"][ended], record), no_record())
        dm, s = dimer_of(record.row), State(*states.T)
        columns["beta"][ended], columns["theta"][ended] = dm.beta_0 + s.dip, s.theta
        for end, rate in ((1, s.n1), (2, s.n2)):
            columns[f"gap_{end}_rate_before"][ended] = columns[f"gap_{end}_rate_after"][ended] = rate
            columns[f"slip_{end}_a"][ended], columns[f"slip_{end}_b"][ended] = slip_at(dm, s, end - 1)
    columns["phase"] = np.mod(columns["phase"] + parameters["phi0"], 2 * pi)
    ends = np.array(digits_of(columns["kind"].astype(int)))
    for own, other in ((0, 1), (1, 0)):
        bystander = (ends[own] == 0) & (ends[other] > IMPACT)
        for axis in ("a", "b"):
            name = f"slip_{own + 1}_{axis}"
            columns[name] = np.where(bystander, np.nan, columns[name])
    return finished(_dataset(columns, EVENT_QUANTITIES, "event"), f"Events {OF_A_RUN}")


def _move_to_ends_of_hops(record: RunRecord, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Move the ends of chatters in `columns` to the accumulation points of their bounces; return the moved rows.

    The kernel writes such a row at the last bounce before the hops that it sums. Here these hops are followed. If
    another event comes before they have died out, the row gets the time of that event. If the run or its record ends
    before, the row is removed.
    """
    periods, phases, segments = columns["period"], columns["phase"], record.segments
    summed = np.flatnonzero(segments[:, SEGMENT_HOP_TIME] > 0).tolist()
    closes = {(segments[k, PERIOD], segments[k, PHASE]): k for k in summed}
    moved = []
    for n in np.flatnonzero(columns["cause"] == C_CHATTER_END):
        k = closes.get((periods[n], phases[n]))
        turn = _end_of_hops(record, k) if k is not None else None
        # without a turn the hops last too short to matter, or longer than they are followed: the row stays
        if turn is not None:
            # four units in the last place of the time: rounding must not put it before the last of the hops
            turn += 4 * np.spacing(2 * pi * (1 + periods[n]))
            last = n + 1 == len(phases)
            period, phase = segments[-1, [PERIOD, PHASE]] if last else (periods[n + 1], phases[n + 1])
            room = 2 * pi * (period - periods[n]) + phase - phases[n]
            if last and turn > room:
                for name in columns:
                    columns[name] = columns[name][:n]
            else:
                phases[n] += min(turn, room)
                moved.append(n)
    return np.array(moved, np.intp)


def _end_of_hops(record: RunRecord, k: int) -> float | None:
    """Return the turn of the plate until the hops that segment `k` sums have died out [rad].

    None if they have not died out within the time over which they are followed.
    """
    segment, omega = record.segments[k], dimer_of(record.row).omega
    span = FOLLOWED * HOPS_LAST * omega * segment[SEGMENT_HOP_TIME]
    status, room = RECORD_FULL, HOP_ROWS
    while status == RECORD_FULL:
        rows, room = new_record(room), HOP_ROWS_GROWTH * room
        status, *_ = _sampled(record, np.array([k]), segment[[PHASE]] + span, rows)
    events, segments = rows_of(rows)
    closed = np.array(digits_of(events[:, E_KIND])).T > 0
    all_down = (closed >= (segment[SEGMENT_MODES : SEGMENT_MODES + 2] != FREE)).all(1)
    ends = events[(events[:, E_CAUSE] == C_CHATTER_END) & all_down]
    if status != OK or not len(ends):
        return None
    period, phase = ends[0, [E_PERIOD, E_PHASE]]
    rest = segments[(segments[:, PERIOD] == period) & (segments[:, PHASE] == phase), SEGMENT_HOP_TIME][-1]
    # `follow_hops` counts the plate's phase so that a period ends after `span`
    return float(2 * pi * (period - 1) + phase + span + omega * rest)


def _places(times: np.ndarray, record: RunRecord) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of the segment in which each time lies, and the plate phase [rad] counted as there.

    A time within the hops that the close of a chatter sums belongs to the segment that starts from the close. Counted
    so, the time of an event gives the phase of the event to the last bit, and no time lies before its segment.

    Raises
    ------
    ParameterError
        If a time is outside the run.
    """
    segments, events, cut, f = record.segments, record.events, record.cut, record.parameters["f"]
    starts = times_of(segments[:, PERIOD], segments[:, PHASE], f)
    end = starts[-1]
    # a run that failed has events beyond its last segment: the last phase has led to an impact without a next phase
    if len(events) and not cut:
        end = max(end, times_of(events[-1, E_PERIOD], events[-1, E_PHASE], f))
    # written so that a NaN is outside, too; 1e-15 allows for the rounding of a time in s
    outside = ~((times >= 0) & (times <= end * (1 + 1e-15) + BOUNDARY / f))
    if outside.any():
        length = "where the record was cut" if cut else "the length of the run"
        raise ParameterError(f"t = {times[outside][0]}: must be in [0, {end:.10g}] s, {length}")
    cycles = times * f
    ends = np.rint(cycles)
    just_below = (cycles < ends) & (ends - cycles <= BOUNDARY + 1e-15 * ends)
    times = np.where(just_below, ends / f, times)
    last = np.searchsorted(starts, times, side="right") - 1
    (closes,) = np.nonzero(segments[:, SEGMENT_HOP_TIME] > 0)
    if closes.size:
        close = closes[np.searchsorted(starts[closes], times, side="right") - 1]
        hops = (starts[close] <= times) & (times < starts[close] + HOPS_LAST * segments[close, SEGMENT_HOP_TIME])
        last = np.where(hops, close, last)
    return last, segments[last, PHASE] + 2 * pi * f * (times - starts[last])


def _states(row: np.ndarray, times: np.ndarray, kernel_states: np.ndarray, modes: np.ndarray) -> xr.Dataset:
    """Return kernel states at `times` in the coordinates of the paper, along `time`."""
    s, dm = State(*kernel_states.T), dimer_of(row)
    phase = s.phase + dm.phi0
    plate, plate_rate, _ = motion(dm, phase)
    beta = dm.beta_0 + s.dip
    sin_b, cos_b, sin_t, cos_t = np.sin(beta), np.cos(beta), np.sin(s.theta), np.cos(s.theta)
    theta_rate = s.wp / cos_b
    h_1 = dm.p1.h
    # velocity of ball 1, along the heading and across it
    v_a, v_b = s.ca - h_1 * sin_b * s.wb, s.cb - h_1 * s.wp
    z1 = dm.p1.r + s.d1 + plate
    columns = {
        "phase": np.mod(phase, 2 * pi),
        "x1": s.x1,
        "y1": s.y1,
        "z1": z1,
        "theta": s.theta,
        "beta": beta,
        "gamma": s.gamma,
        "x1_rate": v_b * cos_t - v_a * sin_t,
        "y1_rate": v_a * cos_t + v_b * sin_t,
        "z1_rate": s.n1 + plate_rate,
        "theta_rate": theta_rate,
        "beta_rate": s.wb,
        "gamma_rate": s.spin - theta_rate * sin_b,
        "gap_1": s.d1,
        "gap_2": s.d2,
        "gap_1_rate": s.n1,
        "gap_2_rate": s.n2,
        "x": s.x1 + h_1 * cos_b * sin_t,
        "y": s.y1 - h_1 * cos_b * cos_t,
        "z": z1 - h_1 * sin_b,
        "plate": plate,
        "contact_state": code_of(modes[:, 0], modes[:, 1]),
    }
    return _dataset(columns, STATE_QUANTITIES, "time").assign_coords(
        time=column("time", times, EVENT_QUANTITIES["time"])
    )


def named_state(row: np.ndarray, start: np.ndarray) -> dict[str, float]:
    """Return a start, a kernel state of shape (1, N_START), as numbers by the names that `simulate` takes."""
    states = _states(row, np.zeros(1), start[:, :N_STATE], start[:, N_STATE:])
    return {name: float(states[name].item()) for name in STARTED}


def _sampled(
    record: RunRecord, which: np.ndarray, phases: np.ndarray, rows: Record
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Return status, kernel states, friction modes and contact forces at plate phases within the segments `which`."""
    states, modes, F = (np.zeros((which.size, n)) for n in (N_STATE, 2, N_F))
    status = sample(record.row, record.segments, which, phases, record.rtol, new_workspace(), rows, states, modes, F)
    return status, states, modes, F


def states_of(record: RunRecord, times: np.ndarray) -> xr.Dataset:
    """Return the states at `times` [s], shape (n,), along `time`; see `Run.states`.

    Raises
    ------
    ParameterError
        If a time is outside the run, or in a phase of contact so long that it takes more steps than allowed.
    """
    status, kernel_states, modes, F = _sampled(record, *_places(times, record), no_record())
    if status != OK:
        time = times[np.isnan(kernel_states[:, PHASE])][0]
        raise ParameterError(f"t = {time:.10g}: there is no state ({STATUS_MESSAGES[status]})")
    kinetic, potential = energies(dimer_of(record.row), kernel_states)
    columns = forces(record.row, kernel_states, modes, F)
    columns |= {"kinetic_energy": kinetic, "potential_energy": potential}
    return _states(record.row, times, kernel_states, modes).assign(_dataset(columns, FORCES, "time").variables)


def energies(dm: Dimer, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return kinetic and potential energy [J] in the room of kernel states, shape (n, N_STATE).

    The potential energy is zero with the centre of mass at the origin of the room, the mean place of the plate.
    """
    s = State(*states.T)
    phase = s.phase + dm.phi0
    height, rise, _ = motion(dm, phase)
    beta, sin_t, cos_t = dm.beta_0 + s.dip, np.sin(s.theta), np.cos(s.theta)
    away_x, away_y, v_x, v_y = motion_along(dm, phase)
    c_n = plain(rise_of_centre)(dm, s.n1, s.n2) + rise
    c_a, c_b = s.ca + v_y * cos_t - v_x * sin_t, s.cb + v_x * cos_t + v_y * sin_t
    turning = dm.J_t * (s.wb**2 + s.wp**2) + dm.J_a * s.spin**2
    kinetic = 0.5 * (dm.m * (c_a**2 + c_b**2 + c_n**2) + turning)
    h = dm.p1.h * np.cos(beta)
    x = s.x1 + h * sin_t + away_x
    y = s.y1 - h * cos_t + away_y
    z = height + dm.p1.r + s.d1 - dm.p1.h * np.sin(beta)
    return kinetic, dm.m * (dm.g * z - dm.fall_x * x - dm.fall_y * y)


def forces(row: np.ndarray, states: np.ndarray, modes: np.ndarray, F: np.ndarray) -> dict[str, np.ndarray]:
    """Return the forces of the plate on both ends [N], by the names of `symbols.FORCES`.

    Two ends on the plate share one axial velocity. If one of them sticks, only the sum of their axial forces is
    determined, and the parts are NaN.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
    states, modes, F : ndarray, shapes (n, N_STATE), (n, 2), (n, N_F)
        Kernel states, the friction modes of their ends, and the forces that go with them.
    """
    dm = dimer_of(row)
    axial = np.array([F[:, A1], F[:, A2]])
    both = (modes != FREE).all(1)
    axial[:, both] = np.nan
    slide = both & (modes == SLIP).all(1)
    for i, p in enumerate((dm.p1, dm.p2)):
        along, across = slip_at(dm, states[slide].T, i)
        speed = np.sqrt(along * along + across * across)
        with np.errstate(invalid="ignore"):  # a slip of speed 0, which just turns back, has no direction: NaN
            axial[i, slide] = -plain(slip_mu)(p, speed) * F[slide, F1 + i * (F2 - F1)] * along / speed
    return {
        "normal_force_1": F[:, F1],
        "normal_force_2": F[:, F2],
        "axial_force": F[:, A1] + F[:, A2],
        "axial_force_1": axial[0],
        "axial_force_2": axial[1],
        "lateral_force_1": F[:, L1],
        "lateral_force_2": F[:, L2],
    }


def made_with(parameters: Mapping[str, float]) -> xr.Variable:
    """Return a number of the parameters of a run without its start, with the parameters as its attribute.

    States of different runs that were put together are known by their numbers.
    """
    text = json.dumps({name: value for name, value in parameters.items() if name not in START})
    about = {"units": "1", "long_name": "number of the run's parameters", "parameters": text}
    return xr.Variable((), np.int32(number_of(text)), about)


def parameters_in(states: xr.Dataset) -> dict[str, float]:
    """Return the parameters of the run of one state, without its start; {} if the state does not have them.

    Raises
    ------
    ParameterError
        If the states come from several runs.
    """
    made = states.variables.get("made_with")
    text = "" if made is None else made.attrs.get("parameters", "")
    if made is not None and (made.size != 1 or not same_number(made.values.item(), number_of(text))):
        raise ParameterError("start: states of several runs were put together; take one from the run that it is of")
    known: dict[str, float] = json.loads(text or "{}")
    return known


def period_rows(segments: np.ndarray) -> np.ndarray:
    """Return the numbers of the rows of `segments` that start forcing periods, and of the end of the last period."""
    rows = np.flatnonzero(segments[:, PHASE] == 0.0)
    return rows[np.unique(segments[rows, PERIOD], return_index=True)[1]]
