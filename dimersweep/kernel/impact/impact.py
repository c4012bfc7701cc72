"""An impact from its first touch to its last: which ends act, phase by phase, and what becomes of the body's velocities."""

from math import cos, sin
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import (
    N_Z,
    PLAIN,
    ZA,
    ZB1,
    ZB2,
    ZN1,
    ZN2,
    ZX1,
    ZX2,
    DoubleLaw,
    first_pressures,
    friction_modes,
    impact_rates,
)
from dimersweep.kernel.impact.double_leg import double_leg
from dimersweep.kernel.impact.double_step import LEG_ROWS
from dimersweep.kernel.impact.phase_log import log_phase, log_single
from dimersweep.kernel.impact.single_impact import (
    DONE,
    JAM,
    STEPS,
    EndLaw,
    single_phase,
)
from dimersweep.kernel.model.body import delassus, levers
from dimersweep.kernel.model.friction import holds_axially, length, slip_force
from dimersweep.kernel.model.layout import (
    BETA,
    CA,
    CB,
    FREE,
    IMPACT,
    IMPACT_STEPS,
    JAMMED,
    N1,
    N2,
    OK,
    SLIP,
    SPIN,
    STICK,
    WB,
    WP,
)
from dimersweep.kernel.numerics.steps import copy

MAX_PHASES = 2000
# approach, in tolerances and in V, that ends the series of switches of two ends at small e
LEFT_OVER, LEAST_LEFT = 1e-3, 1e-13
DOUBLE_TOL = 0.2  # of the integrator of a double impact, in units of the impact's tolerance: its steps add up
FAINT = 0.1  # rebound that is none, in units of the impact's tolerance
FINEST, COARSEST = 5e-14, 1e-4  # tolerances of that integrator: what round-off allows, and what finds events easily
LEAST_SLIP = 1e-12  # slip, in units of V, whose setting out of rest the integrator can still follow
SLIP_TOL = 0.1  # slip that counts as none, in units of the impact's tolerance


class ImpactRows(NamedTuple):
    """Rows of the work array, beyond those of a leg, by what they hold during an impact at both ends."""

    z: Any  # the contact velocities and the compressions
    start: Any  # those before the impact
    before: Any  # those before the phase
    compressing: Any  # 1.0 for an end in compression, -1.0 for one in restitution
    mid: Any  # those at which a slip ended within the phase


@compiled
def impact_rows(work):
    """The rows of an impact at both ends on a work array."""
    return ImpactRows(work[LEG_ROWS], work[LEG_ROWS + 1], work[LEG_ROWS + 2], work[LEG_ROWS + 3], work[LEG_ROWS + 4])


@compiled
def contact_velocity(dm, state, s):
    """Gap rate, axial and lateral velocity of the contact point of the end with sign s [m/s]."""
    lv = levers(dm, s, sin(state[BETA]), cos(state[BETA]))
    n = state[N1] if s < 0.0 else state[N2]
    return n, state[CA] + lv.a * state[WB], state[CB] + lv.b * state[WP] + lv.c * state[SPIN]


@compiled
def restitution(e, tol):
    """Coefficient of restitution, 0 where the rebound is far below the tolerance: its time scale, e, would be too short."""
    return e if e > FAINT * tol else 0.0


@compiled
def end_law(dm, s, both, sin_b, cos_b, e, mu, mu_s):
    """The law of an impact at one end."""
    own, other = levers(dm, s, sin_b, cos_b), levers(dm, -s, sin_b, cos_b)
    w, wj = delassus(dm, own, own), delassus(dm, other, own)
    m = dm.m
    return EndLaw(m * w.nn, m * w.na, m * w.aa, m * w.bb, m * wj.nn, m * wj.na, both, e, mu, mu_s)


@compiled
def double_law(dm, e_1, e_2, mu, mu_s):
    """The law of a double impact (beta = 0)."""
    p, q = levers(dm, -1.0, 0.0, 1.0), levers(dm, 1.0, 0.0, 1.0)
    w, wj = delassus(dm, p, p), delassus(dm, q, p)
    m = dm.m
    return DoubleLaw(m * w.nn, m * wj.nn, -m * w.na, m * w.aa, m * w.bb, m * wj.bb, e_1, e_2, mu, mu_s)


@compiled
def compression(E):
    """X of a stored energy: E = (2/5) X^(5/2)."""
    return (2.5 * E) ** 0.4 if E > 0.0 else 0.0


@compiled
def stored_energy(X):
    """E of a compression X."""
    return 0.4 * X**2.5 if X > 0.0 else 0.0


