"""Motions of the dimer that are known in closed form or by a quadrature, with mpmath's digits.

Dropped flat, it is a ball that bounces. Without friction or without slip it falls as a rod about one end; with e = 0 it
then rocks from end to end.
"""

from collections.abc import Callable, Iterator

from mpmath import asin, findroot, mp, mpf, quad, sin, sqrt
from mpmath import cos as cosine

from tests.oracle.body import Dimer

DIGITS = 50
STILL = 1e-24  # s; a hop shorter than this ends the chatter


class Ball:
    """A ball on a plate that moves as A_z sin(omega t + phi0); heights and velocities are the plate's relative ones."""

    def __init__(self, d: Dimer) -> None:
        mp.dps = DIGITS
        self.e, self.g = mpf(d.e[0]), mpf(d.g)
        self.A_z, self.omega, self.phi0 = mpf(d.A[0, 2]), mpf(d.omega), mpf(d.phi[0, 2])

    def plate_rate(self, t: mpf) -> mpf:
        """Velocity of the plate."""
        return self.A_z * self.omega * cosine(self.omega * t + self.phi0)

    def hop(self, t: mpf, u: mpf) -> tuple[mpf, mpf]:
        """Duration of the hop that begins at time t with relative velocity u, and the relative velocity at its end."""
        phase, speed = self.omega * t + self.phi0, u + self.plate_rate(t)

        def mean_rate(s: mpf) -> mpf:
            """Gap over elapsed time."""
            half = self.omega * s / 2
            return speed - self.g * s / 2 - self.A_z * self.omega * cosine(phase + half) * sin(half) / half

        pull = self.g - self.A_z * self.omega**2 * sin(phase)
        step = u / pull if u > 0 and pull > 0 else mpf("1e-3") / self.omega
        s = step
        while mean_rate(s) > 0:
            s += step / 2
        s = findroot(mean_rate, (s - step / 2, s), solver="anderson", tol=mpf(10) ** (20 - 2 * DIGITS))
        return s, speed - self.g * s - self.plate_rate(t + s)

    def impacts(self) -> Iterator[tuple[mpf, mpf]]:
        """Time of each impact and the relative velocity before it, from a start at rest in space, on the plate."""
        t, v = mpf(0), -self.plate_rate(mpf(0))
        while True:
            yield t, v
            s, v = self.hop(t, -self.e * v)
            t += s

    def rest_time(self) -> mpf:
        """When the bounces have died out."""
        last = mpf(-1)
        for t, _ in self.impacts():
            if t - last < STILL:
                return t
            last = t
        raise AssertionError

    def lift_off(self, t: mpf) -> mpf:
        """First time after t, resting on the plate, when the plate falls away (Gamma > 1)."""
        phase = asin(self.g / (self.A_z * self.omega**2)) - self.phi0
        period = 2 * mp.pi / self.omega
        time = phase / self.omega
        while time < t:
            time += period
        return time


def fall_time(d: Dimer, rolling: bool, beta_0: mpf, beta_1: mpf) -> mpf:
    """Time to fall about one end from rest at beta_0 to beta_1 <= beta_0 on a plate at rest, by conservation of energy."""
    mp.dps = DIGITS
    m, h, g = mpf(d.m), mpf(d.l) / 2, mpf(d.g)
    inertia = fall_inertia(d, rolling)
    top, bottom = sin(beta_0), sin(beta_1)

    def slowness(x: mpf) -> mpf:
        """-dt/dx along sin(beta) = top - x^2, which takes the root out of the start."""
        sin_b = top - x * x
        return 2 * sqrt(inertia(sin_b) / (2 * m * g * h)) / sqrt(1 - sin_b**2)

    return quad(slowness, [0, sqrt(top - bottom)])


def fall_inertia(d: Dimer, rolling: bool) -> Callable[[mpf], mpf]:
    """Twice the kinetic energy over beta'^2, as a function of sin(beta): the centre keeps above one place, or p1 rolls."""
    m, h, r, J = mpf(d.m), mpf(d.l) / 2, mpf(d.r[0]), mpf(d.J1)
    if rolling:
        return lambda sin_b: J + m * (r * r + 2 * r * h * sin_b + h * h)
    return lambda sin_b: J + m * h * h * (1 - sin_b**2)


def fall_rate(d: Dimer, rolling: bool, beta_0: mpf, beta_1: mpf) -> mpf:
    """beta' at beta_1 after a fall from rest at beta_0."""
    gained = 2 * mpf(d.m) * mpf(d.g) * mpf(d.l) / 2 * (sin(beta_0) - sin(beta_1))
    return -sqrt(gained / fall_inertia(d, rolling)(sin(beta_1)))


def rocking_times(d: Dimer, beta_0: mpf, n: int) -> list[mpf]:
    """Times of the first n impacts of a rod that rocks without friction on a plate at rest, e = 0.

    The end that lands stays down, and the other one leaves with W_12/W_11 of the landing's speed, as in Housner's
    rocking block; so sin(beta) at the top falls by the square of that.
    """
    kept = (mpf(d.J1) - mpf(d.m) * (mpf(d.l) / 2) ** 2) / (mpf(d.J1) + mpf(d.m) * (mpf(d.l) / 2) ** 2)
    times, top = [fall_time(d, False, beta_0, mpf(0))], sin(beta_0)
    for _ in range(n - 1):
        top *= kept**2
        times.append(times[-1] + 2 * fall_time(d, False, asin(top), mpf(0)))
    return times
