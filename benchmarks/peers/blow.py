"""The impact law as a user of heyoka would compile it: (6)-(7) of the paper in the regular form dP_i = X_i^(3/2) dtau.

Velocities are in units of the approach speed, impulses in units of mass times that. An impact at one end is closed form
where it sticks, slips in a constant direction or has no friction; else its slip is integrated in the clock dP = v dxi, in
which it is regular where the slip ends. Two ends at once are integrated in tau, from switch to switch. The integrator is
DOP853 with the coefficients of scipy; a switch is located by repeating the step that passes it with other
lengths, guessed from the values and slopes of what falls to zero there.
"""

from math import copysign, inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

compiled = njit(error_model="numpy", nogil=True)  # not cached: functions are arguments here

A, B, E3, E5 = (np.ascontiguousarray(each) for each in (DOP853.A, DOP853.B, DOP853.E3, DOP853.E5))
STAGES = B.size
# rows of the space, after the slopes
ARG, OUT, VALUES, ARMED, STATE, SWITCHES, RATES, FALLS, LOW, LOW_FALLS = range(STAGES, STAGES + 10)
DESK = STAGES + 10, 8
MAX_STEPS, MAX_PROBES, MAX_SWITCHES = 20_000, 60, 400
NONE, STICK, SLIP = 0, 1, 2
DONE, LOST_WAY = 0, 1
NEAR, NEAREST = 1e-3, 1e-15  # how near to zero a switch is located: in tolerances, and at best
SLIGHT = 1e-7  # part of a step over which the slope of a gauge is taken
FIRST = 0.05  # first step of a double impact in tau; it lasts about 3
AXIAL = 10.0  # lateral part of a slip that is none, in units of the slip that is none
LEFT = 1e-3  # gap rate, in tolerances, that is none

AA, AB, AN, AE = range(4)  # of the slip of one end: axial and lateral slip, gap rate, stored energy
# of two ends: gap rates, compressions, the axial slip they share, lateral ones
ZN1, ZN2, ZX1, ZX2, ZA, ZB1, ZB2 = range(7)


class End(NamedTuple):
    """What an impulse at one end does to its own contact velocity, and the law there."""

    nn: float
    na: float
    aa: float
    bb: float
    gain: float  # of the energy that is given back: 1/e^2
    mu: float
    mu_s: float


class Pair(NamedTuple):
    """What impulses at both ends of a dimer that lies flat do to the contact velocities, and the law there."""

    nn: float
    nn_12: float
    na: float  # axial velocity per normal impulse at p2; at p1 it is the opposite
    aa: float
    bb: float
    bb_12: float
    gain_1: float
    gain_2: float
    mu: float
    mu_s: float


@compiled
def speed(a, b):
    """Size of a velocity."""
    return sqrt(a * a + b * b)


@compiled
def step(rates, law, switches, z, h, n, tol, space):
    """One step of DOP853 from z, whose slopes stand on the space, to the space; returns its error over the tolerance."""
    arg, out = space[ARG], space[OUT]
    for i in range(1, STAGES):
        for k in range(n):
            arg[k] = z[k]
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
        out[k] = z[k] + h * total
        sum5 += e5 * e5
        sum3 += e3 * e3
    if sum5 == 0.0:
        return 0.0
    return h * sum5 / sqrt((sum5 + 0.01 * sum3) * n) / tol


@compiled
def least(gauges, law, switches, z, slip_zero, n, space):
    """The least of the gauges that were positive at the start of the step, and its number; their values into the space."""
    values, armed = space[VALUES], space[ARMED]
    gauges(law, switches, z, slip_zero, values)
    lowest, which = inf, 0
    for k in range(n):
        if armed[k] and values[k] < lowest:
            lowest, which = values[k], k
    return lowest, which


@compiled
def near(tol):
    """What is zero for a gauge."""
    return max(NEAREST, NEAR * tol)


@compiled
def slopes(rates, gauges, law, switches, z, h, n, n_g, slip_zero, values, falls, space):
    """Slopes of the gauges at z, where they have these values, by a difference over a slight part of the step h."""
    rates(law, switches, z, space[RATES])
    for k in range(n):
        space[ARG, k] = z[k] + SLIGHT * h * space[RATES, k]
    gauges(law, switches, space[ARG], slip_zero, falls)
    for k in range(n_g):
        falls[k] = (falls[k] - values[k]) / (SLIGHT * h)


