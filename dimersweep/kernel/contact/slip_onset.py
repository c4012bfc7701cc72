"""Slip that sets out from rest: the direction in (4) is that of the acceleration which the contact then has."""

from math import copysign, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import put_slip, put_slips, slip_of
from dimersweep.kernel.contact.forces import F1, contact_rates
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import sincos

ONSET_DIRECTIONS = 48  # directions looked at for a change of sign
SLANT = 1e-7  # change of direction in a finite difference [rad]
# the same of two ends, over the tangent: coarse enough for the smallest slips, whose last digits are rounded
PAIR_SLANT = 1e-4
PAIR_NEWTON, PAIR_KNOWN = 12, 1e-6  # Newton iterations of two ends at most, and the change that ends them
PAIR_TURNS, PAIR_TURN = 100, 0.1  # steps in which two slips turn with their accelerations, and the size of one


@compiled
def set_out(dm, modes, i, phase, y, v, phi, dy, F):
    """Acceleration of the slip of end i across and along the direction phi, once it slips there with speed v."""
    s, c = sincos(phi)
    put_slip(dm, modes, y, i, v * c, v * s)
    contact_rates(dm, modes, phase, y, False, dy, F)
    a, b = slip_of(dm, modes, dy, i)
    return a * s - b * c, a * c + b * s


@compiled
def settle_near(dm, modes, i, phase, y, v, phi, dy, F):
    """Outward direction near phi, by Newton's rule, into y; whether there is one."""
    for _ in range(20):
        across, along = set_out(dm, modes, i, phase, y, v, phi, dy, F)
        beside, _ = set_out(dm, modes, i, phase, y, v, phi + SLANT, dy, F)
        slope = (beside - across) / SLANT
        step = -across / slope if slope != 0.0 else 1.0
        if not abs(step) <= 0.5:
            return False
        phi += step
        if abs(step) <= SLANT:  # as exact as this the slope is, and what is left of the error
            across, along = set_out(dm, modes, i, phase, y, v, phi, dy, F)
            return along > 0.0 and F[F1 + 3 * i] > 0.0
    return False


@compiled
def settle_anywhere(dm, modes, i, phase, y, v, dy, F):
    """Find the direction of a slip out of rest among all directions: changes of sign on a grid, then bisection."""
    before, last = 0.0, 0.0
    for k in range(ONSET_DIRECTIONS + 1):
        phi = -pi + 2.0 * pi * (k + 0.37) / ONSET_DIRECTIONS
        across, _ = set_out(dm, modes, i, phase, y, v, phi, dy, F)
        if k > 0 and across * before < 0.0:
            low, high = last, phi
            for _ in range(60):
                mid = 0.5 * (low + high)
                cross, _ = set_out(dm, modes, i, phase, y, v, mid, dy, F)
                low, high = (mid, high) if cross * before > 0.0 else (low, mid)
            _, along = set_out(dm, modes, i, phase, y, v, 0.5 * (low + high), dy, F)
            if along > 0.0 and F[F1 + 3 * i] > 0.0:
                return True
        before, last = across, phi
    return False


@compiled
def slip_onset(dm, modes, i, phase, y, v, hold_a, hold_b, dy, F):
    """Self-consistent slip (speed v) out of rest of end i, into y; returns False if there is none.

    The contact's acceleration under friction against the slip is parallel to it (doi 10.1115/1.4035411). It is looked for
    near the direction against the force (hold_a, hold_b) that held, then everywhere; where that force is axial, in the
    axial directions first, so that planar motion stays planar.
    """
    if hold_b == 0.0:
        for k in range(2):
            phi_c = 1.0 - 2.0 * k
            put_slip(dm, modes, y, i, v * phi_c, 0.0)
            contact_rates(dm, modes, phase, y, False, dy, F)
            a, b = slip_of(dm, modes, dy, i)
            if phi_c * a > 0.0 and b == 0.0 and F[F1 + 3 * i] > 0.0:
                return True
    if settle_near(dm, modes, i, phase, y, v, atan2(-hold_b, -hold_a), dy, F):
        return True
    return settle_anywhere(dm, modes, i, phase, y, v, dy, F)


