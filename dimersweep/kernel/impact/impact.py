"""Follow an impact from its first touch to its last, phase by phase.

A phase has the same ends acting throughout. The impulses change the velocities of the body by (5).
"""

from math import copysign
from typing import Any, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.compiler.records import Row
from dimersweep.kernel.impact.double_equations import (
    N_Z,
    PLAIN_CLOCK,
    ZA,
    ZB1,
    ZB2,
    ZN1,
    ZN2,
    ZS1,
    ZS2,
    ZX1,
    ZX2,
    compression,
    friction_modes,
    impact_rates,
    stored_energy,
)
from dimersweep.kernel.impact.double_leg import OUT_OF_LEG_STEPS, LegArrays, double_leg
from dimersweep.kernel.impact.single_impact import OTHER, EndLaw, begin_blow, single_phase
from dimersweep.kernel.model.body import (
    attitude,
    contact_velocity,
    delassus,
    end,
    lateral_impulses,
    level_levers,
    levers,
    rise_of_centre,
    slip_rounding,
)
from dimersweep.kernel.model.contact_code import coded, impact_digit
from dimersweep.kernel.model.event_row import log_phase, log_single
from dimersweep.kernel.model.friction import hit, holds_axially, slip_force
from dimersweep.kernel.model.layout import CA, CB, DIP, IMPACT, IMPACT_STEPS, N1, N2, OK, SLIP, SPIN, STICK, WB, WP
from dimersweep.kernel.model.works import note_struck
from dimersweep.kernel.numerics.elementary import length, raised
from dimersweep.kernel.numerics.meter import charge
from dimersweep.kernel.numerics.steps import copy

# switches between two ends at most: a series that `LEFT_OVER` ends long before
MAX_PHASES = 2000
PHASE_COST = 1.0  # work of a phase of an impact at both ends besides its steps, in hops of one end
# approach, in tolerances, below which an end is not loaded: it ends the series of switches between two ends at small e
LEFT_OVER = 1e-3
FINEST = 1e-13  # least approach, in V, and least tolerance of a leg: what round-off allows
# tolerance of the integrator of a double impact, in units of the tolerance of the impact: the errors of its steps add
# up
DOUBLE_TOL = 0.2
NO_REBOUND = 0.1  # rebound that counts as none, in units of the tolerance of the impact
LEAST_SLIP = 1e-12  # least slip, in units of V, that the integrator can still follow when it sets out from rest
IMPACT_SLIP_SCALE = 0.1  # slip that counts as none, in units of the tolerance of the impact


class ImpactArrays:
    """Arrays that an impact at both ends works on."""

    leg: LegArrays
    z: Row  # see `DoubleImpact`
    start: Row
    before: Row
    mid: Row
    compressing: Row
    e: Row


class DoubleImpact(NamedTuple):
    """Impact at both ends on its way; velocities in units of the approach speed V."""

    dm: Any
    modes: Any  # friction modes of both ends
    V: float  # approach speed [m/s]
    slip_tol: float  # slip that counts as none [V]
    left: float  # gap rate that counts as none [V]; `least`: the compression that is worth as much
    least: float
    z: Any  # contact velocities and compressions
    start: Any  # contact velocities and compressions before the impact
    before: Any  # the same before the phase
    mid: Any  # the same at the moment within the phase at which a slip ended
    compressing: Any  # for each end 1.0 in compression, -1.0 in restitution
    e: Any  # restitution of both ends


@compiled
def restitution(p, V, tol):
    """Return the coefficient of restitution of an end in an impact with the approach speed V [m/s].

    It is 0 where the rebound is far below the tolerance: e is the time scale of restitution, which would be too short.
    For slow impacts it must come to p.e, with which the end of a chatter is summed.
    """
    return p.e if p.e > NO_REBOUND * tol else 0.0


