"""What the peer on heyoka borrows from the package: all that happens between two smooth phases, compiled into one call."""

from math import copysign

from dimersweep.kernel.body import as_dimer
from dimersweep.kernel.charts import N_PATH, YB, YGAMMA, YS, YTIME, load, slip_of
from dimersweep.kernel.chatter import come_to_rest
from dimersweep.kernel.choose import INCONSISTENT
from dimersweep.kernel.engine import (
    ROW_DY,
    ROW_F,
    ROW_Y,
    choose,
    collide,
    force_impact,
    no_slip,
    start_state,
    touch,
)
from dimersweep.kernel.jit import compiled, exported
from dimersweep.kernel.layout import D1, D2, FREE, GAMMA, JAMMED, N1, N2, N_STATE, OK, PHASE, SLIP, SPIN, STICK, WB
from dimersweep.kernel.plate import effective_gravity
from dimersweep.kernel.watch import HOLD_LOST, LANDS, SLIP_ZERO, stop_slip

P_PHASE, P_SIDE, P_SLIP = range(3)
LIFT = 1e-15  # a gap that opens starts at this share of the hop's height: a root at zero hides the next one
OPEN = 1e-17  # and at this dip angle where it opens without a rate [rad]


@compiled
def take_over(dm, state, modes, ended, event, dt, y):
    """The state at the end of a phase, and what its event makes exact."""
    if modes[0] == FREE and modes[1] == FREE:
        for k in range(ended.size):
            state[D1 + k] = ended[k]
        state[SPIN] /= dm.r
        if D1 + ended.size > GAMMA:
            state[GAMMA] /= dm.r
        state[PHASE] += dm.omega * dt
        if event >= 0:
            touch(dm, state, 2.0 * event - 1.0)
        return
    for k in range(ended.size):
        y[k] = ended[k]
    y[YS] /= dm.r
    if ended.size > YGAMMA:
        y[YGAMMA] /= dm.r
    if event == LANDS:
        y[YB] = 0.0
    if SLIP_ZERO <= event < LANDS:
        stop_slip(dm, modes, y, event % 2)
    load(dm, modes, y, state)
    state[PHASE] += dm.omega * y[YTIME]


@compiled
def first_hop(dm, state, start):
    """Duration of the shortest hop that begins with this flight; its gap is set off from zero by nothing that matters."""
    hop = 0.0
    for i in range(2):
        rate = state[N1 + i]
        if state[D1 + i] > 0.0:
            continue
        start[i] = OPEN * dm.h
        if rate > 0.0:
            fall = effective_gravity(dm, state[PHASE] + dm.phi0) + dm.h * state[WB] ** 2
            time = 2.0 * rate / max(fall, 1e-3 * dm.g)
            start[i] = LIFT * 0.5 * rate * time
            hop = time if hop == 0.0 else min(hop, time)
    return hop


@compiled
def begin(dm, state, modes, y, start, pars):
    """The start of a phase for its integrator; returns the duration of the hop that begins, 0.0 if none does.

    The integrator has the spin and its angle in units of 1/r: the largest number of its state rules its steps.
    """
    if modes[0] == FREE and modes[1] == FREE:
        for k in range(D1, N_STATE - 1):
            start[k - D1] = state[k]
        start[SPIN - D1] *= dm.r
        start[GAMMA - D1] *= dm.r
        return first_hop(dm, state, start)
    for k in range(N_PATH):
        start[k] = y[k]
    start[YS] *= dm.r
    start[YGAMMA] *= dm.r
    if modes[0] == SLIP and modes[1] == STICK:
        _, b = slip_of(dm, modes, y, 0)
        pars[P_SIDE] = copysign(1.0, b)
    elif modes[0] == STICK and modes[1] == SLIP:
        _, b = slip_of(dm, modes, y, 1)
        pars[P_SIDE] = copysign(1.0, b)
    elif modes[0] == FREE or modes[1] == FREE:
        side = 1.0 if modes[1] == FREE else -1.0
        if start[YB] == 0.0:
            start[YB] = side * OPEN
    return 0.0


@exported
def cross(row, state, modes, ended, event, dt, rtol, doubles, count, start, pars, work, log):
    """Everything between two phases: the end of one, impacts, the close of a chatter, the choice of the next contact mode.

    Parameters
    ----------
    ended : float64 array
        State of the integrator of the phase that has ended.
    event, dt : int, float
        Number of the event and duration of that phase [s]; a negative number at the start of a run.
    doubles : float64 array
        Times of double impacts, filled from `count` on.
    start, pars : float64 arrays, shapes (N_STATE,), (4,)
        Filled with the start of the next phase and its parameters.

    Returns
    -------
    status, count : int
    hop : float
        Duration of the hop that begins [s]; 0.0 if none does.
    """
    dm = as_dimer(row)
    y = work[ROW_Y]
    lifted, lost, forced = -1, False, 0
    if event >= 0:
        take_over(dm, state, modes, ended, event, dt, y)
        if modes[0] != FREE or modes[1] != FREE:
            lifted = event % 2 if event < HOLD_LOST else -1
            lost = HOLD_LOST <= event < SLIP_ZERO
    while True:
        if (state[D1] == 0.0 and state[N1] < 0.0) or (state[D2] == 0.0 and state[N2] < 0.0):
            if state[D1] == 0.0 and state[D2] == 0.0 and count < doubles.size:
                doubles[count] = state[PHASE] / dm.omega
                count += 1
            status, _ = collide(dm, state, modes, rtol, work, log)
            if status != OK:
                return status, count, 0.0
            lifted, lost = -1, False
            come_to_rest(dm, state, modes, no_slip(dm, state, rtol), rtol, y, work[ROW_DY], work[ROW_F])
        slip_tol = no_slip(dm, state, rtol)
        if choose(dm, state, modes, lifted, lost, slip_tol, work) != INCONSISTENT:
            break
        forced += 1
        if forced > 20:
            return JAMMED, count, 0.0
        force_impact(dm, state, modes, lifted)
    pars[P_PHASE], pars[P_SLIP] = state[PHASE] + dm.phi0, slip_tol
    hop = begin(dm, state, modes, y, start, pars)
    return OK, count, hop


@exported
def state_at(row, state, modes, now, event, dt, work, out):
    """The kernel's state in the midst of a phase, into `out`."""
    dm = as_dimer(row)
    for k in range(N_STATE):
        out[k] = state[k]
    take_over(dm, out, modes, now, -1, dt, work[ROW_Y])


@exported
def constants_of(row, beta0, xdot0, state, constants):
    """The start of a run into `state`, and the constants of the equations."""
    dm = as_dimer(row)
    start_state(dm, beta0, xdot0, state)
    constants[0], constants[1], constants[2], constants[3] = dm.h, dm.r, dm.m * dm.it, dm.m * dm.ia
    constants[4], constants[5], constants[6] = dm.mu, dm.mu_s, dm.g
    constants[7], constants[8] = dm.A_z * dm.omega * dm.omega, dm.omega
