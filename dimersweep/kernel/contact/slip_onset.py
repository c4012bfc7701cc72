"""Find how slip sets out from rest: its direction in (4) is that of the acceleration which the contact then has."""

from math import copysign, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import put_slip, put_slips, slip_of
from dimersweep.kernel.contact.forces import F1, take_rates
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.root_bracket import MAX_NEWTON
from dimersweep.kernel.numerics.sincos import sincos

# directions in which a change of sign is looked for
ONSET_DIRECTIONS = 48
# change of direction in a finite difference [rad]: about the root of round-off, where its two errors are alike
SLANT = 1e-7
# the same for two ends, over the tangent: coarse enough for the smallest slips, whose last digits are rounded
PAIR_SLANT = 1e-4
# change of the directions of two ends, over the tangent, that ends Newton's rule
PAIR_KNOWN = 1e-6
# slips with which one end and two ends set out, in units of the slip that counts as none. That of two ends is larger,
# with `SLIP_SCALE` the tolerance of a slip: so steps resolve it, and its direction bears rounding
SINGLE_SPEED, PAIR_SPEED = 0.5, 10.0
# number of steps in which two slips turn with their accelerations, and the size of a step in units of the slips
PAIR_TURNS, PAIR_TURN = 100, 0.1


@compiled
def rates_of_slip(dm, c, i, a, b):
    """Set the slip of end i to (a, b), axial and lateral; return its axial and its lateral rate [m s-2].

    The state, rates and forces of `c` become those of this slip.
    """
    put_slip(dm, c.modes, c.y, i, a, b)
    take_rates(dm, c)
    return slip_of(dm, c.modes, c.dy, i)


@compiled
def set_out(dm, c, i, phi):
    """Let end i slip in the direction phi [rad]; return the acceleration of the slip across phi and along phi.

    Across is positive where the slip turns to a smaller phi. The size of the slip is SINGLE_SPEED, in units of the slip
    that counts as none.
    """
    (sin_phi, cos_phi), v = sincos(phi), SINGLE_SPEED * c.slip_tol
    a, b = rates_of_slip(dm, c, i, v * cos_phi, v * sin_phi)
    return a * sin_phi - b * cos_phi, a * cos_phi + b * sin_phi


@compiled
def settle_near(dm, c, i, phi):
    """Find the outward direction of slip near phi by Newton's rule; return False if there is none.

    Outward means that the acceleration is parallel to the slip and lets it grow. The slip is written into y.
    """
    for _ in range(MAX_NEWTON):
        across, along = set_out(dm, c, i, phi)
        shifted, _ = set_out(dm, c, i, phi + SLANT)
        slope = (shifted - across) / SLANT
        step = -across / slope if slope != 0.0 else 1.0
        # beyond half a radian the slope at phi says nothing; and not <=, since a step that is nan is to end the search,
        # too
        if not abs(step) <= 0.5:
            return False
        phi += step
        # the slope is good to about SLANT, so what is left of the error is below SLANT squared
        if abs(step) <= SLANT:
            across, along = set_out(dm, c, i, phi)
            return along > 0.0 and c.F[F1 + 3 * i] > 0.0
    return False


@compiled
def settle_anywhere(dm, c, i):
    """Find the direction of a slip out of rest among all directions: changes of sign on a grid, then bisection.

    The slip is written into y. Return False if there is none.
    """
    before, last = 0.0, 0.0
    for k in range(ONSET_DIRECTIONS + 1):
        # 0.37: no direction of the grid is axial, lateral or a diagonal, where the function may be exactly zero
        phi = -pi + 2.0 * pi * (k + 0.37) / ONSET_DIRECTIONS
        across, _ = set_out(dm, c, i, phi)
        if k > 0 and across * before < 0.0:
            low, high = last, phi
            for _ in range(60):  # down to round-off
                mid = 0.5 * (low + high)
                cross, _ = set_out(dm, c, i, mid)
                low, high = (mid, high) if cross * before > 0.0 else (low, mid)
            _, along = set_out(dm, c, i, 0.5 * (low + high))
            if along > 0.0 and c.F[F1 + 3 * i] > 0.0:
                return True
        before, last = across, phi
    return False


@compiled
def slip_onset(dm, c, i, hold_a, hold_b):
    """Write the self-consistent slip out of rest of end i into y; return False if there is none.

    The acceleration of the contact under friction against the slip is parallel to the slip (doi 10.1115/1.4035411). It
    is looked for near the direction against the force (hold_a, hold_b) that held the end, then everywhere. Where that
    force is axial, the axial directions come first, so that planar motion stays planar.
    """
    if hold_b == 0.0:
        for k in range(2):
            sign = 1.0 - 2.0 * k
            a, b = rates_of_slip(dm, c, i, SINGLE_SPEED * c.slip_tol * sign, 0.0)
            if sign * a > 0.0 and b == 0.0 and c.F[F1 + 3 * i] > 0.0:
                return True
    return settle_near(dm, c, i, atan2(-hold_b, -hold_a)) or settle_anywhere(dm, c, i)


