"""The vibrating plate: its place, and all that follows from it. Another waveform is written here, and nowhere else.

    z_p = A_z sin(phase) + A_2 sin(2 phase + lag),    phase = omega t + phi0,    lag = phi_2 - 2 phi0

In the frame of the plate gravity is g_e = g + z_p''. A plate without second harmonic (A_2 = 0) takes one sine a value.

A plate that is tilted, or moves along its own axes X and Y too, gives the body the acceleration, relative to the plate,

    A_x = g sin(tilt) cos(azimuth) + Gamma_x g sin(phase + phi_x),    A_y likewise with sin(azimuth), Gamma_y, phi_y,

and g_e has g cos(tilt) in the place of g. Then, and only then, the heading of the dimer counts.
"""

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import ROW_PHI0, ROW_PHI_2
from dimersweep.kernel.numerics.sincos import TWO_PI, one_minus_cos, sincos, x_minus_sin

STEADY = 1e-9  # acceleration across the heading, in g, that counts as none
CREST_EXCESS = 1e-9  # excess of the bound on a crest over its height, over the sum of both harmonics


# --- constants of a plate ---------------------------------------------------------------------------------------------


@compiled
def amplitude(Gamma, g, omega):
    """Amplitude of a harmonic of this intensity and angular frequency [m]."""
    return Gamma * g / omega**2


@compiled
def wave(a, b, lag, phase):
    """a sin(phase) + b sin(2 phase + lag), and its derivative with respect to the phase."""
    s, c = sincos(phase)
    s_2, c_2 = sincos(2.0 * phase + lag)
    return a * s + b * s_2, a * c + 2.0 * b * c_2


@compiled
def crest(a, b, lag):
    """A bound of a sin(phase) + b sin(2 phase + lag) over all phases, above its maximum by `CREST_EXCESS` at most.

    Steps lead round the cycle over which the wave certainly stays below what has been seen of it (its curvature is at most
    a + 4 b), or certainly rises to their ends. A coarse round finds the crest, so that the second one need not climb it.
    """
    bend, top, spare = a + 4.0 * b, -inf, 0.0
    for excess in (1e-3, CREST_EXCESS):
        phase, spare = 0.0, excess * (a + b)
        while phase < TWO_PI:
            value, slope = wave(a, b, lag, phase)
            top = max(top, value)
            phase += max(slope, sqrt(slope * slope + 2.0 * bend * (top - value + spare)) - slope) / bend
    return top + spare


# --- the plate at a phase ---------------------------------------------------------------------------------------------


@compiled
def plate_rate(dm, phase):
    """z_p' [m s-1]."""
    _, c = sincos(phase)
    first = dm.A_z * dm.omega * c
    if dm.A_2 == 0.0:
        return first
    _, c_2 = sincos(2.0 * phase + dm.lag)
    return first + 2.0 * dm.A_2 * dm.omega * c_2


@compiled(inline=True)
def effective_gravity(dm, phase):
    """g_e = g + z_p'' [m s-2]."""
    s, _ = sincos(phase)
    g_e = dm.g - dm.A_z * dm.omega * dm.omega * s
    return g_e if dm.A_2 == 0.0 else g_e - second_acceleration(dm.A_2, dm.lag, dm.omega, phase)


@compiled
def second_acceleration(A_2, lag, omega, phase):
    """The part of the second harmonic in -z_p''. (A call of its own: what calls the others often stays small without it.)"""
    s_2, _ = sincos(2.0 * phase + lag)
    return 4.0 * A_2 * omega * omega * s_2


# --- along the plate --------------------------------------------------------------------------------------------------


@compiled
def acceleration_along(dm, phase, theta):
    """Acceleration of the body relative to the plate, along the heading theta and across it: A_a, A_b [m s-2]."""
    s_x, _ = sincos(phase + dm.lag_x)
    s_y, _ = sincos(phase + dm.lag_y)
    a_x, a_y = dm.fall_x + dm.G_x * s_x, dm.fall_y + dm.G_y * s_y
    sin_t, cos_t = sincos(theta)
    return a_y * cos_t - a_x * sin_t, a_x * cos_t + a_y * sin_t


@compiled
def most_along(dm):
    """Bound of that acceleration, in any direction [m s-2]."""
    return sqrt((abs(dm.fall_x) + abs(dm.G_x)) ** 2 + (abs(dm.fall_y) + abs(dm.G_y)) ** 2)


@compiled
def keeps_speed(dm, theta, w_p):
    """Whether a dimer that rolls on both ends has the same speed after each cycle, w_p being its rate of turning (WP).

    The plate must not fall across the heading. Where the ends are unlike the dimer rolls as a cone does, so that its heading
    must not change, either.
    """
    if dm.sideways == 0.0:
        return True
    sin_t, cos_t = sincos(theta)
    fall = abs(dm.fall_x * cos_t + dm.fall_y * sin_t)
    if dm.p1.r != dm.p2.r:
        fall += abs(dm.G_x * cos_t) + abs(dm.G_y * sin_t) + abs(w_p) * dm.v_scale
    return fall <= STEADY * dm.g


@compiled
def velocity_along(dm, phase):
    """Velocity of the plate along its axes X, Y [m s-1]."""
    _, c_x = sincos(phase + dm.lag_x)
    _, c_y = sincos(phase + dm.lag_y)
    return dm.G_x / dm.omega * c_x, dm.G_y / dm.omega * c_y


