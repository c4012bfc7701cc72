"""Sustained contact: the forces that keep closed ends closed, and the rates they give (the state: ``coordinates``).

These are the accelerations of (2), written for the contact point and the spin. The normal forces are those with which (1),
differentiated once more, gives no acceleration of the gap: (3) at an end that stays closed. The tangential ones follow from
(4): a slipping end has the friction of its direction, and one that sticks that with which its tangential acceleration is zero.
"""

from math import sqrt
from typing import NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    UPRIGHT,
    YAXES,
    YCHART,
    YDIP,
    YGAMMA,
    YS,
    YTHETA,
    YTIME,
    YUA,
    YUB,
    YWB,
    YWP,
    YX,
    YY,
    leading,
    slip_of,
)
from dimersweep.kernel.contact.steep_rod import upright_rates
from dimersweep.kernel.model.body import attitude, end, level_levers, levers
from dimersweep.kernel.model.friction import direction, hold_left, hold_left_of_pair, slip_force
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.model.plate import acceleration_along, effective_gravity
from dimersweep.kernel.numerics.sincos import sincos

# forces of a contact: normal, axial, lateral of p1, then of p2 (at a double contact A1 holds the sum of the axial ones);
# and its compliance (``friction``), at a double contact that to the difference of the normal forces
F1, A1, L1, F2, A2, L2, COMPLIANCE = range(7)
N_F = 7


@compiled
def free_rates(dm, p, y, g_e, A_a, A_b, sin_b, cos_b):
    """Rates by (2) without contact forces, h + Q of (A.5) and (A.6), over the plate.

    They are those of (beta', theta' cos(beta)), and of the (n, a, b) velocities of the leading end p: (1) differentiated.
    """
    w_b, w_p, spin = y[YWB], y[YWP], y[YS]
    lv = levers(p, sin_b, cos_b)
    turn = w_p / cos_b
    axial = dm.J_a * dm.it * spin - sin_b * turn
    d_wb, d_wp = axial * w_p, -axial * w_b
    c_a = y[YUA] - lv.a * w_b
    c_b = y[YUB] - lv.b * w_p - lv.c * spin
    n = -g_e + lv.n * d_wb - p.h * sin_b * w_b * w_b
    a = A_a - turn * c_b + lv.a * d_wb - p.h * cos_b * w_b * w_b
    b = A_b + turn * c_a + lv.b * d_wp + p.r * w_b * (cos_b * w_p + sin_b * spin)
    return d_wb, d_wp, n, a, b


@compiled
def double_forces(dm, modes, y, n_1, n_2, a, b, F):
    """Forces at both ends into F, the axial ones as their sum in F[A1], from the rates without them.

    These are the gap rates n_1, n_2, the axial rate a, and the lateral rate b of both.

    No end is to move off the plate or into it: with (2) and (1) two equations for the normal forces, in which the axial
    friction of (4), A = A_0 + A_1 F_1 + A_2 F_2, takes part.
    """
    w, n_1, n_2, a, b = dm.pair, dm.m * n_1, dm.m * n_2, dm.m * a, dm.m * b
    c_1, s_1 = direction(*slip_of(dm, modes, y, 0))
    c_2, s_2 = direction(*slip_of(dm, modes, y, 1))
    if modes[0] == STICK or modes[1] == STICK:
        A_0, A_1, A_2 = -a / w.aa, -w.na_1 / w.aa, -w.na_2 / w.aa
    else:
        A_0, A_1, A_2 = 0.0, -dm.p1.mu * c_1, -dm.p2.mu * c_2
    m_11, m_12 = w.nn_1 + w.na_1 * A_1, w.nn_12 + w.na_1 * A_2
    m_21, m_22 = w.nn_12 + w.na_2 * A_1, w.nn_2 + w.na_2 * A_2
    n_1, n_2 = n_1 + w.na_1 * A_0, n_2 + w.na_2 * A_0
    det = m_11 * m_22 - m_12 * m_21
    F[COMPLIANCE] = det / (0.5 * (w.nn_1 + w.nn_2) + w.nn_12)
    F[F1], F[F2] = (m_12 * n_2 - m_22 * n_1) / det, (m_21 * n_1 - m_11 * n_2) / det
    F[A1], F[A2] = A_0 + A_1 * F[F1] + A_2 * F[F2], 0.0
    _, F[L1] = slip_force(dm.p1.mu, F[F1], c_1, s_1)
    _, F[L2] = slip_force(dm.p2.mu, F[F2], c_2, s_2)
    if modes[0] == STICK and modes[1] == STICK:
        det = w.bb_1 * w.bb_2 - w.bb_12 * w.bb_12
        F[L1], F[L2] = -b * (w.bb_2 - w.bb_12) / det, -b * (w.bb_1 - w.bb_12) / det
    elif modes[0] == STICK:
        F[L1] = -(b + w.bb_12 * F[L2]) / w.bb_1
    elif modes[1] == STICK:
        F[L2] = -(b + w.bb_12 * F[L1]) / w.bb_2


