"""The contact mode of ends that rest on the plate: which stay closed, which stick, which slip, by enumeration.

Of an end at rest on the plate (3) holds between its normal force and the acceleration of its gap, and (4) says whether
friction can hold it. A mode fits if the forces that go with it do.
"""

from math import copysign

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact import coordinates, slip_onset
from dimersweep.kernel.contact.coordinates import Y, leading, put_slip, put_slips
from dimersweep.kernel.contact.events import end_of, is_hold_lost, is_lift_off
from dimersweep.kernel.contact.forces import A1, A2, COMPLIANCE, F1, F2, L1, L2, contact_rates, hold_reserve, take_rates
from dimersweep.kernel.contact.slip_onset import SINGLE_SPEED, pair_onset
from dimersweep.kernel.model.body import apart_sideways, extent
from dimersweep.kernel.model.friction import axial_left_of_pair, hold_left, lateral_at_limit
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.numerics.elementary import length

CLOSED, SEPARATES, INCONSISTENT = 0, 1, 2
NO_FORCE = 1e-12  # force, in units of the weight, whose sign a moment later decides
MOMENT = 1e-6  # of the plate's phase
ROUNDED_SLIP = 2e-15  # slip that is rounding, in units of the speeds it is a difference of
ROUNDED_HOLD = 1e-9  # lateral hold that is rounding, in units of what is left along the axis
AT_LIMIT = 1e-6  # deceleration, in units of gravity, that is none


@compiled
def single_mode(dm, c, i, lost):
    """Mode of the one closed end i into c.modes; c.y gets the slip that goes with it.

    It sticks where the friction can hold it, or leaves where nothing drives it into the plate, or else slips. At rest one
    of these always fits (so does a slip out of rest, doi 10.1115/1.4035411). While it slips, none does where the friction
    would press it into the plate the more, the more the plate pressed back (Painleve): an impact without collision follows,
    which ends the slip, or turns it to where its force fits. Such a slip that nothing drives into the plate could also be
    kept by a force, but by an unstable one: it leaves (Champneys and Varkonyi, arXiv:1601.03545).

    `lost` says that the hold at rest has just been lost. Returns CLOSED, SEPARATES, or INCONSISTENT when no force satisfies the
    law (Painleve: only an impact can follow).
    """
    modes, y = c.modes, c.y
    modes[0], modes[1] = FREE, FREE
    slips = length(y[Y.u_a], y[Y.u_b]) > c.slip_tol
    mode = SLIP if slips else STICK
    modes[i] = mode
    if not slips:
        put_slip(dm, modes, y, i, 0.0, 0.0)
    take_rates(dm, c)
    if not slips and is_compressive(dm, c, i):
        faint = c.F[F1 + 3 * i] <= NO_FORCE * dm.m * dm.g
        if faint or (not lost and hold_reserve(dm, modes, i, c.F) >= 0.0):
            return CLOSED
    if not is_driven_in(dm, c, i):
        modes[i] = FREE
        return SEPARATES
    modes[i] = mode
    take_rates(dm, c)
    if (slips or start_slip(dm, c, i)) and is_compressive(dm, c, i):
        return CLOSED
    modes[i] = FREE
    return INCONSISTENT


@compiled
def is_compressive(dm, c, i):
    """Whether the force F at end i points outward; where it is only rounding, whether it does a moment later."""
    force = c.F[F1 + 3 * i]
    if abs(force) > NO_FORCE * dm.m * dm.g:
        return force > 0.0
    return comes_back(dm, c, i)


@compiled
def comes_back(dm, c, i):
    """Whether the force at end i, which has just vanished, is positive a moment later."""
    later = force_later(dm, c, i) > 0.0
    take_rates(dm, c)
    return later


@compiled
def force_later(dm, c, i):
    """Normal force at end i a moment after the state, which goes on at its rates; rates and forces are of that moment then.

    A slip that would come to rest within the moment is followed half the way.
    """
    y = c.y
    dip, w_b, w_p, spin, u_a, u_b, theta = y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.spin], y[Y.u_a], y[Y.u_b], y[Y.theta]
    t = min(MOMENT / dm.omega, 0.5 * coordinates.slip_limit(dm, c.modes, y, c.dy))
    for k in range(Y.time):
        y[k] += t * c.dy[k]
    if u_a == 0.0 and u_b == 0.0:  # an end that sticks, or one that is asked of without friction
        y[Y.u_a], y[Y.u_b] = 0.0, 0.0
    contact_rates(dm, c.modes, c.phase + dm.omega * t, y, False, c.dy, c.F)
    y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.spin], y[Y.u_a], y[Y.u_b], y[Y.theta] = dip, w_b, w_p, spin, u_a, u_b, theta
    return c.F[F1 + 3 * i]


