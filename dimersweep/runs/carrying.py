"""Runs in a line that carry their state on: each starts from the state that the one before it has ended in."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.kernel.model.layout import CODE_STATUS, GAMMA, OK, PERIOD, X1, Y1
from dimersweep.parameters import Parameters
from dimersweep.runs.recorded import named_state
from dimersweep.runs.run import Run, as_run, proven_run
from dimersweep.runs.solving import RunSettings, Solved, run_row
from dimersweep.runs.starting import fitted

CYCLIC = (X1, Y1, GAMMA, PERIOD)  # slots of a state that no later state depends on


class Link(NamedTuple):
    """One run of a line.

    Attributes
    ----------
    solved : Solved
    start : ndarray, shape (1, N_START), or None
        State and friction modes that it started from; None for the start of its parameters.
    end : ndarray, shape (1, N_START), or None
        Those that the next one starts from: where it has ended, or what it started from if it did not reach its end.
    """

    solved: Solved
    start: np.ndarray | None
    end: np.ndarray | None


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
        solved, end = run_row(row, start, how, space), start
        if is_stopped(space):
            return
        if solved.codes[CODE_STATUS] == OK:
            end = solved.end.start.copy()
            end[0, CYCLIC] = 0.0
        yield Link(solved, start, end)
        before, start = row, end


def run_in_line(
    parameters: Mapping[str, float],
    how: RunSettings,
    *,
    record: bool = True,
    before: Sequence[np.ndarray] | np.ndarray = (),
    how_before: RunSettings | None = None,
) -> Run:
    """The run of a point of a sweep, bit for bit; it may carry on the state of the runs `before` it on a line.

    Parameters
    ----------
    parameters : mapping
    how : RunSettings
    record : bool
    before : sequence of ndarray, shape (N_ROW,)
        Parameters of those, in their order; if there are none, it starts as its own say.
    how_before : RunSettings, optional
        Of those, where it is another one.

    Returns
    -------
    Run
    """
    given = Parameters(**parameters)
    row = given.row()

    def call(space: Workspace) -> Run:
        start = None
        for link in carried(before, how_before or how, space):
            start = link.end
        if start is not None:
            start = fitted(start, before[-1], row)
        solved = run_row(row, start, how, space, record=record)
        return as_run(given.given(), how.rtol, solved, None if start is None else named_state(row, start))

    return proven_run(call)
