"""The end of a chatter: bounces whose remainder lasts too short to matter are summed as a plastic close.

The rest of a chatter, a geometric series of hops, takes t = 2 n / (a (1 - e)) and hands over, up to terms of the order of
n t, the impulse of a contact that is closed from now on minus the one that cancels the rate n. So the end is closed now by
that (negative) impulse, with the friction of the contact to come: the error is quadratic in n, and bounded by the
tolerance.
"""

from math import cos, hypot, sin

from dimersweep.kernel.body import delassus, levers
from dimersweep.kernel.choose import CLOSED, contact_mode
from dimersweep.kernel.contact import A1, F1, F2, L1, L2, YUA, YUB, double_forces, unload
from dimersweep.kernel.impact import push
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import BETA, CA, CB, D1, D2, FREE, N1, N2, PHASE, SLIP, SPIN, WB, WP

FLOOR = 1e-13  # separation speed, in g/omega, at which round-off rules the hops


@compiled
def slow_enough(dm, n, F, nn, e, tol):
    """Whether the rest of a chatter from gap rate n under a contact force F is below the tolerance."""
    if n <= FLOOR * dm.v_scale:
        return True
    if e >= 1.0 or F <= 0.0:
        return False
    remaining = 2.0 * n / (F * nn * (1.0 - e))
    return n * remaining <= tol * dm.v_scale * dm.T


@compiled
def come_to_rest(dm, state, modes, slip_tol, tol, y, dy, F):
    """Close the ends whose chatter is as good as over; the state is updated.

    Returns
    -------
    bool
        Whether an end was closed.
    """
    fast = (tol * dm.v_scale * dm.T * 0.5 * (dm.g + dm.A_z * dm.omega**2) * 4.0) ** 0.5
    may_1 = state[D1] == 0.0 and 0.0 <= state[N1] <= fast
    may_2 = state[D2] == 0.0 and 0.0 <= state[N2] <= fast
    if not (may_1 and state[N1] > 0.0) and not (may_2 and state[N2] > 0.0):
        return False
    for _ in range(3):
        if not may_1 and not may_2:
            return False
        unload(dm, state, -1.0 if may_1 else 1.0, y)
        phase = state[PHASE] + dm.phi0
        answer = contact_mode(dm, may_1, may_2, phase, y, modes, slip_tol, False, dy, F)
        if answer != CLOSED:
            drop_round_off(dm, state)
            return False
        lv = levers(dm, 1.0, sin(state[BETA]), cos(state[BETA]))
        nn = delassus(dm, lv, lv).nn
        slow_1 = modes[0] == FREE or slow_enough(dm, state[N1], F[F1], nn, dm.e_1, tol)
        slow_2 = modes[1] == FREE or slow_enough(dm, state[N2], F[F2], nn, dm.e_2, tol)
        if slow_1 and slow_2:
            break
        may_1, may_2 = may_1 and slow_1 and modes[0] != FREE, may_2 and slow_2 and modes[1] != FREE
    else:
        return False
    if modes[0] != FREE and modes[1] != FREE:
        close_both(dm, state, modes, y, F)
    else:
        close_one(dm, state, modes, 0 if modes[0] != FREE else 1, y)
    return True


@compiled
def drop_round_off(dm, state):
    """Ends that leave the plate at a rate of round-off leave it at rate zero (a hop at no weight would never end)."""
    for i in range(2):
        if state[D1 + i] == 0.0 and 0.0 < state[N1 + i] <= FLOOR * dm.v_scale:
            state[N1 + i] = 0.0


@compiled
def close_one(dm, state, modes, i, y):
    """Cancel the gap rate of end i by an impulse with the friction of its contact mode."""
    s = -1.0 if i == 0 else 1.0
    sin_b, cos_b = sin(state[BETA]), cos(state[BETA])
    lv, lj = levers(dm, s, sin_b, cos_b), levers(dm, -s, sin_b, cos_b)
    w, wj = delassus(dm, lv, lv), delassus(dm, lj, lv)
    t_a, t_b = -w.an / w.aa, 0.0
    if modes[i] == SLIP:
        v = hypot(y[YUA], y[YUB])
        t_a, t_b = -dm.mu * y[YUA] / v, -dm.mu * y[YUB] / v
    own, other = (N1, N2) if i == 0 else (N2, N1)
    P = -state[own] / (w.nn + w.na * t_a)
    push(dm, state, lv, P, t_a * P, t_b * P)
    state[other] += P * (wj.nn + wj.na * t_a)
    state[own] = 0.0


@compiled
def close_both(dm, state, modes, y, F):
    """Cancel both gap rates at beta = 0 by impulses with the friction of the contact modes."""
    double_forces(dm, modes, y, state[N1], state[N2], 0.0, 0.0, F)
    state[CA] += F[A1] / dm.m
    state[CB] += (F[L1] + F[L2]) / dm.m
    state[WP] += dm.h * (F[L1] - F[L2]) / dm.J_t
    state[SPIN] -= dm.r * (F[L1] + F[L2]) / dm.J_a
    state[N1], state[N2] = 0.0, 0.0
    state[BETA], state[WB] = 0.0, 0.0
