"""The contact mode of ends that rest on the plate: which stay closed, which stick, which slip, by enumeration.

Of an end at rest on the plate (3) holds between its normal force and the acceleration of its gap, and (4) says whether
friction can hold it. A mode fits if the forces that go with it do.
"""

from math import copysign

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    YDIP,
    YS,
    YTHETA,
    YTIME,
    YUA,
    YUB,
    YWB,
    YWP,
    give_impulses,
    leading,
    put_slip,
    put_slips,
    slip_of,
)
from dimersweep.kernel.contact.events import end_of, is_hold_lost, is_lift_off, slip_limit
from dimersweep.kernel.contact.forces import A1, A2, COMPLIANCE, F1, F2, L1, L2, contact_rates, hold_reserve
from dimersweep.kernel.contact.slip_onset import pair_onset, slip_onset
from dimersweep.kernel.model.body import apart_sideways, extent
from dimersweep.kernel.model.friction import axial_left_of_pair, hold_left, lateral_at_limit
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.numerics.elementary import length

CLOSED, SEPARATES, INCONSISTENT = 0, 1, 2
NO_FORCE = 1e-12  # force, in units of the weight, whose sign a moment later decides
MOMENT = 1e-6  # of the plate's phase
ROUNDED_SLIP = 2e-15  # slip that is rounding, in units of the speeds it is a difference of
# slip with which two ends set out, in units of the one that counts as none: steps resolve it, and its direction bears rounding
PAIR_SPEED = 10.0
ROUNDED_HOLD = 1e-9  # lateral hold that is rounding, in units of what is left along the axis
AT_LIMIT = 1e-6  # deceleration, in units of gravity, that is none


@compiled
def single_mode(dm, i, phase, y, modes, slip_tol, lost, dy, F):
    """Mode of the one closed end i into modes; y gets the slip that goes with it.

    It sticks where the friction can hold it, or leaves where nothing drives it into the plate, or else slips. At rest one
    of these always fits (so does a slip out of rest, doi 10.1115/1.4035411). While it slips, none does where the friction
    would press it into the plate the more, the more the plate pressed back (Painleve): an impact without collision follows,
    which ends the slip, or turns it to where its force fits. Such a slip that nothing drives into the plate could also be
    kept by a force, but by an unstable one: it leaves (Champneys and Varkonyi, arXiv:1601.03545).

    Parameters
    ----------
    slip_tol : float
        Slip that counts as none [m/s].
    lost : bool
        The hold at rest has just been lost.

    Returns
    -------
    int
        CLOSED, SEPARATES, or INCONSISTENT when no force satisfies the law (Painleve: only an impact can follow).
    """
    modes[0], modes[1] = FREE, FREE
    slips = length(y[YUA], y[YUB]) > slip_tol
    mode = SLIP if slips else STICK
    modes[i] = mode
    if not slips:
        put_slip(dm, modes, y, i, 0.0, 0.0)
    contact_rates(dm, modes, phase, y, False, dy, F)
    if not slips and is_compressive(dm, modes, i, phase, y, dy, F):
        faint = F[F1 + 3 * i] <= NO_FORCE * dm.m * dm.g
        if faint or (not lost and hold_reserve(dm, modes, i, F) >= 0.0):
            return CLOSED
    if not is_driven_in(dm, modes, i, phase, y, dy, F):
        modes[i] = FREE
        return SEPARATES
    modes[i] = mode
    contact_rates(dm, modes, phase, y, False, dy, F)
    if (slips or start_slip(dm, phase, y, modes, i, slip_tol, dy, F)) and is_compressive(dm, modes, i, phase, y, dy, F):
        return CLOSED
    modes[i] = FREE
    return INCONSISTENT


@compiled
def is_compressive(dm, modes, i, phase, y, dy, F):
    """Whether the force F at end i points outward; where it is only rounding, whether it does a moment later."""
    force = F[F1 + 3 * i]
    if abs(force) > NO_FORCE * dm.m * dm.g:
        return force > 0.0
    return comes_back(dm, modes, i, phase, y, dy, F)


@compiled
def comes_back(dm, modes, i, phase, y, dy, F):
    """Whether the force at end i, which has just vanished, is positive a moment later."""
    later = force_later(dm, modes, i, phase, y, dy, F) > 0.0
    contact_rates(dm, modes, phase, y, False, dy, F)
    return later


