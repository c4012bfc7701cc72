"""The drift of the centre of a circular orbit on a plate with a small tilt or a small sideways motion.

The effect of such a plate on one period turns with the heading. So, to first order, the motion swings about the motion
on the level plate, once in each round. The displacement in a period turns with the heading, too. Its product with the
swing has a mean: the velocity of the centre.
"""

from dataclasses import replace
from math import atan2, pi, remainder, sqrt
from typing import NamedTuple

import numpy as np

from dimersweep.analysis.orbits.map.finding import RTOL, checked, checked_spin, orbit_at
from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, require, singular_lost
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import NEWTON_STEPS
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import check_rtol
from dimersweep.kernel.model.layout import THETA, X1, Y1
from dimersweep.parameters import NOT_LEVEL, Parameters, spelt_out, updated
from dimersweep.runs.run import Run

# number of headings at which the swing is solved for; odd, so that the highest harmonic has a phase
HEADINGS = 17
# tilt [rad] or intensity [1], and size of the swing, from which the first order is taken: the smaller of both plates
SMALL_PLATE, LITTLE = 1e-4, 0.01
SWING_KNOWN = 1e-5  # last step of Newton's method to a swing, relative to the swing
# relative error of the first order up to which it holds; ratio to which the limit, a tilt or an intensity, is known
FIRST_ORDER, HELD = 0.05, 1.02


class Swings:
    """The motions near an orbit, at its mean spin, on a share of a plate's tilt and sideways intensity.

    A phase goes on by the mean turn of the heading in each period. The point of the section, and the heading less the
    phase, are those of the orbit plus a swing, a function of the phase. The harmonics of the swing are solved for with
    the derivatives of the level plate.
    """

    def __init__(self, orbit: PeriodicOrbit, plate: dict[str, float]) -> None:
        self.plate, self.map, self.z = plate, orbit.fixed.map, orbit.slow_motion.z
        m, n = self.map, self.z.size
        self.level = _passed(m, self.z, 0.0)
        self.matrix = np.eye(n + 1)
        for k, d in enumerate(m.step * np.eye(n)):
            self.matrix[:, k] = (_passed(m, self.z + d, 0.0) - _passed(m, self.z - d, 0.0))[: n + 1] / (2 * m.step)

    @singular_lost()
    def on(self, share: float, most: int = NEWTON_STEPS) -> tuple[float, complex, float]:
        """Solve for the swing on a share of the plate, in at most `most` steps of Newton's method.

        Return the greatest swing, the displacement of the centre in a period of the orbit (X + i Y) [m], and the change
        of the mean spin in it [rad/s]. The last two are those before the last step. With `most` = 1 one step is taken,
        converged or not.
        """
        given = {name: share * value if name in NOT_LEVEL else value for name, value in self.plate.items()}
        m, n = replace(self.map, parameters=given), self.z.size
        phases, orders = TURN * np.arange(HEADINGS) / HEADINGS, np.fft.fftfreq(HEADINGS, 1 / HEADINGS)
        swing, turn, size, still = np.zeros((HEADINGS, n + 1)), self.level[n], np.inf, [m.slow, n]
        for _ in range(most):
            seen = np.array([_passed(m, self.z + s[:n], psi + s[n]) for s, psi in zip(swing, phases, strict=True)])
            ahead = seen[:, : n + 1] - np.append(self.level[:n], turn)
            ahead[:, n] += swing[:, n]
            shift = np.exp(1j * orders * turn)[:, None]
            left = (np.fft.fft(ahead, axis=0) - shift * np.fft.fft(swing, axis=0)) / HEADINGS
            way, drift = complex(*seen[:, n + 1 :].mean(axis=0)), float(left[0, m.slow].real) * m.unit
            turn += left[0, n].real
            A = shift[:, :, None] * np.eye(n + 1) - self.matrix
            A[0, still], left[0, still] = np.eye(n + 1)[still], 0.0  # the means of spin and phase are given: they stay
            step = HEADINGS * np.fft.ifft(np.linalg.solve(A, left[:, :, None])[:, :, 0], axis=0).real
            swing, last, size = swing + step, size, np.abs(step).max()
            if size <= SWING_KNOWN * np.abs(swing).max() or most == 1:
                return float(np.abs(swing).max()), way, drift
            if size > max(last, LITTLE):
                break
        raise OrbitLost(f"no motion on a share of {share:.1e} of this plate stays near the orbit")


