"""Fit a circle or a cycloid to a track of the centre of mass, with the covariance of its numbers.

No dimer goes round a circle quite evenly. It swings about the mean path within each forcing period, which counts where
the times are those of few phases of the plate. Its velocity also drifts. This counts where a track is long and, where
the velocity turns against the heading, always. `Track.of` computes from the orbit what a track shows of both.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.fft import fft, fftfreq, next_fast_len
from scipy.interpolate import CubicSpline
from scipy.optimize import leastsq
from scipy.special import exprel
from scipy.stats import f as variance_ratio

from dimersweep.analysis.fits.measured import Measured
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, as_numbers, check_labels

LEAST_TURN = 0.05  # least turn over a whole track that is tried [turns]
TURN_PARTS = 4  # rates that are tried in each further turn: a minimum is about a turn wide
MOST_TURNS_TRIED = 2**20  # most turns over a whole track that are tried: the transforms have 8 million bins then
# most turns in the usual step of the times that are tried: half a turn, and its alias a whole turn further
PER_STEP = 1.5
# share of the best gain from which a rate is tried exactly, the gain being the squares that a rate explains by the
# spectra: times are put into bins, so at the end of the spectrum only sinc(1/2)^2 = 0.4 of it is seen
WORTH = 0.35
# rates that are tried exactly (this number of the best and of the slowest ones), with this number of points
TRIED, TRIED_POINTS = 64, 2000
RATE_VALLEY = 1.0  # least distance of two minima, in radians over the whole track: nearer ones are the same
SAME_TIME = 1e-9  # step of the times that counts as rounding, over the span of the track
FEW_POINTS = 0.25  # quantile of the numbers of rows with one time that counts as the usual number
CHANCE_OF_ALIAS = 0.0027  # probability of a misfit above the best one by chance, from which a minimum is about as good
TIME_ROUNDING = 1e-9  # least error of a coordinate, in radii: that of numbers without errors
# speed of a fast dimer [m s-1]; factor over it, or over the speed of the slowest circle, above which no dimer moves
FAST_TURN, FASTER = 1.0, 10.0
APART_IN_TIME = 3.0  # distance of places of one time, in errors, above which a note reports it
# share of a circle that no centre and no velocity of it explains, below which the circle is not told apart from them
LEAST_OWN = 1e-3
SLOW_POINTS = 20  # different times from which on two further coefficients for a slow drift cost little
SPIRAL_STEPS = 64  # steps in a turn with which the path of an orbit is summed
CYCLOID = ("path_radius", "period", "x", "y", "v_x", "v_y")  # numbers of a cycloid; a circle has the first four
Minimum = tuple[float, np.ndarray]  # a minimum of the misfit: rate [rad per track], coefficients of `_basis`


@dataclass(frozen=True, eq=False)
class Track:
    """The circle, or the cycloid, that fits a track best.

    Attributes
    ----------
    values : dict
        `path_radius` [m] and `period` [s] of the turn. `x` and `y` [m] of the centre in the middle of the times. `v_x`
        and `v_y` [m s-1] of the centre, if it moves.
    covariance : ndarray, shape (n, n)
        Covariance of these values, in their order.
    sense : int
        1 if the track turns counterclockwise, else -1.
    sigma : float
        Standard deviation of the error of each coordinate [m]: as the user gives it, or from the residuals, without the
        part of them that a slow drift of rate and radius explains.
    times : ndarray, shape (n,)
        Times that are used [s]: in order, without copies of a row and without the ends of rounded times.
    moving : bool
        True if the centre may move, as for a cycloid.
    others : tuple of Track
        Faster turns that fit about as well, since the times are too few; turns too fast for a dimer are left out.
    notes : tuple of str
        Sentences for the user: that there are others, that no dimer is so fast, that places of one time differ.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import fits
    >>> t, rng = np.linspace(0, 20, 200), np.random.default_rng(1)
    >>> x, y = 4 * np.cos(0.2 * t), 4 * np.sin(0.2 * t)
    >>> track = fits.circle(t, x + rng.normal(0, 0.01, 200), y + rng.normal(0, 0.01, 200))
    >>> round(track.values["path_radius"], 2), track.sense, round(track.sigma, 3)
    (4.0, 1, 0.01)
    >>> t = np.arange(0, 600, 30)  # a turn in 36 s, seen every 30 s
    >>> track = fits.circle(t, 4 * np.cos(t / 36 * 2 * np.pi), 4 * np.sin(t / 36 * 2 * np.pi))
    >>> [(round(one.values["period"]), one.sense) for one in (track, *track.others)]
    [(180, -1), (36, 1), (26, -1)]
    """

    values: dict[str, float]
    covariance: np.ndarray
    sense: int
    sigma: float
    times: np.ndarray
    moving: bool
    others: tuple["Track", ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of the values."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def measured(self) -> Measured:
        """Radius and period with their covariance, for `fit`."""
        return Measured(CYCLOID[:2], np.array(list(self.values.values())[:2]), self.covariance[:2, :2], self)

    def of(self, orbit: PeriodicOrbit) -> np.ndarray:
        """Return `path_radius` [m] and `period` [s] that a track of `orbit` with these times would have, shape (2,).

        Times count from the moment at which the plate has the phase `phi0` of the parameters of the orbit. The orbit
        has its spin in the middle of the times. Before and after it the rate of the heading, and the velocity seen from
        the heading, drift evenly from impact to impact, ever less or more by the slow multiplier. The velocity is
        summed to a path, which is fitted.
        """
        f, rate, path = orbit.parameters["f"], abs(orbit.precession_rate), orbit.path
        phases = TURN * f * self.times + orbit.parameters["phi0"]
        swing = np.interp(phases, path.phases, path.swing, period=TURN)
        quickens = orbit.precession_rate_drift * f / orbit.precession_rate
        fades = (orbit.slow_multiplier - 1) * f / orbit.periods
        span = float(np.ptp(self.times))
        t = span * _scaled(self.times)
        # the spin is that after an impact, but the rate is the mean over the period before it: half a period earlier
        t += 0.5 * orbit.periods / f
        at = np.linspace(t.min(), t.max(), int(SPIRAL_STEPS * rate * span / TURN) + SPIRAL_STEPS)
        pace = at * exprel(fades * at)
        turned = CubicSpline(at, rate * (1 + quickens * pace)).antiderivative()
        displacement = CubicSpline(at, (1 + path.bend * pace) * np.exp(1j * turned(at))).antiderivative()
        place = path.radius * (1j * rate * displacement(t) + swing * np.exp(1j * turned(t)))
        found, coefficients = _refined(t / span, place, rate * span, self.moving)
        return np.array([abs(coefficients[-1]), TURN * span / abs(found)])

    def __repr__(self) -> str:
        errors = self.errors
        words = ", ".join(f"{name} {value:.6g} ± {errors[name]:.2g}" for name, value in self.values.items())
        return f"<Track: {'; '.join([f'{words}, error of a coordinate {self.sigma:.2g} m', *self.notes])}>"


def circle(t: Any, x: Any, y: Any, sigma: float | str | None = None) -> Track:
    """Fit even motion on a circle to a track of the centre of mass.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times [s] since the plate had the phase `phi0`, in any order; more than two to a turn. Rates are tried up to one
        and a half turns in the median step of the times. Among those that fit about as well as the best, the slowest
        one counts, and a note lists the others. Points of one time count with their mean, and copies of a row once.
    x, y : array_like, shape (n,)
        Places of the centre of mass [m].
    sigma : float, optional
        Standard deviation of the error of each coordinate [m]; by default from the residuals.

    Returns
    -------
    Track

    Raises
    ------
    ParameterError
        If the columns differ in length, are too short, or the track turns too little to have a radius.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import fits
    >>> t = np.linspace(0, 10, 30)
    >>> fits.circle(t, np.cos(t) + 3, np.sin(t), sigma=0.01).measured
    <Measured: path_radius 1 ± 0.00186 m, period 6.28319 ± 0.00393 s>
    """
    return _track(t, x, y, sigma, moving=False)


def cycloid(t: Any, x: Any, y: Any, sigma: float | str | None = None) -> Track:
    """Fit a cycloid to a track of the centre of mass: even motion on a circle whose centre moves evenly.

    The centre moves on a plate that is not quite level.

    Parameters
    ----------
    t, x, y : array_like, shape (n,)
        Track, as for `circle`.
    sigma : float, optional
        Standard deviation of the error of each coordinate [m], as for `circle`.

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