class Single(NamedTuple):
    """Rates and forces of a contact of one end, in the chart by heading."""

    w_b: float  # of beta'
    w_p: float  # of theta' cos(beta)
    spin: float
    a: float  # of the slip, axial and lateral
    b: float
    turn: float  # of theta
    F: float  # forces [N]: normal, axial, lateral
    A: float
    L: float
    compliance: float  # [1/m]


@compiled(inline=True, fuse=True)
def single_rates(dm, mode, p, g_e, A_a, A_b, sin_b, cos_b, w_b, w_p, spin, u_a, u_b):
    """Rates and forces of the contact of one end (p, friction mode, slip u): those of ``single_forces``, written out.

    With `push` what they add to beta'' the normal acceleration is n + F / m + arm_n push = 0, the axial one a + A / m + arm_a
    push, zero at an end that sticks.
    """
    h, r, im, it = p.h, p.r, dm.im, dm.it
    arm_n, arm_a, arm_b, arm_c = h * cos_b, r - h * sin_b, r * sin_b - h, -r * cos_b
    turn = w_p / cos_b
    axial = dm.J_a * it * spin - sin_b * turn
    d_wb, d_wp = axial * w_p, -axial * w_b
    swing = h * w_b * w_b
    n = arm_n * d_wb - sin_b * swing - g_e
    a = A_a + arm_a * d_wb - cos_b * swing - turn * (u_b - arm_b * w_p - arm_c * spin)
    b = A_b + arm_b * d_wp + r * w_b * (cos_b * w_p + sin_b * spin) + turn * (u_a - arm_a * w_b)
    if mode == STICK:
        push = -(arm_n * n + arm_a * a) / (dm.J_t * im + (h * h + r * r - 2.0 * r * h * sin_b))
        F, A = -dm.m * (n + arm_n * push), -dm.m * (a + arm_a * push)
        L = -b / (im + arm_b * arm_b * it + arm_c * arm_c * dm.ia)
        return Single(d_wb + push, d_wp + arm_b * it * L, arm_c * dm.ia * L, 0.0, 0.0, turn, F, A, L, 1.0)
    v2 = u_a * u_a + u_b * u_b
    k = p.mu / sqrt(v2) if v2 > 0.0 else 0.0
    c, d = k * u_a, k * u_b
    yields = im + it * arm_n * (arm_n - c * arm_a)
    F = -n / yields
    A, L = -c * F, -d * F
    push, roll, spun = it * (arm_n * F + arm_a * A), arm_b * it * L, arm_c * dm.ia * L
    d_a, d_b = a + im * A + arm_a * push, b + im * L + arm_b * roll + arm_c * spun
    return Single(d_wb + push, d_wp + roll, spun, d_a, d_b, turn, F, A, L, yields * dm.m)


@compiled(inline=True)
def path_rates(dm, p, sin_b, cos_b, w_b, w_p, spin, u_a, u_b, theta):
    """Rates of x1, y1 and gamma, with the end p the leading one."""
    away = p.h - dm.p1.h  # from the centre of p1
    v_a = u_a - (p.r - away * sin_b) * w_b
    v_b = u_b - (p.r * sin_b - away) * w_p + p.r * cos_b * spin
    sin_t, cos_t = sincos(theta)
    return v_b * cos_t - v_a * sin_t, v_a * cos_t + v_b * sin_t, spin - w_p / cos_b * sin_b


