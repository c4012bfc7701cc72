"""Resolve an impact at one end by (7) and the friction of (4), with its closed forms.

With one contact acting, its normal impulse P is the clock: n' = W_nn - mu W_na cos(phi), and the slip (v, phi) obeys

    v'     = W_na cos(phi) - mu (W_aa cos^2(phi) + W_bb sin^2(phi))
    v phi' = sin(phi) (mu (W_aa - W_bb) cos(phi) - W_na).

Stick, slip without friction and slip along an invariant direction (phi' = 0) make every rate constant: closed form.
Between them a leg is expanded in powers of xi, with dP = v dxi (``expansion``). Velocities are in units of the approach
speed V, impulses of m V, energies of m V^2, the Delassus operator of 1/m.
"""

from math import copysign, inf, sqrt
from typing import NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.expansion import (
    A_A,
    A_E,
    A_J,
    A_N,
    A_P,
    A_V,
    at,
    begin_expansion,
    expand_to_end,
    first_zero,
    square_integral,
    unseen,
)
from dimersweep.kernel.model.friction import holds_axially, slip_force
from dimersweep.kernel.model.layout import IMPACT_STEPS, JAMMED, OK, SLIP, STICK
from dimersweep.kernel.numerics.elementary import exp, length, log
from dimersweep.kernel.numerics.meter import charge, is_over

# in place of a status: the other end begins to be compressed; the impact goes on with the next leg
OTHER, LEG = -1, -2
MAX_LEGS = 200  # an impact has a few legs: compression, slip, stick, restitution
MAX_SINGLE_STEPS = 2000  # expansions of a leg
EXPANSION_COST = 0.35  # work of a step by expansion, in hops of one end: as measured
# sine of the angle to an axial direction, below which an invariant slip is taken for axial
OFF_AXIS = 0.1
# rate of turning (per xi) below which any slip direction counts as invariant: round-off
INVARIANT = 1e-14
# effect on the rates, in tolerances, that may be left of the turning to an attracting direction: small, as motions
# amplify it
ATTRACTED = 1e-4
# ratio of the terms of a series in closed form, below which they are summed, and the number of terms at most: 0.4^80 is
# far below round-off
CONVERGES, MAX_TERMS = 0.4, 80


class EndLaw(NamedTuple):
    """Delassus operator, restitution and friction of an impact at one end while nothing acts at the other."""

    nn: float  # Delassus operator of the end, in units of 1/m
    na: float
    aa: float
    bb: float
    nn_j: float  # gap rate of the other end per normal and per axial impulse here
    na_j: float
    both: float  # 1.0 if the other end is closed (and may be driven to the plate), else 0.0
    e: float
    mu: float
    mu_s: float


class Blow:
    """Impact at one end on its way: velocities in units of the approach speed V, impulses of m V, energies of m V^2."""

    n: float  # gap rate of the end, its axial and its lateral velocity
    a: float
    b: float
    E: float  # elastic energy that is stored in the contact
    n_j: float  # gap rate of the other end
    compressing: bool
    mode: int  # friction mode in the last leg, STICK or SLIP
    P: float  # impulses so far: normal, axial, lateral
    A: float
    B: float
    rest: float  # works so far: of restitution, and, where works are wanted, of slip
    slip: float
    # the part of these before the end stuck (all if it slips to the end): it does not slip again once it sticks
    P_s: float
    A_s: float
    rest_s: float


@compiled
def begin_blow(blow, n, a, b, E, n_j):
    """Begin an impact, or go on with it, from the velocities of the end, its energy and the other end's gap rate."""
    blow.n, blow.a, blow.b, blow.E, blow.n_j = n, a, b, E, n_j
    blow.compressing, blow.mode = n < 0.0 or E == 0.0, SLIP
    blow.P, blow.A, blow.B, blow.rest, blow.slip = 0.0, 0.0, 0.0, 0.0, 0.0
    blow.P_s, blow.A_s, blow.rest_s = 0.0, 0.0, 0.0


@compiled(inline=True)
def gain(law, blow):
    """Return the stored energy lost per normal work: 1 in compression, 1/e^2 in restitution."""
    # 1e-300: with e = 0 a leg of restitution ends at once, but the quotient is formed
    return 1.0 if blow.compressing else 1.0 / max(law.e * law.e, 1e-300)


