"""The contact law at an instant, as a user of heyoka would compile it: which ends collide, rest, lift off, stick or slip.

Nothing of the package's own impacts, chatter or contact modes is in here: what this program agrees on with the engine are
the equations. The contact mode is found by trying all: both ends on the plate, either, none; each with stick where the slip
is zero and the force that holds stays within the limit, else with slip in the direction in which it can set out.
"""

from math import atan2, copysign, cos, hypot, inf, pi, sin

from blow import DONE, STATE, End, Pair, one_end, two_ends
from chatter import Accuracy, come_to_rest
from forces import compliance, forces_both, forces_one, free_rates, respond
from passage import (
    HOLD_LOST,
    N_BODY,
    P_PHASE,
    P_SLIP,
    SLIP_ZERO,
    YUA,
    YUB,
    as_body,
    begin,
    compiled,
    lateral_slip,
    levers,
    load,
    set_slip,
    take_over,
    unload,
)

from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    N1,
    N2,
    PHASE,
    SLIP,
    SPIN,
    STICK,
    WB,
    WP,
)

LOOSEST, FINEST = 1e-3, 2e-15  # relative tolerance of an impact: however slow, and that round-off allows
DIRECTIONS, HALVINGS = 32, 50  # of the search for a slip out of rest
NO_FORCE = 1e-12  # of the weight


@compiled
def gain(e):
    """1/e^2."""
    return 1.0 / (e * e) if e > 0.0 else inf


@compiled
def tolerance(accuracy, V):
    """Of an impact with approach speed V, relative: the small impacts of a chatter need few digits."""
    return min(LOOSEST, max(FINEST, accuracy.impact / V))


@compiled
def collide_one(body, state, i, accuracy, space):
    """Impact of end i, which approaches, while the other one is in the air; returns the status."""
    s = 2.0 * i - 1.0
    sin_b, cos_b = sin(state[DIP]), cos(state[DIP])
    p, q = levers(body, s, sin_b, cos_b), levers(body, -s, sin_b, cos_b)
    nn, na, aa, bb = respond(p, p, body.it, body.ia)
    n, a = state[N1 + i], state[CA] + p[1] * state[WB]
    b = state[CB] + p[2] * state[WP] + p[3] * state[SPIN]
    V = -n
    law = End(nn, na, aa, bb, gain(body.e_1 if i == 0 else body.e_2), body.mu, body.mu_s)
    tol = tolerance(accuracy, V)
    status, n_after, a_after, b_after = one_end(law, -1.0, a / V, b / V, accuracy.slip_zero / V, tol, space)
    d_n, d_a, d_b = n_after * V - n, a_after * V - a, b_after * V - b
    det = nn * aa - na * na
    P, T, L = (aa * d_n - na * d_a) / det, (nn * d_a - na * d_n) / det, d_b / bb
    nn_j, na_j = 1.0 + q[0] * p[0] * body.it, q[0] * p[1] * body.it
    state[N1 + i] = n_after * V
    state[N2 - i] += nn_j * P + na_j * T
    state[CA] += T
    state[CB] += L
    state[WB] += (p[0] * P + p[1] * T) * body.it
    state[WP] += p[2] * L * body.it
    state[SPIN] += p[3] * L * body.ia
    return status


@compiled
def collide_both(body, state, accuracy, space):
    """Impact of a dimer that lies flat; returns the status."""
    h, r, it, ia = body.h, body.r, body.it, body.ia
    V = -min(state[N1], state[N2])
    law = Pair(
        1.0 + h * h * it, 1.0 - h * h * it, h * r * it, 1.0 + r * r * it, 1.0 + h * h * it + r * r * ia,
        1.0 - h * h * it + r * r * ia, gain(body.e_1), gain(body.e_2), body.mu, body.mu_s,
    )  # fmt: skip
    a = state[CA] + r * state[WB]
    b, turn = state[CB] - r * state[SPIN], h * state[WP]
    z = space[STATE]
    z[0], z[1], z[4], z[5], z[6] = state[N1] / V, state[N2] / V, a / V, (b + turn) / V, (b - turn) / V
    status = two_ends(law, z, accuracy.slip_zero / V, tolerance(accuracy, V), space)
    for i in range(2):
        state[N1 + i] = max(0.0, z[i] * V)
    L = (0.5 * (z[5] + z[6]) * V - b) / (1.0 + r * r * ia)
    state[WB] = (state[N2] - state[N1]) / (2.0 * h)
    state[CA] = z[4] * V - r * state[WB]
    state[WP] = (z[5] - z[6]) * V / (2.0 * h)
    state[CB] += L
    state[SPIN] -= r * L * ia
    return status