@compiled
def zero_between(low, high, g_low, g_high, s_low, s_high):
    """Where a falling gauge is zero, by the inverse cubic through values and slopes; if it is level at first, by Newton."""
    if s_low < 0.0 and s_high < 0.0:
        rise = g_high - g_low
        u = -g_low / rise
        v = 1.0 - u
        return v * v * ((1.0 + 2.0 * u) * low + u * rise / s_low) + u * u * ((3.0 - 2.0 * u) * high - v * rise / s_high)
    return high - g_high / s_high if s_high < 0.0 else inf


@compiled
def locate(rates, gauges, law, switches, z, h, n, n_g, tol, slip_zero, space):
    """The state at the shortest step, up to h, at which a gauge falls to zero, into the space."""
    out, values, falls, low_values, low_falls = space[OUT], space[VALUES], space[FALLS], space[LOW], space[LOW_FALLS]
    low, high = 0.0, h
    gauges(law, switches, z, slip_zero, low_values)
    slopes(rates, gauges, law, switches, z, h, n, n_g, slip_zero, low_values, low_falls, space)
    g_high, which = least(gauges, law, switches, out, slip_zero, n_g, space)
    slopes(rates, gauges, law, switches, out, h, n, n_g, slip_zero, values, falls, space)
    s_high = falls[which]
    for probe in range(MAX_PROBES):
        mid = zero_between(low, high, low_values[which], g_high, low_falls[which], s_high)
        if not low < mid < high or probe % 4 == 3:
            mid = 0.5 * (low + high)
        step(rates, law, switches, z, mid, n, 1.0, space)
        g, k = least(gauges, law, switches, out, slip_zero, n_g, space)
        if abs(g) <= near(tol) or high - low <= NEAREST * high:
            break
        slopes(rates, gauges, law, switches, out, h, n, n_g, slip_zero, values, falls, space)
        if g > 0.0:
            low = mid
            for i in range(n_g):
                low_values[i], low_falls[i] = values[i], falls[i]
        else:
            high, g_high, which, s_high = mid, g, k, falls[k]


