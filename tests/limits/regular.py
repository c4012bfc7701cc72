"""The impact law compiled by itself: (6)-(7) of the paper for like ends in the regular form dP_i = X_i^(3/2) dtau.

Velocities are in units of the approach speed, impulses in units of mass times that. An impact at one end is closed form
where it sticks, slips in a constant direction or has no friction; else its slip is integrated in the clock dP = v dxi, in
which it is regular where the slip ends. Two ends at once are integrated in tau, from switch to switch.

The integrator is DOP853 with the coefficients of scipy. Equations `rates(law, switches, z, out)` are followed until one of
the `gauges(law, switches, z, out)` that has been positive falls to zero. All arrays are rows of one space.
"""

from collections import namedtuple
from math import copysign, inf, log, sqrt

import numpy as np
from numba import njit
from scipy.integrate import DOP853

compiled = njit(error_model="numpy", nogil=True)  # not cached: functions are arguments here

FREE, STICK, SLIP = 0, 1, 2  # friction modes of an end
A, B, E3, E5 = (np.ascontiguousarray(each) for each in (DOP853.A, DOP853.B, DOP853.E3, DOP853.E5))
STAGES = B.size  # slopes of a step; the next row has that of the new state
STATE, ARG, OUT, VALUES, AHEAD, ARMED, SWITCHES = range(STAGES + 1, STAGES + 8)  # rows of the space, after the slopes
SPACE = SWITCHES + 1, 8
MAX_STEPS, MAX_PROBES = 20_000, 60
NEAR, NEAREST = 1e-3, 1e-15  # how near to zero a switch is located: in tolerances, and at best
LOOSEST, FINEST = 1e-3, 2e-15  # tolerance of an impact: however slow, and that round-off allows
SLIGHT = 1e-7  # part of a step over which the slope of a gauge is taken
MAX_SWITCHES, HALVINGS = 400, 60
FIRST = 0.05  # first step of a double impact in tau; it lasts about 3
AXIAL = 10.0  # lateral part of a slip that is none, in units of the slip that is none
LEFT = 1e-3  # gap rate, in tolerances, that is none

AA, AB, AN, AE = range(4)  # of the slip of one end: axial and lateral slip, gap rate, stored energy
# of two ends: gap rates, compressions, the axial slip they share, lateral ones
ZN1, ZN2, ZX1, ZX2, ZA, ZB1, ZB2 = range(7)
# What impulses at the ends that collide do to their contact velocities: normal, axial from normal (of two ends, at p2: at p1 it
# is the opposite), axial, lateral, and what one at one end does at the other. Then 1/e^2, friction, slip that counts as none,
# the tolerance, and what is zero for a gauge.
Law = namedtuple("Law", "nn na aa bb nn_12 bb_12 gain mu mu_s slip_zero tol near")


@compiled
def speed(a, b):
    """Return the size of a velocity; `hypot` takes several times as long."""
    return sqrt(a * a + b * b)


@compiled
def step(rates, law, h, n, space):
    """Make one step from the state, whose slopes are row 0, to the row OUT; return its error over the tolerance."""
    state, arg, out, switches = space[STATE], space[ARG], space[OUT], space[SWITCHES]
    for i in range(1, STAGES):
        for k in range(n):
            arg[k] = state[k]
        for j in range(i):
            share = h * A[i, j]
            if share != 0.0:
                for k in range(n):
                    arg[k] += share * space[j, k]
        rates(law, switches, arg, space[i])
    sum5 = sum3 = 0.0
    for k in range(n):
        total = e5 = e3 = 0.0
        for j in range(STAGES):
            total += B[j] * space[j, k]
            e5 += E5[j] * space[j, k]
            e3 += E3[j] * space[j, k]
        out[k] = state[k] + h * total
        sum5 += e5 * e5
        sum3 += e3 * e3
    if sum5 == 0.0:
        return 0.0
    return h * sum5 / sqrt((sum5 + 0.01 * sum3) * n) / law.tol


@compiled
def least(gauges, law, n_g, space):
    """Return the least of the gauges that were positive at the start of the step, now after it, and its number."""
    gauges(law, space[SWITCHES], space[OUT], space[VALUES])
    lowest, which = inf, 0
    for k in range(n_g):
        if space[ARMED, k] > 0.0 and space[VALUES, k] < lowest:
            lowest, which = space[VALUES, k], k
    return lowest, which