def _track(t: Any, x: Any, y: Any, sigma: float | str | None, moving: bool) -> Track:
    """Return the slowest circle or cycloid that fits a track about as well as the best one, with the others."""
    times, place, scatter = _checked(t, x, y, sigma, moving)
    minima = _minima(_scaled(times), place, moving)
    speeds = [abs(rate * coefficients[-1]) / np.ptp(times) for rate, coefficients in minima]
    slow = [each for each, speed in zip(minima, speeds, strict=True) if speed <= FASTER * max(speeds[0], FAST_TURN)]
    track, *others = [_read(times, place, scatter, each) for each in slow]
    radius, error = track.values["path_radius"], track.errors["path_radius"]
    if not error < radius:
        raise ParameterError(f"track: turns by too little to tell its radius, {radius:.3g} ± {error:.2g} m")
    notes = [
        f"a turn of {one.values['path_radius']:.4g} m in {one.values['period']:.6g} s, "
        f"{'counter' if one.sense > 0 else ''}clockwise, fits about as well: the times, every {_step(times):.3g} s, are too few"
        for one in others
    ]
    return replace(track, others=tuple(others), notes=(*notes, *track.notes))


def _read(times: np.ndarray, place: np.ndarray, sigma: float | None, minimum: Minimum) -> Track:
    """Return the circle or the cycloid of a minimum of the misfit, with its errors."""
    (rate, coefficients), s, span, notes = minimum, _scaled(times), float(np.ptp(times)), []
    J = _slopes(s, rate, coefficients)
    scatter, within, _ = _scatter(s, place, rate, coefficients)
    sigma = scatter if sigma is None else sigma
    around, units = coefficients[-1], np.array([1.0, span])[: coefficients.size - 1]
    radius, period = float(abs(around)), TURN * span / abs(rate)
    values = [radius, period, *(coefficients[:-1] / units).view(float).tolist()]
    G = np.zeros((len(values), J.shape[1]))  # derivatives of the values by rate and coefficients
    G[0, -2:], G[1, 0] = (around.real / radius, around.imag / radius), -period / rate
    G[2:, 1:-2] = np.diag(np.repeat(1 / units, 2))
    back = sigma * G @ np.linalg.pinv(J)
    covariance = back @ back.T
    if TURN * radius / period > FASTER * FAST_TURN:
        notes.append(f"a dimer at {TURN * radius / period:.3g} m/s is too fast: x and y must be in m, t in s")
    if abs(within) > APART_IN_TIME * sigma:
        # distance by which the mean of points along an arc is nearer to the centre
        nearer = within.real**2 / (2 * radius)
        covariance[0, 0] += nearer**2
        notes.append(
            f"places of one time differ by {2**0.5 * abs(within):.2g} m: their mean counts, the centre of two balls; "
            f"if times are rounded, the radius is {nearer:.2g} m too small"
        )
    return Track(
        values=dict(zip(CYCLOID, values, strict=False)),
        covariance=covariance,
        sense=int(np.sign(rate)),
        sigma=sigma,
        times=times,
        moving=coefficients.size == 3,
        notes=tuple(notes),
    )