@compiled
def end_law(dm, i, both, sin_b, cos_b, e):
    """Return the law of an impact at end i with its restitution e; `both` is 1.0 if the other end is closed, else 0."""
    p = end(dm, i)
    own, other = levers(p, sin_b, cos_b), levers(end(dm, 1 - i), sin_b, cos_b)
    w, wj = delassus(dm, own, own), delassus(dm, other, own)
    m = dm.m
    return EndLaw(m * w.nn, m * w.na, m * w.aa, m * w.bb, m * wj.nn, m * wj.na, both, e, p.mu_hit, p.mu_s)


@compiled
def is_loaded(d, i):
    """Return True if end i is compressed or approaches the plate.

    It must be by more than the gap rate `left`, or the compression `least` that is worth as much.
    """
    X, n = d.z[ZX1 + i], d.z[ZN1 + i]
    # the last case: an end of little compression that moves out still takes part, until it is out of compression
    return n < -d.left or d.least < X or (X > 0.0 and n > d.left)


@compiled
def acts(d, i):
    """Return True if end i acts now or is about to act.

    It acts if it is loaded, or if the force at the other end drives it from rest towards the plate. At rest and
    uncompressed, an end is driven by the other end alone, with the friction of that end.
    """
    if is_loaded(d, i):
        return True
    z, j = d.z, 1 - i
    if z[ZN1 + i] > 0.0 or not is_loaded(d, j):
        return False
    w, other = d.dm.pair, end(d.dm, j)
    na_i, na_j = (w.na_1, w.na_2) if i == 0 else (w.na_2, w.na_1)
    # tau is the axial impulse at the other end per normal impulse there: of its slip, of its stick, or of slip out of
    # rest
    v = length(z[ZA], z[ZB1 + j])
    if v > d.slip_tol:
        friction, _ = slip_force(other.mu_hit, 1.0, z[ZA], 0.0)
        tau = friction / v
    else:
        tau = -na_j / w.aa if holds_axially(other.mu_s, na_j, w.aa) else -copysign(other.mu_hit, na_j)
    return w.nn_12 + na_i * tau < 0.0


@compiled
def single_impact(dm, state, i, V, tol, work, log):
    """Resolve an impact at end i while the other end is off the plate; the state is updated.

    Returns
    -------
    status, mode, rows : int
        OK or the status of an impact that could not go on; STICK or SLIP at its end; number of rows in the log.
    """
    p, (sin_b, cos_b) = end(dm, i), attitude(dm, state[DIP])
    n, a, b = contact_velocity(dm, state, i)
    hit(p, length(a, b))
    law = end_law(dm, i, 0.0, sin_b, cos_b, restitution(p, V, tol))
    slip_tol = max(IMPACT_SLIP_SCALE * tol, slip_rounding(dm, state) / V)
    blow = work.course[0].blow
    begin_blow(blow, n / V, a / V, b / V, 0.0, 0.0)
    status = single_phase(law, blow, slip_tol, work)
    if status != OK:
        return status, blow.mode, 0
    P, A, B, P_s, A_s, mode = blow.P, blow.A, blow.B, blow.P_s, blow.A_s, blow.mode
    lv, lj = levers(p, sin_b, cos_b), levers(end(dm, 1 - i), sin_b, cos_b)
    wj = delassus(dm, lj, lv)
    unit, other = dm.m * V, N2 - i
    state[N1 + i] = blow.n * V
    state[other] += unit * (wj.nn * P + wj.na * A)
    apply_impulse(dm, state, lv, unit * P, unit * A, unit * B)
    wanted = work.course[0].tally.wanted
    rows, n_j = 0, state[other] - unit * (wj.nn * P + wj.na * A)
    if mode == STICK and P_s > 0.0:
        n_s, n_js = n + V * (law.nn * P_s + law.na * A_s), n_j + unit * (wj.nn * P_s + wj.na * A_s)
        if wanted:
            note_single(work, rows, i, V, unit, (P_s, A_s, B), True)
        rows = log_single(log, rows, i, IMPACT + SLIP, (n, n_j, n_s, n_js), unit * P_s, (0.0, 0.0))
        n, n_j, P, A, B = n_s, n_js, P - P_s, A - A_s, 0.0
    if wanted:
        note_single(work, rows, i, V, unit, (P, A, B), False)
    rates, slip = (n, n_j, state[N1 + i], state[other]), (blow.a * V, blow.b * V)
    rows = log_single(log, rows, i, IMPACT + mode, rates, unit * P, slip)
    return OK, mode, rows


