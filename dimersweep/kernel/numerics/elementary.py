"""The elementary functions of the kernel, to 1.3 units in the last place: no number depends on a library.

Arguments are reduced as in fdlibm: by Cody and Waite, ln 2 in two parts, the first of which has 33 bits. The
polynomials of logarithm and arctangent are those of its e_log and s_atan. Powers carry the logarithm in two numbers,
whose products are split as by Dekker and Veltkamp.
"""

from math import copysign, inf, nan, sqrt

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.numerics.sincos import TO_WHOLE, sincos

PER_LN2, LN2_HIGH, LN2_LOW = 1.44269504088896338700, 6.93147180369123816490e-01, 1.90821492927058770002e-10
LEAST_EXP, MOST_EXP = -708.0, 709.0  # exponents beyond which exp x is taken for zero, or for infinite
# 1 / n! from n = 2 on
E2, E3, E4, E5, E6, E7, E8, E9 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040, 1 / 40320, 1 / 362880
E10, E11, E12, E13 = 1 / 3628800, 1 / 39916800, 1 / 479001600, 1 / 6227020800
E14, E15, E16, E17 = 1 / 87178291200, 1 / 1307674368000, 1 / 20922789888000, 1 / 355687428096000
ROOT_2 = 1.4142135623730951
MANTISSA, BIAS, EXPONENT = 52, 1023, 0x3FF0000000000000  # bits of a float's mantissa, and those of the exponent of 1
FRACTION = 0xFFFFFFFFFFFFF
LEAST_NORMAL = 2.2250738585072014e-308  # the least float with all its bits
# 2^54, by which a float below LEAST_NORMAL is multiplied to have them, and 54
RAISE, RAISED = 18014398509481984.0, 54
LOG_1, LOG_2, LOG_3 = 6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01
LOG_4, LOG_5, LOG_6 = 2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01
LOG_7 = 1.479819860511658591e-01
SPLIT = 134217729.0  # 2^27 + 1: splits the 53 bits of a float in halves (Veltkamp)
ATAN_0, ATAN_1, ATAN_2 = 3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01
ATAN_3, ATAN_4, ATAN_5 = -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02
ATAN_6, ATAN_7, ATAN_8 = 6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02
ATAN_9, ATAN_10 = -3.65315727442169155270e-02, 1.62858201153657823623e-02
HALF_HIGH, HALF_LOW = 4.63647609000806093515e-01, 2.26987774529616870924e-17  # arctangent of 1/2
EIGHTH_HIGH, EIGHTH_LOW = 7.85398163397448278999e-01, 3.06161699786838301793e-17  # pi / 4


# --- exponential ------------------------------------------------------------------------------------------------------


@compiled(fuse=True)
def series(x):
    """Return exp(x) - 1 for |x| of at most half of ln 2, by its power series."""
    z = x * x
    w = z * z
    low = (E2 + x * E3) + z * (E4 + x * E5) + w * ((E6 + x * E7) + z * (E8 + x * E9))
    high = (E10 + x * E11) + z * (E12 + x * E13) + w * ((E14 + x * E15) + z * (E16 + x * E17))
    return x + z * (low + w * w * high)


@compiled(inline=True)
def two_to(k):
    """Return 2^k for a whole k from -1022 to 1023."""
    return float(np.int64((k + BIAS) << MANTISSA).view(np.float64))


@compiled(fuse=True)
def reduced_exp(x, more):
    """Return k and e of exp(x + more) = 2^k (1 + e); `more` is less than the rounding of x."""
    k = (x * PER_LN2 + TO_WHOLE) - TO_WHOLE
    high, low = x - k * LN2_HIGH, k * LN2_LOW - more
    rest = high - low
    return int(k), series(rest) + ((high - rest) - low)


@compiled
def exp_of_pair(x, more):
    """Return exp(x + more), `more` being less than the rounding of x; zero or inf beyond `LEAST_EXP`, `MOST_EXP`."""
    if not LEAST_EXP <= x <= MOST_EXP:
        return 0.0 if x < LEAST_EXP else (inf if x > MOST_EXP else nan)
    k, e = reduced_exp(x, more)
    return two_to(k) * (1.0 + e)


@compiled
def exp(x):
    """Return exp(x); zero or inf where x is beyond `LEAST_EXP`, `MOST_EXP`."""
    return exp_of_pair(x, 0.0)


# --- logarithm and powers -----------------------------------------------------------------------------------------------


@compiled
def mantissa(x):
    """Return k and m with x = 2^k m, m between the root of 1/2 and that of 2, for a finite x > 0."""
    k = -BIAS
    if x < LEAST_NORMAL:
        x, k = x * RAISE, k - RAISED
    bits = np.float64(x).view(np.int64)
    m = float(np.int64((bits & FRACTION) | EXPONENT).view(np.float64))
    k += bits >> MANTISSA
    return (k + 1, 0.5 * m) if m > ROOT_2 else (k, m)


@compiled(fuse=True)
def log_rest(s):
    """Return (log(1 + f) - 2 s) / s for s = f / (2 + f)."""
    z = s * s
    w = z * z
    return z * ((LOG_1 + w * (LOG_3 + w * (LOG_5 + w * LOG_7))) + z * (LOG_2 + w * (LOG_4 + w * LOG_6)))


