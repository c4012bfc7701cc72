"""The record of a run: one row an event, and the state from which each smooth phase starts."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.impact import (
    LOG_A1,
    LOG_A2,
    LOG_B1,
    LOG_B2,
    LOG_N1,
    LOG_N1_AFTER,
    LOG_N2,
    LOG_N2_AFTER,
    LOG_P1,
    LOG_P2,
    contact_velocity,
)
from dimersweep.kernel.model.layout import (
    BETA,
    CB,
    N1,
    N2,
    N_STATE,
    PERIOD,
    PHASE,
    THETA,
)
from dimersweep.kernel.numerics.steps import copy

# columns of an event row
EVENT = (
    "period",
    "phase",
    "cause",
    "kind",
    "contact_before",
    "contact_after",
    "gap_1_rate_before",
    "gap_2_rate_before",
    "gap_1_rate_after",
    "gap_2_rate_after",
    "impulse_1",
    "impulse_2",
    "beta",
    "theta",
    "slip_1_a",
    "slip_1_b",
    "slip_2_a",
    "slip_2_b",
)
N_EVENT = len(EVENT)
# columns of a segment: the state, the friction modes of the phase that starts from it; and where the close of a chatter
# leads to it, the time that the hops which it sums take [s] (else 0), and what it changes (N1 to CB) as it was before
MODES, REST, BEFORE = N_STATE, N_STATE + 2, N_STATE + 3
N_SEGMENT = BEFORE + CB + 1 - N1


@compiled
def note_event(dm, events, count, state, cause, kind, before, after, log_row):
    """Write an event row; `log_row` is a row of an impact's log or has no entries. Returns the count of rows."""
    if count >= events.shape[0]:
        return count + 1
    row = events[count]
    row[0], row[1], row[2], row[3], row[4], row[5] = state[PERIOD], state[PHASE], cause, kind, before, after
    row[10], row[11], row[12], row[13] = 0.0, 0.0, state[BETA], state[THETA]
    if log_row.shape[0] > 0:
        row[6], row[7] = log_row[LOG_N1], log_row[LOG_N2]
        row[8], row[9] = log_row[LOG_N1_AFTER], log_row[LOG_N2_AFTER]
        row[10], row[11] = log_row[LOG_P1], log_row[LOG_P2]
        row[14], row[15], row[16], row[17] = log_row[LOG_A1], log_row[LOG_B1], log_row[LOG_A2], log_row[LOG_B2]
    else:
        row[6], row[7], row[8], row[9] = state[N1], state[N2], state[N1], state[N2]
        _, row[14], row[15] = contact_velocity(dm, state, -1.0)
        _, row[16], row[17] = contact_velocity(dm, state, 1.0)
    return count + 1


@compiled
def note_segment(segments, count, state, modes, rest, before):
    """Write the start of a smooth phase, and the state `before` hops that take the time `rest` were summed.

    Returns the count of rows.
    """
    if count < segments.shape[0]:
        row = segments[count]
        copy(state, row, N_STATE)
        row[MODES], row[MODES + 1], row[REST] = modes[0], modes[1], rest
        for k in range(N1, CB + 1):
            row[BEFORE + k - N1] = before[k]
    return count + 1