@compiled
def gauge_at(rates, gauges, law, row, which, h, n, space):
    """Return a gauge and its slope there where `row` has the state; the slope is a difference over a slight part of h."""
    values, switches = space[AHEAD], space[SWITCHES]
    gauges(law, switches, space[row], values)
    value = values[which]
    rates(law, switches, space[row], space[STAGES])
    for k in range(n):
        space[ARG, k] = space[row, k] + SLIGHT * h * space[STAGES, k]
    gauges(law, switches, space[ARG], values)
    return value, (values[which] - value) / (SLIGHT * h)


@compiled
def zero_of(x_0, g_0, s_0, x_1, g_1, s_1):
    """Return where a falling gauge is zero, by the inverse cubic through two values and slopes; if one is level, by Newton."""
    if s_0 >= 0.0 or s_1 >= 0.0:
        return x_1 - g_1 / s_1
    rise = g_1 - g_0
    u = -g_0 / rise
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * x_0 + u * rise / s_0) + u * u * ((3.0 - 2.0 * u) * x_1 - v * rise / s_1)


@compiled
def locate(rates, gauges, law, h, n, n_g, space):
    """Repeat the step of length h with other lengths until the first gauge falls just to zero."""
    low, high, x, last = 0.0, h, h, -1
    for probe in range(MAX_PROBES):
        g, which = least(gauges, law, n_g, space)
        if abs(g) <= law.near or high - low <= NEAREST * high:
            return
        low, high = (x, high) if g > 0.0 else (low, x)
        if which != last:
            last, x_0 = which, 0.0
            g_0, s_0 = gauge_at(rates, gauges, law, STATE, which, h, n, space)
        g, s = gauge_at(rates, gauges, law, OUT, which, h, n, space)
        guess = zero_of(x_0, g_0, s_0, x, g, s)
        x_0, g_0, s_0 = x, g, s
        x = guess if low < guess < high and probe % 4 < 3 else 0.5 * (low + high)
        step(rates, law, x, n, space)


@compiled
def march(rates, gauges, law, h, n, n_g, space):
    """Follow the state, with a first step h, until a gauge that has been positive falls to zero; return whether one did."""
    for _ in range(MAX_STEPS):
        rates(law, space[SWITCHES], space[STATE], space[0])
        error = step(rates, law, h, n, space)
        factor = 0.9 * error ** (-1.0 / 8.0) if error > 0.0 else 5.0
        if not error <= 1.0:
            h *= max(0.1, factor) if error < inf else 0.1
            continue
        gauges(law, space[SWITCHES], space[STATE], space[VALUES])
        for k in range(n_g):
            space[ARMED, k] = space[VALUES, k] > 0.0
        fell = least(gauges, law, n_g, space)[0] <= 0.0
        if fell:
            locate(rates, gauges, law, h, n, n_g, space)
        for k in range(n):
            space[STATE, k] = space[OUT, k]
        if fell:
            return True
        h *= min(5.0, factor)
    return False


@compiled
def fired(k, law, space):
    """Return whether gauge k has fallen to zero at the end of a march."""
    return space[ARMED, k] > 0.0 and space[VALUES, k] <= law.near


@compiled
def law_of(w, w_12, e, mu, mu_s, slip_zero, tol):
    """Return the law of an impact, all speeds in units of that of approach: the small impacts of a chatter need few digits.

    `w` has the responses normal, axial from normal, axial and lateral of an end to an impulse there, `w_12` to one at the
    other end.
    """
    tol = min(LOOSEST, max(FINEST, tol))
    return Law(
        w[0], w[1], w[2], w[3], w_12[0], w_12[3], 1.0 / (e * e), mu, mu_s, slip_zero, tol, max(NEAREST, NEAR * tol)
    )


@compiled
def excess(law, a, b):
    """Return how far a slip is from the one that counts as none: a logarithm, since it falls exponentially in xi."""
    return 1e-3 * log((a * a + b * b) / law.slip_zero**2)


@compiled
def axial_excess(law, b):
    """Return how far a slip with this lateral part is from an axial one, which stays axial."""
    return excess(law, b / AXIAL, 0.0) if b != 0.0 else 1.0


@compiled
def slip_rates(law, restoring, y, out):
    """Compute d/dxi of the slip of one end, its gap rate and its stored energy."""
    v = speed(y[AA], y[AB])
    out[AA] = law.na * v - law.mu * law.aa * y[AA]
    out[AB] = -law.mu * law.bb * y[AB]
    out[AN] = law.nn * v - law.mu * law.na * y[AA]
    out[AE] = -(law.gain if restoring[0] else 1.0) * y[AN] * v