@compiled
def turning(law, c, s):
    """Return dphi/dxi at the slip direction (c, s), and its derivative with respect to phi (negative: attracting)."""
    spread = law.mu * (law.aa - law.bb)
    return s * (spread * c - law.na), c * (spread * c - law.na) - spread * s * s


@compiled
def turns_away(law, c):
    """Return True if a slip near zero along (c, s), with s != 0, only turns round there and grows again.

    Its direction tends to the way that W_na drives it, where it grows if |W_na| > mu W_aa. But if it is nearer to an
    attracting direction in which slip dies out, it tends to that. A slip that turns away comes to rest at no tolerance,
    be it small beyond measure.
    """
    drive = abs(law.na)
    return drive > law.mu * law.aa and drive > law.mu * (law.aa - law.bb) * copysign(c, c * law.na)


@compiled
def is_invariant(law, v, c, s, tol):
    """Return True if slip along (c, s) keeps its direction.

    It does to rounding, or where it is so near to an attracting direction that the rates do not change. Near an axial
    direction the rates change with s^2 only. How they do while v s^2 dies out as exp(fade xi) is known (`swerve`).
    """
    rate, slope = turning(law, c, s)
    fade = 2.0 * slope + law.na * c - law.mu * law.aa
    off = abs(s * s * s) if abs(s) < OFF_AXIS and fade < 0.0 else abs(rate / slope)
    return abs(rate) <= INVARIANT or (slope < 0.0 and v * off <= ATTRACTED * tol)


@compiled
def swerve(law, c, v, b, P):
    """Return the effect of the turning that is left in a slip v near the axis over an impulse P.

    With s = b / v, s' = slope s in xi: the turning dies out.

    Returns
    -------
    S, S_1, b : float
        Integral of s^2 / 2 over P, that of S, and the lateral slip that is left.
    """
    w_v, (_, slope) = law.na * c - law.mu * law.aa, turning(law, c, 0.0)
    x, size, fade = w_v * P / v, 0.5 * b * b / v, 2.0 * slope + w_v
    left = max(0.0, 1.0 + x)  # share of v that is left; dies: share of s
    # log(1 + x) / x, which is 1 to 5e-9 where x is below 1e-8, and would be a quotient of roundings there
    dies = exp(slope * P / v * (log(left) / x if abs(x) > 1e-8 else 1.0)) if left > 0.0 else 0.0
    S, S_1 = left * dies * dies - 1.0, left * left * dies * dies - 1.0
    return size * S / fade, size * (v * S_1 / (fade + w_v) - P) / fade, b * left * dies


@compiled
def later_zero(P, change, rate):
    """Return the impulse at which a function reaches zero after a small `change` of the function.

    Without the change it falls to zero at the impulse P, with the slope `rate`.
    """
    return max(0.0, P - change / rate) if inf > P else inf


@compiled
def time_to_events(law, blow, v, w, w_j, w_v):
    """Return the impulses after which, at constant rates, each event of the leg happens; inf for none.

    The events are: the gap rate of the end is zero; its energy is spent; the other end turns to the plate; the slip v
    is zero.
    """
    n, n_j = blow.n, blow.n_j
    P_n = -n / w if (blow.compressing and w > 0.0) or (not blow.compressing and w < 0.0) else inf
    P_E = inf
    if not blow.compressing:
        disc = n * n + 2.0 * w * law.e * law.e * blow.E
        if disc >= 0.0:
            P_E = 2.0 * law.e * law.e * blow.E / (n + sqrt(disc))
    P_j = -n_j / w_j if law.both > 0.0 and w_j < 0.0 else inf
    P_v = -v / w_v if w_v < 0.0 else inf
    return P_n, P_E, P_j, P_v


