"""States of a recorded run at any time: each is moved again from the start of the smooth phase it lies in.

A contact phase takes the steps of the run, and looks for its event as the run does, so that just before an event the state
comes to what the run found there: no end is below the plate, no slip has turned round. The hops that the close of a chatter
has summed are followed one by one.
"""

from math import inf, nan

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.contact.contact_mode import CLOSED, MOMENT
from dimersweep.kernel.contact.coordinates import (
    BY_HEADING,
    Y,
    change_chart,
    contact_state,
    kernel_state,
    leading,
    slip_speed,
)
from dimersweep.kernel.contact.events import (
    HOLD_LOST,
    LANDING,
    NO_EVENT,
    OUT_OF_STEPS,
    end_of,
    is_lift_off,
    is_slip_end,
)
from dimersweep.kernel.contact.forces import Contact, contact_rates
from dimersweep.kernel.contact.phase import sustain_contact
from dimersweep.kernel.course import ROW_TRIAL, Ask, contact_of, motion_of
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.model.body import TWO_PI, end, set_dimer
from dimersweep.kernel.model.layout import CB, CONTACT_STEPS, FREE, N1, N_ROW, N_STATE, OK, PERIOD, PHASE, STOPPED
from dimersweep.kernel.model.plate import start_later
from dimersweep.kernel.numerics.meter import set_bound
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import BEFORE, SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.kernel.smooth_motion import find_contact, no_slip, only_grazes, set_contact
from dimersweep.kernel.verdict.past import begin_past

SLIP_END_ERROR = 10.0  # x rtol: how much sooner than the run a sample may find the end of a slip [rad]
MOST_GRAZES = 1000  # in a contact phase
HOPS_LAST = 2.0  # hops are followed for so long, in units of the time that they take when the plate does not change


@exported
def sample(row, segments, which, phases, rtol, space, record, states, modes):
    """Kernel states of a run at given times.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    segments : float64 array, shape (n, N_SEGMENT)
        Starts of smooth phases (``record``); of hops that were summed, if they are to be followed.
    which : int64 array, shape (k,)
        Number of the segment in whose phase each time lies.
    phases : float64 array, shape (k,)
        Plate phase [rad] of each time, counted as that of the segment and not below it.
    rtol : float
    space : Workspace
        Scratch.
    record : Record
        Scratch, without rows.
    states : float64 array, shape (k, N_STATE)
        Filled in place.
    modes : float64 array, shape (k, 2)
        Friction modes of the ends, filled in place.

    Returns
    -------
    int
        OK or the reason why not; the other times are sampled all the same.
    """
    dm, worst = space.dimer, OK
    set_dimer(row, dm)
    for k in range(phases.shape[0]):
        segment, state = segments[which[k]], states[k]
        copy(segment, state, N_STATE)
        modes[k, 0], modes[k, 1] = segment[SEGMENT_MODES], segment[SEGMENT_MODES + 1]
        motion = motion_of(state, modes[k], space.past, space)
        set_bound(motion.meter, inf)
        span = (phases[k] - state[PHASE]) / dm.omega
        status = OK
        if 0.0 <= span < HOPS_LAST * segment[SEGMENT_HOP_TIME]:
            copy(row, space.row, N_ROW)
            status = follow_hops(dm, space, segment, motion, span, rtol, record)
        elif span > 0.0 and modes[k, 0] == FREE and modes[k, 1] == FREE:
            fly(dm, take_off(dm, state), state, span, True)
        elif span > 0.0:
            status = move_contact(dm, motion, span, rtol)
        if status != OK:
            for j in range(N_STATE):
                state[j] = nan
            worst = status
    return worst


@exported
def forces_at(row, states, modes, rtol, space, forces):
    """Contact forces of kernel states; zero at ends in free motion.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    states : float64 array, shape (k, N_STATE)
    modes : float64 array, shape (k, 2)
        Friction modes of the ends.
    rtol : float
        Accuracy of the run.
    space : Workspace
        Scratch.
    forces : float64 array, shape (k, N_F)
        Filled in place [N], see `contact_rates`: forces along the axis and across it.
    """
    dm = space.dimer
    set_dimer(row, dm)
    for k in range(states.shape[0]):
        if modes[k, 0] == FREE and modes[k, 1] == FREE:
            continue
        copy(states[k], space.state, N_STATE)
        copy(modes[k], space.modes, 2)
        motion = motion_of(space.state, space.modes, space.past, space)
        begin_contact(dm, motion, rtol)
        if motion.contact[Y.chart] != BY_HEADING:
            change_chart(dm, end(dm, leading(space.modes)).s, motion.contact)
        contact_rates(dm, space.modes, states[k, PHASE] + dm.phi0, motion.contact, False, motion.rates, forces[k])


