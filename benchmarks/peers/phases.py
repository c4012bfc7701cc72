"""The dimer on heyoka: free flight and every contact mode as symbolic equations, for Taylor series with events.

Each phase is compiled once for each accuracy and serves every dimer: its constants are parameters at run time.

Slip has the clock dt = v dxi (v the speed of the slip, or half the harmonic mean of two): in time the equations are singular
where the slip comes to rest, and a Taylor series can only creep there; in xi they are not.
"""

from functools import cache
from typing import NamedTuple

import heyoka as hy
import numpy as np
from passage import HOLD_LOST, LANDS, LIFTS, N_CLOSED, N_PATH, SLIP_ZERO

from dimersweep.kernel.model.layout import (
    D1,
    FREE,
    N_STATE,
    SLIP,
    STICK,
    X1,
)

TIME_UP = -1  # the event of a phase that has lasted as long as was asked

# parameters of the equations at run time: four of the phase, then the dimer's constants (the last one is in every equation)
PHASE_0, SIDE, SLIP_TOL, END = (hy.par[k] for k in range(4))
H, R, IT, IA, MU, MU_S, G, PLATE, OMEGA = (hy.par[4 + k] for k in range(9))
N_OF_PHASE, N_PARS = 4, 13
FALLS, RISES = hy.event_direction.negative, hy.event_direction.positive


def constants_of(body):
    """The dimer's constants in that order."""
    plate = body.A_z * body.omega**2
    return np.array([body.h, body.r, body.it, body.ia, body.mu, body.mu_s, body.g, plate, body.omega])


class Phase(NamedTuple):
    """Equations of one smooth phase, per unit of mass, and what ends it."""

    rates: list  # of the state [D1:] in flight, of y in contact
    events: list  # (event function, direction, event number)
    slip_clock: bool  # whether it runs in xi


def _variables(names):
    return hy.make_vars(*names)


def _squared(a, b):
    return a * a + b * b


def _above(a, b):
    """How far a slip is from the one that counts as none: a logarithm, for in xi slip falls exponentially."""
    return hy.log(_squared(a, b)) - 2.0 * hy.log(SLIP_TOL)


def flight():
    """Free motion: the torque-free symmetric top in its heading frame, and both gaps."""
    names = ("d1", "d2", "n1", "n2", "beta", "wb", "wp", "spin_r", "ca", "cb", "theta", "x1", "y1", "gamma_r")
    d1, d2, n1, n2, beta, wb, wp, spin_r, ca, cb, theta, x1, y1, gamma_r = _variables(names)
    spin = spin_r / R
    sin_b, cos_b = hy.sin(beta), hy.cos(beta)
    turn = wp / cos_b
    axial = IT / IA * spin - sin_b * turn
    fall = PLATE * hy.sin(OMEGA * hy.time + PHASE_0) - G
    bend = H * (cos_b * axial * wp - sin_b * wb * wb)
    v_a, v_b = ca + H * sin_b * wb, cb + H * wp
    sin_t, cos_t = hy.sin(theta), hy.cos(theta)
    rates = [
        (d1, n1),
        (d2, n2),
        (n1, fall - bend),
        (n2, fall + bend),
        (beta, wb),
        (wb, axial * wp),
        (wp, -axial * wb),
        (spin_r, hy.expression(0.0)),
        (ca, -turn * cb),
        (cb, turn * ca),
        (theta, turn),
        (x1, v_b * cos_t - v_a * sin_t),
        (y1, v_a * cos_t + v_b * sin_t),
        (gamma_r, spin_r - R * turn * sin_b),
    ]
    return Phase(rates, [(d1, FALLS, 0), (d2, FALLS, 1)], False)