@compiled
def is_driven_in(dm, c, i):
    """Whether end i, the leading one, would go into the plate without a contact force (friction vanishes at no slip)."""
    modes, y = c.modes, c.y
    u_a, u_b = y[Y.u_a], y[Y.u_b]
    y[Y.u_a], y[Y.u_b] = 0.0, 0.0
    modes[0], modes[1] = FREE, FREE
    modes[i] = SLIP
    take_rates(dm, c)
    answer = is_compressive(dm, c, i)
    y[Y.u_a], y[Y.u_b] = u_a, u_b
    return answer


@compiled
def double_mode(dm, c, lost):
    """Friction modes with both ends on the plate, and the forces; c.y gets the slips that go with them."""
    modes, y = c.modes, c.y
    rest_1 = length(y[Y.u_a], y[Y.u_b]) <= c.slip_tol
    rest_2 = length(y[Y.u_a], y[Y.u_b] - apart_sideways(dm, y[Y.w_p], y[Y.spin])) <= c.slip_tol
    modes[0] = STICK if rest_1 else SLIP
    modes[1] = STICK if rest_2 else SLIP
    if rest_1:
        put_slip(dm, modes, y, 0, 0.0, 0.0)
    if rest_2:
        put_slip(dm, modes, y, 1, 0.0, 0.0)
    take_rates(dm, c)
    if (rest_1 or rest_2) and (lost or hold_reserve(dm, modes, 0 if rest_1 else 1, c.F) < 0.0):
        if rest_1 and rest_2:
            start_slips(dm, c)
        else:
            start_beside(dm, c, 0 if rest_1 else 1)
    take_rates(dm, c)


@compiled
def start_slips(dm, c):
    """Both ends at rest and not both held: an end whose lateral hold is exceeded slips laterally, if the other one is held
    then; else both slip.

    Two ends whose axial hold is exceeded are at their limits, and each sets out against the force that held it. Its lateral
    part is known, and its axial part is what the limit leaves; the axial slip of both is one.
    """
    modes, F, small = c.modes, c.F, SINGLE_SPEED * c.slip_tol
    hold_1, hold_2 = dm.p1.mu_h, dm.p2.mu_h
    # a loss is found to rounding: an end whose lateral hold has ended may come with a last rest of it
    rest = ROUNDED_HOLD * max(axial_left_of_pair(hold_1, F[F1], F[L1], hold_2, F[F2], F[L2], F[A1]), 0.0)
    over_1 = hold_left(hold_1, F[F1], 0.0, F[L1]) <= rest
    over_2 = hold_left(hold_2, F[F2], 0.0, F[L2]) <= rest
    if not over_1 and not over_2:
        modes[0], modes[1] = SLIP, SLIP
        side = -copysign(1.0, F[A1])
        b_1, b_2 = -side * lateral_at_limit(hold_1, F[F1], F[L1]), -side * lateral_at_limit(hold_2, F[F2], F[L2])
        pair_onset(dm, c, side, b_1, b_2)
        return
    b_1, b_2 = -copysign(small, F[L1]), -copysign(small, F[L2])
    if not over_1 or not over_2:
        modes[0], modes[1] = SLIP if over_1 else STICK, SLIP if over_2 else STICK
        put_slips(dm, c.y, 0.0, b_1 if over_1 else 0.0, b_2 if over_2 else 0.0)
        take_rates(dm, c)
        if hold_reserve(dm, modes, 1 if over_1 else 0, F) >= 0.0:
            return
    slip_together(dm, c, b_1, b_2)


@compiled
def slip_together(dm, c, b_1, b_2):
    """Both ends slip out of rest, near the direction of the accelerations which they have with the lateral slips b_1, b_2."""
    c.modes[0], c.modes[1] = SLIP, SLIP
    a, a_1, a_2 = slip_onset.rates_of_pair(dm, c, 0.0, b_1, b_2)
    if abs(a) > AT_LIMIT * max(abs(a_1), abs(a_2)):
        pair_onset(dm, c, copysign(1.0, a), a_1 / a, a_2 / a)


@compiled
def start_beside(dm, c, i):
    """End i begins to slip beside one that slips. Where that one hardly does, and would be turned back, both set out together
    if neither can be held.
    """
    modes, y = c.modes, c.y
    u_a, u_b, w_p = y[Y.u_a], y[Y.u_b], y[Y.w_p]
    start_slip(dm, c, i)
    take_rates(dm, c)
    v, along, _ = coordinates.change_of_slip(dm, modes, y, c.dy, 1 - i)
    if along >= 0.0 or v > 2.0 * slip_onset.PAIR_SPEED * c.slip_tol:
        return
    modes[0], modes[1] = STICK, STICK
    put_slips(dm, y, 0.0, 0.0, 0.0)
    take_rates(dm, c)
    if hold_reserve(dm, modes, 0, c.F) < 0.0:
        start_slips(dm, c)
    if modes[0] == STICK or modes[1] == STICK:
        modes[i], modes[1 - i] = STICK, SLIP
        y[Y.u_a], y[Y.u_b], y[Y.w_p] = u_a, u_b, w_p
        take_rates(dm, c)
        start_slip(dm, c, i)