@compiled
def slip_gauges(law, restoring, y, out):
    """Compute what is positive until compression or restitution ends, until the slip does, and until it is axial."""
    out[0] = y[AE] if restoring[0] else -y[AN]
    out[1] = excess(law, y[AA], y[AB])
    out[2] = axial_excess(law, y[AB])


@compiled
def with_constant_rates(law, n, rate, E, restoring):
    """Return normal impulse and gap rate at the end of an impact whose gap rate grows by `rate` per impulse."""
    P = 0.0
    if not restoring:
        P, E, n = -n / rate, E + 0.5 * n * n / rate, 0.0
    after = sqrt(n * n + 2.0 * rate * E / law.gain)
    return P + (after - n) / rate, after


@compiled
def one_end(law, n, a, b, space):
    """Return whether all went well, and gap rate, axial and lateral slip after an impact at one end."""
    y, restoring = space[STATE], space[SWITCHES]
    y[AA], y[AB], y[AN], y[AE], restoring[0] = a, b, n, 0.0, 0.0
    v = speed(a, b)
    if law.mu_s == 0.0 or law.tol * v >= 1.0:  # nothing slows the slip, or its direction hardly turns
        c, d = (a / v, b / v) if v > 0.0 else (0.0, 0.0)
        P, n = with_constant_rates(law, n, law.nn - law.mu * law.na * c, 0.0, False)
        return True, n, a + (law.na - law.mu * law.aa * c) * P, b - law.mu * law.bb * d * P
    while speed(y[AA], y[AB]) > law.slip_zero:
        y[AB] = 0.0 if abs(y[AB]) <= AXIAL * law.slip_zero else y[AB]
        v = speed(y[AA], y[AB])
        if v <= law.slip_zero:
            break
        rate = max(law.nn * v - law.mu * law.na * y[AA], 1e-3 * v)
        h = sqrt(2.0 * y[AE] / (law.gain * rate * v)) if restoring[0] else -y[AN] / rate
        if not march(slip_rates, slip_gauges, law, 1.001 * h, 4, 3, space):
            return False, n, a, b
        if fired(1, law, space):
            break
        if fired(2, law, space):
            y[AB] = 0.0
        if fired(0, law, space):
            if restoring[0]:
                return True, max(0.0, y[AN]), y[AA], y[AB]
            y[AN], restoring[0] = 0.0, 1.0
    sticks = abs(law.na) <= law.mu_s * law.aa
    hold = law.na / law.aa if sticks else copysign(law.mu, law.na)
    P, n = with_constant_rates(law, y[AN], law.nn - law.na * hold, y[AE], restoring[0] > 0.0)
    return True, n, (law.na - law.aa * hold) * P, 0.0


MODES, ACTS, RESTORES, SIDE = 0, 2, 4, 6  # switches of a double impact, of p1 and then of p2; side of a lateral slip
G_GAP, G_TURN, G_SLIP, G_HOLD = 0, 2, 4, 6  # its gauges
N_Z, N_G = 7, 8


@compiled
def pair_friction(law, switches, f_1, f_2, z):
    """Return the total axial friction and the lateral ones under the pressures f."""
    mode_1, mode_2, side = switches[MODES], switches[MODES + 1], switches[SIDE]
    hold = law.na * (f_1 - f_2) / law.aa
    if mode_1 == STICK and mode_2 == STICK:
        return hold, 0.0, 0.0
    if mode_1 == STICK:  # they share the axial velocity: the other end can slip only laterally
        L_2 = -law.mu * f_2 * side
        return hold, -law.bb_12 / law.bb * L_2, L_2
    if mode_2 == STICK:
        L_1 = -law.mu * f_1 * side
        return hold, L_1, -law.bb_12 / law.bb * L_1
    v_1, v_2 = speed(z[ZA], z[ZB1]), speed(z[ZA], z[ZB2])
    k_1 = law.mu * f_1 / v_1 if v_1 > 0.0 else 0.0
    k_2 = law.mu * f_2 / v_2 if v_2 > 0.0 else 0.0
    return -(k_1 + k_2) * z[ZA], -k_1 * z[ZB1], -k_2 * z[ZB2]


