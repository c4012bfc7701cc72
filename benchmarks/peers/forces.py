"""Contact forces of the peer's law: what keeps the closed ends on the plate, held or slipping.

All is linear in the accelerations of the ends without forces; with rates in their place it gives impulses.
"""

from math import cos, sin

from passage import compiled, gravity, levers

from dimersweep.kernel.model.layout import (
    CA,
    CB,
    DIP,
    SLIP,
    SPIN,
    STICK,
    WB,
    WP,
)


@compiled
def respond(p, q, it, ia):
    """Normal from normal, axial from normal, axial from axial, lateral from lateral, at levers p for impulses at levers q."""
    return 1.0 + p[0] * q[0] * it, p[1] * q[0] * it, 1.0 + p[1] * q[1] * it, 1.0 + p[2] * q[2] * it + p[3] * q[3] * ia


@compiled
def compliance(body, state, s):
    """Of the end with sign s: normal, axial from normal, axial, lateral."""
    p = levers(body, s, sin(state[DIP]), cos(state[DIP]))
    return respond(p, p, body.it, body.ia)


@compiled
def free_rates(body, state, s):
    """Accelerations of the contact point of the end with sign s without contact forces: normal, axial, lateral."""
    h, r = body.h, body.r
    sin_b, cos_b = sin(state[DIP]), cos(state[DIP])
    w_b, w_p, spin = state[WB], state[WP], state[SPIN]
    p = levers(body, s, sin_b, cos_b)
    turn = w_p / cos_b
    axial = body.it / body.ia * spin - sin_b * turn
    n = -gravity(body, state) + p[0] * axial * w_p - s * h * sin_b * w_b * w_b
    a = -turn * state[CB] + p[1] * axial * w_p - s * h * cos_b * w_b * w_b
    b = turn * state[CA] - p[2] * axial * w_b + r * w_b * (cos_b * w_p + sin_b * spin)
    return n, a, b


@compiled
def forces_one(body, w, free, mode, c, d):
    """Normal, axial and lateral force at the only closed end, slipping along (c, d) or held."""
    nn, na, aa, bb = w
    n, a, b = free
    if mode == STICK:
        det = nn * aa - na * na
        return (na * a - aa * n) / det, (na * n - nn * a) / det, -b / bb
    F = -n / (nn - body.mu * na * c)
    return F, -body.mu * F * c, -body.mu * F * d


@compiled
def forces_both(body, free_1, free_2, mode_1, mode_2, c_1, d_1, c_2, d_2):
    """F_1, F_2, axial total, L_1, L_2 of a dimer that lies flat; ends that slip do so along (c_i, d_i)."""
    h, r, it, ia, mu = body.h, body.r, body.it, body.ia, body.mu
    na, aa = h * r * it, 1.0 + r * r * it
    bb, bb_12 = 1.0 + h * h * it + r * r * ia, 1.0 - h * h * it + r * r * ia
    total = -0.5 * (free_1[0] + free_2[0])
    if mode_1 == SLIP and mode_2 == SLIP:
        T_c, T_d = -0.5 * mu * total * (c_1 + c_2), -0.5 * mu * (c_2 - c_1)
    else:
        T_c, T_d = -free_1[1] / aa, -na / aa
    difference = (free_1[0] - free_2[0] - 2.0 * na * T_c) / (2.0 * h * h * it + 2.0 * na * T_d)
    F_1, F_2 = 0.5 * (total - difference), 0.5 * (total + difference)
    L_1, L_2 = -mu * F_1 * d_1, -mu * F_2 * d_2
    if mode_1 == STICK and mode_2 == STICK:
        L_1 = L_2 = -free_1[2] / (bb + bb_12)
    elif mode_1 == STICK:
        L_1 = -(free_1[2] + bb_12 * L_2) / bb
    elif mode_2 == STICK:
        L_2 = -(free_2[2] + bb_12 * L_1) / bb
    return F_1, F_2, T_c + T_d * difference, L_1, L_2