@compiled
def follow_hops(dm, space, segment, motion, span, rtol, record):
    """Move the state on by a time from the close of a chatter, through the hops that were summed there; returns a status.

    The plate's phase is counted anew, so that a forcing period ends at the time wanted; the row of the workspace changes
    accordingly, and its later dimer is filled in from it.
    """
    state, modes = motion.state, motion.modes
    for k in range(N1, CB + 1):
        state[k] = segment[BEFORE + k - N1]
    if span == 0.0:  # right after the bounce
        for i in range(2):
            if state[N1 + i] > 0.0:
                modes[i] = FREE
        return OK
    start, periods = state[PHASE], state[PERIOD]
    state[PHASE], state[PERIOD] = TWO_PI - dm.omega * span, 0.0
    start_later(space.row, start - state[PHASE])
    begin_past(motion.past[0])
    set_dimer(space.row, space.later_dimer)
    status, _ = evolve(space.later_dimer, Ask(1, rtol, rtol**3, False, True), motion, record)
    state[PHASE], state[PERIOD] = start + dm.omega * span, periods
    return status


@compiled
def move_contact(dm, motion, span, rtol):
    """Move the state of a contact phase on by a time in it, in place; returns a status.

    An event before that time is the end of the phase, found a hair too early, or one that the run has passed by: a slip that
    is over stays so, all else goes on, but no end goes below the plate.
    """
    state, modes, y = motion.state, motion.modes, motion.contact
    begin_contact(dm, motion, rtol)
    done, event = follow_to_event(dm, contact_of(dm, motion), motion.work, span, rtol)
    if is_slip_end(event) and dm.omega * (span - done) > max(MOMENT, SLIP_END_ERROR * rtol):
        # passed by: all again, with no events in view
        begin_contact(dm, motion, rtol)
        done, event = 0.0, LANDING
    if event != NO_EVENT and not is_slip_end(event):
        later = contact_later(dm, contact_of(dm, motion), done)
        _, event = sustain_contact(dm, later, span - done, True, rtol, False, motion.work)
        if y[Y.chart] == BY_HEADING:
            side = 1.0 if modes[0] != FREE else -1.0
            y[Y.dip] = side * max(0.0, side * y[Y.dip])
    kernel_state(dm, modes, y, state)
    state[PHASE] += dm.omega * span
    if event == OUT_OF_STEPS:
        return STOPPED if motion.meter[0].stop else CONTACT_STEPS
    return OK


@compiled
def begin_contact(dm, motion, rtol):
    """Set the contact state at the start of a phase.

    A slip that sets out from rest is chosen again: its direction is lost in the rounding of the state.
    """
    state, modes, y, trial = motion.state, motion.modes, motion.contact, motion.work.rows[ROW_TRIAL]
    motion.course[0].slip_tol = no_slip(dm, state, rtol)
    c = contact_of(dm, motion)
    set_contact(dm, state, modes, y)
    speed, _ = slip_speed(dm, modes, y, y)
    if speed <= c.slip_tol:
        answer = find_contact(dm, Contact(trial, c.phase, y, c.dy, c.F, c.slip_tol), state, HOLD_LOST)
        if answer != CLOSED or trial[0] != modes[0] or trial[1] != modes[1]:
            contact_state(dm, state, leading(modes), y)


@compiled
def follow_to_event(dm, c, work, span, rtol):
    """Follow a contact phase, with its path, to its first event that is no graze; returns time and event."""
    done, event = 0.0, NO_EVENT
    for _ in range(MOST_GRAZES):
        t, event = sustain_contact(dm, contact_later(dm, c, done), span - done, True, rtol, True, work)
        done += t
        if not (is_lift_off(event) and only_grazes(dm, contact_later(dm, c, done), end_of(event))):
            break
    return done, event


@compiled
def contact_later(dm, c, time):
    """The contact with the plate moved on by a time."""
    return Contact(c.modes, c.phase + dm.omega * time, c.y, c.dy, c.F, c.slip_tol)