@compiled
def log(x):
    """Return log(x) for a finite x > 0, to 1.7 units in the last place."""
    k, m = mantissa(x)
    f = m - 1.0
    s = f / (2.0 + f)
    return k * LN2_HIGH + (2.0 * s + (s * log_rest(s) + k * LN2_LOW))


@compiled
def upper(x):
    """Return the upper half of the bits of x."""
    big = SPLIT * x
    return big - (big - x)


@compiled
def log_pair(x):
    """Return log(x) as two numbers whose sum has 20 bits more than one number; for a finite x > 0."""
    k, m = mantissa(x)
    f = m - 1.0
    d = 2.0 + f
    d_high, s_high = upper(d), upper(f / d)
    s_low = ((f - s_high * d_high) - s_high * ((d - d_high) + (f - (d - 2.0)))) / d
    s = s_high + s_low
    big, small = k * LN2_HIGH, 2.0 * s_high
    most = big + small
    rest = ((big - most) + small) + (k * LN2_LOW + (2.0 * s_low + s * log_rest(s)))
    high = most + rest
    return high, (most - high) + rest


@compiled
def raised(x, y):
    """Return x^y for x >= 0, y > 0; zero or inf where it is beyond exp(`LEAST_EXP`), exp(`MOST_EXP`)."""
    if not 0.0 < x < inf:
        return x
    high, low = log_pair(x)
    whole, y_high = upper(high), upper(y)
    product = y * high
    part, y_part = high - whole, y - y_high
    rounding = ((y_high * whole - product) + y_high * part + y_part * whole) + y_part * part
    return exp_of_pair(product, rounding + y * low)


@compiled
def nearly_raised(x, y):
    """Return `raised` in half its time, for the size of a step.

    Its error is some units in the last place times the logarithm of the power.
    """
    return exp(y * log(x)) if 0.0 < x < inf else x


@compiled
def multiplied(x, n):
    """Return x^n for a whole n >= 0 by multiplications. (The compiler's own way calls the library where n is huge.)"""
    product = 1.0
    while n > 0:
        if n & 1:
            product *= x
        x *= x
        n >>= 1
    return product


@compiled
def eighth_root(x):
    """Return x^(1/8) by three square roots, faster than `raised`."""
    return sqrt(sqrt(sqrt(x)))


@compiled
def length(a, b):
    """Return the length of a vector whose square neither vanishes nor overflows (``hypot`` is the system's)."""
    return sqrt(a * a + b * b)


# --- arctangent ---------------------------------------------------------------------------------------------------------


@compiled(fuse=True)
def atan_lack(t):
    """Return t less its arctangent, for a t between -7/16 and 7/16."""
    z = t * t
    w = z * z
    odd = z * (ATAN_0 + w * (ATAN_2 + w * (ATAN_4 + w * (ATAN_6 + w * (ATAN_8 + w * ATAN_10)))))
    return t * (odd + w * (ATAN_1 + w * (ATAN_3 + w * (ATAN_5 + w * (ATAN_7 + w * ATAN_9)))))


@compiled
def atan2(y, x):
    """Return the angle of the finite vector (x, y) in [-pi, pi]; y where both are zero."""
    steep = abs(y) > abs(x)
    small, great = (abs(x), abs(y)) if steep else (abs(y), abs(x))
    if great == 0.0:
        return y
    if 16.0 * small < 7.0 * great:
        t = small / great
        high, low = 0.0, 0.0
    elif 16.0 * small < 11.0 * great:
        t = (2.0 * small - great) / (2.0 * great + small)
        high, low = HALF_HIGH, HALF_LOW
    else:
        t = (small - great) / (small + great)
        high, low = EIGHTH_HIGH, EIGHTH_LOW
    angle = high - ((atan_lack(t) - low) - t)
    if steep:
        angle = 2.0 * EIGHTH_HIGH - (angle - 2.0 * EIGHTH_LOW)
    if x < 0.0:
        angle = 4.0 * EIGHTH_HIGH - (angle - 4.0 * EIGHTH_LOW)
    return copysign(angle, y)


# --- for Python: its own depend on the system's library, and numpy's on the processor -------------------------------------

FUNCTIONS = ("sin x", "cos x", "exp x", "log |x|", "|x|^|y|", "atan2(y, x)")


@exported
def fill_functions(x, y, out):
    """Compute all `FUNCTIONS` at x[k], y[k], and write them into row k of `out`, one column for each function.

    `x` and `y` are finite and have the shape (n,), `out` has the shape (n, 6). log |x| has no meaning at x = 0.
    """
    for k in range(x.size):
        out[k, 0], out[k, 1] = sincos(x[k])
        out[k, 2], out[k, 3] = exp(x[k]), log(abs(x[k]))
        out[k, 4], out[k, 5] = raised(abs(x[k]), abs(y[k])), atan2(y[k], x[k])


def functions(x, y=1.0):
    """Return all `FUNCTIONS` of two numbers, or of arrays of one shape, along a last axis."""
    x, y = (np.array(each, float) for each in np.broadcast_arrays(x, y))
    out = np.empty((*x.shape, len(FUNCTIONS)))
    fill_functions(x.ravel(), y.ravel(), out.reshape(-1, len(FUNCTIONS)))
    return out


def angles(y, x):
    """Return the angle of finite vectors (x, y) in [-pi, pi]; floats, or arrays of one shape."""
    return functions(x, y)[..., -1]


def sine_and_cosine(x):
    """Return sine and cosine of an angle by `sincos`, as a list of two."""
    return functions(x)[:2].tolist()
