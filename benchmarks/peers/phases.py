"""The dimer on heyoka: free flight and every contact mode as symbolic equations, for Taylor series with events.

Each phase is compiled once for each accuracy and serves every dimer: its constants are parameters at run time.

Slip has the clock dt = v dxi (v the speed of the slip, or half the harmonic mean of two): in time the equations are singular
where the slip comes to rest, and a Taylor series can only creep there; in xi they are not.
"""

from functools import cache
from typing import NamedTuple

import heyoka as hy
import law
import numpy as np
from law import BEGUN, BETA, D1, HOLD_LOST, LANDS, LIFTS, N_BODY, SLIP_ZERO, TIME, Body

from tests.limits.regular import FREE, SLIP, STICK

TIME_UP = -1  # the event of a phase that has lasted as long as was asked
FALLS, RISES = hy.event_direction.negative, hy.event_direction.positive

N_PHASE = 3  # parameters of a phase: angle of the plate at its start, slip that is none, its end
PHASE, SLIP_TOL, END = (hy.par[k] for k in range(N_PHASE))
N_MOTION = 9  # and as many of the body
N_PARS = N_PHASE + N_MOTION
BODY = Body(*(hy.par[N_PHASE + k] for k in range(N_MOTION)), *[None] * (N_BODY - N_MOTION))
VARIABLES = hy.make_vars(
    "x1", "y1", "rolled", "d1", "d2", "n1", "n2", "beta", "wb", "wp", "roll", "va", "vb", "theta", "t"
)  # fmt: skip
d1, d2, n1, n2, beta, wb, wp, roll, va, vb, theta, t = VARIABLES[D1:]
ZERO, ONE = hy.expression(0.0), hy.expression(1.0)
STILL = [ZERO] * 4  # gaps and their rates, which follow from the dip angle in a contact
levers, respond, free_motion, forces_one, forces_both = (
    getattr(law, name).py_func for name in ("levers", "respond", "free_motion", "forces_one", "forces_both")
)


class Phase(NamedTuple):
    """The equations of a smooth phase, per unit of mass, and what ends it."""

    rates: list  # of the state
    events: list  # (event function, direction, event number)
    slip_clock: bool  # whether it runs in xi


def size(a, b):
    """Return the speed of a slip."""
    return hy.sqrt(a * a + b * b)


def above(a, b):
    """Return how far a slip is from the one that counts as none: a logarithm, for in xi slip falls exponentially."""
    return hy.log(a * a + b * b) - 2.0 * hy.log(SLIP_TOL)


def within(F, T, L):
    """Return how far the force of a hold is from its limit."""
    return BODY.mu_s * BODY.mu_s * F * F - T * T - L * L


def free(s, time, sin_b, cos_b, turning, c_a, c_b):
    """Return the accelerations without contact forces, seen from the end with sign s."""
    p, fall = levers(BODY, s, sin_b, cos_b), BODY.g - BODY.plate * hy.sin(BODY.omega * time + PHASE)
    return free_motion(BODY, p, s, sin_b, cos_b, fall, turning, wp, roll, c_a, c_b)


def path(sin_b, cos_b, c_a, c_b):
    """Return the rates of the place and the angle of ball 1 where the centre has the velocity c."""
    v_a, v_b = c_a + BODY.h * sin_b * wb, c_b + BODY.h * wp
    sin_t, cos_t = hy.sin(theta), hy.cos(theta)
    return [v_b * cos_t - v_a * sin_t, v_a * cos_t + v_b * sin_t, roll - BODY.r * wp / cos_b * sin_b]


def flight():
    """Return free motion: the torque-free symmetric top in its heading frame, and both gaps."""
    sin_b, cos_b = hy.sin(beta), hy.cos(beta)
    d_wb, d_wp, d_n1, _, _ = free(-1.0, hy.time, sin_b, cos_b, wb, va, vb)
    d_n2 = free(1.0, hy.time, sin_b, cos_b, wb, va, vb)[2]
    turn = wp / cos_b
    rates = [*path(sin_b, cos_b, va, vb), n1, n2, d_n1, d_n2, wb, d_wb, d_wp, ZERO, -turn * vb, turn * va, turn]
    return Phase(rates, [(d1, FALLS, 0), (d2, FALLS, 1)], False)


