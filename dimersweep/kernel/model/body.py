"""The dimer's body: masses and inertias, contact Jacobian and Delassus operator in the heading frame (Appendix A).

It is an axisymmetric body with two balls that need not be alike. With the velocity of the centre of mass (c_a, c_b, c_n) and
the spin components (beta', theta' cos(beta), axial spin) as quasi-velocities the mass matrix of (A.4) is
diag(m, m, m, J_t, J_t, J_a), and the contact point of end i, whose ball of radius r_i has its centre at h_i on the axis
(h_1 < 0 < h_2), moves with

    gap rate   n_i = c_n + h_i cos(beta) beta'
    axial      a_i = c_a + (r_i - h_i sin(beta)) beta'
    lateral    b_i = c_b + (r_i sin(beta) - h_i) theta' cos(beta) - r_i cos(beta) spin

so W and N of (A.1), (A.3) have one row each, and normal and axial motion never couple to the lateral one.

Both ends touch the plate where sin(beta_0) = (r_2 - r_1) / l, which is called level. There both axial levers are the height of
the centre of mass: the ends share one axial velocity. Dip angles count from there in the kernel: a small gap, and the dip that
opens it, so have all their digits.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.model.layout import CA, CB, DIP, SPIN, WB, WP, Dimer, End
from dimersweep.kernel.model.plate import TWO_PI, amplitude
from dimersweep.kernel.numerics.elementary import atan2
from dimersweep.kernel.numerics.sincos import one_minus_cos, sincos

# by which stick friction is above slip friction at least: a slip out of rest accelerates, however slowly
STICK_MARGIN = 1e-9


@compiled
def as_dimer(row):
    """Dimer of one parameter row: a solid rod between the surfaces of two solid balls.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units.

    Returns
    -------
    Dimer
    """
    # fmt: off
    (e_1, e_2, Gamma, f, A_r, mu_1, mu_2, mu_s_1, mu_s_2, mu_h_1, mu_h_2, _, _, phi0, r_1, r_2, rho_b_1, rho_b_2, rho_r,
     D_r, g, Gamma_2, phi_2, eta, k_ratio, tilt, azimuth, Gamma_x, phi_x, Gamma_y, phi_y, _, _, _, _, _, _) = row
    # fmt: on
    lever = (A_r - 1.0) * (r_1 + r_2)
    rod = lever - (r_1 + r_2)
    m_1, m_2 = rho_b_1 * 4.0 / 3.0 * pi * r_1**3, rho_b_2 * 4.0 / 3.0 * pi * r_2**3
    m_r = rho_r * pi * 0.25 * D_r**2 * rod
    m = m_1 + m_2 + m_r
    # places on the axis, from the middle between the ball centres: of the centre of mass, and from there of the rod's middle
    centre = 0.5 * ((m_2 - m_1) * lever + m_r * (r_1 - r_2)) / m
    rod_at = 0.5 * (r_1 - r_2) - centre
    h_1, h_2 = -0.5 * lever - centre, 0.5 * lever - centre
    J_t = 0.4 * (m_1 * r_1**2 + m_2 * r_2**2) + (m_1 * h_1**2 + m_2 * h_2**2)
    J_t += m_r * (rod**2 / 12.0 + D_r**2 / 16.0 + rod_at**2)
    J_a = 0.4 * (m_1 * r_1**2 + m_2 * r_2**2) + 0.125 * m_r * D_r**2
    sin_0 = (r_2 - r_1) / lever
    cos_0 = sqrt((1.0 - sin_0) * (1.0 + sin_0))
    sin_tilt, cos_tilt = sincos(tilt)
    sin_way, cos_way = sincos(azimuth)
    omega = TWO_PI * f
    hold_1, hold_2 = mu_1 * (1.0 + STICK_MARGIN), mu_2 * (1.0 + STICK_MARGIN)
    return Dimer(
        End(-1.0, r_1, h_1, e_1, mu_1, max(mu_s_1, hold_1), max(mu_h_1, hold_1), 1.0),
        End(1.0, r_2, h_2, e_2, mu_2, max(mu_s_2, hold_2), max(mu_h_2, hold_2), k_ratio),
        lever,
        atan2(sin_0, cos_0),
        sin_0,
        cos_0,
        eta,
        m,
        J_t,
        J_a,
        1.0 / m,
        1.0 / J_t,
        1.0 / J_a,
        g * cos_tilt,
        amplitude(Gamma, g, omega),
        omega,
        1.0 / f,
        phi0 - TWO_PI * (phi0 // TWO_PI),
        amplitude(Gamma_2, g, 2.0 * omega),
        (phi_2 - 2.0 * phi0) % TWO_PI,
        1.0 if tilt != 0.0 or Gamma_x != 0.0 or Gamma_y != 0.0 else 0.0,
        g * sin_tilt * cos_way,
        g * sin_tilt * sin_way,
        Gamma_x * g,
        phi_x % TWO_PI,
        Gamma_y * g,
        phi_y % TWO_PI,
        min(g / omega, sqrt(g * lever)),
        sqrt(g / lever),
    )


@exported
def dimer_of(row):
    """The dimer of one parameter row, for Python; see `as_dimer`."""
    return as_dimer(row)


@compiled
def end(dm, i):
    """End number i: 0 is p1, 1 is p2."""
    return dm.p1 if i == 0 else dm.p2


# --- the dip ----------------------------------------------------------------------------------------------------------


@compiled
def tilted(dm, sin_d, cos_d):
    """Sine and cosine of the dip angle beta, from those of the dip above level."""
    return dm.sin_0 * cos_d + dm.cos_0 * sin_d, dm.cos_0 * cos_d - dm.sin_0 * sin_d


@compiled
def attitude(dm, dip):
    """Sine and cosine of the dip angle beta at a dip above level."""
    sin_d, cos_d = sincos(dip)
    return tilted(dm, sin_d, cos_d)


@compiled
def lift(dm, dip):
    """sin(beta) - sin(beta_0): by how much p2 is higher over the plate than p1, in units of l."""
    sin_d, cos_d = sincos(dip)
    return dm.cos_0 * sin_d - dm.sin_0 * one_minus_cos(sin_d, cos_d)


# --- contact Jacobian and Delassus operator -----------------------------------------------------------------------------


class Levers(NamedTuple):
    """Contact Jacobian of one end at one dip angle: what unit spin components add to its contact velocity [m]."""

    n: float  # gap rate per beta'
    a: float  # axial velocity per beta'
    b: float  # lateral velocity per theta' cos(beta)
    c: float  # lateral velocity per axial spin


@compiled
def levers(p, sin_b, cos_b):
    """Contact Jacobian of the end p, (A.1) and (A.3)."""
    return Levers(p.h * cos_b, p.r - p.h * sin_b, p.r * sin_b - p.h, -p.r * cos_b)


@compiled
def level_levers(dm):
    """Contact Jacobians of p1 and p2 where both touch the plate."""
    return levers(dm.p1, dm.sin_0, dm.cos_0), levers(dm.p2, dm.sin_0, dm.cos_0)


class Delassus(NamedTuple):
    """What a unit impulse at one end does to the contact velocity of the same or the other end [1/kg]."""

    nn: float
    na: float  # normal velocity of the first end per axial impulse at the second
    an: float  # axial velocity of the first end per normal impulse at the second
    aa: float
    bb: float


@compiled
def delassus(dm, p, q):
    """Delassus operator between the ends with levers p and q: velocity at p per impulse at q."""
    im, it = dm.im, dm.it
    return Delassus(
        im + p.n * q.n * it,
        p.n * q.a * it,
        p.a * q.n * it,
        im + p.a * q.a * it,
        im + p.b * q.b * it + p.c * q.c * dm.ia,
    )


class Pair(NamedTuple):
    """Delassus operator of both ends on the plate [1/kg]: they share the axial velocity, and normal and lateral do not mix."""

    nn_1: float
    nn_2: float
    nn_12: float
    na_1: float  # gap rate of p1 per axial impulse, and axial velocity per normal impulse at p1
    na_2: float
    aa: float
    bb_1: float
    bb_2: float
    bb_12: float


@compiled
def pair_of(dm):
    """Delassus operator of both ends where both touch the plate."""
    p, q = level_levers(dm)
    w_1, w_2, w_12 = delassus(dm, p, p), delassus(dm, q, q), delassus(dm, p, q)
    return Pair(w_1.nn, w_2.nn, w_12.nn, w_1.na, w_2.na, w_1.aa, w_1.bb, w_2.bb, w_12.bb)


# --- velocities ---------------------------------------------------------------------------------------------------------


@compiled
def rise_of_centre(dm, n_1, n_2):
    """Velocity of the centre of mass along the normal, over the plate, from the gap rates of both ends [m s-1]."""
    return (dm.p2.h * n_1 - dm.p1.h * n_2) / dm.l


@compiled
def apart_sideways(dm, w_p, spin):
    """Lateral velocity of p1 less that of p2 where both touch the plate [m s-1].

    It is l cos(beta_0) times the turning rate about the vertical.
    """
    return dm.l * dm.cos_0 * (dm.cos_0 * w_p + dm.sin_0 * spin)


@compiled
def turn_of_pair(dm, apart, spin):
    """theta' cos(beta) where both ends touch the plate, from the lateral velocity of p1 less that of p2."""
    return (apart / (dm.l * dm.cos_0) - dm.sin_0 * spin) / dm.cos_0


