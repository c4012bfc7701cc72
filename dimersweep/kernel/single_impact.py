"""Impact at one end: the impulse ODE with the end's own normal impulse as time, and its closed forms.

With one contact acting, dP is the clock: n' = W_nn - mu W_na cos(phi), and the slip (v, phi) obeys

    v'     = W_na cos(phi) - mu (W_aa cos^2(phi) + W_bb sin^2(phi))
    v phi' = sin(phi) (mu (W_aa - W_bb) cos(phi) - W_na).

Sticking, absent friction and slip along an invariant direction (phi' = 0) make every rate constant: closed form. Between
them the clock xi with dP = v dxi removes the stiffness of the slip direction at small slip, and a Taylor expansion in xi
gives a leg and its events at once. Velocities are in units of the approach speed V, impulses of m V, energies of m V^2, the
Delassus operator of 1/m.
"""

from math import copysign, exp, inf, log, log1p, sqrt
from typing import NamedTuple

from dimersweep.kernel.jit import compiled
from dimersweep.kernel.law import length
from dimersweep.kernel.layout import SLIP, STICK

DONE, OTHER, LEG, JAM, STEPS = 0, 1, 2, 3, 4
MAX_LEGS = 200
MAX_STEPS = 2000
INVARIANT = 1e-14  # rate of turning (per xi) below which any slip direction counts as invariant
ATTRACTED = 1e-2  # effect on the rates, in tolerances, of what is left of the turning towards an attracting direction


LEAST_ORDER, ORDER = 6, 15  # of the expansion of a leg with a turning slip direction
CLOSE = 1e-8  # step of Newton's rule, in units of its place, after which it is done
ROUNDED = 1e-15  # error of a velocity, in units of itself, that no step improves
INVERSE = tuple(1.0 / (j + 1.0) for j in range(ORDER))
A_V, A_A, A_P, A_N, A_J, A_E = range(6)  # its rows: slip, axial slip, impulse, gap rates of both ends, energy


class EndLaw(NamedTuple):
    """What governs the impact at one end while nothing acts at the other."""

    nn: float  # Delassus operator of the end, in units of 1/m
    na: float
    aa: float
    bb: float
    nn_j: float  # gap rate of the other end per normal and per axial impulse here
    na_j: float
    both: float  # 1.0 if the other end is closed (and may be set in motion towards the plate), else 0.0
    e: float
    mu: float
    mu_s: float


@compiled
def sticks(law):
    """Whether the end holds where its slip has come to rest: |W_na| / W_aa <= mu_s."""
    return abs(law.na) <= law.mu_s * law.aa


@compiled
def turning(law, c, s):
    """dphi/dxi at the slip direction (c, s), and its derivative with respect to phi (negative: attracting)."""
    spread = law.mu * (law.aa - law.bb)
    return s * (spread * c - law.na), c * (spread * c - law.na) - spread * s * s


@compiled
def turns_away(law, c):
    """Whether a slip near zero along (c, s), with s != 0, only turns round there and grows again.

    Its direction tends to the way that W_na drives it, where it grows if |W_na| > mu W_aa, unless it is nearer to an
    attracting direction in which it dies out. At no tolerance does such a slip come to rest, be it small beyond measure.
    """
    drive = abs(law.na)
    return drive > law.mu * law.aa and drive > law.mu * (law.aa - law.bb) * copysign(c, c * law.na)


@compiled
def is_invariant(law, v, c, s, tol):
    """Whether slip along (c, s) keeps its direction: to rounding, or so near to an attracting one that the rates do.

    The axial directions (s = 0) change the rates only with s^2; how the lateral slip dies out is known (``lateral_left``).
    """
    rate, slope = turning(law, c, s)
    if abs(rate) <= INVARIANT:
        return True
    off = s * s if abs(s) < 1e-2 else abs(rate / slope)
    return slope < 0.0 and v * off <= ATTRACTED * tol


@compiled
def lateral_left(law, c, b, v, w_v, P):
    """Lateral slip near the axial direction c = +-1 after an impulse P over which the slip changes at the rate w_v.

    phi changes by the factor exp(slope xi), with xi the integral of dP / v.
    """
    _, slope = turning(law, c, 0.0)
    x = w_v * P / v
    xi = P / v * (log1p(x) / x if abs(x) > 1e-12 else 1.0)
    return b * (1.0 + x) * exp(slope * xi)


