"""Find states of a recorded run at any time: each is moved again from the start of the smooth phase that it lies in.

A contact phase starts from the slip that the run had, and takes the steps of the run up to the first that passes the
time asked for. So just before an event the state agrees with the event that the run found: no end is below the plate,
no slip has reversed. The hops that the close of a chatter has summed are followed one by one.
"""

from math import inf, nan

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.contact.contact_mode import MOMENT
from dimersweep.kernel.contact.coordinates import (
    BY_HEADING,
    Y,
    change_chart,
    kernel_state,
    leading,
)
from dimersweep.kernel.contact.events import (
    NO_EVENT,
    OUT_OF_STEPS,
    end_of,
    is_lift_off,
)
from dimersweep.kernel.contact.forces import Contact, contact_rates
from dimersweep.kernel.contact.phase import sustain_contact
from dimersweep.kernel.course import RunRequest, contact_of, motion_of
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.model.body import end, set_dimer
from dimersweep.kernel.model.layout import CB, CONTACT_STEPS, FREE, N1, N_ROW, N_STATE, OK, PERIOD, PHASE, STOPPED
from dimersweep.kernel.model.plate import start_later
from dimersweep.kernel.numerics.meter import set_bound
from dimersweep.kernel.numerics.sincos import TWO_PI
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import BEFORE, SEGMENT_HOP_TIME, SEGMENT_MODES, SEGMENT_SLIP
from dimersweep.kernel.smooth_motion import only_grazes, resume_contact, set_contact
from dimersweep.kernel.verdict.past import begin_past

# phase by which a sample may find the end of a slip sooner than the run [rad], in units of rtol
EARLY = 10.0
MOST_GRAZES = 1000  # grazes in a contact phase
# time over which hops are followed, in units of the time that they take on a plate that does not change: that may be
# longer
HOPS_LAST = 2.0


@exported
def sample(row, segments, which, phases, rtol, space, record, states, modes, forces):
    """Fill in the kernel states of a run at given times.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    segments : float64 array, shape (n, N_SEGMENT)
        Starts of smooth phases (``record``); with the time of hops that were summed, if they are to be followed.
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
    forces : float64 array, shape (k, N_F), or empty
        Contact forces [N], filled in place if they are wanted; zero at ends in free motion.

    Returns
    -------
    int
        OK or the status of a time without a state, which is nan; the other times are sampled all the same.
    """
    dm, worst = space.dimer[0], OK
    set_dimer(row, dm)
    for k in range(phases.shape[0]):
        segment, state = segments[which[k]], states[k]
        copy(segment, state, N_STATE)
        modes[k, 0], modes[k, 1] = segment[SEGMENT_MODES], segment[SEGMENT_MODES + 1]
        motion = motion_of(state, modes[k], space.past, space)
        set_bound(motion.meter, inf)
        span = (phases[k] - state[PHASE]) / dm.omega
        status = OK
        free = modes[k, 0] == FREE and modes[k, 1] == FREE
        if 0.0 <= span < HOPS_LAST * segment[SEGMENT_HOP_TIME]:
            copy(row, space.row, N_ROW)
            status = follow_hops(dm, space, segment, motion, span, rtol, record)
            free = modes[k, 0] == FREE and modes[k, 1] == FREE
            if not free:
                set_contact(dm, state, modes[k], motion.contact)
        elif free:
            if span > 0.0:
                fly(dm, take_off(dm, state), state, span, True)
        else:
            begin_contact(dm, motion, segment, rtol)
            if span > 0.0:
                status = move_contact(dm, motion, span, rtol)
        if status != OK:
            for j in range(N_STATE):
                state[j] = nan
            worst = status
        elif not free and forces.shape[0] > 0:
            note_forces(dm, motion, forces[k])
    return worst


@compiled
def note_forces(dm, motion, forces):
    """Write the contact forces of the contact state, along the axis and across it; see `contact_rates`."""
    y = motion.contact
    if y[Y.chart] != BY_HEADING:
        change_chart(dm, end(dm, leading(motion.modes)).s, y)
    contact_rates(dm, motion.modes, motion.state[PHASE] + dm.phi0, y, False, motion.rates, forces)


@compiled
def follow_hops(dm, space, segment, motion, span, rtol, record):
    """Move the state on by `span` [s] from the close of a chatter, by a run through the hops that were summed there.

    Return the status of the run. A run ends with a forcing period. So that this period ends after `span`, the phase of
    the plate is counted from another moment during the run: the row of the workspace has a later start, and its later
    dimer is set from the row.
    """
    state, modes = motion.state, motion.modes
    for k in range(N1, CB + 1):
        state[k] = segment[BEFORE + k - N1]
    if span == 0.0:  # right after the bounce: ends that leave are free
        for i in range(2):
            if state[N1 + i] > 0.0:
                modes[i] = FREE
        return OK
    start, periods = state[PHASE], state[PERIOD]
    state[PHASE], state[PERIOD] = TWO_PI - dm.omega * span, 0.0
    start_later(space.row, start - state[PHASE])
    begin_past(motion.past[0])
    set_dimer(space.row, space.later_dimer[0])
    status, _ = evolve(space.later_dimer[0], RunRequest(1, rtol, rtol * rtol * rtol, False, True), motion, record)
    state[PHASE], state[PERIOD] = start + dm.omega * span, periods
    return status


@compiled
def move_contact(dm, motion, span, rtol):
    """Move the state of a contact phase on by a time in it, in place, by the steps that the run took; return a status.

    Forces that graze zero go on as in the run. An end that is about to land is not below the plate.
    """
    state, modes, y, done, event = motion.state, motion.modes, motion.contact, 0.0, NO_EVENT
    # the run had the rest of the forcing period before it: its steps were chosen for that
    whole = (TWO_PI - state[PHASE]) / dm.omega
    for _ in range(MOST_GRAZES):
        c = contact_later(dm, contact_of(dm, motion), done)
        t, event = sustain_contact(dm, c, whole - done, min(span, whole) - done, True, rtol, motion.work)
        done += t
        if not (is_lift_off(event) and only_grazes(dm, contact_later(dm, c, t), end_of(event))):
            break
    if y[Y.chart] == BY_HEADING:
        side = 1.0 if modes[0] != FREE else -1.0
        y[Y.dip] = side * max(0.0, side * y[Y.dip])
    kernel_state(dm, modes, y, state)
    state[PHASE] += dm.omega * span
    if event == OUT_OF_STEPS or dm.omega * (span - done) > max(MOMENT, EARLY * rtol):
        return STOPPED if motion.meter[0].stop else CONTACT_STEPS
    return OK


@compiled
def begin_contact(dm, motion, segment, rtol):
    """Set the contact state at the start of a phase as the run had it.

    The slip in the segment counts where slip sets out from rest: the velocities of the state have lost its direction to
    rounding. Runs that were saved by an earlier version have none (nan).
    """
    y, slip_a, slip_b = motion.contact, segment[SEGMENT_SLIP], segment[SEGMENT_SLIP + 1]
    resume_contact(dm, motion, rtol)
    if y[Y.chart] == BY_HEADING and slip_a == slip_a:
        y[Y.u_a], y[Y.u_b] = slip_a, slip_b


@compiled
def contact_later(dm, c, time):
    """Return the contact with the phase of the plate moved on by a time [s]."""
    return Contact(c.modes, c.phase + dm.omega * time, c.y, c.dy, c.F, c.slip_tol)
