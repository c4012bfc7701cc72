"""Choose the contact mode of ends that rest on the plate: which ends stay closed, which stick, which slip.

For an end at rest on the plate, (3) holds between its normal force and the acceleration of its gap, and (4) says
whether friction can hold the end. The candidate modes are tried one after the other; a mode fits if its forces obey (3)
and (4).
"""

from math import copysign

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact import coordinates, slip_onset
from dimersweep.kernel.contact.coordinates import Y, leading, put_slip, put_slips
from dimersweep.kernel.contact.events import end_of, is_hold_end, is_lift_off
from dimersweep.kernel.contact.forces import A1, A2, COMPLIANCE, F1, F2, L1, L2, contact_rates, hold_reserve, take_rates
from dimersweep.kernel.contact.slip_onset import SINGLE_SPEED, pair_onset
from dimersweep.kernel.model.body import apart_sideways, extent
from dimersweep.kernel.model.friction import axial_left_of_pair, hold_left, lateral_at_limit
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from dimersweep.kernel.numerics.elementary import length

CLOSED, SEPARATES, INCONSISTENT = 0, 1, 2
# force, in units of the weight, below which the sign may be rounding: the sign a moment later decides in its place
NO_FORCE = 1e-12
# phase of the plate [rad] after which such a force is judged again: far above the rounding of a phase, and far below
# the phase over which forces change
MOMENT = 1e-6
# slip that is rounding, in units of the speeds it is a difference of: nine units of round-off
ROUNDED_SLIP = 2e-15
# lateral hold that is rounding, in units of the hold that is left along the axis
ROUNDED_HOLD = 1e-9
# deceleration, in units of gravity, that counts as none: of a slip that sets out exactly at its limit only rounding is
# left
AT_LIMIT = 1e-6


@compiled
def single_mode(dm, c, i, hold_ended):
    """Choose the mode of the one closed end i, and write it into c.modes and the slip that goes with it into c.y.

    The end sticks where friction can hold it. It leaves the plate where nothing drives it into the plate. Else it
    slips. At rest one of these modes always fits; a slip out of rest always exists (doi 10.1115/1.4035411). For an end
    that slips no mode fits where its friction presses it into the plate the more, the more the plate presses back
    (Painleve). An impact without collision follows then: it ends the slip, or turns the slip to a direction in which a
    force fits. Such a slip that nothing drives into the plate has a force that fits, too, but an unstable one: the end
    leaves (Champneys and Varkonyi, arXiv:1601.03545).

    `hold_ended` is True if friction has just ceased to hold the end at rest. Return CLOSED, SEPARATES, or INCONSISTENT
    when no force satisfies the law (Painleve: only an impact can follow).
    """
    modes, y = c.modes, c.y
    modes[0], modes[1] = FREE, FREE
    slips = length(y[Y.u_a], y[Y.u_b]) > c.slip_tol
    mode = SLIP if slips else STICK
    modes[i] = mode
    if not slips:
        put_slip(dm, modes, y, i, 0.0, 0.0)
    take_rates(dm, c)
    # the order of trial decides where several modes fit: stick, then free, then slip (see above)
    if not slips and is_compressive(dm, c, i):
        # with next to no force the hold is a ratio of two roundings: the end sticks
        faint = c.F[F1 + 3 * i] <= NO_FORCE * dm.m * dm.g
        if faint or (not hold_ended and hold_reserve(dm, modes, i, c.F) >= 0.0):
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
    """Return True if the force F at end i points outward; a force of rounding is judged by its value a moment later."""
    force = c.F[F1 + 3 * i]
    if abs(force) > NO_FORCE * dm.m * dm.g:
        return force > 0.0
    return comes_back(dm, c, i)


@compiled
def comes_back(dm, c, i):
    """Return True if the force at end i, which has just vanished, is positive a moment later."""
    later = force_later(dm, c, i) > 0.0
    take_rates(dm, c)
    return later


