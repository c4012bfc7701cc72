"""The event loop of one run: collide, come to rest, choose the contact mode, move to the next event."""

from math import cos, hypot, isfinite, sin, sqrt

from dimersweep.kernel.chatter import come_to_rest, kinetic
from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.contact_mode import (
    CLOSED,
    INCONSISTENT,
    MOMENT,
    contact_mode,
)
from dimersweep.kernel.contact.coordinates import (
    YB,
    YUA,
    YUB,
    YWB,
    YWP,
    load,
    unload,
)
from dimersweep.kernel.contact.events import (
    HOLD_LOST,
    JAMS,
    LANDS,
    SLIP_ZERO,
)
from dimersweep.kernel.contact.forces import F1, contact_rates
from dimersweep.kernel.contact.phase import (
    GLIDE_ROWS,
    NO_EVENT,
    OUT_OF_STEPS,
    glide,
)
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.flight.landing import MAX_PROBES, next_landing
from dimersweep.kernel.impact.impact import (
    contact_velocity,
    double_impact,
    rounding,
    single_impact,
)
from dimersweep.kernel.model.body import TWO_PI
from dimersweep.kernel.model.layout import (
    BETA,
    C_CHATTER_END,
    C_END,
    C_IMPACT,
    C_LIFT_OFF,
    C_SLIP,
    C_START,
    C_STICK,
    CA,
    CB,
    CONTACT_STEPS,
    D1,
    D2,
    FREE,
    JAMMED,
    MAX_EVENTS,
    N1,
    N2,
    N_STATE,
    NOT_FINITE,
    OK,
    PERIOD,
    PHASE,
    RECORD_FULL,
    ROOT_STEPS,
    STICK,
)
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import note_event, note_segment
from dimersweep.kernel.verdict.classify import (
    note_impact,
    note_landing,
    note_period,
    note_take_off,
    rests_for_good,
    settled_period,
    time_of,
)

WORK, WORK_PER_PERIOD = 5_000_000, 100_000  # bound on events, in hops of one end: some seconds, and 0.1 s a period
GLIDE_WORK, PAIR_WORK = 30, 20  # hops that take as long as a contact phase, as an impact at both ends
LOOSEST = 1e-3  # relative tolerance of an impact, however slow
SLIP_SCALE = 0.1  # slip that counts as none in contact, in units of the tolerance and g/omega
COINCIDENT = 4e-16  # gap, in units of l, that counts as closed when the other end lands
WORK_ROWS, WORK_COLUMNS = GLIDE_ROWS + 8, 16
ROW_Y, ROW_DY, ROW_F, ROW_BEFORE = GLIDE_ROWS, GLIDE_ROWS + 1, GLIDE_ROWS + 2, GLIDE_ROWS + 3


@compiled
def start_state(dm, beta0, xdot0, state):
    """Section 7 of the start: p1 on the plate, the rod at beta0 along Y, the balls moving sideways with xdot0."""
    for k in range(N_STATE):
        state[k] = 0.0
    plate = dm.A_z * dm.omega * cos(dm.phi0)
    state[D2] = 2.0 * dm.h * sin(beta0)
    state[N1] = state[N2] = -plate
    state[BETA] = beta0
    state[CB] = xdot0


@compiled
def no_slip(dm, state, rtol):
    """Slip that counts as none in contact [m/s]: below the tolerance, but clear of round-off."""
    return max(SLIP_SCALE * rtol * dm.v_scale, 32.0 * rounding(dm, state))


@compiled
def contact_code(modes):
    """Contact state of Table 1 between impacts."""
    return int(5 * modes[0] + modes[1])


