"""The engine from any state: what `simulate` cannot start from, with the record of what follows."""

from typing import NamedTuple

import numpy as np

from dimersweep.kernel import event_loop
from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.course import Ask, motion_of, new_workspace
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.event_row import EVENT
from dimersweep.kernel.model.layout import STATUSES
from dimersweep.kernel.record import EVENT_COUNT, new_record, no_record, rows_of
from dimersweep.kernel.verdict import past
from tests.checks.examine import look_at


@exported
def evolve(dm, ask, state, space, record):
    """The event loop from any state."""
    past.begin_past(space.past[0])
    status, _ = event_loop.evolve(dm, ask, motion_of(state, space.modes, space.past, space), record)
    return status


@exported
def begin(dm, row, state):
    """The start of a scene."""
    event_loop.start_state(dm, row, state)


def last_state(row, periods, rtol, close):
    """Status, number of events and last state of a scene whose chatters are closed with an accuracy of their own."""
    dm, space, record = dimer_of(row), new_workspace(), no_record()
    begin(dm, row, space.state)
    status = evolve(dm, Ask(periods, rtol, close, False, True), space.state, space, record)
    return status, record.counts[EVENT_COUNT], space.state


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
    """Run the dimer of a parameter row from a kernel state for some forcing periods."""
    state, record = state.copy(), new_record(rows, 200)
    status = evolve(dimer_of(row), Ask(periods, rtol, rtol, False, True), state, new_workspace(), record)
    return Launched(row, rtol, STATUSES[status], state, *rows_of(record))
