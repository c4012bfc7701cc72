"""Works of the forces in an impact: its law (6)-(7) once more, with the works as further integrals.

Nothing of the impact's own solution is used but its record: which ends act in a phase, whether they stick or slip, and how
large the normal impulses are at its end. Of its law the force over the compression is shared (``double_equations``), no rate.
A phase is integrated from the velocities that the phases before it have given, until its normal impulses are as recorded.
Units within a phase: the approach speed V, the mass m of the dimer, m V of impulses.
"""

from math import copysign
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import compression, first_forces, force, stored_energy
from dimersweep.kernel.model.body import delassus, end, lateral_impulses, levers
from dimersweep.kernel.model.friction import length, outward_slip, slip_strength
from dimersweep.kernel.model.layout import IMPACT, SLIP, STICK
from dimersweep.kernel.numerics.steps import DOP_STAGES, WIDTH, copy, explicit_step, step_factor

# velocities of the body: of the centre of mass (normal, axial, lateral), beta', theta' cos(beta), axial spin
UN, UA, UB, UWB, UWP, US = range(6)
N_U = 6
# works: of the plate by the normal forces at p1, p2, and along itself; what restitution and slip take (below zero) at p1, p2
PLATE_1, PLATE_2, ALONG, REST_1, REST_2, SLIP_1, SLIP_2 = range(7)
N_WORK = 7
# a phase: gap rates, compressions (of a single end: its stored energy), axial and lateral velocities, as in the state of an
# impact, and the sum of the normal impulses; normal impulses, the axial one, laterals; works of restitution and slip
QN1, QN2, QX1, QX2, QA, QB1, QB2, QP, QP1, QP2, QSA, QSB1, QSB2, QR1, QR2, QS1, QS2 = range(17)
N_Q = 17
# constants of a phase: the Delassus operator, in units of 1/m; 1 or 1/e^2; the friction modes, or the number of the end; the
# slip that counts as none
LNN1, LNN2, LNN12, LNA1, LNA2, LAA, LBB1, LBB2, LBB12, LGAIN1, LGAIN2, LMODE1, LMODE2, LEND, LREST = range(15)
BOTH = -1.0
# rows of the scratch array
R_K, R_Q, R_OUT, R_START, R_LAW, R_SCALE, R_BODY, R_LATER, R_SUM = 0, 12, 13, 14, 15, 16, 17, 18, 19
IMPACT_ROWS, WORK_WIDTH = 20, 18
TOL = 1e-14  # of a step
STEPS = 20_000  # of a phase at most
ON_AXIS = 1e-8  # angle of a slip to the axis below which it is axial (its square counts)
PLASTIC = 1e-9  # restitution that is none
EVENT_LOCATED = 1e-15  # what the impulse at the end of a phase may be off
ROOT_PROBES = 40


@compiled
def set_law(dm, i, sin_b, cos_b, law):
    """Delassus operator of both ends, with the axial lever of end i."""
    p, q, own = levers(dm.p1, sin_b, cos_b), levers(dm.p2, sin_b, cos_b), levers(end(dm, i), sin_b, cos_b)
    w_1, w_2, w_12 = delassus(dm, p, p), delassus(dm, q, q), delassus(dm, p, q)
    law[LNN1], law[LNN2], law[LNN12] = dm.m * w_1.nn, dm.m * w_2.nn, dm.m * w_12.nn
    law[LBB1], law[LBB2], law[LBB12] = dm.m * w_1.bb, dm.m * w_2.bb, dm.m * w_12.bb
    w_1, w_2 = delassus(dm, p, own), delassus(dm, q, own)
    law[LNA1], law[LNA2], law[LAA] = dm.m * w_1.na, dm.m * w_2.na, dm.m * delassus(dm, own, own).aa


@compiled
def load_phase(dm, i, sin_b, cos_b, u, V, q):
    """Contact velocities of the body velocities u into q, in units of V; no impulses and no works yet."""
    for k in range(N_Q):
        if k != QX1 and k != QX2:
            q[k] = 0.0
    first, second = levers(dm.p1, sin_b, cos_b), levers(dm.p2, sin_b, cos_b)
    q[QN1], q[QN2] = (u[UN] + first.n * u[UWB]) / V, (u[UN] + second.n * u[UWB]) / V
    q[QA] = (u[UA] + (first.a if i == 0 else second.a) * u[UWB]) / V
    q[QB1] = (u[UB] + first.b * u[UWP] + first.c * u[US]) / V
    q[QB2] = (u[UB] + second.b * u[UWP] + second.c * u[US]) / V


