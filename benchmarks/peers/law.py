"""The dimer per unit of mass for the peer on heyoka, and its contact law at an instant, as a user of heyoka would compile it.

Functions of plain arithmetic serve twice: Numba compiles them for what happens at an instant, and `phases` calls them on
heyoka's symbols. Nothing of the engine is in here.

The contact mode is found by trying all: both ends on the plate, either, none; each with stick where the slip is zero and the
force that holds stays within the limit, else with slip. The rest of a chatter is summed. It lasts t = 2 n / (a (1 - k)), k
the ratio of its hops. An end that is closed at once lacks an impulse that goes with its gap rate: n now, none at the end, and
none on the average, since the gap is zero at both ends. With the friction of the contact to come the close costs
n (omega t)^2 only, and as much again for how far the slip turns.
"""

from collections import namedtuple
from math import atan2, copysign, cos, inf, pi, sin

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from tests.limits.regular import (
    FREE,
    SLIP,
    STATE,
    STICK,
    ZA,
    ZB1,
    ZB2,
    ZN1,
    ZN2,
    compiled,
    law_of,
    one_end,
    speed,
    two_ends,
)
from tests.oracle.body import dimer

# Slots of the state: centre of ball 1 and its angle times r, gaps and their rates, dip angle, beta', theta' cos(beta), spin
# times r, two velocities, heading, time in the present phase, and when that began. The velocities are those of the centre
# of mass along and across the axis; in a contact they are the slip of the leading end (p1 if it is closed, else p2), which
# would drown in round-off. The factor r is there because the largest number of a state rules heyoka's steps.
X1, Y1, ROLLED, D1, D2, N1, N2, BETA, WB, WP, ROLL, VA, VB, THETA, TIME, BEGUN = range(16)
N_STATE = 16
LIFTS, HOLD_LOST, SLIP_ZERO, LANDS = 0, 2, 4, 6  # events of a contact: the number of its kind, plus 1 for p2
# Half the distance of the balls, their radius, mass over transverse inertia and mass times r^2 over axial inertia, friction,
# gravity, acceleration of the plate, its angular frequency: these nine are in the equations of motion. Then the plate's phase
# at t = 0, restitution, and in m/s: tolerance of impacts, slip that counts as none, cost of the end of a chatter.
Body = namedtuple("Body", "h r it ia mu mu_s g plate omega phi0 e impact slip_zero close")
N_BODY = len(Body._fields)
HALVINGS = 50  # of the search for the direction of a slip out of rest
NO_FORCE = 1e-12  # of the weight
LEAST_RATE = 1e-14  # separation that is none in any case [m/s]
LIFT = 1e-15  # a gap that opens starts at this share of the hop's height: a root at zero hides the next one
OPEN = 1e-17  # and at this share of h where it opens without a rate


def body_of(scene, impact, slip_zero, close):
    """Return the constants of named parameters, and of three accuracies."""
    d = dimer(scene)
    if d.e[0] == 0.0 or any(one != other for one, other in (d.r, d.e, d.mu, d.mu_s)):
        raise ValueError("the peer on heyoka takes like ends with e > 0 only")
    motion = (
        d.l / 2,
        d.r[0],
        d.m / d.J1,
        d.r[0] ** 2 * d.m / d.J2,
        d.mu[0],
        d.mu_s[0],
        d.g,
        d.A[0, 2] * d.omega**2,
        d.omega,
    )
    return Body(*motion, d.phi[0, 2], d.e[0], impact, slip_zero, close)


def start_state(body, beta0, xdot0):
    """Return the state at the release: p1 on the plate, at rest but for the lateral speed xdot0."""
    state = np.zeros(N_STATE)
    state[D2], state[BETA], state[VB] = 2.0 * body.h * sin(beta0), beta0, xdot0
    state[N1] = state[N2] = -body.plate / body.omega * cos(body.phi0)
    return state


def coordinates(body, state):
    """Return x1, y1, gap of p1, theta, beta, gamma and their rates; the velocities in the state are those of the centre."""
    sin_b, cos_b, sin_t, cos_t = sin(state[BETA]), cos(state[BETA]), sin(state[THETA]), cos(state[THETA])
    turn = state[WP] / cos_b
    v_a, v_b = state[VA] + body.h * sin_b * state[WB], state[VB] + body.h * state[WP]
    place = state[X1], state[Y1], state[D1], state[THETA], state[BETA], state[ROLLED] / body.r
    rates = v_b * cos_t - v_a * sin_t, v_a * cos_t + v_b * sin_t, state[N1], turn, state[WB]
    return np.array([*place, *rates, state[ROLL] / body.r - turn * sin_b])


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
def levers_of(body, state, i):
    """Return the levers of end i in this state."""
    return levers(body, 2.0 * i - 1.0, sin(state[BETA]), cos(state[BETA]))


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


