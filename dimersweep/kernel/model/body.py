"""The dimer's body: masses and inertias, contact Jacobian and Delassus operator in the heading frame (Appendix A).

It is an axisymmetric body with two balls that need not be alike. The quasi-velocities are the velocity of the centre of
mass (c_a, c_b, c_n) and the spin components (beta', theta' cos(beta), axial spin). With them the mass matrix of (A.4)
is diag(m, m, m, J_t, J_t, J_a). The ball of end i has the radius r_i and its centre at h_i on the axis (h_1 < 0 < h_2).
Its contact point moves with

    gap rate   n_i = c_n + h_i cos(beta) beta'
    axial      a_i = c_a + (r_i - h_i sin(beta)) beta'
    lateral    b_i = c_b + (r_i sin(beta) - h_i) theta' cos(beta) - r_i cos(beta) spin

so W and N of (A.1), (A.3) have one row each, and normal and axial motion never couple to the lateral one.

Both ends touch the plate where sin(beta_0) = (r_2 - r_1) / l, which is called level. There both axial levers are the
height of the centre of mass: the ends share one axial velocity. Dip angles count from there in the kernel. So a small
gap, and the dip that opens it, have all their digits.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, exported, plain
from dimersweep.kernel.compiler.records import new_record
from dimersweep.kernel.model.layout import CA, CB, DIP, N1, N2, N_DIMER_ROW, SPIN, THETA, WB, WP, X1, Y1, Dimer
from dimersweep.kernel.model.plate import set_plate
from dimersweep.kernel.numerics.elementary import atan2
from dimersweep.kernel.numerics.sincos import one_minus_cos, sincos

# share by which stick friction exceeds slip friction at least: so a slip out of rest accelerates, however slowly
STICK_MARGIN = 1e-9


@compiled
def set_friction(p, mu, mu_s, mu_h):
    """Set the friction of an end; the friction that holds is a little above that of slip, by STICK_MARGIN at least."""
    least = mu * (1.0 + STICK_MARGIN)
    p.mu, p.mu_hit, p.mu_s, p.mu_h = mu, mu, max(mu_s, least), max(mu_h, least)


@compiled
def set_split(split, w_1, w_2):
    """Set the split of two forces from the velocity that a unit of each gives."""
    split.both, split.apart = 0.5 * (w_1 + w_2), 0.5 * (w_1 - w_2)


@compiled
def set_pair(dm):
    """Set the Delassus operator of both ends at a double contact."""
    w, (p, q) = dm.pair, level_levers(dm)
    w_1, w_2, w_12 = delassus(dm, p, p), delassus(dm, q, q), delassus(dm, p, q)
    w.nn_1, w.nn_2, w.nn_12 = dm.m * w_1.nn, dm.m * w_2.nn, dm.m * w_12.nn
    w.na_1, w.na_2, w.aa = dm.m * w_1.na, dm.m * w_2.na, dm.m * w_1.aa
    w.bb_1, w.bb_2, w.bb_12 = dm.m * w_1.bb, dm.m * w_2.bb, dm.m * w_12.bb
    set_split(w.n_1, w.nn_1, w.nn_12)
    set_split(w.n_2, w.nn_12, w.nn_2)
    set_split(w.a, w.na_1, w.na_2)
    set_split(w.b_1, w.bb_1, w.bb_12)
    set_split(w.b_2, w.bb_12, w.bb_2)


@compiled
def set_dimer(row, dm):
    """Set the dimer of one parameter row: a solid rod between the surfaces of two solid balls.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units.
    dm : Dimer
        Filled in place.
    """
    # fmt: off
    (e_1, e_2, f, A_r, mu_1, mu_2, mu_s_1, mu_s_2, mu_h_1, mu_h_2,
     r_1, r_2, rho_b_1, rho_b_2, rho_r, D_r, g, eta, k_ratio, tilt, azimuth) = row[:N_DIMER_ROW]
    # fmt: on
    lever = (A_r - 1.0) * (r_1 + r_2)
    rod = lever - (r_1 + r_2)
    # products in place of powers: Python's powers come from the system's library
    m_1, m_2 = rho_b_1 * 4.0 / 3.0 * pi * (r_1 * r_1 * r_1), rho_b_2 * 4.0 / 3.0 * pi * (r_2 * r_2 * r_2)
    m_r = rho_r * pi * 0.25 * (D_r * D_r) * rod
    m = m_1 + m_2 + m_r
    # places on the axis: of the centre of mass from the middle between the ball centres, of the rod's middle from that
    # centre
    centre = 0.5 * ((m_2 - m_1) * lever + m_r * (r_1 - r_2)) / m
    rod_at = 0.5 * (r_1 - r_2) - centre
    h_1, h_2 = -0.5 * lever - centre, 0.5 * lever - centre
    p, q = dm.p1, dm.p2
    p.s, p.r, p.h, p.e, p.k = -1.0, r_1, h_1, e_1, 1.0
    q.s, q.r, q.h, q.e, q.k = 1.0, r_2, h_2, e_2, k_ratio
    set_friction(p, mu_1, mu_s_1, mu_h_1)
    set_friction(q, mu_2, mu_s_2, mu_h_2)
    J_t = 0.4 * (m_1 * (r_1 * r_1) + m_2 * (r_2 * r_2)) + (m_1 * (h_1 * h_1) + m_2 * (h_2 * h_2))
    J_t += m_r * (rod * rod / 12.0 + D_r * D_r / 16.0 + rod_at * rod_at)
    J_a = 0.4 * (m_1 * (r_1 * r_1) + m_2 * (r_2 * r_2)) + 0.125 * m_r * (D_r * D_r)
    dm.m, dm.J_t, dm.J_a = m, J_t, J_a
    dm.im, dm.it, dm.ia = 1.0 / m, 1.0 / J_t, 1.0 / J_a
    dm.l, dm.sin_0 = lever, (r_2 - r_1) / lever
    dm.cos_0 = sqrt((1.0 - dm.sin_0) * (1.0 + dm.sin_0))
    dm.beta_0 = atan2(dm.sin_0, dm.cos_0)
    dm.eta = eta
    set_pair(dm)
    set_plate(row, f, g, tilt, azimuth, dm)
    dm.v_scale, dm.w_scale = min(g / dm.omega, sqrt(g * lever)), sqrt(g / lever)


@exported
def fill_dimer(row, dm):
    """Set the dimer of one parameter row from Python; see `set_dimer`."""
    set_dimer(row, dm)


def dimer_of(row: np.ndarray) -> Dimer:
    """Return the dimer of one parameter row, for Python; see `set_dimer`."""
    dm = new_record(Dimer)
    fill_dimer(row, dm)
    return dm


@compiled(inline=True)
def end(dm, i):
    """Return end number i: 0 is p1, 1 is p2."""
    return dm.p1 if i == 0 else dm.p2


# --- the dip ----------------------------------------------------------------------------------------------------------


@compiled(inline=True)
def attitude(dm, dip):
    """Return sine and cosine of the dip angle beta at a dip above level."""
    return sincos(dm.beta_0 + dip)


@compiled
def centre(dm, state):
    """Return the place x, y of the centre of mass on the plate [m]."""
    _, cos_b = attitude(dm, state[DIP])
    sin_t, cos_t = sincos(state[THETA])
    reach = -dm.p1.h * cos_b
    return state[X1] - reach * sin_t, state[Y1] + reach * cos_t


@compiled(inline=True)
def lift(dm, dip):
    """Return sin(beta) - sin(beta_0): how much higher p2 is over the plate than p1, in units of l."""
    sin_d, cos_d = sincos(dip)
    return dm.cos_0 * sin_d - dm.sin_0 * one_minus_cos(sin_d, cos_d)


# --- contact Jacobian and Delassus operator -----------------------------------------------------------------------------


class Levers(NamedTuple):
    """Contact Jacobian of one end at one dip angle: contact velocity per unit spin component [m]."""

    n: float  # gap rate per beta'
    a: float  # axial velocity per beta'
    b: float  # lateral velocity per theta' cos(beta)
    c: float  # lateral velocity per axial spin


@compiled(inline=True)
def levers(p, sin_b, cos_b):
    """Return the contact Jacobian of the end p, (A.1) and (A.3)."""
    return Levers(p.h * cos_b, p.r - p.h * sin_b, p.r * sin_b - p.h, -p.r * cos_b)


@compiled(inline=True)
def level_levers(dm):
    """Return the contact Jacobians of p1 and p2 at the dip at which both touch the plate."""
    return levers(dm.p1, dm.sin_0, dm.cos_0), levers(dm.p2, dm.sin_0, dm.cos_0)


class Delassus(NamedTuple):
    """Contact velocity of an end per unit impulse at the same or the other end [1/kg]."""

    nn: float
    na: float  # normal velocity of the first end per axial impulse at the second
    an: float  # axial velocity of the first end per normal impulse at the second
    aa: float
    bb: float


@compiled(inline=True)
def delassus(dm, p, q):
    """Return the Delassus operator between the ends with levers p and q: velocity at p per impulse at q."""
    im, it = dm.im, dm.it
    return Delassus(
        im + p.n * q.n * it,
        p.n * q.a * it,
        p.a * q.n * it,
        im + p.a * q.a * it,
        im + p.b * q.b * it + p.c * q.c * dm.ia,
    )


# --- velocities ---------------------------------------------------------------------------------------------------------


@compiled
def rise_of_centre(dm, n_1, n_2):
    """Return the normal velocity of the centre of mass relative to the plate [m s-1]; n_1, n_2 are the gap rates."""
    return (dm.p2.h * n_1 - dm.p1.h * n_2) / dm.l


@compiled
def apart_sideways(dm, w_p, spin):
    """Return the lateral velocity of p1 less that of p2 where both touch the plate [m s-1].

    It is l cos(beta_0) times the turning rate about the vertical.
    """
    return dm.l * dm.cos_0 * (dm.cos_0 * w_p + dm.sin_0 * spin)


@compiled
def turn_of_pair(dm, apart, spin):
    """Return theta' cos(beta) where both ends touch the plate, from the lateral velocity of p1 less that of p2."""
    return (apart / (dm.l * dm.cos_0) - dm.sin_0 * spin) / dm.cos_0


