"""What is asked of a run, and a run on its way: the arrays it works on, and what stands between its events."""

from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import new_record
from dimersweep.kernel.contact.step_control import STEP_ROWS
from dimersweep.kernel.model.layout import N_ROW, N_STATE, OK, Dimer
from dimersweep.kernel.numerics.meter import METER, has_no_bound
from dimersweep.kernel.verdict.past import PAST_COLUMNS, PAST_ROWS

# bound on the work of a run, in hops of one end: some seconds, and 0.1 s a period
BUDGET, BUDGET_PER_PERIOD = 5_000_000, 100_000

# slots of a course
(
    STATUS,  # OK, or why the run cannot go on
    ENDED,  # whether the run has ended before its last forcing period
    PENDING,  # whether the contact of the ends at rest on the plate is to be chosen anew
    HOLD_IS_LOST,  # whether a sticking end has just reached the limit of its friction
    CONTACT_IS_SET,  # whether the contact state is the one just chosen: it holds slips that the kernel state would round off
    SLIP_TOL,  # slip that counts as none in contact [m/s]
    CAUSE,  # of the next event row
    CONTACT_BEFORE,  # contact state of Table 1 before the event
    HOP_TIME,  # time that the hops take which the close of a chatter sums; below zero if none were [s]
    FORCED,  # impacts without collision in a row
    PERIOD_EVENTS,  # number of events when the forcing period began
) = range(11)
NO, YES = 0.0, 1.0

# rows of the work array beyond those of a contact step, and the meter's
ROW_CONTACT = STEP_ROWS
ROW_RATES, ROW_FORCES, ROW_BEFORE, ROW_COURSE, ROW_TRIAL = range(ROW_CONTACT + 1, ROW_CONTACT + 6)
WORK_ROWS, WORK_COLUMNS = ROW_TRIAL + 3, 16


class Ask(NamedTuple):
    """What is asked of a run."""

    periods: int  # forcing periods at most
    rtol: float  # the one accuracy knob
    close: float  # accuracy of the close of a chatter: less than rtol where its hops are to be followed further
    settle: bool  # stop at the end of the period in which the verdict is known
    path: bool  # whether x1, y1 and gamma are wanted


class Motion(NamedTuple):
    """A run on its way; all arrays are modified in place."""

    state: Any  # shape (N_STATE,)
    modes: Any  # friction modes of the ends, shape (2,)
    past: Any  # what the verdict needs (`verdict.past`), shape (PAST_ROWS, PAST_COLUMNS)
    course: Any  # the slots above
    contact: Any  # the state as a contact phase has it (`coordinates`), its rates, and its forces
    rates: Any
    forces: Any
    before: Any  # the state before hops were summed
    work: Any  # rows for impacts and contact steps, shape (WORK_ROWS, WORK_COLUMNS)
    meter: Any  # the work that the run has done and may do, and whether it is to stop (`numerics.meter`)


class Workspace(NamedTuple):
    """Scratch arrays of one thread; `state`, `modes` and `past` are those at the end of the last run."""

    state: Any
    modes: Any
    later_state: Any
    later_modes: Any
    later_past: Any
    twin_state: Any
    twin_modes: Any
    strobe: Any
    past: Any
    dimer: Any  # that of the run, and one on a plate whose phase is shifted, with its parameters
    later_dimer: Any
    row: Any
    work: Any


def new_workspace() -> Workspace:
    """Scratch arrays for what Python calls: the compiled code allocates nothing."""
    return Workspace(
        state=np.zeros(N_STATE),
        modes=np.zeros(2),
        later_state=np.zeros(N_STATE),
        later_modes=np.zeros(2),
        later_past=np.zeros((PAST_ROWS, PAST_COLUMNS)),
        twin_state=np.zeros(N_STATE),
        twin_modes=np.zeros(2),
        strobe=np.zeros(4),
        past=np.zeros((PAST_ROWS, PAST_COLUMNS)),
        dimer=new_record(Dimer),
        later_dimer=new_record(Dimer),
        row=np.zeros(N_ROW),
        work=has_no_bound(np.zeros((WORK_ROWS, WORK_COLUMNS))),
    )


@compiled(inline=True)
def motion_of(state, modes, past, space):
    """The run of a state with its past, on the scratch arrays of a workspace."""
    work = space.work
    return Motion(
        state,
        modes,
        past,
        work[ROW_COURSE],
        work[ROW_CONTACT],
        work[ROW_RATES],
        work[ROW_FORCES],
        work[ROW_BEFORE],
        work,
        work[METER],
    )


@compiled(inline=True)
def begin_course(course, contact, cause, events):
    """Set a course to its start.

    Parameters
    ----------
    contact : float
        Contact state of Table 1 at the start. The friction modes of ends on the plate are chosen anew.
    cause : int
        Why the first event row is written, such as C_START.
    events : int
        Number of event rows in the record so far.
    """
    course[STATUS], course[ENDED] = OK, NO
    course[PENDING], course[HOLD_IS_LOST], course[CONTACT_IS_SET], course[SLIP_TOL] = YES, NO, NO, 0.0
    course[CAUSE], course[CONTACT_BEFORE], course[HOP_TIME] = cause, contact, 0.0
    course[FORCED] = 0.0
    course[PERIOD_EVENTS] = events
