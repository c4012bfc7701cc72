"""The event loop of one run: resolve the impact, choose the contact, move to the next event, and follow it up."""

from math import isfinite, sqrt

from dimersweep.kernel import smooth_motion
from dimersweep.kernel.chatter import come_to_rest, note_close
from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact import events
from dimersweep.kernel.contact.contact_mode import INCONSISTENT
from dimersweep.kernel.contact.events import NO_EVENT
from dimersweep.kernel.course import BUDGET, BUDGET_PER_PERIOD, begin_course, contact_of
from dimersweep.kernel.energy import keep_phase, keep_struck
from dimersweep.kernel.impact.impact import double_impact, single_impact
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.body import attitude, contact_velocity, kinetic, lift
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, N1, N2, OK, PERIOD, PHASE, SPIN, THETA, WB, WP
from dimersweep.kernel.model.plate import plate_rate, velocity_along
from dimersweep.kernel.model.works import begin_tally
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.meter import charge, is_over, set_bound
from dimersweep.kernel.numerics.sincos import sincos
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import (
    EVENT_COUNT,
    EVENT_ROWS,
    SEGMENT_ROWS,
    is_full,
    is_kept,
    note_contact,
    note_event,
    note_impact_phases,
    note_segment,
)
from dimersweep.kernel.smooth_motion import no_slip, rests_for_good
from dimersweep.kernel.verdict.classify import stays_as_it_is
from dimersweep.kernel.verdict.past import note_contact_modes, note_impact, note_landings
from dimersweep.kernel.verdict.settling import note_period

# work of a choice of contact for two ends, which may have to find how they set out, in hops of one end
PAIR_COST = 6.0
LOOSEST = 1e-3  # relative tolerance of an impact at the loosest, however slow the impact
MOST_FORCED = 20  # impacts without collision in a row, after which the contact counts as jammed
# approach that stands for an impact without collision, in units of the slip: it must not count, nor drown in round-off
TURNED = 1e-9


@compiled
def evolve(dm, request, motion, record):
    """Run from a state to the end of the last forcing period asked for, or until its verdict is known.

    Parameters
    ----------
    dm : Dimer
    request : RunRequest
    motion : Motion
        Modified in place.
    record : Record
        Filled in place where it has rows.

    Returns
    -------
    status, at_rest : int, bool
        OK or the status of a run that could not go on; True if the dimer rests for good.
    """
    begin_course(motion.course[0], coded(motion.modes[0], motion.modes[1]), layout.C_START, record.counts[EVENT_COUNT])
    set_bound(motion.meter, BUDGET + BUDGET_PER_PERIOD * request.periods)
    tally = motion.work.course[0].tally
    tally.wanted = record.book.ends.shape[0] > 0
    while going_on(request, motion):
        if approaches(motion.state) and not resolve_impact(dm, request, motion, record):
            break
        if motion.course[0].pending and not choose_contact(dm, request, motion, record):
            continue
        event = smooth_motion.move_to_next_event(dm, request, motion)
        if tally.wanted:
            phase = record.counts[SEGMENT_ROWS] - 1
            keep_phase(record.book, phase, motion.state, motion.modes, motion.contact, motion.work)
        follow_up(dm, request, motion, record, event)
    tally.wanted = False
    return finish(dm, motion, record)


@compiled(inline=True)
def going_on(request, motion):
    """Return True if the run is to go on; set its status where it cannot."""
    course = motion.course[0]
    if course.status != OK or course.ended or motion.state[PERIOD] >= request.periods:
        return False
    if is_over(motion.meter):
        course.status = why_over(motion.meter)
    return course.status == OK


@compiled(inline=True)
def why_over(meter):
    """Return the status of a run whose meter is over."""
    return layout.STOPPED if meter[0].stop else layout.MAX_EVENTS


@compiled(inline=True)
def approaches(state):
    """Return True if a closed end moves into the plate."""
    return (state[D1] == 0.0 and state[N1] < 0.0) or (state[D2] == 0.0 and state[N2] < 0.0)


# --- impacts ----------------------------------------------------------------------------------------------------------