@compiled
def end_phase(dm, i, sin_b, cos_b, u, V, q):
    """Add the impulses of a phase to the body velocities u, by (5)."""
    first, second = levers(dm.p1, sin_b, cos_b), levers(dm.p2, sin_b, cos_b)
    unit = dm.m * V
    u[UN] += V * (q[QP1] + q[QP2])
    u[UA] += V * q[QSA]
    u[UB] += V * (q[QSB1] + q[QSB2])
    turn = first.n * q[QP1] + second.n * q[QP2] + (first.a if i == 0 else second.a) * q[QSA]
    u[UWB] += unit * turn * dm.it
    u[UWP] += unit * (first.b * q[QSB1] + second.b * q[QSB2]) * dm.it
    u[US] += unit * (first.c * q[QSB1] + second.c * q[QSB2]) * dm.ia


class LawPhase(NamedTuple):
    """A phase whose slopes are asked for."""

    dm: Any
    law: Any
    K: Any  # slopes of the stages


@compiled
def frictions(dm, law, least, f_1, f_2, a, b_1, b_2):
    """Axial friction A_1, A_2 and lateral friction L_1, L_2 of both ends; of held ends A_1 is the sum of the axial ones.

    Below the slip `least` friction falls to zero with the slip.
    """
    k_1 = slip_strength(dm.p1.mu, f_1, max(length(a, b_1), least))
    k_2 = slip_strength(dm.p2.mu, f_2, max(length(a, b_2), least))
    if law[LMODE1] != STICK and law[LMODE2] != STICK:
        return -k_1 * a, -k_2 * a, -k_1 * b_1, -k_2 * b_2
    hold, L_1, L_2 = -(law[LNA1] * f_1 + law[LNA2] * f_2) / law[LAA], 0.0, 0.0
    if law[LMODE1] != STICK:
        L_1 = -k_1 * b_1
        L_2 = -law[LBB12] / law[LBB2] * L_1
    elif law[LMODE2] != STICK:
        L_2 = -k_2 * b_2
        L_1 = -law[LBB12] / law[LBB1] * L_2
    return hold, 0.0, L_1, L_2


@compiled
def slopes_with_works(phase, stage, n_1, n_2, X_1, X_2, a, b_1, b_2, _):
    """Slopes of a stage; of the first WIDTH numbers of a phase they are returned.

    Where both ends act, the clock is that of dP_i = k_i X_i^eta dtau; where one does, and slips, that of dP = v dxi.
    """
    dm, law, k, acting = phase.dm, phase.law, phase.K[stage], phase.law[LEND]
    if acting == BOTH:
        f_1, f_2, least = force(dm, 0, X_1), force(dm, 1, X_2), law[LREST]
        pace_1 = 1.0 if n_1 < 0.0 or X_1 > 0.0 else 0.0
        pace_2 = 1.0 if n_2 < 0.0 or X_2 > 0.0 else 0.0
    else:
        f_1 = length(a, b_1) if acting == 0.0 else 0.0
        f_2 = length(a, b_2) if acting == 1.0 else 0.0
        least, pace_1, pace_2 = 0.0, f_1, f_2
    A_1, A_2, L_1, L_2 = frictions(dm, law, least, f_1, f_2, a, b_1, b_2)
    A = A_1 + A_2
    k[QP1], k[QP2], k[QSA], k[QSB1], k[QSB2] = f_1, f_2, A, L_1, L_2
    k[QR1], k[QR2], k[QS1], k[QS2] = n_1 * f_1, n_2 * f_2, A_1 * a + L_1 * b_1, A_2 * a + L_2 * b_2
    return (
        law[LNN1] * f_1 + law[LNN12] * f_2 + law[LNA1] * A,
        law[LNN12] * f_1 + law[LNN2] * f_2 + law[LNA2] * A,
        -law[LGAIN1] * n_1 * pace_1,
        -law[LGAIN2] * n_2 * pace_2,
        law[LNA1] * f_1 + law[LNA2] * f_2 + law[LAA] * A,
        law[LBB1] * L_1 + law[LBB12] * L_2,
        law[LBB12] * L_1 + law[LBB2] * L_2,
        f_1 + f_2,
    )


@compiled
def law_step(dm, h, work):
    """One step of DOP853 from the phase in row R_Q into row R_OUT; returns its error over the tolerance."""
    K, q = work[R_K : R_K + DOP_STAGES], work[R_Q]
    phase, k = LawPhase(dm, work[R_LAW], K), K[0]
    k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7] = slopes_with_works(
        phase, 0, q[QN1], q[QN2], q[QX1], q[QX2], q[QA], q[QB1], q[QB2], q[QP]
    )
    return explicit_step(slopes_with_works, phase, h, q, K, N_Q, work[R_SCALE], work[R_OUT])


