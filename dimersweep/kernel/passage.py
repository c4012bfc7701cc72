"""Read the record of some forcing periods: symbols of its events, longest hops, and the last strike of the bouncer.

A passage is the motion from a section to its image. The bouncer is the end that is in the air for longer. The spin of a
motion is the spin after the last impact of the bouncer.
"""

from math import nan
from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.contact_code import CODE_BASE
from dimersweep.kernel.model.event_row import E_AFTER, E_BEFORE, E_CAUSE, E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import (
    C_IMPACT,
    C_START,
    CA,
    CAUSES,
    CB,
    D1,
    D2,
    DI_NONE,
    FREE,
    IMPACT,
    N1,
    N_STATE,
    PERIOD,
    PHASE,
    SPIN,
    THETA,
)
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.sincos import TWO_PI
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import BEFORE, EVENT_ROWS, SEGMENT_MODES, SEGMENT_ROWS, is_kept
from dimersweep.kernel.verdict.past import double_end, zeta_of

# a symbol is the sum of the cause of an event, its contact state times `PER_STATE`, and `SAME_IMPACT` if it is a phase
# of the same impact as the event before
PER_STATE = len(CAUSES)
SAME_IMPACT = PER_STATE * CODE_BASE**2


class Read(NamedTuple):
    """Numbers that are read off a passage, for Python: a row of an array in the kernel."""

    spin: float  # spin after the last strike of the bouncer, or at the end without a strike [rad/s]
    turned: float  # theta after that strike, or at the end [rad]
    theta: float  # theta at the end [rad]
    hop_1: float  # longest time for which each end is off the plate, if the motion repeats after the passage [rad]
    hop_2: float
    phase: float  # phase of that strike since the section [rad]; this and the next two are NaN without a strike
    speed: float  # speed of the centre of mass after the strike [m/s]
    zeta: float  # angle of its velocity from the axis, in the sense towards the bouncer [rad]
    di_end: float  # end state of the strike: a code in ``layout.DI_ENDS``
    strikes: float  # 1.0 if there is a strike
    events: float  # rows of events and segments in the record by now
    segments: float


N_READ = len(Read._fields)
R_SPIN, R_TURNED, R_THETA, R_HOP, _, R_PHASE, R_SPEED, R_ZETA, R_END, R_STRIKES, R_EVENTS, R_SEGMENTS = range(N_READ)


class Reading(NamedTuple):
    """Numbers and symbols that are read off n passages in one record."""

    rows: Any  # shape (n, N_READ)
    symbols: Any  # symbol of each row of events, int64


def new_reading(passages: int, rows: int) -> Reading:
    """Return a reading for so many passages, in a record with so many rows."""
    return Reading(np.zeros((passages, N_READ)), np.zeros(rows, np.int64))


@compiled(inline=True)
def digit(code, i):
    """Return the digit of end i in the code of a contact state, see ``contact_code``."""
    return int(code) // CODE_BASE if i == 0 else int(code) % CODE_BASE


@compiled
def event_time(row):
    """Return the total phase of the plate at an event, with all periods [rad]."""
    return row[E_PERIOD] * TWO_PI + row[E_PHASE]


@compiled
def segment_time(row):
    """Return the total phase of the plate at the start of a smooth phase, with all periods [rad]."""
    return row[PERIOD] * TWO_PI + row[PHASE]


@compiled
def read_passage(dm, state, record, first_event, first_segment, k, struck, reading):
    """Fill in the numbers and symbols of the k-th passage, which ends in `state`.

    Its rows in the record begin at `first_event` and `first_segment`. `struck`, shape (N_STATE,), is scratch. If the
    record has no rows nothing is read.
    """
    if not is_kept(record):
        return
    events = record.events[first_event : record.counts[EVENT_ROWS]]
    segments = record.segments[first_segment : record.counts[SEGMENT_ROWS]]
    row = reading.rows[k]
    row[R_EVENTS], row[R_SEGMENTS] = record.counts[EVENT_ROWS], record.counts[SEGMENT_ROWS]
    note_symbols(events, reading.symbols[first_event : record.counts[EVENT_ROWS]])
    for i in range(2):
        row[R_HOP + i] = longest_hop(events, i, segment_time(segments[-1]))
    row[R_SPIN], row[R_TURNED], row[R_THETA] = state[SPIN], state[THETA], state[THETA]
    row[R_PHASE], row[R_SPEED], row[R_ZETA] = nan, nan, nan
    i = bouncer(segments)
    at = last_strike(events, segments, i)
    row[R_END], row[R_STRIKES] = DI_NONE, at >= 0
    if at >= 0:
        copy(segments[at], struck, N_STATE)
        for j in range(N1, CB + 1):  # velocities as they were before the hops of a chatter were summed
            struck[j] = segments[at, BEFORE + j - N1]
        row[R_SPIN], row[R_TURNED], row[R_PHASE] = struck[SPIN], struck[THETA], struck[PHASE]
        row[R_SPEED], row[R_ZETA] = length(struck[CA], struck[CB]), zeta_of(struck[CA], struck[CB], i)
        if struck[D1] == 0.0 and struck[D2] == 0.0:
            row[R_END] = double_end(dm, struck, i)


@compiled
def note_symbols(events, symbols):
    """Write the symbol of each event."""
    last = -1.0
    for k in range(events.shape[0]):
        row = events[k]
        symbols[k] = int(row[E_CAUSE]) + PER_STATE * int(row[E_KIND])
        if row[E_CAUSE] == C_IMPACT and max(digit(row[E_KIND], 0), digit(row[E_KIND], 1)) > IMPACT:
            now = event_time(row)
            if now == last:
                symbols[k] += SAME_IMPACT
            last = now


@compiled
def longest_hop(events, i, period):
    """Return the longest time for which end i is off the plate in a motion that repeats after a `period` [rad]."""
    longest, first, last, leaves = 0.0, -1.0, 0.0, False
    for k in range(events.shape[0]):
        row = events[k]
        before, after = digit(row[E_BEFORE], i), digit(row[E_AFTER], i)
        if row[E_CAUSE] != C_START and (digit(row[E_KIND], i) > IMPACT or before > FREE or after > FREE):  # it touches
            now = event_time(row)
            if first < 0.0:
                first = now
            elif leaves:
                longest = max(longest, now - last)
            last, leaves = now, after == FREE or after > IMPACT
    return max(longest, first + period - last) if leaves else longest


@compiled
def bouncer(segments):
    """Return the number of the end that is in the air for longer."""
    first, second = 0.0, 0.0
    for k in range(segments.shape[0] - 1):
        span = segment_time(segments[k + 1]) - segment_time(segments[k])
        first += span if segments[k, SEGMENT_MODES] == FREE else 0.0
        second += span if segments[k, SEGMENT_MODES + 1] == FREE else 0.0
    return 1 if second >= first else 0


@compiled
def last_strike(events, segments, i):
    """Return the number of the segment right after the last impact of end i; -1 without such an impact."""
    for k in range(events.shape[0] - 1, -1, -1):
        if digit(events[k, E_KIND], i) > IMPACT:
            now = event_time(events[k])
            for at in range(segments.shape[0]):
                if segment_time(segments[at]) >= now:
                    return at
            return -1
    return -1
