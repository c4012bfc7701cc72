"""The dimer of the paper's Appendix A: constants, and the 6x6 matrices as printed there, for two ends that may be unlike.

Coordinates q = (x1, y1, delta1, theta, dip, gamma): the paper's, relative to the plate, with the gap delta1 = z1 - r_1 in the
place of z1, and with dip = beta - beta_0, where sin(beta_0) = (r_2 - r_1) / l is level, in the place of beta: both gaps
vanish where delta1 and the dip do. As M(q) does not depend on x1, y1, z1, the plate's motion only adds to gravity in Q.

The paper's l/2 is there for two things: the way h from ball 1's centre to the centre of mass, and half of l itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEFAULTS = {
    "e": 0.6, "Gamma": 0.9, "f": 15.0, "A_r": 6.0, "mu": 0.2, "mu_s": 0.4, "beta0": 4 * pi / 45, "xdot0": 1.0,
    "phi0": 0.0, "r": 5e-3, "rho_b": 7850.0, "rho_r": 1180.0, "D_r": 4e-3, "g": 9.81,
}  # fmt: skip
OTHERS = {
    "mu_h", "l", "eta", "k_ratio", "tilt", "azimuth", "theta0", "ydot0", "betadot0", "thetadot0", "gammadot0", "gap0",
}  # fmt: skip
# names of the intensity and the phase of each harmonic of the plate along X, Y, Z; the last ones count from the first phase
HARMONICS = 16
WAVES = [
    [(f"Gamma{axis}{index}", f"phi{axis}{index}") for axis in ("_x", "_y", "")]
    for index in ("", *(f"_{k}" for k in range(2, HARMONICS + 1)))
]
WAVES[0][2] = ("Gamma", "phi0")
ENDS = ("e", "r", "rho_b", "mu", "mu_s", "mu_h")
Pair = tuple[float, float]


@dataclass(frozen=True)
class Dimer:
    """Constants of one dimer and its plate (SI)."""

    r: Pair
    l: float  # noqa: E741  (the paper's name)
    h: float  # from ball 1's centre to the centre of mass
    beta_0: float  # level
    m: float
    J1: float  # transverse inertia about the centre of mass
    J2: float  # axial inertia
    e: Pair
    mu: Pair
    mu_s: Pair
    mu_h: Pair
    k: Pair  # stiffness of the contacts in an impact, in units of the first
    eta: float  # its force is k X^eta
    g: float
    omega: float
    fall: Array  # gravity along the plate's axes X, Y, Z
    A: Array  # amplitudes of the plate along them, a row a harmonic
    phi: Array  # their phases at t = 0


def dimer(params: Mapping[str, float]) -> Dimer:
    """Constants that follow from named parameters.

    Parameters
    ----------
    params : mapping
        Any of the names in `DEFAULTS` and `OTHERS`; X_1, X_2 of the names in `ENDS` where the two ends differ.

    Returns
    -------
    Dimer
    """
    waves = {name for wave in WAVES for names in wave for name in names}
    unknown = set(params) - set(DEFAULTS) - OTHERS - waves - {f"{name}_{i}" for name in ENDS for i in (1, 2)}
    if unknown:
        raise ValueError(f"unknown parameters: {sorted(unknown)}")
    p = {**DEFAULTS, **params}

    def ends(name: str, otherwise: Pair = (0.0, 0.0)) -> Pair:
        both = (p[name],) * 2 if name in p else otherwise
        return p.get(f"{name}_1", both[0]), p.get(f"{name}_2", both[1])

    r, rho = ends("r"), ends("rho_b")
    length = p.get("l", (p["A_r"] - 1) * (r[0] + r[1]))
    rod = length - r[0] - r[1]
    m_b = [rho[i] * 4 / 3 * pi * r[i] ** 3 for i in (0, 1)]
    m_r = p["rho_r"] * pi / 4 * p["D_r"] ** 2 * rod
    m = m_b[0] + m_b[1] + m_r
    middle = r[0] + rod / 2  # of the rod, from ball 1's centre
    h = (m_b[1] * length + m_r * middle) / m
    J_b = [2 / 5 * m_b[i] * r[i] ** 2 for i in (0, 1)]
    J1 = sum(J_b) + m_b[0] * h**2 + m_b[1] * (length - h) ** 2
    J1 += m_r * (rod**2 / 12 + p["D_r"] ** 2 / 16 + (middle - h) ** 2)
    J2 = sum(J_b) + m_r * p["D_r"] ** 2 / 8
    omega, g = 2 * pi * p["f"], p["g"]
    tilt, azimuth = p.get("tilt", 0.0), p.get("azimuth", 0.0)
    orders = np.arange(1, HARMONICS + 1)[:, None]
    Gamma, phi = (np.array([[p.get(each[j], 0.0) for each in wave] for wave in WAVES]) for j in (0, 1))
    phi[:, :2] += orders * p["phi0"]
    there = max(1, 1 + int(np.flatnonzero(Gamma.any(axis=1)).max(initial=0)))
    Gamma, phi, orders = Gamma[:there], phi[:there], orders[:there]
    mu_s = ends("mu_s")
    return Dimer(
        r=r, l=length, h=h, beta_0=asin((r[1] - r[0]) / length), m=m, J1=J1, J2=J2,
        e=ends("e"), mu=ends("mu"), mu_s=mu_s, mu_h=ends("mu_h", mu_s),
        k=(1.0, p.get("k_ratio", sqrt(r[1] / r[0]))), eta=p.get("eta", 1.5), g=g, omega=omega,
        fall=g * np.array([sin(tilt) * cos(azimuth), sin(tilt) * sin(azimuth), -cos(tilt)]),
        A=Gamma * g / (orders * omega) ** 2, phi=phi,
    )  # fmt: skip


def felt(d: Dimer, t: float) -> Array:
    """Gravity less the plate's acceleration, along X, Y, Z: what a body feels in the plate's frame."""
    rates = _rates(d)
    return d.fall + (d.A * rates**2 * np.sin(rates * t + d.phi)).sum(axis=0)


def plate_velocity(d: Dimer, t: float) -> Array:
    """Velocity of the plate along X, Y, Z."""
    rates = _rates(d)
    out: Array = (d.A * rates * np.cos(rates * t + d.phi)).sum(axis=0)
    return out


def _rates(d: Dimer) -> Array:
    """Angular frequencies of the harmonics that there are, and of those before them, in a column."""
    return d.omega * np.arange(1, len(d.A) + 1)[:, None]


def _angles(d: Dimer, q: Array) -> tuple[float, float, float, float]:
    """Sines and cosines of theta and beta."""
    beta = d.beta_0 + q[4]
    return sin(q[3]), cos(q[3]), sin(beta), cos(beta)


def mass_matrix(d: Dimer, q: Array) -> Array:
    """M(q), eq. (A.4)."""
    st, ct, sb, cb = _angles(d, q)
    half = d.m * d.h
    M14, M15, M24, M25 = -half * cb * ct, half * sb * st, -half * cb * st, -half * sb * ct
    M44 = (d.m * d.h**2 + d.J1) * cb**2 + d.J2 * sb**2
    M55 = d.m * d.h**2 + d.J1
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
    st, ct, sb, cb = _angles(d, q)
    dt, db, dg = qdot[3], qdot[4], qdot[5]
    half, quarter = d.m * d.h, d.m * d.h**2
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


def uniform_forces(d: Dimer, q: Array, a: Array) -> Array:
    """Q(q), eq. (A.6), under the acceleration `a` along X, Y, Z, which acts at the centre of mass."""
    st, ct, sb, cb = _angles(d, q)
    turning = -d.h * cb * (ct * a[0] + st * a[1])
    dipping = d.h * (sb * (st * a[0] - ct * a[1]) + cb * a[2])
    return d.m * np.array([*a, turning, dipping, 0])


def normal_matrix(d: Dimer, q: Array) -> Array:
    """W(q), eq. (A.1), shape (6, 2)."""
    return np.array([[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, d.l * _angles(d, q)[3], 0]]).T


def tangential_matrix(d: Dimer, q: Array) -> Array:
    """N(q), eq. (A.3), shape (6, 4), columns 1x, 2x, 1y, 2y."""
    st, ct, sb, cb = _angles(d, q)
    (r_1, r_2), length = d.r, d.l
    return np.array(
        [
            [1, 1, 0, 0],
            [0, 0, 1, 1],
            [0, 0, 0, 0],
            [0, -length * ct * cb, 0, -length * st * cb],
            [-r_1 * st, (length * sb - r_2) * st, r_1 * ct, (r_2 - length * sb) * ct],
            [-r_1 * ct * cb, -r_2 * ct * cb, -r_1 * st * cb, -r_2 * st * cb],
        ]
    )


def normal_bias(d: Dimer, q: Array, qdot: Array) -> Array:
    """d/dt(W^T) q', shape (2,); the paper does not print it."""
    return np.array([0.0, -d.l * _angles(d, q)[2] * qdot[4] ** 2])


