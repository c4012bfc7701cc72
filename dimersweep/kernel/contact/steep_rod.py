"""Compute the rates of a contact of one end in the upright chart, by (2)-(4): the rod as a top in fixed axes.

They are regular at the vertical. With k the axis from p1 to p2, w = k x k' + spin k and the torque T of the contact
force about the centre of mass,

    k'' = -|k'|^2 k + (J_a / J_t) spin k x k' + T x k / J_t,    J_a spin' = k . T,

and the contact point of end s moves with V + s h k' - r w x z. At a moment the force is that of the heading frame
(A.1-A.3).
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import Y, axis
from dimersweep.kernel.model.body import delassus, levers
from dimersweep.kernel.model.friction import single_forces, slip_mu
from dimersweep.kernel.model.layout import SLIP
from dimersweep.kernel.numerics.elementary import length


@compiled
def upright_rates(dm, mode, p, pull, y, path, dy):
    """Write the rates of y in the upright chart into dy; return the forces and the compliance.

    The forces are the normal force and the friction along the axes a and b of the chart [N].
    """
    # right-handed coordinates: x along b, y along a, z upwards
    h, r, spin = p.h, p.r, y[Y.spin]
    kz, dz, cos_b, c, d = axis(p.s, y)
    kx, ky, dx, dy_ = y[Y.k_b], y[Y.k_a], y[Y.dk_b], y[Y.dk_a]
    wx, wy, wz = ky * dz - kz * dy_, kz * dx - kx * dz, kx * dy_ - ky * dx  # k x k'
    square, gyro = dx * dx + dy_ * dy_ + dz * dz, dm.J_a * dm.it * spin
    ax, ay, az = gyro * wx - square * kx, gyro * wy - square * ky, gyro * wz - square * kz
    # without torque w' = rest k'
    rest = (1.0 - dm.J_a * dm.it) * spin
    fx, fy, fn = pull.b + h * ax - r * rest * dy_, pull.a + h * ay + r * rest * dx, h * az - pull.down
    lv = levers(p, kz, cos_b)
    u_a, u_b = y[Y.u_a] * c + y[Y.u_b] * d, y[Y.u_b] * c - y[Y.u_a] * d
    w = delassus(dm, lv, lv)
    N, A, L, compliance = single_forces(
        dm, slip_mu(p, length(u_a, u_b)), mode, w, u_a, u_b, fn, fy * c + fx * d, fx * c - fy * d
    )
    Fy, Fx = A * c - L * d, A * d + L * c
    px, py, pz = h * kx, h * ky, h * kz - r  # from the centre of mass to the contact
    Tx, Ty, Tz = py * N - pz * Fy, pz * Fx - px * N, px * Fy - py * Fx
    bx, by = dm.it * (Ty * kz - Tz * ky), dm.it * (Tz * kx - Tx * kz)  # T x k / J_t
    bz = dm.it * (Tx * ky - Ty * kx)
    spun = dm.ia * (kx * Tx + ky * Ty + kz * Tz)
    dy[Y.k_b], dy[Y.k_a], dy[Y.dk_b], dy[Y.dk_a], dy[Y.spin] = dx, dy_, ax + bx, ay + by, spun
    dy[Y.u_a], dy[Y.u_b] = 0.0, 0.0
    if mode == SLIP:
        # the torque adds k x (T x k) / J_t + spin' k to w'
        ux, uy = ky * bz - kz * by + spun * kx, kz * bx - kx * bz + spun * ky
        dy[Y.u_b] = fx + dm.im * Fx + h * bx - r * uy
        dy[Y.u_a] = fy + dm.im * Fy + h * by + r * ux
    dy[Y.time] = 1.0
    if path:
        wx, wy = wx + spin * kx, wy + spin * ky
        dy[Y.x] = y[Y.u_b] - (h - dm.p1.h) * dx + r * wy
        dy[Y.y] = y[Y.u_a] - (h - dm.p1.h) * dy_ - r * wx
        dy[Y.gamma] = spin + (dy_ * kx - dx * ky) / (kz - p.s)
    return N, Fy, Fx, compliance