@compiled
def collide(dm, state, modes, tol, fastest, work, log):
    """Resolve the impact of the closed ends that approach; the state and the friction modes are updated.

    Parameters
    ----------
    fastest : float
        Greatest speed in the plate's frame so far [m/s]: a motion that has always been slow has its own measure of small.

    Returns
    -------
    status, rows : int
        OK or the reason; rows of the impact's log.
    """
    closed_1, closed_2 = state[D1] == 0.0, state[D2] == 0.0
    V = 0.0
    if closed_1:
        V = max(V, -state[N1])
    if closed_2:
        V = max(V, -state[N2])
    # velocities have an absolute tolerance: the small impacts of a chatter need few digits of their own
    tol = min(LOOSEST, tol * max(1.0, min(dm.v_scale, fastest) / V))
    if closed_1 and closed_2:
        state[BETA] = 0.0
        return double_impact(dm, state, V, tol, modes, work, log)
    i = 0 if closed_1 else 1
    status, mode, rows = single_impact(dm, state, -1.0 if closed_1 else 1.0, V, tol, work, log)
    modes[0], modes[1] = FREE, FREE
    modes[i] = mode
    return status, rows


@compiled
def choose(dm, state, modes, lost, slip_tol, work):
    """Contact modes of the ends at rest on the plate; the state follows them.

    Returns
    -------
    int
        CLOSED, SEPARATES or INCONSISTENT.
    """
    y, dy, F = work[ROW_Y], work[ROW_DY], work[ROW_F]
    closed_1 = state[D1] == 0.0 and state[N1] == 0.0
    closed_2 = state[D2] == 0.0 and state[N2] == 0.0
    modes[0], modes[1] = FREE, FREE
    if not closed_1 and not closed_2:
        return CLOSED
    unload(dm, state, -1.0 if closed_1 else 1.0, y)
    if closed_1 and closed_2:
        y[YB], y[YWB] = 0.0, 0.0
    answer = contact_mode(dm, closed_1, closed_2, state[PHASE] + dm.phi0, y, modes, slip_tol, lost, dy, F)
    if answer == CLOSED:
        load(dm, modes, y, state)
    return answer


@compiled
def move(dm, state, modes, chosen, path, tol, slip_tol, work):
    """Move to the next event or to the end of the forcing period, whichever is first.

    Parameters
    ----------
    chosen : bool
        The contact modes have just been chosen, and the contact state stands on the desk: it holds slips that a detour
        through the kernel state would drown in round-off.

    Returns
    -------
    event : int
        Event number of ``glide`` (a landing of p2 or p1 is LANDS), or NO_EVENT at the end of the period.
    status : int
    """
    span = (TWO_PI - state[PHASE]) / dm.omega
    if modes[0] == FREE and modes[1] == FREE:
        fl = take_off(dm, state)
        sign, t, probes = next_landing(fl, span)
        if probes == MAX_PROBES:
            return NO_EVENT, ROOT_STEPS
        fly(dm, fl, state, min(t, span), path)
        if sign == 0.0:
            return NO_EVENT, OK
        touch(dm, state, sign)
        return LANDS, OK
    y = work[ROW_Y]
    if not chosen:
        unload(dm, state, -1.0 if modes[0] != FREE else 1.0, y)
        hold_rest(dm, modes, y)
    t, event = glide(dm, modes, y, state[PHASE] + dm.phi0, span, path, tol, slip_tol, True, work)
    if event == LANDS:
        y[YB] = 0.0
    load(dm, modes, y, state)
    state[PHASE] += dm.omega * t
    if event == OUT_OF_STEPS:
        return NO_EVENT, CONTACT_STEPS
    return event, OK


@compiled
def hold_rest(dm, modes, y):
    """Make the slip of a sticking end exactly zero (it was, but for the rounding of ``load`` and ``unload``)."""
    if modes[0] == STICK or (modes[0] == FREE and modes[1] == STICK):
        y[YUA], y[YUB] = 0.0, 0.0
    elif modes[1] == STICK:
        y[YUA] = 0.0
        y[YWP] = y[YUB] / (2.0 * dm.h)


@compiled
def touch(dm, state, sign):
    """Close the gap of the end that has landed, and the other one too if it is no higher, to rounding."""
    near = COINCIDENT * 2.0 * dm.h
    landed, other = (D1, D2) if sign < 0.0 else (D2, D1)
    if state[other] - state[landed] <= near:
        state[other] = 0.0
    state[landed] = 0.0
    if state[D1] == 0.0 and state[D2] == 0.0:
        state[BETA] = 0.0