@compiled
def is_loaded(i, z, left, least):
    """Whether end i is compressed or approaches, by more than the gap rate `left`, or the compression `least` worth as much."""
    X, n = z[ZX1 + i], z[ZN1 + i]
    return n < -left or least < X or (X > 0.0 and n > left)


@compiled
def let_go(i, z, compressing, left, least):
    """An end that is not loaded has no compression left."""
    if not is_loaded(i, z, left, least):
        z[ZX1 + i] = 0.0
        compressing[i] = 1.0


@compiled
def acts(law, i, z, left, least, slip_tol):
    """Whether end i acts now or is about to: it is loaded, or the force at the other end drives it towards the plate from rest.

    At rest and uncompressed, an end is driven by the other one alone, with the friction that other end has.
    """
    if is_loaded(i, z, left, least):
        return True
    if z[ZN1 + i] > 0.0 or not is_loaded(1 - i, z, left, least):
        return False
    sign = 1.0 if i == 0 else -1.0
    v = length(z[ZA], z[ZB2 - i])
    if v > slip_tol:
        friction, _ = slip_force(law.mu, 1.0, z[ZA], 0.0)
        tau = friction / v
    else:
        tau = -sign * (law.w / law.aa if holds_axially(law.mu_s, law.w, law.aa) else law.mu)
    return law.nn_12 - sign * law.w * tau < 0.0


@compiled
def single_impact(dm, state, s, V, tol, work, log):
    """Impact at the end with sign s while the other one is off the plate; updates the state.

    Returns
    -------
    status, mode, rows : int
        OK or the reason; STICK or SLIP at the end; rows logged.
    """
    sin_b, cos_b = sin(state[BETA]), cos(state[BETA])
    e = restitution(dm.e_1 if s < 0.0 else dm.e_2, tol)
    law = end_law(dm, s, 0.0, sin_b, cos_b, e, dm.mu, dm.mu_s)
    n, a, b = contact_velocity(dm, state, s)
    slip_tol = max(SLIP_TOL * tol, rounding(dm, state) / V)
    n_plus, a_plus, b_plus, _, _, P, A, B, P_s, A_s, mode, reason = single_phase(
        law, n / V, a / V, b / V, 0.0, 0.0, slip_tol, work
    )
    if reason != DONE:
        return (JAMMED if reason == JAM else IMPACT_STEPS), mode, 0
    lv, lj = levers(dm, s, sin_b, cos_b), levers(dm, -s, sin_b, cos_b)
    wj = delassus(dm, lj, lv)
    unit = dm.m * V
    own, other = (N1, N2) if s < 0.0 else (N2, N1)
    state[own] = n_plus * V
    state[other] += unit * (wj.nn * P + wj.na * A)
    apply_impulse(dm, state, lv, unit * P, unit * A, unit * B)
    rows, n_j = 0, state[other] - unit * (wj.nn * P + wj.na * A)
    if mode == STICK and P_s > 0.0:
        n_s, n_js = n + V * (law.nn * P_s + law.na * A_s), n_j + unit * (wj.nn * P_s + wj.na * A_s)
        rows = log_single(log, rows, s, IMPACT + SLIP, n, n_j, n_s, n_js, unit * P_s, 0.0, 0.0)
        n, n_j, P = n_s, n_js, P - P_s
    rows = log_single(log, rows, s, IMPACT + mode, n, n_j, n_plus * V, state[other], unit * P, a_plus * V, b_plus * V)
    return OK, mode, rows


@compiled
def apply_impulse(dm, state, lv, P, A, B):
    """Add impulses at an end with the given levers to the body's velocities (gap rates apart)."""
    state[CA] += A / dm.m
    state[CB] += B / dm.m
    state[WB] += (lv.n * P + lv.a * A) / dm.J_t
    state[WP] += lv.b * B / dm.J_t
    state[SPIN] += lv.c * B / dm.J_a


@compiled
def rounding(dm, state):
    """Round-off of a contact velocity [m/s]: slip below it is none."""
    size = abs(state[CA]) + abs(state[CB]) + dm.r * abs(state[SPIN]) + dm.h * (abs(state[WB]) + abs(state[WP]))
    return 8.0 * 2.3e-16 * size


@compiled
def load_double(dm, state, V, z):
    """Contact velocities at a double contact into z, in units of V, uncompressed."""
    z[ZN1], z[ZN2] = state[N1] / V, state[N2] / V
    z[ZX1], z[ZX2] = 0.0, 0.0
    _, a, b_1 = contact_velocity(dm, state, -1.0)
    _, _, b_2 = contact_velocity(dm, state, 1.0)
    z[ZA], z[ZB1], z[ZB2] = a / V, b_1 / V, b_2 / V


