"""Whether a dimer that slides on both ends comes to rest without ever lifting one.

With both ends on the plate the dimer is a rod that slides, turns and rolls in the plane. In the frame of its heading, with
v_a, v_b the velocity of its centre, w = theta', s its spin, h half its length, the slips of the ends are
(v_a, c + h w) and (v_a, c - h w), c = v_b - r s. The normal forces F_1 + F_2 = m g_e(t) carry the weight, and

    h (F_1 - F_2) = J_a s w + r A,    |A| <= mu_h m g_e

(A is the axial friction). So both ends stay loaded as long as J_a |s w| < m g_e (h - r mu_h), with g_e >= g (1 - Gamma). Two
arguments tell what s and w can become.

Let q = J_a / r^2, M = m + q, V = (m v_b + q r s) / M the velocity of rolling that friction across the rod leaves as
it is, and m P^2 = m v_a^2 + (m q / M) c^2 + J_t w^2, so that the energy is (m P^2 + M V^2) / 2. Friction takes
mu (F_1 |u_1| + F_2 |u_2|) from it, and M V' = -m w v_a, whence

    P P' = -mu (F_1 |u_1| + F_2 |u_2|) / m + w v_a V.

There |u_1| + |u_2| >= 2 sqrt(v_a^2 + max(c^2, h^2 w^2)) >= 2 eta P with eta^-2 = max(1, q / M + J_t / (m h^2)), and
|w v_a| <= P^2 / (2 sqrt(J_t / m)). While J_a |s w| is below m g_e (h - r mu_h) / 2, each force is above
m g_e (1 - mu_h r / h) / 4, and so

    P' <= -d g_e(t) + k P,    d = mu eta (1 - mu_h r / h) / 2,    k = max|V| / (2 sqrt(J_t / m)).

If k P <= d g (1 - Gamma), P never grows; if k Q <= d g with Q = P + 2 d A_z omega, P never exceeds Q. The largest P bounds
|w| <= sqrt(m / J_t) P and r |s| <= max|V| + m / sqrt(q M) P, which must keep J_a |s w| below that half.

Besides, friction never gives the rod energy. As long as both ends are loaded, J_a |s w| is at most sqrt(J_a / J_t) times the
energy, and the energy of now bounds it for good.
"""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import CA, CB, SPIN, WP
from dimersweep.kernel.model.plate import lightest, speed_bound


@compiled
def room(dm, g_e, drag):
    """Moment that the weight leaves to the gyroscopic one beside an axial friction of `drag` weights against it [N m]."""
    return dm.m * g_e * (dm.h - dm.r * drag)


@compiled
def sliding_speed(dm, a, b, w, spin):
    """P, the speed of sliding [m/s]: m P^2 / 2 is the energy that friction can still take from the rod."""
    c, q = b - dm.r * spin, dm.J_a / dm.r**2
    return sqrt(a * a + q / (dm.m + q) * c * c + dm.J_t * dm.im * w * w)


@compiled
def is_calm(dm, b, spin, P):
    """Whether what is left of the motion is bounded well enough to tell that both ends stay down."""
    q = dm.J_a / dm.r**2
    M = dm.m + q
    now = (dm.m * b + q * dm.r * spin) / M
    V = sqrt(now * now + dm.m * P * P / M)
    gyration = sqrt(dm.J_t * dm.im)
    eta = 1.0 / sqrt(max(1.0, q / M + (gyration / dm.h) ** 2))
    d, k = 0.5 * dm.mu * eta * (1.0 - dm.mu_h * dm.r / dm.h), 0.5 * V / gyration
    if d < 0.0:
        return False
    speed = speed_bound(dm)
    least = room(dm, lightest(dm), dm.mu_h)
    if 0.5 * (dm.m * P * P + M * now * now) * sqrt(dm.J_a * dm.it) <= least:
        return True
    top = P if k * P <= d * lightest(dm) else P + 2.0 * d * speed
    turn, roll = top / gyration, (V + dm.m / sqrt(q * M) * top) / dm.r
    return k * top <= d * dm.g and dm.J_a * roll * turn <= 0.5 * least


@compiled
def slides_to_rest(dm, state):
    """Whether both ends, which slide on the plate now, are sure to stay on it."""
    a, b, w, spin = state[CA], state[CB], state[WP], state[SPIN]
    if dm.mu == 0.0:
        return dm.J_a * abs(spin * w) <= room(dm, lightest(dm), dm.mu_h)
    return is_calm(dm, b, spin, sliding_speed(dm, a, b, w, spin))
