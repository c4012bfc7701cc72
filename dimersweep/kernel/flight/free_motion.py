"""Move the dimer freely over the moving plate: (2) without contact forces, in closed form.

The centre of mass is ballistic, and the dimer is a symmetric top without torque. Its axis u turns about the constant
angular momentum L at Omega = |L|/J_t, so that sin(beta)(t) = c0 + c1 cos(Omega t) + c2 sin(Omega t). Everything is
written as an increment over the start in 1 - cos x and x - sin x, which keeps the full relative precision of hops of
any smallness.
"""

from math import copysign, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import attitude, lift
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, GAMMA, N1, N2, PHASE, SPIN, THETA, WB, WP, X1, Y1
from dimersweep.kernel.model.plate import over_plate, sway_from, swung
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import TWO_PI, nearest, one_minus_cos, sincos, x_minus_sin


class Flight(NamedTuple):
    """Constants of one flight; times count from its start."""

    d_1: float  # gaps and gap rates at the start
    d_2: float
    n_1: float
    n_2: float
    g: float
    h_1: float  # places of the ball centres on the axis, counted from the centre of mass [m]
    h_2: float
    Omega: float  # rate of the axis about L [rad s-1]
    c1: float  # amplitudes of sin(beta)
    c2: float
    sway: Any  # the plate from the start on
    bound4: float  # bound of the fourth time derivative of either gap
    sin_b: float  # sine and cosine of the dip angle at the start
    cos_b: float
    L: Any  # angular momentum over J_t in the frame (a, b, n) of the heading at the start [rad s-1]


@compiled
def angular_momentum(dm, state, sin_b, cos_b):
    """Return L_a, L_b, L_n, the angular momentum over J_t in the frame (a, b, n) of the present heading [rad s-1]."""
    axial = dm.J_a / dm.J_t * state[SPIN]
    return (
        -sin_b * state[WP] + cos_b * axial,
        state[WB],
        cos_b * state[WP] + sin_b * axial,
    )


@compiled
def take_off(dm, state):
    """Return the flight that starts from a state."""
    sin_b, cos_b = attitude(dm, state[DIP])
    L = angular_momentum(dm, state, sin_b, cos_b)
    Omega = sqrt(L[0] * L[0] + L[1] * L[1] + L[2] * L[2])
    c1, c2 = 0.0, 0.0
    if Omega > 0.0:
        c1 = sin_b - dm.J_a / dm.J_t * state[SPIN] * L[2] / (Omega * Omega)
        c2 = cos_b * state[WB] / Omega
    O2 = Omega * Omega
    return Flight(
        state[D1],
        state[D2],
        state[N1],
        state[N2],
        dm.g,
        dm.p1.h,
        dm.p2.h,
        Omega,
        c1,
        c2,
        sway_from(dm, state[PHASE] + dm.phi0),
        max(-dm.p1.h, dm.p2.h) * O2 * O2 * sqrt(c1 * c1 + c2 * c2) + dm.most_snap,
        sin_b,
        cos_b,
        L,
    )


@compiled(inline=True)
def gap_series(dm, fl, i, t):
    """Return the gap of end i at time t and its first three time derivatives; the first is the gap rate of (1)."""
    x = fl.Omega * t
    sx, cx = sincos(x)
    kx = one_minus_cos(sx, cx)
    d, n, h = (fl.d_1, fl.n_1, fl.h_1) if i == 0 else (fl.d_2, fl.n_2, fl.h_2)
    O2 = h * fl.Omega * fl.Omega
    over = (
        d + (n - 0.5 * fl.g * t) * t - h * (fl.c1 * kx + fl.c2 * x_minus_sin(x, sx)),
        n - fl.g * t - h * fl.Omega * (fl.c1 * sx + fl.c2 * kx),
        -fl.g - O2 * (fl.c1 * cx + fl.c2 * sx),
        -O2 * fl.Omega * (fl.c2 * cx - fl.c1 * sx),
    )
    return over_plate(dm, fl.sway, t, over)


@compiled(inline=True)
def turn_of_heading(kappa, L_n, Omega, x, angle):
    """Return the turn of the heading, towards b, while the axis turns by x about L [rad].

    `angle` is the angle between the headings at both ends, in (-pi, pi]. Where the vertical is outside the cone of the
    axis, the heading swings by less than half a turn. Else it goes round one way, once with every turn of the axis:
    theta' = (L_n - kappa Omega u_n) / cos(beta)^2 does not change its sign. During half a turn of the axis it goes at
    least a quarter of a turn and at most three quarters.
    """
    if abs(L_n) <= abs(kappa) * Omega:
        return angle
    sign = -copysign(1.0, L_n)
    turns = nearest(x / TWO_PI)
    turns -= 1.0 if turns > x / TWO_PI else 0.0  # rounded down
    least = -0.25 * TWO_PI if x - turns * TWO_PI < 0.5 * TWO_PI else 0.25 * TWO_PI
    return angle + sign * TWO_PI * (turns if sign * angle > least else turns + 1.0)


@compiled
def dip_at(dm, rise, sin_b, cos_b):
    """Return the dip above level at which sin(beta) is `rise` above that of level, with all the digits of the rise."""
    sin_d = rise * (dm.cos_0 + dm.sin_0 * (sin_b + dm.sin_0) / (cos_b + dm.cos_0))
    return atan2(sin_d, cos_b * dm.cos_0 + sin_b * dm.sin_0)