@compiled
def collide_one(body, state, i, space):
    """Carry end i, which approaches, through its impact while the other one is in the air; return whether all went well."""
    p = levers_of(body, state, i)
    w = respond(body, p, p)
    nn, na, aa, bb = w
    n, (a, b, _) = state[N1 + i], slip_of(body, state, i)
    V = -n
    well, n_after, a_after, b_after = one_end(
        law_of(w, w, body.e, body.mu, body.mu_s, body.slip_zero / V, body.impact / V), -1.0, a / V, b / V, space
    )
    d_n, d_a, d_b = n_after * V - n, a_after * V - a, b_after * V - b
    det = nn * aa - na * na
    push(body, state, i, (aa * d_n - na * d_a) / det, (nn * d_a - na * d_n) / det, d_b / bb)
    state[N1 + i] = n_after * V
    return well


@compiled
def collide_both(body, state, space):
    """Carry a dimer that lies flat through an impact; return whether all went well."""
    V = -min(state[N1], state[N2])
    a, b_1, _ = slip_of(body, state, 0)
    b_2 = slip_of(body, state, 1)[1]
    z = space[STATE]
    z[ZN1], z[ZN2], z[ZA], z[ZB1], z[ZB2] = state[N1] / V, state[N2] / V, a / V, b_1 / V, b_2 / V
    p, q = levers_of(body, state, 1), levers_of(body, state, 0)
    w, w_12 = respond(body, p, p), respond(body, p, q)
    well = two_ends(law_of(w, w_12, body.e, body.mu, body.mu_s, body.slip_zero / V, body.impact / V), space)
    state[N1], state[N2] = max(0.0, z[ZN1] * V), max(0.0, z[ZN2] * V)
    state[WB] = (state[N2] - state[N1]) / (2.0 * body.h)
    state[VA] = z[ZA] * V - body.r * state[WB]
    state[WP] = (z[ZB1] - z[ZB2]) * V / (2.0 * body.h)
    L = 0.5 * ((z[ZB1] + z[ZB2]) * V - b_1 - b_2) / (1.0 + body.ia)
    state[VB] += L
    state[ROLL] -= L * body.ia
    return well


@compiled
def way(body, state, i):
    """Return friction mode, direction and size of the slip of end i."""
    a, b, v = slip_of(body, state, i)
    if v <= body.slip_zero and body.mu_s > 0.0:
        return STICK, 0.0, 0.0, 0.0
    return (SLIP, a / v, b / v, v) if v > 0.0 else (SLIP, 0.0, 0.0, inf)


@compiled
def is_over(body, state, i, V):
    """Return whether end i is so near to the end of its chatter that its hops may be summed, and how long they take [s]."""
    n = state[N1 + i]
    if state[D1 + i] > 0.0:
        return False, 0.0
    if n <= LEAST_RATE:
        return True, 0.0
    fall = -free_rates(body, state, i)[0]
    if fall <= 0.0 or n >= V:
        return False, inf
    time = 2.0 * n / (fall * (1.0 - n / V))
    if body.plate * body.omega * time >= 0.5 * fall:  # the plate might end it before
        return False, inf
    mode, _, _, v = way(body, state, i)
    turn = body.omega * time
    if mode == SLIP and body.mu > 0.0:
        turn = max(turn, n / v)
    return n * turn * turn <= body.close, time


@compiled
def stays_open(body, state, j, time):
    """Return whether end j certainly stays off the plate for so long, the other one being closed now."""
    if state[D1 + j] == 0.0 and state[N1 + j] <= state[N2 - j]:
        return False
    fall = body.g + body.plate + body.h * (state[WB] ** 2 + state[WP] ** 2 + (state[ROLL] / body.r) ** 2)
    return state[D1 + j] + time * (state[N1 + j] - fall * time) >= 0.0