@compiled(fuse=True)
def run_down(law, a, b, tol):
    """Return the impulse over which a turning slip dies out, and the integral of a over that impulse.

    The slip turns to an attracting axial direction. With q = tan^2 of half the angle to that direction, the sign sigma
    of which is c, the hodograph is

        v = K q^alpha (1 - w q)^beta (1 + q),    dq/dxi = 2 m q (1 - w q) / (1 + q),

    m = mu (W_aa - W_bb) - sigma W_na < 0, alpha = (sigma W_na - mu W_aa) / 2m > 0, w = (mu (W_aa - W_bb) + sigma W_na)
    / m. So the integrals of v and of a v over xi down to q = 0 are power series in q. Both are inf where the series
    converge slowly.
    """
    v = length(a, b)
    spread = law.mu * (law.aa - law.bb)
    c = 1.0 if spread * a < law.na * v else -1.0
    m, fade = spread - c * law.na, c * law.na - law.mu * law.aa
    near = v + c * a
    if m >= 0.0 or fade >= 0.0 or near <= 0.0:
        return inf, inf
    q, w = (v - c * a) / near, (spread + c * law.na) / m
    if q * max(1.0, abs(w)) > CONVERGES:
        return inf, inf
    alpha, g = 0.5 * fade / m, 0.5 * law.mu * law.bb * (1.0 + w) / m  # g = beta w
    f, f_1, f_2 = 1.0, 0.0, 0.0  # terms of (1 - w q)^(beta - 1) in powers of q, the newest first
    d, d_1, d_2, d_3 = 1.0, 0.0, 0.0, 0.0  # of (1 - w q)^(2 beta - 1)
    shape, first, second = 0.0, 0.0, 0.0
    for k in range(MAX_TERMS):
        shape += f
        first += (f + q * (2.0 * f_1 + q * f_2)) / (alpha + k)
        second += (d + q * (d_1 - q * (d_2 + q * d_3))) / (2.0 * alpha + k)
        # a tenth: the terms to come fall off about as powers of CONVERGES, and add up to less than the tolerance
        if abs(f) + abs(f_1) + abs(d) + abs(d_1) <= 0.1 * tol:
            size = v / (shape * (1.0 - w * q) * (1.0 + q))
            return size * first / (-2.0 * m), c * size * size * second / (-2.0 * m)
        more, step = w * (k + 1.0), q / (k + 1.0)
        f_2, f_1, f = f_1, f, f * (more - g) * step
        d_3, d_2, d_1, d = d_2, d_1, d, d * (more - 2.0 * g) * step
    return inf, inf


@compiled
def stop_at_once(law, blow, tol):
    """Follow the rest of a leg in which the slip dies out before anything else happens: set its velocities and energy.

    Returns
    -------
    P, A, S : float
        Normal and axial impulse; work of friction. P is inf if the slip does not die out first, as far as is known.
    """
    n, a, b = blow.n, blow.a, blow.b
    P, swept = run_down(law, a, b, tol)
    # the gap rate must only rise, wherever the slip turns: else compression may end before
    if inf == P or law.nn - law.mu * abs(law.na) < 0.0:
        return inf, 0.0, 0.0
    A = -(a + law.na * P) / law.aa
    n_end = n + law.nn * P + law.na * A
    # n = n_0 + W_nn P + W_na (a - a_0 - W_na P) / W_aa, integrated over P
    worked = P * (n - law.na * a / law.aa + 0.5 * P * (law.nn - law.na * law.na / law.aa)) + law.na / law.aa * swept
    E_end = blow.E - gain(law, blow) * worked
    if (blow.compressing and n_end >= 0.0) or E_end <= 0.0:
        return inf, 0.0, 0.0
    blow.n, blow.a, blow.b, blow.E = n_end, 0.0, 0.0, E_end
    blow.n_j += law.nn_j * P + law.na_j * A
    # a dA + b dB, with da = W_na dP + W_aa dA and db = W_bb dB, over the slip down to zero
    return P, A, -(0.5 * a * a + law.na * swept) / law.aa - 0.5 * b * b / law.bb


@compiled(inline=True)
def add(blow, P, A, B, slip):
    """Add the impulses of a leg (normal, axial and lateral) and the work of slip in it."""
    blow.P, blow.A, blow.B, blow.slip = blow.P + P, blow.A + A, blow.B + B, blow.slip + slip


@compiled(inline=True)
def reached(c, row, order, xi, zero):
    """Return a row of the expansion at xi, exactly 0.0 if that is its zero."""
    return 0.0 if xi == zero else at(c, row, order, xi)[0]