@compiled
def reach(dm):
    """Radius of the greater ball, and the distance of the centre of mass from the farther one [m]."""
    return max(dm.p1.r, dm.p2.r), max(-dm.p1.h, dm.p2.h)


# --- for Python ---------------------------------------------------------------------------------------------------------


def dip_of(dm, rise):
    """Dip above level [rad] at which p2 is higher over the plate than p1 by `rise` [m]; floats, or arrays of one shape."""
    share = np.asarray(rise) / dm.l
    sin_b = np.clip(dm.sin_0 + share, -1.0, 1.0)
    cos_b = np.sqrt((1.0 - sin_b) * (1.0 + sin_b))
    sin_d = share * (dm.cos_0 + dm.sin_0 * (sin_b + dm.sin_0) / (cos_b + dm.cos_0))
    return np.arctan2(sin_d, cos_b * dm.cos_0 + sin_b * dm.sin_0)


def rise_at(dm, beta):
    """By how much p2 is higher over the plate than p1 [m] at the dip angle `beta` [rad]; floats, or arrays of one shape."""
    dip = beta - dm.beta_0
    return 2.0 * dm.l * np.sin(0.5 * dip) * np.cos(0.5 * (beta + dm.beta_0))


def slip_at(dm, state, i):
    """Axial and lateral velocity of the contact point of end i in a kernel state [m s-1]."""
    beta = dm.beta_0 + state[DIP]
    lv = getattr(levers, "py_func", levers)((dm.p1, dm.p2)[i], np.sin(beta), np.cos(beta))
    return state[CA] + lv.a * state[WB], state[CB] + lv.b * state[WP] + lv.c * state[SPIN]
