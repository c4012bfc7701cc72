"""Sine and cosine of one angle at once: in half the time of two library calls, and without numbers of a library.

The angle is brought into [-pi/4, pi/4] by whole right angles (Cody and Waite, pi/2 in two parts, the first of which has
33 bits). There two polynomials have the values to rounding (those of fdlibm: coefficients of its __kernel_sin,
__kernel_cos).
"""

from math import copysign, inf, nan

from dimersweep.kernel.compiler.jit import compiled

SMALL = 0.78  # angle that lies in that interval as it is: slightly less than pi / 4
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
    """Return sine and cosine of an angle of at most half a right angle.

    The terms are added in pairs: a chain half as long as term after term.
    """
    z = y * y
    w = z * z
    s = (S1 + z * S2) + w * ((S3 + z * S4) + w * (S5 + z * S6))
    c = (C1 + z * C2) + w * ((C3 + z * C4) + w * (C5 + z * C6))
    return y + y * z * s, (1.0 - 0.5 * z) + w * c


@compiled(fuse=True)
def sincos(x):
    """Return sin x and cos x, to 1.5 units in the last place.

    Beyond `MOST_ANGLE` they are those of an angle within half such a unit of x; nan where x is not finite.
    """
    if abs(x) <= SMALL:
        return polynomials(x)
    if not abs(x) <= MOST_ANGLE:
        if not abs(x) < inf:
            return nan, nan
        # the remainder is exact, and the rounding of 2 pi counts less than that of x
        x = copysign(abs(x) % TWO_PI, x)
    turns = (x * PER_RIGHT + TO_WHOLE) - TO_WHOLE
    s, c = polynomials((x - turns * RIGHT_HIGH) - turns * RIGHT_LOW)
    quarter = int(turns) & 3
    if quarter & 1:
        s, c = c, s
    return (-s if quarter & 2 else s), (-c if quarter == 1 or quarter == 2 else c)


@compiled(inline=True)
def nearest(x):
    """Round x to the nearest whole number, the even one of two, as a float.

    This holds for an x below 2^51 in size. A larger x stays nearly what it is, and a NaN stays one: an integer made of
    them would depend on the processor.
    """
    return (x + TO_WHOLE) - TO_WHOLE


@compiled(inline=True)
def one_minus_cos(s, c):
    """Return 1 - cos x from sin x, cos x without cancellation."""
    return s * s / (1.0 + c) if c > 0.0 else 1.0 - c


@compiled(inline=True)
def x_minus_sin(x, s):
    """Return x - sin x without cancellation; s is sin x."""
    # above 0.5 no more than five bits cancel; below it the series is good to some units of round-off
    if abs(x) > 0.5:
        return x - s
    y = x * x
    return x * y / 6.0 * (1.0 - y / 20.0 * (1.0 - y / 42.0 * (1.0 - y / 72.0 * (1.0 - y / 110.0 * (1.0 - y / 156.0)))))