@compiled
def come_to_rest(body, state, V):
    """Close the ends whose chatter is as good as over, after an impact with approach speed V."""
    over_1, time_1 = is_over(body, state, 0, V)
    over_2, time_2 = is_over(body, state, 1, V)
    mode_1, c_1, d_1, _ = way(body, state, 0)
    mode_2, c_2, d_2, _ = way(body, state, 1)
    rates_1, rates_2 = (state[N1], 0.0, 0.0), (state[N2], 0.0, 0.0)
    if over_1 and over_2:
        mode = STICK if mode_1 == STICK and mode_2 == STICK else SLIP
        P_1, P_2, T, L_1, L_2 = forces_both(body, rates_1, rates_2, mode, c_1, d_1, c_2, d_2)
        push(body, state, 0, P_1, T, L_1)
        push(body, state, 1, P_2, 0.0, L_2)
        state[N1] = state[N2] = state[BETA] = state[WB] = 0.0
    elif (over_1 and stays_open(body, state, 1, time_1)) or (over_2 and stays_open(body, state, 0, time_2)):
        i = 0 if over_1 else 1
        rates, mode, c, d = (rates_1, mode_1, c_1, d_1) if over_1 else (rates_2, mode_2, c_2, d_2)
        p = levers_of(body, state, i)
        P, T, L = forces_one(body, respond(body, p, p), rates, mode, c, d)
        push(body, state, i, P, T, L)
        state[N1 + i] = 0.0


@compiled
def shift(body, state, i, sign):
    """Make the velocity of the centre the slip of end i (sign 1), or that slip the velocity again (-1)."""
    _, a, b, c = levers_of(body, state, i)
    state[VA] += sign * a * state[WB]
    state[VB] += sign * (b * state[WP] + c * state[ROLL])


@compiled
def try_one(body, state, i, lost, modes, start):
    """Return whether end i alone is pressed to the plate; its mode and, at the start, its slip."""
    p = levers_of(body, state, i)
    w, free = respond(body, p, p), free_rates(body, state, i)
    if free[0] >= 0.0:
        return False
    start[:] = state
    shift(body, start, i, 1.0)
    modes[0] = modes[1] = FREE
    modes[i] = SLIP
    v = speed(start[VA], start[VB])
    if v > body.slip_zero or body.mu_s == 0.0:
        return w[0] - body.mu * w[1] * start[VA] / v > 0.0
    start[VA] = start[VB] = 0.0
    F, T, L = forces_one(body, w, free, STICK, 0.0, 0.0)
    if F > 0.0 and not lost and speed(T, L) <= body.mu_s * F:
        modes[i] = STICK
        return True
    low, high = atan2(L, T) + 0.5 * pi, atan2(L, T) + 1.5 * pi
    for _ in range(HALVINGS):  # for the direction in which a slip sets out along its own acceleration (a, b)
        c, d = cos(0.5 * (low + high)), sin(0.5 * (low + high))
        F, T, L = forces_one(body, w, free, SLIP, c, d)
        a, b = free[1] + w[1] * F + w[2] * T, free[2] + w[3] * L
        low, high = (0.5 * (low + high), high) if c * b - d * a > 0.0 else (low, 0.5 * (low + high))
    start[VA], start[VB] = 0.5 * body.slip_zero * c, 0.5 * body.slip_zero * d
    return F > 0.0


@compiled
def try_both(body, state, lost, modes, start):
    """Return whether both ends are pressed to the plate, and both stick or both slip; their mode and slip, as above."""
    start[:] = state
    shift(body, start, 0, 1.0)
    free_1, free_2 = free_rates(body, state, 0), free_rates(body, state, 1)
    mode_1, c_1, d_1, _ = way(body, state, 0)
    mode_2, c_2, d_2, _ = way(body, state, 1)
    modes[0] = modes[1] = mode_1
    if mode_1 == STICK and mode_2 == STICK:
        start[VA] = start[VB] = start[WP] = 0.0
        F_1, F_2, T, _, _ = forces_both(body, free_1, free_2, STICK, 0.0, 0.0, 0.0, 0.0)
        if not lost and abs(T) <= body.mu_s * (F_1 + F_2):
            return F_1 > 0.0 and F_2 > 0.0
        modes[0] = modes[1] = SLIP
        c_1 = c_2 = -copysign(1.0, T)
        start[VA] = 0.5 * body.slip_zero * c_1
    elif mode_1 != mode_2:
        return False
    F_1, F_2, _, _, _ = forces_both(body, free_1, free_2, SLIP, c_1, d_1, c_2, d_2)
    return F_1 > 0.0 and F_2 > 0.0


