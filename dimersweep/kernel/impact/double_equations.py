"""State the law of an impact at both ends at once: the regular form of (6)-(7), and where friction holds.

At a double contact the ends share one axial velocity a. The force of a contact is k_i X_i^eta, with eta = 3/2 for
Hertz's law, so that its energy is E_i = k_i X_i^(eta + 1) / (eta + 1). With dP_i = k_i X_i^eta dtau

    n_1' = W_11 f_1 + W_12 f_2 + w_1 A      a'   = w_1 f_1 + w_2 f_2 + W_aa A
    n_2' = W_12 f_1 + W_22 f_2 + w_2 A      b_i' = B_ii L_i + B_ij L_j
    X_i' = -n_i in compression, -n_i / e_i^2 in restitution

with f_i = k_i X_i^eta, A the total axial and L_i the lateral friction per tau. Where an end begins or ceases to press,
f_i is not smooth in tau. It is smooth in the clock of that end, dtau = Y_i dsigma with X_i = Y_i^2, in which dY_i /
dsigma = X_i' / 2. There Hertz's force is the cube of Y_i, and all can be continued through Y_i = 0. Units: velocities
of the approach speed V, impulses of m V, the Delassus operator of 1/m.
"""

from math import copysign, inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.friction import direction, hold_left, outward_slip, slip_force, slip_strength
from dimersweep.kernel.model.layout import SLIP, STICK
from dimersweep.kernel.numerics.elementary import length, raised

# state of the impact: gap rates, compressions, axial and lateral velocities; and beyond the entries that steps control
# (`steps.WIDTH`), where they are wanted, the works of slip at both ends
ZN1, ZN2, ZX1, ZX2, ZA, ZB1, ZB2 = range(7)
N_Z = 7
ZS1, ZS2, N_RUBBED = 8, 9, 10
HERTZ = 1.5  # exponent of two elastic bodies that touch at a point
# clocks besides those of the ends, 0 and 1: tau, and the common clock of two ends that move alike
PLAIN_CLOCK, BOTH_CLOCK = -1, 2


@compiled(inline=True)
def lateral_of(dm, i):
    """Return the lateral velocity of end i per lateral impulse there."""
    return dm.pair.bb_1 if i == 0 else dm.pair.bb_2


@compiled(fuse=True, inline=True)
def from_sums(split, both, apart):
    """Return the velocity that two forces give, from their sum and their difference.

    So ends that move alike continue to move alike to the last digit, however sums of products are rounded.
    """
    return split.both * both + split.apart * apart


@compiled
def pull(dm, f_1, f_2):
    """Return the axial acceleration that the normal forces give."""
    return from_sums(dm.pair.a, f_1 + f_2, f_1 - f_2)


@compiled(inline=True)
def power(X, eta):
    """Return X^eta for X > 0, else 0.0; a power takes five times as long as the root of Hertz's law."""
    if not X > 0.0:
        return 0.0
    return X * sqrt(X) if eta == HERTZ else raised(X, eta)


@compiled(inline=True)
def force(dm, i, X):
    """Return f_i = k_i X^eta, the normal force of end i per clock tau: (6) for alike ends and Hertz's law."""
    return end(dm, i).k * power(X, dm.eta)


@compiled
def has_root(clock, i):
    """Return True if a state in a clock has Y_i in the place of X_i."""
    return clock == i or clock == BOTH_CLOCK


@compiled(inline=True)
def force_in_clock(dm, clock, i, X):
    """Return f_i from a state in a clock, with X the number in the place of X_i."""
    if not has_root(clock, i):
        return force(dm, i, X)
    k = end(dm, i).k
    return k * (X * X * X) if dm.eta == HERTZ else copysign(k * power(abs(X), 2.0 * dm.eta), X)


@compiled(inline=True)
def forces(dm, z, clock):
    """Return f_1, f_2 of a state in a clock."""
    return force_in_clock(dm, clock, 0, z[ZX1]), force_in_clock(dm, clock, 1, z[ZX2])


@compiled
def stored_energy(dm, i, X):
    """Return the elastic energy E_i of a compression X."""
    return force(dm, i, X) * X / (dm.eta + 1.0) if X > 0.0 else 0.0