@compiled
def force_impact(dm, state):
    """Set a vanishing approach at the ends whose contact law has no force: what follows is an impact without collision."""
    for i in range(2):
        if state[D1 + i] == 0.0 and state[N1 + i] == 0.0:
            _, a, b = contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
            state[N1 + i] = -1e-9 * hypot(a, b)


@compiled
def only_touched(dm, modes, i, phase, work):
    """Whether the force at end i, zero now in the contact phase on the desk, is positive again a moment later."""
    F = work[ROW_F]
    contact_rates(dm, modes, phase + MOMENT, work[ROW_Y], False, work[ROW_DY], F)
    return F[F1 + 3 * i] > 0.0


@compiled
def pass_over(dm, state, modes, path, tol, slip_tol, work):
    """Go on over that moment in the contact phase on the desk."""
    y = work[ROW_Y]
    span = min(MOMENT, TWO_PI - state[PHASE]) / dm.omega
    t, _ = glide(dm, modes, y, state[PHASE] + dm.phi0, span, path, tol, slip_tol, False, work)
    load(dm, modes, y, state)
    state[PHASE] += dm.omega * t


@compiled
def cause_of(event):
    """Why an event row is written, from the event number of a contact phase."""
    if event < HOLD_LOST:
        return C_LIFT_OFF
    return C_SLIP if event < SLIP_ZERO else C_STICK