@compiled
def note_single(work, row, i, V, unit, impulses, slipping):
    """Note the works of a phase at end i alone, and its impulses (normal, axial, lateral)."""
    P, A, B = impulses
    rest, slip = works_of_one(i, work.course[0].blow, slipping)
    P_1, B_1, P_2, B_2 = (P, B, 0.0, 0.0) if i == 0 else (0.0, 0.0, P, B)
    note_struck(work, row, unit * V, rest, slip, (unit * P_1, unit * P_2, unit * A, unit * B_1, unit * B_2))


@compiled
def works_of_one(i, blow, slipping):
    """Return the works of restitution and of slip at both ends, where end i alone acts.

    They are those up to the moment at which it sticks, if it is `slipping`; else those that are left. They are taken
    off `blow`.
    """
    rest, slip = blow.rest_s if slipping else blow.rest, blow.slip
    blow.rest, blow.slip = blow.rest - rest, 0.0
    return ((rest, 0.0), (slip, 0.0)) if i == 0 else ((0.0, rest), (0.0, slip))


@compiled
def apply_impulse(dm, state, lv, P, A, B):
    """Add impulses at an end with the given levers to the velocities of the body (gap rates apart), by (5)."""
    state[CA] += A / dm.m
    state[CB] += B / dm.m
    state[WB] += (lv.n * P + lv.a * A) / dm.J_t
    state[WP] += lv.b * B / dm.J_t
    state[SPIN] += lv.c * B / dm.J_a


@compiled
def begin_double(d, state, tol):
    """Set contact velocities at a double contact, in units of V, and the restitution of both ends; no compression."""
    dm, z, V = d.dm, d.z, d.V
    z[ZN1], z[ZN2] = state[N1] / V, state[N2] / V
    z[ZX1], z[ZX2] = 0.0, 0.0
    _, a, b_1 = contact_velocity(dm, state, 0)
    _, _, b_2 = contact_velocity(dm, state, 1)
    z[ZA], z[ZB1], z[ZB2] = a / V, b_1 / V, b_2 / V
    copy(z, d.start, N_Z)
    d.compressing[0], d.compressing[1] = 1.0, 1.0
    d.e[0], d.e[1] = restitution(dm.p1, V, tol), restitution(dm.p2, V, tol)
    hit(dm.p1, length(a, b_1))
    hit(dm.p2, length(a, b_2))


@compiled
def impulses_between(d, start, z):
    """Return the impulses that lead from the contact velocities `start` to z [kg m/s].

    They are the normal impulses P_1, P_2, the axial sum A and the lateral impulses B_1, B_2.
    """
    dm, V = d.dm, d.V
    p, q = level_levers(dm)
    d_n1, d_n2 = (z[ZN1] - start[ZN1]) * V, (z[ZN2] - start[ZN2]) * V
    d_w = (d_n2 - d_n1) / (q.n - p.n)
    A = dm.m * ((z[ZA] - start[ZA]) * V - p.a * d_w)
    push, moment = dm.m * rise_of_centre(dm, d_n1, d_n2), dm.J_t * d_w - p.a * A
    P_1, P_2 = (q.n * push - moment) / (q.n - p.n), (moment - p.n * push) / (q.n - p.n)
    unit = dm.m * V
    B_1, B_2 = lateral_impulses(dm, (z[ZB1] - start[ZB1]) * unit, (z[ZB2] - start[ZB2]) * unit)
    return P_1, P_2, A, B_1, B_2


