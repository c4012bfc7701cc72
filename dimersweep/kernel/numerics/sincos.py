"""Sine and cosine of one angle at once, in half the time of two library calls, whose numbers may depend on the library.

The angle is brought into [-pi/4, pi/4] by whole right angles (Cody and Waite, pi/2 in two parts, the first of which has 33
bits), where two polynomials have the values to rounding (those of fdlibm: coefficients of its __kernel_sin, __kernel_cos).
"""

from math import copysign, inf, nan

from dimersweep.kernel.compiler.jit import compiled

SMALL = 0.78  # angle that is in that interval as it is
MOST_ANGLE = 1e5  # angle up to which the first product of the reduction is exact, with room to spare
PER_RIGHT = 0.63661977236758134  # 2 / pi
TWO_PI = 6.283185307179586
RIGHT_HIGH, RIGHT_LOW = 1.57079632673412561417, 6.07710050650619224932e-11  # pi / 2
TO_WHOLE = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to a whole number
S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


@compiled(fuse=True, inline=True)
def polynomials(y):
    """Sine and cosine of an angle within a right angle's half, by pairs of terms: a chain half as long as term after term."""
    z = y * y
    w = z * z
    s = (S1 + z * S2) + w * ((S3 + z * S4) + w * (S5 + z * S6))
    c = (C1 + z * C2) + w * ((C3 + z * C4) + w * (C5 + z * C6))
    return y + y * z * s, (1.0 - 0.5 * z) + w * c


@compiled(fuse=True)
def sincos(x):
    """sin x and cos x, to 1.5 units in the last place; beyond `MOST_ANGLE`, of an angle within half of such a unit of x."""
    if abs(x) <= SMALL:
        return polynomials(x)
    if not abs(x) <= MOST_ANGLE:
        if not abs(x) < inf:
            return nan, nan
        x = copysign(abs(x) % TWO_PI, x)  # exact, and 2 pi is rounded off by less than x
    turns = (x * PER_RIGHT + TO_WHOLE) - TO_WHOLE
    s, c = polynomials((x - turns * RIGHT_HIGH) - turns * RIGHT_LOW)
    quarter = int(turns) & 3
    if quarter & 1:
        s, c = c, s
    return (-s if quarter & 2 else s), (-c if quarter == 1 or quarter == 2 else c)


@compiled(inline=True)
def one_minus_cos(s, c):
    """1 - cos x from sin x, cos x without cancellation."""
    return s * s / (1.0 + c) if c > 0.0 else 1.0 - c


@compiled(inline=True)
def x_minus_sin(x, s):
    """x - sin x without cancellation."""
    if abs(x) > 0.5:
        return x - s
    y = x * x
    return x * y / 6.0 * (1.0 - y / 20.0 * (1.0 - y / 42.0 * (1.0 - y / 72.0 * (1.0 - y / 110.0 * (1.0 - y / 156.0)))))