def _checked(t: Any, x: Any, y: Any, sigma: Any, moving: bool) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Return times and places x + iy of a track, each row once, and the error of a coordinate, if any; all checked."""
    given = (("t", t, "s"), ("x", x, "m"), ("y", y, "m"))
    times, *places = (as_numbers(name, values, units) for name, values, units in given)
    check_labels({"t": t, "x": x, "y": y})
    for name, values in zip("xy", places, strict=True):
        if values.size != times.size:
            raise ParameterError(f"{name}: has {values.size} values; must have {times.size}, as t has")
    times, place, different = _rows(times, places[0] + 1j * places[1])
    least = 5 if moving else 4
    if different < least:
        raise ParameterError(f"t: has {different} different times; must have at least {least}")
    if max(np.ptp(values) for values in places) == 0:
        raise ParameterError(f"x, y: all {places[0].size} points are at one place; a track has to move")
    sigma = None if sigma is None else as_number("sigma", sigma, "m")
    if sigma is not None and sigma <= 0:
        raise ParameterError(f"sigma = {sigma:g}: must be > 0")
    return times, place, sigma


def _rows(times: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the times and places of a track by time, without copies of a row, and the number of different times.

    Several rows of one time may be two balls, or several times that were rounded to one. Where most times have several
    rows, two kinds of times are left out. A time with a single row may have one ball only. The first or the last time
    with fewer rows than most may lack a part of the times that were rounded to it, so that their mean is shifted.
    """
    order = np.argsort(times, kind="stable")
    times, place = times[order], place[order]
    begins = np.r_[True, np.diff(times) > SAME_TIME * np.ptp(times)]
    if begins.all():
        return times, place, times.size
    rows = np.unique(np.column_stack([times[begins][np.cumsum(begins) - 1], place.real, place.imag]), axis=0)
    _, group, counts = np.unique(rows[:, 0], return_inverse=True, return_counts=True)
    usual = np.quantile(counts, FEW_POINTS)
    whole = counts >= np.minimum(usual, 2)
    whole[[0, -1]] = counts[[0, -1]] >= usual
    rows = rows[whole[group]]
    return rows[:, 0], rows[:, 1] + 1j * rows[:, 2], int(whole.sum())


