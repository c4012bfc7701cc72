"""Runs in a line that carry their state on: each starts from the state that the one before it has ended in."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import N_START, Workspace, ask_for, is_stopped, run_rows
from dimersweep.kernel.model.layout import (
    CODE_MODE,
    CODE_N_PERIODS,
    CODE_STATUS,
    GAMMA,
    M_UNRESOLVED,
    OK,
    PERIOD,
    X1,
    Y1,
)
from dimersweep.kernel.record import no_record
from dimersweep.parameters import Parameters
from dimersweep.runs.recorded import named_state
from dimersweep.runs.run import Run, as_run
from dimersweep.runs.settings import RunSettings, run_row_patiently
from dimersweep.runs.starting import fitted
from dimersweep.work.stopping import StopFlag, stoppable

CYCLIC = (X1, Y1, GAMMA, PERIOD)  # slots of a state that no later state depends on


class Link(NamedTuple):
    """One run of a line.

    Attributes
    ----------
    out, codes : ndarray, shapes (1, N_OUT), (1, N_CODES)
        Its outcome.
    start : ndarray, shape (1, N_START), or None
        State and friction modes that it started from; None for the start of its parameters.
    end : ndarray, shape (1, N_START), or None
        Those that the next one starts from: where it has ended, or what it started from if it did not reach its end.
    cost : int
        Forcing periods that were run for it.
    """

    out: np.ndarray
    codes: np.ndarray
    start: np.ndarray | None
    end: np.ndarray | None
    cost: int


def carried(
    rows: Iterable[np.ndarray],
    how: RunSettings,
    space: Workspace,
    start: np.ndarray | None = None,
    before: np.ndarray | None = None,
) -> Iterator[Link]:
    """Make runs one after the other; the first starts as its parameters say, or from `start`.

    The state is that relative to the plate at the end of the last forcing period, so that it goes on without a jump in its
    phase. A run that has not settled is made anew from its own start for twice as many periods, up to `how.max_periods`.

    Parameters
    ----------
    rows : iterable of ndarray, shape (N_ROW,)
        Parameters of each run, in the order in which they are made.
    how : RunSettings
    space : Workspace
        Scratch arrays, which the caller may use between two links; if they are stopped, no more links come.
    start : ndarray, shape (1, N_START), optional
    before : ndarray, shape (N_ROW,), optional
        Parameters that `start` comes from.

    Yields
    ------
    Link
    """
    for row in rows:
        if start is not None and before is not None:
            start = fitted(start, before, row)
        out, codes = blank(1)
        starts, cost = np.zeros((0, N_START)) if start is None else start, 0
        for length in how.lengths():
            run_rows(
                row[None], starts, ask_for(length, how.rtol, how.stop_when_settled), 0, out, codes, space, no_record()
            )
            cost += int(codes[0, CODE_N_PERIODS])
            if codes[0, CODE_MODE] != M_UNRESOLVED or is_stopped(space):
                break
        if is_stopped(space):
            return
        end = _end_of(space) if codes[0, CODE_STATUS] == OK else start
        yield Link(out, codes, start, end, cost)
        before, start = row, end


def _end_of(space: Workspace) -> np.ndarray:
    """State and friction modes at the end of the last run on scratch arrays, shape (1, N_START), to start from."""
    state = space.state.copy()
    state[list(CYCLIC)] = 0.0
    return np.concatenate([state, space.modes])[None]


def run_in_line(
    before: Iterable[Mapping[str, float]],
    parameters: Mapping[str, float],
    how: RunSettings,
    last: RunSettings,
    *,
    record: bool,
) -> Run:
    """The run with `parameters` that carries on the state of the runs `before` it.

    Parameters
    ----------
    before : iterable of mapping
        Parameters of those, in their order; if there are none, it starts as its own say.
    parameters : mapping
    how, last : RunSettings
        Of those before, and of the run.
    record : bool

    Returns
    -------
    Run
        The run of that line, bit for bit.
    """
    rows = [Parameters(**each).row() for each in before]
    given = Parameters(**parameters)
    row = given.row()

    def call(stop: StopFlag) -> Run:
        with stop.space() as space:
            *_, former = [None, *carried(rows, how, space)]
            start = None if former is None else former.end
            if start is not None:
                start = fitted(start, rows[-1], row)
            solved = run_row_patiently(row, start, last, space, record=record)
        return as_run(given.given(), last.rtol, solved, None if start is None else named_state(row, start))

    return stoppable(call)