@compiled
def impulses_between(dm, z, start, V):
    """Normal impulses (P_1, P_2), axial sum A and laterals (B_1, B_2) that lead from `start` to z [kg m/s]."""
    d_c = 0.5 * (z[ZN1] - start[ZN1] + z[ZN2] - start[ZN2]) * V
    d_w = 0.5 * (z[ZN2] - start[ZN2] - z[ZN1] + start[ZN1]) * V / dm.h
    A = dm.m * ((z[ZA] - start[ZA]) * V - dm.r * d_w)
    difference = (dm.J_t * d_w - dm.r * A) / dm.h
    P_1, P_2 = 0.5 * (dm.m * d_c - difference), 0.5 * (dm.m * d_c + difference)
    p, q = levers(dm, -1.0, 0.0, 1.0), levers(dm, 1.0, 0.0, 1.0)
    bb, bb_12 = delassus(dm, p, p).bb, delassus(dm, p, q).bb
    d_1, d_2 = (z[ZB1] - start[ZB1]) * V, (z[ZB2] - start[ZB2]) * V
    det = bb * bb - bb_12 * bb_12
    return P_1, P_2, A, (bb * d_1 - bb_12 * d_2) / det, (bb * d_2 - bb_12 * d_1) / det


@compiled
def double_impact(dm, state, V, tol, modes, work, log):
    """Impact with both ends on the plate (beta = 0); updates the state and the friction modes of the ends.

    Returns
    -------
    status, rows : int
        OK or the reason; rows logged.
    """
    law = double_law(dm, restitution(dm.e_1, tol), restitution(dm.e_2, tol), dm.mu, dm.mu_s)
    z, start, before, compressing, mid = impact_rows(work)
    load_double(dm, state, V, z)
    copy(z, start, N_Z)
    slip_tol = max(max(SLIP_TOL * tol, LEAST_SLIP), rounding(dm, state) / V)
    left = max(LEFT_OVER * tol, LEAST_LEFT)
    least = left**0.8  # X^(5/4) is worth a gap rate
    compressing[0], compressing[1] = 1.0, 1.0
    rows = 0
    status = IMPACT_STEPS
    lost = False
    for _ in range(MAX_PHASES):
        let_go(0, z, compressing, left, least)
        let_go(1, z, compressing, left, least)
        on_1, on_2 = acts(law, 0, z, left, least, slip_tol), acts(law, 1, z, left, least, slip_tol)
        if not on_1 and not on_2:
            z[ZN1], z[ZN2] = max(0.0, z[ZN1]), max(0.0, z[ZN2])
            status = OK
            break
        copy(z, before, N_Z)
        if on_1 and on_2:
            f_1, f_2 = first_pressures(z)
            friction_modes(law, z, modes, f_1, f_2, slip_tol, lost)
            if follow_acceleration(law, z, modes, compressing, left, mid):
                continue
            event = double_leg(law, z, modes, compressing, max(min(DOUBLE_TOL * tol, COARSEST), FINEST), slip_tol, work)
            if event < 0:
                break
            lost = 4 <= event < 6
            settle_event(law, event, z, compressing, left)
        else:
            i = 0 if on_1 else 1
            halts, reason = single_end_phase(dm, law, i, z, modes, compressing, slip_tol, before, mid, work)
            lost = False
            if reason == JAM or reason == STEPS:
                status = JAMMED if reason == JAM else IMPACT_STEPS
                break
            if halts:
                P_1, P_2, _, _, _ = impulses_between(dm, mid, before, V)
                beside = SLIP if length(before[ZA], before[ZB2 - i]) > slip_tol else STICK
                mode_1, mode_2 = (SLIP, beside) if i == 0 else (beside, SLIP)
                code = 5 * phase_code(on_1, mode_1) + phase_code(on_2, mode_2)
                rows = log_phase(log, rows, code, before[ZN1], before[ZN2], mid, V, P_1, P_2)
                copy(mid, before, N_Z)
        P_1, P_2, _, _, _ = impulses_between(dm, z, before, V)
        code = 5 * phase_code(on_1, modes[0]) + phase_code(on_2, modes[1])
        rows = log_phase(log, rows, code, before[ZN1], before[ZN2], z, V, P_1, P_2)
    P_1, P_2, A, B_1, B_2 = impulses_between(dm, z, start, V)
    state[N1], state[N2] = z[ZN1] * V, z[ZN2] * V
    state[CA] += A / dm.m
    state[WB] = (state[N2] - state[N1]) / (2.0 * dm.h)
    p, q = levers(dm, -1.0, 0.0, 1.0), levers(dm, 1.0, 0.0, 1.0)
    apply_impulse(dm, state, p, 0.0, 0.0, B_1)
    apply_impulse(dm, state, q, 0.0, 0.0, B_2)
    return status, rows