@compiled
def rates_of_pair(dm, c, u, u_1, u_2):
    """Set the slips of both ends to u, u_1, u_2; return the rates of these three numbers [m s-2].

    u is the axial slip, which both ends share; u_1 and u_2 are the lateral slips of p1 and p2. The state, rates and
    forces of `c` become those of these slips.
    """
    put_slips(dm, c.y, u, u_1, u_2)
    take_rates(dm, c)
    a, a_1 = slip_of(dm, c.modes, c.dy, 0)
    _, a_2 = slip_of(dm, c.modes, c.dy, 1)
    return a, a_1, a_2


@compiled
def set_out_as_pair(dm, c, side, b_1, b_2):
    """Let end i slip in the direction `side` (1, b_i), for both ends; return three accelerations [m s-2].

    The first is the axial acceleration, positive towards `side`. The second and the third belong to p1 and p2: each is
    the lateral acceleration of end i less b_i times the axial one. It is zero where the acceleration of an end is
    parallel to its slip.
    """
    u = side * (PAIR_SPEED * c.slip_tol) / length(1.0, max(abs(b_1), abs(b_2)))
    a, a_1, a_2 = rates_of_pair(dm, c, u, u * b_1, u * b_2)
    return side * a, side * (a_1 - b_1 * a), side * (a_2 - b_2 * a)


@compiled
def pair_onset(dm, c, side, b_1, b_2):
    """Let both ends slip out of rest together: write slips into y, each parallel to the acceleration that it gets.

    The direction of the slip of end i is `side` (1, b_i). So `side`, 1.0 or -1.0, is the sign of the axial slip, which
    both ends share, and b_i is the lateral slip of end i over the axial slip. Such slips are looked for near the given
    directions, then near the directions to which slips in the given directions turn. If neither finds any, the ends
    slip in the given directions.
    """
    if not settle_pair(dm, c, side, b_1, b_2):
        u, u_1, u_2 = turned_pair(dm, c, side, side * b_1, side * b_2)
        if u == 0.0 or not settle_pair(dm, c, copysign(1.0, u), u_1 / u, u_2 / u):
            set_out_as_pair(dm, c, side, b_1, b_2)


@compiled
def settle_pair(dm, c, side, b_1, b_2):
    """Find slips parallel to their accelerations by Newton's rule, from the directions `side` (1, b_i).

    The directions are those of `pair_onset`; the slips are written into y. Return False if Newton's rule finds none, or
    slips that would decrease.
    """
    for _ in range(MAX_NEWTON):
        along, r_1, r_2 = set_out_as_pair(dm, c, side, b_1, b_2)
        d_1, d_2 = PAIR_SLANT * (1.0 + abs(b_1)), PAIR_SLANT * (1.0 + abs(b_2))
        _, s_11, s_21 = set_out_as_pair(dm, c, side, b_1 + d_1, b_2)
        _, s_12, s_22 = set_out_as_pair(dm, c, side, b_1, b_2 + d_2)
        s_11, s_21, s_12, s_22 = (s_11 - r_1) / d_1, (s_21 - r_2) / d_1, (s_12 - r_1) / d_2, (s_22 - r_2) / d_2
        det = s_11 * s_22 - s_12 * s_21
        step_1, step_2 = (s_12 * r_2 - s_22 * r_1) / det, (s_21 * r_1 - s_11 * r_2) / det
        # a step that would double the tangent leaves the neighbourhood, where the slopes hold
        if not abs(step_1) <= 1.0 + abs(b_1) or not abs(step_2) <= 1.0 + abs(b_2):
            return False
        b_1, b_2 = b_1 + step_1, b_2 + step_2
        if abs(step_1) <= PAIR_KNOWN * (1.0 + abs(b_1)) and abs(step_2) <= PAIR_KNOWN * (1.0 + abs(b_2)):
            along, _, _ = set_out_as_pair(dm, c, side, b_1, b_2)
            return along > 0.0
    return False


@compiled
def turned_pair(dm, c, u, u_1, u_2):
    """Return the slips u, u_1, u_2 (see `rates_of_pair`) to which the given slips turn as their accelerations go on.

    Only the ratios of the returned numbers have a meaning.
    """
    v = PAIR_SPEED * c.slip_tol
    for _ in range(PAIR_TURNS):
        size = max(abs(u), max(abs(u_1), abs(u_2)))
        u, u_1, u_2 = u / size, u_1 / size, u_2 / size
        a, a_1, a_2 = rates_of_pair(dm, c, v * u, v * u_1, v * u_2)
        step = PAIR_TURN / max(abs(a), max(abs(a_1), abs(a_2)))
        u, u_1, u_2 = u + step * a, u_1 + step * a_1, u_2 + step * a_2
    return u, u_1, u_2