@compiled
def compression(dm, i, E):
    """Return the compression X_i of a stored energy E."""
    return raised((dm.eta + 1.0) * E / end(dm, i).k, 1.0 / (dm.eta + 1.0)) if E > 0.0 else 0.0


@compiled
def to_clock(clock, z):
    """Write a state of the plain clock in another clock, in place."""
    for i in range(2):
        if has_root(clock, i):
            z[ZX1 + i] = sqrt(max(0.0, z[ZX1 + i]))


@compiled
def from_clock(clock, z):
    """Write a state in a clock as a state of the plain clock, in place; a Y_i below zero gives a negative X_i."""
    for i in range(2):
        if has_root(clock, i):
            z[ZX1 + i] *= abs(z[ZX1 + i])


@compiled(inline=True)
def friction(dm, modes, f_1, f_2, a, b_1, b_2):
    """Return the total axial friction A and the lateral frictions L_1, L_2 for given friction modes of both ends."""
    if modes[0] == STICK and modes[1] == STICK:
        return -pull(dm, f_1, f_2) / dm.pair.aa, 0.0, 0.0
    # where one end sticks the common axial slip is zero: the other end can slip only laterally
    if modes[0] == STICK:
        _, L_2 = slip_force(dm.p2.mu_hit, f_2, 0.0, copysign(1.0, b_2))
        return -pull(dm, f_1, f_2) / dm.pair.aa, -dm.pair.bb_12 / dm.pair.bb_1 * L_2, L_2
    if modes[1] == STICK:
        _, L_1 = slip_force(dm.p1.mu_hit, f_1, 0.0, copysign(1.0, b_1))
        return -pull(dm, f_1, f_2) / dm.pair.aa, L_1, -dm.pair.bb_12 / dm.pair.bb_2 * L_1
    k_1, k_2 = slip_strength(dm.p1.mu_hit, f_1, length(a, b_1)), slip_strength(dm.p2.mu_hit, f_2, length(a, b_2))
    return -(k_1 + k_2) * a, -k_1 * b_1, -k_2 * b_2


@compiled(fuse=True, inline=True)
def rates_in_clock(dm, modes, gains, clock, z):
    """Return the rates of the state z (seven numbers) of a double impact by (7), in a clock; `gains` are 1 or 1/e^2.

    The factor dtau/dsigma multiplies the forces, which are known before the frictions.
    """
    X_1, X_2 = z[ZX1], z[ZX2]
    pace = 1.0 if clock == PLAIN_CLOCK else (X_2 if clock == 1 else X_1)
    f_1, f_2 = pace * force_in_clock(dm, clock, 0, X_1), pace * force_in_clock(dm, clock, 1, X_2)
    A, L_1, L_2 = friction(dm, modes, f_1, f_2, z[ZA], z[ZB1], z[ZB2])
    w, f, apart, L, L_apart = dm.pair, f_1 + f_2, f_1 - f_2, L_1 + L_2, L_1 - L_2
    return (
        from_sums(w.n_1, f, apart) + w.na_1 * A,
        from_sums(w.n_2, f, apart) + w.na_2 * A,
        -(0.5 if has_root(clock, 0) else pace) * gains[0] * z[ZN1],
        -(0.5 if has_root(clock, 1) else pace) * gains[1] * z[ZN2],
        from_sums(w.a, f, apart) + w.aa * A,
        from_sums(w.b_1, L, L_apart),
        from_sums(w.b_2, L, L_apart),
    )


@compiled(inline=True)
def impact_rates(dm, modes, gains, clock, z, out):
    """Write the rates of the state z of a double impact in a clock into `out`, as `rates_in_clock` gives them."""
    state = z[ZN1], z[ZN2], z[ZX1], z[ZX2], z[ZA], z[ZB1], z[ZB2]
    out[ZN1], out[ZN2], out[ZX1], out[ZX2], out[ZA], out[ZB1], out[ZB2] = rates_in_clock(dm, modes, gains, clock, state)


@compiled
def rub_rates(dm, modes, clock, z, out):
    """Write the work of slip at both ends per clock, in the state z (numbers or an array), into its places in `out`."""
    pace = 1.0 if clock == PLAIN_CLOCK else (z[ZX2] if clock == 1 else z[ZX1])
    for i in range(2):
        out[ZS1 + i] = 0.0
        if modes[i] == SLIP:
            a, b = z[ZA], z[ZB1 + i]
            A, L = slip_force(end(dm, i).mu_hit, pace * force_in_clock(dm, clock, i, z[ZX1 + i]), *direction(a, b))
            out[ZS1 + i] = A * a + L * b


