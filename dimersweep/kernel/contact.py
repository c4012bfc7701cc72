"""Sustained contact: the forces that keep closed ends closed, the rates they give, and the choice of contact mode.

The state of a contact phase is y = (beta, beta', theta' cos(beta), spin, u_a, u_b, theta, t, x1, y1, gamma): u is the slip
of the leading end (p1 if it is closed, else p2), so that slow slip keeps its relative precision and sticking is u = 0; t
counts from the start of a step.
"""

from math import cos, hypot, sin, sqrt

from dimersweep.kernel.body import delassus, levers
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import (
    BETA,
    CA,
    CB,
    D1,
    D2,
    FREE,
    GAMMA,
    N1,
    N2,
    SLIP,
    SPIN,
    STICK,
    THETA,
    WB,
    WP,
    X1,
    Y1,
)
from dimersweep.kernel.plate import effective_gravity

YB, YWB, YWP, YS, YUA, YUB, YTHETA, YTIME, YX, YY, YGAMMA = range(11)
N_CLOSED, N_PATH = 8, 11  # entries without and with the path
# forces of a contact: normal, axial, lateral of p1, then of p2 (at a double contact A1 holds the sum of the axial ones)
F1, A1, L1, F2, A2, L2 = range(6)


@compiled
def leading_sign(modes):
    """Sign of the leading end: -1 for p1, +1 for p2."""
    return -1.0 if modes[0] != FREE else 1.0


@compiled
def unload(dm, state, s, y):
    """Contact state y from the kernel state, s the sign of the leading end."""
    lv = levers(dm, s, sin(state[BETA]), cos(state[BETA]))
    y[YB], y[YWB], y[YWP], y[YS] = state[BETA], state[WB], state[WP], state[SPIN]
    y[YUA] = state[CA] + lv.a * state[WB]
    y[YUB] = state[CB] + lv.b * state[WP] + lv.c * state[SPIN]
    y[YTHETA], y[YX], y[YY], y[YGAMMA] = state[THETA], state[X1], state[Y1], state[GAMMA]
    y[YTIME] = 0.0


@compiled
def load(dm, modes, y, state):
    """Kernel state from the contact state y: closed gaps and their rates are exactly zero."""
    s = leading_sign(modes)
    sin_b, cos_b = sin(y[YB]), cos(y[YB])
    lv = levers(dm, s, sin_b, cos_b)
    state[BETA], state[WB], state[WP], state[SPIN] = y[YB], y[YWB], y[YWP], y[YS]
    state[CA] = y[YUA] - lv.a * y[YWB]
    state[CB] = y[YUB] - lv.b * y[YWP] - lv.c * y[YS]
    state[THETA], state[X1], state[Y1], state[GAMMA] = y[YTHETA], y[YX], y[YY], y[YGAMMA]
    gap, rate = 2.0 * dm.h * sin_b, 2.0 * dm.h * cos_b * y[YWB]
    state[D1] = 0.0 if modes[0] != FREE else -gap
    state[N1] = 0.0 if modes[0] != FREE else -rate
    state[D2] = 0.0 if modes[1] != FREE else gap
    state[N2] = 0.0 if modes[1] != FREE else rate


@compiled
def slip_of(dm, modes, y, i):
    """Axial and lateral slip of end i (0 or 1), which is closed."""
    if i == 0 or modes[0] == FREE:
        return y[YUA], y[YUB]
    return y[YUA], y[YUB] - 2.0 * dm.h * y[YWP]


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
def direction(a, b):
    """Cosine and sine of a slip's direction, 0 and 0 for none (no slip is so small that its square vanishes)."""
    v2 = a * a + b * b
    k = 1.0 / sqrt(v2) if v2 > 0.0 else 0.0
    return k * a, k * b


@compiled
def single_forces(dm, mode, lv, y, n, a, b):
    """Normal, axial and lateral force at the one closed end; nan-free, the normal force may come out negative."""
    w = delassus(dm, lv, lv)
    if mode == STICK:
        det = w.nn * w.aa - w.na * w.na
        return (w.na * a - w.aa * n) / det, (w.na * n - w.nn * a) / det, -b / w.bb
    c, s = direction(y[YUA], y[YUB])
    F = -n / (w.nn - dm.mu * w.na * c)
    return F, -dm.mu * F * c, -dm.mu * F * s


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
    D = (n_1 - n_2 - 2.0 * w.an * A_c) / (w.nn - wx.nn + 2.0 * w.an * A_d)
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

    Parameters
    ----------
    dm : Dimer
    modes : float64 array, shape (2,)
        FREE, STICK or SLIP of p1 and p2, not both FREE.
    phase : float
        Plate phase omega t + phi0 [rad].
    y, dy : float64 array, shape (11,)
        Contact state and its rate.
    path : bool
        Whether the rates of x1, y1 and gamma are wanted.
    F : float64 array, shape (6,)
        Forces [N]: normal, axial, lateral of p1, then of p2.
    """
    s = leading_sign(modes)
    double = modes[0] != FREE and modes[1] != FREE
    sin_b, cos_b = (0.0, 1.0) if double else (sin(y[YB]), cos(y[YB]))
    lv = levers(dm, s, sin_b, cos_b)
    d_wb, d_wp, n, a, b = free_rates(dm, s, y, effective_gravity(dm, phase), sin_b, cos_b)
    for k in range(6):
        F[k] = 0.0
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
        i = 0 if s < 0.0 else 1
        normal, axial, lateral = single_forces(dm, modes[i], lv, y, n, a, b)
        k = 3 * i
        F[F1 + k], F[A1 + k], F[L1 + k] = normal, axial, lateral
        w = delassus(dm, lv, lv)
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
            return min(room_1, room_2)
        return sqrt(room_1) + sqrt(room_2) - abs(F[A1])
    k = 3 * i
    axial = F[A1] if modes[0] != FREE else F[A2]
    return mu_s * F[F1 + k] - hypot(axial, F[L1 + k])


@compiled
def set_slip(dm, modes, y, i, a, b):
    """Give end i, which is closed, the slip (a, b); the other end keeps its lateral slip."""
    y[YUA] = a
    if modes[0] == FREE or modes[1] == FREE:
        y[YUB] = b
    elif i == 0:
        y[YWP] += (b - y[YUB]) / (2.0 * dm.h)
        y[YUB] = b
    else:
        y[YWP] = (y[YUB] - b) / (2.0 * dm.h)