@compiled
def swing(fall, G, omega, angle, t):
    """What the acceleration fall + G sin(angle + omega t) adds to a velocity and to a place over a time t."""
    y = omega * t
    sy, cy = sincos(y)
    s, c = sincos(angle)
    s, c = G / omega * s, G / omega * c
    k = one_minus_cos(sy, cy)
    return fall * t + s * sy + c * k, 0.5 * fall * t * t + (s * k + c * x_minus_sin(y, sy)) / omega


# --- bounds over a cycle ----------------------------------------------------------------------------------------------


@compiled
def tempo(dm):
    """Greatest angular frequency in the motion of the plate [rad s-1]."""
    return dm.omega if dm.A_2 == 0.0 else 2.0 * dm.omega


@compiled
def lightest(dm):
    """Least g_e of a cycle [m s-2]."""
    if dm.A_2 == 0.0:
        return dm.g - dm.A_z * dm.omega * dm.omega
    return dm.g - crest(dm.A_z * dm.omega * dm.omega, 4.0 * dm.A_2 * dm.omega * dm.omega, dm.lag)


@compiled
def speed_bound(dm):
    """Bound of z_p' [m s-1]."""
    return (dm.A_z + 2.0 * dm.A_2) * dm.omega


@compiled
def heaviest(dm):
    """Bound of g_e from above [m s-2]."""
    return dm.g + (dm.A_z + 4.0 * dm.A_2) * dm.omega**2


@compiled
def jerk_bound(dm):
    """Bound of the rate of g_e [m s-3]."""
    return (dm.A_z + 8.0 * dm.A_2) * dm.omega**3


@compiled
def snap_bound(dm):
    """Bound of the fourth time derivative of z_p [m s-4]."""
    w2 = dm.omega * dm.omega
    return (dm.A_z + 16.0 * dm.A_2) * w2 * w2


# --- the plate under a flight -----------------------------------------------------------------------------------------


class Sway(NamedTuple):
    """The plate from a moment on, from which times count."""

    omega: float
    s: float  # A_z sin, A_z cos of its phase at that moment
    c: float
    s_2: float  # A_2 sin, A_2 cos of the phase of its second harmonic
    c_2: float


@compiled(inline=True)
def sway_from(dm, phase):
    """The plate from a phase on."""
    s_2, c_2 = (0.0, 0.0) if dm.A_2 == 0.0 else sincos(2.0 * phase + dm.lag)
    s, c = sincos(phase)
    return Sway(dm.omega, dm.A_z * s, dm.A_z * c, dm.A_2 * s_2, dm.A_2 * c_2)


@compiled
def bound_of_acceleration(sway):
    """Bound of z_p'' [m s-2]."""
    bound = sway.omega * sway.omega * sqrt(sway.s * sway.s + sway.c * sway.c)
    return bound + 4.0 * sway.omega * sway.omega * sqrt(sway.s_2 * sway.s_2 + sway.c_2 * sway.c_2)


@compiled(inline=True)
def less_harmonic(omega, s, c, angle, over):
    """A height and its first three time derivatives less those of one harmonic, an `angle` omega t after the start.

    Of the harmonic only counts what its height and its rate at the start do not foretell.

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
def less_second_harmonic(sway, angle, over):
    """A height and its derivatives less those of the plate's second harmonic, an `angle` of the first one after the start."""
    y, sy, cy = angle
    twice = 2.0 * y, 2.0 * sy * cy, 1.0 - 2.0 * sy * sy
    return less_harmonic(2.0 * sway.omega, sway.s_2, sway.c_2, twice, over)


@compiled(inline=True)
def over_plate(sway, t, over):
    """Height over the plate and its first three time derivatives, from those over one that goes on at its first rate."""
    y = sway.omega * t
    sy, cy = sincos(y)
    over = less_harmonic(sway.omega, sway.s, sway.c, (y, sy, cy), over)
    return over if sway.s_2 == 0.0 and sway.c_2 == 0.0 else less_second_harmonic(sway, (y, sy, cy), over)


def phases_later(phi0, phi_2, by):
    """phi0 and phi_2 of a plate that starts later, by an angle of its phase: numbers, or arrays of one shape [rad]."""
    return phi0 + by, phi_2 + 2.0 * by


_phases_later = compiled(phases_later)


@compiled
def start_later(row, by):
    """Move the phase of the plate at the start on by an angle [rad], in a parameter row in place."""
    row[ROW_PHI0], row[ROW_PHI_2] = _phases_later(row[ROW_PHI0], row[ROW_PHI_2], by)


# --- for Python -------------------------------------------------------------------------------------------------------


def motion_along(dm, phase):
    """Place and velocity of the plate along its axes, x, y, x', y', at phases of any shape [m, m s-1]."""
    angles = phase + dm.lag_x, phase + dm.lag_y
    places = (G / dm.omega**2 * np.sin(angle) for G, angle in zip((dm.G_x, dm.G_y), angles, strict=True))
    rates = (G / dm.omega * np.cos(angle) for G, angle in zip((dm.G_x, dm.G_y), angles, strict=True))
    return *places, *rates


def motion(dm, phase):
    """z_p, z_p' and z_p'' at phases of any shape [m, m s-1, m s-2]."""
    omega = dm.omega
    height, rate = dm.A_z * np.sin(phase), dm.A_z * omega * np.cos(phase)
    acceleration = -dm.A_z * omega**2 * np.sin(phase)
    if dm.A_2 == 0.0:
        return height, rate, acceleration
    twice = 2.0 * phase + dm.lag
    height, rate = height + dm.A_2 * np.sin(twice), rate + 2.0 * dm.A_2 * omega * np.cos(twice)
    return height, rate, acceleration - 4.0 * dm.A_2 * omega**2 * np.sin(twice)