@compiled
def shorten_to(dm, h, slot, target, work):
    """Shorten a step h, over which slot `slot` of the phase rises beyond `target`, to where it is that; by secants."""
    q, out = work[R_Q], work[R_OUT]
    low, high, low_value, high_value = 0.0, h, q[slot] - target, out[slot] - target
    for k in range(ROOT_PROBES):
        share = low_value / (low_value - high_value)
        h = low + (high - low) * (share if k % 3 < 2 else 0.5)
        law_step(dm, h, work)
        value = out[slot] - target
        if abs(value) <= EVENT_LOCATED or not low < h < high:
            break
        if value < 0.0:
            low, low_value = h, value
        else:
            high, high_value = h, value


@compiled
def is_axial(dm, law, q):
    """Whether the slip of a single end is along the axis, which attracts its direction."""
    i = int(law[LEND])
    mu, c = dm.p1.mu if i == 0 else dm.p2.mu, copysign(1.0, q[QA])
    attracts = mu * (law[LAA] - law[LBB1 + i]) < c * law[LNA1 + i]
    return attracts and abs(q[QB1 + i]) <= ON_AXIS * abs(q[QA])


@compiled
def follow_law(dm, target, work):
    """Carry a phase on to where its normal impulses sum up to `target`; returns whether it has come there.

    It has not where the slip of a single end comes to rest before, or goes along the axis for good, or where nothing presses
    any more.
    """
    q, out, law, scale = work[R_Q], work[R_OUT], work[R_LAW], work[R_SCALE]
    i = int(law[LEND])
    for k in range(WIDTH):
        scale[k] = TOL
    v_0 = length(q[QA], q[QB1 + i]) if i >= 0 else 0.0
    h = target / v_0 if i >= 0 else 1e-4
    for _ in range(STEPS):
        error = law_step(dm, h, work)
        if not error <= 1.0:
            h *= min(0.8, step_factor(error, 8.0))
            continue
        if i >= 0 and q[QN1 + i] < 0.0 and out[QN1 + i] > 0.0:  # from compression to restitution
            shorten_to(dm, h, QN1 + i, 0.0, work)
            if out[QP] < target:
                copy(out, q, N_Q)
                q[QN1 + i] = 0.0
                e = dm.p1.e if i == 0 else dm.p2.e
                law[LGAIN1 + i] = 1.0 / (e * e) if e > PLASTIC else 0.0
                q[QX1 + i] *= 1.0 if e > PLASTIC else 0.0
                continue
        if out[QP] >= target:
            if out[QP] > target:
                shorten_to(dm, h, QP, target, work)
            copy(out, q, N_Q)
            return True
        copy(out, q, N_Q)
        h *= min(5.0, step_factor(error, 8.0))
        if i >= 0 and (length(q[QA], q[QB1 + i]) <= law[LREST] * v_0 or is_axial(dm, law, q)):
            return False
        if i < 0 and not q[QX1] > 0.0 and not q[QX2] > 0.0 and q[QN1] >= 0.0 and q[QN2] >= 0.0:
            return False
    return False


@compiled
def straight_stretch(dm, law, q, P, t_a):
    """A stretch of a phase of a single end, at rest or slipping along the axis, over the normal impulse P: closed form.

    t_a is the axial impulse per normal one.
    """
    i = int(law[LEND])
    j = 1 - i
    n, a, w = q[QN1 + i], q[QA], law[LNN1 + i] + law[LNA1 + i] * t_a
    e = dm.p1.e if i == 0 else dm.p2.e
    P_c = min(P, -n / w) if n < 0.0 and w > 0.0 else 0.0  # in compression
    q[QX1 + i] -= P_c * (n + 0.5 * w * P_c)
    if e <= PLASTIC and n + w * P >= 0.0:
        q[QX1 + i] = 0.0
    elif P_c < P:
        q[QX1 + i] -= (P - P_c) * (n + 0.5 * w * (P + P_c)) / (e * e)
    q[QN1 + i] += w * P
    q[QN1 + j] += (law[LNN12] + law[LNA1 + j] * t_a) * P
    q[QA] += (law[LNA1 + i] + law[LAA] * t_a) * P
    q[QP] += P
    q[QP1 + i] += P
    q[QSA] += t_a * P
    q[QR1 + i] += P * (n + 0.5 * w * P)
    q[QS1 + i] += t_a * P * 0.5 * (a + q[QA])


