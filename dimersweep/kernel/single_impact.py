"""Impact at one end: the impulse ODE with the end's own normal impulse as time, and its closed forms.

With one contact acting, dP is the clock: n' = W_nn - mu W_na cos(phi), and the slip (v, phi) obeys

    v'     = W_na cos(phi) - mu (W_aa cos^2(phi) + W_bb sin^2(phi))
    v phi' = sin(phi) (mu (W_aa - W_bb) cos(phi) - W_na).

Sticking, absent friction and slip along an invariant direction (phi' = 0) make every rate constant: closed form. Between
them the clock xi with dP = v dxi removes the stiffness of the slip direction at small slip. Velocities are in units of the
approach speed V, impulses of m V, energies of m V^2, the Delassus operator of 1/m.
"""

from math import atan2, copysign, cos, exp, hypot, inf, log1p, sin, sqrt
from typing import NamedTuple

from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import SLIP, STICK
from dimersweep.kernel.steps import DOP_STAGES, copy, explicit_method, step_factor

DONE, OTHER, LEG, JAM, STEPS = 0, 1, 2, 3, 4
MAX_LEGS = 200
MAX_STEPS = 2000
INVARIANT = 1e-14  # rate of turning (per xi) below which any slip direction counts as invariant
ATTRACTED = 1e-2  # effect on the rates, in tolerances, of what is left of the turning towards an attracting direction


N_LEG = 5
impact_stage, impact_finish = explicit_method(N_LEG)


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


@compiled
def slopes(law, y, n0, gain, out):
    """d/dxi of y = (phi, v, P, A, E), A the axial impulse; `gain` is 1 in compression, 1/e^2 in restitution.

    Returns
    -------
    n, w, w_j : float
        Own gap rate at y (n0 at the start of the leg), and what an impulse adds to it and to the other end's.
    """
    c, s = cos(y[0]), sin(y[0])
    n = n0 + law.nn * y[2] + law.na * y[3]
    out[0], _ = turning(law, c, s)
    out[1] = y[1] * (law.na * c - law.mu * (law.aa * c * c + law.bb * s * s))
    out[2] = y[1]
    out[3] = -law.mu * c * y[1]
    out[4] = -gain * n * y[1]
    return n, law.nn - law.mu * law.na * c, law.nn_j - law.mu * law.na_j * c


@compiled
def short_step(law, y, n0, gain, xi, K, out):
    """Classical Runge-Kutta step in place, for the last corrections of an event; K[0] holds the slopes at y."""
    for i in range(1, 4):
        part = xi if i == 3 else 0.5 * xi
        for k in range(N_LEG):
            out[k] = y[k] + part * K[i - 1, k]
        slopes(law, out, n0, gain, K[i])
    for k in range(N_LEG):
        y[k] += xi / 6.0 * (K[0, k] + 2.0 * (K[1, k] + K[2, k]) + K[3, k])


@compiled
def turning_leg(law, n0, a, b, E, n_j0, compressing, tol, work):
    """One leg with a turning slip direction, up to its first event or until the direction has become invariant.

    Events are approached by Newton steps of the method itself: the slopes are smooth beyond them.

    Returns
    -------
    n, a, b, E, n_j, P, A, B : float
        Velocities, energy and other gap rate after the leg; normal, axial, lateral impulse of it.
    reason : int
        LEG (go on with the next leg) or STEPS.
    """
    y, out, scale, K = work[0], work[1], work[2], work[4 : 4 + DOP_STAGES]
    y[0], y[1], y[2], y[3], y[4] = atan2(b, a), hypot(a, b), 0.0, 0.0, E
    gain = 1.0 if compressing else 1.0 / (law.e * law.e)
    slip_end = max(tol, 1e-14 * y[1])
    short = (10.0 * tol) ** 0.2 / max(1.0, y[1])  # the classical method is then good enough
    limit = inf
    for _ in range(MAX_STEPS):
        n, w, w_j = slopes(law, y, n0, gain, K[0])
        n_j = n_j0 + law.nn_j * y[2] + law.na_j * y[3]
        P_n, P_E, P_j, _ = time_to_events(law, n, y[4], y[1], n_j, compressing, w, w_j, 0.0)
        dP = min(P_n, min(P_E, P_j))
        c, s = cos(y[0]), sin(y[0])
        near = abs(dP) <= 2e-15 * max(1.0, abs(y[2]))
        if near or (dP > 0.0 and (y[1] <= slip_end or is_invariant(law, y[1], c, s, tol))):
            n = 0.0 if near and dP == P_n else n
            E = 0.0 if near and dP == P_E else y[4]
            n_j = 0.0 if near and dP == P_j else n_j
            a_plus, b_plus = y[1] * c, y[1] * s
            B = (b_plus - b) / law.bb
            if y[1] <= slip_end:
                a_plus, b_plus = 0.0, 0.0
            return n, a_plus, b_plus, E, n_j, y[2], y[3], B, LEG
        _, slope = turning(law, c, s)
        xi = min(dP / y[1], limit, 3.0 / (abs(slope) + abs(K[0, 1] / y[1])))
        if abs(xi) * (abs(slope) + abs(K[0, 1] / y[1])) <= short:
            short_step(law, y, n0, gain, xi, K, out)
            continue
        scale[0], scale[1], scale[2], scale[3], scale[4] = tol / max(1.0, y[1]), tol, tol, tol, tol
        for i in range(1, DOP_STAGES):
            impact_stage(i, xi, y, K, N_LEG, out)
            slopes(law, out, n0, gain, K[i])
        error = impact_finish(xi, y, K, N_LEG, scale, out)
        limit = abs(xi) * step_factor(error, 8.0)
        if error <= 1.0:
            copy(out, y, N_LEG)
    return n0, a, b, E, n_j0, 0.0, 0.0, 0.0, STEPS


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
    v = hypot(a, b)
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
    work : float64 array, at least (16, 8)

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
        v = hypot(a, b)
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
