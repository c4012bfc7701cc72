"""Make runs of given length and accuracy: one run with its record and its end, or many runs until they settle."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, check_rtol, check_switch
from dimersweep.kernel.batch import N_START, Workspace, run_many, run_recorded, run_request
from dimersweep.kernel.energy import Book
from dimersweep.kernel.model.event_row import E_CAUSE
from dimersweep.kernel.model.layout import (
    C_END,
    C_START,
    CODE_MODE,
    CODE_N_EVENTS,
    CODE_N_PERIODS,
    CODE_STATUS,
    GAMMA,
    M_APERIODIC,
    M_FAILED,
    M_UNRESOLVED,
    N_STATE,
    OK,
    PERIOD,
    X1,
    Y1,
)
from dimersweep.kernel.record import Record, new_record, no_record, rows_of, was_full
from dimersweep.kernel.verdict.past import PAST_SHAPE
from dimersweep.runs.recorded import RunRecord

# bits of the modes whose runs use all the periods that they may
SLOW_MODES = sum(1 << mode for mode in (M_FAILED, M_APERIODIC, M_UNRESOLVED))
# rows of a record at first, rows more for each period, and growth where too few: about twice the rows of a drift
RECORD_ROWS, ROWS_PER_PERIOD, RECORD_GROWTH = 500, 100, 4
MAX_ROWS = 2_000_000  # most rows of events, and of segments: 0.7 GB in all
MAX_RECORDED = 100_000  # most forcing periods that are recorded: those of a drift fit into MAX_ROWS
CYCLIC = (X1, Y1, GAMMA, PERIOD)  # slots of a state that no later motion depends on
# words of the refusal of a longer record
IN_PYTHON = "a run whose events and states are recorded; give record=False for one without them"


def check_recorded(periods: int, which: str = IN_PYTHON) -> None:
    """Refuse to record more than `MAX_RECORDED` forcing periods; `which` says in the message what is recorded.

    Raises
    ------
    ParameterError
    """
    if periods > MAX_RECORDED:
        raise ParameterError(f"periods = {periods}: must be <= {MAX_RECORDED} for {which}")


class RunSettings(NamedTuple):
    """Settings of the runs of points: how long and how accurate they are; see `run_patiently`."""

    periods: int  # forcing periods of the first run of a point
    max_periods: int  # forcing periods of the longest run of a point
    rtol: float  # accuracy [1]
    stop_when_settled: bool = True  # True if a run ends as soon as its motion has settled and its numbers stand

    def lengths(self) -> Iterator[int]:
        """Yield the forcing periods of the runs of a point that does not settle: each twice those of the run before."""
        periods = self.periods
        yield periods
        while periods < self.max_periods:
            periods = min(2 * periods, self.max_periods)
            yield periods

    def cost(self, n_periods: int) -> int:
        """Return the forcing periods that all runs of a point have taken, if its last run has taken `n_periods`.

        The runs before that one were made to their full lengths, as they had not settled.
        """
        return n_periods + sum(length for length in self.lengths() if length < n_periods)


def exactly(periods: int, rtol: float) -> RunSettings:
    """Return settings of runs of so many forcing periods, whether or not their motions settle."""
    return RunSettings(periods, periods, rtol, stop_when_settled=False)


def run_settings(
    *, periods: int, max_periods: int | None = None, rtol: float = 1e-8, stop_when_settled: bool = True
) -> RunSettings:
    """Return settings of runs from a user's values, checked; see `sweep`.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    periods = check_count("periods", periods)
    longest = periods if max_periods is None else check_count("max_periods", max_periods)
    if longest < periods:
        raise ParameterError(f"max_periods = {longest}: must be >= periods = {periods}")
    settles = check_switch("stop_when_settled", stop_when_settled)
    if longest > periods and not settles:
        raise ParameterError(f"max_periods = {longest}: is for runs that stop when they have settled")
    return RunSettings(periods, longest, check_rtol(rtol), settles)


class RunEnd(NamedTuple):
    """End of a run: the arrays from which the kernel makes the run longer.

    Attributes
    ----------
    start : ndarray, shape (1, N_START)
        State and friction modes at the end.
    past : ndarray, shape PAST_SHAPE
        Numbers of the run that the verdict on its mode needs.
    """

    start: np.ndarray
    past: np.ndarray


class Solved(NamedTuple):
    """Results of the kernel for one run.

    Attributes
    ----------
    out, codes : ndarray, shapes (N_OUT,), (N_CODES,)
    record : RunRecord or None
    end : RunEnd
    cost : int
        Forcing periods that were run, shorter runs of the point included.
    start : ndarray, shape (1, N_START), or None
        State and friction modes from which the run started; None if its parameters gave the start.
    """

    out: np.ndarray
    codes: np.ndarray
    record: RunRecord | None
    end: RunEnd
    cost: int
    start: np.ndarray | None

    @property
    def onward(self) -> np.ndarray | None:
        """State and friction modes for the start of the next run on a line, shape (1, N_START).

        It is the end of the run, with cyclic coordinates at 0. If the run failed it is its own start, None included.
        """
        if self.codes[CODE_STATUS] != OK:
            return self.start
        end = self.end.start.copy()
        end[0, CYCLIC] = 0.0
        return end