@compiled
def force_later(dm, c, i):
    """Return the normal force at end i a MOMENT later, when the state has gone on at its present rates.

    c.dy and c.F become those of that moment; c.y stays. A slip that would come to rest within the moment is followed
    over half of the time to rest only.
    """
    y = c.y
    dip, w_b, w_p, spin, u_a, u_b, theta = y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.spin], y[Y.u_a], y[Y.u_b], y[Y.theta]
    # half of the time to rest: at rest the direction of the slip, and of its friction, would be lost
    t = min(MOMENT / dm.omega, 0.5 * coordinates.slip_limit(dm, c.modes, y, c.dy))
    for k in range(Y.time):
        y[k] += t * c.dy[k]
    # an end that sticks, or whose force is judged without friction (`is_driven_in`): it is not to slip in between
    if u_a == 0.0 and u_b == 0.0:
        y[Y.u_a], y[Y.u_b] = 0.0, 0.0
    contact_rates(dm, c.modes, c.phase + dm.omega * t, y, False, c.dy, c.F)
    y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.spin], y[Y.u_a], y[Y.u_b], y[Y.theta] = dip, w_b, w_p, spin, u_a, u_b, theta
    return c.F[F1 + 3 * i]


@compiled
def is_driven_in(dm, c, i):
    """Return True if end i, the leading one, would move into the plate without a contact force and without slip."""
    modes, y = c.modes, c.y
    u_a, u_b = y[Y.u_a], y[Y.u_b]
    # a slip of zero has no direction, and so no friction: its force is the one that holds off the drive alone
    y[Y.u_a], y[Y.u_b] = 0.0, 0.0
    modes[0], modes[1] = FREE, FREE
    modes[i] = SLIP
    take_rates(dm, c)
    answer = is_compressive(dm, c, i)
    y[Y.u_a], y[Y.u_b] = u_a, u_b
    return answer


@compiled
def double_mode(dm, c, hold_ended):
    """Choose the friction modes of both ends on the plate; write the modes, their slips into c.y, and their forces.

    `hold_ended` is True if friction has just ceased to hold an end at rest.
    """
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
    if (rest_1 or rest_2) and (hold_ended or hold_reserve(dm, modes, 0 if rest_1 else 1, c.F) < 0.0):
        if rest_1 and rest_2:
            start_slips(dm, c)
        else:
            start_second_slip(dm, c, 0 if rest_1 else 1)
    take_rates(dm, c)


@compiled
def start_slips(dm, c):
    """Let one end or both slip out of rest, where friction cannot hold both ends at rest.

    An end whose lateral hold is exceeded slips laterally, if friction holds the other end then. Else both ends slip.

    Two ends whose axial hold is exceeded are both at their limits, and each sets out against the force that held it.
    The lateral part of that force is known, and its axial part is what the limit leaves. Both ends have one axial slip.
    """
    modes, F, small = c.modes, c.F, SINGLE_SPEED * c.slip_tol
    hold_1, hold_2 = dm.p1.mu_h, dm.p2.mu_h
    # the moment at which a hold ends is located to rounding only: a last rest of the lateral hold may be left
    rest = ROUNDED_HOLD * max(axial_left_of_pair(hold_1, F[F1], F[L1], hold_2, F[F2], F[L2], F[A1]), 0.0)
    over_1 = hold_left(hold_1, F[F1], 0.0, F[L1]) <= rest
    over_2 = hold_left(hold_2, F[F2], 0.0, F[L2]) <= rest
    if not over_1 and not over_2:
        modes[0], modes[1] = SLIP, SLIP
        # minus: the slip sets out against the force that held the ends
        side = -copysign(1.0, F[A1])
        b_1, b_2 = -side * lateral_at_limit(hold_1, F[F1], F[L1]), -side * lateral_at_limit(hold_2, F[F2], F[L2])
        pair_onset(dm, c, side, b_1, b_2)
        return
    # minus: against the lateral force that held
    b_1, b_2 = -copysign(small, F[L1]), -copysign(small, F[L2])
    # one end alone first: its slip may relieve the other end
    if not over_1 or not over_2:
        modes[0], modes[1] = SLIP if over_1 else STICK, SLIP if over_2 else STICK
        put_slips(dm, c.y, 0.0, b_1 if over_1 else 0.0, b_2 if over_2 else 0.0)
        take_rates(dm, c)
        if hold_reserve(dm, modes, 1 if over_1 else 0, F) >= 0.0:
            return
    slip_together(dm, c, b_1, b_2)


