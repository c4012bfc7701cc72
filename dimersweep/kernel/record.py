"""The record of a run: a row for each event, and a row with the state from which each smooth phase starts."""

from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import Y
from dimersweep.kernel.energy import Book, new_book
from dimersweep.kernel.model.body import contact_velocity
from dimersweep.kernel.model.event_row import E_KIND, N_EVENT, write_moment, write_phase
from dimersweep.kernel.model.layout import C_CHATTER_END, C_IMPACT, C_SLIP, C_STICK, CB, N1, N_STATE
from dimersweep.kernel.numerics.steps import copy

# columns of a segment: the state; the friction modes of the phase that starts from it; the time of the hops that a
# close of a chatter has summed there [s] (else 0); the numbers that the close changes (N1 to CB) as they were before;
# and the slip of the leading end, to its last digit
SEGMENT_MODES, SEGMENT_HOP_TIME, BEFORE = N_STATE, N_STATE + 2, N_STATE + 3
SEGMENT_SLIP = BEFORE + CB + 1 - N1
N_SEGMENT = SEGMENT_SLIP + 2
# counts: events, and the rows that the record has or would need
EVENT_COUNT, EVENT_ROWS, SEGMENT_ROWS = range(3)
N_COUNTS = 3
PHASES = 64  # phases of one impact that are kept


class Record(NamedTuple):
    """Rows for the record of a run, none if no record is wanted, and the counts."""

    log: Any  # phases of one impact, shape (n, N_EVENT)
    events: Any  # shape (n, N_EVENT)
    segments: Any  # shape (n, N_SEGMENT)
    counts: Any  # shape (N_COUNTS,), int64
    book: Book  # the works of the forces beside it


def new_record(rows: int, phases: int = PHASES, *, works: bool = False) -> Record:
    """Return an empty record with room for so many events, as many smooth phases, and so many phases of one impact."""
    log, counts, book = np.zeros((phases, N_EVENT)), np.zeros(N_COUNTS, np.int64), new_book(rows if works else 0)
    return Record(log, np.zeros((rows, N_EVENT)), np.zeros((rows, N_SEGMENT)), counts, book)


def no_record() -> Record:
    """Return a record that keeps nothing but the counts."""
    return new_record(0, 0)


def rows_of(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return the events and segments that were written."""
    events, segments = record.events[: record.counts[EVENT_ROWS]], record.segments[: record.counts[SEGMENT_ROWS]]
    return with_one_nan(events), with_one_nan(segments)


def with_one_nan(numbers: np.ndarray) -> np.ndarray:
    """Replace every nan by the nan of Python, in place, and return the array: the sign bit of 0/0 depends on the processor."""
    numbers[np.isnan(numbers)] = np.nan
    return numbers


def was_full(record: Record) -> bool:
    """Return True if a run that was made needed more rows than there were."""
    return bool(max(record.counts[EVENT_ROWS], record.counts[SEGMENT_ROWS]) > len(record.events))


@compiled
def without_rows(record):
    """Return a record that keeps nothing, with the same counts array."""
    book = record.book
    none = Book(book.smooth[:0], book.flows[:0], book.ends[:0], book.struck[:0], book.leads[:0])
    return Record(record.log[:0], record.events[:0], record.segments[:0], record.counts, none)


@compiled
def clear_counts(counts):
    """Set the counts of events and rows to zero."""
    counts[EVENT_COUNT], counts[EVENT_ROWS], counts[SEGMENT_ROWS] = 0, 0, 0


@compiled(inline=True)
def is_kept(record):
    """Return True if a record is wanted."""
    return record.segments.shape[0] > 0


@compiled(inline=True)
def is_full(record):
    """Return True if the record would have needed more rows."""
    counts = record.counts
    return counts[EVENT_ROWS] > record.events.shape[0] or counts[SEGMENT_ROWS] > record.segments.shape[0]


@compiled(inline=True)
def next_row(rows, counts, kind):
    """Count a row of a kind; return its number, below zero where there is no room for it."""
    counts[kind] += 1
    return counts[kind] - 1 if counts[kind] <= rows.shape[0] else -1


@compiled(inline=True)
def note_event(dm, record, state, cause, before, after):
    """Write the row of an event between impacts, from one contact state of Table 1 to another."""
    k = next_row(record.events, record.counts, EVENT_ROWS) if is_kept(record) else -1
    if k < 0:
        return
    row = record.events[k]
    n_1, a_1, b_1 = contact_velocity(dm, state, 0)
    n_2, a_2, b_2 = contact_velocity(dm, state, 1)
    write_moment(dm, row, state, cause, before, after)
    write_phase(row, after, (n_1, n_2, n_1, n_2), (0.0, 0.0), (a_1, b_1, a_2, b_2))


@compiled
def note_impact_phases(dm, record, state, rows, before):
    """Write the event rows of an impact: one for each phase in its log."""
    if not is_kept(record):
        return
    for i in range(rows):
        phase = record.log[i]
        kind, after = phase[E_KIND], record.log[i + 1, E_KIND] if i + 1 < rows else 0.0
        k = next_row(record.events, record.counts, EVENT_ROWS)
        if k >= 0:
            copy(phase, record.events[k], N_EVENT)
            write_moment(dm, record.events[k], state, C_IMPACT, before, after)
        before = kind


@compiled(inline=True)
def note_segment(record, motion, hop_time):
    """Write the start of a smooth phase, and the state before hops were summed that take the time `hop_time` [s]."""
    n = next_row(record.segments, record.counts, SEGMENT_ROWS) if is_kept(record) else -1
    if n >= 0:
        row = record.segments[n]
        copy(motion.state, row, N_STATE)
        row[SEGMENT_MODES], row[SEGMENT_MODES + 1], row[SEGMENT_HOP_TIME] = motion.modes[0], motion.modes[1], hop_time
        for k in range(N1, CB + 1):
            row[BEFORE + k - N1] = motion.before[k]
        row[SEGMENT_SLIP], row[SEGMENT_SLIP + 1] = motion.contact[Y.u_a], motion.contact[Y.u_b]


@compiled(inline=True)
def note_contact(dm, record, motion, after):
    """Write the smooth phase that starts now, in the contact state `after`, and the event that has led to it.

    No event is written where the rows of an impact have it already. A slip that ends, but that nothing holds there,
    goes on in another direction.
    """
    state, cause, before = motion.state, motion.course[0].cause, motion.course[0].contact_before
    if cause == C_STICK and before == after:
        cause = C_SLIP
    if cause != C_IMPACT or after != 0:
        note_event(dm, record, state, cause, before, after)
    hop_time = motion.course[0].hop_time if cause == C_CHATTER_END else 0.0
    note_segment(record, motion, hop_time)
