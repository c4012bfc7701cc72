"""The vibrating plate: its height, and all that follows from it. Another waveform is written here, and nowhere else.

    z_p = sum over k = 1 ... 16 of A_k sin(k phase + lag_k),    phase = omega t + phi0,    lag_k = phi_k - k phi0

with A_k (k omega)^2 = Gamma_k g; A_1 is the paper's A_z, and lag_1 is zero. In the frame of the plate gravity is g_e =
g + z_p''. The sine and the cosine of the phase give those of its multiples, one after the other.

A plate that is tilted, or moves along its own axes X and Y too, gives the body the acceleration, relative to the plate,

    A_x = g sin(tilt) cos(azimuth) + sum over k of Gamma_x_k g sin(k phase + phi_x_k),

A_y likewise with sin(azimuth), Gamma_y_k, phi_y_k, and g_e has g cos(tilt) in the place of g. Then, and only then, the
heading of the dimer counts.
"""

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, plain
from dimersweep.kernel.model.layout import HARMONICS, ROW_PHI0, ROW_X, ROW_Y, ROW_Z
from dimersweep.kernel.numerics.sincos import TWO_PI, one_minus_cos, sincos, x_minus_sin

STEADY = 1e-9  # acceleration across the heading, in g, that counts as none: rounding of a tilt along the heading
CREST_EXCESS = 1e-9  # excess of the bound on a crest over the crest, in units of the sum of all harmonics


# --- constants of a plate ---------------------------------------------------------------------------------------------