@compiled(inline=True)
def resolve_impact(dm, request, motion, record):
    """Resolve the impact of the closed ends that approach, and close a chatter that is as good as over.

    Return True if the run goes on.
    """
    state, past, course = motion.state, motion.past[0], motion.course[0]
    record.counts[EVENT_COUNT] += 1
    energy = kinetic(dm, state)
    past.fastest = max(past.fastest, sqrt(2.0 * energy * dm.im))
    course.status = noted_impact(dm, request, motion, record)
    if course.status != OK:
        return False
    course.pending, course.event, course.cause, course.contact_before = True, NO_EVENT, layout.C_IMPACT, 0.0
    if is_kept(record):
        copy(state, motion.before, layout.N_STATE)
    hops = record.counts[EVENT_COUNT] - course.period_events
    charge_pair(motion)
    course.slip_tol = no_slip(dm, state, request.rtol)
    course.hop_time = come_to_rest(dm, contact_of(dm, motion), state, request.close, hops, energy)
    if course.hop_time >= 0.0:
        course.cause = layout.C_CHATTER_END
        if motion.work.course[0].tally.wanted:
            note_close(dm, motion.before, state, motion.forces, motion.work)
    return True


@compiled(inline=True)
def noted_impact(dm, request, motion, record):
    """Resolve an impact and note all that is kept of it; return its status.

    These are the landings, the double event and the rows of the record.
    """
    state, past, course = motion.state, motion.past[0], motion.course[0]
    double = state[D1] == 0.0 and state[D2] == 0.0
    end, begins = note_landings(dm, past, state)
    status, rows = collide(dm, state, motion.modes, request.rtol, past.fastest, motion.work, record.log)
    note_impact(dm, state, past, double, end, begins)
    # an impact that is not over has no rows
    if status == OK:
        first = record.counts[EVENT_ROWS]
        note_impact_phases(dm, record, state, rows, course.contact_before)
        keep_struck(record.book, first, first + rows, record.counts[SEGMENT_ROWS], motion.work.rows)
    return status


@compiled
def collide(dm, state, modes, tol, fastest, work, log):
    """Resolve the impact of the closed ends that approach; the state and the friction modes are updated.

    `fastest` is the greatest speed in the plate's frame so far [m/s]: a motion that has always been slow has its own
    measure of small. Return a status, and the number of rows in the log of the impact.
    """
    closed_1, closed_2 = state[D1] == 0.0, state[D2] == 0.0
    if work.course[0].tally.wanted:
        begin_tally(dm, state, work.course[0].tally)
    V = max(-state[N1] if closed_1 else 0.0, -state[N2] if closed_2 else 0.0)
    # velocities have an absolute tolerance: the small impacts of a chatter need few digits of their own
    tol = min(LOOSEST, tol * max(1.0, min(dm.v_scale, fastest) / V))
    if closed_1 and closed_2:
        state[DIP] = 0.0
        return double_impact(dm, state, V, tol, modes, work, log)
    i = 0 if closed_1 else 1
    status, mode, rows = single_impact(dm, state, i, V, tol, work, log)
    modes[0], modes[1] = layout.FREE, layout.FREE
    modes[i] = mode
    return status, rows


@compiled
def force_impact(dm, state):
    """Set a vanishing approach at the ends whose contact law has no force: an impact without collision follows."""
    for i in range(2):
        if state[D1 + i] == 0.0 and state[N1 + i] == 0.0:
            _, a, b = contact_velocity(dm, state, i)
            state[N1 + i] = -TURNED * length(a, b)


# --- the contact of ends at rest on the plate ---------------------------------------------------------------------------


@compiled(inline=True)
def choose_contact(dm, request, motion, record):
    """Choose the contact of the ends at rest on the plate, and note the smooth phase that begins with it.

    Return True if the run moves on. It does not where an impact without collision has to come first, or where the
    record is full.
    """
    state, modes, course = motion.state, motion.modes, motion.course[0]
    course.slip_tol = no_slip(dm, state, request.rtol)
    charge_pair(motion)
    if smooth_motion.find_contact(dm, contact_of(dm, motion), state, course.event) == INCONSISTENT:
        course.forced += 1
        if course.forced > MOST_FORCED:
            course.status = layout.JAMMED
        else:
            force_impact(dm, state)
        return False
    course.forced, course.pending, course.contact_is_set = 0, False, True
    if course.cause == layout.C_CHATTER_END:
        row = record.counts[EVENT_ROWS]
        keep_struck(record.book, row, row + 1, record.counts[SEGMENT_ROWS], motion.work.rows)
    note_contact(dm, record, motion, coded(modes[0], modes[1]))
    if is_kept(record) and is_full(record):
        course.status = layout.RECORD_FULL
        return False
    note_contact_modes(dm, motion.past[0], state, modes)
    return True


@compiled(inline=True)
def charge_pair(motion):
    """Charge a choice of contact, if both ends are on the plate."""
    if motion.state[D1] == 0.0 and motion.state[D2] == 0.0:
        charge(motion.meter, PAIR_COST)


# --- what follows an event ----------------------------------------------------------------------------------------------