def _passed(m: ReturnMap, z: np.ndarray, heading: float) -> np.ndarray:
    """Return the image of a point with a heading, its turn [rad] and displacement along X, Y [m], shape (n + 3,)."""
    state = m.state(z)
    state[THETA] = heading
    state, modes, _ = m.recorder.run(m.row, state, m.periods, m.rtol, path=True)
    require((modes == m.modes).all(), "the contact at the section changes")
    return np.array([*m.section.point(state)[m.free], state[THETA] - heading, state[X1], state[Y1]])


class CentreDrift(NamedTuple):
    """The drift of the centre of a circular orbit on a plate that is not level.

    Attributes
    ----------
    orbit : PeriodicOrbit
        Orbit on the level plate.
    centre_velocity_x, centre_velocity_y : float
        Velocity of the centre to first order, on the plate that was given [m s-1], as of a run.
    per_unit : float
        Speed of the centre per radian of `tilt` [m s-1 rad-1], or per unit of `Gamma_x` or `Gamma_y` [m s-1].
    direction : float
        Angle of the velocity from the direction of descent (`Gamma_x`: from X, `Gamma_y`: from Y),
        positive from X to Y [rad].
    holds_to : float
        Tilt [rad] or intensity [1] up to which the first order holds. Up to there the relative error of the velocity at
        this mean spin, plus the relative change of the spin in a round, is at most 5 %.
    spin_drift : float
        Change of the spin that the plate adds to the orbit's own, to second order [rad s-1 per forcing period].
    """

    orbit: PeriodicOrbit
    centre_velocity_x: float
    centre_velocity_y: float
    per_unit: float
    direction: float
    holds_to: float
    spin_drift: float


def centre_drift(
    *, spin: float | None = None, guess: Run | PeriodicOrbit | None = None, rtol: float = RTOL, **parameters: float
) -> CentreDrift:
    """Compute the drift of the centre of a circle on a plate with a small tilt or sideways motion, to first order.

    No run is made. To first order, all other means are those on the level plate, and the effects of `tilt`, `Gamma_x`
    and `Gamma_y` add up. If several are given, they grow together. Then `per_unit`, `direction` and `holds_to` refer to
    the first of them, in this order.

    Parameters
    ----------
    spin, guess, rtol
        Spin, guess and accuracy of the orbit on the level plate, as for `find`, with the periods of the guess. A guess
        may be a run on the plate that is given.
    **parameters : float
        Parameters of the model, with `tilt`, `Gamma_x` or `Gamma_y`.

    Returns
    -------
    CentreDrift

    Raises
    ------
    ParameterError
        For an unknown parameter, a value that is not allowed, or a level plate.
    OrbitError
        If there is no orbit, or if it is no circle.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> drift = orbits.centre_drift(tilt=1e-3, spin=144.0)
    >>> round(drift.per_unit, 2), round(drift.direction, 3)
    (11.59, 3.11)
    """
    parameters = spelt_out(parameters, getattr(guess, "parameters", None))
    level = checked(parameters | dict.fromkeys(NOT_LEVEL, 0.0), guess)
    given = Parameters(**updated({} if guess is None else guess.parameters, parameters)).given()
    name = next((name for name in NOT_LEVEL if given.get(name)), None)
    if name is None:
        raise ParameterError("tilt = Gamma_x = Gamma_y = 0: on a level plate the centre of a circle stays")
    periods = guess.periods if isinstance(guess, PeriodicOrbit) else 1
    orbit = orbit_at(level, spin if spin is None else checked_spin(spin, level), periods, guess, check_rtol(rtol))
    if not orbit.precession_rate:
        raise OrbitError(f"spin = {orbit.spin:g}: the dimer walks straight on, and on no circle")
    swings, begin = Swings(orbit, given), SMALL_PLATE / given[name]
    begin *= min(1.0, LITTLE / swings.on(begin, most=1)[0])
    _, way, drift = swings.on(begin)
    low, high, rounds = begin, 1 / given[name], orbit.period * given["f"] / orbit.periods
    while high > HELD * low:
        share, holds = min(4 * low, sqrt(low * high)), False
        if swung := attempt(swings.on, share):
            _, there, lost = swung
            holds = abs(there * begin / share / way - 1) + abs(lost / orbit.spin) * rounds <= FIRST_ORDER
        low, high = (share, high) if holds else (low, share)
    v = way / begin * given["f"] / orbit.periods
    falls = {"tilt": given.get("azimuth", 0.0), "Gamma_x": 0.0, "Gamma_y": pi / 2}[name]
    direction, drift = remainder(atan2(v.imag, v.real) - falls, TURN), drift / begin**2 / orbit.periods
    return CentreDrift(orbit, v.real, v.imag, abs(v) / given[name], direction, low * given[name], drift)