def _step(times: np.ndarray) -> float:
    """Return the usual (median) step of the times."""
    return float(np.median(np.diff(np.unique(times))))


def _slopes(s: np.ndarray, rate: float, coefficients: np.ndarray) -> np.ndarray:
    """Return the derivatives of x and y by the rate, and by the real and the imaginary part of each coefficient."""
    A = _basis(s, rate, coefficients.size == 3)
    parts = (factor * column for column in A.T for factor in (1, 1j))
    columns = np.column_stack([1j * s * A[:, -1] * coefficients[-1], *parts])
    return np.vstack([columns.real, columns.imag])


def _scatter(s: np.ndarray, place: np.ndarray, rate: float, coefficients: np.ndarray) -> tuple[float, complex, float]:
    """Return the error of a coordinate, the distance of places of one time, and what chance adds to a sum of squares.

    The error is the standard deviation without what a slow drift of rate and radius explains. With many times that is a
    change to second order, with few a linear one. Points of one time count with their mean, as two balls lie on both
    sides of it. Their distance is complex: its real part lies along the path, its imaginary part across.
    """
    s, group, counts = np.unique(s, return_inverse=True, return_counts=True)
    mean = (np.bincount(group, place.real) + 1j * np.bincount(group, place.imag)) / counts
    A, weights = _basis(s, rate, coefficients.size == 3), np.sqrt(np.tile(counts, 2))
    residual = A @ coefficients - mean
    within = (place - mean[group]) / (1j * A[:, -1] * coefficients[-1] / abs(coefficients[-1]))[group]
    along, across = np.sqrt([within.real @ within.real, within.imag @ within.imag] / np.maximum(1, group.size - s.size))
    left, free = np.concatenate([residual.real, residual.imag]) * weights, weights.size - 1 - 2 * coefficients.size
    variance = max(float(left @ left) / free, abs(TIME_ROUNDING * coefficients[-1]) ** 2)
    orders = np.column_stack([1j * s**2, s, 1j * s**3, s**2])[:, : 4 if s.size >= SLOW_POINTS else 2]
    slow = orders * (A[:, -1] * coefficients[-1])[:, None]
    slopes = np.column_stack([_slopes(s, rate, coefficients), np.vstack([slow.real, slow.imag])]) * weights[:, None]
    left = left - slopes @ np.linalg.lstsq(slopes, left, rcond=None)[0]
    sigma = np.linalg.norm(left) / np.sqrt(slopes.shape[0] - slopes.shape[1])
    return float(sigma), complex(along, across), float(variance * variance_ratio.isf(CHANCE_OF_ALIAS, 1, free))


def _scaled(times: np.ndarray) -> np.ndarray:
    """Return times over their span, from -1/2 to 1/2."""
    return (times - 0.5 * (times.min() + times.max())) / np.ptp(times)


def _basis(s: np.ndarray, rate: float, moving: bool) -> np.ndarray:
    """Return the columns whose sum is a track x + iy: a centre, its velocity if it moves, even motion on a circle."""
    still = [np.ones(s.size), s] if moving else [np.ones(s.size)]
    return np.column_stack([*still, np.exp(1j * rate * s)])


def _minima(s: np.ndarray, place: np.ndarray, moving: bool) -> list[Minimum]:
    """Return the minima of the misfit that fit about as well as the best one, the slowest first.

    Promising rates are tried with some of the points, and the best of them with all.
    """
    some = np.sort(np.random.default_rng(0).permutation(s.size)[:TRIED_POINTS])
    slow = TURN * np.geomspace(LEAST_TURN, 1, 16)
    slow = np.concatenate([-slow[::-1], slow])
    misses = np.array([np.inf, *(_solved(_basis(s[some], rate, moving), place[some])[1] for rate in slow), np.inf])
    slow = slow[(misses[1:-1] <= misses[:-2]) & (misses[1:-1] <= misses[2:])]
    minima = _alike(s[some], place[some], [*slow, *_fast_rates(s, place, moving)], moving)
    return minima if some.size == s.size else _alike(s, place, [rate for rate, _ in minima], moving)