class _Contact:
    """What the equations of all contact modes share: variables, levers and the Delassus operator of the leading end."""

    def __init__(self, s, double):
        names = ("beta", "wb", "wp", "spin_r", "ua", "ub", "theta", "t", "x1", "y1", "gamma_r")
        self.beta, self.wb, self.wp, self.spin_r, self.ua, self.ub, self.theta, self.t, *self.path = _variables(names)
        self.spin = self.spin_r / R
        self.s, self.double = s, double
        self.sin_b, self.cos_b = (0.0, 1.0) if double else (hy.sin(self.beta), hy.cos(self.beta))
        self.n, self.a = s * H * self.cos_b, R - s * H * self.sin_b
        self.b, self.c = R * self.sin_b - s * H, -R * self.cos_b
        self.turn = self.wp / self.cos_b
        self.nn, self.na, self.aa = 1.0 + self.n * self.n * IT, self.n * self.a * IT, 1.0 + self.a * self.a * IT
        self.bb = 1.0 + self.b * self.b * IT + self.c * self.c * IA

    def free(self):
        """Accelerations without contact forces: of beta', theta' cos(beta), and of the leading end's n, a, b."""
        axial = IT / IA * self.spin - self.sin_b * self.turn
        d_wb, d_wp = axial * self.wp, -axial * self.wb
        c_a, c_b = self.ua - self.a * self.wb, self.ub - self.b * self.wp - self.c * self.spin
        bend = self.s * H * self.wb * self.wb
        n = PLATE * hy.sin(OMEGA * self.t + PHASE_0) - G + self.n * d_wb - bend * self.sin_b
        a = -self.turn * c_b + self.a * d_wb - bend * self.cos_b
        b = self.turn * c_a + self.b * d_wp + R * self.wb * (self.cos_b * self.wp + self.sin_b * self.spin)
        return d_wb, d_wp, n, a, b

    def phase(self, d_wb, d_wp, d_spin, d_ua, d_ub, events, clock=None):
        """The phase with these accelerations; `clock` is dt/dxi, None for time itself."""
        zero = hy.expression(0.0)
        v_a = self.ua - self.a * self.wb + H * self.sin_b * self.wb
        v_b = self.ub - self.b * self.wp - self.c * self.spin + H * self.wp
        sin_t, cos_t = hy.sin(self.theta), hy.cos(self.theta)
        rates = [
            (self.beta, zero if self.double else self.wb),
            (self.wb, zero if self.double else d_wb),
            (self.wp, d_wp),
            (self.spin_r, R * d_spin),
            (self.ua, d_ua),
            (self.ub, d_ub),
            (self.theta, self.turn),
            (self.t, hy.expression(1.0)),
            (self.path[0], v_b * cos_t - v_a * sin_t),
            (self.path[1], v_a * cos_t + v_b * sin_t),
            (self.path[2], self.spin_r - R * self.turn * self.sin_b),
        ]
        if clock is None:
            return Phase(rates, events, False)
        in_xi = [(name, clock * rate) for name, rate in rates]
        return Phase(in_xi, [*events, (self.t - END, RISES, TIME_UP)], True)


def single(i, mode):
    """End i alone on the plate, sticking or slipping."""
    s = 2.0 * i - 1.0
    k = _Contact(s, False)
    d_wb, d_wp, n, a, b = k.free()
    events = [(-s * k.beta, FALLS, LANDS)]
    zero = hy.expression(0.0)
    if mode == STICK:
        det = k.nn * k.aa - k.na * k.na
        F, A, L = (k.na * a - k.aa * n) / det, (k.na * n - k.nn * a) / det, -b / k.bb
        events.append((MU_S * MU_S * F * F - _squared(A, L), FALLS, HOLD_LOST + i))
        d_ua, d_ub, clock = zero, zero, None
    else:
        v = hy.sqrt(_squared(k.ua, k.ub))
        F = -n / (k.nn - MU * k.na * k.ua / v)
        A, L = -MU * F * k.ua / v, -MU * F * k.ub / v
        events.append((_above(k.ua, k.ub), FALLS, SLIP_ZERO + i))
        d_ua, d_ub, clock = a + k.na * F + k.aa * A, b + k.bb * L, v
    events.append((F, FALLS, LIFTS + i))
    return k.phase(d_wb + (k.n * F + k.a * A) * IT, d_wp + k.b * L * IT, k.c * L * IA, d_ua, d_ub, events, clock)


