"""Compute the forces that keep closed ends closed in sustained contact, and the rates that they give.

The contact state is that of `coordinates`. The rates are the accelerations of (2), written for the contact point and
the spin. The normal forces are those with which (1), differentiated once more, gives no acceleration of the gap: (3) at
an end that stays closed. The tangential forces follow from (4): a slipping end has the friction of its direction, and a
sticking end the friction with which its tangential acceleration is zero.

The powers of the forces are the rates of their works, which are integrated with the state where they are wanted.
"""

from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import Row
from dimersweep.kernel.contact.coordinates import N_CLOSED, N_PATH, UPRIGHT, Y, leading, slip_of
from dimersweep.kernel.contact.steep_rod import upright_rates
from dimersweep.kernel.model.body import attitude, delassus, end, level_levers, levers
from dimersweep.kernel.model.friction import direction, hold_left, hold_left_of_pair, single_forces, slip_force, slip_mu
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.model.plate import acceleration_along, effective_gravity, plate_rate, velocity_along
from dimersweep.kernel.model.works import ALONG, PLATE_1, PLATE_2, SLIP_1
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.sincos import sincos

# forces of a contact: normal, axial, lateral of p1, then of p2 (at a double contact A1 holds the sum of the axial
# forces); and the compliance of the contact (``friction``), at a double contact the compliance to the difference of the
# normal forces
F1, A1, L1, F2, A2, L2, COMPLIANCE = range(7)
N_F = 7


class Contact(NamedTuple):
    """Ends that touch the plate at a moment: their modes, state, rates and forces. All arrays are modified in place."""

    modes: Any  # friction modes of the ends, shape (2,)
    phase: float  # phase of the plate [rad]
    y: Any  # contact state, shape (N_Y,), and its rates
    dy: Any
    F: Any  # forces [N], and the compliance [1/m], shape (N_F,)
    slip_tol: float  # slip that counts as none [m/s]


class Moment(NamedTuple):
    """Contact state within a phase, its rates, and the forces."""

    y: Row
    dy: Row
    F: Row


class Pull(NamedTuple):
    """Acceleration that pulls the body relative to the plate: down, along its heading and across it [m s-2]."""

    down: float
    a: float
    b: float


class Rod(NamedTuple):
    """Attitude, rates and slip of the dimer in contact, by heading."""

    sin_b: float
    cos_b: float
    w_b: float
    w_p: float
    spin: float
    u_a: float
    u_b: float
    theta: float


@compiled(inline=True)
def rod_of(y, sin_b, cos_b):
    """Return the rod of a contact state by heading; sine and cosine of its dip angle are passed on."""
    return Rod(sin_b, cos_b, y[Y.w_b], y[Y.w_p], y[Y.spin], y[Y.u_a], y[Y.u_b], y[Y.theta])


@compiled(inline=True)
def pull_at(dm, phase, theta):
    """Return the pull at the body at a phase of the plate [rad] and a heading theta [rad]."""
    a, b = acceleration_along(dm, phase, theta) if dm.sideways != 0.0 else (0.0, 0.0)
    return Pull(effective_gravity(dm, phase), a, b)


# --- both ends ----------------------------------------------------------------------------------------------------------


@compiled(inline=True, fuse=True)
def free_rates(dm, p, rod, pull):
    """Return five rates of the motion relative to the plate without contact forces: h + Q of (A.5), (A.6) in (2).

    They are the rates of beta' and of theta' cos(beta), and the normal, axial and lateral acceleration of the leading
    end p. These three are the derivatives of its velocities in (1).
    """
    sin_b, cos_b, w_b, w_p, spin, u_a, u_b, _ = rod
    lv = levers(p, sin_b, cos_b)
    turn = w_p / cos_b
    axial = dm.J_a * dm.it * spin - sin_b * turn
    d_wb, d_wp = axial * w_p, -axial * w_b
    c_a = u_a - lv.a * w_b
    c_b = u_b - lv.b * w_p - lv.c * spin
    swing = p.h * w_b * w_b
    n = -pull.down + lv.n * d_wb - sin_b * swing
    a = pull.a - turn * c_b + lv.a * d_wb - cos_b * swing
    b = pull.b + turn * c_a + lv.b * d_wp + p.r * w_b * (cos_b * w_p + sin_b * spin)
    return d_wb, d_wp, n, a, b


