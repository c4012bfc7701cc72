"""The end of a chatter in the peer's law: hops whose remainder is too short to matter, as one close.

The rest of a chatter lasts t = 2 n / (a (1 - k)), k the ratio of its hops. An end that is closed at once lacks an impulse that
goes with its gap rate: n now, none at the end, and none on the average, since the gap is zero at both ends. With the friction
of the contact to come the close costs n (omega t)^2 only, and as much again for how far the slip turns.
"""

from math import cos, hypot, inf, sin
from typing import NamedTuple

from forces import compliance, forces_both, forces_one, free_rates
from passage import compiled, levers

from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    N1,
    N2,
    SLIP,
    SPIN,
    STICK,
    WB,
    WP,
)


class Accuracy(NamedTuple):
    """Absolute tolerance of impacts, slip that counts as none, cost of a close, separation that is none in any case [m/s]."""

    impact: float
    slip_zero: float
    close: float
    v_rest: float


@compiled
def rest_time(body, state, i, n, ratio):
    """Time that the hops of end i from gap rate n take [s]; inf if the plate might end them before."""
    fall = -free_rates(body, state, 2.0 * i - 1.0)[0]
    if fall <= 0.0 or ratio >= 1.0:
        return inf
    time = 2.0 * n / (fall * (1.0 - ratio))
    return time if body.A_z * body.omega**3 * time < 0.5 * fall else inf


@compiled
def slip_of(body, state, i):
    """Axial and lateral slip of end i."""
    _, a, b, c = levers(body, 2.0 * i - 1.0, sin(state[DIP]), cos(state[DIP]))
    return state[CA] + a * state[WB], state[CB] + b * state[WP] + c * state[SPIN]


@compiled
def way(body, state, i, slip_zero):
    """Friction mode of end i and the direction of its slip."""
    a, b = slip_of(body, state, i)
    v = hypot(a, b)
    if v <= slip_zero and body.mu_s > 0.0:
        return STICK, 0.0, 0.0, 0.0
    return (SLIP, a / v, b / v, v) if v > 0.0 else (SLIP, 0.0, 0.0, inf)


@compiled
def over(body, state, i, ratio, accuracy):
    """Whether the hops of end i may be summed, and how long they take [s]."""
    n = state[N1 + i]
    if n <= accuracy.v_rest:
        return True, 0.0
    time = rest_time(body, state, i, n, ratio)
    mode, _, _, v = way(body, state, i, accuracy.slip_zero)
    turn = body.omega * time
    if mode == SLIP and body.mu > 0.0:
        turn = max(turn, n / v)
    return n * turn * turn <= accuracy.close, time


@compiled
def stays_open(body, state, j, time):
    """Whether end j certainly stays off the plate for so long, the other one being closed now."""
    if state[D1 + j] == 0.0 and state[N1 + j] <= state[N2 - j]:
        return False
    fall = body.g + body.A_z * body.omega**2 + body.h * (state[WB] ** 2 + state[WP] ** 2 + state[SPIN] ** 2)
    return state[D1 + j] + time * (state[N1 + j] - fall * time) >= 0.0


@compiled
def close_one(body, state, i, slip_zero):
    """Close end i by the impulse that cancels its gap rate."""
    p = levers(body, 2.0 * i - 1.0, sin(state[DIP]), cos(state[DIP]))
    q = levers(body, 1.0 - 2.0 * i, sin(state[DIP]), cos(state[DIP]))
    mode, c, d, _ = way(body, state, i, slip_zero)
    w = compliance(body, state, 2.0 * i - 1.0)
    P, T, L = forces_one(body, w, (state[N1 + i], 0.0, 0.0), mode, c, d)
    turn = (p[0] * P + p[1] * T) * body.it
    state[N1 + i] = 0.0
    state[N2 - i] += P + q[0] * turn
    state[CA] += T
    state[CB] += L
    state[WB] += turn
    state[WP] += p[2] * L * body.it
    state[SPIN] += p[3] * L * body.ia


@compiled
def close_both(body, state, slip_zero):
    """Close both ends of a dimer that lies flat."""
    mode_1, c_1, d_1, _ = way(body, state, 0, slip_zero)
    mode_2, c_2, d_2, _ = way(body, state, 1, slip_zero)
    rate_1, rate_2 = (state[N1], 0.0, 0.0), (state[N2], 0.0, 0.0)
    _, _, T, L_1, L_2 = forces_both(body, rate_1, rate_2, mode_1, mode_2, c_1, d_1, c_2, d_2)
    state[N1] = state[N2] = state[DIP] = state[WB] = 0.0
    state[CA] += T
    state[CB] += L_1 + L_2
    state[WP] += body.h * (L_1 - L_2) * body.it
    state[SPIN] -= body.r * (L_1 + L_2) * body.ia


@compiled
def come_to_rest(body, state, V, accuracy):
    """Close the ends whose chatter is as good as over, after an impact with approach speed V."""
    over_1, time_1 = over(body, state, 0, state[N1] / V, accuracy)
    over_2, time_2 = over(body, state, 1, state[N2] / V, accuracy)
    over_1, over_2 = over_1 and state[D1] == 0.0, over_2 and state[D2] == 0.0
    if over_1 and over_2:
        close_both(body, state, accuracy.slip_zero)
    elif over_1 and stays_open(body, state, 1, time_1):
        close_one(body, state, 0, accuracy.slip_zero)
    elif over_2 and stays_open(body, state, 0, time_2):
        close_one(body, state, 1, accuracy.slip_zero)
