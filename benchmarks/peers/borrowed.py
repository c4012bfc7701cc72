"""What the second peer on heyoka borrows from the engine: impacts, the close of a chatter, the choice of the contact mode."""

from passage import HOLD_LOST, P_PHASE, P_SLIP, SLIP_ZERO, as_body, begin, compiled, take_over

from dimersweep.kernel.chatter import come_to_rest, kinetic
from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.contact.contact_mode import INCONSISTENT
from dimersweep.kernel.course import ROW_CONTACT, motion_of
from dimersweep.kernel.event_loop import approaches, collide, force_impact
from dimersweep.kernel.model.body import set_dimer
from dimersweep.kernel.model.layout import D1, D2, FREE, N1, N2, OK, PHASE
from dimersweep.kernel.smooth_motion import find_contact, no_slip


@exported
def settle(row, state, modes, lost, rtol, space, log):
    """All that the engine does at an instant.

    Returns
    -------
    settled : bool
    slip_tol : float
        Slip that counts as none [m/s].
    """
    dm, motion = space.dimer, motion_of(state, modes, space.past, space)
    set_dimer(row, dm)
    y, dy, F = motion.contact, motion.rates, motion.forces
    for _ in range(20):
        if approaches(state):
            energy = kinetic(dm, state)
            status, _ = collide(dm, state, modes, rtol, dm.v_scale, motion.work, log)
            if status != OK:
                return False, 0.0
            lost = False
            come_to_rest(dm, state, modes, no_slip(dm, state, rtol), rtol, 0.0, energy, y, dy, F)
        slip_tol = no_slip(dm, state, rtol)
        if find_contact(dm, motion, modes, lost, slip_tol) != INCONSISTENT:
            return True, slip_tol
        force_impact(dm, state)
    return False, 0.0


@compiled
def settle_all(row, states, modes, lost, rtol, space, log):
    """Settle many instants, one after the other."""
    for k in range(len(states)):
        settle(row, states[k], modes[k], lost[k], rtol, space, log)


@compiled
def arrive(constants, state, modes, ended, event, dt, y):
    """The state at the end of a phase; whether a hold was lost there."""
    if event < 0:
        return False
    flew = modes[0] == FREE and modes[1] == FREE
    take_over(as_body(constants), state, modes, ended, event, dt, y)
    return not flew and HOLD_LOST <= event < SLIP_ZERO


@compiled
def cross(constants, row, rtol, space, log, state, modes, ended, event, dt, doubles, count, start, pars):
    """From the end of one phase to the start of the next, as `law.cross`."""
    body, y = as_body(constants), space.work.rows[ROW_CONTACT]
    lost = arrive(constants, state, modes, ended, event, dt, y)
    if state[D1] == 0.0 and state[D2] == 0.0 and min(state[N1], state[N2]) < 0.0 and count < doubles.size:
        doubles[count] = state[PHASE] / body.omega
        count += 1
    settled, slip_tol = settle(row, state, modes, lost, rtol, space, log)
    if not settled:
        return count, -1.0
    pars[P_PHASE], pars[P_SLIP] = state[PHASE] + body.phi0, slip_tol
    return count, begin(body, state, modes, y, start, pars)