@compiled
def time_to_events(law, n, E, v, n_j, compressing, w, w_j, w_v):
    """Impulses after which, at constant rates, the leg ends: own rate zero, energy spent, other end turned, slip zero."""
    P_n = -n / w if (compressing and w > 0.0) or (not compressing and w < 0.0) else inf
    P_E = inf
    if not compressing:
        disc = n * n + 2.0 * w * law.e * law.e * E
        if disc >= 0.0:
            P_E = 2.0 * law.e * law.e * E / (n + sqrt(disc))
    P_j = -n_j / w_j if law.both > 0.0 and w_j < 0.0 else inf
    P_v = -v / w_v if w_v < 0.0 else inf
    return P_n, P_E, P_j, P_v


@compiled(fuse=True, inline=True)
def expand(law, n0, a, b, E, n_j0, gain, order, c):
    """Taylor coefficients of a leg in xi, up to xi**order, into the rows of c: A_V, A_A, A_P, A_N, A_J, A_E.

    With dP = v dxi both slips have linear laws, a' = W_na v - mu W_aa a and b' = -mu W_bb b, so that b is an exponential
    and v = sqrt(a^2 + b^2) the only function to expand.
    """
    c[A_A, 0], c[A_P, 0], c[A_N, 0], c[A_J, 0], c[A_E, 0] = a, 0.0, n0, n_j0, E
    v0 = length(a, b)
    inverse = 1.0 / v0
    fading = b * b  # coefficient of b^2
    for j in range(order):
        rest, work = 0.5 * fading + a * c[A_A, j], 0.0  # half the coefficient of v^2, less what is known of it
        for i in range(1, (j + 1) // 2):
            rest += c[A_A, i] * c[A_A, j - i] - c[A_V, i] * c[A_V, j - i]
        if j % 2 == 0:
            i = j // 2
            rest += 0.5 * (c[A_A, i] * c[A_A, i] - c[A_V, i] * c[A_V, i])
        c[A_V, j] = v0 if j == 0 else rest * inverse
        for i in range(j + 1):
            work += c[A_N, i] * c[A_V, j - i]
        k = INVERSE[j]
        fading *= -2.0 * law.mu * law.bb * k
        dP, dA = c[A_V, j] * k, -law.mu * c[A_A, j] * k
        c[A_A, j + 1] = law.na * dP + law.aa * dA
        c[A_P, j + 1] = dP
        c[A_N, j + 1] = law.nn * dP + law.na * dA
        c[A_J, j + 1] = law.nn_j * dP + law.na_j * dA
        c[A_E, j + 1] = -gain * work * k


@compiled(fuse=True)
def at(c, row, order, xi):
    """Value and slope of an expansion at xi."""
    value, slope = c[row, order], 0.0
    for j in range(order - 1, -1, -1):
        slope = slope * xi + value
        value = value * xi + c[row, j]
    return value, slope


@compiled
def reach(c, order, v, tol):
    """Step over which the last terms of the expansions stay below the tolerance, and well inside their convergence."""
    small = max(0.1 * min(tol, 0.01 * v), ROUNDED * max(v, abs(c[A_N, 0])))
    energy = 1.0 / max(1.0, sqrt(c[A_E, 0]))  # an energy counts by the rate that it gives
    least = inf
    for j in range(order - 1, order + 1):
        size = max(abs(c[A_A, j]), max(abs(c[A_P, j]), max(abs(c[A_N, j]), energy * abs(c[A_E, j]))))
        if size > 0.0:
            least = min(least, (small / size) ** (1.0 / j))
    return least


@compiled
def parabola_zero(c0, c1, c2):
    """First zero of c0 + c1 x + c2 x^2 at x > 0, from c0 > 0; inf if there is none."""
    disc = c1 * c1 - 4.0 * c0 * c2
    if disc < 0.0:
        return inf
    below = sqrt(disc) - c1
    return 2.0 * c0 / below if below > 0.0 else inf


@compiled(fuse=True)
def first_zero(c, row, order, sign, h):
    """First zero in (0, h] of an expansion, of the given sign before, whose slope changes sign at most once; else inf.

    Bracketed Newton steps from the zero of the first three terms: a fast slip has its events at a tiny part of the interval.
    A dip below zero between positive ends is looked for at the bottom of it.
    """
    low, high = 0.0, h
    end, slope_end = at(c, row, order, h)
    if sign * end > 0.0:
        if sign * c[row, 1] >= 0.0 or sign * slope_end <= 0.0:
            return inf
        for _ in range(60):
            mid = 0.5 * (low + high)
            value, slope = at(c, row, order, mid)
            if sign * value <= 0.0:
                high = mid
                break
            low, high = (mid, high) if sign * slope < 0.0 else (low, mid)
        else:
            return inf
        low = 0.0
    x = parabola_zero(sign * c[row, 0], sign * c[row, 1], sign * c[row, 2])
    if not 0.0 < x < high:
        x = high
    for _ in range(100):
        value, slope = at(c, row, order, x)
        low, high = (x, high) if sign * value > 0.0 else (low, x)
        new = x - value / slope if slope != 0.0 else high
        if not low <= new <= high:
            new = 0.5 * (low + high)
        x, step = new, new - x
        if abs(step) <= CLOSE * x:  # the next step of Newton's rule would be below round-off
            break
    return x


@compiled
def turning_leg(law, n0, a, b, E, n_j0, compressing, tol, work):
    """One leg with a turning slip direction, up to its first event or until the direction has become invariant.

    Returns
    -------
    n, a, b, E, n_j, P, A, B : float
        Velocities, energy and other gap rate after the leg; normal, axial, lateral impulse of it.
    reason : int
        LEG (go on with the next leg) or STEPS.
    """
    gain = 1.0 if compressing else 1.0 / (law.e * law.e)
    order = min(ORDER, max(LEAST_ORDER, int(8.0 - 0.6 * log(tol))))  # the least work for a step of this accuracy
    slip_end, lateral = max(tol, 1e-14 * length(a, b)), abs(b) > tol
    n, n_j, P, A, B = n0, n_j0, 0.0, 0.0, 0.0
    for _ in range(MAX_STEPS):
        v = length(a, b)
        expand(law, n, a, b, E, n_j, gain, order, work)
        h = reach(work, order, v, tol)
        xi_n = first_zero(work, A_N, order, -1.0 if compressing else 1.0, h)
        xi_E = inf if compressing else first_zero(work, A_E, order, 1.0, h)
        xi_j = first_zero(work, A_J, order, 1.0, h) if law.both > 0.0 else inf
        xi = min(min(xi_n, xi_E), min(xi_j, h))
        a_old, b_old = a, b
        a, _ = at(work, A_A, order, xi)
        b = b * exp(-law.mu * law.bb * xi)
        dP, _ = at(work, A_P, order, xi)
        n, _ = at(work, A_N, order, xi)
        E, _ = at(work, A_E, order, xi)
        n_j, _ = at(work, A_J, order, xi)
        P, A, B = P + dP, A + (a - a_old - law.na * dP) / law.aa, B + (b - b_old) / law.bb
        v = length(a, b)
        ended = xi == xi_n or xi == xi_E or xi == xi_j
        stopped = v <= slip_end
        if ended or stopped or is_invariant(law, v, a / v, b / v, tol):
            n = 0.0 if xi == xi_n else n
            E = 0.0 if xi == xi_E else E
            n_j = 0.0 if xi == xi_j else n_j
            if stopped:
                a, b = copysign(2.0 * slip_end, law.na) if lateral and turns_away(law, a / v) else 0.0, 0.0
            return n, a, b, E, n_j, P, A, B, LEG
    return n, a, b, E, n_j, P, A, B, STEPS


@compiled
def straight_leg(law, n, a, b, E, n_j, compressing, stick, c, s):
    """One leg at constant rates: sticking (stick), or slipping along the direction (c, s); closed form."""
    if stick:
        t_a, t_b = -law.na / law.aa, 0.0
        w_a, w_b, w_v = 0.0, 0.0, 0.0
    else:
        t_a, t_b = -law.mu * c, -law.mu * s
        w_a, w_b = law.na + law.aa * t_a, law.bb * t_b
        w_v = w_a * c + w_b * s if law.mu > 0.0 else 0.0
    v = length(a, b)
    b0 = b
    w, w_j = law.nn + law.na * t_a, law.nn_j + law.na_j * t_a
    P_n, P_E, P_j, P_v = time_to_events(law, n, E, v, n_j, compressing, w, w_j, w_v)
    P = min(min(P_n, P_E), min(P_j, P_v))
    if inf == P:
        return n, a, b, E, n_j, 0.0, 0.0, 0.0, JAM
    gain = 1.0 if compressing else 1.0 / max(law.e * law.e, 1e-300)
    E = 0.0 if P == P_E else max(0.0, E - gain * P * (n + 0.5 * w * P))
    n = 0.0 if P_n == P else n + w * P
    n_j = 0.0 if P_j == P else n_j + w_j * P
    if P_v == P:
        a, b = 0.0, 0.0
    elif not stick:
        a = a + w_a * P
        b = lateral_left(law, c, b, v, w_v, P) if s == 0.0 and b != 0.0 and law.mu > 0.0 else b + w_b * P
    return n, a, b, E, n_j, P, t_a * P, (b - b0) / law.bb, LEG


@compiled
def single_phase(law, n, a, b, E, n_j, tol, work):
    """Run the impact at one end until its energy is spent or the other closed end begins to be compressed.

    Parameters
    ----------
    law : EndLaw
    n, a, b : float
        Gap rate, axial and lateral velocity of the end [V].
    E : float
        Elastic energy stored at the end [m V^2].
    n_j : float
        Gap rate of the other end [V].
    tol : float
        Error per unit of velocity, and the slip that counts as none.
    work : float64 array, at least (6, ORDER + 1)

    Returns
    -------
    n, a, b, E, n_j, P, A, B : float
        After the phase; impulses of it.
    P_s, A_s : float
        Of these, what was given before the end stuck (all of it if it slips to the end): an impact at one end does not
        slip again once it sticks.
    mode : int
        STICK or SLIP, the friction mode in which the phase ended.
    reason : int
        DONE, OTHER, JAM or STEPS.
    """
    P, A, B, P_s, A_s = 0.0, 0.0, 0.0, 0.0, 0.0
    compressing = n < 0.0 or E == 0.0
    mode = SLIP
    for _ in range(MAX_LEGS):
        if not compressing and (E <= 0.0 or law.e == 0.0):
            return n, a, b, 0.0, n_j, P, A, B, P_s, A_s, mode, DONE
        v = length(a, b)
        stick, turns, c, s = False, False, 1.0, 0.0
        if law.mu == 0.0 and (v > tol or not sticks(law)):
            mode = SLIP  # no friction: the direction is of no consequence
        elif v <= tol:
            a, b, v = 0.0, 0.0, 0.0
            stick = sticks(law)
            mode = STICK if stick else SLIP
            c = 1.0 if law.na > 0.0 else -1.0  # the self-consistent direction of slip out of rest
        else:
            mode = SLIP
            c, s = a / v, b / v
            turns = not is_invariant(law, v, c, s, tol)
            if not turns and abs(s) < 1e-2:
                c, s = copysign(1.0, a), 0.0
        w_j = law.nn_j + law.na_j * (-law.na / law.aa if stick else -law.mu * c)
        if turns:
            n, a, b, E, n_j, dP, dA, dB, reason = turning_leg(law, n, a, b, E, n_j, compressing, tol, work)
        else:
            n, a, b, E, n_j, dP, dA, dB, reason = straight_leg(law, n, a, b, E, n_j, compressing, stick, c, s)
        P, A, B = P + dP, A + dA, B + dB
        if not stick:
            P_s, A_s = P, A
        if reason != LEG:
            return n, a, b, E, n_j, P, A, B, P_s, A_s, mode, reason
        if n == 0.0:
            compressing = not compressing
        if law.both > 0.0 and n_j == 0.0 and (turns or w_j < 0.0):
            return n, a, b, E, n_j, P, A, B, P_s, A_s, mode, OTHER
    return n, a, b, E, n_j, P, A, B, P_s, A_s, mode, STEPS
