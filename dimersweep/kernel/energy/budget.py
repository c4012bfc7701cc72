"""The energy budget of a recorded run: what the forces do in each smooth phase and in each impact."""

import numpy as np

from dimersweep.kernel.chatter import kinetic
from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.course import motion_of
from dimersweep.kernel.energy.contact_work import CONTACT_ROWS, contact_work
from dimersweep.kernel.energy.impact_work import (
    ALONG,
    IMPACT_ROWS,
    PLATE_1,
    PLATE_2,
    QP1,
    QP2,
    QSA,
    QSB1,
    QSB2,
    QX1,
    QX2,
    R_BODY,
    R_LATER,
    R_Q,
    R_SUM,
    UA,
    UB,
    UN,
    US,
    UWB,
    UWP,
    WORK_WIDTH,
    close_work,
    impact_phase,
)
from dimersweep.kernel.flight.free_motion import fly, take_off
from dimersweep.kernel.model.body import TWO_PI, attitude, extent, rise_of_centre, set_dimer
from dimersweep.kernel.model.contact_code import digits_of
from dimersweep.kernel.model.layout import (
    C_CHATTER_END,
    C_IMPACT,
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    IMPACT,
    N1,
    N2,
    N_STATE,
    PERIOD,
    PHASE,
    SPIN,
    THETA,
    WB,
    WP,
)
from dimersweep.kernel.model.plate import plate_rate, speed_bound, velocity_along
from dimersweep.kernel.numerics.sincos import sincos
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import (
    BEFORE,
    E_CAUSE,
    E_KIND,
    E_N1,
    E_N1_AFTER,
    E_N2,
    E_N2_AFTER,
    E_P1,
    E_P2,
    E_PERIOD,
    E_PHASE,
    SEGMENT_MODES,
)

FINER, FINEST = 1e-2, 1e-13  # accuracy of the budget over that of the run, and the best of it
ALL = -1  # in place of a number of a segment
digits_in = compiled(digits_of, inline=True)


def budget_scratch() -> np.ndarray:
    """Scratch array for `budget`."""
    return np.zeros((IMPACT_ROWS + CONTACT_ROWS, WORK_WIDTH))


@exported
def budget(row, segments, events, rtol, space, scratch, ends, smooth, flows, struck, leads_to):
    """Works of the forces in the smooth phases and impacts of a run.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    segments : float64 array, shape (n, N_SEGMENT)
        Starts of smooth phases (``record``); the last one is the end of the run.
    events : float64 array, shape (k, N_EVENT)
        The rows of the record, in order of time.
    rtol : float
        Accuracy of the run.
    space : Workspace
        Scratch.
    scratch : float64 array
        That of ``budget_scratch``.
    ends : float64 array, shape (n - 1, N_STATE)
        Filled with the states at the ends of the smooth phases, before an impact there.
    smooth : float64 array, shape (n - 1, N_WORK)
        Filled with the works in the smooth phases [J].
    flows : float64 array, shape (n - 1, N_WORK)
        Filled with what flows in them either way: the integrals of the powers' sizes [J].
    struck : float64 array, shape (k, N_WORK)
        Filled with the works in impacts and in closes of chatters [J], zero in other rows.
    leads_to : int64 array, shape (k,)
        Filled with the number of the segment that an event leads to; 0 up to the first one.

    Returns
    -------
    int
        ALL, or the number of the segment whose phase takes more steps than its bound; nothing is filled in after it.
    """
    dm, e, tol = space.dimer, 0, max(FINER * rtol, FINEST)
    set_dimer(row, dm)
    while e < events.shape[0] and not is_later(events[e], segments[0]):
        leads_to[e] = 0
        e += 1
    for n in range(segments.shape[0] - 1):
        segment, state, later = segments[n], ends[n], segments[n + 1]
        copy(segment, state, N_STATE)
        space.modes[0], space.modes[1] = segment[SEGMENT_MODES], segment[SEGMENT_MODES + 1]
        motion = motion_of(state, space.modes, space.past, space)
        turn = TWO_PI * (later[PERIOD] - segment[PERIOD]) + later[PHASE] - segment[PHASE]
        span = turn / dm.omega
        if span > 0.0 and motion.modes[0] == FREE and motion.modes[1] == FREE:
            fly(dm, take_off(dm, state), state, span, True)
        elif span > 0.0:
            unit = kinetic(dm, state) + 0.5 * dm.m * (speed_bound(dm) ** 2 + dm.v_scale**2)
            if not contact_work(dm, motion, span, rtol, tol, unit, scratch[IMPACT_ROWS:], smooth[n], flows[n]):
                return n
        e = strike(dm, state, later, events, e, n + 1, tol, scratch, struck, leads_to)
    return ALL