@compiled
def lateral_impulses(dm, d_1, d_2):
    """Return the lateral impulses at both ends on the plate that change their lateral velocities.

    d_1 and d_2 are the changes of the velocities times m [kg m s-1].
    """
    w = dm.pair
    det = w.bb_1 * w.bb_2 - w.bb_12 * w.bb_12
    return (w.bb_2 * d_1 - w.bb_12 * d_2) / det, (w.bb_1 * d_2 - w.bb_12 * d_1) / det


@compiled(inline=True)
def extent(dm):
    """Return the radius of the larger ball, and the distance of the centre of mass from the farther ball centre [m]."""
    return max(dm.p1.r, dm.p2.r), max(-dm.p1.h, dm.p2.h)


# --- for Python ---------------------------------------------------------------------------------------------------------


def rise_at(dm, beta):
    """Return how much higher p2 is over the plate than p1 [m] at the dip angle `beta` [rad].

    It takes floats, or arrays of one shape.
    """
    dip = beta - dm.beta_0
    return 2.0 * dm.l * np.sin(0.5 * dip) * np.cos(0.5 * (beta + dm.beta_0))


def slip_at(dm, state, i):
    """Return the axial and lateral velocity of the contact point of end i in a kernel state [m s-1], for Python."""
    beta = dm.beta_0 + state[DIP]
    lv = plain(levers)((dm.p1, dm.p2)[i], np.sin(beta), np.cos(beta))
    return state[CA] + lv.a * state[WB], state[CB] + lv.b * state[WP] + lv.c * state[SPIN]


@compiled
def contact_velocity(dm, state, i):
    """Return gap rate, axial and lateral velocity of the contact point of end i [m/s]."""
    lv = levers(end(dm, i), *attitude(dm, state[DIP]))
    return state[N1 + i], state[CA] + lv.a * state[WB], state[CB] + lv.b * state[WP] + lv.c * state[SPIN]


@compiled
def slip_rounding(dm, state):
    """Return the round-off of a contact velocity [m/s]: slip below it counts as none."""
    r, h = extent(dm)
    size = abs(state[CA]) + abs(state[CB]) + r * abs(state[SPIN]) + h * (abs(state[WB]) + abs(state[WP]))
    # eight units of round-off: a contact velocity is a sum of three products of rounded numbers
    return 8.0 * 2.3e-16 * size


@compiled
def kinetic(dm, state):
    """Return the kinetic energy in the plate's frame [J]."""
    c_n = rise_of_centre(dm, state[N1], state[N2])
    moving = dm.m * (state[CA] * state[CA] + state[CB] * state[CB] + c_n * c_n)
    turning = dm.J_t * (state[WB] * state[WB] + state[WP] * state[WP])
    return 0.5 * (moving + turning + dm.J_a * state[SPIN] * state[SPIN])