@compiled
def double_rates(dm, modes, g_e, A_a, A_b, y, path, dy, F):
    """Rates of the contact of both ends into dy, and the forces into F."""
    (p, q), w = level_levers(dm), dm.pair
    d_wb, _, n_1, a, b = free_rates(dm, dm.p1, y, g_e, A_a, A_b, dm.sin_0, dm.cos_0)
    double_forces(dm, modes, y, n_1, n_1 + dm.l * dm.cos_0 * d_wb, a, b, F)
    dy[YDIP], dy[YWB] = 0.0, 0.0
    dy[YWP] = (p.b * F[L1] + q.b * F[L2]) * dm.it
    dy[YS] = (p.c * F[L1] + q.c * F[L2]) * dm.ia
    both_slip = modes[0] == SLIP and modes[1] == SLIP
    dy[YUA] = a + dm.im * (w.na_1 * F[F1] + w.na_2 * F[F2] + w.aa * F[A1]) if both_slip else 0.0
    dy[YUB] = b + dm.im * (w.bb_1 * F[L1] + w.bb_12 * F[L2]) if modes[0] == SLIP else 0.0
    dy[YTHETA], dy[YTIME] = y[YWP] / dm.cos_0, 1.0
    if path:
        dy[YX], dy[YY], dy[YGAMMA] = path_rates(
            dm, dm.p1, dm.sin_0, dm.cos_0, 0.0, y[YWP], y[YS], y[YUA], y[YUB], y[YTHETA]
        )


@compiled
def contact_rates(dm, modes, phase, y, path, dy, F):
    """Time derivative of y in a contact phase into dy, and the contact forces into F: (2) with (3) and (4).

    In the upright chart the friction is along the axes of the chart.

    Parameters
    ----------
    dm : Dimer
    modes : float64 array, shape (2,)
        FREE, STICK or SLIP of p1 and p2, not both FREE.
    phase : float
        Plate phase omega t + phi0 [rad].
    y, dy : float64 array, shape (N_Y,)
        Contact state and its rate.
    path : bool
        Whether the rates of x1, y1 and gamma are wanted.
    F : float64 array, shape (N_F,)
        Forces [N]: normal, axial, lateral of p1, then of p2; and the compliance [1/m].
    """
    i = leading(modes)
    p = end(dm, i)
    g_e, A_a, A_b = effective_gravity(dm, phase), 0.0, 0.0
    if dm.sideways != 0.0:
        A_a, A_b = acceleration_along(dm, phase, y[YAXES] if y[YCHART] == UPRIGHT else y[YTHETA])
    if modes[0] != FREE and modes[1] != FREE:
        double_rates(dm, modes, g_e, A_a, A_b, y, path, dy, F)
        return
    for k in range(N_F):
        F[k] = 0.0
    k = 3 * i
    if y[YCHART] == UPRIGHT:
        F[COMPLIANCE] = upright_rates(dm, modes[i], p, g_e, A_a, A_b, y, path, dy, F, k)
        return
    sin_b, cos_b = attitude(dm, y[YDIP])
    r = single_rates(dm, modes[i], p, g_e, A_a, A_b, sin_b, cos_b, y[YWB], y[YWP], y[YS], y[YUA], y[YUB])
    F[F1 + k], F[A1 + k], F[L1 + k], F[COMPLIANCE] = r.F, r.A, r.L, r.compliance
    dy[YDIP], dy[YWB], dy[YWP], dy[YS], dy[YUA], dy[YUB] = y[YWB], r.w_b, r.w_p, r.spin, r.a, r.b
    dy[YTHETA], dy[YTIME] = r.turn, 1.0
    if path:
        dy[YX], dy[YY], dy[YGAMMA] = path_rates(dm, p, sin_b, cos_b, y[YWB], y[YWP], y[YS], y[YUA], y[YUB], y[YTHETA])


@compiled
def hold_reserve(dm, modes, i, F):
    """How far the friction that holds end i is from its limit [N]; of two held ends only the sum of the axial parts counts."""
    if modes[0] == STICK and modes[1] == STICK:
        return hold_left_of_pair(dm.p1.mu_h, F[F1], F[L1], dm.p2.mu_h, F[F2], F[L2], F[A1])
    k = 3 * i
    axial = F[A1] if modes[0] != FREE else F[A2]
    return hold_left(end(dm, i).mu_h, F[F1 + k], axial, F[L1 + k])