@compiled
def force_later(dm, modes, i, phase, y, dy, F):
    """Normal force at end i a moment after the state y, which goes on at its rates dy; dy and F are of that moment then.

    A slip that would come to rest within the moment is followed half the way.
    """
    dip, w_b, w_p, spin, u_a, u_b, theta = y[YDIP], y[YWB], y[YWP], y[YS], y[YUA], y[YUB], y[YTHETA]
    t = min(MOMENT / dm.omega, 0.5 * slip_limit(dm, modes, y, dy))
    for k in range(YTIME):
        y[k] += t * dy[k]
    if u_a == 0.0 and u_b == 0.0:  # an end that sticks, or one that is asked of without friction
        y[YUA], y[YUB] = 0.0, 0.0
    contact_rates(dm, modes, phase + dm.omega * t, y, False, dy, F)
    y[YDIP], y[YWB], y[YWP], y[YS], y[YUA], y[YUB], y[YTHETA] = dip, w_b, w_p, spin, u_a, u_b, theta
    return F[F1 + 3 * i]


@compiled
def is_driven_in(dm, modes, i, phase, y, dy, F):
    """Whether end i, the leading one of y, would go into the plate without a contact force (friction vanishes at no slip)."""
    u_a, u_b = y[YUA], y[YUB]
    y[YUA], y[YUB] = 0.0, 0.0
    modes[0], modes[1] = FREE, FREE
    modes[i] = SLIP
    contact_rates(dm, modes, phase, y, False, dy, F)
    answer = is_compressive(dm, modes, i, phase, y, dy, F)
    y[YUA], y[YUB] = u_a, u_b
    return answer


@compiled
def double_mode(dm, phase, y, modes, slip_tol, lost, dy, F):
    """Friction modes with both ends on the plate into modes, and the forces into F; y gets the slips that go with them."""
    rest_1 = length(y[YUA], y[YUB]) <= slip_tol
    rest_2 = length(y[YUA], y[YUB] - apart_sideways(dm, y[YWP], y[YS])) <= slip_tol
    modes[0] = STICK if rest_1 else SLIP
    modes[1] = STICK if rest_2 else SLIP
    if rest_1:
        put_slip(dm, modes, y, 0, 0.0, 0.0)
    if rest_2:
        put_slip(dm, modes, y, 1, 0.0, 0.0)
    contact_rates(dm, modes, phase, y, False, dy, F)
    if rest_1 and rest_2:
        if lost or hold_reserve(dm, modes, 0, F) < 0.0:
            start_slips(dm, phase, y, modes, slip_tol, dy, F)
    elif rest_1 and (lost or hold_reserve(dm, modes, 0, F) < 0.0):
        start_beside(dm, phase, y, modes, 0, slip_tol, dy, F)
    elif rest_2 and (lost or hold_reserve(dm, modes, 1, F) < 0.0):
        start_beside(dm, phase, y, modes, 1, slip_tol, dy, F)
    contact_rates(dm, modes, phase, y, False, dy, F)


@compiled
def start_slips(dm, phase, y, modes, slip_tol, dy, F):
    """Both ends at rest and not both held: an end whose lateral hold is exceeded slips laterally, if the other one is held
    then; else both slip.

    Two ends whose axial hold is exceeded are at their limits, and each sets out against the force that held it. Its lateral
    part is known, and its axial part is what the limit leaves; the axial slip of both is one.
    """
    # a loss is found to rounding: an end whose lateral hold has ended may come with a last rest of it
    rest = ROUNDED_HOLD * max(axial_left_of_pair(dm.p1.mu_h, F[F1], F[L1], dm.p2.mu_h, F[F2], F[L2], F[A1]), 0.0)
    over_1 = hold_left(dm.p1.mu_h, F[F1], 0.0, F[L1]) <= rest
    over_2 = hold_left(dm.p2.mu_h, F[F2], 0.0, F[L2]) <= rest
    small = 0.5 * slip_tol
    if not over_1 and not over_2:
        modes[0], modes[1] = SLIP, SLIP
        side = -copysign(1.0, F[A1])
        b_1 = -side * lateral_at_limit(dm.p1.mu_h, F[F1], F[L1])
        b_2 = -side * lateral_at_limit(dm.p2.mu_h, F[F2], F[L2])
        pair_onset(dm, modes, phase, y, PAIR_SPEED * slip_tol, side, b_1, b_2, dy, F)
        return
    b_1, b_2 = -copysign(small, F[L1]), -copysign(small, F[L2])
    if not over_1 or not over_2:
        modes[0], modes[1] = SLIP if over_1 else STICK, SLIP if over_2 else STICK
        put_slips(dm, y, 0.0, b_1 if over_1 else 0.0, b_2 if over_2 else 0.0)
        contact_rates(dm, modes, phase, y, False, dy, F)
        if hold_reserve(dm, modes, 1 if over_1 else 0, F) >= 0.0:
            return
    slip_together(dm, phase, y, modes, b_1, b_2, slip_tol, dy, F)


