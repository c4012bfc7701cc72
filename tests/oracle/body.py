"""The dimer of the paper's Appendix A: constants, and the 6x6 matrices as printed there.

Coordinates q = (x1, y1, delta1, theta, beta, gamma): the paper's, with the gap delta1 = z1 - r - z_p(t) in the place of
z1. As M(q) does not depend on z1, that only turns g into the effective g_e(t) = g + z_p''(t) in Q.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEFAULTS = {
    "e": 0.6, "Gamma": 0.9, "f": 15.0, "A_r": 6.0, "mu": 0.2, "mu_s": 0.4, "beta0": 4 * pi / 45, "xdot0": 1.0,
    "phi0": 0.0, "r": 5e-3, "rho_b": 7850.0, "rho_r": 1180.0, "D_r": 4e-3, "g": 9.81,
}  # fmt: skip


@dataclass(frozen=True)
class Dimer:
    """Constants of one dimer and its plate (SI)."""

    r: float
    l: float  # noqa: E741  (the paper's name)
    m: float
    J1: float  # transverse inertia about the centre of mass
    J2: float  # axial inertia
    e: tuple[float, float]
    mu: float
    mu_s: float
    mu_h: float
    A_z: float
    omega: float
    phi0: float
    A_2: float
    phi_2: float
    g: float


def dimer(params: Mapping[str, float]) -> Dimer:
    """Constants that follow from named parameters.

    Parameters
    ----------
    params : mapping
        Any of the names in `DEFAULTS`; e_1, e_2 where the two ends differ; Gamma_2, phi_2 of the plate's second harmonic;
        mu_h where a lasting contact is held by another coefficient than mu_s.

    Returns
    -------
    Dimer
    """
    unknown = set(params) - set(DEFAULTS) - {"e_1", "e_2", "Gamma_2", "phi_2", "mu_h"}
    if unknown:
        raise ValueError(f"unknown parameters: {sorted(unknown)}")
    p = {**DEFAULTS, **params}
    r, length = p["r"], 2 * p["r"] * (p["A_r"] - 1)
    m_b = p["rho_b"] * 4 / 3 * pi * r**3
    m_r = p["rho_r"] * pi / 4 * p["D_r"] ** 2 * (length - 2 * r)
    J1 = 2 * (2 / 5 * m_b * r**2 + m_b * length**2 / 4) + m_r * ((length - 2 * r) ** 2 / 12 + p["D_r"] ** 2 / 16)
    J2 = 2 * (2 / 5) * m_b * r**2 + m_r * p["D_r"] ** 2 / 8
    omega = 2 * pi * p["f"]
    return Dimer(
        r=r, l=length, m=2 * m_b + m_r, J1=J1, J2=J2, e=(p.get("e_1", p["e"]), p.get("e_2", p["e"])),
        mu=p["mu"], mu_s=p["mu_s"], mu_h=p.get("mu_h", p["mu_s"]), A_z=p["Gamma"] * p["g"] / omega**2, omega=omega,
        phi0=p["phi0"], A_2=p.get("Gamma_2", 0.0) * p["g"] / (2 * omega) ** 2, phi_2=p.get("phi_2", 0.0), g=p["g"],
    )  # fmt: skip


def effective_gravity(d: Dimer, t: float) -> float:
    """g + z_p''(t), the gravity felt in the plate's frame."""
    first, second = d.omega * t + d.phi0, 2 * d.omega * t + d.phi_2
    return d.g - d.A_z * d.omega**2 * sin(first) - d.A_2 * (2 * d.omega) ** 2 * sin(second)


def plate_rate(d: Dimer, t: float) -> float:
    """z_p'(t)."""
    first, second = d.omega * t + d.phi0, 2 * d.omega * t + d.phi_2
    return d.A_z * d.omega * cos(first) + d.A_2 * 2 * d.omega * cos(second)


def mass_matrix(d: Dimer, q: Array) -> Array:
    """M(q), eq. (A.4)."""
    st, ct, sb, cb = sin(q[3]), cos(q[3]), sin(q[4]), cos(q[4])
    half = d.m * d.l / 2
    M14, M15, M24, M25 = -half * cb * ct, half * sb * st, -half * cb * st, -half * sb * ct
    M44 = (d.m * d.l**2 / 4 + d.J1) * cb**2 + d.J2 * sb**2
    M55 = d.m * d.l**2 / 4 + d.J1
    return np.array(
        [
            [d.m, 0, 0, M14, M15, 0],
            [0, d.m, 0, M24, M25, 0],
            [0, 0, d.m, 0, half * cb, 0],
            [M14, M24, 0, M44, 0, d.J2 * sb],
            [M15, M25, half * cb, 0, M55, 0],
            [0, 0, 0, d.J2 * sb, 0, d.J2],
        ]
    )