def run_row(
    row: np.ndarray,
    start: np.ndarray | None,
    how: RunSettings,
    space: Workspace,
    *,
    record: bool = False,
    past: np.ndarray | None = None,
) -> Solved:
    """Run one point, anew for twice as many periods until it has settled, as `how` says; return the last run.

    A record that turns out too small is made again with more rows, as a run is deterministic. A record of more than
    `MAX_ROWS` is cut; the whole run is then made without a record.

    Parameters
    ----------
    row : ndarray, shape (N_ROW,)
    start : ndarray, shape (1, N_START), optional
        State and friction modes, in place of the start in `row`.
    how : RunSettings
        Settings. If the run continues another one, its periods include those of that run.
    space : Workspace
        Scratch arrays, through which the run may be stopped.
    record : bool
        True to record events and states.
    past : ndarray, optional
        `RunEnd.past` of the run that this one continues.

    Raises
    ------
    ParameterError
        If the record of a run from the start in `row` would be too long.
    """
    (out, codes), cost = blank(1), 0

    def run(periods: int, kept: Record) -> Record:
        if past is not None:
            space.past.view(np.float64)[:] = past.ravel()
        run_recorded(row, run_request(periods, how.rtol, how.stop_when_settled, record), out, codes, kept, space, start)
        return kept

    for periods in how.lengths():
        kept, full = None, False
        if record:
            if start is None:
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
    end = RunEnd(
        np.concatenate([space.state, space.modes])[None], space.past.view(np.float64).reshape(PAST_SHAPE).copy()
    )
    return Solved(out[0], codes[0], kept, end, cost, start)


def go_on(
    row: np.ndarray, end: RunEnd, n_events: int, record: RunRecord | None, how: RunSettings, space: Workspace
) -> Solved:
    """Make a run longer that has ended in `end`, after `n_events` events and with `record`; return the whole of it.

    The periods of `how` are those of the whole run.
    """
    more = run_row(row, end.start, how, space, record=record is not None, past=end.past)
    more.codes[CODE_N_EVENTS] += n_events
    if record is None or more.record is None:
        return more
    # the rows where the two parts meet, an end and a start, are no events of the whole run
    begun = int(more.record.events[0, E_CAUSE] == C_START)
    events = np.concatenate([record.events[:-1], more.record.events[begun:]])
    segments = np.concatenate([record.segments[:-1], more.record.segments[begun:]])
    return more._replace(record=record._replace(events=events, segments=segments, cut=record.cut or more.record.cut))


def with_works(record: RunRecord, space: Workspace) -> tuple[RunRecord, Book]:
    """Make a recorded run once more, with the works of its forces; return its record, and the works in a `Book`.

    The works are integrated along and change nothing of the run. A run whose start is unknown is made from its first
    smooth phase on, so that its last digits may differ.
    """
    events, segments = record.events, record.segments
    ended = len(events) > 0 and not record.cut and events[-1, E_CAUSE] == C_END
    request = run_request(segments[-1, PERIOD] + (not ended), record.rtol, path=True)
    start = segments[:1, : N_STATE + 2] if record.start is None else record.start
    kept = new_record(max(len(events), len(segments)), works=True)
    run_recorded(record.row, request, *blank(1), kept, space, start)
    events, segments = (rows[: len(of)] for rows, of in zip(rows_of(kept), (events, segments), strict=True))
    return record._replace(events=events, segments=segments), kept.book


def run_patiently(
    rows: np.ndarray,
    how: RunSettings,
    out: np.ndarray,
    codes: np.ndarray,
    until: int = 0,
    space: Workspace | None = None,
) -> int:
    """Run points as `run_many` does, up to the first that has not settled; that one again for twice as long, and so on.

    A longer run starts anew, so that the result depends on the point alone. Most motions settle soon; those that ring
    down slowly are too few to give all points the longest time at once.

    Parameters
    ----------
    rows, out, codes, until, space
        As in ``kernel.batch.run_rows``.
    how : RunSettings

    Returns
    -------
    int
        Number of points that were run; their results are in `out` and `codes`.
    """
    rtol, settle = how.rtol, how.stop_when_settled

    first, *longer = how.lengths()
    which = until | 1 << M_UNRESOLVED
    made = run_many(rows, first, rtol, settle, out, codes, until=which, space=space)
    last = slice(made - 1, made)
    for more in longer:
        if not made or codes[made - 1, CODE_MODE] != M_UNRESOLVED:
            break
        if not run_many(rows[last], more, rtol, settle, out[last], codes[last], until=until, space=space):
            return made - 1  # the work was stopped within this point
    return made


def run_all_patiently(
    rows: np.ndarray, how: RunSettings, space: Workspace | None = None, until: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Run all points by `run_patiently`; return `out` and `codes`, blank from the point where the work was stopped.

    `until` has the bits of modes: the first run that comes to one of them is the last one made.
    """
    out, codes = blank(len(rows))
    done, made = 0, 1
    while made and done < len(rows):
        made = run_patiently(rows[done:], how, out[done:], codes[done:], until, space)
        done += made
        if until >> int(codes[done - 1, CODE_MODE]) & 1:
            break
    return out, codes
