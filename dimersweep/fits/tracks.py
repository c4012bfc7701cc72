"""A track of the centre of mass: the circle or the cycloid that fits it, with the covariance of what it gives.

No dimer goes round a circle quite evenly. It swings about the mean path within each forcing period, which counts where the
times are those of few phases of the plate; and its velocity drifts, which counts where a track is long and, where it turns
against the heading, always. What a track shows of both follows from the orbit: `Track.of`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import fft, fftfreq
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.special import exprel

from dimersweep.errors import ParameterError
from dimersweep.fits.measured import Measured
from dimersweep.inputs import as_number, as_numbers, check_labels
from dimersweep.orbits.orbit import PeriodicOrbit
from dimersweep.orbits.passage import TURN

LEAST_TURN = 0.05  # turns in a track that are tried at least
TURN_PARTS = 4  # rates that are tried in each further turn
TRIED = 12  # of them that are tried exactly
LEAST_OWN = 1e-3  # share of a circle that is none of what stands still, below which it is not told apart
SLOW_POINTS = 20  # points of a track, with which two further coefficients cost little
SPIRAL_STEPS = 64  # of a turn, by which the path of an orbit is summed
CYCLOID = ("path_radius", "period", "x", "y", "v_x", "v_y")  # numbers of one; those of a circle are the first four


@dataclass(frozen=True, eq=False)
class Track:
    """The circle, or the cycloid, that fits a track best.

    Attributes
    ----------
    values : dict
        `path_radius` [m] and `period` [s] of the turn, the centre `x`, `y` [m] in the middle of the track's times, and its
        velocity `v_x`, `v_y` [m s-1] if it moves.
    covariance : ndarray, shape (n, n)
        Of these, in their order.
    sense : int
        1 if it turns counterclockwise, else -1.
    sigma : float
        Standard deviation of the error of each coordinate [m]: the given one, or what the residuals say, less what is left of
        them because rate and radius drift slowly.
    times : ndarray, shape (n,)
        [s]
    moving : bool
        Whether the centre may move, as that of a cycloid.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import fits
    >>> t, rng = np.linspace(0, 20, 200), np.random.default_rng(1)
    >>> x, y = 4 * np.cos(0.2 * t), 4 * np.sin(0.2 * t)
    >>> track = fits.circle(t, x + rng.normal(0, 0.01, 200), y + rng.normal(0, 0.01, 200))
    >>> round(track.values["path_radius"], 2), track.sense, round(track.sigma, 3)
    (4.0, 1, 0.01)
    """

    values: dict[str, float]
    covariance: np.ndarray
    sense: int
    sigma: float
    times: np.ndarray
    moving: bool

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def measured(self) -> Measured:
        """Radius and period with their covariance, for `fit`."""
        return Measured(CYCLOID[:2], np.array(list(self.values.values())[:2]), self.covariance[:2, :2], self)

    def of(self, orbit: PeriodicOrbit) -> np.ndarray:
        """The `path_radius` and the `period` that a track of an orbit at these times gives, shape (2,).

        Times count from the moment at which the plate has the phase `phi0` of the orbit's parameters. The spin is that of the
        orbit in the middle of them, where it drifts evenly from impact to impact. Before and after it the heading's rate and
        the velocity seen from there change by what the orbit says, ever less or more by the slow multiplier; the velocity is
        summed.
        """
        f, rate, path = orbit.parameters["f"], abs(orbit.precession_rate), orbit.path
        phases = TURN * f * self.times + orbit.parameters["phi0"]
        swing = np.interp(phases, path.phases, path.swing, period=TURN)
        quickens = orbit.precession_rate_drift * f / orbit.precession_rate
        fades = (orbit.slow_multiplier - 1) * f / orbit.periods
        span = float(np.ptp(self.times))
        t = self.times - _middle(self.times)
        t += 0.5 * orbit.periods / f  # the rate is the mean of the period up to the impact that the spin is told after
        at = np.linspace(t.min(), t.max(), int(SPIRAL_STEPS * rate * span / TURN) + SPIRAL_STEPS)
        pace = at * exprel(fades * at)
        turned = CubicSpline(at, rate * (1 + quickens * pace)).antiderivative()
        way = CubicSpline(at, (1 + path.bend * pace) * np.exp(1j * turned(at))).antiderivative()
        place = path.radius * (1j * rate * way(t) + swing * np.exp(1j * turned(t)))
        found, coefficients = _refined(t / span, place, rate * span, self.moving)
        return np.array([abs(coefficients[-1]), TURN * span / abs(found)])

    def __repr__(self) -> str:
        errors = self.errors
        words = ", ".join(f"{name} {value:.6g} ± {errors[name]:.2g}" for name, value in self.values.items())
        return f"<Track: {words}, error of a coordinate {self.sigma:.2g} m>"


def circle(t: Any, x: Any, y: Any, sigma: float | None = None) -> Track:
    """The circle that a track of the centre of mass goes round evenly.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times [s] since the plate had the phase `phi0`, in any order; more than two to a turn.
    x, y : array_like, shape (n,)
        Places of the centre of mass [m].
    sigma : float, optional
        Standard deviation of the error of each coordinate [m]; by default as the residuals say.

    Returns
    -------
    Track

    Raises
    ------
    ParameterError
        If these are no tracks of one length, or too short ones, or the track does not turn by enough.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import fits
    >>> t = np.linspace(0, 10, 30)
    >>> fits.circle(t, np.cos(t) + 3, np.sin(t), sigma=0.01).measured
    <Measured: path_radius 1 ± 0.00186 m, period 6.28319 ± 0.00393 s>
    """
    return _track(t, x, y, sigma, moving=False)


def cycloid(t: Any, x: Any, y: Any, sigma: float | None = None) -> Track:
    """The cycloid that fits a track: even motion on a circle whose centre moves evenly, as on a plate not quite level.

    Parameters
    ----------
    t, x, y : array_like, shape (n,)
        As for `circle`.
    sigma : float, optional

    Returns
    -------
    Track

    Raises
    ------
    ParameterError
        As for `circle`.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import fits
    >>> t = np.linspace(0, 20, 60)
    >>> track = fits.cycloid(t, np.cos(t) + 0.1 * t, np.sin(t), sigma=0.01)
    >>> round(track.values["path_radius"], 6), round(track.values["v_x"], 6)
    (1.0, 0.1)
    """
    return _track(t, x, y, sigma, moving=True)


def _track(t: Any, x: Any, y: Any, sigma: float | None, moving: bool) -> Track:
    times, place, sigma = _checked(t, x, y, sigma, moving)
    span = float(np.ptp(times))
    s = (times - _middle(times)) / span  # in [-1/2, 1/2]
    rate, coefficients = _refined(s, place, _best_rate(s, place, moving), moving)
    A = _basis(s, rate, moving)
    residual = A @ coefficients - place
    J = _slopes(A, s, coefficients)
    if sigma is None:
        sigma = _scatter(residual, J, s, A[:, -1] * coefficients[-1])
    around, units = coefficients[-1], np.array([1.0, span])[: coefficients.size - 1]
    radius, period = float(abs(around)), TURN * span / abs(rate)
    values = [radius, period, *(coefficients[:-1] / units).view(float).tolist()]
    G = np.zeros((len(values), J.shape[1]))  # derivatives of these
    G[0, -2:], G[1, 0] = (around.real / radius, around.imag / radius), -period / rate
    G[2:, 1:-2] = np.diag(np.repeat(1 / units, 2))
    back = sigma * G @ np.linalg.pinv(J)
    covariance = back @ back.T
    if not np.sqrt(covariance[0, 0]) < radius:
        raise ParameterError(
            f"track: turns by too little to tell its radius, {radius:.3g} ± {covariance[0, 0] ** 0.5:.2g} m"
        )
    return Track(
        values=dict(zip(CYCLOID, values, strict=False)),
        covariance=covariance,
        sense=int(np.sign(rate)),
        sigma=sigma,
        times=times,
        moving=moving,
    )


def _checked(t: Any, x: Any, y: Any, sigma: float | None, moving: bool) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Times and places x + iy of a track, and the error of a coordinate where it is given."""
    given = (("t", t, "s"), ("x", x, "m"), ("y", y, "m"))
    times, *places = (as_numbers(name, values, units) for name, values, units in given)
    check_labels({"t": t, "x": x, "y": y})
    for name, values in zip("xy", places, strict=True):
        if values.size != times.size:
            raise ParameterError(f"{name}: has {values.size} values; must have {times.size}, as t has")
    least = 5 if moving else 4
    if np.unique(times).size < least:
        raise ParameterError(f"t: has {np.unique(times).size} different times; must have at least {least}")
    if max(np.ptp(values) for values in places) == 0:
        raise ParameterError(f"x, y: all {times.size} points are at one place; a track has to move")
    sigma = None if sigma is None else as_number("sigma", sigma, "m")
    if sigma is not None and sigma <= 0:
        raise ParameterError(f"sigma = {sigma:g}: must be > 0")
    return times, places[0] + 1j * places[1], sigma