@compiled
def slip_together(dm, c, b_1, b_2):
    """Let both ends slip out of rest, near the direction of the accelerations that lateral slips b_1, b_2 give them."""
    c.modes[0], c.modes[1] = SLIP, SLIP
    a, a_1, a_2 = slip_onset.rates_of_pair(dm, c, 0.0, b_1, b_2)
    # directions of a pair are ratios to the axial slip: without an axial acceleration the slips stay as they are set
    if abs(a) > AT_LIMIT * max(abs(a_1), abs(a_2)):
        pair_onset(dm, c, copysign(1.0, a), a_1 / a, a_2 / a)


@compiled
def start_second_slip(dm, c, i):
    """Let end i begin to slip beside an end that slips already.

    The new slip may turn back the slip of the other end, where that is hardly more than none. Then both ends set out
    together, if friction can hold neither of them.
    """
    modes, y = c.modes, c.y
    u_a, u_b, w_p = y[Y.u_a], y[Y.u_b], y[Y.w_p]
    start_slip(dm, c, i)
    take_rates(dm, c)
    v, along, _ = coordinates.change_of_slip(dm, modes, y, c.dy, 1 - i)
    # a pair sets out with PAIR_SPEED: a slip of up to twice that has hardly begun, and may begin anew with the other
    # one
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
    """Let end i, held by the forces in c.F until now, begin to slip; return False if it cannot.

    The rates and forces become those of the slip. At its limit a slip may have no acceleration yet: it sets out against
    the force that held the end.
    """
    hold_a = c.F[A1] if c.modes[0] != FREE else c.F[A2]
    hold_b = c.F[L1] if i == 0 else c.F[L2]
    small, hold = SINGLE_SPEED * c.slip_tol, length(hold_a, hold_b)
    c.modes[i] = SLIP
    if slip_onset.slip_onset(dm, c, i, hold_a, hold_b):
        return True
    a, b = slip_onset.rates_of_slip(dm, c, i, -small * hold_a / hold, -small * hold_b / hold)
    # the slip points against the hold: a product with it above zero is a deceleration, which would end the slip at once
    return a * hold_a + b * hold_b <= AT_LIMIT * dm.g * hold


@compiled
def lead_with(dm, c, i, slip):
    """Make c.y hold the slip of end i, with both ends on the plate; `slip` is (u_a, u_b) of p1 and theta' cos(beta)."""
    u_a, u_b, w_p = slip
    c.y[Y.u_a], c.y[Y.w_p] = u_a, w_p
    c.y[Y.u_b] = u_b - i * apart_sideways(dm, w_p, c.y[Y.spin])


