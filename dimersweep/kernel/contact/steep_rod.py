"""Rates of a contact of one end in the upright chart, by (2)-(4): the rod as a top in fixed axes, regular at the vertical.

With k the axis from p1 to p2, w = k x k' + spin k and the torque T of the contact force about the centre of mass,

    k'' = -|k'|^2 k + (J_a / J_t) spin k x k' + T x k / J_t,    J_a spin' = k . T,

and the contact point of end s moves with V + s h k' - r w x z. At a moment the force is that of the heading frame (A.1-A.3).
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    KA,
    KB,
    KDA,
    KDB,
    YGAMMA,
    YS,
    YTIME,
    YUA,
    YUB,
    YX,
    YY,
    axis,
)
from dimersweep.kernel.model.body import delassus, levers
from dimersweep.kernel.model.friction import single_forces
from dimersweep.kernel.model.layout import SLIP


@compiled
def upright_rates(dm, mode, p, g_e, A_a, A_b, y, path, dy, F, first):
    """Rates of y into dy; normal force and friction along the axes a, b of the chart into F from number `first` on; the
    compliance, which is returned.
    """
    # right-handed coordinates: x along b, y along a, z upwards
    h, r, spin = p.h, p.r, y[YS]
    kz, dz, cos_b, c, d = axis(p.s, y)
    kx, ky, dx, dy_ = y[KB], y[KA], y[KDB], y[KDA]
    wx, wy, wz = ky * dz - kz * dy_, kz * dx - kx * dz, kx * dy_ - ky * dx  # k x k'
    square, gyro = dx * dx + dy_ * dy_ + dz * dz, dm.J_a * dm.it * spin
    ax, ay, az = gyro * wx - square * kx, gyro * wy - square * ky, gyro * wz - square * kz
    rest = (1.0 - dm.J_a * dm.it) * spin  # w' without torque is rest k'
    fx, fy, fn = A_b + h * ax - r * rest * dy_, A_a + h * ay + r * rest * dx, h * az - g_e
    lv = levers(p, kz, cos_b)
    u_a, u_b = y[YUA] * c + y[YUB] * d, y[YUB] * c - y[YUA] * d
    w = delassus(dm, lv, lv)
    N, A, L, compliance = single_forces(dm, p.mu, mode, w, u_a, u_b, fn, fy * c + fx * d, fx * c - fy * d)
    Fy, Fx = A * c - L * d, A * d + L * c
    F[first], F[first + 1], F[first + 2] = N, Fy, Fx
    px, py, pz = h * kx, h * ky, h * kz - r  # from the centre of mass to the contact
    Tx, Ty, Tz = py * N - pz * Fy, pz * Fx - px * N, px * Fy - py * Fx
    bx, by = dm.it * (Ty * kz - Tz * ky), dm.it * (Tz * kx - Tx * kz)  # T x k / J_t
    bz = dm.it * (Tx * ky - Ty * kx)
    spun = dm.ia * (kx * Tx + ky * Ty + kz * Tz)
    dy[KB], dy[KA], dy[KDB], dy[KDA], dy[YS] = dx, dy_, ax + bx, ay + by, spun
    dy[YUA], dy[YUB] = 0.0, 0.0
    if mode == SLIP:
        # what the torque adds to w': k x (T x k) / J_t + spin' k
        ux, uy = ky * bz - kz * by + spun * kx, kz * bx - kx * bz + spun * ky
        dy[YUB] = fx + dm.im * Fx + h * bx - r * uy
        dy[YUA] = fy + dm.im * Fy + h * by + r * ux
    dy[YTIME] = 1.0
    if not path:
        return compliance
    wx, wy = wx + spin * kx, wy + spin * ky
    dy[YX] = y[YUB] - (h - dm.p1.h) * dx + r * wy
    dy[YY] = y[YUA] - (h - dm.p1.h) * dy_ - r * wx
    dy[YGAMMA] = spin + (dy_ * kx - dx * ky) / (kz - p.s)
    return compliance