@compiled
def turning_leg(law, blow, tol, work):
    """Follow one leg with a turning slip direction to its first event, or until the direction has become invariant.

    Returns
    -------
    int
        LEG, OTHER, or IMPACT_STEPS, also where the meter of the scratch is over.
    """
    # 1e-14: some tens of units of round-off, below which the slip is a difference of rounded numbers
    slip_end, lateral = max(tol, 1e-14 * length(blow.a, blow.b)), abs(blow.b) > tol
    P, A, B, S, c = 0.0, 0.0, 0.0, 0.0, work.rows
    for _ in range(MAX_SINGLE_STEPS):
        if is_over(work.meter):
            break
        charge(work.meter, EXPANSION_COST)
        a, b = blow.a, blow.b
        if law.both == 0.0:
            dP, dA, dS = stop_at_once(law, blow, tol)
            if dP < inf:
                add(blow, P + dP, A + dA, B - b / law.bb, S + dS)
                return LEG
        fading = begin_expansion(blow, c)
        order, h = expand_to_end(law, gain(law, blow), blow.compressing, fading, unseen(c, length(a, b), tol), c)
        xi_n = first_zero(c, A_N, order, -1.0 if blow.compressing else 1.0, h)
        xi_E = inf if blow.compressing else first_zero(c, A_E, order, 1.0, h)
        xi_j = first_zero(c, A_J, order, 1.0, h) if law.both > 0.0 else inf
        xi = min(min(xi_n, xi_E), min(xi_j, h))
        if work.course[0].tally.wanted:
            S -= law.mu * square_integral(c, A_V, order, xi)  # dP = v dxi
        blow.a, blow.b = at(c, A_A, order, xi)[0], b * exp(-law.mu * law.bb * xi)
        dP, _ = at(c, A_P, order, xi)
        P, A, B = P + dP, A + (blow.a - a - law.na * dP) / law.aa, B + (blow.b - b) / law.bb
        blow.n, blow.E = reached(c, A_N, order, xi, xi_n), reached(c, A_E, order, xi, xi_E)
        blow.n_j = reached(c, A_J, order, xi, xi_j)
        v = length(blow.a, blow.b)
        stopped = v <= slip_end
        ended = xi == xi_n or xi == xi_E or xi == xi_j or stopped
        if ended or is_invariant(law, v, blow.a / v, blow.b / v, tol):
            if stopped:
                # twice the slip that ends a leg: the next leg is not to end where it begins
                turned = lateral and turns_away(law, blow.a / v)
                blow.a, blow.b = copysign(2.0 * slip_end, law.na) if turned else 0.0, 0.0
            add(blow, P, A, B, S)
            return OTHER if law.both > 0.0 and blow.n_j == 0.0 else LEG
    return IMPACT_STEPS


@compiled
def straight_leg(law, blow, c, s):
    """Follow one leg at constant rates, by its closed form: stick, or slip along the direction (c, s).

    Returns
    -------
    int
        LEG, OTHER or JAMMED.
    """
    n, a, b, stick = blow.n, blow.a, blow.b, blow.mode == STICK
    if stick:
        t_a, t_b = -law.na / law.aa, 0.0
        w_a, w_b, w_v = 0.0, 0.0, 0.0
    else:
        t_a, t_b = slip_force(law.mu, 1.0, c, s)
        w_a, w_b = law.na + law.aa * t_a, law.bb * t_b
        w_v = w_a * c + w_b * s if law.mu > 0.0 else 0.0
    v = length(a, b)
    w, w_j = law.nn + law.na * t_a, law.nn_j + law.na_j * t_a
    times = time_to_events(law, blow, v, w, w_j, w_v)
    P_n, P_E, P_j, P_v = times
    P = min(min(P_n, P_E), min(P_j, P_v))
    if inf == P:
        return JAMMED
    if not stick and law.mu > 0.0 and s == 0.0 and abs(b) > INVARIANT * v:
        swerving_leg(law, blow, c, v, times)
    else:
        worked = P * (n + 0.5 * w * P)
        blow.E = 0.0 if P == P_E else max(0.0, blow.E - gain(law, blow) * worked)
        blow.n = 0.0 if P_n == P else n + w * P
        blow.n_j = 0.0 if P_j == P else blow.n_j + w_j * P
        if P_v == P:
            blow.a, blow.b = 0.0, 0.0
        elif not stick:
            blow.a, blow.b = a + w_a * P, b + w_b * P
        slid = 0.0 if stick else P * (v + 0.5 * w_v * P)  # integral of the slip over P
        add(blow, P, t_a * P, (blow.b - b) / law.bb, -law.mu * slid)
    return OTHER if law.both > 0.0 and blow.n_j == 0.0 and w_j < 0.0 else LEG