@compiled
def contact_mode(dm, c, closed_1, closed_2, event):
    """Choose which of the closed ends stay closed and in which friction modes.

    The modes are written into c.modes. Return CLOSED, SEPARATES or INCONSISTENT. Before the call c.y has p1 as its
    leading end if p1 is closed. `event` is the event that ended the last contact phase (`events`), NO_EVENT if there
    was none. Rounding may leave a little of a hold that is exceeded, or of a force that has vanished.

    With both ends on the plate the double contact is tried first, then each end alone where its force points outward.
    At a negative compliance the double contact does not fit, even where both forces point outward. The least difference
    between the ends grows then, and drives off the end with the greater force, or the end that nothing drives into the
    plate.

    All modes are judged at the spin of the given state, so that their forces agree even near zero. A slip that the
    chosen mode sets or takes away then comes about by impulses. A slip that is only rounding needs none, so that a run
    goes on from a stored state to the same bits.
    """
    y = c.y
    u_b, w_p = y[Y.u_b], y[Y.w_p]
    if not (closed_1 and closed_2):
        answer = single_mode(dm, c, 0 if closed_1 else 1, is_hold_end(event))
    else:
        answer = mode_of_pair(dm, c, event)
        if answer == CLOSED:
            # where p2 alone stays closed, y now has the slip of p2
            u_b -= leading(c.modes) * apart_sideways(dm, w_p, y[Y.spin])
    if answer == CLOSED:
        r, h = extent(dm)
        size = abs(y[Y.u_a]) + abs(u_b) + r * abs(y[Y.spin]) + h * (abs(y[Y.w_b]) + abs(w_p))
        if abs(y[Y.u_b] - u_b) + h * abs(y[Y.w_p] - w_p) > ROUNDED_SLIP * size:
            coordinates.give_impulses(dm, c.modes, y, u_b, w_p)
    return answer


@compiled
def mode_of_pair(dm, c, event):
    """Choose the modes of two ends on the plate, as `contact_mode` does; return CLOSED, SEPARATES or INCONSISTENT."""
    slip = c.y[Y.u_a], c.y[Y.u_b], c.y[Y.w_p]
    double_mode(dm, c, is_hold_end(event))
    both_stick = c.modes[0] == STICK and c.modes[1] == STICK
    on_1, on_2 = is_compressive(dm, c, 0), is_compressive(dm, c, 1)
    if on_1 and on_2 and is_lift_off(event) and not comes_back(dm, c, end_of(event)):
        # the end whose force has just vanished is off, and the other one on
        on_1, on_2 = end_of(event) == 1, end_of(event) == 0
    stays = 0 if on_1 else 1
    # the compliance comes first: where it is negative, the signs of both forces are turned round
    if c.F[COMPLIANCE] < 0.0:
        stays = 0 if c.F[F1] < c.F[F2] else 1
        stays = stays if is_driven_in(dm, c, stays) else 1 - stays
    elif on_1 and on_2:
        return CLOSED
    # each end alone is judged by what drives it, not by the forces of the double contact
    elif not on_1 and not on_2 and is_driven_in(dm, c, 0):
        stays = 0
    answer = mode_of_one(dm, c, stays, slip)
    # the sign is 1 if p1 leads, else -1: beta' opens the gap of p2, and closes that of p1
    if both_stick and answer == CLOSED and (1.0 - 2.0 * leading(c.modes)) * c.dy[Y.w_b] * dm.l < -NO_FORCE * dm.g:
        # friction can hold both ends, but the force at one of them pulls; beside the other end alone it is driven in:
        # both slip
        lead_with(dm, c, 0, slip)
        slip_together(dm, c, 0.0, 0.0)
        take_rates(dm, c)
        if is_compressive(dm, c, 0) and is_compressive(dm, c, 1):
            return CLOSED
        answer = mode_of_one(dm, c, stays, slip)
    return answer


@compiled
def mode_of_one(dm, c, stays, slip):
    """Choose the mode of one of two ends on the plate alone; return the result of `single_mode`.

    The other end leaves. End `stays` is tried first, and the other end if nothing drives `stays` into the plate. `slip`
    is that of `lead_with`. If a hold was exceeded, it was the hold of both ends: it says nothing of one end alone.
    """
    lead_with(dm, c, stays, slip)
    answer = single_mode(dm, c, stays, False)
    # the friction of both ends may have driven off an end that nothing drives off where it is alone
    if answer == SEPARATES:
        lead_with(dm, c, 1 - stays, slip)
        answer = single_mode(dm, c, 1 - stays, False)
    return answer