@compiled
def phase_code(on, mode):
    """Digit of the contact state of an end in an impact phase: b_i is set where the end acts."""
    return int(mode) + (IMPACT if on else FREE)


@compiled
def settle_event(law, event, z, compressing, left):
    """Make the outcome of an event exact: the function that vanished is zero, at both ends if they move alike.

    The other end may have passed an event of its own in the same rounding: what its state says then holds for it too.
    """
    i = event % 2
    j = 1 - i
    if event < 2:
        if z[ZN1 + j] == z[ZN1 + i] and compressing[j] == compressing[i]:
            z[ZN1 + j] = 0.0
            turn(law, j, z, compressing, left)
        z[ZN1 + i] = 0.0
        turn(law, i, z, compressing, left)
    elif event < 4:
        if z[ZX1 + j] == z[ZX1 + i] and compressing[j] == compressing[i]:
            z[ZX1 + j], compressing[j] = 0.0, 1.0
        z[ZX1 + i] = 0.0
        compressing[i] = 1.0
    elif event >= 6:
        z[ZB1 + j] = 0.0 if z[ZB1 + j] == z[ZB1 + i] else z[ZB1 + j]
        z[ZB1 + i] = 0.0
        z[ZA] = 0.0
    if z[ZX1 + j] > 0.0 and z[ZN1 + j] * compressing[j] > 0.0:
        turn(law, j, z, compressing, left)
    elif z[ZX1 + j] <= 0.0 and compressing[j] < 0.0:
        z[ZX1 + j], compressing[j] = 0.0, 1.0


@compiled
def follow_acceleration(law, z, modes, compressing, left, rates):
    """An end with compression left whose gap rate is exactly zero goes where its acceleration says.

    Returns whether an end without restitution has lost its energy so, and the phase with it.
    """
    gone = False
    for i in range(2):
        if z[ZN1 + i] == 0.0 and z[ZX1 + i] > 0.0:
            impact_rates(law, modes, compressing, PLAIN, z, rates)
            if rates[ZN1 + i] * compressing[i] > 0.0:
                turn(law, i, z, compressing, left)
                gone = gone or z[ZX1 + i] == 0.0
    return gone


@compiled
def turn(law, i, z, compressing, left):
    """End i passes from compression to restitution or back; its energy is lost where it is not worth the gap rate `left`."""
    compressing[i] = -compressing[i]
    e = law.e_1 if i == 0 else law.e_2
    if e * max(0.0, z[ZX1 + i]) ** 1.25 <= left:
        z[ZX1 + i] = 0.0
        compressing[i] = 1.0


@compiled
def single_end_phase(dm, pair, i, z, modes, compressing, slip_tol, before, mid, work):
    """Phase of a double impact in which only end i acts; z, modes and the direction of compression in place.

    Returns
    -------
    halts : bool
        Whether end i slipped first and stuck then; the velocities at that moment are in `mid`.
    reason : int
    """
    s = -1.0 if i == 0 else 1.0
    law = end_law(dm, s, 1.0, 0.0, 1.0, pair.e_1 if i == 0 else pair.e_2, dm.mu, dm.mu_s)
    j = 1 - i
    n, a, b, E, n_j, P, _, B, P_s, A_s, mode, reason = single_phase(
        law, z[ZN1 + i], z[ZA], z[ZB1 + i], stored_energy(z[ZX1 + i]), z[ZN1 + j], slip_tol, work
    )
    z[ZN1 + i], z[ZA], z[ZB1 + i], z[ZX1 + i], z[ZN1 + j] = n, a, b, compression(E), n_j
    z[ZB1 + j] += pair.bb_12 * B
    compressing[i] = 1.0 if n < 0.0 or E == 0.0 else -1.0
    compressing[j] = 1.0
    modes[i] = mode
    modes[j] = STICK if length(z[ZA], z[ZB1 + j]) <= slip_tol else SLIP
    halts = mode == STICK and 0.0 < P_s < P
    if halts:
        copy(before, mid, N_Z)
        mid[ZN1 + i] += law.nn * P_s + law.na * A_s
        mid[ZN1 + j] += law.nn_j * P_s + law.na_j * A_s
        mid[ZA], mid[ZB1 + i] = 0.0, 0.0
        mid[ZB1 + j] -= pair.bb_12 * before[ZB1 + i] / law.bb
    return halts, reason