@compiled
def slip_together(dm, phase, y, modes, b_1, b_2, slip_tol, dy, F):
    """Both ends slip out of rest, near the direction of the accelerations which they have with the lateral slips b_1, b_2."""
    modes[0], modes[1] = SLIP, SLIP
    put_slips(dm, y, 0.0, b_1, b_2)
    contact_rates(dm, modes, phase, y, False, dy, F)
    a, a_1 = slip_of(dm, modes, dy, 0)
    _, a_2 = slip_of(dm, modes, dy, 1)
    if abs(a) > AT_LIMIT * max(abs(a_1), abs(a_2)):
        pair_onset(dm, modes, phase, y, PAIR_SPEED * slip_tol, copysign(1.0, a), a_1 / a, a_2 / a, dy, F)


@compiled
def start_beside(dm, phase, y, modes, i, slip_tol, dy, F):
    """End i begins to slip beside one that slips. Where that one hardly does, and would be turned back, both set out together
    if neither can be held.
    """
    u_a, u_b, w_p = y[YUA], y[YUB], y[YWP]
    start_slip(dm, phase, y, modes, i, slip_tol, dy, F)
    contact_rates(dm, modes, phase, y, False, dy, F)
    a, b = slip_of(dm, modes, y, 1 - i)
    d_a, d_b = slip_of(dm, modes, dy, 1 - i)
    if a * d_a + b * d_b >= 0.0 or length(a, b) > 2.0 * PAIR_SPEED * slip_tol:
        return
    modes[0], modes[1] = STICK, STICK
    put_slips(dm, y, 0.0, 0.0, 0.0)
    contact_rates(dm, modes, phase, y, False, dy, F)
    if hold_reserve(dm, modes, 0, F) < 0.0:
        start_slips(dm, phase, y, modes, slip_tol, dy, F)
    if modes[0] == STICK or modes[1] == STICK:
        modes[i], modes[1 - i] = STICK, SLIP
        y[YUA], y[YUB], y[YWP] = u_a, u_b, w_p
        contact_rates(dm, modes, phase, y, False, dy, F)
        start_slip(dm, phase, y, modes, i, slip_tol, dy, F)


@compiled
def start_slip(dm, phase, y, modes, i, slip_tol, dy, F):
    """End i, held by the forces F, begins to slip, with the rates and forces in dy, F; returns whether it can.

    At the limit slip may have no acceleration yet: it sets out against the force that held.
    """
    hold_a = F[A1] if modes[0] != FREE else F[A2]
    hold_b = F[L1] if i == 0 else F[L2]
    small, hold = 0.5 * slip_tol, length(hold_a, hold_b)
    modes[i] = SLIP
    if slip_onset(dm, modes, i, phase, y, small, hold_a, hold_b, dy, F):
        return True
    put_slip(dm, modes, y, i, -small * hold_a / hold, -small * hold_b / hold)
    contact_rates(dm, modes, phase, y, False, dy, F)
    a, b = slip_of(dm, modes, dy, i)
    return a * hold_a + b * hold_b <= AT_LIMIT * dm.g * hold


@compiled
def lead_with(dm, i, u_a, u_b, w_p, y):
    """Have y hold the slip of end i, with both ends on the plate, where p1 slips by (u_a, u_b) and theta' cos(beta) is w_p."""
    y[YUA], y[YWP] = u_a, w_p
    y[YUB] = u_b - i * apart_sideways(dm, w_p, y[YS])