@compiled
def double_forces(dm, modes, y, free, F):
    """Write the forces at both ends into F, from the rates without contact forces.

    F[A1] holds the sum of the axial forces. `free` holds the rates of the gap rates of p1 and p2, of the axial velocity
    and of the lateral velocity of both ends.

    No end is to move off the plate or into it: (2) and (1) give two equations for the normal forces. The axial friction
    of (4), A = A_0 + A_1 F_1 + A_2 F_2, takes part in them.
    """
    w, n_1, n_2, a, b = dm.pair, dm.m * free[0], dm.m * free[1], dm.m * free[2], dm.m * free[3]
    slip_1, slip_2 = slip_of(dm, modes, y, 0), slip_of(dm, modes, y, 1)
    (c_1, s_1), (c_2, s_2) = direction(*slip_1), direction(*slip_2)
    mu_1, mu_2 = slip_mu(dm.p1, length(*slip_1)), slip_mu(dm.p2, length(*slip_2))
    if modes[0] == STICK or modes[1] == STICK:
        # an end that sticks has no axial acceleration, and both ends share theirs
        A_0, A_1, A_2 = -a / w.aa, -w.na_1 / w.aa, -w.na_2 / w.aa
    else:
        A_0, A_1, A_2 = 0.0, -mu_1 * c_1, -mu_2 * c_2
    m_11, m_12 = w.nn_1 + w.na_1 * A_1, w.nn_12 + w.na_1 * A_2
    m_21, m_22 = w.nn_12 + w.na_2 * A_1, w.nn_2 + w.na_2 * A_2
    n_1, n_2 = n_1 + w.na_1 * A_0, n_2 + w.na_2 * A_0
    det = m_11 * m_22 - m_12 * m_21
    F[COMPLIANCE] = det / (0.5 * (w.nn_1 + w.nn_2) + w.nn_12)
    F[F1], F[F2] = (m_12 * n_2 - m_22 * n_1) / det, (m_21 * n_1 - m_11 * n_2) / det
    F[A1], F[A2] = A_0 + A_1 * F[F1] + A_2 * F[F2], 0.0
    _, F[L1] = slip_force(mu_1, F[F1], c_1, s_1)
    _, F[L2] = slip_force(mu_2, F[F2], c_2, s_2)
    if modes[0] == STICK and modes[1] == STICK:
        det = w.bb_1 * w.bb_2 - w.bb_12 * w.bb_12
        F[L1], F[L2] = -b * (w.bb_2 - w.bb_12) / det, -b * (w.bb_1 - w.bb_12) / det
    elif modes[0] == STICK:
        F[L1] = -(b + w.bb_12 * F[L2]) / w.bb_1
    elif modes[1] == STICK:
        F[L2] = -(b + w.bb_12 * F[L1]) / w.bb_2


@compiled
def double_rates(dm, modes, pull, y, path, dy, F):
    """Write the rates of a contact of both ends into dy, and its forces into F."""
    (p, q), w, rod = level_levers(dm), dm.pair, rod_of(y, dm.sin_0, dm.cos_0)
    d_wb, _, n_1, a, b = free_rates(dm, dm.p1, rod, pull)
    double_forces(dm, modes, y, (n_1, n_1 + dm.l * dm.cos_0 * d_wb, a, b), F)
    dy[Y.dip], dy[Y.w_b] = 0.0, 0.0
    dy[Y.w_p] = (p.b * F[L1] + q.b * F[L2]) * dm.it
    dy[Y.spin] = (p.c * F[L1] + q.c * F[L2]) * dm.ia
    both_slip = modes[0] == SLIP and modes[1] == SLIP
    dy[Y.u_a] = a + dm.im * (w.na_1 * F[F1] + w.na_2 * F[F2] + w.aa * F[A1]) if both_slip else 0.0
    dy[Y.u_b] = b + dm.im * (w.bb_1 * F[L1] + w.bb_12 * F[L2]) if modes[0] == SLIP else 0.0
    dy[Y.theta], dy[Y.time] = y[Y.w_p] / dm.cos_0, 1.0
    if path:
        dy[Y.x], dy[Y.y], dy[Y.gamma] = path_rates(dm, dm.p1, rod)


# --- one end ------------------------------------------------------------------------------------------------------------


class Single(NamedTuple):
    """Rates and forces of a contact of one end, in the chart by heading."""

    w_b: float  # rate of beta'
    w_p: float  # rate of theta' cos(beta)
    spin: float
    a: float  # rates of the slip, axial and lateral
    b: float
    turn: float  # rate of theta
    F: float  # forces [N]: normal, axial, lateral
    A: float
    L: float
    compliance: float  # [1/m]


@compiled(inline=True, fuse=True)
def single_rates(dm, mode, p, rod, pull):
    """Return the rates and forces of the contact of one end p with its friction mode."""
    d_wb, d_wp, n, a, b = free_rates(dm, p, rod, pull)
    lv = levers(p, rod.sin_b, rod.cos_b)
    mu, w = slip_mu(p, length(rod.u_a, rod.u_b)), delassus(dm, lv, lv)
    F, A, L, compliance = single_forces(dm, mu, mode, w, rod.u_a, rod.u_b, n, a, b)
    push, roll, spun = dm.it * (lv.n * F + lv.a * A), lv.b * dm.it * L, lv.c * dm.ia * L
    d_a, d_b = (a + w.an * F + w.aa * A, b + w.bb * L) if mode == SLIP else (0.0, 0.0)
    return Single(d_wb + push, d_wp + roll, spun, d_a, d_b, rod.w_p / rod.cos_b, F, A, L, compliance)