@compiled
def sets_out(body, w, free, free_j, i, side, phi):
    """Acceleration of a slip of end i along phi, across that direction and along it, and the normal force.

    `side` is the direction of the other end's lateral slip; 0 if that end is off the plate.
    """
    c, d = cos(phi), sin(phi)
    if side == 0.0:
        F, T, L = forces_one(body, w, free, SLIP, c, d)
        a, b = free[1] + w[1] * F + w[2] * T, free[2] + w[3] * L
    else:
        r, h, it, ia = body.r, body.h, body.it, body.ia
        if i == 0:
            F, F_j, T, L, L_j = forces_both(body, free, free_j, SLIP, SLIP, c, d, 0.0, side)
        else:
            F_j, F, T, L_j, L = forces_both(body, free_j, free, SLIP, SLIP, 0.0, side, c, d)
        a = free[1] + w[1] * (F - F_j) + w[2] * T
        b = free[2] + w[3] * L + (1.0 - h * h * it + r * r * ia) * L_j
    return c * b - d * a, c * a + d * b, F


@compiled
def direction(body, w, free, free_j, i, side, hold):
    """Direction in which a slip sets out along its own acceleration; the one against the hold if none is found."""
    before, low = 0.0, hold
    for k in range(DIRECTIONS + 1):
        # the first interval is about the direction against the hold
        high = hold + pi + 2.0 * pi * (k - 0.5) / DIRECTIONS
        across, _, _ = sets_out(body, w, free, free_j, i, side, high)
        if k > 0 and before * across <= 0.0:
            right = high
            for _ in range(HALVINGS):
                mid = 0.5 * (low + right)
                there, _, _ = sets_out(body, w, free, free_j, i, side, mid)
                low, right = (mid, right) if there * before > 0.0 else (low, mid)
            _, along, F = sets_out(body, w, free, free_j, i, side, right)
            if along > 0.0 and F > 0.0:
                return right
        before, low = across, high
    return hold + pi


@compiled
def try_one(body, state, i, lost, slip_zero, modes, y):
    """End i alone on the plate: its mode, and its slip in y; whether the plate presses it."""
    s = 2.0 * i - 1.0
    w, free = compliance(body, state, s), free_rates(body, state, s)
    if free[0] >= 0.0:
        return False
    unload(body, state, s, y)
    modes[0] = modes[1] = FREE
    modes[i] = SLIP
    v = hypot(y[YUA], y[YUB])
    if v > slip_zero or body.mu_s == 0.0:
        return w[0] - body.mu * w[1] * y[YUA] / v > 0.0
    y[YUA] = y[YUB] = 0.0
    F, T, L = forces_one(body, w, free, STICK, 0.0, 0.0)
    if F > 0.0 and not lost and hypot(T, L) <= body.mu_s * F:
        modes[i] = STICK
        return True
    phi = direction(body, w, free, free, i, 0.0, atan2(L, T))
    y[YUA], y[YUB] = 0.5 * slip_zero * cos(phi), 0.5 * slip_zero * sin(phi)
    return sets_out(body, w, free, free, i, 0.0, phi)[2] > 0.0


@compiled
def try_both(body, state, lost, slip_zero, modes, y):
    """Both ends on the plate: their modes, and their slips in y; whether the plate presses both."""
    unload(body, state, -1.0, y)
    free_1, free_2 = free_rates(body, state, -1.0), free_rates(body, state, 1.0)
    modes[0] = modes[1] = SLIP
    b_2 = lateral_slip(body, modes, y, 1)
    v_1, v_2 = hypot(y[YUA], y[YUB]), hypot(y[YUA], b_2)
    rest_1, rest_2 = v_1 <= slip_zero and body.mu_s > 0.0, v_2 <= slip_zero and body.mu_s > 0.0
    if not rest_1 and not rest_2:
        F_1, F_2, _, _, _ = forces_both(
            body, free_1, free_2, SLIP, SLIP, y[YUA] / v_1, y[YUB] / v_1, y[YUA] / v_2, b_2 / v_2
        )
        return F_1 > 0.0 and F_2 > 0.0
    if rest_1:
        set_slip(body, modes, y, 0, 0.0, 0.0)
    if rest_2:
        set_slip(body, modes, y, 1, 0.0, 0.0)
    if rest_1 and rest_2:  # then nothing turns, and no force is lateral
        F_1, F_2, T, _, _ = forces_both(body, free_1, free_2, STICK, STICK, 0.0, 0.0, 0.0, 0.0)
        if not lost and abs(T) <= body.mu_s * (F_1 + F_2):
            modes[0] = modes[1] = STICK
        else:
            side = -copysign(1.0, T)
            y[YUA] = 0.5 * slip_zero * side
            F_1, F_2, _, _, _ = forces_both(body, free_1, free_2, SLIP, SLIP, side, 0.0, side, 0.0)
        return F_1 > 0.0 and F_2 > 0.0
    i = 0 if rest_1 else 1
    side = copysign(1.0, b_2 if rest_1 else y[YUB])
    if rest_1:
        F_1, F_2, T, L, _ = forces_both(body, free_1, free_2, STICK, SLIP, 0.0, 0.0, 0.0, side)
    else:
        F_1, F_2, T, _, L = forces_both(body, free_1, free_2, SLIP, STICK, 0.0, side, 0.0, 0.0)
    if not lost and hypot(T, L) <= body.mu_s * (F_1 if rest_1 else F_2):
        modes[i] = STICK
        return F_1 > 0.0 and F_2 > 0.0
    w = compliance(body, state, 2.0 * i - 1.0)
    free, free_j = (free_1, free_2) if rest_1 else (free_2, free_1)
    phi = direction(body, w, free, free_j, i, side, atan2(L, T))
    set_slip(body, modes, y, i, 0.5 * slip_zero * cos(phi), 0.5 * slip_zero * sin(phi))
    return F_1 > 0.0 and F_2 > 0.0