def _slopes(A: np.ndarray, s: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Derivatives of x and y of a track by the rate, and by the real and the imaginary part of each coefficient."""
    parts = (factor * column for column in A.T for factor in (1, 1j))
    columns = np.column_stack([1j * s * A[:, -1] * coefficients[-1], *parts])
    return np.vstack([columns.real, columns.imag])


def _scatter(residual: np.ndarray, J: np.ndarray, s: np.ndarray, around: np.ndarray) -> float:
    """Standard deviation of a coordinate by the residuals, less what a rate and a radius explain that change.

    Of many points that is a change to second order, of few an even one.
    """
    orders = np.column_stack([1j * s**2, s, 1j * s**3, s**2])[:, : 4 if s.size >= SLOW_POINTS else 2]
    slow = orders * around[:, None]
    slopes = np.column_stack([J, np.vstack([slow.real, slow.imag])])
    left = np.concatenate([residual.real, residual.imag])
    left = left - slopes @ np.linalg.lstsq(slopes, left, rcond=None)[0]
    return float(np.linalg.norm(left) / np.sqrt(slopes.shape[0] - slopes.shape[1]))


def _middle(times: np.ndarray) -> float:
    return float(0.5 * (times.min() + times.max()))


def _basis(s: np.ndarray, rate: float, moving: bool) -> np.ndarray:
    """What places x + iy are sums of: a centre, its velocity, even motion on a circle; one a column."""
    still = [np.ones(s.size), s] if moving else [np.ones(s.size)]
    return np.column_stack([*still, np.exp(1j * rate * s)])


def _best_rate(s: np.ndarray, place: np.ndarray, moving: bool) -> float:
    """The rate of turning, in radians in the whole track, at which circle and track are nearest, roughly.

    The valley of the misfit is a turn wide to either side. Rates below a turn are tried one by one, the others, up to one of
    half as many turns as there are times, by Fourier transforms; of these the best ones once more.
    """
    slow = TURN * np.geomspace(LEAST_TURN, 1, 16)
    rates = np.concatenate([slow, -slow, _fast_rates(s, place, moving)])
    misses = [_solved(_basis(s, rate, moving), place)[1] for rate in rates]
    return float(rates[int(np.argmin(misses))])


def _fast_rates(s: np.ndarray, place: np.ndarray, moving: bool) -> np.ndarray:
    """The rates of whole turns and their parts at which a circle takes most of the squares of a track off, by its spectra.

    Times are put into bins. With the sums of e = exp(i rate s), of s e and of the conjugate of e times the place, which their
    transforms are, what a circle takes off beside a centre, or a centre that moves, is a quotient at each rate.
    """
    most = max(1, s.size // 2)
    bins, length = 4 * most, 4 * most * TURN_PARTS
    which = np.minimum((bins * (s + 0.5)).astype(int), bins - 1)
    still = np.linalg.qr(_basis(s, 0.0, moving)[:, : 2 if moving else 1].real)[0]
    left = place - still @ (still.T @ place)

    def spectrum(values: np.ndarray) -> np.ndarray:
        """Sums of values times exp(-i rate s), but for a phase, at rates of a turn over TURN_PARTS and its multiples."""
        parts = [np.bincount(which, part, bins) for part in (values.real, values.imag)]
        return fft(parts[0] + 1j * parts[1], length)

    # a circle less its share in what stands still has so many squares left
    own = s.size - sum(np.abs(spectrum(column)) ** 2 for column in still.T)
    taken = np.abs(spectrum(left)) ** 2 / np.maximum(own, LEAST_OWN * s.size)
    turns = fftfreq(length, 1 / length) / TURN_PARTS
    taken[(np.abs(turns) < 1) | (np.abs(turns) > most)] = 0.0
    best = np.argpartition(taken, -TRIED)[-TRIED:]
    return TURN * turns[best]


def _solved(A: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, float]:
    coefficients = np.linalg.lstsq(A, place, rcond=None)[0]
    return coefficients, float(np.linalg.norm(A @ coefficients - place))


def _refined(s: np.ndarray, place: np.ndarray, rate: float, moving: bool) -> tuple[float, np.ndarray]:
    """The rate and the coefficients of least squares, from a rate nearby."""

    def residual(p: np.ndarray) -> np.ndarray:
        miss = _basis(s, p[0], moving) @ p[1:].view(complex) - place
        return np.concatenate([miss.real, miss.imag])

    def slopes(p: np.ndarray) -> np.ndarray:
        return _slopes(_basis(s, p[0], moving), s, p[1:].view(complex))

    start = np.concatenate([[rate], _solved(_basis(s, rate, moving), place)[0].view(float)])
    p = least_squares(residual, start, slopes, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return float(p[0]), p[1:].copy().view(complex)