@compiled
def evolve(dm, state, modes, periods, rtol, close, settle, path, past, work, log, events, segments, counts):
    """Run from a state to `periods` completed forcing periods, or until the motion has settled.

    Parameters
    ----------
    state, modes : float64 arrays, shapes (N_STATE,), (2,)
        Modified in place.
    rtol, close : float
        The one accuracy knob, and the accuracy of the close of a chatter: less where its hops are to be followed further.
    settle : bool
        Stop when the motion is known: at once where it rests for good and no path is wanted, that forcing period counting
        as completed; else at the end of a period.
    path : bool
        Whether x1, y1 and gamma are wanted.
    past : float64 array, shape (PAST_ROWS, PAST_COLUMNS)
        What the verdict needs (``fate``), modified in place.
    work : float64 array, shape (WORK_ROWS, WORK_COLUMNS)
    log : float64 array, shape (n, N_LOG)
        Phases of one impact; no rows if no record is wanted.
    events, segments : float64 arrays
        The record (``record``); no rows if none is wanted.
    counts : int64 array, shape (3,)
        Number of events, event rows and segments, modified in place.

    Returns
    -------
    status, at_rest : int, bool
    """
    work_left = WORK + WORK_PER_PERIOD * periods
    record = segments.shape[0] > 0
    none = log[0, :0] if record else state[:0]
    pending, lost, cause, rest = True, False, C_START, 0.0
    forced, told, fastest = 0, -1, 0.0
    before, begun = contact_code(modes), counts[0]
    while state[PERIOD] < periods:
        if work_left < 0:
            return MAX_EVENTS, False
        if (state[D1] == 0.0 and state[N1] < 0.0) or (state[D2] == 0.0 and state[N2] < 0.0):
            counts[0] += 1
            work_left -= PAIR_WORK if state[D1] == state[D2] else 0
            energy = kinetic(dm, state)
            fastest = max(fastest, sqrt(2.0 * energy * dm.im))
            status = strike(dm, state, modes, before, rtol, fastest, past, work, log, events, counts)
            if status != OK:
                return status, False
            pending, lost, cause = True, False, C_IMPACT
            if record:
                copy(state, work[ROW_BEFORE], N_STATE)
            slip_tol = no_slip(dm, state, rtol)
            rest = come_to_rest(
                dm, state, modes, slip_tol, close, counts[0] - begun, energy, work[ROW_Y], work[ROW_DY], work[ROW_F]
            )
            if rest >= 0.0:
                cause = C_CHATTER_END
            before = 0
        slip_tol = no_slip(dm, state, rtol)
        chosen = pending
        if pending:
            answer = choose(dm, state, modes, lost, slip_tol, work)
            if answer == INCONSISTENT:
                forced += 1
                if forced > 20:
                    return JAMMED, False
                force_impact(dm, state)
                continue
            forced = 0
            if record:
                after = contact_code(modes)
                if cause != C_IMPACT or after != 0:
                    counts[1] = note_event(dm, events, counts[1], state, cause, after, before, after, none)
                hops = rest if cause == C_CHATTER_END else 0.0
                counts[2] = note_segment(segments, counts[2], state, modes, hops, work[ROW_BEFORE])
                if counts[1] > events.shape[0] or counts[2] > segments.shape[0]:
                    return RECORD_FULL, False
            note_flights(dm, state, modes, past)
            pending = False
            if settle and told < 0 and rests_for_good(dm, state, modes):
                told = counts[0]
                if not path:
                    break
        before = contact_code(modes)
        work_left -= GLIDE_WORK if before > 0 else 1
        event, status = move(dm, state, modes, chosen, path, rtol, slip_tol, work)
        if status != OK:
            return status, False
        if event == JAMS:  # the force of a slip grows beyond all bounds: an impact without collision follows
            counts[0] += 1
            force_impact(dm, state)
            continue
        if event == NO_EVENT:
            state[PHASE] = 0.0
            state[PERIOD] += 1.0
            begun = counts[0]
            if not isfinite(state[BETA] + state[D1] + state[D2] + state[N1] + state[N2] + state[CA] + state[CB]):
                return NOT_FINITE, False
            note_period(dm, state, modes, past)
            if record:
                counts[2] = note_segment(segments, counts[2], state, modes, 0.0, state)
            if settle and (told >= 0 or rests_for_good(dm, state, modes) or settled_period(past) > 0):
                break
        else:
            counts[0] += 1
            if event < HOLD_LOST and only_touched(dm, modes, event % 2, state[PHASE] + dm.phi0, work):
                pass_over(dm, state, modes, path, rtol, slip_tol, work)
                continue
            pending, lost = True, HOLD_LOST <= event < SLIP_ZERO
            if event != LANDS:
                cause = cause_of(event)
    if record:
        counts[1] = note_event(
            dm, events, counts[1], state, C_END, contact_code(modes), before, contact_code(modes), none
        )
        counts[2] = note_segment(segments, counts[2], state, modes, 0.0, state)
        if counts[1] > events.shape[0] or counts[2] > segments.shape[0]:
            return RECORD_FULL, False
    if told < 0:
        return OK, rests_for_good(dm, state, modes)
    counts[0] = told
    if not path:
        state[PHASE] = 0.0
        state[PERIOD] += 1.0
        note_period(dm, state, modes, past)
    return OK, True


@compiled
def strike(dm, state, modes, before, rtol, fastest, past, work, log, events, counts):
    """An impact with all that is kept of it: landings, the double event, the rows of the record."""
    now = time_of(state, dm.omega, dm.T)
    double = state[D1] == 0.0 and state[D2] == 0.0
    long_flight, lander = False, 0
    for i in range(2):
        if state[D1 + i] == 0.0:
            if note_landing(dm, past, i, now):
                long_flight, lander = True, i
            elif state[N1 + i] < 0.0 and not long_flight:
                lander = i
    other_down = past[0, 1 - lander] < 0.0 or now - past[0, 1 - lander] < 0.5 * dm.T
    status, rows = collide(dm, state, modes, rtol, fastest, work, log)
    note_impact(dm, state, past, double, lander, long_flight and other_down, now)
    if log.shape[0] > 0:
        for k in range(rows):
            after = log[k + 1, 0] if k + 1 < rows else 0.0
            counts[1] = note_event(dm, events, counts[1], state, C_IMPACT, log[k, 0], before, after, log[k])
            before = int(log[k, 0])
    return status


@compiled
def note_flights(dm, state, modes, past):
    """Note the ends that are off the plate from now on."""
    now = time_of(state, dm.omega, dm.T)
    for i in range(2):
        if modes[i] == FREE:
            note_take_off(past, i, now)
