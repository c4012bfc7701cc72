"""The kernel's verbs, callable from Python, for which most are not compiled in the program, to save time.

With the JIT off these are the plain functions. They have a folder of their own: compiled code is kept until a source of its
folder changes.
"""

import numpy as np

from dimersweep.kernel import batch, smooth_motion
from dimersweep.kernel.compiler.jit import exported, plain
from dimersweep.kernel.contact import contact_mode as contact_modes
from dimersweep.kernel.contact import coordinates, forces, phase
from dimersweep.kernel.course import motion_of, new_work, new_workspace
from dimersweep.kernel.flight import free_motion, landing
from dimersweep.kernel.impact import double_equations, impact, single_impact
from dimersweep.kernel.model import body, event_row, friction, plate
from dimersweep.kernel.model.layout import DIP, State
from dimersweep.kernel.numerics import elementary
from dimersweep.kernel.numerics import sincos as sines
from dimersweep.kernel.verdict import track
from dimersweep.parameters import Parameters


def called(verb):
    """A verb, compiled for Python too."""
    return exported(plain(verb))


set_pair = called(body.set_pair)
follow_track = called(track.follow_track)
track_of = called(track.track_of)
exp = called(elementary.exp)
log = called(elementary.log)
atan2 = called(elementary.atan2)
raised = called(elementary.raised)
multiplied = called(elementary.multiplied)
nearest = called(sines.nearest)
keep_one_nan = called(batch.keep_one_nan)
delassus = called(body.delassus)
take_off = called(free_motion.take_off)
collide_double = called(impact.double_impact)
kernel_state = called(coordinates.kernel_state)
set_slip = called(coordinates.set_slip)
slip_force = called(friction.slip_force)
hold_left = called(friction.hold_left)
hold_left_of_pair = called(friction.hold_left_of_pair)
outward_slip = called(friction.outward_slip)
pair_friction = called(double_equations.friction)
hold_reserve = called(forces.hold_reserve)
effective_gravity = called(plate.effective_gravity)
plate_rate = called(plate.plate_rate)
lightest = called(plate.lightest)


@exported
def number(s):
    """Number of the end with sign s: -1 for p1, +1 for p2."""
    return 0 if s < 0.0 else 1


@exported
def end(dm, s):
    """The end with sign s."""
    return body.end(dm, number(s))


@exported
def sincos(x):
    return sines.sincos(x)


@exported
def levers(dm, s, sin_b, cos_b):
    return body.levers(end(dm, s), sin_b, cos_b)


@exported
def contact_velocity(dm, state, s):
    return impact.contact_velocity(dm, state, number(s))


@exported
def angular_momentum(dm, state):
    return free_motion.angular_momentum(dm, state, *body.attitude(dm, state[DIP]))


@exported
def gap_series(dm, fl, s, t):
    return free_motion.gap_series(dm, fl, number(s), t)


@exported
def fly(dm, state, t):
    """Free motion with the path, from the state's own take-off."""
    free_motion.fly(dm, free_motion.take_off(dm, state), state, t, True)


@exported
def first_landing(dm, fl, sign, until):
    return landing.first_landing(dm, fl, number(sign), until)


@exported
def next_landing(dm, fl, until):
    """Sign of the end that lands first (0.0 for neither), the time, and the probes."""
    i, t, probes = landing.next_landing(dm, fl, until)
    return (0.0 if i < 0 else (-1.0 if i == 0 else 1.0)), t, probes


@exported
def run_down(law, a, b, tol):
    return single_impact.run_down(law, a, b, tol)


@exported
def single_phase(law, n, a, b, tol, work):
    """An impact at one end on its own; `work.course[0].blow` tells what came of it."""
    single_impact.begin_blow(work.course[0].blow, n, a, b, 0.0, 0.0)
    return single_impact.single_phase(law, work.course[0].blow, tol, work)


@exported
def end_law(dm, s, beta):
    return impact.end_law(dm, number(s), 0.0, np.sin(beta), np.cos(beta), end(dm, s).e)


@exported
def collide_single(dm, state, s, V, tol, work, log):
    return impact.single_impact(dm, state, number(s), V, tol, work, log)


@exported
def contact_state(dm, state, s, y):
    coordinates.contact_state(dm, state, number(s), y)


@exported
def set_slips(dm, modes, y, a, b_1, b_2):
    u_b, w_p = y[coordinates.Y.u_b], y[coordinates.Y.w_p]
    coordinates.put_slips(dm, y, a, b_1, b_2)
    coordinates.give_impulses(dm, modes, y, u_b, w_p)


