"""Make runs in a line that carry their state on: each starts from the state in which the run before it has ended."""

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
    """Make runs one after the other, each from the end of the run before.

    The first one starts from `start`, or as its parameters say. The carried state is relative to the plate at the end
    of the last forcing period, so that its phase does not jump. A run that has not settled is made anew from its own
    start for twice as many periods, up to `how.max_periods`.

    Parameters
    ----------
    rows : iterable of ndarray, shape (N_ROW,)
        Parameters of each run, in the order in which they are made.
    how : RunSettings
    space : Workspace
        Scratch arrays, which the caller may use between two runs. If they are stopped, the iteration ends.
    start : ndarray, shape (1, N_START), optional
        State of the first run; by default its parameters give the start.
    before : ndarray, shape (N_ROW,), optional
        Parameters of the dimer that `start` is a state of.
    record : bool
        True to record events and states.

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
    """Make the run of a point of a sweep, bit for bit, after the runs `before` it on a line whose state it carries on.

    Parameters
    ----------
    parameters : mapping
    how : RunSettings
    record : bool
    before : sequence of ndarray, shape (N_ROW,)
        Parameters of the runs before it, in their order. If there are none, the run starts from its own parameters.
    how_before : RunSettings, optional
        Settings of the runs before it, if they differ from `how`.

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