@compiled
def fly(dm, fl, state, t, path):
    """Move a state on by the time t of free motion, in place.

    Parameters
    ----------
    dm : Dimer
    fl : Flight
        From ``take_off(dm, state)``.
    state : float64 array, shape (N_STATE,)
        Modified in place.
    t : float
        Time of flight [s].
    path : bool
        True if the cyclic coordinates x1, y1, gamma are wanted (theta always is).
    """
    sin_b, cos_b, (L_a, L_b, L_n) = fl.sin_b, fl.cos_b, fl.L
    gap_1, rate_1, _, _ = gap_series(dm, fl, 0, t)
    gap_2, rate_2, _, _ = gap_series(dm, fl, 1, t)
    u_a, u_b, rise = cos_b, 0.0, lift(dm, state[DIP])
    turn = 0.0
    if fl.Omega > 0.0:
        kappa = dm.J_a / dm.J_t * state[SPIN] / fl.Omega
        v_a, v_b = -sin_b * state[WB] / fl.Omega, -state[WP] / fl.Omega
        x = fl.Omega * t
        s, c = sincos(x)
        par_a, par_b = kappa * L_a / fl.Omega, kappa * L_b / fl.Omega
        u_a, u_b = par_a + (u_a - par_a) * c + v_a * s, par_b * (1.0 - c) + v_b * s
        turn = turn_of_heading(kappa, L_n, fl.Omega, x, atan2(cos_b * u_b, cos_b * u_a))
        rise += -fl.c1 * one_minus_cos(s, c) + fl.c2 * s
    new_cos, u_n = length(u_a, u_b), dm.sin_0 + rise
    co, si = (u_a / new_cos, u_b / new_cos) if new_cos > 0.0 else (1.0, 0.0)
    if path:
        advance_path(dm, fl, state, t, turn, (u_a, u_b, u_n), (co, si))
    if dm.sideways != 0.0:
        swing_along(dm, state, t, path)
    c_a, c_b = state[CA], state[CB]
    state[PHASE] += dm.omega * t
    state[N1], state[N2] = rate_1, rate_2
    # the smaller gap keeps its relative precision, the other one follows from the dip
    if abs(gap_1) <= abs(gap_2):
        state[D1], state[D2] = gap_1, gap_1 + dm.l * rise
    else:
        state[D1], state[D2] = gap_2 - dm.l * rise, gap_2
    state[DIP] = dip_at(dm, rise, u_n, new_cos)
    state[WB] = L_b * co - L_a * si
    state[WP] = -u_n * (L_a * co + L_b * si) + new_cos * L_n
    state[CA] = c_a * co + c_b * si
    state[CB] = c_b * co - c_a * si
    state[THETA] -= turn


@compiled
def swing_along(dm, state, t, path):
    """Add the motion and the tilt of the plate to velocity and place over a flight, in place; see `plate.swung`."""
    sin_t, cos_t = sincos(state[THETA])
    v_x, x, v_y, y = swung(dm, state[PHASE] + dm.phi0, t)
    state[CA] += v_y * cos_t - v_x * sin_t
    state[CB] += v_x * cos_t + v_y * sin_t
    if path:
        state[X1] += x
        state[Y1] += y


@compiled
def advance_path(dm, fl, state, t, turn, u, new):
    """Move x1, y1 and the spinning angle gamma on over a flight, in place.

    The rest of the state is still that of the start of the flight. At its end the axis is u, in the frame of the
    heading at the start; `new` has cosine and sine of the new heading in that frame.
    """
    sin_t, cos_t = sincos(state[THETA])
    (u_a, u_b, u_n), (co, si) = u, new
    s_a = state[CA] * t + dm.p1.h * (u_a - fl.cos_b)
    s_b = state[CB] * t + dm.p1.h * u_b
    state[X1] += -s_a * sin_t + s_b * cos_t
    state[Y1] += s_a * cos_t + s_b * sin_t
    spin = state[SPIN]
    state[GAMMA] += (1.0 - dm.J_a / dm.J_t) * spin * t
    if fl.Omega == 0.0:
        return
    # b turned about L, measured against the new b in the plane across the axis
    x = fl.Omega * t
    s, c = sincos(x)
    k = one_minus_cos(s, c)
    l_a, l_b, l_n = fl.L[0] / fl.Omega, fl.L[1] / fl.Omega, fl.L[2] / fl.Omega
    b_a = l_n * s + l_a * l_b * k
    b_b = 1.0 - k + l_b * l_b * k
    b_n = -l_a * s + l_n * l_b * k
    new_cos = sqrt(max(0.0, 1.0 - u_n * u_n))
    along_b = b_b * co - b_a * si
    along_p = -u_n * (b_a * co + b_b * si) + new_cos * b_n
    angle = atan2(-along_p, along_b)
    # the winding follows the heading: gamma' = spin - theta' sin(beta)
    guess = dm.J_a / dm.J_t * spin * t + turn * 0.5 * (dm.sin_0 + lift(dm, state[DIP]) + u_n)
    angle += TWO_PI * nearest((guess - angle) / TWO_PI)
    state[GAMMA] += angle