@exported
def contact_rates(dm, modes, phase, y, dy, F):
    forces.contact_rates(dm, modes, phase, y, True, dy, F)


@exported
def straight_leg(law, n, a, b, mode, c, s, work):
    """The first leg of an impact at one end, at constant rates; `work.course[0].blow` tells what came of it."""
    single_impact.begin_blow(work.course[0].blow, n, a, b, 0.0, 0.0)
    work.course[0].blow.mode = mode
    return single_impact.straight_leg(law, work.course[0].blow, c, s)


@exported
def contact_mode(dm, closed_1, closed_2, phase, y, modes, slip_tol, event, dy, F):
    c = forces.Contact(modes, phase, y, dy, F, slip_tol)
    return contact_modes.contact_mode(dm, c, closed_1, closed_2, event)


@exported
def sustained(dm, modes, y, at, span, tol, slip_tol, work, path):
    c = forces.Contact(modes, at, y, y, y, slip_tol)
    return phase.sustain_contact(dm, c, span, span, path, tol, work)


def sustain_contact(dm, modes, y, at, span, tol, slip_tol, work, path=True):
    """Contact phase; with a default of its own the compiled function would be compiled for it, too."""
    return sustained(dm, modes, y, at, span, tol, slip_tol, work, path)


@exported
def rests_flat(dm, state, modes, space):
    return smooth_motion.rests_for_good(dm, motion_of(state, modes, space.past, space))


def rests_for_good(dm, modes):
    """Whether a dimer that lies flat rests for good."""
    return rests_flat(dm, np.array(State()), modes, new_workspace())


@exported
def along_plate(dm, phase, theta):
    """Acceleration along the heading and across it; velocity of the plate along X and Y."""
    return (*plate.acceleration_along(dm, phase, theta), *plate.velocity_along(dm, phase))


@exported
def plate_bounds(dm):
    """Bounds of the plate's speed, of the effective gravity from above, and of the third and fourth derivative."""
    return dm.most_speed, plate.heaviest(dm), dm.most_jerk, dm.most_snap


def row_of(**parameters):
    """Parameter row; what is not named is the paper's base case."""
    if "mu" in parameters:
        parameters.setdefault("mu_s", parameters["mu"])
    return Parameters(**parameters).row()


def dimer(**parameters):
    """The kernel's dimer; what is not named is the paper's base case (and mu_s = mu where mu alone is)."""
    return body.dimer_of(row_of(**parameters))


def scratch():
    """Scratch, and an impact's log."""
    return new_work(), np.zeros((200, event_row.N_EVENT))


def state_of(dm, q, qdot, phase=0.0):
    """Kernel state from the oracle's coordinates (x1, y1, delta1, theta, dip, gamma) and their rates."""
    (x, y, gap, theta, dip, gamma), (x_rate, y_rate, gap_rate, turn, dip_rate, gamma_rate) = q, qdot
    sin_b, cos_b, sin_t, cos_t = *(f(dm.beta_0 + dip) for f in (np.sin, np.cos)), np.sin(theta), np.cos(theta)
    state = State(
        phase=phase, d1=gap, d2=gap + 2 * dm.l * np.sin(dip / 2) * np.cos(dm.beta_0 + dip / 2),
        n1=gap_rate, n2=gap_rate + dm.l * cos_b * dip_rate,
        dip=dip, wb=dip_rate, wp=turn * cos_b, spin=gamma_rate + turn * sin_b,
        ca=y_rate * cos_t - x_rate * sin_t + dm.p1.h * sin_b * dip_rate,
        cb=x_rate * cos_t + y_rate * sin_t + dm.p1.h * turn * cos_b,
        theta=theta, x1=x, y1=y, gamma=gamma,
    )  # fmt: skip
    return np.array(state, float)


def oracle_state(dm, state):
    """The oracle's coordinates and rates, q and qdot, of a kernel state."""
    s = State(*state)
    sin_b, cos_b = np.sin(dm.beta_0 + s.dip), np.cos(dm.beta_0 + s.dip)
    turn, v_a, v_b = s.wp / cos_b, s.ca - dm.p1.h * sin_b * s.wb, s.cb - dm.p1.h * s.wp
    x_rate = v_b * np.cos(s.theta) - v_a * np.sin(s.theta)
    y_rate = v_a * np.cos(s.theta) + v_b * np.sin(s.theta)
    rates = np.array([x_rate, y_rate, s.n1, turn, s.wb, s.spin - turn * sin_b])
    return np.array([s.x1, s.y1, s.d1, s.theta, s.dip, s.gamma]), rates
