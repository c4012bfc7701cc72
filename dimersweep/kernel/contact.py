"""Sustained contact: the forces that keep closed ends closed, and the rates they give (state and charts: ``charts``)."""

from math import cos, sin, sqrt

from dimersweep.kernel.body import delassus, levers
from dimersweep.kernel.charts import (
    UPRIGHT,
    YB,
    YCHART,
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
    leading_sign,
)
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.law import direction, length, single_forces
from dimersweep.kernel.layout import FREE, SLIP, STICK
from dimersweep.kernel.plate import effective_gravity
from dimersweep.kernel.upright import upright_rates

# forces of a contact: normal, axial, lateral of p1, then of p2 (at a double contact A1 holds the sum of the axial ones);
# and its compliance (``law``), at a double contact that to the difference of the normal forces
F1, A1, L1, F2, A2, L2, COMPLIANCE = range(7)
N_F = 7


@compiled
def free_rates(dm, s, y, g_e, sin_b, cos_b):
    """Rates without contact forces: of (beta', theta' cos(beta)), and of the leading end's (n, a, b) velocities."""
    w_b, w_p, spin = y[YWB], y[YWP], y[YS]
    lv = levers(dm, s, sin_b, cos_b)
    turn = w_p / cos_b
    axial = dm.J_a * dm.it * spin - sin_b * turn
    d_wb, d_wp = axial * w_p, -axial * w_b
    c_a = y[YUA] - lv.a * w_b
    c_b = y[YUB] - lv.b * w_p - lv.c * spin
    n = -g_e + lv.n * d_wb - s * dm.h * sin_b * w_b * w_b
    a = -turn * c_b + lv.a * d_wb - s * dm.h * cos_b * w_b * w_b
    b = turn * c_a + lv.b * d_wp + dm.r * w_b * (cos_b * w_p + sin_b * spin)
    return d_wb, d_wp, n, a, b


@compiled
def double_forces(dm, modes, y, n_1, n_2, a, b, F):
    """Forces at both ends (beta = 0) into F; the axial ones as their sum in F[A1]. b is the free lateral rate of both.

    The sum S of the normal forces is fixed by the weight, their difference D by the balance of moments, in which the axial
    friction A = A_c + A_d D takes part.
    """
    p, q = levers(dm, -1.0, 0.0, 1.0), levers(dm, 1.0, 0.0, 1.0)
    w, wx = delassus(dm, q, q), delassus(dm, p, q)
    total = -(n_1 + n_2) / (w.nn + wx.nn)
    held = modes[0] == STICK or modes[1] == STICK
    c_1, s_1 = direction(y[YUA], y[YUB])
    c_2, s_2 = direction(y[YUA], y[YUB] - 2.0 * dm.h * y[YWP])
    if held:
        A_c, A_d = -a / w.aa, -w.an / w.aa
    else:
        A_c, A_d = -0.5 * dm.mu * total * (c_1 + c_2), -0.5 * dm.mu * (c_2 - c_1)
    yields = w.nn - wx.nn + 2.0 * w.an * A_d
    F[COMPLIANCE] = yields * dm.m
    D = (n_1 - n_2 - 2.0 * w.an * A_c) / yields
    F[F1], F[F2] = 0.5 * (total - D), 0.5 * (total + D)
    F[A1], F[A2] = A_c + A_d * D, 0.0
    F[L1], F[L2] = -dm.mu * F[F1] * s_1, -dm.mu * F[F2] * s_2
    if modes[0] == STICK and modes[1] == STICK:
        F[L1] = F[L2] = -b / (w.bb + wx.bb)
    elif modes[0] == STICK:
        F[L1] = -(b + wx.bb * F[L2]) / w.bb
    elif modes[1] == STICK:
        F[L2] = -(b + wx.bb * F[L1]) / w.bb


@compiled
def contact_rates(dm, modes, phase, y, path, dy, F):
    """Time derivative of y in a contact phase into dy, and the contact forces into F.

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
    s = leading_sign(modes)
    g_e = effective_gravity(dm, phase)
    for k in range(N_F):
        F[k] = 0.0
    i = 0 if s < 0.0 else 1
    if y[YCHART] == UPRIGHT:
        F[COMPLIANCE] = upright_rates(dm, modes[i], s, g_e, y, path, dy, F, 3 * i)
        return
    double = modes[0] != FREE and modes[1] != FREE
    sin_b, cos_b = (0.0, 1.0) if double else (sin(y[YB]), cos(y[YB]))
    lv = levers(dm, s, sin_b, cos_b)
    d_wb, d_wp, n, a, b = free_rates(dm, s, y, g_e, sin_b, cos_b)
    if double:
        double_forces(dm, modes, y, n, n + 2.0 * dm.h * d_wb, a, b, F)
        slips = modes[0] == SLIP
        w = delassus(dm, lv, lv)
        other = delassus(dm, lv, levers(dm, 1.0, 0.0, 1.0))
        dy[YB], dy[YWB] = 0.0, 0.0
        dy[YWP] = dm.h * (F[L1] - F[L2]) * dm.it
        dy[YS] = -dm.r * (F[L1] + F[L2]) * dm.ia
        both_slip = slips and modes[1] == SLIP
        dy[YUA] = a + w.an * (F[F1] - F[F2]) + w.aa * F[A1] if both_slip else 0.0
        dy[YUB] = b + w.bb * F[L1] + other.bb * F[L2] if slips else 0.0
    else:
        w = delassus(dm, lv, lv)
        normal, axial, lateral, F[COMPLIANCE] = single_forces(dm, modes[i], w, y[YUA], y[YUB], n, a, b)
        k = 3 * i
        F[F1 + k], F[A1 + k], F[L1 + k] = normal, axial, lateral
        dy[YB] = y[YWB]
        dy[YWB] = d_wb + (lv.n * normal + lv.a * axial) * dm.it
        dy[YWP] = d_wp + lv.b * lateral * dm.it
        dy[YS] = lv.c * lateral * dm.ia
        dy[YUA] = a + w.an * normal + w.aa * axial if modes[i] == SLIP else 0.0
        dy[YUB] = b + w.bb * lateral if modes[i] == SLIP else 0.0
    turn = y[YWP] / cos_b
    dy[YTHETA], dy[YTIME] = turn, 1.0
    if not path:
        return
    v_a = y[YUA] - lv.a * y[YWB] + dm.h * sin_b * y[YWB]
    v_b = y[YUB] - lv.b * y[YWP] - lv.c * y[YS] + dm.h * y[YWP]
    sin_t, cos_t = sin(y[YTHETA]), cos(y[YTHETA])
    dy[YX] = v_b * cos_t - v_a * sin_t
    dy[YY] = v_a * cos_t + v_b * sin_t
    dy[YGAMMA] = y[YS] - turn * sin_b


@compiled
def hold_reserve(dm, modes, i, F):
    """How far the friction that holds end i is from its limit [N]; of two held ends only the sum of the axial parts counts."""
    mu_s = dm.mu_s
    if modes[0] == STICK and modes[1] == STICK:
        room_1 = (mu_s * F[F1]) ** 2 - F[L1] ** 2
        room_2 = (mu_s * F[F2]) ** 2 - F[L2] ** 2
        if room_1 < 0.0 or room_2 < 0.0:
            return -sqrt(-min(room_1, room_2))
        return sqrt(room_1) + sqrt(room_2) - abs(F[A1])
    k = 3 * i
    axial = F[A1] if modes[0] != FREE else F[A2]
    return mu_s * F[F1 + k] - length(axial, F[L1 + k])