@compiled(inline=True)
def put_forces(i, normal, axial, lateral, compliance, F):
    """Write the forces and the compliance of the contact of end i alone into F; those of the other end are zero."""
    for k in range(N_F):
        F[k] = 0.0
    F[F1 + 3 * i], F[A1 + 3 * i], F[L1 + 3 * i], F[COMPLIANCE] = normal, axial, lateral, compliance


@compiled(inline=True)
def path_rates(dm, p, rod):
    """Return the rates of x1, y1 and gamma; p is the leading end."""
    sin_b, cos_b, w_b, w_p, spin, u_a, u_b, theta = rod
    away = p.h - dm.p1.h  # distance of the ball centres of p1 and p
    v_a = u_a - (p.r - away * sin_b) * w_b
    v_b = u_b - (p.r * sin_b - away) * w_p + p.r * cos_b * spin
    sin_t, cos_t = sincos(theta)
    return v_b * cos_t - v_a * sin_t, v_a * cos_t + v_b * sin_t, spin - w_p / cos_b * sin_b


# --- any contact --------------------------------------------------------------------------------------------------------


@compiled
def contact_rates(dm, modes, phase, y, path, dy, F):
    """Write the time derivative of y in a contact phase into dy, and the contact forces into F: (2) with (3) and (4).

    In the upright chart the friction is along the axes of the chart. `path` is True if the rates of x1, y1 and gamma
    are wanted; the other arguments are those of `Contact`.
    """
    pull = pull_at(dm, phase, y[Y.axes] if y[Y.chart] == UPRIGHT else y[Y.theta])
    if modes[0] != FREE and modes[1] != FREE:
        double_rates(dm, modes, pull, y, path, dy, F)
        return
    i = leading(modes)
    p = end(dm, i)
    if y[Y.chart] == UPRIGHT:
        put_forces(i, *upright_rates(dm, modes[i], p, pull, y, path, dy), F)
        return
    rod = rod_of(y, *attitude(dm, y[Y.dip]))
    r = single_rates(dm, modes[i], p, rod, pull)
    put_forces(i, r.F, r.A, r.L, r.compliance, F)
    dy[Y.dip], dy[Y.w_b], dy[Y.w_p], dy[Y.spin], dy[Y.u_a], dy[Y.u_b] = y[Y.w_b], r.w_b, r.w_p, r.spin, r.a, r.b
    dy[Y.theta], dy[Y.time] = r.turn, 1.0
    if path:
        dy[Y.x], dy[Y.y], dy[Y.gamma] = path_rates(dm, p, rod)


@compiled
def take_rates(dm, c):
    """Write the rates and forces of a contact at its present modes, phase and state."""
    contact_rates(dm, c.modes, c.phase, c.y, False, c.dy, c.F)


@compiled(inline=True)
def phase_rates(p, phase, at):
    """Write the rates and forces at a moment of a contact phase, and the powers where works are wanted."""
    contact_rates(p.dm, p.modes, phase, at.y, p.n > N_CLOSED, at.dy, at.F)
    if p.n > N_PATH:
        work_rates(p.dm, p.modes, phase, at.y, at.F, at.dy)


@compiled
def work_rates(dm, modes, phase, y, F, dy):
    """Write the powers of the forces F at a contact state into the places of the works in dy [W]."""
    rise = plate_rate(dm, phase)
    dy[Y.work + PLATE_1], dy[Y.work + PLATE_2], dy[Y.work + ALONG] = F[F1] * rise, F[F2] * rise, 0.0
    if dm.sideways != 0.0:
        axial, lateral = F[A1] + F[A2], F[L1] + F[L2]
        v_x, v_y = velocity_along(dm, phase)
        sin_t, cos_t = sincos(y[Y.axes] if y[Y.chart] == UPRIGHT else y[Y.theta])
        dy[Y.work + ALONG] = axial * (v_y * cos_t - v_x * sin_t) + lateral * (v_x * cos_t + v_y * sin_t)
    both_slip = modes[0] == SLIP and modes[1] == SLIP
    for i in range(2):
        dy[Y.work + SLIP_1 + i] = 0.0
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            axial = F[A1 + 3 * i]
            # F has the sum of the axial forces; the slip of each end gives its own part
            if both_slip:
                axial, _ = slip_force(slip_mu(end(dm, i), length(a, b)), F[F1 + 3 * i], *direction(a, b))
            dy[Y.work + SLIP_1 + i] = axial * a + F[L1 + 3 * i] * b


@compiled
def hold_reserve(dm, modes, i, F):
    """Return how far the friction that holds end i is from its limit [N]; negative beyond it.

    Of two held ends only the sum of the axial parts counts.
    """
    if modes[0] == STICK and modes[1] == STICK:
        return hold_left_of_pair(dm.p1.mu_h, F[F1], F[L1], dm.p2.mu_h, F[F2], F[L2], F[A1])
    k = 3 * i
    axial = F[A1] if modes[0] != FREE else F[A2]
    return hold_left(end(dm, i).mu_h, F[F1 + k], axial, F[L1 + k])
