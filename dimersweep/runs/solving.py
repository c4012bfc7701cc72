"""One run of the kernel: its outcome, its record, and the end from which it can go on."""

from typing import NamedTuple

import numpy as np

from dimersweep.errors import ParameterError
from dimersweep.kernel.batch import N_START, Workspace, ask_for, run_recorded
from dimersweep.kernel.energy import Book
from dimersweep.kernel.model.event_row import EVENT
from dimersweep.kernel.model.layout import (
    C_END,
    C_START,
    CODE_MODE,
    CODE_N_EVENTS,
    CODE_N_PERIODS,
    M_UNRESOLVED,
    N_CODES,
    N_OUT,
    N_STATE,
    PERIOD,
)
from dimersweep.kernel.record import Record, new_record, no_record, rows_of, was_full
from dimersweep.runs.recorded import RunRecord
from dimersweep.runs.settings import RunSettings

RECORD_ROWS, ROWS_PER_PERIOD, RECORD_GROWTH = 500, 100, 4  # capacity of a record: about twice what a drift takes
MAX_ROWS = 2_000_000  # of events and of segments each, 0.7 GB in all
MAX_RECORDED = 100_000  # forcing periods: those of a drift fit
IN_PYTHON = "a run whose events and states are recorded; give record=False for one without them"
CAUSE_COLUMN = EVENT.index("cause")


def check_recorded(periods: int, which: str = IN_PYTHON) -> None:
    """Refuse to record more forcing periods than memory and patience hold.

    Raises
    ------
    ParameterError
    """
    if periods > MAX_RECORDED:
        raise ParameterError(f"periods = {periods}: must be <= {MAX_RECORDED} for {which}")


class RunEnd(NamedTuple):
    """Where a run has ended: what the kernel needs to go on.

    Attributes
    ----------
    start : ndarray, shape (1, N_START)
        State and friction modes.
    past : ndarray, shape (PAST_ROWS, PAST_COLUMNS)
        What the verdict keeps of the run.
    """

    start: np.ndarray
    past: np.ndarray


class Solved(NamedTuple):
    """What the kernel gives of one run.

    Attributes
    ----------
    out, codes : ndarray, shapes (N_OUT,), (N_CODES,)
    record : RunRecord or None
    end : RunEnd
    cost : int
        Forcing periods that were run.
    """

    out: np.ndarray
    codes: np.ndarray
    record: RunRecord | None
    end: RunEnd
    cost: int


def run_row(
    row: np.ndarray,
    start: np.ndarray | None,
    how: RunSettings,
    space: Workspace,
    *,
    record: bool = False,
    past: np.ndarray | None = None,
) -> Solved:
    """One point, made anew for twice as many periods until it has settled, as `how` says; the last of these runs.

    A record that turns out too small is taken again with more rows (a run is deterministic). One of more than `MAX_ROWS` is
    cut: the whole run is then made without it.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
    start : ndarray, shape (1, N_START), optional
        In place of the start in `row`.
    how : RunSettings
        Its periods count those before `start`.
    space : Workspace
        Scratch arrays, which may be stopped.
    record : bool
    past : ndarray, optional
        Of the run that goes on.

    Raises
    ------
    ParameterError
        If a record from the start would be too long.
    """
    out, codes, cost = np.full((1, N_OUT), np.nan), np.zeros((1, N_CODES), np.int64), 0

    def run(periods: int, kept: Record) -> Record:
        if past is not None:
            space.past[:] = past
        run_recorded(row, ask_for(periods, how.rtol, how.stop_when_settled, record), out, codes, kept, space, start)
        return kept

    for periods in how.lengths():
        kept, full = None, False
        if record:
            if past is None:
                check_recorded(periods)
            rows = min(RECORD_ROWS + ROWS_PER_PERIOD * periods, MAX_ROWS)
            while was_full(made := run(periods, new_record(rows))) and rows < MAX_ROWS:
                rows = min(RECORD_GROWTH * rows, MAX_ROWS)
            full, (events, segments) = was_full(made), rows_of(made)
            begun = np.zeros((0, N_START)) if start is None else start
            kept = RunRecord(row, how.rtol, events.copy(), segments.copy(), full, begun)
        if full or not record:
            run(periods, no_record())
        cost += int(codes[0, CODE_N_PERIODS])
        if codes[0, CODE_MODE] != M_UNRESOLVED:
            break
    end = RunEnd(np.concatenate([space.state, space.modes])[None], space.past.copy())
    return Solved(out[0], codes[0], kept, end, cost)


def go_on(
    row: np.ndarray, end: RunEnd, n_events: int, record: RunRecord | None, how: RunSettings, space: Workspace
) -> Solved:
    """More of a run that has ended after `n_events` events with `record`: the whole of it, for the periods of `how` in all."""
    more = run_row(row, end.start, how, space, record=record is not None, past=end.past)
    more.codes[CODE_N_EVENTS] += n_events
    if record is None or more.record is None:
        return more
    # what was noted where the two parts meet, an end and a start, is no event
    begun = int(more.record.events[0, CAUSE_COLUMN] == C_START)
    events = np.concatenate([record.events[:-1], more.record.events[begun:]])
    segments = np.concatenate([record.segments[:-1], more.record.segments[begun:]])
    return more._replace(record=record._replace(events=events, segments=segments, cut=record.cut or more.record.cut))


def with_works(record: RunRecord, space: Workspace) -> tuple[RunRecord, Book]:
    """A recorded run once more, with the works of its forces: its record, and the book beside that.

    What stands in the book rides along, and changes nothing of the run. One whose start is not known is made from its first
    smooth phase on, so that its last digits may differ.
    """
    events, segments = record.events, record.segments
    ended = len(events) > 0 and not record.cut and events[-1, CAUSE_COLUMN] == C_END
    ask = ask_for(segments[-1, PERIOD] + (not ended), record.rtol, path=True)
    start = segments[:1, : N_STATE + 2] if record.start is None else record.start
    kept = new_record(max(len(events), len(segments)), works=True)
    run_recorded(record.row, ask, np.zeros((1, N_OUT)), np.zeros((1, N_CODES), np.int64), kept, space, start)
    events, segments = (rows[: len(of)] for rows, of in zip(rows_of(kept), (events, segments), strict=True))
    return record._replace(events=events, segments=segments), kept.book