@compiled
def velocity_rates(law, switches, f_1, f_2, z, out):
    """Compute d/dtau of the contact velocities under the pressures f."""
    T, L_1, L_2 = pair_friction(law, switches, f_1, f_2, z)
    out[ZN1] = law.nn * f_1 + law.nn_12 * f_2 - law.na * T
    out[ZN2] = law.nn_12 * f_1 + law.nn * f_2 + law.na * T
    out[ZA] = law.na * (f_2 - f_1) + law.aa * T
    out[ZB1] = law.bb * L_1 + law.bb_12 * L_2
    out[ZB2] = law.bb_12 * L_1 + law.bb * L_2


@compiled
def slip_clock(law, switches, z):
    """Return dtau/dxi: the slip that comes to rest first, so that its end is regular; 1 where an end sticks."""
    if law.mu_s == 0.0 or switches[MODES] == STICK or switches[MODES + 1] == STICK:
        return 1.0
    v_1, v_2 = speed(z[ZA], z[ZB1]), speed(z[ZA], z[ZB2])
    if not switches[ACTS]:
        return v_2
    return v_1 * v_2 / (v_1 + v_2) if switches[ACTS + 1] else v_1


@compiled
def pressures(switches, X_1, X_2):
    """Return dP/dtau at the ends that act under these compressions."""
    f_1 = X_1 * sqrt(X_1) if switches[ACTS] and X_1 > 0.0 else 0.0
    return f_1, X_2 * sqrt(X_2) if switches[ACTS + 1] and X_2 > 0.0 else 0.0


@compiled
def pair_rates(law, switches, z, out):
    """Compute d/dxi of an impact at both ends."""
    f_1, f_2 = pressures(switches, z[ZX1], z[ZX2])
    velocity_rates(law, switches, f_1, f_2, z, out)
    clock = slip_clock(law, switches, z)
    for k in range(N_Z):
        out[k] *= clock
    for i in range(2):
        gain = law.gain if switches[RESTORES + i] else 1.0
        out[ZX1 + i] = -gain * z[ZN1 + i] * clock if switches[ACTS + i] else 0.0


@compiled
def pair_gauges(law, switches, z, out):
    """Compute for each end what is positive until its compression, restitution or rest off the plate, slip or hold is over.

    The slip of an end that acts alone ends in the axial direction, which is invariant; to follow its lateral part further
    would be stiff. In the place of a hold stands how far that part is from none.
    """
    f_1, f_2 = pressures(switches, z[ZX1], z[ZX2])
    T, L_1, L_2 = pair_friction(law, switches, f_1, f_2, z)
    total = f_1 + f_2
    both = switches[MODES] == STICK and switches[MODES + 1] == STICK
    for i in range(2):
        acts, restores, sticks = switches[ACTS + i] > 0.0, switches[RESTORES + i] > 0.0, switches[MODES + i] == STICK
        out[G_GAP + i] = -z[ZN1 + i] if acts and not restores else z[ZN1 + i]
        out[G_TURN + i] = z[ZX1 + i] if restores else 1.0
        out[G_SLIP + i] = out[G_HOLD + i] = 1.0
        if acts and not sticks and law.mu_s > 0.0:
            beside = switches[MODES + 1 - i] == STICK
            out[G_SLIP + i] = switches[SIDE] * z[ZB1 + i] if beside else excess(law, z[ZA], z[ZB1 + i])
            if not switches[ACTS + 1 - i]:
                out[G_HOLD + i] = axial_excess(law, z[ZB1 + i])
        if sticks and total > 0.0:
            f, L = (total, 0.0) if both else ((f_1, L_1) if i == 0 else (f_2, L_2))
            out[G_HOLD + i] = (law.mu_s * f - speed(T, L)) / total


@compiled
def outward(drive_a, drive_b, k_a, k_b):
    """Return the direction d of a slip from rest along its own acceleration: drive - (k_a d_a, k_b d_b) = lambda d."""
    low, high = 0.0, speed(drive_a, drive_b)
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        if speed(drive_a / (mid + k_a), drive_b / (mid + k_b)) > 1.0:
            low = mid
        else:
            high = mid
    d_a, d_b = drive_a / (high + k_a), drive_b / (high + k_b)
    size = speed(d_a, d_b)
    return d_a / size, d_b / size