@compiled
def set_out_as_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F):
    """Two ends slip along (1, b_i) times `side`, the faster with the speed v: the axial acceleration that way, and what each
    lateral one has beyond that direction.
    """
    u = side * v / length(1.0, max(abs(b_1), abs(b_2)))
    put_slips(dm, y, u, u * b_1, u * b_2)
    contact_rates(dm, modes, phase, y, False, dy, F)
    a, a_1 = slip_of(dm, modes, dy, 0)
    _, a_2 = slip_of(dm, modes, dy, 1)
    return side * a, side * (a_1 - b_1 * a), side * (a_2 - b_2 * a)


@compiled
def pair_onset(dm, modes, phase, y, v, side, b_1, b_2, dy, F):
    """Slips out of rest of two ends, into y: along (1, b_i) times `side`, where the accelerations are parallel to the slips.

    They are looked for near the given ones, then where slips that set out so turn. Where there are none, the given ones are
    kept.
    """
    if not settle_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F):
        u, u_1, u_2 = turned_pair(dm, modes, phase, y, v, side, side * b_1, side * b_2, dy, F)
        if u == 0.0 or not settle_pair(dm, modes, phase, y, v, copysign(1.0, u), u_1 / u, u_2 / u, dy, F):
            set_out_as_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F)


@compiled
def settle_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F):
    """Such directions near (1, b_i) times `side`, by Newton's rule, into y; whether there are any."""
    for _ in range(PAIR_NEWTON):
        along, r_1, r_2 = set_out_as_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F)
        d_1, d_2 = PAIR_SLANT * (1.0 + abs(b_1)), PAIR_SLANT * (1.0 + abs(b_2))
        _, s_11, s_21 = set_out_as_pair(dm, modes, phase, y, v, side, b_1 + d_1, b_2, dy, F)
        _, s_12, s_22 = set_out_as_pair(dm, modes, phase, y, v, side, b_1, b_2 + d_2, dy, F)
        s_11, s_21, s_12, s_22 = (s_11 - r_1) / d_1, (s_21 - r_2) / d_1, (s_12 - r_1) / d_2, (s_22 - r_2) / d_2
        det = s_11 * s_22 - s_12 * s_21
        step_1, step_2 = (s_12 * r_2 - s_22 * r_1) / det, (s_21 * r_1 - s_11 * r_2) / det
        if not abs(step_1) <= 1.0 + abs(b_1) or not abs(step_2) <= 1.0 + abs(b_2):
            return False
        b_1, b_2 = b_1 + step_1, b_2 + step_2
        if abs(step_1) <= PAIR_KNOWN * (1.0 + abs(b_1)) and abs(step_2) <= PAIR_KNOWN * (1.0 + abs(b_2)):
            along, _, _ = set_out_as_pair(dm, modes, phase, y, v, side, b_1, b_2, dy, F)
            return along > 0.0
    return False


@compiled
def turned_pair(dm, modes, phase, y, v, u, u_1, u_2, dy, F):
    """Where the slips (u, u_i) of two ends turn, as their accelerations have them: axial and lateral parts, in no unit."""
    for _ in range(PAIR_TURNS):
        size = max(abs(u), max(abs(u_1), abs(u_2)))
        u, u_1, u_2 = u / size, u_1 / size, u_2 / size
        put_slips(dm, y, v * u, v * u_1, v * u_2)
        contact_rates(dm, modes, phase, y, False, dy, F)
        a, a_1 = slip_of(dm, modes, dy, 0)
        _, a_2 = slip_of(dm, modes, dy, 1)
        step = PAIR_TURN / max(abs(a), max(abs(a_1), abs(a_2)))
        u, u_1, u_2 = u + step * a, u_1 + step * a_1, u_2 + step * a_2
    return u, u_1, u_2