@compiled
def choose(body, state, modes, lifted, lost, slip_zero, y):
    """The contact mode of the ends at rest on the plate, but for one that has just lifted off; whether there is one.

    The state follows it; slips are in y, where round-off does not drown them.
    """
    closed_1 = state[D1] == 0.0 and state[N1] == 0.0 and lifted != 0
    closed_2 = state[D2] == 0.0 and state[N2] == 0.0 and lifted != 1
    if closed_1 and closed_2:
        state[DIP] = state[WB] = 0.0
        if try_both(body, state, lost, slip_zero, modes, y):
            load(body, modes, y, state)
            return True
    for i in range(2):
        closed = closed_1 if i == 0 else closed_2
        alone = not (closed_1 and closed_2)
        if (
            closed
            and try_one(body, state, i, lost, slip_zero, modes, y)
            and (alone or other_leaves(body, state, modes, i, y))
        ):
            load(body, modes, y, state)
            return True
    modes[0] = modes[1] = FREE
    falls_1 = closed_1 and free_rates(body, state, -1.0)[0] < -NO_FORCE * body.g
    falls_2 = closed_2 and free_rates(body, state, 1.0)[0] < -NO_FORCE * body.g
    return not falls_1 and not falls_2


@compiled
def other_leaves(body, state, modes, i, y):
    """Whether the end that is not i, at rest on the plate too, is accelerated off it by the forces of end i alone."""
    s, h, r, it = 2.0 * i - 1.0, body.h, body.r, body.it
    v = hypot(y[YUA], y[YUB])
    c, d = (y[YUA] / v, y[YUB] / v) if v > 0.0 else (0.0, 0.0)
    F, T, _ = forces_one(body, compliance(body, state, s), free_rates(body, state, s), modes[i], c, d)
    return free_rates(body, state, -s)[0] + (1.0 - h * h * it) * F - s * h * r * it * T >= 0.0


@compiled
def cross(constants, y, space, state, modes, ended, event, dt, doubles, count, start, pars):
    """From the end of one phase to the start of the next: impacts, the end of a chatter, the contact mode.

    Parameters
    ----------
    constants : float64 array
        Those of `Body`, then of `Accuracy`.
    ended : float64 array
        State of the integrator of the phase that has ended.
    event, dt : int, float
        Number of the event and duration of that phase [s]; a negative number at the start of a run.
    doubles : float64 array
        Times of double impacts, filled from `count` on.
    start, pars : float64 arrays
        Filled with the start of the next phase and its parameters.

    Returns
    -------
    count, hop : int, float
        Double impacts so far; duration of the hop that begins [s], 0.0 if none does, negative where no law holds.
    """
    body = as_body(constants)
    accuracy = Accuracy(constants[N_BODY], constants[N_BODY + 1], constants[N_BODY + 2], constants[N_BODY + 3])
    lifted, lost = -1, False
    if event >= 0:
        flew = modes[0] == FREE and modes[1] == FREE
        take_over(body, state, modes, ended, event, dt, y)
        if not flew:
            lifted = event % 2 if event < HOLD_LOST else -1
            lost = HOLD_LOST <= event < SLIP_ZERO
    closed_1, closed_2 = state[D1] == 0.0, state[D2] == 0.0
    if (closed_1 and state[N1] < 0.0) or (closed_2 and state[N2] < 0.0):
        V = -min(state[N1] if closed_1 else 0.0, state[N2] if closed_2 else 0.0)
        if closed_1 and closed_2:
            if count == doubles.size:
                return count, -1.0
            doubles[count] = state[PHASE] / body.omega
            count += 1
            status = collide_both(body, state, accuracy, space)
        else:
            status = collide_one(body, state, 0 if closed_1 else 1, accuracy, space)
        if status != DONE:
            return count, -1.0
        come_to_rest(body, state, V, accuracy)
        lifted, lost = -1, False
    if not choose(body, state, modes, lifted, lost, accuracy.slip_zero, y):
        return count, -1.0
    pars[P_PHASE], pars[P_SLIP] = state[PHASE] + body.phi0, accuracy.slip_zero
    return count, begin(body, state, modes, y, start, pars)