@compiled
def take_slip_away(law, q, j):
    """Take away what is left of a slip that is as good as over."""
    i = 1 - j
    a, b = q[QA], q[QB1 + i]
    q[QSA] -= a / law[LAA]
    q[QSB1 + i] -= b / law[LBB1 + i]
    q[QB1 + j] -= law[LBB12] * b / law[LBB1 + i]
    q[QA], q[QB1 + i] = 0.0, 0.0


@compiled
def phase_of_one(dm, i, mode, P, work):
    """A phase of an impact in which end i alone acts, over its normal impulse P."""
    q, law = work[R_Q], work[R_LAW]
    p = dm.p1 if i == 0 else dm.p2
    compresses = q[QN1 + i] < 0.0
    law[LEND], law[LMODE1], law[LMODE2] = i, SLIP, SLIP  # of an end that sticks nothing is integrated
    law[LGAIN1 + i] = 1.0 if compresses else (1.0 / (p.e * p.e) if p.e > PLASTIC else 0.0)
    hold = -law[LNA1 + i] / law[LAA]
    if mode == STICK:
        take_slip_away(law, q, 1 - i)
        straight_stretch(dm, law, q, P, hold)
        return
    if p.mu == 0.0:
        straight_stretch(dm, law, q, P, 0.0)
        return
    if length(q[QA], q[QB1 + i]) > law[LREST] and not is_axial(dm, law, q) and follow_law(dm, P, work):
        return
    if length(q[QA], q[QB1 + i]) > law[LREST] and is_axial(dm, law, q):
        t_a = -copysign(p.mu, q[QA])
        w, left = law[LNA1 + i] + law[LAA] * t_a, P - q[QP]
        stops = q[QA] * w < 0.0 and -q[QA] / w < left
        straight_stretch(dm, law, q, -q[QA] / w if stops else left, t_a)
        if not stops:
            return
    take_slip_away(law, q, 1 - i)
    away = -copysign(p.mu, law[LNA1 + i])
    straight_stretch(dm, law, q, P - q[QP], away if abs(law[LNA1 + i]) > p.mu * law[LAA] else hold)


@compiled
def set_slips_out(dm, law, q):
    """Give a slip that begins at rest the direction in which it sets out, and take away that of ends that stick."""
    stick_1, stick_2 = law[LMODE1] == STICK, law[LMODE2] == STICK
    if stick_1 or stick_2:
        q[QA] = 0.0
        q[QB1] = 0.0 if stick_1 else q[QB1]
        q[QB2] = 0.0 if stick_2 else q[QB2]
        return
    none, (f_1, f_2) = 10.0 * law[LREST], first_forces(dm, q)
    pull = law[LNA1] * f_1 + law[LNA2] * f_2
    rest_1, rest_2 = length(q[QA], q[QB1]) <= none, length(q[QA], q[QB2]) <= none
    if rest_1 and rest_2:
        q[QA] = copysign(none, pull)
    elif rest_1:
        side = -law[LBB12] * dm.p2.mu * f_2 * copysign(1.0, q[QB2])
        d_a, d_b = outward_slip(pull, side, dm.p1.mu * f_1 * law[LAA], dm.p1.mu * f_1 * law[LBB1])
        q[QA], q[QB1] = none * d_a, none * d_b
    elif rest_2:
        side = -law[LBB12] * dm.p1.mu * f_1 * copysign(1.0, q[QB1])
        d_a, d_b = outward_slip(pull, side, dm.p2.mu * f_2 * law[LAA], dm.p2.mu * f_2 * law[LBB2])
        q[QA], q[QB2] = none * d_a, none * d_b


@compiled
def loading_gain(e, X, n_before, n_after):
    """1 in compression, 1/e^2 in restitution, from the compression at the start of a phase in which it is one of them, and
    the gap rates before and after.
    """
    compresses = X == 0.0 or n_before < 0.0 or (n_before == 0.0 and n_after < 0.0)
    return 1.0 if compresses or e <= PLASTIC else 1.0 / (e * e)


