"""Between two phases on heyoka: the body's state from what the integrator ended with, and what it starts with next.

The state has the slots of `dimersweep.kernel.model.layout`; that numbering is all these modules take from the package. A
contact is described by y = (beta, beta', theta' cos(beta), spin, u_a, u_b, theta, t, x1, y1, gamma), u the slip of the
leading end (p1 if it is closed, else p2). The integrator has the spin and its angle in units of 1/r: the largest number of
its state rules its steps.
"""

from math import copysign, cos, hypot, sin
from typing import NamedTuple

import numpy as np
from numba import njit

from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    GAMMA,
    N1,
    N2,
    N_STATE,
    PHASE,
    SLIP,
    SPIN,
    STICK,
    THETA,
    WB,
    WP,
    X1,
    Y1,
)
from tests.oracle.body import dimer

compiled = njit(error_model="numpy", nogil=True)  # not cached: a cache sees no edit in another module

YB, YWB, YWP, YS, YUA, YUB, YTHETA, YTIME, YX, YY, YGAMMA = range(11)
N_CLOSED, N_PATH = 8, 11  # entries without and with the path
P_PHASE, P_SIDE, P_SLIP, P_END = range(4)  # parameters of a phase
LIFTS, HOLD_LOST, SLIP_ZERO, LANDS = 0, 2, 4, 6  # events of a contact: the number of its kind, plus 1 for p2
LIFT = 1e-15  # a gap that opens starts at this share of the hop's height: a root at zero hides the next one
OPEN = 1e-17  # and at this dip angle where it opens without a rate [rad]


class Body(NamedTuple):
    """The dimer and its plate, per unit of mass."""

    h: float  # half the distance of the balls
    r: float
    it: float  # mass over transverse and over axial inertia
    ia: float
    e_1: float
    e_2: float
    mu: float
    mu_s: float
    g: float
    A_z: float
    omega: float
    phi0: float


N_BODY = len(Body._fields)


def body_of(scene):
    """The body that follows from named parameters."""
    d = dimer(scene)
    return Body(d.l / 2, d.r[0], d.m / d.J1, d.m / d.J2, *d.e, d.mu[0], d.mu_s[0], d.g, d.A[2], d.omega, d.phi[2])


def start_state(body, beta0, xdot0):
    """At the release: p1 on the plate, at rest but for the lateral speed xdot0."""
    state = np.zeros(N_STATE)
    state[D2], state[DIP], state[CB] = 2.0 * body.h * sin(beta0), beta0, xdot0
    state[N1] = state[N2] = -body.A_z * body.omega * cos(body.phi0)
    return state


@compiled
def as_body(row):
    """The body of its constants in an array (which costs a call from Python less than their names)."""
    return Body(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11])


@compiled
def levers(body, s, sin_b, cos_b):
    """Of the end with sign s: gap rate and axial velocity per beta', lateral velocity per theta' cos(beta) and per spin."""
    h, r = body.h, body.r
    return s * h * cos_b, r - s * h * sin_b, r * sin_b - s * h, -r * cos_b


@compiled
def gravity(body, state):
    """Effective gravity in the plate's frame."""
    return body.g - body.A_z * body.omega**2 * sin(state[PHASE] + body.phi0)


@compiled
def unload(body, state, s, y):
    """The contact state of a body whose leading end has the sign s."""
    _, a, b, c = levers(body, s, sin(state[DIP]), cos(state[DIP]))
    y[YB], y[YWB], y[YWP], y[YS] = state[DIP], state[WB], state[WP], state[SPIN]
    y[YUA] = state[CA] + a * state[WB]
    y[YUB] = state[CB] + b * state[WP] + c * state[SPIN]
    y[YTHETA], y[YX], y[YY], y[YGAMMA], y[YTIME] = state[THETA], state[X1], state[Y1], state[GAMMA], 0.0


@compiled
def load(body, modes, y, state):
    """The body's state from that of its contact; gaps that are closed are exactly zero, and so are their rates."""
    s = -1.0 if modes[0] != FREE else 1.0
    sin_b, cos_b = sin(y[YB]), cos(y[YB])
    _, a, b, c = levers(body, s, sin_b, cos_b)
    state[DIP], state[WB], state[WP], state[SPIN] = y[YB], y[YWB], y[YWP], y[YS]
    state[CA] = y[YUA] - a * y[YWB]
    state[CB] = y[YUB] - b * y[YWP] - c * y[YS]
    state[THETA], state[X1], state[Y1], state[GAMMA] = y[YTHETA], y[YX], y[YY], y[YGAMMA]
    gap, rate = 2.0 * body.h * sin_b, 2.0 * body.h * cos_b * y[YWB]
    state[D1], state[N1] = (0.0, 0.0) if modes[0] != FREE else (-gap, -rate)
    state[D2], state[N2] = (0.0, 0.0) if modes[1] != FREE else (gap, rate)


