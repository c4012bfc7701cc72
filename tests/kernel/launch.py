"""The engine from any state: what `simulate` cannot start from, with the record of what follows."""

from typing import NamedTuple

import numpy as np
from cached import compiled
from examine import look_at
from verbs import as_dimer

from dimersweep.kernel import event_loop as engine
from dimersweep.kernel.batch import BETA0, XDOT0, new_desk
from dimersweep.kernel.impact.impact import N_LOG
from dimersweep.kernel.model.layout import STATUSES
from dimersweep.kernel.record import EVENT, N_EVENT, N_SEGMENT
from dimersweep.kernel.verdict import classify as fate


@compiled
def evolve(dm, state, modes, periods, rtol, close, past, work, log, events, segments, counts):
    """The event loop with the path and the record."""
    fate.begin_past(past)
    status, _ = engine.evolve(
        dm, state, modes, periods, rtol, close, False, True, past, work, log, events, segments, counts
    )
    return status


@compiled
def begin(dm, row, state):
    """The start of a scene."""
    engine.start_state(dm, row[BETA0], row[XDOT0], state)


def last_state(row, periods, rtol, close):
    """Status, number of events and last state of a scene whose chatters are closed with an accuracy of their own."""
    dm, desk, counts, none = as_dimer(row), new_desk(), np.zeros(3, np.int64), np.zeros((0, N_LOG))
    begin(dm, row, desk.state)
    status = evolve(dm, desk.state, desk.modes, periods, rtol, close, desk.past, desk.work, none, none, none, counts)
    return status, counts[0], desk.state


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
    desk, counts = new_desk(), np.zeros(3, np.int64)
    state, log = state.copy(), np.zeros((200, N_LOG))
    events, segments = np.zeros((rows, N_EVENT)), np.zeros((rows, N_SEGMENT))
    status = evolve(
        as_dimer(row), state, desk.modes, periods, rtol, rtol, desk.past, desk.work, log, events, segments, counts
    )
    return Launched(row, rtol, STATUSES[status], state, events[: counts[1]], segments[: counts[2]])