def pair(mode_1, mode_2):
    """Both ends on the plate (beta = 0), each sticking or slipping; beside an end that sticks the other slips laterally."""
    k = _Contact(-1.0, True)
    _, _, n, a, b = k.free()
    d_wb = IT / IA * k.spin * k.wp
    zero = hy.expression(0.0)
    b_2 = k.ub - 2.0 * H * k.wp
    w = H * R * IT  # axial velocity per normal impulse at p2
    bb_12 = 1.0 - H * H * IT + R * R * IA
    total = -(2.0 * n + 2.0 * H * d_wb) / 2.0
    v_1, v_2 = hy.sqrt(_squared(k.ua, k.ub)), hy.sqrt(_squared(k.ua, b_2))
    slips = mode_1 == SLIP and mode_2 == SLIP
    if slips:
        A_c, A_d = -0.5 * MU * total * (k.ua / v_1 + k.ua / v_2), -0.5 * MU * (k.ua / v_2 - k.ua / v_1)
    else:
        A_c, A_d = -a / k.aa, -w / k.aa
    D = (-2.0 * H * d_wb - 2.0 * w * A_c) / (2.0 * H * H * IT + 2.0 * w * A_d)
    F_1, F_2 = 0.5 * (total - D), 0.5 * (total + D)
    A = A_c + A_d * D
    events = [(F_1, FALLS, LIFTS), (F_2, FALLS, LIFTS + 1)]
    clock = None
    if slips:
        L_1, L_2 = -MU * F_1 * k.ub / v_1, -MU * F_2 * b_2 / v_2
        clock = v_1 * v_2 / (v_1 + v_2)
        events.append((_above(k.ua, k.ub), FALLS, SLIP_ZERO))
        events.append((_above(k.ua, b_2), FALLS, SLIP_ZERO + 1))
    elif mode_1 == STICK and mode_2 == STICK:
        L_1 = L_2 = -b / (k.bb + bb_12)
        room_1, room_2 = MU_S * MU_S * F_1 * F_1 - L_1 * L_1, MU_S * MU_S * F_2 * F_2 - L_2 * L_2
        events.append((room_1 + room_2 + 2.0 * hy.sqrt(room_1 * room_2) - A * A, FALLS, HOLD_LOST))
    elif mode_1 == STICK:
        L_2 = -MU * F_2 * SIDE
        L_1 = -(b + bb_12 * L_2) / k.bb
        events.append((MU_S * MU_S * F_1 * F_1 - _squared(A, L_1), FALLS, HOLD_LOST))
        events.append((SIDE * b_2 - SLIP_TOL, FALLS, SLIP_ZERO + 1))
    else:
        L_1 = -MU * F_1 * SIDE
        L_2 = -(b + bb_12 * L_1) / k.bb
        events.append((MU_S * MU_S * F_2 * F_2 - _squared(A, L_2), FALLS, HOLD_LOST + 1))
        events.append((SIDE * k.ub - SLIP_TOL, FALLS, SLIP_ZERO))
    d_ua = a + w * (F_2 - F_1) + k.aa * A if slips else zero
    d_ub = b + k.bb * L_1 + bb_12 * L_2 if mode_1 == SLIP else zero
    return k.phase(zero, H * (L_1 - L_2) * IT, -R * (L_1 + L_2) * IA, d_ua, d_ub, events, clock)


def equations(mode_1, mode_2):
    """The phase with these friction modes."""
    if mode_1 == FREE and mode_2 == FREE:
        return flight()
    if mode_1 == FREE:
        return single(1, mode_2)
    return single(0, mode_1) if mode_2 == FREE else pair(mode_1, mode_2)


class Integrator(NamedTuple):
    """A compiled phase, and views of what is set at its start."""

    taylor: hy.taylor_adaptive
    state: np.ndarray
    constants: np.ndarray
    pars: np.ndarray
    numbers: tuple
    slip_clock: bool
    forced: bool  # by the plate in time, while the state may not move


@cache
def integrator(mode_1, mode_2, tol, path):
    """The compiled phase with these friction modes."""
    phase = equations(mode_1, mode_2)
    flies = mode_1 == FREE and mode_2 == FREE
    n = (N_STATE - 2 if flies else N_PATH) if path else (X1 - D1 if flies else N_CLOSED)
    taylor = hy.taylor_adaptive(
        phase.rates[:n],
        [0.0] * n,
        tol=tol,
        pars=[0.0] * N_PARS,
        t_events=[hy.t_event(function, direction=direction) for function, direction, _ in phase.events],
    )
    numbers = tuple(number for _, _, number in phase.events)
    pars, forced = taylor.pars, not flies and not phase.slip_clock
    return Integrator(taylor, taylor.state, pars[N_OF_PHASE:], pars[:N_OF_PHASE], numbers, phase.slip_clock, forced)
