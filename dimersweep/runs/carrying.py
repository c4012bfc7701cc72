"""Runs in a line that carry their state on: each starts from the state that the one before it has ended in."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.parameters import Parameters
from dimersweep.runs.recorded import named_state
from dimersweep.runs.run import Run, as_run, proven_run
from dimersweep.runs.solving import RunSettings, Solved, run_row
from dimersweep.runs.starting import fitted


def carried(
    rows: Iterable[np.ndarray],
    how: RunSettings,
    space: Workspace,
    start: np.ndarray | None = None,
    before: np.ndarray | None = None,
    *,
    record: bool = False,
) -> Iterator[Solved]:
    """Make runs one after the other; the first starts as its parameters say, or from `start`.

    The state is that relative to the plate at the end of the last forcing period, so that it goes on without a jump in its
    phase. A run that has not settled is made anew from its own start for twice as many periods, up to `how.max_periods`.

    Parameters
    ----------
    rows : iterable of ndarray, shape (N_ROW,)
        Parameters of each run, in the order in which they are made.
    how : RunSettings
    space : Workspace
        Scratch arrays, which the caller may use between two runs; if they are stopped, no more runs come.
    start : ndarray, shape (1, N_START), optional
    before : ndarray, shape (N_ROW,), optional
        Parameters that `start` comes from.
    record : bool
        Whether their events and states are recorded.

    Yields
    ------
    Solved
    """
    for row in rows:
        if start is not None and before is not None:
            start = fitted(start, before, row)
        solved = run_row(row, start, how, space, record=record)
        if is_stopped(space):
            return
        yield solved
        before, start = row, solved.onward


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
        for made in carried(before, how_before or how, space):
            start = made.onward
        if start is not None:
            start = fitted(start, before[-1], row)
        solved = run_row(row, start, how, space, record=record)
        return as_run(given.given(), how.rtol, solved, None if start is None else named_state(row, start))

    return proven_run(call)
