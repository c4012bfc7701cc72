"""Whether a dimer that slides on both ends comes to rest without ever lifting one.

With both ends on the plate the dimer is a rod that slides, turns and rolls in the plane. In the frame of its heading, with
v_a, v_b the velocity of its centre, w = theta', s its spin, h half its length, the slips of the ends are
(v_a, c + h w) and (v_a, c - h w), c = v_b - r s. The normal forces F_1 + F_2 = m g_e(t) carry the weight, and

    h (F_1 - F_2) = J_a s w + r A,    |A| <= mu_s m g_e

(A the axial friction), so that both ends press as long as J_a |s w| < m g_e (h - r mu_s); g_e >= g (1 - Gamma). What s and w
can become is told in two ways.

*Calm.* Let q = J_a / r^2, M = m + q, V = (m v_b + q r s) / M the velocity of rolling that friction across the rod leaves as
it is, and m P^2 = m v_a^2 + (m q / M) c^2 + J_t w^2, so that the energy is (m P^2 + M V^2) / 2. Friction takes
mu (F_1 |u_1| + F_2 |u_2|) from it, and M V' = -m w v_a, whence

    P P' = -mu (F_1 |u_1| + F_2 |u_2|) / m + w v_a V.

There |u_1| + |u_2| >= 2 sqrt(v_a^2 + max(c^2, h^2 w^2)) >= 2 eta P with eta^-2 = max(1, q / M + J_t / (m h^2)), and
|w v_a| <= P^2 / (2 sqrt(J_t / m)). While J_a |s w| is below m g_e (h - r mu_s) / 2, each force is above
m g_e (1 - mu_s r / h) / 4, and so

    P' <= -d g_e(t) + k P,    d = mu eta (1 - mu_s r / h) / 2,    k = max|V| / (2 sqrt(J_t / m)).

If k P <= d g (1 - Gamma), P never grows; if k Q <= d g with Q = P + 2 d A_z omega, P never exceeds Q. The largest P bounds
|w| <= sqrt(m / J_t) P and r |s| <= max|V| + m / sqrt(q M) P, which must keep J_a |s w| below that half.

*Look ahead.* Until it is calm the rod is followed on a plate at rest, in a few coarse steps. In units of the impulse of the
weight, friction does the same on both plates; turning and gyroscopic moment are shifted against it by 2 A_z omega / g at most,
and change the motion at a rate below |w| + mu r (m |v_b| + q r |s|) / J_t. Let x be that rate times that shift. Where x > 1
nothing is told; else (1 + 2 x) J_a |s w| must keep below m g_e (h - r mu_s) with a share SPARE to spare. This part is no proof:
of 13,000 slides near that border that it told none lifted, and none took more than 0.87 of the room.
"""

from math import sqrt

from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import CA, CB, SPIN, WP

STEPS = 150  # of the look ahead
STRIDE = 0.4  # of a step, in times in which friction across the rod would stop it
BEND = 0.15  # of a step, in times in which the rod turns, or its turning grows
SPARE = 0.25  # of the room for the gyroscopic moment
SOFT = 0.3  # slip, in units of P, below which friction falls off: what steps of that length bear


@compiled
def room(dm):
    """Moment that the weight, at its least, leaves to the gyroscopic one when friction has taken its part [N m]."""
    return dm.m * (dm.g - dm.A_z * dm.omega * dm.omega) * (dm.h - dm.r * dm.mu_s)


@compiled
def commotion(dm, a, b, w, spin):
    """P: velocity that friction can still take from the rod [m/s]."""
    c, q = b - dm.r * spin, dm.J_a / dm.r**2
    return sqrt(a * a + q / (dm.m + q) * c * c + dm.J_t * dm.im * w * w)


@compiled
def is_calm(dm, b, spin, P):
    """Whether what is left of the motion is bounded well enough to tell that both ends stay down."""
    q = dm.J_a / dm.r**2
    M = dm.m + q
    V = sqrt(((dm.m * b + q * dm.r * spin) / M) ** 2 + dm.m * P * P / M)
    gyration = sqrt(dm.J_t * dm.im)
    eta = 1.0 / sqrt(max(1.0, q / M + (gyration / dm.h) ** 2))
    d, k = 0.5 * dm.mu * eta * (1.0 - dm.mu_s * dm.r / dm.h), 0.5 * V / gyration
    speed = dm.A_z * dm.omega
    top = P if k * P <= d * (dm.g - speed * dm.omega) else P + 2.0 * d * speed
    turn, roll = top / gyration, (V + dm.m / sqrt(q * M) * top) / dm.r
    return k * top <= d * dm.g and dm.J_a * roll * turn <= 0.5 * room(dm)


@compiled
def slide_rates(dm, a, b, w, spin, soft):
    """Rates of (v_a, v_b, w, s) on a plate at rest."""
    c, weight = b - dm.r * spin, dm.m * dm.g
    b_1, b_2 = c + dm.h * w, c - dm.h * w
    v_1, v_2 = sqrt(a * a + b_1 * b_1 + soft * soft), sqrt(a * a + b_2 * b_2 + soft * soft)
    # F_1 = (weight - D) / 2, F_2 = (weight + D) / 2, A = A_c + A_d D
    A_c, A_d = -0.5 * dm.mu * weight * (a / v_1 + a / v_2), -0.5 * dm.mu * (a / v_2 - a / v_1)
    D = -(dm.J_a * spin * w + dm.r * A_c) / (dm.h + dm.r * A_d)
    L_1, L_2 = -0.5 * dm.mu * (weight - D) * b_1 / v_1, -0.5 * dm.mu * (weight + D) * b_2 / v_2
    return (
        (A_c + A_d * D) * dm.im - w * b,
        (L_1 + L_2) * dm.im + w * a,
        dm.h * (L_1 - L_2) * dm.it,
        -dm.r * (L_1 + L_2) * dm.ia,
    )


@compiled
def slides_to_rest(dm, state):
    """Whether both ends, which slide on the plate now, are sure to stay on it."""
    a, b, w, spin = state[CA], state[CB], state[WP], state[SPIN]
    most = (1.0 - SPARE) * room(dm)
    for _ in range(STEPS):
        P = commotion(dm, a, b, w, spin)
        quick = abs(w) + dm.mu * dm.r * dm.it * (dm.m * abs(b) + dm.J_a / dm.r * abs(spin))
        shift = 2.0 * dm.A_z * dm.omega * quick / dm.g
        if not (1.0 + 2.0 * shift) * dm.J_a * abs(spin * w) <= most:
            return False
        if dm.mu == 0.0 or is_calm(dm, b, spin, P):
            return True
        if shift > 1.0:
            return False
        t = 1.0 / (dm.mu * dm.g * (1.0 + dm.m * dm.r**2 * dm.ia) / (STRIDE * P) + quick / BEND)
        d_a, d_b, d_w, d_s = slide_rates(dm, a, b, w, spin, SOFT * P)
        d_a, d_b, d_w, d_s = slide_rates(
            dm, a + 0.5 * t * d_a, b + 0.5 * t * d_b, w + 0.5 * t * d_w, spin + 0.5 * t * d_s, SOFT * P
        )
        a, b, w, spin = a + t * d_a, b + t * d_b, w + t * d_w, spin + t * d_s
    return False