@compiled
def double_impact(dm, state, V, tol, modes, work, log):
    """Resolve an impact with both ends on the plate; the state and the friction modes of the ends are updated.

    Returns
    -------
    status, rows : int
        OK or the status of an impact that could not go on; number of rows in the log.
    """
    slip_tol = max(max(IMPACT_SLIP_SCALE * tol, LEAST_SLIP), slip_rounding(dm, state) / V)
    left, leg_tol = max(LEFT_OVER * tol, FINEST), max(DOUBLE_TOL * tol, FINEST)
    # the root of E, which goes with X^(eta + 1), is worth a gap rate
    least = raised(left, 2.0 / (dm.eta + 1.0))
    b = work.impact[0]
    z, start, before, mid, compressing = b.z, b.start, b.before, b.mid, b.compressing
    d = DoubleImpact(dm, modes, V, slip_tol, left, least, z, start, before, mid, compressing, b.e)
    begin_double(d, state, tol)
    wanted, blow = work.course[0].tally.wanted, work.course[0].blow
    rows, status, hold_ended = 0, IMPACT_STEPS, False
    for _ in range(MAX_PHASES):
        charge(work.meter, PHASE_COST)
        for i in range(2):
            # an end that is not loaded has no compression left, and would begin with compression again
            if not is_loaded(d, i):
                z[ZX1 + i], compressing[i] = 0.0, 1.0
        on_1, on_2 = acts(d, 0), acts(d, 1)
        if not on_1 and not on_2:
            z[ZN1], z[ZN2] = max(0.0, z[ZN1]), max(0.0, z[ZN2])
            status = OK
            break
        copy(z, before, N_Z)
        works = (0.0, 0.0), (0.0, 0.0)
        if on_1 and on_2:
            friction_modes(dm, z, modes, slip_tol, hold_ended)
            if follow_acceleration(d):
                continue
            event = double_leg(d, leg_tol, work)
            if event == OUT_OF_LEG_STEPS:
                break
            if wanted:
                works = (rest_work(d, 0), rest_work(d, 1)), (z[ZS1], z[ZS2])
            # events 4 and 5: a hold is lost (`double_leg.event_value`)
            hold_ended = 4 <= event < 6
            settle_event(d, event)
        else:
            i = 0 if on_1 else 1
            reason, hold_ended = single_end_phase(d, i, work), False
            if reason != OK and reason != OTHER:
                status = reason
                break
            if blow.mode == STICK and 0.0 < blow.P_s < blow.P:
                other_mode = SLIP if length(before[ZA], before[ZB2 - i]) > slip_tol else STICK
                mode_1, mode_2 = (SLIP, other_mode) if i == 0 else (other_mode, SLIP)
                code = coded(impact_digit(on_1, mode_1), impact_digit(on_2, mode_2))
                rows = note_phase(d, mid, code, works_of_one(i, blow, True), rows, work, log)
                copy(mid, before, N_Z)
            works = works_of_one(i, blow, False)
        code = coded(impact_digit(on_1, modes[0]), impact_digit(on_2, modes[1]))
        rows = note_phase(d, z, code, works, rows, work, log)
    _, _, A, B_1, B_2 = impulses_between(d, start, z)
    state[N1], state[N2] = z[ZN1] * V, z[ZN2] * V
    state[CA] += A / dm.m
    p, q = level_levers(dm)
    state[WB] = (state[N2] - state[N1]) / (q.n - p.n)
    apply_impulse(dm, state, p, 0.0, 0.0, B_1)
    apply_impulse(dm, state, q, 0.0, 0.0, B_2)
    return status, rows


@compiled
def rest_work(d, i):
    """Return the work of the normal impulse at end i over a leg.

    It is the loss of the stored energy, times e^2 in restitution.
    """
    released = stored_energy(d.dm, i, d.before[ZX1 + i]) - stored_energy(d.dm, i, d.z[ZX1 + i])
    return released if d.compressing[i] > 0.0 else d.e[i] * d.e[i] * released


@compiled
def note_phase(d, z, code, works, rows, work, log):
    """Note a phase of a double impact that ends at z; return the number of rows in the log.

    `code` is its contact state, and `works` are its works of restitution and of slip.
    """
    impulses, V = impulses_between(d, d.before, z), d.V
    if work.course[0].tally.wanted:
        note_struck(work, rows, d.dm.m * V * V, works[0], works[1], impulses)
    rates = d.before[ZN1] * V, d.before[ZN2] * V, z[ZN1] * V, z[ZN2] * V
    slips = z[ZA] * V, z[ZB1] * V, z[ZA] * V, z[ZB2] * V
    return log_phase(log, rows, code, rates, (impulses[0], impulses[1]), slips)