@compiled
def strays(n_g, space):
    """Whether a gauge of normal motion that began at zero goes below it: then it falls with this step, whose dip was tiny."""
    values, armed = space[VALUES], space[ARMED]
    found = False
    for k in range(n_g // 2):
        if not armed[k] and values[k] < 0.0:
            armed[k], found = 1.0, True
    return found


@compiled
def march(rates, gauges, law, switches, z, h, n, n_g, tol, slip_zero, space):
    """Integrate z until a gauge that has been positive falls to zero; whether one did. The gauges stand on the space."""
    out, values, armed = space[OUT], space[VALUES], space[ARMED]
    for _ in range(MAX_STEPS):
        rates(law, switches, z, space[0])
        error = step(rates, law, switches, z, h, n, tol, space)
        factor = 0.9 * error ** (-1.0 / 8.0) if error > 0.0 else 5.0
        if not error <= 1.0:
            h *= max(0.1, factor) if error < inf else 0.1
            continue
        gauges(law, switches, z, slip_zero, values)
        for k in range(n_g):
            armed[k] = values[k] > 0.0
        fell = least(gauges, law, switches, out, slip_zero, n_g, space)[0] <= 0.0
        strayed = not fell and strays(n_g, space)
        if fell:
            locate(rates, gauges, law, switches, z, h, n, n_g, tol, slip_zero, space)
        for k in range(n):
            z[k] = out[k]
        if fell or strayed:
            return True
        h *= min(5.0, factor)
    return False


@compiled
def fired(k, tol, space):
    """Whether gauge k has fallen to zero at the end of a march."""
    return space[ARMED, k] > 0.0 and space[VALUES, k] <= near(tol)


@compiled
def excess(a, b, slip_zero):
    """How far a slip is from the one that counts as none: a logarithm, since it falls exponentially in xi."""
    return 1e-3 * log((a * a + b * b) / slip_zero**2)


@compiled
def slip_rates(law, restoring, y, out):
    """d/dxi of the slip of one end, its gap rate and its stored energy."""
    v = speed(y[AA], y[AB])
    out[AA] = law.na * v - law.mu * law.aa * y[AA]
    out[AB] = -law.mu * law.bb * y[AB]
    out[AN] = law.nn * v - law.mu * law.na * y[AA]
    out[AE] = -(law.gain if restoring[0] else 1.0) * y[AN] * v


@compiled
def slip_gauges(law, restoring, y, slip_zero, out):
    """Positive until compression or restitution ends, until the slip does, and until it is axial."""
    out[0] = y[AE] if restoring[0] else -y[AN]
    out[2] = excess(y[AB], 0.0, AXIAL * slip_zero) if y[AB] != 0.0 else 1.0
    out[1] = excess(y[AA], y[AB], slip_zero)


@compiled
def with_constant_rates(law, n, rate, E, restoring):
    """Normal impulse and gap rate at the end of an impact whose gap rate grows by `rate` per impulse."""
    P = 0.0
    if not restoring:
        P, E, n = -n / rate, E + 0.5 * n * n / rate, 0.0
    after = sqrt(n * n + 2.0 * rate * E / law.gain)
    return P + (after - n) / rate, after


@compiled
def one_end(law, n, a, b, slip_zero, tol, space):
    """Gap rate, axial and lateral slip after an impact at one end.

    Returns
    -------
    status, n, a, b
    """
    y, restoring = space[STATE], space[SWITCHES]
    y[AA], y[AB], y[AN], y[AE] = a, b, n, 0.0
    restoring[0] = 0.0
    if law.mu_s == 0.0:
        P, n = with_constant_rates(law, n, law.nn, 0.0, False)
        return DONE, n, a + law.na * P, b
    if tol * speed(a, b) >= 1.0:  # the direction of the slip hardly turns
        c, d = a / speed(a, b), b / speed(a, b)
        P, n = with_constant_rates(law, n, law.nn - law.mu * law.na * c, 0.0, False)
        return DONE, n, a + (law.na - law.mu * law.aa * c) * P, b - law.mu * law.bb * d * P
    while speed(y[AA], y[AB]) > slip_zero:
        y[AB] = 0.0 if abs(y[AB]) <= AXIAL * slip_zero else y[AB]
        v = speed(y[AA], y[AB])
        if v <= slip_zero:
            break
        rate = max(law.nn * v - law.mu * law.na * y[AA], 1e-3 * v)
        h = sqrt(2.0 * y[AE] / (law.gain * rate * v)) if restoring[0] else -y[AN] / rate
        if not march(slip_rates, slip_gauges, law, restoring, y, 1.001 * h, 4, 3, tol, slip_zero, space):
            return LOST_WAY, n, a, b
        if fired(1, tol, space):
            break
        if fired(2, tol, space):
            y[AB] = 0.0
        if not fired(0, tol, space):
            continue
        if restoring[0] or law.gain == inf:
            return DONE, max(0.0, y[AN]), y[AA], y[AB]
        y[AN], restoring[0] = 0.0, 1.0
    if abs(law.na) <= law.mu_s * law.aa:
        _, n = with_constant_rates(law, y[AN], law.nn - law.na**2 / law.aa, y[AE], restoring[0] > 0.0)
        return DONE, n, 0.0, 0.0
    side = copysign(1.0, law.na)
    P, n = with_constant_rates(law, y[AN], law.nn - law.mu * law.na * side, y[AE], restoring[0] > 0.0)
    return DONE, n, (law.na - law.mu * law.aa * side) * P, 0.0


@compiled
def pressure(X):
    """dP/dtau."""
    return X * sqrt(X) if X > 0.0 else 0.0


MODES, ACTS, RESTORES, SIDE = 0, 2, 4, 6  # switches of a double impact, of p1 and then of p2; side of a lateral slip
G_GAP, G_TURN, G_SLIP, G_HOLD = 0, 2, 4, 6  # its gauges
N_Z, N_G = 7, 8


@compiled
def pair_friction(law, switches, f_1, f_2, z):
    """Total axial friction and the lateral ones under the pressures f."""
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
    """d/dtau of the contact velocities under the pressures f."""
    T, L_1, L_2 = pair_friction(law, switches, f_1, f_2, z)
    out[ZN1] = law.nn * f_1 + law.nn_12 * f_2 - law.na * T
    out[ZN2] = law.nn_12 * f_1 + law.nn * f_2 + law.na * T
    out[ZA] = law.na * (f_2 - f_1) + law.aa * T
    out[ZB1] = law.bb * L_1 + law.bb_12 * L_2
    out[ZB2] = law.bb_12 * L_1 + law.bb * L_2


@compiled
def slip_clock(law, switches, z):
    """dtau/dxi: the slip that comes to rest first, so that its end is regular; 1 where an end sticks."""
    if law.mu_s == 0.0 or switches[MODES] == STICK or switches[MODES + 1] == STICK:
        return 1.0
    v_1, v_2 = speed(z[ZA], z[ZB1]), speed(z[ZA], z[ZB2])
    if not switches[ACTS]:
        return v_2
    return v_1 * v_2 / (v_1 + v_2) if switches[ACTS + 1] else v_1


@compiled
def pair_rates(law, switches, z, out):
    """d/dxi of an impact at both ends."""
    f_1 = pressure(z[ZX1]) if switches[ACTS] else 0.0
    f_2 = pressure(z[ZX2]) if switches[ACTS + 1] else 0.0
    velocity_rates(law, switches, f_1, f_2, z, out)
    clock = slip_clock(law, switches, z)
    for k in range(N_Z):
        out[k] *= clock
    for i in range(2):
        gain = (law.gain_1 if i == 0 else law.gain_2) if switches[RESTORES + i] else 1.0
        out[ZX1 + i] = -gain * z[ZN1 + i] * clock if switches[ACTS + i] else 0.0


@compiled
def pair_gauges(law, switches, z, slip_zero, out):
    """For each end: positive until its compression, restitution or rest off the plate is over, and while slip or hold lasts.

    The slip of an end that acts alone ends in the axial direction, which is invariant; to follow its lateral part further
    would be stiff. In the place of a hold stands how far that part is from none.
    """
    f_1 = pressure(z[ZX1]) if switches[ACTS] else 0.0
    f_2 = pressure(z[ZX2]) if switches[ACTS + 1] else 0.0
    T, L_1, L_2 = pair_friction(law, switches, f_1, f_2, z)
    total = f_1 + f_2
    both = switches[MODES] == STICK and switches[MODES + 1] == STICK
    for i in range(2):
        acts, restores = switches[ACTS + i] > 0.0, switches[RESTORES + i] > 0.0
        out[G_GAP + i] = -z[ZN1 + i] if acts and not restores else z[ZN1 + i]
        out[G_TURN + i] = z[ZX1 + i] if restores else 1.0
        sticks = switches[MODES + i] == STICK
        out[G_SLIP + i] = 1.0
        if acts and not sticks and law.mu_s > 0.0:
            beside = switches[MODES + 1 - i] == STICK
            out[G_SLIP + i] = switches[SIDE] * z[ZB1 + i] if beside else excess(z[ZA], z[ZB1 + i], slip_zero)
        out[G_HOLD + i] = 1.0
        if acts and not sticks and not switches[ACTS + 1 - i] and z[ZB1 + i] != 0.0 and law.mu_s > 0.0:
            out[G_HOLD + i] = excess(z[ZB1 + i], 0.0, AXIAL * slip_zero)
        if sticks and total > 0.0:
            f, L = (total, 0.0) if both else ((f_1, L_1) if i == 0 else (f_2, L_2))
            out[G_HOLD + i] = (law.mu_s * f - speed(T, L)) / total


@compiled
def outward(drive_a, drive_b, k_a, k_b):
    """Direction d of a slip from rest along its own acceleration: drive - (k_a d_a, k_b d_b) = lambda d."""
    low, high = 0.0, speed(drive_a, drive_b)
    for _ in range(MAX_PROBES):
        mid = 0.5 * (low + high)
        if speed(drive_a / (mid + k_a), drive_b / (mid + k_b)) > 1.0:
            low = mid
        else:
            high = mid
    d_a, d_b = drive_a / (high + k_a), drive_b / (high + k_b)
    size = speed(d_a, d_b)
    return d_a / size, d_b / size


@compiled
def straighten(switches, z, slip_zero):
    """Make the slip of an end that acts alone axial if it nearly is."""
    if switches[ACTS] + switches[ACTS + 1] == 1.0:
        i = 0 if switches[ACTS] else 1
        z[ZB1 + i] = 0.0 if abs(z[ZB1 + i]) <= AXIAL * slip_zero else z[ZB1 + i]


@compiled
def hold_or_slip(law, switches, z, f_1, f_2, slip_zero, lost):
    """Whether the ends at zero slip stick, or in which direction they set out."""
    switches[MODES] = switches[MODES + 1] = SLIP
    if law.mu_s == 0.0:
        return
    straighten(switches, z, slip_zero)
    rest_1, rest_2 = speed(z[ZA], z[ZB1]) <= slip_zero, speed(z[ZA], z[ZB2]) <= slip_zero
    pull = law.na * (f_2 - f_1)
    if rest_1 and rest_2:
        z[ZA] = z[ZB1] = z[ZB2] = 0.0
        if not lost and abs(pull) <= law.mu_s * law.aa * (f_1 + f_2):
            switches[MODES] = switches[MODES + 1] = STICK
        else:
            z[ZA] = copysign(0.5 * slip_zero, pull)
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
    z[ZA], z[ZB1 + i] = 0.5 * slip_zero * d_a, 0.5 * slip_zero * d_b


@compiled
def pressures(switches, z):
    """The pressures, or where all only begin their ratio then; an end that acts has some."""
    f_1 = pressure(z[ZX1]) if z[ZX1] + z[ZX2] > 0.0 else pressure(-z[ZN1])
    f_2 = pressure(z[ZX2]) if z[ZX1] + z[ZX2] > 0.0 else pressure(-z[ZN2])
    least = 1e-9 * max(f_1, f_2)
    return max(f_1, least) if switches[ACTS] else 0.0, max(f_2, least) if switches[ACTS + 1] else 0.0


@compiled
def wake(law, switches, z, f_1, f_2, left, rates):
    """An end at rest on the plate that the other one presses down begins to be compressed; whether one does."""
    velocity_rates(law, switches, f_1, f_2, z, rates)
    woken = False
    for i in range(2):
        if not switches[ACTS + i] and abs(z[ZN1 + i]) <= left and rates[ZN1 + i] < 0.0:
            switches[ACTS + i], woken = 1.0, True
            z[ZN1 + i] = 0.0
    return woken


@compiled
def turn(law, switches, z, tol, space):
    """What follows from the gauges that have fallen to zero; whether it was only a hold that was lost."""
    lost = True
    for i in range(2):
        acts, restores = switches[ACTS + i] > 0.0, switches[RESTORES + i] > 0.0
        if fired(G_GAP + i, tol, space):
            z[ZN1 + i], lost = 0.0, False
            if acts:
                switches[RESTORES + i] = not restores
                if not restores and (law.gain_1 if i == 0 else law.gain_2) == inf:
                    z[ZX1 + i] = switches[ACTS + i] = switches[RESTORES + i] = 0.0
            else:
                switches[ACTS + i] = 1.0
        if restores and fired(G_TURN + i, tol, space):
            z[ZX1 + i] = switches[ACTS + i] = switches[RESTORES + i] = 0.0
            lost = False
        if fired(G_SLIP + i, tol, space):
            z[ZA] = z[ZB1 + i] = 0.0
            lost = False
        elif switches[MODES + i] == SLIP and fired(G_HOLD + i, tol, space):
            z[ZB1 + i], lost = 0.0, False
    return lost


@compiled
def two_ends(law, z, slip_zero, tol, space):
    """Carry the contact velocities z of a dimer that lies flat through an impact; returns the status."""
    switches = space[SWITCHES]
    for k in range(6):
        switches[k] = 0.0
    z[ZX1] = z[ZX2] = 0.0
    left = max(LEFT * tol, 1e-14)
    lost = False
    for _ in range(MAX_SWITCHES):
        for i in range(2):
            if not switches[ACTS + i] and z[ZN1 + i] < -left:
                switches[ACTS + i] = 1.0
        f_1, f_2 = pressures(switches, z)
        hold_or_slip(law, switches, z, f_1, f_2, slip_zero, lost)
        if wake(law, switches, z, f_1, f_2, left, space[RATES]):
            f_1, f_2 = pressures(switches, z)
            hold_or_slip(law, switches, z, f_1, f_2, slip_zero, lost)
        if not switches[ACTS] and not switches[ACTS + 1]:
            return DONE
        h = FIRST / slip_clock(law, switches, z)
        if not march(pair_rates, pair_gauges, law, switches, z, h, N_Z, N_G, tol, slip_zero, space):
            return LOST_WAY
        lost = turn(law, switches, z, tol, space)
    return LOST_WAY