def single(i, mode):
    """Return the phase of end i alone on the plate, sticking or slipping."""
    s, sin_b, cos_b = 2.0 * i - 1.0, hy.sin(beta), hy.cos(beta)
    p = levers(BODY, s, sin_b, cos_b)
    c_a, c_b = va - p[1] * wb, vb - p[2] * wp - p[3] * roll
    d_wb, d_wp, n, a, b = free(s, t, sin_b, cos_b, wb, c_a, c_b)
    w, v = respond(BODY, p, p), size(va, vb)
    F, A, L = forces_one(BODY, w, (n, a, b), mode, va / v, vb / v)
    events = [(-s * beta, FALLS, LANDS), (F, FALLS, LIFTS + i)]
    d_ua = d_ub = ZERO
    if mode == STICK:
        events.append((within(F, A, L), FALLS, HOLD_LOST + i))
    else:
        events.append((above(va, vb), FALLS, SLIP_ZERO + i))
        d_ua, d_ub = a + w[1] * F + w[2] * A, b + w[3] * L
    turning = d_wb + (p[0] * F + p[1] * A) * BODY.it, d_wp + p[2] * L * BODY.it, p[3] * L * BODY.ia
    rates = [*path(sin_b, cos_b, c_a, c_b), *STILL, wb, *turning, d_ua, d_ub, wp / cos_b]
    return contact(rates, events, v if mode == SLIP else None)


def pair(mode):
    """Return the phase of both ends on the plate (beta = 0), which both stick or both slip."""
    h, it, ia = BODY.h, BODY.it, BODY.ia
    c_a, c_b = va, vb - h * wp + roll
    (_, _, *free_1), (_, _, *free_2) = (free(s, t, 0.0, 1.0, 0.0, c_a, c_b) for s in (-1.0, 1.0))
    ub_2 = vb - 2.0 * h * wp
    v_1, v_2 = size(va, vb), size(va, ub_2)
    F_1, F_2, A, L_1, L_2 = forces_both(BODY, free_1, free_2, mode, va / v_1, vb / v_1, va / v_2, ub_2 / v_2)
    events = [(F_1, FALLS, LIFTS), (F_2, FALLS, LIFTS + 1)]
    rates = path(0.0, 1.0, c_a, c_b) + STILL
    if mode == STICK:
        return contact([*rates, *[ZERO] * 6, wp], [*events, (within(F_1 + F_2, A, 0.0), FALLS, HOLD_LOST)], None)
    events += [(above(va, vb), FALLS, SLIP_ZERO), (above(va, ub_2), FALLS, SLIP_ZERO + 1)]
    d_ua = free_1[1] + h * BODY.r * it * (F_2 - F_1) + (1.0 + BODY.r * BODY.r * it) * A
    d_ub = free_1[2] + (1.0 + h * h * it + ia) * L_1 + (1.0 - h * h * it + ia) * L_2
    rates += [ZERO, ZERO, h * (L_1 - L_2) * it, -(L_1 + L_2) * ia, d_ua, d_ub, wp]
    return contact(rates, events, v_1 * v_2 / (v_1 + v_2))


def contact(rates, events, clock):
    """Return a contact with these rates in time; `clock` is dt/dxi, None where it runs in time itself."""
    rates = [*rates, ONE]
    if clock is None:
        return Phase(rates, events, False)
    return Phase([clock * rate for rate in rates], [*events, (t - END, RISES, TIME_UP)], True)


def equations(mode_1, mode_2):
    """Return the phase with these friction modes."""
    if mode_1 == FREE and mode_2 == FREE:
        return flight()
    if mode_1 == FREE:
        return single(1, mode_2)
    return single(0, mode_1) if mode_2 == FREE else pair(mode_1)


class Integrator(NamedTuple):
    """A compiled phase, and views of what is set at its start."""

    taylor: hy.taylor_adaptive
    state: np.ndarray
    pars: np.ndarray
    numbers: tuple
    slots: slice
    slip_clock: bool
    forced: bool  # by the plate in time, while the state may not move


@cache
def integrator(mode_1, mode_2, tol, with_path):
    """Return the compiled phase with these friction modes."""
    phase = equations(mode_1, mode_2)
    flies = mode_1 == FREE and mode_2 == FREE
    bare = D1 if flies else BETA
    slots = slice(0 if with_path else bare, TIME if flies else BEGUN)
    taylor = hy.taylor_adaptive(
        list(zip(VARIABLES[slots], phase.rates[slots], strict=True)),
        [0.0] * (slots.stop - slots.start),
        tol=tol,
        pars=[0.0] * N_PARS,
        t_events=[hy.t_event(function, direction=direction) for function, direction, _ in phase.events],
    )
    numbers = tuple(number for _, _, number in phase.events)
    forced = not flies and not phase.slip_clock
    return Integrator(taylor, taylor.state, taylor.pars, numbers, slots, phase.slip_clock, forced)
