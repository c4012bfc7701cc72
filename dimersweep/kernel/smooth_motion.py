"""Move a run on between its impacts: choose the contact that begins, and go to the next event."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.contact_mode import CLOSED, contact_mode, force_later
from dimersweep.kernel.contact.coordinates import Y, contact_state, kernel_state, leading
from dimersweep.kernel.contact.events import LANDING, NO_EVENT, OUT_OF_PROBES
from dimersweep.kernel.contact.forces import F1, F2, Pull, double_rates, hold_reserve, take_rates
from dimersweep.kernel.contact.phase import sustain_contact
from dimersweep.kernel.course import contact_of
from dimersweep.kernel.energy import begin_phase
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.flight.landing import MAX_LANDING_PROBES, next_landing
from dimersweep.kernel.model.body import kinetic, slip_rounding, turn_of_pair
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.layout import D1, D2, DIP, FREE, N1, N2, PHASE, STICK, THETA, WP
from dimersweep.kernel.model.plate import keeps_speed, lightest, most_along
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.sincos import TWO_PI

# slip that counts as none in contact, in units of the tolerance and the scale of velocities
SLIP_SCALE = 0.1
# difference of the gaps, in units of l, below which the other end lands too: about two units of round-off
COINCIDENT = 4e-16
FINER, FINEST = 1e-2, 1e-13  # tolerance of works over that of the run, and the least one
# work of a contact phase besides its steps, of a flight with its impact, and of a probe for a landing, in hops of one
# end
CONTACT_COST, HOP_COST, PROBE_COST = 3.0, 0.6, 0.12


@compiled
def no_slip(dm, state, rtol):
    """Return the slip that counts as none in contact [m/s]: below the tolerance, but clear of round-off."""
    return max(SLIP_SCALE * rtol * dm.v_scale, 32.0 * slip_rounding(dm, state))


@compiled(inline=True)
def find_contact(dm, c, state, event):
    """Choose the contact modes of the ends at rest on the plate; the contact state is set, and the state follows it.

    Returns
    -------
    int
        CLOSED, SEPARATES or INCONSISTENT.
    """
    modes, y = c.modes, c.y
    closed_1 = state[D1] == 0.0 and state[N1] == 0.0
    closed_2 = state[D2] == 0.0 and state[N2] == 0.0
    modes[0], modes[1] = FREE, FREE
    if not closed_1 and not closed_2:
        return CLOSED
    contact_state(dm, state, 0 if closed_1 else 1, y)
    if closed_1 and closed_2:
        y[Y.dip], y[Y.w_b] = 0.0, 0.0
    answer = contact_mode(dm, c, closed_1, closed_2, event)
    if answer == CLOSED:
        kernel_state(dm, modes, y, state)
    return answer


@compiled(inline=True)
def move_to_next_event(dm, request, motion):
    """Move to the next event or to the end of the forcing period, whichever is first.

    Returns
    -------
    int
        The event (`contact.events`), or NO_EVENT at the end of the period.
    """
    modes, course = motion.modes, motion.course[0]
    course.contact_before = coded(modes[0], modes[1])
    free = modes[0] == FREE and modes[1] == FREE
    if free:
        event = fly_to_landing(dm, motion, request.path)
    else:
        charge(motion.meter, CONTACT_COST)
        if not course.contact_is_set:
            resume_contact(dm, motion, request.rtol)
        event = follow_contact(dm, request, motion)
    course.contact_is_set = False
    return event


@compiled(inline=True)
def fly_to_landing(dm, motion, path):
    """Move freely to the next landing or to the end of the forcing period; return the event."""
    state = motion.state
    span = (TWO_PI - state[PHASE]) / dm.omega
    fl = take_off(dm, state)
    i, t, probes = next_landing(dm, fl, span)
    charge(motion.meter, HOP_COST + PROBE_COST * probes)
    if probes >= MAX_LANDING_PROBES:
        return OUT_OF_PROBES
    fly(dm, fl, state, min(t, span), path)
    if i < 0:
        return NO_EVENT
    touch(dm, state, i)
    return LANDING


@compiled
def touch(dm, state, i):
    """Close the gap of end i, which has landed, and also that of the other end if it is no higher, to rounding."""
    if state[D2 - i] - state[D1 + i] <= COINCIDENT * dm.l:
        state[D2 - i] = 0.0
    state[D1 + i] = 0.0
    if state[D1] == 0.0 and state[D2] == 0.0:
        state[DIP] = 0.0


@compiled
def resume_contact(dm, motion, rtol):
    """Set the contact state, and the slip that counts as none, of a phase under way."""
    motion.course[0].slip_tol = no_slip(dm, motion.state, rtol)
    set_contact(dm, motion.state, motion.modes, motion.contact)


@compiled(inline=True)
def set_contact(dm, state, modes, y):
    """Set the contact state of a phase under way from the kernel state."""
    contact_state(dm, state, leading(modes), y)
    clear_slip(dm, modes, y)


@compiled
def clear_slip(dm, modes, y):
    """Set the slip of a sticking end to exactly zero.

    It was zero, but for the rounding on the way to the kernel state and back.
    """
    if modes[0] == STICK or (modes[0] == FREE and modes[1] == STICK):
        y[Y.u_a], y[Y.u_b] = 0.0, 0.0
    elif modes[1] == STICK:
        y[Y.u_a] = 0.0
        y[Y.w_p] = turn_of_pair(dm, y[Y.u_b], y[Y.spin])


@compiled(inline=True)
def follow_contact(dm, request, motion):
    """Follow the contact phase to its next event, or to the end of the forcing period; return the event."""
    state, y, span = motion.state, motion.contact, (TWO_PI - motion.state[PHASE]) / dm.omega
    if motion.work.course[0].tally.wanted:
        # the tolerance of works is a share of the energy of the motion, and of a body that moves with the plate
        plate = 0.5 * dm.m * (dm.most_speed * dm.most_speed + dm.v_scale * dm.v_scale)
        energy = kinetic(dm, state) + plate
        motion.work.control[0].doubt = max(FINER * request.rtol, FINEST) * energy
        begin_phase(y, motion.work)
    t, event = sustain_contact(dm, contact_of(dm, motion), span, span, request.path, request.rtol, motion.work)
    if event == LANDING:
        y[Y.dip] = 0.0
    kernel_state(dm, motion.modes, y, state)
    state[PHASE] += dm.omega * t
    return event


@compiled(inline=True)
def only_grazes(dm, c, i):
    """Return True if the force at end i, zero now in the contact phase, is positive again a moment later."""
    take_rates(dm, c)
    return force_later(dm, c, i) > 0.0


@compiled
def rests_for_good(dm, motion):
    """Return True if both ends stick for good: friction and plate hold the rod at every moment of the cycle.

    The rod lies still, or rolls on at its speed, straight or as a cone. Its forces are linear in gravity and in the
    acceleration along the plate, so that they are judged at the worst of both.
    """
    modes, y = motion.modes, motion.contact
    if modes[0] != STICK or modes[1] != STICK or not keeps_speed(dm, motion.state[THETA], motion.state[WP]):
        return False
    lightest_g = lightest(dm)
    if lightest_g < 0.0:
        return False
    contact_state(dm, motion.state, 0, y)
    clear_slip(dm, modes, y)
    most = most_along(dm)
    # the four corners of a square around all directions: `most` bounds the acceleration along the plate in any of them
    for k in range(4 if most > 0.0 else 1):
        A_a, A_b = most * (1.0 - 2.0 * (k % 2)), most * (1.0 - 2.0 * (k // 2))
        double_rates(dm, modes, Pull(lightest_g, A_a, A_b), y, False, motion.rates, motion.forces)
        if min(motion.forces[F1], motion.forces[F2]) < 0.0 or hold_reserve(dm, modes, 0, motion.forces) < 0.0:
            return False
    return True