@compiled
def swerving_leg(law, blow, c, v, times):
    """Follow one leg of a slip v near the axis along (c, 0), where the turning that is left changes all rates a little.

    `times` are the impulses of its events without that change (`time_to_events`).
    """
    n, a, b, t_a, (P_n, P_E, P_j, P_v) = blow.n, blow.a, blow.b, -law.mu * c, times
    w, w_j, w_a = law.nn + law.na * t_a, law.nn_j + law.na_j * t_a, law.na + law.aa * t_a
    S, S_1, left = swerve(law, c, v, b, min(min(P_n, P_E), min(P_j, P_v)))
    slower = 2.0 * law.mu * (law.aa - law.bb) - law.na * c
    P_n, P_j = later_zero(P_n, -law.na * t_a * S, w), later_zero(P_j, -law.na_j * t_a * S, w_j)
    P_E, P_v = later_zero(P_E, law.na * t_a * S_1, -(n + w * P_E)), later_zero(P_v, slower * S, w_a * c)
    P = min(min(P_n, P_E), min(P_j, P_v))
    A, worked = t_a * (P - S), P * (n + 0.5 * w * P) - law.na * t_a * S_1
    blow.E = 0.0 if P == P_E else max(0.0, blow.E - gain(law, blow) * worked)
    blow.n = 0.0 if P_n == P else n + law.nn * P + law.na * A
    blow.n_j = 0.0 if P_j == P else blow.n_j + law.nn_j * P + law.na_j * A
    blow.a, blow.b = (0.0, 0.0) if P_v == P else (a + law.na * P + law.aa * A, left)
    add(blow, P, A, (blow.b - b) / law.bb, -law.mu * (P * (v + 0.5 * w_a * c * P) + slower * S_1))


@compiled
def begin_leg(law, blow, tol):
    """Choose the friction mode of the next leg.

    Return the direction (c, s) of its slip, and whether that direction turns. A slip that counts as none is set to
    rest. Out of rest it goes the way that W_na drives it.
    """
    v, holds = length(blow.a, blow.b), holds_axially(law.mu_s, law.na, law.aa)
    blow.mode = SLIP
    if law.mu == 0.0 and (v > tol or not holds):
        # without friction the direction is of no consequence; the straight leg reverses the gap rate to the last digit
        return 1.0, 0.0, False
    if v <= tol:
        blow.a, blow.b = 0.0, 0.0
        blow.mode = STICK if holds else SLIP
        return 1.0 if law.na > 0.0 else -1.0, 0.0, False
    c, s = blow.a / v, blow.b / v
    if not is_invariant(law, v, c, s, tol):
        return c, s, True
    return (copysign(1.0, c), 0.0, False) if abs(s) < OFF_AXIS else (c, s, False)


@compiled
def single_phase(law, blow, tol, work):
    """Follow the impact at one end until its energy is spent or the other closed end begins to be compressed.

    Parameters
    ----------
    law : EndLaw
    blow : Blow
        From its start (`begin_blow`); modified in place.
    tol : float
        Error per unit of velocity, and the slip that counts as none.
    work : Scratch
        Scratch rows, at least (6, ORDER + 1), the meter, and the tally, which says if works are wanted.

    Returns
    -------
    int
        OK, where its energy is spent, OTHER, JAMMED or IMPACT_STEPS.
    """
    for _ in range(MAX_LEGS):
        compressing, E = blow.compressing, blow.E
        if not compressing and (E <= 0.0 or law.e == 0.0):
            blow.E = 0.0
            return OK
        c, s, turns = begin_leg(law, blow, tol)
        reason = turning_leg(law, blow, tol, work) if turns else straight_leg(law, blow, c, s)
        blow.rest += (E - blow.E) * (1.0 if compressing else law.e * law.e)
        if blow.mode == SLIP:
            blow.P_s, blow.A_s, blow.rest_s = blow.P, blow.A, blow.rest
        if reason != LEG:
            return reason
        if blow.n == 0.0 or (compressing and blow.n > 0.0):
            blow.compressing = not compressing
    return IMPACT_STEPS