@compiled
def is_later(event, segment):
    """Whether an event comes after the start of a segment."""
    if event[E_PERIOD] == segment[PERIOD]:
        return event[E_PHASE] > segment[PHASE]
    return event[E_PERIOD] > segment[PERIOD]


@compiled
def body_velocities(dm, state, skip, u):
    """Velocities of the body of a kernel state that begins after `skip` numbers."""
    u[UN], u[UA], u[UB] = rise_of_centre(dm, state[skip + N1], state[skip + N2]), state[skip + CA], state[skip + CB]
    u[UWB], u[UWP], u[US] = state[skip + WB], state[skip + WP], state[skip + SPIN]


@compiled
def fastest(dm, u):
    """A bound of the speed of any point of the body [m s-1]."""
    r, h = extent(dm)
    return abs(u[UN]) + abs(u[UA]) + abs(u[UB]) + (r + h) * (abs(u[UWB]) + abs(u[UWP])) + r * abs(u[US])


@compiled
def strike(dm, state, later, events, e, n, tol, scratch, struck, leads_to):
    """Works of the impacts from the end of a phase to the start of the next one, number n; returns the next event row.

    `tol` is the slip that counts as none, in units of the fastest speed.
    """
    u, q = scratch[R_BODY], scratch[R_Q]
    sin_b, cos_b = attitude(dm, state[DIP])
    body_velocities(dm, state, 0, u)
    begun, V = False, 0.0
    while e < events.shape[0] and not is_later(events[e], later):
        event, done = events[e], struck[e]
        leads_to[e] = n
        digit_1, digit_2 = digits_in(int(event[E_KIND]))
        strikes = event[E_CAUSE] == C_IMPACT and (digit_1 > IMPACT or digit_2 > IMPACT)
        if strikes:
            if not begun:
                q[QX1], q[QX2], V, begun = 0.0, 0.0, fastest(dm, u), True
            before, after = (event[E_N1], event[E_N2]), (event[E_N1_AFTER], event[E_N2_AFTER])
            P = (event[E_P1], event[E_P2])
            impact_phase(dm, digit_1, digit_2, before, after, P, sin_b, cos_b, V, tol, u, scratch, done)
        elif event[E_CAUSE] == C_CHATTER_END:
            body_velocities(dm, later, BEFORE - N1, u)
            body_velocities(dm, later, 0, scratch[R_LATER])
            closed_1, closed_2 = later[D1] == 0.0 and later[N1] == 0.0, later[D2] == 0.0 and later[N2] == 0.0
            close_work(dm, closed_1, closed_2, sin_b, cos_b, u, scratch[R_LATER], scratch, done)
        if strikes or event[E_CAUSE] == C_CHATTER_END:
            given = scratch[R_SUM]
            rise = plate_rate(dm, later[PHASE] + dm.phi0)
            done[PLATE_1], done[PLATE_2] = given[QP1] * rise, given[QP2] * rise
            if dm.sideways != 0.0:
                v_x, v_y = velocity_along(dm, later[PHASE] + dm.phi0)
                sin_t, cos_t = sincos(later[THETA])
                side = given[QSB1] + given[QSB2]
                done[ALONG] = given[QSA] * (v_y * cos_t - v_x * sin_t) + side * (v_x * cos_t + v_y * sin_t)
        e += 1
    return e
