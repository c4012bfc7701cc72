"""The dimer as a free axisymmetric top: centre, axis, velocity, angular momentum, and the coordinates of the paper.

A state is an array of 14: centre of mass (its height counted from a ball's radius above the plate), axis from end 1 to
end 2, velocity, angular momentum, theta and gamma, all in the plate's frame, SI.
"""

from math import asin, atan2, cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.checks.cached import compiled
from tests.oracle.body import Dimer

CENTRE, AXIS, VELOCITY, MOMENTUM, THETA, GAMMA, N_STATE = 0, 3, 6, 9, 12, 13, 14
SIDES = (-1.0, 1.0)  # where along the axis the ends are, in units of l/2

Array = NDArray[np.float64]


class Top(NamedTuple):
    """Constants of one dimer on its plate, all floats (SI)."""

    r: float
    half: float  # l/2
    m: float
    J_t: float
    J_a: float
    mu: float
    mu_s: float
    A_z: float
    omega: float
    phi0: float
    g: float


def top_of(d: Dimer) -> Top:
    """Constants for the compiled code."""
    return Top(d.r[0], d.l / 2, d.m, d.J1, d.J2, d.mu[0], d.mu_s[0], d.A[0, 2], d.omega, d.phi[0, 2], d.g)


@compiled
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def vector(state, start):
    return state[start], state[start + 1], state[start + 2]


@compiled
def spin_rate(top, state):
    """Angular velocity about the axis."""
    u, L = vector(state, AXIS), vector(state, MOMENTUM)
    return (u[0] * L[0] + u[1] * L[1] + u[2] * L[2]) / top.J_a


@compiled
def turn_rate(top, state, L):
    """Angular velocity that belongs to the angular momentum `L`."""
    u = vector(state, AXIS)
    along = (1 / top.J_a - 1 / top.J_t) * (u[0] * L[0] + u[1] * L[1] + u[2] * L[2])
    return L[0] / top.J_t + along * u[0], L[1] / top.J_t + along * u[1], L[2] / top.J_t + along * u[2]


@compiled
def lever(top, state, i):
    """From the centre of mass to end i."""
    reach = SIDES[i] * top.half
    return reach * state[AXIS], reach * state[AXIS + 1], reach * state[AXIS + 2] - top.r


@compiled
def gap(top, state, i):
    """Gap of end i."""
    return state[CENTRE + 2] + SIDES[i] * top.half * state[AXIS + 2]


@compiled
def contact_velocity(top, state, i):
    """Velocity of end i: x, y, and the gap rate."""
    turn = cross(turn_rate(top, state, vector(state, MOMENTUM)), lever(top, state, i))
    return state[VELOCITY] + turn[0], state[VELOCITY + 1] + turn[1], state[VELOCITY + 2] + turn[2]


@compiled
def push(top, state, i, impulse):
    """Apply an impulse (x, y, z) at end i."""
    torque = cross(lever(top, state, i), impulse)
    for k in range(3):
        state[VELOCITY + k] += impulse[k] / top.m
        state[MOMENTUM + k] += torque[k]


@compiled
def compliance(top, state, out):
    """Fill `out`, shape (2, n, 2, n), with the velocity of each end per impulse at each end: x, y, and for n = 3 also z."""
    n = out.shape[1]
    for j in range(2):
        for b in range(n):
            unit = (1.0 if b == 0 else 0.0, 1.0 if b == 1 else 0.0, 1.0 if b == 2 else 0.0)
            omega = turn_rate(top, state, cross(lever(top, state, j), unit))
            for i in range(2):
                turn = cross(omega, lever(top, state, i))
                for a in range(n):
                    out[i, a, j, b] = (unit[a] / top.m if a == b else 0.0) + turn[a]


@compiled
def fly(top, state, h):
    """Free motion over a time h without gravity: exact but for gamma, which is of second order."""
    for k in range(3):
        state[CENTRE + k] += h * state[VELOCITY + k]
    u, L = vector(state, AXIS), vector(state, MOMENTUM)
    size = sqrt(L[0] * L[0] + L[1] * L[1] + L[2] * L[2])
    if size == 0:
        return
    n = (L[0] / size, L[1] / size, L[2] / size)
    angle = size / top.J_t * h
    c, s, side = cos(angle), sin(angle), cross(n, u)
    along = (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) * (1 - c)
    w = (
        c * u[0] + s * side[0] + along * n[0],
        c * u[1] + s * side[1] + along * n[1],
        c * u[2] + s * side[2] + along * n[2],
    )
    turned = atan2(u[0] * w[1] - u[1] * w[0], u[0] * w[0] + u[1] * w[1])
    state[GAMMA] += spin_rate(top, state) * h - turned * 0.5 * (u[2] + w[2])
    state[THETA] += turned
    scale = 1 / sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    for k in range(3):
        state[AXIS + k] = w[k] * scale


@compiled
def gravity(top, t):
    """Gravity felt in the plate's frame."""
    return top.g - top.A_z * top.omega**2 * sin(top.omega * t + top.phi0)


def state_of(d: Dimer, q: Array, qdot: Array) -> Array:
    """State of the paper's coordinates (x1, y1, delta1, theta, beta, gamma) and their rates, shape (6,) each."""
    theta, beta = q[3], q[4]
    u = np.array([-sin(theta) * cos(beta), cos(theta) * cos(beta), sin(beta)])
    by_theta = np.array([-cos(theta) * cos(beta), -sin(theta) * cos(beta), 0.0])
    by_beta = np.array([sin(theta) * sin(beta), -cos(theta) * sin(beta), cos(beta)])
    u_rate = qdot[3] * by_theta + qdot[4] * by_beta
    spin = qdot[5] + qdot[3] * sin(beta)
    momentum = d.J1 * np.cross(u, u_rate) + d.J2 * spin * u
    return np.concatenate([q[:3] + d.l / 2 * u, u, qdot[:3] + d.l / 2 * u_rate, momentum, [theta, q[5]]])


def coordinates_of(d: Dimer, state: Array) -> Array:
    """The paper's coordinates and their rates, shape (12,), of a state; theta and gamma count whole turns."""
    u, momentum = state[AXIS : AXIS + 3], state[MOMENTUM : MOMENTUM + 3]
    u_rate = np.cross(momentum, u) / d.J1
    level = hypot(u[0], u[1])
    beta_rate, theta_rate = u_rate[2] / level, (u[0] * u_rate[1] - u[1] * u_rate[0]) / level**2
    spin = float(momentum @ u) / d.J2
    place, velocity = state[:3] - d.l / 2 * u, state[VELOCITY : VELOCITY + 3] - d.l / 2 * u_rate
    angles = [state[THETA], asin(u[2]), state[GAMMA]]
    return np.concatenate([place, angles, velocity, [theta_rate, beta_rate, spin - theta_rate * u[2]]])
