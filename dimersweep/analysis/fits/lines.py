"""Analyse a periodic motion in a long record: times of its samples, its line, its trend, and changes of the line."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_lsq_spline
from scipy.linalg import toeplitz
from scipy.ndimage import maximum_filter1d, median_filter

from dimersweep.errors import ParameterError

CHUNK = 2048  # samples that are summed at a time: their exponentials stay in a processor's cache
MOST_BLOCKS = 64  # blocks of a record at most; each has a period at least
# most steps of Gauss and Newton's method for the frequency, and the relative size of a step that ends it
STEPS, SETTLED = 20, 1e-12
FIRST_SAMPLES = 8  # samples whose numbers follow from the usual step alone, even if some are missing
# missing samples up to which a clock without gaps, a little slower, is tried last: its rounded times are the same
FEW_MISSING = 2
# periods between the knots of a trend, and means of the record from knot to knot: each covers a quarter of a period
TREND, TREND_PARTS = 4, 16
# height of a clear line over the median of this number of bins on each side: noise alone reaches it in one of 1e11
# bins, since its amplitude in a bin has the median 1.18 sigma, and exceeds 6 * 1.18 sigma with probability exp(-25)
CLEAR, MEDIAN_BINS = 6.0, 20
# bins beside a line in which no other line is looked for: a Hann window widens a line to two on each side
NEAR_LINE = 3
# further lines that are removed at most, and their least amplitude over the first one
LINES, SMALL_LINE = 12, 1e-5
# change of a line that refuses the record; changes that are reported: over those of noise, and relative to the line
STEADY_LINE, NOISE_CHANGES, REPORTED_CHANGE = 0.1, 2.0, 0.003


@dataclass(frozen=True, eq=False)
class Periodic:
    """Harmonics that fit a record: the sum of `parts[k] exp(i k omega t)` over positive and negative k.

    Attributes
    ----------
    omega : float
        Angular frequency [rad s-1].
    parts : ndarray, shape (harmonics + 1, axes), complex128
        Amplitudes for k from 0; those for -k are the conjugates.
    weights : ndarray, shape (axes,)
        Inverse variances of the residuals of each axis.
    curve : float
        Second derivative of half the weighted sum of squares by `omega`.
    """

    omega: float
    parts: np.ndarray
    weights: np.ndarray
    curve: float

    @property
    def f(self) -> float:
        """Frequency [Hz]."""
        return float(self.omega / (2 * np.pi))

    def taken_from(self, t: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the record without the harmonics, but with the constant."""
        rest, factors = a.copy(), 2 * np.stack([self.parts.real, -self.parts.imag], axis=1)
        for part, waves in _waves(t, self.omega, len(self.parts) - 1, np.arange(0, t.size + CHUNK, CHUNK)):
            rest[part] -= waves[:, 2:] @ factors[1:].reshape(-1, a.shape[1])
        return rest

    def sums(self, t: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for blocks of a record their middle times, numbers of samples, and sums of `rest exp(-i k omega t)`.

        The sums have the shape (blocks, harmonics + 1, axes).
        """
        count = int(min(MOST_BLOCKS, np.ptp(t) * self.f))
        edges = np.searchsorted(t, [*np.linspace(t[0], t[-1], count + 1)[:-1], np.inf])
        each = _waves(t, self.omega, len(self.parts) - 1, edges)
        sums = np.array([(rest[part].T @ waves).view(complex).conj().T for part, waves in each])
        return np.add.reduceat(t, edges[:-1]) / np.diff(edges), np.diff(edges), sums


def _waves(t: np.ndarray, omega: float, most: int, edges: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield parts of a record, with the real and imaginary parts of exp(i k omega t) for k from 0 to `most`."""
    for part in (slice(*ends) for ends in pairwise(edges)):
        powers = np.ones((t[part].size, most + 1), complex)
        powers[:, 1] = np.exp(1j * omega * t[part])
        for k in range(2, most + 1):
            # from halves, so that rounding grows with the logarithm of k only
            np.multiply(powers[:, k // 2], powers[:, k - k // 2], out=powers[:, k])
        yield part, powers.view(float)


def fitted(t: np.ndarray, a: np.ndarray, omega: float, most: int, *, free: bool = True) -> Periodic:
    """Return the harmonics up to the order `most` that fit a record best.

    If `free`, the frequency is fitted, too, by Gauss and Newton's method from `omega` on [rad s-1].
    """
    span, squares = np.abs(t).max(), (a**2).sum(axis=0)
    least = t.size * (1e-15 * np.abs(a).max()) ** 2  # squares that rounding leaves of a record without noise
    orders = np.arange(-most, most + 1)
    for _ in range(STEPS):
        # the normal matrix needs sums of exponentials only, so no array of record times harmonics is kept
        moments, products = np.zeros((3, 4 * most + 2)), np.zeros((2, a.shape[1], 2 * most + 2))
        for part, waves in _waves(t, omega, 2 * most, np.arange(0, t.size + CHUNK, CHUNK)):
            late = t[part] / span
            moments += np.stack([np.ones_like(late), late, late**2]) @ waves
            products += np.stack([a[part].T, late * a[part].T]) @ waves[:, : 2 * most + 2]
        plain, first, second = (toeplitz(each.conj(), each) for each in moments.view(complex))
        above = products.view(complex).transpose(0, 2, 1)
        seen, late_seen = np.concatenate([above[:, :0:-1], above.conj()], axis=1)
        parts = np.linalg.solve(plain, seen)
        weights = t.size / np.maximum(squares - (parts.conj() * seen).sum(axis=0).real, least)
        slope = 1j * orders[:, None] * parts  # derivative of the model by omega, without its factor t
        across = first @ slope
        curves = slope.conj() * (second @ slope) - across.conj() * np.linalg.solve(plain, across)
        curve = float(weights @ curves.sum(axis=0).real)
        change = float(weights @ (slope.conj() * (late_seen - first @ parts)).sum(axis=0).real) / curve
        found = Periodic(omega, parts[most:], weights, curve * span**2)
        if not free or abs(change) <= max(SETTLED * omega * span, 1e-3 * curve**-0.5):
            break
        omega += float(np.clip(change, -1, 1)) / span  # at most 1 rad at the ends: a larger step would leave the line
    return found


def on_a_grid(t: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the times of an even clock whose rounded times are `t`, and the relative error of its pace.

    If there is no such clock, return `t` and no error (0). All times count from the first one.

    Raises
    ------
    ParameterError
        If the times do not increase.
    """
    steps, since = np.diff(t), t - t[0]
    wrong, backward = np.flatnonzero(steps <= 0), steps.min() < 0 or since[-1] == 0
    fault = f"t = {t[wrong[0] + 1]:.13g} after {t[wrong[0]]:.13g}: the times must increase" if wrong.size else ""
    if backward:
        raise ParameterError(fault)
    # stamps of a coarse clock differ by multiples of its steps; steps are at least those of single precision
    levels = np.diff(np.unique(np.append(steps, 0.0)))
    levels = levels[levels > 4 * np.spacing(np.abs(t).max())]
    rounded = max(levels.min() if levels.size else 0.0, np.spacing(np.float32(since[-1])))
    all_there = np.arange(t.size)
    numbers = _numbers(since, rounded) if np.ptp(steps) > 0.01 * rounded else all_there
    few = np.ptp(numbers) - all_there[-1] <= FEW_MISSING
    for places in (numbers, all_there) if few else (all_there, numbers):
        even = places - places.mean()
        even *= even @ since / (even @ even or 1.0)
        if (np.diff(places) > 0).all() and np.ptp(even - since) <= 1.05 * rounded:
            # rounding repeats after a while, so its errors are not independent: means of blocks show their size
            off = [each.mean() for each in np.array_split(even - since, min(MOST_BLOCKS, t.size))]
            return even - even[0], float(np.std(off) * np.sqrt(12 / len(off)) / since[-1])
    if fault:
        raise ParameterError(fault)
    return since, 0.0


def _numbers(t: np.ndarray, rounded: float) -> np.ndarray:
    """Return the number of each sample by an even clock, whose samples may be missing.

    The clock has the step of which most times are multiples.
    """
    m = min(FIRST_SAMPLES, t.size - 1)
    strides = t[m:] - t[:-m]
    step = max(float(strides[np.abs(strides - np.median(strides)) <= rounded].mean()) / m, np.spacing(t[-1]))
    while m < t.size:  # longer and longer stretches give the step more and more exactly
        m = min(2 * m, t.size)
        tried = step * (1 + np.arange(-4, 5) / (8 * m))
        together = [np.exp(2j * np.pi / each * t[:m]).mean() for each in tried]
        k = int(np.abs(together).argmax())
        step = float(tried[k])
    return np.rint(t / step - np.angle(together[k]) / (2 * np.pi))


def densities(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz], shape (m,), and the spectral density of each axis, in units of `a` Hz-1/2, shape (axes,
    m).
    """
    count = round(np.ptp(t) / np.median(np.diff(t))) + 1
    even, step = np.linspace(t[0], t[-1], count, retstep=True)
    window = np.hanning(count + 2)[1:-1]  # without a window a strong line would hide weak ones beside it
    values = [np.fft.rfft(window * np.interp(even, t, each)) for each in (a - a.mean(axis=0)).T]
    return np.fft.rfftfreq(count, step), np.abs(values) * np.sqrt(2 * step / (window**2).sum())


def peaks(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequencies of clear lines [Hz], and their amplitudes, the strongest first.

    Frequencies are interpolated by a parabola through the logarithms of three bins.
    """
    frequencies, density = densities(t, a)
    size = np.linalg.norm(density, axis=0) * np.sqrt(3 * frequencies[1])
    here = (size == maximum_filter1d(size, 2 * NEAR_LINE + 1)) & (
        size > CLEAR * median_filter(size, 2 * MEDIAN_BINS + 1)
    )
    k = np.flatnonzero(here[NEAR_LINE + 1 : -1]) + NEAR_LINE + 1
    k = k[np.argsort(-size[k])]
    low, top, high = (np.log(np.maximum(size[k + by], 1e-300)) for by in (-1, 0, 1))
    return (k + 0.5 * (low - high) / np.minimum(low - 2 * top + high, -1e-300)) * frequencies[1], size[k]


def trend(t: np.ndarray, rest: np.ndarray, period: float) -> np.ndarray:
    """Return the slow change of a record, over several periods: a spline, shape (n, axes)."""
    knots = np.linspace(t[0], t[-1], int(np.ptp(t) / (TREND * period)) + 1)
    edges = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], TREND_PARTS * len(knots), endpoint=False)))
    counts = np.diff(edges, append=t.size)
    centres, means = np.add.reduceat(t, edges) / counts, np.add.reduceat(rest, edges) / counts[:, None]
    return make_lsq_spline(centres, means, np.r_[[t[0]] * 3, knots, [t[-1]] * 3])(t)


def without_others(
    t: np.ndarray, a: np.ndarray, rest: np.ndarray, found: Periodic
) -> tuple[np.ndarray, list[Periodic]]:
    """Return a record without the clear lines in its residual `rest`, and these lines."""
    lines: list[Periodic] = []
    frequencies, sizes = peaks(t, rest)
    # a line slower than the knots of the trend is part of it
    clear = (sizes > SMALL_LINE * np.abs(found.parts[1]).max()) & (frequencies > found.f / TREND)
    for frequency in frequencies[clear]:
        order = round(frequency / found.f)
        own = 1 <= order < len(found.parts) and abs(frequency - order * found.f) * np.ptp(t) <= NEAR_LINE
        if not own and len(lines) < LINES:
            lines.append(fitted(t, rest, 2 * np.pi * frequency, 1))
            rest, a = (lines[-1].taken_from(t, each) for each in (rest, a))
    return a, lines


def changes(t: np.ndarray, rest: np.ndarray, found: Periodic, begin: float) -> str:
    """Return a clause on how the spectral line at the frequency of `found` changes along z, "" if it hardly does.

    The line may begin or stop within the record, change its frequency, or change its amplitude.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the samples [s].
    rest : ndarray, shape (n, axes)
        Record without the harmonics of `found` [m s-2]; its first column is the acceleration along z.
    found : Periodic
        Harmonics that fit the record.
    begin : float
        Time that is added to `t` for the times in the clause [s].

    Raises
    ------
    ParameterError
        If the line changes by more than `STEADY_LINE`, relative to its amplitude.
    """
    at, counts, sums = found.sums(t, rest)
    line, at = 1 + sums[:, 1, 0] / counts / found.parts[1, 0], at + begin
    change = float(np.sqrt((np.abs(line - 1) ** 2).mean()))
    # median of the size of a difference of two, over the deviation of one
    noise = np.median(np.abs(np.diff(line))) / 1.18
    if change <= max(NOISE_CHANGES * noise, REPORTED_CHANGE):
        return ""
    sizes, turns = np.abs(line), np.unwrap(np.angle(line)) / (2 * np.pi)
    there = sizes > 0.5 * np.quantile(sizes, 0.9)
    away = np.abs(turns - np.interp(at, at[[0, -1]], turns[[0, -1]]))
    k = int(away[1:-1].argmax()) + 1
    if not there.all():
        ends = [(at[k : k + 2].mean(), "begins" if there[k + 1] else "stops") for k in np.flatnonzero(np.diff(there))]
        seen = " and ".join(f"{word} at t = {when:.3f} s" for when, word in ends[:2])
    elif 2 * np.pi * away[k] > np.ptp(sizes) / 2:
        before, after = (found.f + np.polyfit(at[part], turns[part], 1)[0] for part in (slice(k + 1), slice(k, None)))
        seen = f"has {before:.6g} Hz before t = {at[k]:.3f} s and {after:.6g} Hz after"
    else:
        ends = [(at[k], 2 * abs(found.parts[1, 0]) * sizes[k]) for k in sorted((sizes.argmin(), sizes.argmax()))]
        seen = "has " + " and ".join(f"{size:.4g} m/s2 at t = {when:.3f} s" for when, size in ends)
    seen = f"the line at {found.f:.6g} Hz {seen}"
    if change > STEADY_LINE:
        raise ParameterError(f"a (z): {seen}; give a part in which it stays the same")
    return seen