@compiled(inline=True)
def follow_up(dm, request, motion, record, event):
    """Follow an event up: it leads to an impact, the next forcing period, a new contact, or nothing."""
    course = motion.course[0]
    if events.is_failure(event):
        course.status = layout.CONTACT_STEPS if event == events.OUT_OF_STEPS else layout.ROOT_STEPS
    elif event == NO_EVENT:
        end_period(dm, request, motion, record)
    else:
        record.counts[EVENT_COUNT] += 1
        # at a jam the force of a slip grows beyond all bounds: an impact without collision follows
        if event == events.JAM:
            force_impact(dm, motion.state)
        elif not (
            events.is_lift_off(event) and smooth_motion.only_grazes(dm, contact_of(dm, motion), events.end_of(event))
        ):
            course.pending = True
            course.event = event
            if event != events.LANDING:
                course.cause = (
                    layout.C_STICK
                    if events.is_slip_end(event)
                    else (layout.C_SLIP if events.is_hold_end(event) else layout.C_LIFT_OFF)
                )


@compiled(inline=True)
def end_period(dm, request, motion, record):
    """End a forcing period: note a strobe of the motion, and end the run if its verdict is known."""
    state, modes, course = motion.state, motion.modes, motion.course[0]
    state[PHASE] = 0.0
    state[PERIOD] += 1.0
    course.period_events = record.counts[EVENT_COUNT]
    if not isfinite(state[DIP] + state[D1] + state[D2] + state[N1] + state[N2] + state[CA] + state[CB]):
        course.status = layout.NOT_FINITE
        return
    note_period(dm, state, modes, motion.past[0])
    course.contact_is_set = modes[0] != layout.FREE or modes[1] != layout.FREE
    # the slip in the row of the segment is that of the contact state: it is set before the row is written
    if course.contact_is_set:
        smooth_motion.resume_contact(dm, motion, request.rtol)
    note_segment(record, motion, 0.0)
    if request.settle and (
        rests_for_good(dm, motion) or stays_as_it_is(dm, motion.past[0], request.periods - int(state[PERIOD]))
    ):
        course.ended = True


# --- start and end of a run ---------------------------------------------------------------------------------------------


@compiled
def start_state(dm, row, state):
    """Set the start of a run.

    The lower end is at gap0 over the plate, the rod at beta0 along the heading theta0 (along Y where that is zero). The
    rates of x1, y1, beta, theta, gamma are those of the row and the rate of z1 is zero, all in the room.
    """
    beta0, xdot0, theta0, ydot0, betadot0, thetadot0, gammadot0, gap0 = row[layout.ROW_START :]
    for k in range(layout.N_STATE):
        state[k] = 0.0
    state[DIP], state[THETA] = beta0 - dm.beta_0, theta0
    rise = dm.l * lift(dm, state[DIP])
    state[D1], state[D2] = max(0.0, -rise) + gap0, max(0.0, rise) + gap0
    state[N1] = state[N2] = -plate_rate(dm, dm.phi0)
    v_x, v_y = velocity_along(dm, dm.phi0)
    # written so that v_y is -0.0 where both are zero, as in all earlier versions: results keep their bits
    v_x, v_y = xdot0 - v_x, -(v_y - ydot0)
    sin_t, cos_t = sincos(theta0)
    state[CA], state[CB] = v_y * cos_t - v_x * sin_t, v_x * cos_t + v_y * sin_t
    # rates turn the dimer about the centre of ball 1, whose velocity is kept
    if betadot0 != 0.0 or thetadot0 != 0.0 or gammadot0 != 0.0:
        sin_b, cos_b = attitude(dm, state[DIP])
        state[WB], state[WP], state[SPIN] = betadot0, thetadot0 * cos_b, gammadot0 + thetadot0 * sin_b
        state[N2] += dm.l * cos_b * state[WB]
        state[CA] += dm.p1.h * sin_b * state[WB]
        state[CB] += dm.p1.h * state[WP]


@compiled(inline=True)
def finish(dm, motion, record):
    """Write the last row of the record; return the status and whether the dimer rests for good, as `evolve` does."""
    state, modes, course = motion.state, motion.modes, motion.course[0]
    if course.status != OK:
        out_of_steps = course.status == layout.CONTACT_STEPS or course.status == layout.IMPACT_STEPS
        return why_over(motion.meter) if out_of_steps and is_over(motion.meter) else course.status, False
    note_event(dm, record, state, layout.C_END, course.contact_before, coded(modes[0], modes[1]))
    note_segment(record, motion, 0.0)
    if is_kept(record) and is_full(record):
        return layout.RECORD_FULL, False
    return OK, rests_for_good(dm, motion)
