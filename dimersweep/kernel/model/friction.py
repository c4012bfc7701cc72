"""Coulomb's law, eq. (4): the friction of an end that slips, and the limit of the friction that holds.

Another law of friction is written here. An end that slips with the velocity u under the normal force F feels -mu F u /
|u|. An end at rest is held as long as its friction is at most ``hold`` times F: mu_h in lasting contact, mu_s inside an
impact. Both ends of a flat dimer share one axial velocity. Of two held ends only the sum of the axial parts is
determined, and they hold where some split of it does.

Forces, impulses and forces per clock of an impact all obey this law. Closed forms of it are written out for speed in
``double_equations.friction``, ``single_impact.straight_leg``, ``turning`` and ``expansion`` (impacts). Each is tested
against the functions here.
"""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import STICK
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.root_bracket import MAX_NEWTON

# least cosine of the angle between axis and friction, for an end that is held laterally only: below it is rounding
LEAST_COSINE = 1e-6


@compiled
def direction(a, b):
    """Return cosine and sine of the direction of a slip; 0 and 0 for no slip (any other has a square above 0)."""
    v2 = a * a + b * b
    k = 1.0 / sqrt(v2) if v2 > 0.0 else 0.0
    return k * a, k * b


# --- slip -------------------------------------------------------------------------------------------------------------


@compiled(inline=True)
def slip_mu(p, v):
    """Return the coefficient of friction of an end that slips at the speed v [m/s]; Coulomb's does not depend on v."""
    return p.mu


@compiled(inline=True)
def hit(p, v):
    """Set the coefficient of slip friction for an impact that begins with the slip speed v of an end [m/s].

    An impact is so short that it has one coefficient, that of this speed.
    """
    p.mu_hit = slip_mu(p, v)


@compiled
def slip_force(mu, F, c, s):
    """Return axial and lateral friction of an end that slips in the direction (c, s) under the normal force F."""
    return -mu * F * c, -mu * F * s


@compiled
def slip_strength(mu, F, v):
    """Return the size of the friction over the speed v of the slip; 0.0 for no slip."""
    return mu * F / v if v > 0.0 else 0.0


@compiled
def outward_slip(drive_a, drive_b, k_a, k_b):
    """Return the direction d of slip out of rest.

    It obeys drive - (k_a d_a, k_b d_b) = lambda d with lambda >= 0 (doi 10.1115/1.4035411). `drive` is the contact
    acceleration without the friction of the end, k its friction times the diagonal of the Delassus operator. The length
    of d = (drive_a / (lambda + k_a), drive_b / (lambda + k_b)) falls with lambda. Newton's rule for its inverse, which
    is concave, climbs to the lambda at which it is one.
    """
    size = length(drive_a, drive_b)
    if size == 0.0:
        return 1.0, 0.0
    rate = max(0.0, max(abs(drive_a) - k_a, abs(drive_b) - k_b))
    for _ in range(MAX_NEWTON):
        d_a, d_b = drive_a / (rate + k_a), drive_b / (rate + k_b)
        size = length(d_a, d_b)
        step = (size - 1.0) * size * size / (d_a * d_a / (rate + k_a) + d_b * d_b / (rate + k_b))
        if not step > 1e-16 * rate:
            break
        rate += step
    return d_a / size, d_b / size


# --- hold -------------------------------------------------------------------------------------------------------------


@compiled
def hold_left(hold, F, A, L):
    """Return how far the friction (A, L) that holds an end is from its limit; negative beyond it."""
    return hold * F - length(A, L)


@compiled
def axial_left_of_pair(hold_1, F_1, L_1, hold_2, F_2, L_2, A):
    """Return how far the sum A of the axial frictions of two held ends is from its limit; negative beyond it.

    The limit is the sum of the axial parts that the lateral frictions L_1, L_2 leave of each end's bound.
    """
    limit_1, limit_2 = hold_1 * F_1, hold_2 * F_2
    room_1, room_2 = limit_1 * limit_1 - L_1 * L_1, limit_2 * limit_2 - L_2 * L_2
    return sqrt(max(room_1, 0.0)) + sqrt(max(room_2, 0.0)) - abs(A)


@compiled
def hold_left_of_pair(hold_1, F_1, L_1, hold_2, F_2, L_2, A):
    """Return how far two held ends are from the limit of their friction; negative beyond it.

    It is the least of three: the lateral reserve of each end, and the axial reserve of both. A normal force below zero
    ends the contact, not the hold: its size counts here.
    """
    left_1, left_2 = hold_left(hold_1, abs(F_1), 0.0, L_1), hold_left(hold_2, abs(F_2), 0.0, L_2)
    return min(left_1, left_2, axial_left_of_pair(hold_1, F_1, L_1, hold_2, F_2, L_2, A))


@compiled
def lateral_at_limit(hold, F, L):
    """Return the lateral part L of the friction that holds an end at its limit, over the size of the axial part."""
    limit = hold * F
    least = LEAST_COSINE * limit
    return L / sqrt(max(limit * limit - L * L, least * least)) if limit > 0.0 else 0.0


@compiled
def holds_axially(hold, na, aa):
    """Return True if an end at rest is held where its normal force alone drives it along the axis (W_na, W_aa)."""
    return abs(na) <= hold * aa


# --- the forces of one contact ----------------------------------------------------------------------------------------


@compiled(inline=True, fuse=True)
def single_forces(dm, mu, mode, w, u_a, u_b, n, a, b):
    """Return the normal, axial and lateral force at the one closed end, and its compliance.

    (u_a, u_b) is its slip and mu its coefficient of friction. n, a, b are the accelerations of its contact point
    without contact forces, and w is its Delassus operator. The normal force may come out negative.

    The compliance is the normal acceleration per normal force, with the friction that goes with it, in units of 1/m (1
    for an end that sticks). At zero the force is infinite. Below zero the force presses the end into the plate the
    more, the greater it is.
    """
    if mode == STICK:
        det = w.nn * w.aa - w.na * w.na
        return (w.na * a - w.aa * n) / det, (w.na * n - w.nn * a) / det, -b / w.bb, 1.0
    # all is multiplied by the speed, for one division in place of two: the next stage of a step has to wait for
    # divisions
    v = length(u_a, u_b) or 1.0
    A, L = slip_force(mu, 1.0, u_a, u_b)
    yields = v * w.nn + w.na * A
    F = -n / yields
    return v * F, F * A, F * L, yields / v * dm.m
