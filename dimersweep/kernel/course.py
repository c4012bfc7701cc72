"""Requests for runs, and a run on its way: the arrays that it works on, and its progress between events."""

from math import inf
from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import ROW, one, record_type
from dimersweep.kernel.contact.events import NO_EVENT
from dimersweep.kernel.contact.forces import Contact
from dimersweep.kernel.contact.step_control import Control, StepArrays
from dimersweep.kernel.impact.double_leg import Stride
from dimersweep.kernel.impact.expansion import EXPANSION_ROWS
from dimersweep.kernel.impact.impact import ImpactArrays
from dimersweep.kernel.impact.single_impact import Blow
from dimersweep.kernel.model.layout import N_ROW, N_STATE, OK, PHASE, Dimer
from dimersweep.kernel.model.works import STRUCK_ROWS, WorkTally
from dimersweep.kernel.numerics.meter import Meter
from dimersweep.kernel.numerics.root_bracket import RootBracket
from dimersweep.kernel.verdict.past import Past

# bound on the work of a run, in hops of one end, and its increase with each period: a few seconds, and 0.2 s a period,
# at most
BUDGET, BUDGET_PER_PERIOD = 1_500_000, 100_000


class Course:
    """Progress of a run between two events."""

    status: int  # OK, or why the run cannot go on
    ended: bool  # True if the run has ended before its last forcing period
    pending: bool  # True if the contact of the ends at rest on the plate is to be chosen anew
    event: int  # event that has just ended a contact phase (`contact.events`), NO_EVENT if none has
    contact_is_set: bool  # True if the contact state was just chosen: it has slips that the kernel state rounds off
    slip_tol: float  # slip that counts as none in contact [m/s]
    cause: int  # cause of the next event row
    contact_before: float  # contact state of Table 1 before the event
    hop_time: float  # time of the hops that the close of a chatter sums; below zero if it summed none [s]
    forced: int  # impacts without collision in a row
    period_events: int  # number of events when the forcing period began
    blow: Blow  # impact at one end
    stride: Stride  # leg of an impact at both ends
    tally: WorkTally  # works of the forces, where they are wanted


# rows of scratch beyond those of an expansion
ROW_CONTACT, ROW_RATES, ROW_FORCES, ROW_BEFORE, ROW_TRIAL, WORK_ROWS = range(EXPANSION_ROWS, EXPANSION_ROWS + 6)


class Scratch(NamedTuple):
    """Scratch of one thread for impacts and contact steps; records are in arrays of one, which functions can return."""

    rows: Any  # shape (WORK_ROWS + STRUCK_ROWS, ROW); the last ones have the works of an impact (`works.note_struck`)
    step: Any  # arrays of a contact phase (`step_control.StepArrays`)
    impact: Any  # arrays of an impact at both ends (`impact.ImpactArrays`)
    bracket: Any  # bracket of an event within a step (`root_bracket.RootBracket`)
    control: Any  # control of the steps of a contact phase (`step_control.Control`)
    course: Any  # progress of the run (`Course`)
    meter: Any  # work that the run has done and may do, and whether it is to stop (`meter.Meter`)


def new_work() -> Scratch:
    """Return scratch whose meter has no bound."""
    rows, meter = np.zeros((WORK_ROWS + STRUCK_ROWS, ROW)), one(Meter)
    meter[0].bound = inf
    return Scratch(rows, one(StepArrays), one(ImpactArrays), one(RootBracket), one(Control), one(Course), meter)


class RunRequest(NamedTuple):
    """Request for a run: its length, accuracy and results."""

    periods: int  # forcing periods at most
    rtol: float  # tolerance of the run, from which all others follow
    close: float  # accuracy of the close of a chatter: less than rtol where its hops are to be followed further
    settle: bool  # stop at the end of the period in which the verdict is known
    path: bool  # True if x1, y1 and gamma are wanted


class Motion(NamedTuple):
    """Run on its way; all arrays are modified in place."""

    state: Any  # shape (N_STATE,)
    modes: Any  # friction modes of the ends, shape (2,)
    past: Any  # past of the run, for the verdict (`verdict.past.Past`)
    course: Any  # progress of the run (`Course`)
    contact: Any  # contact state (`coordinates`), its rates, and its forces
    rates: Any
    forces: Any
    before: Any  # state before hops were summed
    work: Any  # scratch (`Scratch`), and its meter
    meter: Any


class Workspace(NamedTuple):
    """Scratch arrays of one thread; `state`, `modes` and `past` are those at the end of the last run.

    Records stand in arrays of one, which a call from Python passes on twenty times as fast.
    """

    state: Any
    modes: Any
    later_state: Any
    later_modes: Any
    later_past: Any
    twin_state: Any
    twin_modes: Any
    past: Any
    dimer: Any  # dimer of the run; `later_dimer`, `row`: dimer on a plate whose phase is shifted, and its parameters
    later_dimer: Any
    row: Any
    work: Any


def new_workspace() -> Workspace:
    """Return scratch arrays for calls from Python: the compiled code allocates nothing."""
    return Workspace(
        state=np.zeros(N_STATE),
        modes=np.zeros(2),
        later_state=np.zeros(N_STATE),
        later_modes=np.zeros(2),
        later_past=np.zeros(1, record_type(Past)),
        twin_state=np.zeros(N_STATE),
        twin_modes=np.zeros(2),
        past=np.zeros(1, record_type(Past)),
        dimer=one(Dimer),
        later_dimer=one(Dimer),
        row=np.zeros(N_ROW),
        work=new_work(),
    )


@compiled(inline=True)
def motion_of(state, modes, past, space):
    """Return the motion of a state with its past, on the scratch arrays of a workspace."""
    work, rows = space.work, space.work.rows
    return Motion(
        state,
        modes,
        past,
        work.course,
        rows[ROW_CONTACT],
        rows[ROW_RATES],
        rows[ROW_FORCES],
        rows[ROW_BEFORE],
        work,
        work.meter,
    )


@compiled(inline=True)
def contact_of(dm, motion):
    """Return the contact of the ends on the plate in a run, at its present phase and state."""
    phase, slip_tol = motion.state[PHASE] + dm.phi0, motion.course[0].slip_tol
    return Contact(motion.modes, phase, motion.contact, motion.rates, motion.forces, slip_tol)


@compiled(inline=True)
def begin_course(course, contact, cause, events):
    """Reset the progress of a run before its first event, and mark the contact of its ends as still to be chosen.

    `contact` is the contact state of Table 1 at the start, and `cause` the cause of the first event row. `events` is
    the number of events that the record has already. The works and the impacts in the course stay as they are.
    """
    course.status, course.ended = OK, False
    course.pending, course.event, course.contact_is_set, course.slip_tol = True, NO_EVENT, False, 0.0
    course.cause, course.contact_before, course.hop_time = cause, contact, 0.0
    course.forced, course.period_events = 0, events