@compiled
def choose(body, state, modes, lifted, lost, start):
    """Return whether there is a contact mode of the ends at rest on the plate, but for one that has just lifted off.

    The mode is set, and so is the start of its phase.
    """
    closed_1 = state[D1] == 0.0 and state[N1] == 0.0 and lifted != 0
    closed_2 = state[D2] == 0.0 and state[N2] == 0.0 and lifted != 1
    if closed_1 and closed_2:
        state[BETA] = state[WB] = 0.0
        return try_both(body, state, lost, modes, start)
    if (closed_1 or closed_2) and try_one(body, state, 0 if closed_1 else 1, lost, modes, start):
        return True
    modes[0] = modes[1] = FREE
    start[:] = state
    falls_1 = closed_1 and free_rates(body, state, 0)[0] < -NO_FORCE * body.g
    falls_2 = closed_2 and free_rates(body, state, 1)[0] < -NO_FORCE * body.g
    return not falls_1 and not falls_2


@compiled
def lift_off(body, state, modes, start):
    """Set the gaps that open now off zero by nothing that matters; return how long the shortest hop lasts, 0.0 if none does."""
    flies, hop = modes[0] == FREE and modes[1] == FREE, inf
    for i in range(2):
        if modes[i] != FREE or state[D1 + i] > 0.0:
            continue
        rate = max(0.0, state[N1 + i])
        time = 2.0 * rate / max(gravity(body, state) + body.h * state[WB] ** 2, 1e-3 * body.g)
        gap = OPEN * body.h + LIFT * 0.5 * rate * time
        if flies:
            start[D1 + i] = gap
        else:
            start[BETA] = (i - 0.5) * gap / body.h
            time = time / speed(start[VA], start[VB]) if modes[1 - i] == SLIP else time
        hop = min(hop, time) if time > 0.0 else hop
    return hop if hop < inf else 0.0


@compiled
def arrive(body, modes, ended, first, event, state):
    """Fill the state, with the velocity of the centre, from what the integrator ended with; make exact what its event says."""
    flies = modes[0] == FREE and modes[1] == FREE
    for k in range(ended.size):
        state[first + k] = ended[k]
    state[BEGUN] += state[TIME]
    if flies:
        if event >= 0:
            state[D1 + event] = 0.0
            if state[D2 - event] <= 1e-15 * body.h:
                state[D2 - event] = state[BETA] = 0.0
        return
    state[BETA] = 0.0 if event == LANDS else state[BETA]
    lead = 0 if modes[0] != FREE else 1
    if SLIP_ZERO <= event < LANDS:
        state[VA] = 0.0
        if event % 2 == lead:
            if modes[0] != FREE and modes[1] != FREE:
                state[WP] -= state[VB] / (2.0 * body.h)
            state[VB] = 0.0
        else:
            state[WP] = state[VB] / (2.0 * body.h)
    shift(body, state, lead, -1.0)
    gap, rate = 2.0 * body.h * sin(state[BETA]), 2.0 * body.h * cos(state[BETA]) * state[WB]
    state[D1], state[N1] = (0.0, 0.0) if modes[0] != FREE else (-gap, -rate)
    state[D2], state[N2] = (0.0, 0.0) if modes[1] != FREE else (gap, rate)


@compiled
def cross(row, space, state, modes, ended, first, event, doubles, count, start):
    """Lead from the end of one phase to the start of the next: impacts, the end of a chatter, the contact mode.

    `ended` is the state of the integrator of the phase that has ended, from the slot `first` on, by an event (negative at the
    start of a run). The state at that time, the modes of the next phase and its start are filled in, and the times of double
    impacts from `count` on. Returns their number, and how long the hop lasts that begins: 0.0 if none does, negative where no
    law holds.
    """
    body = Body(*to_fixed_tuple(row, N_BODY))
    lifted, lost = -1, False
    if event >= 0:
        if modes[0] != FREE or modes[1] != FREE:
            lifted = event % 2 if event < HOLD_LOST else -1
            lost = HOLD_LOST <= event < SLIP_ZERO
        arrive(body, modes, ended, first, event, state)
    V_1, V_2 = -state[N1] if state[D1] == 0.0 else 0.0, -state[N2] if state[D2] == 0.0 else 0.0
    if max(V_1, V_2) > 0.0:
        lifted, lost = -1, False
        if state[D1] == 0.0 and state[D2] == 0.0:
            doubles[count] = state[BEGUN]
            count += 1
            well = collide_both(body, state, space)
        else:
            well = collide_one(body, state, 0 if state[D1] == 0.0 else 1, space)
        if not well or count == doubles.size:
            return count, -1.0
        come_to_rest(body, state, max(V_1, V_2))
    if not choose(body, state, modes, lifted, lost, start):
        return count, -1.0
    start[TIME] = 0.0
    return count, lift_off(body, state, modes, start)