@compiled
def contact_mode(dm, closed_1, closed_2, phase, y, modes, slip_tol, event, dy, F):
    """Which of the closed ends stay closed, and in which friction modes, into modes (y with p1 leading if it is closed).

    `event` is the number of what has just ended the last contact phase (`events`), NO_EVENT if nothing has: rounding may
    leave a little of a hold that was lost, or of a force that has vanished.

    With both ends on the plate the double contact is tried first, then each end alone where its force points outward. At a
    negative compliance the double contact is no answer even where both forces point outward: the least difference between
    the ends grows, and drives off the one with the greater force, or the one that nothing drives into the plate.

    All modes are judged at the spin of the given state, so that the forces of each agree even near zero. A slip that the mode
    found sets or takes away then comes about by impulses; one that is only rounding needs none, so that a run goes on from a
    stored state to the same bits.

    Returns
    -------
    int
        CLOSED, SEPARATES or INCONSISTENT.
    """
    u_b, w_p = y[YUB], y[YWP]
    if not (closed_1 and closed_2):
        answer = single_mode(dm, 0 if closed_1 else 1, phase, y, modes, slip_tol, is_hold_lost(event), dy, F)
    else:
        answer = mode_of_pair(dm, phase, y, modes, slip_tol, event, dy, F)
        if answer == CLOSED:
            u_b -= leading(modes) * apart_sideways(dm, w_p, y[YS])
    if answer == CLOSED:
        r, h = extent(dm)
        size = abs(y[YUA]) + abs(u_b) + r * abs(y[YS]) + h * (abs(y[YWB]) + abs(w_p))
        if abs(y[YUB] - u_b) + h * abs(y[YWP] - w_p) > ROUNDED_SLIP * size:
            give_impulses(dm, modes, y, u_b, w_p)
    return answer


@compiled
def mode_of_pair(dm, phase, y, modes, slip_tol, event, dy, F):
    """`contact_mode` with both ends on the plate."""
    u_a, u_b, w_p = y[YUA], y[YUB], y[YWP]
    double_mode(dm, phase, y, modes, slip_tol, is_hold_lost(event), dy, F)
    held = modes[0] == STICK and modes[1] == STICK
    on_1, on_2 = is_compressive(dm, modes, 0, phase, y, dy, F), is_compressive(dm, modes, 1, phase, y, dy, F)
    if on_1 and on_2 and is_lift_off(event) and not comes_back(dm, modes, end_of(event), phase, y, dy, F):
        on_1, on_2 = end_of(event) == 1, end_of(event) == 0
    stays = 0 if on_1 else 1
    if F[COMPLIANCE] < 0.0:
        stays = 0 if F[F1] < F[F2] else 1
        stays = stays if is_driven_in(dm, modes, stays, phase, y, dy, F) else 1 - stays
    elif on_1 and on_2:
        return CLOSED
    elif not on_1 and not on_2 and is_driven_in(dm, modes, 0, phase, y, dy, F):
        stays = 0
    answer = mode_of_one(dm, stays, phase, y, modes, slip_tol, u_a, u_b, w_p, dy, F)
    if held and answer == CLOSED and (1.0 - 2.0 * leading(modes)) * dy[YWB] * dm.l < -NO_FORCE * dm.g:
        # two could be held, but for the pull of one, which is driven in beside the other one alone: both slip
        lead_with(dm, 0, u_a, u_b, w_p, y)
        slip_together(dm, phase, y, modes, 0.0, 0.0, slip_tol, dy, F)
        contact_rates(dm, modes, phase, y, False, dy, F)
        if is_compressive(dm, modes, 0, phase, y, dy, F) and is_compressive(dm, modes, 1, phase, y, dy, F):
            return CLOSED
        answer = mode_of_one(dm, stays, phase, y, modes, slip_tol, u_a, u_b, w_p, dy, F)
    return answer


@compiled
def mode_of_one(dm, stays, phase, y, modes, slip_tol, u_a, u_b, w_p, dy, F):
    """`single_mode` of one of two ends on the plate, of which p1 slips by (u_a, u_b): of the end that stays, or the other one.

    A hold that was lost was that of both.
    """
    lead_with(dm, stays, u_a, u_b, w_p, y)
    answer = single_mode(dm, stays, phase, y, modes, slip_tol, False, dy, F)
    if answer == SEPARATES:  # friction at both ends may have driven off one that nothing drives off alone
        lead_with(dm, 1 - stays, u_a, u_b, w_p, y)
        answer = single_mode(dm, 1 - stays, phase, y, modes, slip_tol, False, dy, F)
    return answer
