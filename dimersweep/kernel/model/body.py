"""The dimer's body: masses and inertias, contact Jacobian and Delassus operator in the heading frame (Appendix A).

With the velocity of the centre of mass (c_a, c_b, c_n) and the spin components (beta', theta' cos(beta), axial spin) as
quasi-velocities the mass matrix of (A.4) is diag(m, m, m, J_t, J_t, J_a), and the contact point of end i (s_1 = -1,
s_2 = +1) moves with

    gap rate   n_i = c_n + s_i h cos(beta) beta'
    axial      a_i = c_a + (r - s_i h sin(beta)) beta'
    lateral    b_i = c_b + (r sin(beta) - s_i h) theta' cos(beta) - r cos(beta) spin

so W and N of (A.1), (A.3) have one row each, and normal and axial motion never couple to the lateral one.
"""

from math import pi, sqrt
from typing import NamedTuple

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.model.layout import Dimer
from dimersweep.kernel.model.plate import TWO_PI, amplitude


@compiled
def as_dimer(row):
    """Dimer of one parameter row.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units.

    Returns
    -------
    Dimer
        Derived constants: inertias of a solid rod of length l - 2r between two solid balls.
    """
    e_1, e_2, Gamma, f, A_r, mu, mu_s, _, _, phi0, r, rho_b, rho_r, D_r, g, Gamma_2, phi_2, mu_h = row
    lever = 2.0 * r * (A_r - 1.0)
    rod = lever - 2.0 * r
    m_b = rho_b * 4.0 / 3.0 * pi * r**3
    m_r = rho_r * pi * 0.25 * D_r**2 * rod
    J_t = 2.0 * (0.4 * m_b * r**2 + 0.25 * m_b * lever**2) + m_r * (rod**2 / 12.0 + D_r**2 / 16.0)
    J_a = 0.8 * m_b * r**2 + 0.125 * m_r * D_r**2
    m = 2.0 * m_b + m_r
    omega = TWO_PI * f
    hold = mu * (
        1.0 + 1e-9
    )  # a hair above mu where it is equal: slip that sets out of rest accelerates, however slowly
    return Dimer(
        e_1,
        e_2,
        mu,
        max(mu_s, hold),
        max(mu_h, hold),
        g,
        amplitude(Gamma, g, omega),
        omega,
        1.0 / f,
        phi0 - TWO_PI * (phi0 // TWO_PI),
        amplitude(Gamma_2, g, 2.0 * omega),
        (phi_2 - 2.0 * phi0) % TWO_PI,
        r,
        0.5 * lever,
        m,
        J_t,
        J_a,
        1.0 / m,
        1.0 / J_t,
        1.0 / J_a,
        min(g / omega, sqrt(g * lever)),
        sqrt(g / lever),
    )


@exported
def dimer_of(row):
    """The same for Python."""
    return as_dimer(row)


class Levers(NamedTuple):
    """Contact Jacobian of one end at one dip angle: what unit spin components add to its contact velocity [m]."""

    n: float  # gap rate per beta'
    a: float  # axial velocity per beta'
    b: float  # lateral velocity per theta' cos(beta)
    c: float  # lateral velocity per axial spin


@compiled
def levers(dm, s, sin_b, cos_b):
    """Contact Jacobian of the end with sign s (-1 for p1, +1 for p2)."""
    return Levers(s * dm.h * cos_b, dm.r - s * dm.h * sin_b, dm.r * sin_b - s * dm.h, -dm.r * cos_b)


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
