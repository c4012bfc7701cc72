"""How runs are made: their length and accuracy, one run with its record and its end, many that are given time to settle."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, check_rtol, check_switch
from dimersweep.kernel.batch import N_START, Workspace, ask_for, run_many, run_recorded
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

SLOW_MODES = sum(1 << mode for mode in (M_FAILED, M_APERIODIC, M_UNRESOLVED))  # these use all periods they are given
RECORD_ROWS, ROWS_PER_PERIOD, RECORD_GROWTH = 500, 100, 4  # capacity of a record: about twice what a drift takes
MAX_ROWS = 2_000_000  # of events and of segments each, 0.7 GB in all
MAX_RECORDED = 100_000  # forcing periods: those of a drift fit
CYCLIC = (X1, Y1, GAMMA, PERIOD)  # slots of a state that no later state depends on
IN_PYTHON = "a run whose events and states are recorded; give record=False for one without them"


def check_recorded(periods: int, which: str = IN_PYTHON) -> None:
    """Refuse to record more forcing periods than memory and patience hold.

    Raises
    ------
    ParameterError
    """
    if periods > MAX_RECORDED:
        raise ParameterError(f"periods = {periods}: must be <= {MAX_RECORDED} for {which}")


class RunSettings(NamedTuple):
    """How long and how accurate the runs of points are; see `run_patiently`."""

    periods: int  # forcing periods of the first run of a point
    max_periods: int  # and of the longest
    rtol: float  # accuracy [1]
    stop_when_settled: bool = True  # whether a run ends as soon as its motion has settled and its numbers stand

    def lengths(self) -> Iterator[int]:
        """Forcing periods of the runs of a point that does not settle, one after the other: each twice those before."""
        periods = self.periods
        yield periods
        while periods < self.max_periods:
            periods = min(2 * periods, self.max_periods)
            yield periods

    def cost(self, n_periods: int) -> int:
        """Forcing periods of all runs of a point whose last one has taken so many: it went on where those before ended."""
        return n_periods + sum(length for length in self.lengths() if length < n_periods)


def exactly(periods: int, rtol: float) -> RunSettings:
    """Settings of runs of so many forcing periods, whether or not their motions settle."""
    return RunSettings(periods, periods, rtol, stop_when_settled=False)


def run_settings(
    *, periods: int, max_periods: int | None = None, rtol: float = 1e-8, stop_when_settled: bool = True
) -> RunSettings:
    """Settings of runs from what a user gives, see `sweep`.

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
    """Where a run has ended: what the kernel needs to go on.

    Attributes
    ----------
    start : ndarray, shape (1, N_START)
        State and friction modes.
    past : ndarray, shape PAST_SHAPE
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
    start : ndarray, shape (1, N_START), or None
        State and friction modes that it started from; None for the start of its parameters.
    """

    out: np.ndarray
    codes: np.ndarray
    record: RunRecord | None
    end: RunEnd
    cost: int
    start: np.ndarray | None

    @property
    def onward(self) -> np.ndarray | None:
        """The start of the run that its state is carried to: where it has ended, or its own if it did not reach its end."""
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
        If the record of a run from the start in `row` would be too long.
    """
    (out, codes), cost = blank(1), 0

    def run(periods: int, kept: Record) -> Record:
        if past is not None:
            space.past.view(np.float64)[:] = past.ravel()
        run_recorded(row, ask_for(periods, how.rtol, how.stop_when_settled, record), out, codes, kept, space, start)
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
    """More of a run that has ended after `n_events` events with `record`: the whole of it, for the periods of `how` in all."""
    more = run_row(row, end.start, how, space, record=record is not None, past=end.past)
    more.codes[CODE_N_EVENTS] += n_events
    if record is None or more.record is None:
        return more
    # what was noted where the two parts meet, an end and a start, is no event
    begun = int(more.record.events[0, E_CAUSE] == C_START)
    events = np.concatenate([record.events[:-1], more.record.events[begun:]])
    segments = np.concatenate([record.segments[:-1], more.record.segments[begun:]])
    return more._replace(record=record._replace(events=events, segments=segments, cut=record.cut or more.record.cut))


def with_works(record: RunRecord, space: Workspace) -> tuple[RunRecord, Book]:
    """A recorded run once more, with the works of its forces: its record, and the book beside that.

    What stands in the book rides along, and changes nothing of the run. One whose start is not known is made from its first
    smooth phase on, so that its last digits may differ.
    """
    events, segments = record.events, record.segments
    ended = len(events) > 0 and not record.cut and events[-1, E_CAUSE] == C_END
    ask = ask_for(segments[-1, PERIOD] + (not ended), record.rtol, path=True)
    start = segments[:1, : N_STATE + 2] if record.start is None else record.start
    kept = new_record(max(len(events), len(segments)), works=True)
    run_recorded(record.row, ask, *blank(1), kept, space, start)
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

    A longer run starts anew: what comes out depends on the point alone. Most motions settle soon, and those that ring down
    slowly are too few to be given all they may need at once.

    Parameters
    ----------
    rows, out, codes, until, space
        See ``kernel.batch.run_rows``.
    how : RunSettings

    Returns
    -------
    int
        Number of points made.
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
            return made - 1  # it was stopped
    return made


def run_all_patiently(
    rows: np.ndarray, how: RunSettings, space: Workspace | None = None, until: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Results of all points by `run_patiently`: `out` and `codes`, blank from where the work was stopped.

    The first run with one of the modes in `until` is the last one made.
    """
    out, codes = blank(len(rows))
    done, made = 0, 1
    while made and done < len(rows):
        made = run_patiently(rows[done:], how, out[done:], codes[done:], until, space)
        done += made
        if until >> int(codes[done - 1, CODE_MODE]) & 1:
            break
    return out, codes