@compiled
def hold_or_slip(law, switches, z, f_1, f_2, lost):
    """Set whether the ends at zero slip stick, or in which direction they set out."""
    switches[MODES] = switches[MODES + 1] = SLIP
    if law.mu_s == 0.0:
        return
    for i in range(2):
        if switches[ACTS + i] and not switches[ACTS + 1 - i] and abs(z[ZB1 + i]) <= AXIAL * law.slip_zero:
            z[ZB1 + i] = 0.0
    rest_1, rest_2 = speed(z[ZA], z[ZB1]) <= law.slip_zero, speed(z[ZA], z[ZB2]) <= law.slip_zero
    pull = law.na * (f_2 - f_1)
    if rest_1 and rest_2:
        z[ZA] = z[ZB1] = z[ZB2] = 0.0
        if not lost and abs(pull) <= law.mu_s * law.aa * (f_1 + f_2):
            switches[MODES] = switches[MODES + 1] = STICK
        else:
            z[ZA] = copysign(0.5 * law.slip_zero, pull)
        return
    i = 0 if rest_1 else 1
    f, f_j = (f_1, f_2) if rest_1 else (f_2, f_1)
    if not (rest_1 or rest_2) or f == 0.0:
        return
    switches[SIDE] = copysign(1.0, z[ZB2 - i])
    z[ZA] = z[ZB1 + i] = 0.0
    push = -law.bb_12 * law.mu * f_j * switches[SIDE]
    if not lost and speed(pull / law.aa, push / law.bb) <= law.mu_s * f:
        switches[MODES + i] = STICK
        return
    d_a, d_b = outward(pull, push, law.mu * f * law.aa, law.mu * f * law.bb)
    z[ZA], z[ZB1 + i] = 0.5 * law.slip_zero * d_a, 0.5 * law.slip_zero * d_b


@compiled
def turn(law, switches, z, space):
    """Do what follows from the gauges that have fallen to zero; return whether it was only a hold that was lost."""
    lost = True
    for i in range(2):
        acts, restores = switches[ACTS + i] > 0.0, switches[RESTORES + i] > 0.0
        if fired(G_GAP + i, law, space):
            z[ZN1 + i], lost = 0.0, False
            if acts:
                switches[RESTORES + i] = not restores
            else:
                switches[ACTS + i] = 1.0
        if restores and fired(G_TURN + i, law, space):
            z[ZX1 + i] = switches[ACTS + i] = switches[RESTORES + i] = 0.0
            lost = False
        if fired(G_SLIP + i, law, space):
            z[ZA], z[ZB1 + i], lost = 0.0, 0.0, False
        elif switches[MODES + i] == SLIP and fired(G_HOLD + i, law, space):
            z[ZB1 + i], lost = 0.0, False
    return lost


@compiled
def two_ends(law, space):
    """Carry the contact velocities of a dimer that lies flat, on the space, through an impact; return whether all went well."""
    z, switches = space[STATE], space[SWITCHES]
    switches[:] = FREE
    z[ZX1] = z[ZX2] = 0.0
    left = max(LEFT * law.tol, 1e-14)
    lost = False
    for _ in range(MAX_SWITCHES):
        for i in range(2):
            if not switches[ACTS + i] and z[ZN1 + i] < -left:
                switches[ACTS + i] = 1.0
        if not switches[ACTS] and not switches[ACTS + 1]:
            return True
        begun = z[ZX1] + z[ZX2] > 0.0  # else the pressures only begin their ratio now
        f_1, f_2 = pressures(switches, z[ZX1] if begun else -z[ZN1], z[ZX2] if begun else -z[ZN2])
        lowest = 1e-9 * max(f_1, f_2)  # an end that acts has some
        f_1, f_2 = max(f_1, lowest) if switches[ACTS] else 0.0, max(f_2, lowest) if switches[ACTS + 1] else 0.0
        hold_or_slip(law, switches, z, f_1, f_2, lost)
        velocity_rates(law, switches, f_1, f_2, z, space[VALUES])
        woken = False  # an end at rest on the plate that the other one presses down
        for i in range(2):
            if not switches[ACTS + i] and abs(z[ZN1 + i]) <= left and space[VALUES, ZN1 + i] < 0.0:
                switches[ACTS + i], z[ZN1 + i], woken = 1.0, 0.0, True
        if woken:
            continue
        if not march(pair_rates, pair_gauges, law, FIRST / slip_clock(law, switches, z), N_Z, N_G, space):
            return False
        lost = turn(law, switches, z, space)
    return False
