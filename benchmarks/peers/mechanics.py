"""The dimer per unit of mass, for the peer on heyoka: its state, its free motion and the forces of its contacts.

Functions of plain arithmetic serve twice: Numba compiles them for what happens at an instant, and `phases` calls them on
heyoka's symbols. Nothing of the engine is in here.
"""

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.oracle.body import dimer

compiled = njit(error_model="numpy", nogil=True)  # not cached: a cache sees no edit in another module

FREE, STICK, SLIP = 0, 1, 2  # friction modes of an end
# Slots of the state: centre of ball 1 and its angle times r, gaps and their rates, dip angle, beta', theta' cos(beta), spin
# times r, two velocities, heading, time in the present phase, and when that began. The velocities are those of the centre
# of mass along and across the axis; in a contact they are the slip of the leading end (p1 if it is closed, else p2), which
# would drown in round-off. The factor r is there because the largest number of a state rules heyoka's steps.
X1, Y1, ROLLED, D1, D2, N1, N2, BETA, WB, WP, ROLL, VA, VB, THETA, TIME, BEGUN = range(16)
N_STATE = 16
LIFTS, HOLD_LOST, SLIP_ZERO, LANDS = 0, 2, 4, 6  # events of a contact: the number of its kind, plus 1 for p2


class Body(NamedTuple):
    """Constants of a dimer, of its plate and of what counts as accurate; the first nine are in the equations of motion."""

    h: float  # half the distance of the balls
    r: float
    it: float  # mass over transverse inertia
    ia: float  # mass times r^2 over axial inertia
    mu: float
    mu_s: float
    g: float
    plate: float  # amplitude of the plate's acceleration
    omega: float
    phi0: float
    e: float
    impact: float  # tolerance of impacts [m/s]
    slip_zero: float  # slip that counts as none [m/s]
    close: float  # cost of the end of a chatter [m/s]


def body_of(scene, impact, slip_zero, close):
    """Return the constants of named parameters, and of three accuracies."""
    d = dimer(scene)
    r, omega = d.r[0], d.omega
    dynamics = d.l / 2, r, d.m / d.J1, r * r * d.m / d.J2, d.mu[0], d.mu_s[0], d.g, d.A[0, 2] * omega**2, omega
    return Body(*dynamics, d.phi[0, 2], d.e[0], impact, slip_zero, close)


def start_state(body, beta0, xdot0):
    """Return the state at the release: p1 on the plate, at rest but for the lateral speed xdot0."""
    state = np.zeros(N_STATE)
    state[D2], state[BETA], state[VB] = 2.0 * body.h * sin(beta0), beta0, xdot0
    state[N1] = state[N2] = -body.plate / body.omega * cos(body.phi0)
    return state


def coordinates(body, state):
    """Return x1, y1, gap of p1, theta, beta, gamma and their rates; the velocities in the state are those of the centre."""
    sin_b, cos_b, sin_t, cos_t = *(f(state[BETA]) for f in (sin, cos)), *(f(state[THETA]) for f in (sin, cos))
    turn = state[WP] / cos_b
    v_a, v_b = state[VA] + body.h * sin_b * state[WB], state[VB] + body.h * state[WP]
    place = state[X1], state[Y1], state[D1], state[THETA], state[BETA], state[ROLLED] / body.r
    speed = v_b * cos_t - v_a * sin_t, v_a * cos_t + v_b * sin_t, state[N1], turn, state[WB]
    return np.array([*place, *speed, state[ROLL] / body.r - turn * sin_b])


@compiled
def as_body(row):
    """Return the constants that stand in an array, which costs a call from Python less than their names."""
    return Body(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7],
        row[8], row[9], row[10], row[11], row[12], row[13],
    )  # fmt: skip


@compiled
def levers(body, s, sin_b, cos_b):
    """Return gap rate and axial velocity of the end with sign s per beta', its lateral one per theta' cos(beta) and roll."""
    return s * body.h * cos_b, body.r - s * body.h * sin_b, body.r * sin_b - s * body.h, -cos_b


@compiled
def respond(body, p, q):
    """Return what impulses at levers q do at levers p: normal, axial from normal, axial, lateral."""
    lateral = 1.0 + p[2] * q[2] * body.it + p[3] * q[3] * body.ia
    return 1.0 + p[0] * q[0] * body.it, p[1] * q[0] * body.it, 1.0 + p[1] * q[1] * body.it, lateral