@compiled
def settle_event(d, event):
    """Make the state after an event exact: the function that vanished is zero, at both ends if they move alike.

    The other end may have passed an event of its own within the same rounding. Then it is turned to compression or
    restitution as its gap rate and its compression demand.
    """
    z, compressing, i = d.z, d.compressing, event % 2
    j = 1 - i
    # 0 and 1: a gap rate is zero; 2 and 3: an end is out of compression; 6 and 7: a slip is zero. 4 and 5 (a hold is
    # lost) leave the state as it is
    if event < 2:
        if z[ZN1 + j] == z[ZN1 + i] and compressing[j] == compressing[i]:
            z[ZN1 + j] = 0.0
            turn(d, j)
        z[ZN1 + i] = 0.0
        turn(d, i)
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
        turn(d, j)
    elif z[ZX1 + j] <= 0.0 and compressing[j] < 0.0:
        z[ZX1 + j], compressing[j] = 0.0, 1.0


@compiled
def follow_acceleration(d):
    """Turn each compressed end whose gap rate is exactly zero to where its acceleration leads.

    Return True if an end without restitution has so lost its energy, which ends the phase.
    """
    z, rates, gone = d.z, d.mid, False
    for i in range(2):
        if z[ZN1 + i] == 0.0 and z[ZX1 + i] > 0.0:
            impact_rates(d.dm, d.modes, d.compressing, PLAIN_CLOCK, z, rates)
            if rates[ZN1 + i] * d.compressing[i] > 0.0:
                turn(d, i)
                gone = gone or z[ZX1 + i] == 0.0
    return gone


@compiled
def turn(d, i):
    """Turn end i from compression to restitution or back.

    Its energy is lost where it is worth no more than the gap rate `left`.
    """
    d.compressing[i] = -d.compressing[i]
    # the energy goes with X^(eta + 1), and its root, times e, is the gap rate that the rebound comes to
    if d.e[i] * raised(max(0.0, d.z[ZX1 + i]), 0.5 * (d.dm.eta + 1.0)) <= d.left:
        d.z[ZX1 + i] = 0.0
        d.compressing[i] = 1.0


@compiled
def single_end_phase(d, i, work):
    """Follow the phase of a double impact in which only end i acts.

    The state, the modes and the direction of compression become those after it. Where the end first slipped and then
    stuck, the velocities at that moment are written into `mid`. Return OK, OTHER, or the status if the phase cannot go
    on.
    """
    dm, z, mid, j = d.dm, d.z, d.mid, 1 - i
    law, blow = end_law(dm, i, 1.0, dm.sin_0, dm.cos_0, d.e[i]), work.course[0].blow
    begin_blow(blow, z[ZN1 + i], z[ZA], z[ZB1 + i], stored_energy(dm, i, z[ZX1 + i]), z[ZN1 + j])
    status = single_phase(law, blow, d.slip_tol, work)
    z[ZN1 + i], z[ZA], z[ZB1 + i], z[ZX1 + i] = blow.n, blow.a, blow.b, compression(dm, i, blow.E)
    z[ZN1 + j] = blow.n_j
    z[ZB1 + j] += dm.pair.bb_12 * blow.B
    d.compressing[i] = 1.0 if blow.n < 0.0 or blow.E == 0.0 else -1.0
    d.compressing[j] = 1.0
    d.modes[i] = blow.mode
    d.modes[j] = STICK if length(z[ZA], z[ZB1 + j]) <= d.slip_tol else SLIP
    copy(d.before, mid, N_Z)
    mid[ZN1 + i] += law.nn * blow.P_s + law.na * blow.A_s
    mid[ZN1 + j] += law.nn_j * blow.P_s + law.na_j * blow.A_s
    mid[ZA], mid[ZB1 + i] = 0.0, 0.0
    mid[ZB1 + j] -= dm.pair.bb_12 * d.before[ZB1 + i] / law.bb
    return status