@compiled
def set_plate(row, f, g, tilt, azimuth, dm):
    """Set the plate of one parameter row.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    f, g, tilt, azimuth : float
        Of the row: frequency [Hz], gravity [m s-2], slope and its direction [rad].
    dm : Dimer
        Filled in place.
    """
    sin_tilt, cos_tilt = sincos(tilt)
    sin_azimuth, cos_azimuth = sincos(azimuth)
    omega, phi0 = TWO_PI * f, row[ROW_PHI0]
    dm.omega, dm.period, dm.g, dm.phi0 = omega, 1.0 / f, g * cos_tilt, phi0 - TWO_PI * (phi0 // TWO_PI)
    dm.fall_x, dm.fall_y = g * sin_tilt * cos_azimuth, g * sin_tilt * sin_azimuth
    dm.n_z, dm.n_along, dm.sideways = 1, 1, 0.0 if tilt == 0.0 else 1.0
    speed, acceleration, jerk, snap = 0.0, 0.0, 0.0, 0.0
    for j in range(HARMONICS):
        k = j + 1.0
        Gamma, Gamma_x, Gamma_y = row[ROW_Z + 2 * j], row[ROW_X + 2 * j], row[ROW_Y + 2 * j]
        dm.A[j], dm.G_x[j], dm.G_y[j] = Gamma * g / (k * omega * (k * omega)), Gamma_x * g, Gamma_y * g
        if Gamma != 0.0:
            dm.n_z = j + 1
        s, c = sincos((row[ROW_Z + 2 * j + 1] - k * phi0) % TWO_PI) if Gamma != 0.0 else (0.0, 1.0)
        dm.A_sin[j], dm.A_cos[j] = dm.A[j] * c, dm.A[j] * s
        if Gamma_x != 0.0 or Gamma_y != 0.0:
            dm.n_along, dm.sideways = j + 1, 1.0
            dm.lag_x[j], dm.lag_y[j] = row[ROW_X + 2 * j + 1] % TWO_PI, row[ROW_Y + 2 * j + 1] % TWO_PI
        speed += k * dm.A[j]
        acceleration += k * k * dm.A[j]
        jerk += k * k * k * dm.A[j]
        snap += k * k * k * k * dm.A[j]
    dm.tempo, dm.most_speed, dm.most_acceleration = dm.n_z * omega, speed * omega, acceleration * (omega * omega)
    dm.most_jerk, dm.most_snap = jerk * (omega * omega * omega), snap * (omega * omega) * (omega * omega)


@compiled(inline=True)
def next_multiple(s, c, s1, c1):
    """Return sine and cosine of the sum of two angles; the sine of a small sum keeps all its digits."""
    return s * c1 + c * s1, c * c1 - s * s1


@compiled
def wave(dm, phase):
    """Return -z_p'' [m s-2], and its derivative with respect to the phase."""
    value, slope, s, c = 0.0, 0.0, 0.0, 1.0
    s1, c1 = sincos(phase)
    for j in range(dm.n_z):
        s, c = next_multiple(s, c, s1, c1)
        k = j + 1.0
        w2 = k * k * dm.omega * dm.omega
        value += w2 * (dm.A_sin[j] * s + dm.A_cos[j] * c)
        slope += k * w2 * (dm.A_sin[j] * c - dm.A_cos[j] * s)
    return value, slope


@compiled
def crest(dm):
    """Return a bound of -z_p'' over all phases, above its maximum by `CREST_EXCESS` at most [m s-2].

    Steps lead round the cycle. Over each the wave certainly stays below the greatest value so far (its curvature is at
    most `bend`), or certainly rises to the end of the step. A coarse round finds the crest, so that the second round
    need not climb it.
    """
    bend, top, spare = dm.most_snap / (dm.omega * dm.omega), -inf, 0.0
    for excess in (1e-3, CREST_EXCESS):  # the coarse round, and the fine one
        phase, spare = 0.0, excess * dm.most_acceleration
        while phase < TWO_PI:
            value, slope = wave(dm, phase)
            top = max(top, value)
            phase += max(slope, sqrt(slope * slope + 2.0 * bend * (top - value + spare)) - slope) / bend
    return top + spare


@compiled
def lightest(dm):
    """Return the least g_e of a cycle [m s-2]."""
    return dm.g - (dm.A[0] * dm.omega * dm.omega if dm.n_z == 1 else crest(dm))


@compiled
def heaviest(dm):
    """Return a bound of g_e from above [m s-2]."""
    return dm.g + dm.most_acceleration


# --- the plate at a phase ---------------------------------------------------------------------------------------------


@compiled
def plate_rate(dm, phase):
    """Return z_p' [m s-1]."""
    s1, c1 = sincos(phase)
    rate, s, c = dm.A[0] * dm.omega * c1, s1, c1
    for j in range(1, dm.n_z):
        s, c = next_multiple(s, c, s1, c1)
        rate += (j + 1.0) * dm.omega * (dm.A_sin[j] * c - dm.A_cos[j] * s)
    return rate


@compiled(inline=True)
def effective_gravity(dm, phase):
    """Return g_e = g + z_p'' [m s-2]."""
    s, c = sincos(phase)
    g_e = dm.g - dm.A[0] * dm.omega * dm.omega * s
    return g_e if dm.n_z == 1 else g_e - higher_acceleration(dm, s, c)


@compiled
def higher_acceleration(dm, s1, c1):
    """Return the part of the higher harmonics in -z_p'' [m s-2], from sine and cosine of the phase.

    (It is a function of its own because its callers often stay small without it.)
    """
    a, s, c = 0.0, s1, c1
    for j in range(1, dm.n_z):
        s, c = next_multiple(s, c, s1, c1)
        k = j + 1.0
        a += k * k * (dm.A_sin[j] * s + dm.A_cos[j] * c)
    return a * dm.omega * dm.omega


# --- along the plate --------------------------------------------------------------------------------------------------


@compiled
def acceleration_along(dm, phase, theta):
    """Return A_a, A_b, the acceleration of the body relative to the plate [m s-2].

    A_a is along the heading theta, A_b across it.
    """
    a_x, a_y = dm.fall_x, dm.fall_y
    for j in range(dm.n_along):
        k = j + 1.0
        s_x, _ = sincos(k * phase + dm.lag_x[j])
        s_y, _ = sincos(k * phase + dm.lag_y[j])
        a_x, a_y = a_x + dm.G_x[j] * s_x, a_y + dm.G_y[j] * s_y
    sin_t, cos_t = sincos(theta)
    return a_y * cos_t - a_x * sin_t, a_x * cos_t + a_y * sin_t


@compiled
def most_along(dm):
    """Return a bound of the acceleration of the body along the plate, in any direction [m s-2]."""
    most_x, most_y = abs(dm.fall_x), abs(dm.fall_y)
    for j in range(dm.n_along):
        most_x, most_y = most_x + abs(dm.G_x[j]), most_y + abs(dm.G_y[j])
    return sqrt(most_x * most_x + most_y * most_y)


@compiled
def keeps_speed(dm, theta, w_p):
    """Return True if a dimer that rolls on both ends has the same speed after each cycle.

    The plate must not fall across the heading theta. Where the ends are unlike the dimer rolls as a cone does, so that
    its heading must not change, either; w_p is its rate of turning (WP).
    """
    if dm.sideways == 0.0:
        return True
    sin_t, cos_t = sincos(theta)
    fall = abs(dm.fall_x * cos_t + dm.fall_y * sin_t)
    if dm.p1.r != dm.p2.r:
        fall += abs(w_p) * dm.v_scale
        for j in range(dm.n_along):
            fall += abs(dm.G_x[j] * cos_t) + abs(dm.G_y[j] * sin_t)
    return fall <= STEADY * dm.g


@compiled
def velocity_along(dm, phase):
    """Return the velocity of the plate along its axes X, Y [m s-1]."""
    # -0.0 plus a number is that number, also where it is a zero of either sign
    v_x, v_y = -0.0, -0.0
    for j in range(dm.n_along):
        k = j + 1.0
        _, c_x = sincos(k * phase + dm.lag_x[j])
        _, c_y = sincos(k * phase + dm.lag_y[j])
        v_x, v_y = v_x + dm.G_x[j] / (k * dm.omega) * c_x, v_y + dm.G_y[j] / (k * dm.omega) * c_y
    return v_x, v_y


@compiled
def swung(dm, phase, t):
    """Return v_x, x, v_y, y, the velocity and the place that the acceleration along the axes X, Y adds.

    It acts for a time t [s] from a phase of the plate on.
    """
    v_x, x, v_y, y = dm.fall_x * t, 0.5 * dm.fall_x * t * t, dm.fall_y * t, 0.5 * dm.fall_y * t * t
    for j in range(dm.n_along):
        k = j + 1.0
        v_x, x = swing(v_x, x, dm.G_x[j], k * dm.omega, k * phase + dm.lag_x[j], t)
        v_y, y = swing(v_y, y, dm.G_y[j], k * dm.omega, k * phase + dm.lag_y[j], t)
    return v_x, x, v_y, y


@compiled
def swing(v, x, G, omega, angle, t):
    """Return a velocity and a place after the acceleration G sin(angle + omega t) has acted for a time t."""
    y = omega * t
    sy, cy = sincos(y)
    s, c = sincos(angle)
    s, c = G / omega * s, G / omega * c
    k = one_minus_cos(sy, cy)
    return v + s * sy + c * k, x + (s * k + c * x_minus_sin(y, sy)) / omega


# --- the plate under a flight -----------------------------------------------------------------------------------------


class Sway(NamedTuple):
    """Plate from a moment on, from which times count."""

    omega: float
    s: float  # A_z sin, A_z cos of the phase of the plate at that moment [m]
    c: float


@compiled(inline=True)
def sway_from(dm, phase):
    """Return the sway of the plate from a phase on; its higher harmonics are written into `dm` until the next call."""
    s, c = sincos(phase)
    if dm.n_z > 1:
        sway_higher(dm, s, c)
    return Sway(dm.omega, dm.A[0] * s, dm.A[0] * c)


@compiled
def sway_higher(dm, s1, c1):
    """Write the heights of the higher harmonics at a phase of the plate into `dm`, with sine s1 and cosine c1 of it.

    They are written as A_k sin (`sway_s`) and A_k cos (`sway_c`) of the angle k phase + phi_k of harmonic k [m].
    """
    s, c = s1, c1
    for j in range(1, dm.n_z):
        s, c = next_multiple(s, c, s1, c1)
        dm.sway_s[j], dm.sway_c[j] = dm.A_sin[j] * s + dm.A_cos[j] * c, dm.A_sin[j] * c - dm.A_cos[j] * s


@compiled(inline=True)
def less_harmonic(omega, s, c, angle, over):
    """Return a height and its first three time derivatives less those of one harmonic.

    The time is an `angle` omega t after the start. Only the part of the harmonic counts that its height and its rate at
    the start do not foretell.

    Parameters
    ----------
    angle : (float, float, float)
        With its sine and its cosine.
    over : tuple of 4 float
    """
    y, sy, cy = angle
    height, rate, second, third = over
    k = one_minus_cos(sy, cy)
    w2 = omega * omega
    return (
        height + s * k + c * x_minus_sin(y, sy),
        rate + omega * (s * sy + c * k),
        second + w2 * (s * cy + c * sy),
        third + w2 * omega * (c * cy - s * sy),
    )


@compiled
def less_higher_harmonics(dm, angle, over):
    """Return a height and its derivatives less those of the higher harmonics of the plate.

    `angle` is that of the first harmonic since the start.
    """
    y, sy, cy = angle
    s, c = sy, cy
    for j in range(1, dm.n_z):
        s, c = next_multiple(s, c, sy, cy)
        k = j + 1.0
        over = less_harmonic(k * dm.omega, dm.sway_s[j], dm.sway_c[j], (k * y, s, c), over)
    return over


@compiled(inline=True)
def over_plate(dm, sway, t, over):
    """Return a height over the plate and its first three time derivatives.

    `over` are those over a plate that goes on at its rate of the start.
    """
    y = sway.omega * t
    sy, cy = sincos(y)
    over = less_harmonic(sway.omega, sway.s, sway.c, (y, sy, cy), over)
    return over if dm.n_z == 1 else less_higher_harmonics(dm, (y, sy, cy), over)


@compiled
def start_later(row, by):
    """Add the angle `by` [rad] to the phase of the plate at the start, in a parameter row, in place.

    Harmonic k of the plate's height moves on by k times the angle. The phases of the motion along the plate stay: they
    count from the phase of the plate.
    """
    for j in range(HARMONICS):
        row[ROW_PHI0 + 2 * j] += (j + 1.0) * by


# --- for Python -------------------------------------------------------------------------------------------------------


def started_at(row, phase):
    """Return a copy of a parameter row with the plate at `phase` [rad] at the start, reduced to [0, 2 pi)."""
    later = row.copy()
    plain(start_later)(later, phase - row[ROW_PHI0])
    later[ROW_PHI0] = phase % TWO_PI
    return later


def motion_along(dm, phase):
    """Return x, y, x', y', place and velocity of the plate along its axes, at phases of any shape [m, m s-1]."""
    squares = (dm.omega * np.arange(1, dm.n_along + 1)) ** 2
    (x, v_x, _), (y, v_y, _) = (
        _motion(dm.omega, G[: dm.n_along] / squares * (np.cos(lag) + 1j * np.sin(lag))[: dm.n_along], phase)
        for G, lag in ((dm.G_x, dm.lag_x), (dm.G_y, dm.lag_y))
    )
    return x, y, v_x, v_y


def motion(dm, phase):
    """Return z_p, z_p' and z_p'' at phases of any shape [m, m s-1, m s-2]."""
    return _motion(dm.omega, dm.A_sin[: dm.n_z] + 1j * dm.A_cos[: dm.n_z], phase)


def _motion(omega, A, phase):
    """Return the imaginary part of the sum over k of A_k exp(i k phase), and its first two time derivatives."""
    k = np.arange(1, A.size + 1)
    angles = np.multiply.outer(phase, k)
    s, c = np.sin(angles), np.cos(angles)
    A_1, A_2 = k * omega * A, k * omega * (k * omega) * A
    waves = (A.real * s + A.imag * c, A_1.real * c - A_1.imag * s, -A_2.real * s - A_2.imag * c)
    return tuple(each.sum(axis=-1) for each in waves)