def _alike(s: np.ndarray, place: np.ndarray, rates: list[float], moving: bool) -> list[Minimum]:
    """Return the minima near `rates` that fit about as well as the best of them, the slowest first."""
    minima = [_refined(s, place, rate, moving) for rate in rates]
    misses = [np.linalg.norm(_basis(s, rate, moving) @ coefficients - place) ** 2 for rate, coefficients in minima]
    order = np.argsort(misses)
    most = misses[order[0]] + _scatter(s, place, *minima[order[0]])[2]
    found: list[Minimum] = []
    for k in order:
        if misses[k] <= most and all(abs(minima[k][0] - rate) > RATE_VALLEY for rate, _ in found):
            found.append(minima[k])
    return sorted(found, key=lambda each: abs(each[0]))


def _fast_rates(s: np.ndarray, place: np.ndarray, moving: bool) -> np.ndarray:
    """Return rates of more than a turn at which a circle explains more squares of a track than at rates around.

    Times are put into bins, whose usual step limits the rates. The transforms of the bins are the sums of e = exp(i
    rate s), of s e and of the conjugate of e times the place. From them follow the squares that a circle explains
    beside a centre, fixed or moving: a quotient at each rate.
    """
    most = next_fast_len(int(min(PER_STEP / _step(s), MOST_TURNS_TRIED)) + 1)
    bins, length = 2 * most, 2 * most * TURN_PARTS
    which = np.minimum((bins * (s + 0.5)).astype(int), bins - 1)
    still = np.linalg.qr(_basis(s, 0.0, moving)[:, : 2 if moving else 1].real)[0]
    left = place - still @ (still.T @ place)

    def spectrum(values: np.ndarray) -> np.ndarray:
        """Return the sums of values times exp(-i rate s), but for a phase, at multiples of 1 / TURN_PARTS turns."""
        parts = [np.bincount(which, part, bins) for part in (values.real, values.imag)]
        return fft(parts[0] + 1j * parts[1], length)

    # squares of a circle without the part of it that a centre (and its velocity) explains
    own = s.size - sum(np.abs(spectrum(column)) ** 2 for column in still.T)
    taken = np.abs(spectrum(left)) ** 2 / np.maximum(own, LEAST_OWN * s.size)
    turns = fftfreq(length, 1 / length) / TURN_PARTS
    taken[np.abs(turns) < 1] = 0.0  # slower rates are tried one by one
    peaks = np.flatnonzero((taken > WORTH * taken.max()) & (taken >= np.roll(taken, 1)) & (taken >= np.roll(taken, -1)))
    here, ahead, back = taken[peaks], taken[(peaks + 1) % length], taken[peaks - 1]
    height = here + (ahead - back) ** 2 / np.maximum(8 * (2 * here - ahead - back), here)  # top of a parabola
    chosen = [np.argsort(order)[:TRIED] for order in (-height, np.abs(turns[peaks]))]
    return TURN * turns[peaks[np.union1d(*chosen)]]


def _solved(A: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the coefficients of least squares, and the norm of the residuals."""
    coefficients = np.linalg.lstsq(A, place, rcond=None)[0]
    return coefficients, float(np.linalg.norm(A @ coefficients - place))


def _refined(s: np.ndarray, place: np.ndarray, rate: float, moving: bool) -> tuple[float, np.ndarray]:
    """Return the rate and the coefficients of least squares, from a rate nearby."""

    def residual(p: np.ndarray) -> np.ndarray:
        miss = _basis(s, p[0], moving) @ p[1:].view(complex) - place
        return np.concatenate([miss.real, miss.imag])

    def slopes(p: np.ndarray) -> np.ndarray:
        return _slopes(s, p[0], p[1:].view(complex))

    start = np.concatenate([[rate], _solved(_basis(s, rate, moving), place)[0].view(float)])
    # all that it returns, not the place alone: else it warns where round-off keeps it from its tolerances
    p, *_ = leastsq(
        residual, start, Dfun=slopes, xtol=1e-14, ftol=1e-14, gtol=1e-14, diag=np.ones(start.size), full_output=True
    )
    return float(p[0]), p[1:].copy().view(complex)
