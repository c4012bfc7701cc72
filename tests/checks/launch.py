"""The engine from any state: what `simulate` cannot start from, with the record of what follows."""

from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.kernel import event_loop
from dimersweep.kernel.batch import N_START, run_rows
from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.course import RunRequest, new_workspace
from dimersweep.kernel.model.event_row import EVENT
from dimersweep.kernel.model.layout import CODE_STATUS, FREE, STATUSES
from dimersweep.kernel.record import EVENT_COUNT, new_record, no_record, rows_of
from tests.checks.examine import look_at

SCENE = np.zeros((0, N_START))  # in place of states to start from


def made(row, starts, ask, record):
    """Status and last state of a run."""
    (out, codes), space = blank(1), new_workspace()
    run_rows(row[None], starts, ask, 0, out, codes, space, record)
    return codes[0, CODE_STATUS], space.state


@exported
def begin(dm, row, state):
    """The start of a scene."""
    event_loop.start_state(dm, row, state)


def last_state(row, periods, rtol, close):
    """Status, number of events and last state of a scene whose chatters are closed with an accuracy of their own."""
    record = no_record()
    status, state = made(row, SCENE, RunRequest(periods, rtol, close, False, True), record)
    return status, record.counts[EVENT_COUNT], state


class Launched(NamedTuple):
    """What became of a state."""

    row: np.ndarray
    rtol: float
    status: str
    state: np.ndarray  # the last one
    events: np.ndarray
    segments: np.ndarray

    def column(self, name):
        """A column of the event rows."""
        return self.events[:, EVENT.index(name)]

    def look(self):
        """What the record shows (see ``examine``)."""
        return look_at(self.row, self.rtol, self.status, len(self.events), self.events, self.segments)


def launch(row, state, periods, rtol=1e-8, rows=20_000):
    """Run the dimer of a parameter row from a kernel state at the start of a period for some forcing periods."""
    record = new_record(rows, 200)
    status, last = made(row, np.append(state, [FREE, FREE])[None], RunRequest(periods, rtol, rtol, False, True), record)
    return Launched(row, rtol, STATUSES[status], last, *rows_of(record))