def tangential_bias(d: Dimer, q: Array, qdot: Array) -> Array:
    """S^tau = d/dt(N^T) q', eq. (A.2), shape (4,), order 1x, 2x, 1y, 2y."""
    st, ct, sb, cb = _angles(d, q)
    dt, db, dg = qdot[3], qdot[4], qdot[5]
    spin_x = -ct * dt * db + sb * ct * db * dg + cb * st * dt * dg  # of a ball, in units of its radius
    spin_y = -st * dt * db + sb * st * db * dg - cb * ct * dt * dg
    S2x = 2 * d.l * sb * ct * dt * db + d.l * cb * st * (dt**2 + db**2)
    S2y = 2 * d.l * sb * st * dt * db - d.l * cb * ct * (dt**2 + db**2)
    return np.array([d.r[0] * spin_x, d.r[1] * spin_x + S2x, d.r[0] * spin_y, d.r[1] * spin_y + S2y])


def jacobian(d: Dimer, q: Array) -> Array:
    """Contact Jacobian, shape (2, 3, 6): for each end the rows normal, x, y of (W, N)^T."""
    W, N = normal_matrix(d, q), tangential_matrix(d, q)
    return np.array([[W[:, i], N[:, i], N[:, 2 + i]] for i in (0, 1)])


def delassus(d: Dimer, q: Array) -> tuple[Array, Array]:
    """Delassus blocks J M^-1 J^T, shape (2, 3, 2, 3), and M^-1 J^T as an array of shape (6, 2, 3)."""
    J = jacobian(d, q).reshape(6, 6)
    response: Array = np.linalg.solve(mass_matrix(d, q), J.T).astype(float)
    return (J @ response).reshape(2, 3, 2, 3), response.reshape(6, 2, 3)


def rise(d: Dimer, q: Array) -> float:
    """delta2 - delta1 = l (sin(beta) - sin(beta_0)), m, with all digits near level."""
    return 2 * d.l * sin(q[4] / 2) * cos(d.beta_0 + q[4] / 2)


def gaps(d: Dimer, q: Array) -> Array:
    """(delta1, delta2), shape (2,), m."""
    return np.array([q[2], q[2] + rise(d, q)])


def gap_rates(d: Dimer, q: Array, qdot: Array) -> Array:
    """(delta1', delta2') = W^T q', shape (2,), m/s."""
    return np.array([qdot[2], qdot[2] + d.l * _angles(d, q)[3] * qdot[4]])


def slips(d: Dimer, q: Array, qdot: Array) -> Array:
    """Tangential velocities N^T q' of the two ends, shape (2, 2), columns x, y, m/s."""
    v = tangential_matrix(d, q).T @ qdot
    return np.array([[v[0], v[2]], [v[1], v[3]]])


def axial_direction(q: Array) -> Array:
    """Horizontal heading of the axis from end 1 to end 2, shape (2,)."""
    return np.array([-sin(q[3]), cos(q[3])])