@compiled
def axial_hold_left(dm, f_1, f_2, A):
    """Return how far the friction A that holds both ends is from its limit; negative beyond it.

    Neither end slips sideways.
    """
    return dm.p1.mu_s * f_1 + dm.p2.mu_s * f_2 - abs(A)


@compiled(inline=True)
def stick_reserve(dm, modes, i, z, f_1, f_2):
    """Return how far the friction that holds end i is from its limit; inf if it slips.

    With both ends held, only the sum of the axial parts counts.
    """
    if modes[i] != STICK:
        return inf
    A, L_1, L_2 = friction(dm, modes, f_1, f_2, z[ZA], z[ZB1], z[ZB2])
    if modes[1 - i] == STICK:
        return axial_hold_left(dm, f_1, f_2, A)
    return hold_left(dm.p1.mu_s, f_1, A, L_1) if i == 0 else hold_left(dm.p2.mu_s, f_2, A, L_2)


@compiled
def hold_or_slip(dm, i, z, f_1, f_2, tol, hold_ended):
    """Return the friction mode of end i, at rest beside an end that slips laterally.

    If end i slips, its slip in z is set to half of tol, outward. `hold_ended` is True if friction has just ceased to
    hold it.
    """
    own, other, bb = end(dm, i), end(dm, 1 - i), lateral_of(dm, i)
    f_i, f_j = (f_1, f_2) if i == 0 else (f_2, f_1)
    z[ZA], z[ZB1 + i] = 0.0, 0.0
    drive = pull(dm, f_1, f_2)
    side = -dm.pair.bb_12 * other.mu_hit * f_j * copysign(1.0, z[ZB2 - i])
    if not hold_ended and hold_left(own.mu_s, f_i, drive / dm.pair.aa, side / bb) >= 0.0:
        return STICK
    d_a, d_b = outward_slip(drive, side, own.mu_hit * f_i * dm.pair.aa, own.mu_hit * f_i * bb)
    # half of the slip that counts as none: enough for a direction, and twice the slip at which a slip ends
    # (SLIP_ENDS_AT)
    z[ZA], z[ZB1 + i] = 0.5 * tol * d_a, 0.5 * tol * d_b
    return SLIP


@compiled
def friction_modes(dm, z, modes, tol, hold_ended):
    """Write the friction modes of both ends for the present slips and forces into `modes`.

    Slips below tol are set to rest. `hold_ended` is True if friction has just ceased to hold an end at rest, whatever
    rounding says of the limit.
    """
    f_1, f_2 = first_forces(dm, z)
    at_rest_1 = length(z[ZA], z[ZB1]) <= tol
    at_rest_2 = length(z[ZA], z[ZB2]) <= tol
    modes[0], modes[1] = SLIP, SLIP
    if at_rest_1 and at_rest_2:
        z[ZA], z[ZB1], z[ZB2] = 0.0, 0.0, 0.0
        drive = pull(dm, f_1, f_2)
        if not hold_ended and axial_hold_left(dm, f_1, f_2, drive / dm.pair.aa) >= 0.0:
            modes[0], modes[1] = STICK, STICK
        else:
            # half of the slip that counts as none, the way that the normal forces drive it
            z[ZA] = copysign(0.5 * tol, drive)
    elif at_rest_1:
        modes[0] = hold_or_slip(dm, 0, z, f_1, f_2, tol, hold_ended)
    elif at_rest_2:
        modes[1] = hold_or_slip(dm, 1, z, f_1, f_2, tol, hold_ended)


@compiled
def first_forces(dm, z):
    """Return forces with the ratio that they have at the start of a phase.

    They are k X^eta, or k (-n)^eta where both compressions are only beginning: there X_i grows as -n_i times tau.
    """
    if z[ZX1] > 0.0 or z[ZX2] > 0.0:
        return force(dm, 0, z[ZX1]), force(dm, 1, z[ZX2])
    return force(dm, 0, -z[ZN1]), force(dm, 1, -z[ZN2])
