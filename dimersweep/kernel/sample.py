"""States of a recorded run at any time: each is moved again from the start of the smooth phase it lies in.

A contact phase takes the steps of the run, and looks for its event as the run does, so that just before an event the state
comes to what the run found there: no end is below the plate, no slip has turned round. The hops that the close of a chatter
has summed are followed one by one.
"""

from math import nan

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.contact.contact_mode import CLOSED, MOMENT
from dimersweep.kernel.contact.coordinates import (
    BY_HEADING,
    YB,
    YCHART,
    load,
    unload,
)
from dimersweep.kernel.contact.events import (
    HOLD_LOST,
    LANDS,
    LIFTS,
    SLIP_ZERO,
    slip_speed,
)
from dimersweep.kernel.contact.phase import NO_EVENT, OUT_OF_STEPS, glide
from dimersweep.kernel.event_loop import (
    ROW_BEFORE,
    ROW_Y,
    choose,
    evolve,
    hold_rest,
    no_slip,
    only_touched,
)
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.model.body import TWO_PI, as_dimer
from dimersweep.kernel.model.layout import (
    CB,
    CONTACT_STEPS,
    FREE,
    N1,
    N_ROW,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    ROW,
)
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import BEFORE, MODES, REST
from dimersweep.kernel.verdict.classify import begin_past

ROW_TRIAL, ROW_LATER = ROW_BEFORE + 1, ROW_BEFORE + 2
PHI0 = ROW.index("phi0")
HOPS_LAST = 2.0  # hops are followed for so long, in units of the time that they take when the plate does not change


@compiled
def begin(dm, state, modes, slip_tol, work):
    """Contact state at the start of a phase, on the desk.

    A slip that sets out from rest is chosen again: its direction is lost in the rounding of the state.
    """
    y, trial = work[ROW_Y], work[ROW_TRIAL]
    unload(dm, state, -1.0 if modes[0] != FREE else 1.0, y)
    hold_rest(dm, modes, y)
    speed, _ = slip_speed(dm, modes, y, y)
    if speed <= slip_tol:
        answer = choose(dm, state, trial, True, slip_tol, work)
        if answer != CLOSED or trial[0] != modes[0] or trial[1] != modes[1]:
            unload(dm, state, -1.0 if modes[0] != FREE else 1.0, y)


@compiled
def follow(dm, state, modes, span, rtol, work):
    """Move the state of a contact phase on by a time in it, in place; returns whether that took no more steps than allowed.

    An event before that time is the end of the phase, found a hair too early, or one that the run has passed by: a slip that
    is over stays so, all else goes on, but no end goes below the plate.
    """
    y, slip_tol = work[ROW_Y], no_slip(dm, state, rtol)
    begin(dm, state, modes, slip_tol, work)
    phase, done, side = state[PHASE] + dm.phi0, 0.0, 1.0 if modes[0] != FREE else -1.0
    t, event = glide(dm, modes, y, phase, span, True, rtol, slip_tol, True, work)
    while LIFTS <= event < HOLD_LOST and only_touched(dm, modes, event % 2, phase + dm.omega * (done + t), work):
        done += t
        brief = min(MOMENT / dm.omega, span - done)
        glide(dm, modes, y, phase + dm.omega * done, brief, True, rtol, slip_tol, False, work)
        done += brief
        t, event = glide(dm, modes, y, phase + dm.omega * done, span - done, True, rtol, slip_tol, True, work)
    done += t
    if SLIP_ZERO <= event < LANDS and dm.omega * (span - done) > MOMENT:  # passed by: all again, with no events in view
        begin(dm, state, modes, slip_tol, work)
        done, event = 0.0, LANDS
    if event != NO_EVENT and not SLIP_ZERO <= event < LANDS:
        _, event = glide(dm, modes, y, phase + dm.omega * done, span - done, True, rtol, slip_tol, False, work)
        if y[YCHART] == BY_HEADING:
            y[YB] = side * max(0.0, side * y[YB])
    load(dm, modes, y, state)
    state[PHASE] += dm.omega * span
    return event != OUT_OF_STEPS


@compiled
def hop(row, omega, segment, state, modes, span, rtol, past, work, counts):
    """Move the state on by a time from the close of a chatter, through the hops that were summed there; returns a status.

    The plate's phase is counted anew, so that a forcing period ends at the time wanted.
    """
    for k in range(N1, CB + 1):
        state[k] = segment[BEFORE + k - N1]
    later, none = work[ROW_LATER, :N_ROW], work[:0]
    start, periods = state[PHASE], state[PERIOD]
    state[PHASE], state[PERIOD] = TWO_PI - omega * span, 0.0
    copy(row, later, N_ROW)
    later[PHI0] += start - state[PHASE]
    begin_past(past)
    status, _ = evolve(
        as_dimer(later), state, modes, 1, rtol, rtol**3, False, True, past, work, none, none, none, counts
    )
    state[PHASE], state[PERIOD] = start + omega * span, periods
    return status


@exported
def sample(row, segments, which, phases, rtol, past, work, counts, states, modes):
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
    past, work, counts : arrays
        Scratch, as of ``evolve``.
    states : float64 array, shape (k, N_STATE)
        Filled in place.
    modes : float64 array, shape (k, 2)
        Friction modes of the ends, filled in place.

    Returns
    -------
    int
        OK or the reason why not; the other times are sampled all the same.
    """
    dm = as_dimer(row)
    status = OK
    for k in range(phases.shape[0]):
        segment, state, mode = segments[which[k]], states[k], modes[k]
        copy(segment, state, N_STATE)
        mode[0], mode[1] = segment[MODES], segment[MODES + 1]
        span = (phases[k] - state[PHASE]) / dm.omega
        done = OK
        if 0.0 < span < HOPS_LAST * segment[REST]:
            done = hop(row, dm.omega, segment, state, mode, span, rtol, past, work, counts)
        elif span > 0.0 and mode[0] == FREE and mode[1] == FREE:
            fly(dm, take_off(dm, state), state, span, True)
        elif span > 0.0 and not follow(dm, state, mode, span, rtol, work):
            done = CONTACT_STEPS
        if done != OK:
            for j in range(N_STATE):
                state[j] = nan
            status = done
    return status