@compiled
def start_slip(dm, c, i):
    """End i, held by the forces, begins to slip, with the rates and forces that go with it; returns whether it can.

    At the limit slip may have no acceleration yet: it sets out against the force that held.
    """
    hold_a = c.F[A1] if c.modes[0] != FREE else c.F[A2]
    hold_b = c.F[L1] if i == 0 else c.F[L2]
    small, hold = SINGLE_SPEED * c.slip_tol, length(hold_a, hold_b)
    c.modes[i] = SLIP
    if slip_onset.slip_onset(dm, c, i, hold_a, hold_b):
        return True
    a, b = slip_onset.rates_of_slip(dm, c, i, -small * hold_a / hold, -small * hold_b / hold)
    return a * hold_a + b * hold_b <= AT_LIMIT * dm.g * hold


@compiled
def lead_with(dm, c, i, slip):
    """Have c.y hold the slip of end i, with both on the plate, where `slip` is that of p1 and theta' cos(beta)."""
    u_a, u_b, w_p = slip
    c.y[Y.u_a], c.y[Y.w_p] = u_a, w_p
    c.y[Y.u_b] = u_b - i * apart_sideways(dm, w_p, c.y[Y.spin])


@compiled
def contact_mode(dm, c, closed_1, closed_2, event):
    """Which of the closed ends stay closed, and in which friction modes, into c.modes (c.y with p1 leading if it is closed);
    returns CLOSED, SEPARATES or INCONSISTENT.

    `event` is the number of what has just ended the last contact phase (`events`), NO_EVENT if nothing has: rounding may
    leave a little of a hold that was lost, or of a force that has vanished.

    With both ends on the plate the double contact is tried first, then each end alone where its force points outward. At a
    negative compliance the double contact is no answer even where both forces point outward: the least difference between
    the ends grows, and drives off the one with the greater force, or the one that nothing drives into the plate.

    All modes are judged at the spin of the given state, so that the forces of each agree even near zero. A slip that the mode
    found sets or takes away then comes about by impulses; one that is only rounding needs none, so that a run goes on from a
    stored state to the same bits.
    """
    y = c.y
    u_b, w_p = y[Y.u_b], y[Y.w_p]
    if not (closed_1 and closed_2):
        answer = single_mode(dm, c, 0 if closed_1 else 1, is_hold_lost(event))
    else:
        answer = mode_of_pair(dm, c, event)
        if answer == CLOSED:
            u_b -= leading(c.modes) * apart_sideways(dm, w_p, y[Y.spin])
    if answer == CLOSED:
        r, h = extent(dm)
        size = abs(y[Y.u_a]) + abs(u_b) + r * abs(y[Y.spin]) + h * (abs(y[Y.w_b]) + abs(w_p))
        if abs(y[Y.u_b] - u_b) + h * abs(y[Y.w_p] - w_p) > ROUNDED_SLIP * size:
            coordinates.give_impulses(dm, c.modes, y, u_b, w_p)
    return answer


@compiled
def mode_of_pair(dm, c, event):
    """`contact_mode` with both ends on the plate."""
    slip = c.y[Y.u_a], c.y[Y.u_b], c.y[Y.w_p]
    double_mode(dm, c, is_hold_lost(event))
    held = c.modes[0] == STICK and c.modes[1] == STICK
    on_1, on_2 = is_compressive(dm, c, 0), is_compressive(dm, c, 1)
    if on_1 and on_2 and is_lift_off(event) and not comes_back(dm, c, end_of(event)):
        on_1, on_2 = end_of(event) == 1, end_of(event) == 0
    stays = 0 if on_1 else 1
    if c.F[COMPLIANCE] < 0.0:  # first: then the signs of both forces are turned round
        stays = 0 if c.F[F1] < c.F[F2] else 1
        stays = stays if is_driven_in(dm, c, stays) else 1 - stays
    elif on_1 and on_2:
        return CLOSED
    elif not on_1 and not on_2 and is_driven_in(dm, c, 0):  # each alone: by what drives it, not by the forces of both
        stays = 0
    answer = mode_of_one(dm, c, stays, slip)
    if held and answer == CLOSED and (1.0 - 2.0 * leading(c.modes)) * c.dy[Y.w_b] * dm.l < -NO_FORCE * dm.g:
        # two could be held, but for the pull of one, which is driven in beside the other one alone: both slip
        lead_with(dm, c, 0, slip)
        slip_together(dm, c, 0.0, 0.0)
        take_rates(dm, c)
        if is_compressive(dm, c, 0) and is_compressive(dm, c, 1):
            return CLOSED
        answer = mode_of_one(dm, c, stays, slip)
    return answer


@compiled
def mode_of_one(dm, c, stays, slip):
    """`single_mode` of one of two ends on the plate, with the slip of `lead_with`: of the end that stays, or the other one.

    A hold that was lost was that of both.
    """
    lead_with(dm, c, stays, slip)
    answer = single_mode(dm, c, stays, False)
    if answer == SEPARATES:  # friction at both ends may have driven off one that nothing drives off alone
        lead_with(dm, c, 1 - stays, slip)
        answer = single_mode(dm, c, 1 - stays, False)
    return answer