@compiled
def impact_phase(dm, digit_1, digit_2, n_before, n_after, P, sin_b, cos_b, V, least, u, work, done):
    """One phase of an impact as it was recorded; the body velocities u in place.

    Parameters
    ----------
    digit_1, digit_2 : int
        Of the contact state: IMPACT and more at an end that acts.
    n_before, n_after, P : (float, float)
        Recorded gap rates and normal impulses of both ends [m/s], [N s].
    sin_b, cos_b : float
        Of the dip angle.
    V : float
        Unit of velocities [m/s].
    least : float
        Slip that counts as none, in this unit.
    u : float64 array, shape (N_U,)
    work : float64 array, shape (IMPACT_ROWS, WORK_WIDTH)
        Scratch; compressions are carried on from phase to phase in R_Q.
    done : float64 array, shape (N_WORK,)
        Works of restitution and slip are filled in [J], and impulses into the row R_SUM of the scratch.
    """
    q, law, total = work[R_Q], work[R_LAW], work[R_SUM]
    on_1, on_2 = digit_1 > IMPACT, digit_2 > IMPACT
    i = 0 if on_1 else 1
    set_law(dm, i, sin_b, cos_b, law)
    law[LREST] = least
    load_phase(dm, i, sin_b, cos_b, u, V, q)
    unit = dm.m * V
    if dm.p1.e <= PLASTIC and n_before[0] >= 0.0:
        q[QX1] = 0.0
    if dm.p2.e <= PLASTIC and n_before[1] >= 0.0:
        q[QX2] = 0.0
    if on_1 and on_2:
        law[LEND], law[LMODE1], law[LMODE2] = BOTH, digit_1 - IMPACT, digit_2 - IMPACT
        law[LGAIN1] = loading_gain(dm.p1.e, q[QX1], n_before[0], n_after[0])
        law[LGAIN2] = loading_gain(dm.p2.e, q[QX2], n_before[1], n_after[1])
        set_slips_out(dm, law, q)
        follow_law(dm, (P[0] + P[1]) / unit, work)
    else:
        q[QX1 + i], q[QX2 - i] = stored_energy(dm, i, q[QX1 + i]), 0.0
        phase_of_one(dm, i, (digit_1 if i == 0 else digit_2) - IMPACT, P[i] / unit, work)
        q[QX1 + i] = compression(dm, i, q[QX1 + i])
    for k in range(2):
        q[QX1 + k] = max(0.0, q[QX1 + k])
        done[REST_1 + k] = unit * V * q[QR1 + k]
        done[SLIP_1 + k] = unit * V * q[QS1 + k]
    for k in range(QP1, QSB2 + 1):
        total[k] = unit * q[k]
    end_phase(dm, i, sin_b, cos_b, u, V, q)


@compiled
def impulses_of_change(dm, i, both, sin_b, cos_b, u, later, total):
    """Impulses that change the body velocities from u to `later`, those at p1 and p2 or at end i alone, into `total`."""
    first, second = levers(dm.p1, sin_b, cos_b), levers(dm.p2, sin_b, cos_b)
    push, A, side = dm.m * (later[UN] - u[UN]), dm.m * (later[UA] - u[UA]), dm.m * (later[UB] - u[UB])
    total[QSA] = A
    total[QP1], total[QP2], total[QSB1], total[QSB2] = 0.0, 0.0, 0.0, 0.0
    if not both:
        total[QP1 + i], total[QSB1 + i] = push, side
        return
    moment = dm.J_t * (later[UWB] - u[UWB]) - first.a * A
    total[QP1] = (second.n * push - moment) / (second.n - first.n)
    total[QP2] = push - total[QP1]
    d_1 = side + dm.m * (first.b * (later[UWP] - u[UWP]) + first.c * (later[US] - u[US]))
    d_2 = side + dm.m * (second.b * (later[UWP] - u[UWP]) + second.c * (later[US] - u[US]))
    total[QSB1], total[QSB2] = lateral_impulses(dm, d_1, d_2)


@compiled
def close_work(dm, closed_1, closed_2, sin_b, cos_b, u, later, work, done):
    """Works of the impulses with which the close of a chatter ends the gap rates of closed ends; u becomes `later`.

    An impulse that acts at once works with the mean of the velocities before and after it.
    """
    q, total, i = work[R_Q], work[R_SUM], 0 if closed_1 else 1
    impulses_of_change(dm, i, closed_1 and closed_2, sin_b, cos_b, u, later, total)
    for k in range(N_U):
        work[R_START, k] = 0.5 * (u[k] + later[k])
        u[k] = later[k]
    load_phase(dm, i, sin_b, cos_b, work[R_START], 1.0, q)
    alone = not (closed_1 and closed_2)
    for k in range(2):
        done[REST_1 + k] = total[QP1 + k] * q[QN1 + k]
        share = (1.0 if k == i else 0.0) if alone else 0.5
        done[SLIP_1 + k] = share * total[QSA] * q[QA] + total[QSB1 + k] * q[QB1 + k]