@compiled
def free_motion(body, p, s, sin_b, cos_b, fall, wb, wp, roll, va, vb):
    """Return accelerations without contact forces: of beta', theta' cos(beta), and of the end at levers p its n, a, b."""
    turn = wp / cos_b
    axial = body.it * body.r / body.ia * roll - sin_b * turn
    n = -fall + p[0] * axial * wp - s * body.h * sin_b * wb * wb
    a = -turn * vb + p[1] * axial * wp - s * body.h * cos_b * wb * wb
    b = turn * va - p[2] * axial * wb + wb * (body.r * cos_b * wp + sin_b * roll)
    return axial * wp, -axial * wb, n, a, b


@compiled
def forces_one(body, w, free, mode, c, d):
    """Return normal, axial and lateral force at the only closed end, slipping along (c, d) or held.

    All forces are linear in the accelerations of the ends without them; with rates in their place they are impulses.
    """
    nn, na, aa, bb = w
    n, a, b = free
    if mode == STICK:
        det = nn * aa - na * na
        return (na * a - aa * n) / det, (na * n - nn * a) / det, -b / bb
    F = -n / (nn - body.mu * na * c)
    return F, -body.mu * F * c, -body.mu * F * d


@compiled
def forces_both(body, free_1, free_2, mode, c_1, d_1, c_2, d_2):
    """Return F_1, F_2, the axial total, L_1, L_2 of a dimer that lies flat: both ends are held, or slip along (c_i, d_i)."""
    h, it, mu = body.h, body.it, body.mu
    na, aa = h * body.r * it, 1.0 + body.r * body.r * it
    total = -0.5 * (free_1[0] + free_2[0])
    T_c, T_d = -free_1[1] / aa, -na / aa
    if mode == SLIP:
        T_c, T_d = -0.5 * mu * total * (c_1 + c_2), -0.5 * mu * (c_2 - c_1)
    difference = (free_1[0] - free_2[0] - 2.0 * na * T_c) / (2.0 * h * h * it + 2.0 * na * T_d)
    F_1, F_2 = 0.5 * (total - difference), 0.5 * (total + difference)
    if mode == STICK:  # then nothing turns, and no force is lateral
        return F_1, F_2, T_c + T_d * difference, 0.0, 0.0
    return F_1, F_2, T_c + T_d * difference, -mu * F_1 * d_1, -mu * F_2 * d_2


@compiled
def speed(a, b):
    """Return the size of a velocity; `hypot` takes several times as long."""
    return sqrt(a * a + b * b)


@compiled
def levers_of(body, state, i):
    """Return the levers of end i in this state."""
    return levers(body, 2.0 * i - 1.0, sin(state[BETA]), cos(state[BETA]))


@compiled
def compliance(body, state, i):
    """Return what an impulse at end i does there."""
    p = levers_of(body, state, i)
    return respond(body, p, p)


@compiled
def gravity(body, state):
    """Return the effective gravity in the plate's frame at the start of a phase."""
    return body.g - body.plate * sin(body.omega * state[BEGUN] + body.phi0)


@compiled
def free_rates(body, state, i):
    """Return the accelerations of end i without contact forces: normal, axial, lateral."""
    fall, p, sin_b, cos_b = gravity(body, state), levers_of(body, state, i), sin(state[BETA]), cos(state[BETA])
    rates = state[WB], state[WP], state[ROLL], state[VA], state[VB]
    _, _, n, a, b = free_motion(body, p, 2.0 * i - 1.0, sin_b, cos_b, fall, *rates)
    return n, a, b


@compiled
def slip_of(body, state, i):
    """Return axial and lateral slip of end i and their size; the state has the velocities of the centre."""
    _, a, b, c = levers_of(body, state, i)
    axial, lateral = state[VA] + a * state[WB], state[VB] + b * state[WP] + c * state[ROLL]
    return axial, lateral, speed(axial, lateral)


@compiled
def push(body, state, i, P, T, L):
    """Give the body an impulse at end i: normal, axial, lateral."""
    p, q = levers_of(body, state, i), levers_of(body, state, 1 - i)
    turn = (p[0] * P + p[1] * T) * body.it
    state[N1 + i] += P + p[0] * turn
    state[N2 - i] += P + q[0] * turn
    state[VA] += T
    state[VB] += L
    state[WB] += turn
    state[WP] += p[2] * L * body.it
    state[ROLL] += p[3] * L * body.ia