@compiled
def lateral_slip(body, modes, y, i):
    """Lateral slip of end i, which is closed."""
    return y[YUB] if i == 0 or modes[0] == FREE else y[YUB] - 2.0 * body.h * y[YWP]


@compiled
def set_slip(body, modes, y, i, a, b):
    """Give end i, which is closed, the slip (a, b); the other end keeps its lateral one."""
    y[YUA] = a
    if modes[0] == FREE or modes[1] == FREE:
        y[YUB] = b
    elif i == 0:
        y[YWP] += (b - y[YUB]) / (2.0 * body.h)
        y[YUB] = b
    else:
        y[YWP] = (y[YUB] - b) / (2.0 * body.h)


@compiled
def take_over(body, state, modes, ended, event, dt, y):
    """The state at the end of a phase, and what its event makes exact."""
    if modes[0] == FREE and modes[1] == FREE:
        for k in range(ended.size):
            state[D1 + k] = ended[k]
        state[SPIN] /= body.r
        if D1 + ended.size > GAMMA:
            state[GAMMA] /= body.r
        state[PHASE] += body.omega * dt
        if event >= 0:
            touch(body, state, event)
        return
    for k in range(ended.size):
        y[k] = ended[k]
    y[YS] /= body.r
    if ended.size > YGAMMA:
        y[YGAMMA] /= body.r
    if event == LANDS:
        y[YB] = 0.0
    if SLIP_ZERO <= event < LANDS:
        set_slip(body, modes, y, event % 2, 0.0, 0.0)
    load(body, modes, y, state)
    state[PHASE] += body.omega * y[YTIME]


@compiled
def touch(body, state, i):
    """Close the gap of end i, which has landed, and the other one if it is no higher, to rounding."""
    if state[D2 - i] - state[D1 + i] <= 1e-15 * body.h:
        state[D2 - i] = 0.0
    state[D1 + i] = 0.0
    if state[D1] == 0.0 and state[D2] == 0.0:
        state[DIP] = 0.0


@compiled
def hop_time(body, state, rate):
    """How long a hop that begins with this gap rate may last, about."""
    fall = gravity(body, state) + body.h * state[WB] ** 2
    return 2.0 * rate / max(fall, 1e-3 * body.g)


@compiled
def first_hop(body, state, start):
    """Duration of the shortest hop that begins with this flight; its gap is set off from zero by nothing that matters."""
    hop = 0.0
    for i in range(2):
        rate = state[N1 + i]
        if state[D1 + i] > 0.0:
            continue
        start[i] = OPEN * body.h
        if rate > 0.0:
            time = hop_time(body, state, rate)
            start[i] = LIFT * 0.5 * rate * time
            hop = time if hop == 0.0 else min(hop, time)
    return hop


@compiled
def lone_hop(body, state, modes, start):
    """The hop of the one open end in a contact, in the clock of that phase; its gap is a dip angle here."""
    if start[YB] != 0.0:
        return 0.0
    i = 0 if modes[0] == FREE else 1
    side, rate = 2.0 * i - 1.0, state[N1 + i]
    start[YB] = side * OPEN
    if rate <= 0.0:
        return 0.0
    time = hop_time(body, state, rate)
    start[YB] = side * LIFT * 0.25 * rate * time / body.h
    return time / hypot(start[YUA], start[YUB]) if modes[1 - i] == SLIP else time


@compiled
def begin(body, state, modes, y, start, pars):
    """The start of a phase for its integrator; returns the duration of the hop that begins, 0.0 if none does."""
    if modes[0] == FREE and modes[1] == FREE:
        for k in range(D1, N_STATE - 1):
            start[k - D1] = state[k]
        start[SPIN - D1] *= body.r
        start[GAMMA - D1] *= body.r
        return first_hop(body, state, start)
    for k in range(N_PATH):
        start[k] = y[k]
    start[YS] *= body.r
    start[YGAMMA] *= body.r
    if modes[0] == FREE or modes[1] == FREE:
        return lone_hop(body, state, modes, start)
    if modes[0] == SLIP and modes[1] == STICK:
        pars[P_SIDE] = copysign(1.0, lateral_slip(body, modes, y, 0))
    elif modes[0] == STICK and modes[1] == SLIP:
        pars[P_SIDE] = copysign(1.0, lateral_slip(body, modes, y, 1))
    return 0.0


@compiled
def state_at(body, state, modes, now, event, dt, y, out):
    """The body's state in the midst of a phase, into `out`."""
    for k in range(N_STATE):
        out[k] = state[k]
    take_over(body, out, modes, now, event, dt, y)