def inertial_forces(d: Dimer, q: Array, qdot: Array) -> Array:
    """h(q, q'), eq. (A.5); its "m_l" is m times l."""
    st, ct, sb, cb = sin(q[3]), cos(q[3]), sin(q[4]), cos(q[4])
    dt, db, dg = qdot[3], qdot[4], qdot[5]
    half, quarter = d.m * d.l / 2, d.m * d.l**2 / 4
    return np.array(
        [
            -half * (cb * st * (dt**2 + db**2) + 2 * sb * ct * dt * db),
            half * (cb * ct * (dt**2 + db**2) - 2 * sb * st * dt * db),
            half * sb * db**2,
            (2 * (d.J1 - d.J2 + quarter) * sb * dt - d.J2 * dg) * cb * db,
            -((d.J1 - d.J2 + quarter) * sb * dt - d.J2 * dg) * cb * dt,
            -d.J2 * cb * dt * db,
        ]
    )


def gravity_forces(d: Dimer, q: Array, g_e: float) -> Array:
    """Q(q), eq. (A.6), under the gravity `g_e`."""
    return np.array([0, 0, -d.m * g_e, 0, -d.m * g_e * d.l * cos(q[4]) / 2, 0])


def normal_matrix(d: Dimer, q: Array) -> Array:
    """W(q), eq. (A.1), shape (6, 2)."""
    return np.array([[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, d.l * cos(q[4]), 0]]).T


def tangential_matrix(d: Dimer, q: Array) -> Array:
    """N(q), eq. (A.3), shape (6, 4), columns 1x, 2x, 1y, 2y."""
    st, ct, sb, cb = sin(q[3]), cos(q[3]), sin(q[4]), cos(q[4])
    r, length = d.r, d.l
    return np.array(
        [
            [1, 1, 0, 0],
            [0, 0, 1, 1],
            [0, 0, 0, 0],
            [0, -length * ct * cb, 0, -length * st * cb],
            [-r * st, (length * sb - r) * st, r * ct, (r - length * sb) * ct],
            [-r * ct * cb, -r * ct * cb, -r * st * cb, -r * st * cb],
        ]
    )


def normal_bias(d: Dimer, q: Array, qdot: Array) -> Array:
    """d/dt(W^T) q', shape (2,); the paper does not print it."""
    return np.array([0.0, -d.l * sin(q[4]) * qdot[4] ** 2])


def tangential_bias(d: Dimer, q: Array, qdot: Array) -> Array:
    """S^tau = d/dt(N^T) q', eq. (A.2), shape (4,), order 1x, 2x, 1y, 2y."""
    st, ct, sb, cb = sin(q[3]), cos(q[3]), sin(q[4]), cos(q[4])
    dt, db, dg = qdot[3], qdot[4], qdot[5]
    r, length = d.r, d.l
    S1x = -r * ct * dt * db + r * sb * ct * db * dg + r * cb * st * dt * dg
    S2x = S1x + 2 * length * sb * ct * dt * db + length * cb * st * (dt**2 + db**2)
    S1y = -r * st * dt * db + r * sb * st * db * dg - r * cb * ct * dt * dg
    S2y = S1y + 2 * length * sb * st * dt * db - length * cb * ct * (dt**2 + db**2)
    return np.array([S1x, S2x, S1y, S2y])


def jacobian(d: Dimer, q: Array) -> Array:
    """Contact Jacobian, shape (2, 3, 6): for each end the rows normal, x, y of (W, N)^T."""
    W, N = normal_matrix(d, q), tangential_matrix(d, q)
    return np.array([[W[:, i], N[:, i], N[:, 2 + i]] for i in (0, 1)])


def delassus(d: Dimer, q: Array) -> tuple[Array, Array]:
    """Delassus blocks J M^-1 J^T, shape (2, 3, 2, 3), and M^-1 J^T as an array of shape (6, 2, 3)."""
    J = jacobian(d, q).reshape(6, 6)
    response: Array = np.linalg.solve(mass_matrix(d, q), J.T).astype(float)
    return (J @ response).reshape(2, 3, 2, 3), response.reshape(6, 2, 3)


def gaps(d: Dimer, q: Array) -> Array:
    """(delta1, delta2), shape (2,), m."""
    return np.array([q[2], q[2] + d.l * sin(q[4])])


def gap_rates(d: Dimer, q: Array, qdot: Array) -> Array:
    """(delta1', delta2') = W^T q', shape (2,), m/s."""
    return np.array([qdot[2], qdot[2] + d.l * cos(q[4]) * qdot[4]])


def slips(d: Dimer, q: Array, qdot: Array) -> Array:
    """Tangential velocities N^T q' of the two ends, shape (2, 2), columns x, y, m/s."""
    v = tangential_matrix(d, q).T @ qdot
    return np.array([[v[0], v[2]], [v[1], v[3]]])


def axial_direction(q: Array) -> Array:
    """Horizontal heading of the axis from end 1 to end 2, shape (2,)."""
    return np.array([-sin(q[3]), cos(q[3])])
