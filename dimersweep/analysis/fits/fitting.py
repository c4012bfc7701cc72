"""Find the parameters whose orbit is nearest to measured values, their errors, and what the data leave open."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product
from signal import SIGINT
from threading import current_thread, main_thread
from typing import Any, NamedTuple, Unpack

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import orthogonal_procrustes
from scipy.optimize import least_squares, minimize
from scipy.stats import chi2, norm
from scipy.stats.qmc import Halton

from dimersweep.analysis.fits.likelihood import Likelihood
from dimersweep.analysis.fits.measured import MEASURABLE, Measured
from dimersweep.analysis.fits.pictures import draw_fit
from dimersweep.analysis.fits.tracks import Track
from dimersweep.analysis.fits.valley import FEW_ERRORS, Valley
from dimersweep.analysis.orbits.map.finding import RTOL
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.poincare import Recorder
from dimersweep.errors import OrbitError, ParameterError, Stopped
from dimersweep.inputs import check_switch
from dimersweep.plots.style import Look
from dimersweep.symbols import PARAMETERS, units_shown
from dimersweep.work.progress import Tally, watch

# points at which the orbit is computed first: this number for each free parameter, and once more
FIRST_LOOKS = 8
MOST_CORNERED = 3  # free parameters up to which the corners of the ranges are among them: there are 2**n corners
DESCENTS = 4  # descents of the solver at most, from points that are better than all points around
MOST_STEPS = 30  # steps of the solver in a descent at most
# step of the differences for slopes [ranges]: their errors are its square, 1e-8, and that of the orbit, 1e-10, over it
SLOPE_STEP = 1e-4
# a descent has come to no minimum if a step of one range along the slope would gain more than this share of the misfit
FALLS_ON = 0.05
RIM = 1e-3  # distance from an end of the range [ranges] within which a value counts as at the end
APART_BY = 0.05  # distance above which two minima are different ones [ranges]
INSIDE = 1e-9  # distance of a start from the ends of the ranges [ranges]: the solver refuses to start on its bounds
ENOUGH = 1e-6  # step [ranges], and relative gain in the misfit, at which the solver ends
# slope of half the misfit at which the solver ends [1/range]: a direction that is determined has a singular value of at
# least FEW_ERRORS, so less than LEVEL / FEW_ERRORS = 3e-4 of an error is left
LEVEL = 1e-3
IMPROBABLE = 0.0027  # probability of a misfit at which the data are impossible: that of three standard deviations
FINE = 1e-9  # step at which the solver ends across a valley [ranges]: finer than ENOUGH, as the data change fast there
FEW_STEPS = 10  # steps across a valley at most: each starts near its end
# errors per range with which the solver is kept from moving along a valley, where the misfit is nearly flat
STIFF = 1e3
POINTS = 20  # approximate number of points of a valley as large as the ranges
PER_ERROR = 0.5  # step along a shorter valley, in the errors along it
APART_ALONG = 0.7  # distance below which points of a valley are the same, in steps: a neighbour is 1 away
FAR_UP = 9.0  # misfit above the best one at which a valley ends: three standard deviations
CURVED = 0.3  # deviation from the slopes, one error away from the fit and in errors, above which the slopes do not do
NO_ERRORS = 1e-2  # change of the data over a whole range, in errors, below which a parameter has no effect


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Fit:
    """The parameters whose orbit is nearest to the measured values, with their errors.

    Attributes
    ----------
    values : dict
        Values of the free parameters, SI units.
    covariance : ndarray, shape (n, n)
        Covariance of the free parameters, in their order: from the slopes at the fit and the errors of the data, or
        from the valley, if there is one. A parameter that the data do not determine has the variance inf, and nan off
        the diagonal. All is nan if no parameters give the data and the nearest ones lie at the end of a range or at a
        border of the stable orbits.
    possible : bool
        True if parameters in the ranges may give the data: a greater misfit has a probability of at least 0.0027.
    chi_square, probability : float
        Sum of the squared residuals in units of their errors, and the probability of a greater sum.
    singular_values : ndarray, shape (n,)
        Singular values of the slopes, the largest first: change of the data, in their errors, for a step of one range.
    directions : ndarray, shape (n, n)
        Steps that belong to the singular values, one in each row, in ranges.
    undetermined : tuple of str
        Sentences on what the data leave open.
    notes : tuple of str
        Further sentences: that no parameters give the data, that a value is at the end of its range, that there is
        another minimum.
    others : tuple of dict
        Values at other minima that give the data, too.
    valley : Valley or None
        Points that cover all values that give the data, with the profile of each parameter; only where the slopes at
        one point do not give the errors.
    measured : Measured
        The measured values.
    predicted : ndarray, shape (m,)
        The measured quantities of the fitted orbit.
    orbit : PeriodicOrbit
        The fitted orbit.
    ranges : dict
        Least and greatest value of each free parameter.
    cost : float
        Forcing periods that the fit took.

    Examples
    --------
    >>> from dimersweep import fits
    >>> fit = fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)})
    >>> fit
    <Fit: e 0.6506 ± 0.0076, chi-square 0.00 of 1 value>
    """

    values: dict[str, float]
    covariance: np.ndarray
    possible: bool
    chi_square: float
    probability: float
    singular_values: np.ndarray
    directions: np.ndarray
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    others: tuple[dict[str, float], ...]
    valley: Valley | None
    measured: Measured
    predicted: np.ndarray
    orbit: PeriodicOrbit
    ranges: dict[str, tuple[float, float]]
    cost: float

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of the fitted values: 68.27 % of the probability lie within one of them."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def within(self, share: float) -> dict[str, float]:
        """Return the distances from the fitted values within which a share of the probability lies.

        A share of 0.6827 gives `errors`. Twice an error holds 95.45 % where all is determined; in a valley it may hold
        much less.

        Examples
        --------
        >>> from dimersweep import fits
        >>> fit = fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)})
        >>> round(fit.within(0.9545)["e"] / fit.errors["e"], 3)
        2.0
        """
        errors = np.array(list(self.errors.values()))
        if self.valley is None:
            distances = errors * norm.isf((1 - share) / 2)
        else:
            distances = np.where(np.isinf(errors), np.inf, self.valley.within(np.array([*self.values.values()]), share))
        return dict(zip(self.values, distances.tolist(), strict=True))

    def __repr__(self) -> str:
        errors = self.errors
        words = ", ".join(f"{name} {value:.4g} ± {errors[name]:.2g}" for name, value in self.values.items())
        n = len(self.predicted)
        remark = "" if self.possible else "; no parameters in the ranges give the data"
        remark += "; not all is determined" if self.undetermined else ""
        return f"<Fit: {words}, chi-square {self.chi_square:.2f} of {n} value{'s' if n > 1 else ''}{remark}>"

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """Return the fitted and the measured values, and what the data leave open, as lines of text.

        Examples
        --------
        >>> from dimersweep import fits
        >>> print(fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)}).table().splitlines()[0])
        free               value        error   range
        """
        errors = self.errors
        lines = [f"{'free':<14}{'value':>10}{'error':>13}   range"]
        for name, (low, high) in self.ranges.items():
            lines.append(
                f"{name:<14}{self.values[name]:>10.6g}{errors[name]:>13.2g}   {low:g} to {high:g} {unit_of(name)}".rstrip()
            )
        lines.append(f"{'measured':<14}{'value':>10}{'error':>13}{'fitted':>13}")
        rows = zip(self.measured.names, self.measured.values, self.measured.errors, self.predicted, strict=True)
        lines += [f"{n:<14}{v:>10.6g}{s:>13.2g}{p:>13.6g} {unit_of(n)}".rstrip() for n, v, s, p in rows]
        lines.append(f"chi-square {self.chi_square:.3g}; a greater one has a probability of {self.probability:.2g}")
        return "\n".join([*lines, *self.notes, *self.undetermined, f"cost: {self.cost:,.0f} forcing periods"])

    def plot(self, **look: Unpack[Look]) -> Figure:
        """Draw the regions of one and two standard deviations of each pair of free parameters.

        With a valley, also draw the profile of each parameter. `look` is as in `plots.Look`.

        Examples
        --------
        >>> from dimersweep import fits
        >>> fits.fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)}).plot().savefig("fit.png")
        """
        return draw_fit(self.values, self.covariance, self.ranges, self.valley, **look)


def fit(
    measured: Mapping[str, tuple[float, float]] | Measured | Track,
    free: Mapping[str, tuple[float, float]],
    *,
    spin: float | str | None = None,
    rtol: float = RTOL,
    progress: bool = True,
    **parameters: float,
) -> Fit:
    """Return the parameters whose orbit is nearest to the measured values.

    The model is the stable orbit of `orbits.find`. Orbits are computed at points spread over the ranges, and
    `scipy.optimize.least_squares` descends from the best of them.

    Parameters
    ----------
    measured : mapping of str to (float, float), Measured or Track
        Values and standard deviations of some of `path_radius` [m], `period` [s], `path_speed` [m s-1], `zeta` [rad],
        `spin` [rad s-1], `impact_phase` [cycles], `radius` [m] and `speed` [m s-1]. The last two are those of equation
        (11), right after the double impact, and not of the path. Or a track, from `circle` or `cycloid`.
    free : mapping of str to (float, float)
        Least and greatest value of each free parameter; `spin` may be one of them.
    spin : float, optional
        Axial spin [rad s-1] if it is not free; by default the spin that a lateral start with `xdot0` rolls up to.
    rtol : float
        Accuracy of the map [1].
    progress : bool
        If True, show the progress: a bar on a terminal and in a notebook, else a line every ten seconds.
    **parameters : float
        Parameters of the model that are not free; by default the paper's base case.

    Returns
    -------
    Fit

    Raises
    ------
    ParameterError
        For an unknown name, an error that is not above 0, a range without an interior, or a value that is not allowed.
    OrbitError
        If no point at which an orbit was computed has a stable one.
    Stopped
        On Ctrl-C, with the best values so far; it is a KeyboardInterrupt.

    Examples
    --------
    >>> from dimersweep import fits
    >>> fit = fits.fit({"path_radius": (3.1, 0.02)}, {"e": (0.5, 0.85), "mu": (0.05, 0.4)}, progress=False)
    >>> fit.possible, round(float(fit.predicted[0]), 2)
    (False, 3.74)
    """
    likelihood = Likelihood(measured, free, spin=spin, rtol=rtol, **parameters)
    # other threads show no progress: two bars at a time are an error
    shown = check_switch("progress", progress) and current_thread() is main_thread()
    with watch(1, {}, lambda: 1, show=shown) as tally:
        search = _Search(likelihood, tally)
        try:
            found = _fitted(search)
        except KeyboardInterrupt as stop:
            raise Stopped(search.so_far(), getattr(stop, "signal", SIGINT)) from None
        tally.doing = f"chi-square {found.chi_square:.3g}"
        tally.expect(tally.done + 1)
        tally.add({"done": 1})
        return found


def _fitted(search: "_Search") -> Fit:
    """Return the fit: compute points spread over the ranges, descend from the best of them, and take the least misfit.

    If the least misfit is improbable, and a border of the stable orbits has cut off its descent, a simplex goes on
    along the border.
    """
    starts = search.starts()
    ends = _ordered(map(search.descended, search.steps("descending", starts)))
    slopes = search.slopes(ends[0])
    if _probability(ends[0].misfit, slopes) < IMPROBABLE and search.cut_off(ends[0], slopes):
        ends = _ordered([*map(search.simplex, search.steps("along a border", ends[:1])), *ends])
        slopes = search.slopes(ends[0])
    return _answer(search, ends, slopes)


class _Point(NamedTuple):
    """A point of the ranges (each from 0 to 1), its stable orbit, and the residuals of its data, in errors."""

    u: np.ndarray
    orbit: PeriodicOrbit
    residuals: np.ndarray

    @property
    def misfit(self) -> float:
        """Sum of the squared residuals [1]."""
        return float(self.residuals @ self.residuals)


def _ordered(points: Iterable[_Point]) -> list[_Point]:
    """Return points in the order of their misfits, the best first."""
    return sorted(points, key=lambda point: point.misfit)


class _Search:
    """A search for the best point in units of the ranges, which keeps the last point and the best one."""

    def __init__(self, likelihood: Likelihood, tally: Tally) -> None:
        self.likelihood = likelihood
        self.tally, self.doing = tally, ""
        self.width = likelihood.high - likelihood.low
        self.recorder = Recorder()
        self.last: _Point | None = None
        self.best: _Point | None = None
        self.reason: Exception | None = None

    def at(self, u: np.ndarray, guess: PeriodicOrbit | None = None) -> _Point | None:
        """Return the point at `u` with its orbit, found from a guess nearby or from nothing; None if it has no stable
        orbit.
        """
        before, self.last = self.recorder.periods, None
        try:
            orbit = self.likelihood.orbit(self.likelihood.low + u * self.width, guess, self.recorder)
            residuals = self.likelihood.residuals(orbit)
            if not np.isfinite(residuals).all():
                raise OrbitError("the orbit goes round in no circle")
            self.last = _Point(u.copy(), replace(orbit, cost=self.recorder.periods - before), residuals)
        except (OrbitError, ParameterError) as error:
            self.reason = error
        if self.last and (self.best is None or self.last.misfit < self.best.misfit):
            self.best = self.last
        best = f": chi-square {self.best.misfit:.2g}" if self.best else ""
        self.tally.tell(self.doing + best)
        return self.last

    def steps(self, doing: str, items: Sequence[Any]) -> Iterator[Any]:
        """Yield the items one by one, and show each as a point of the progress."""
        self.doing = doing
        self.tally.expect(self.tally.total + len(items))
        for each in items:
            yield each
            self.tally.add({"done": 1})

    def so_far(self) -> str:
        """Return the best values so far, in a line."""
        if self.best is None:
            return "the fit has found no stable orbit so far"
        values = ", ".join(f"{name} = {value:.6g}" for name, value in self.values(self.best).items())
        return f"the best values of the fit so far are {values} (chi-square {self.best.misfit:.4g}), without errors"

    def values(self, point: _Point) -> dict[str, float]:
        """Return the values of the free parameters at a point, in SI units."""
        return self.likelihood.values(self.likelihood.low + point.u * self.width)

    def starts(self) -> list[_Point]:
        """Return the best points to start descents from, the best first: each is better than all points around it.

        Raises
        ------
        OrbitError, ParameterError
            If no point of those spread over the ranges has a stable orbit.
        """
        n = self.width.size
        spread = Halton(n, scramble=False).random((n + 1) * FIRST_LOOKS + 1)[1:]  # the first one is a corner, at 0
        corners = np.array(list(product((0.0, 1.0), repeat=n))) if n <= MOST_CORNERED else np.empty((0, n))
        looks = [np.full(n, 0.5), *spread, *corners]
        found = [point for point in map(self.at, self.steps("looking around", looks)) if point]
        if isinstance(self.reason, ParameterError) and not found:
            raise self.reason
        if not found:
            looked = f"{len(looks)} points of the ranges ({self.recorder.periods:,.0f} forcing periods)"
            raise OrbitError(f"no stable orbit at any of {looked}; at the last one: {self.reason}")
        places, misfits = (np.array(column) for column in zip(*((one.u, one.misfit) for one in found), strict=True))
        # each point with its 2 n nearest ones: as many as neighbours in a grid
        near = np.array([np.argsort(np.linalg.norm(places - u, axis=1))[: 2 * n + 1] for u in places])
        least = np.flatnonzero(misfits <= misfits[near].min(axis=1))
        return _ordered(found[k] for k in least)[:DESCENTS]

    def slopes(self, point: _Point, central: bool = True) -> np.ndarray:
        """Return the derivatives of the residuals by the parameters in ranges, shape (m, n): `central` if possible."""
        columns = []
        for step in SLOPE_STEP * np.eye(point.u.size):
            places = (np.clip(point.u + offset, 0, 1) for offset in (step, -step))
            found = (self.at(u, point.orbit) for u in places if (u != point.u).any())
            ahead, back, *_ = (*islice(filter(None, found), 2 if central else 1), point, point)
            width = (ahead.u - back.u).sum()
            columns.append((ahead.residuals - back.residuals) / (width or 1.0))
        return np.column_stack(columns)

    def descended(self, start: _Point, along: np.ndarray | None = None) -> _Point:
        """Return the point to which the solver descends from `start`, or `start` if it finds no better one.

        With directions `along`, shape (d, n), the solver moves across them only, and stays on the branch of orbits of
        the start.
        """
        inside = np.clip(start.u, INSIDE, 1 - INSIDE)  # the solver begins within its bounds
        guess, enough, most = (None, ENOUGH, MOST_STEPS) if along is None else (start.orbit, FINE, FEW_STEPS)
        stiff = np.empty((0, inside.size)) if along is None else STIFF * along
        if self.at(inside, guess) is None:
            return start
        known = None if along is None else self.slopes(start)  # across a valley the way is short: they hardly change

        # inf where there is no stable orbit: the solver takes a shorter step then
        def residuals(u: np.ndarray) -> np.ndarray:
            point = self.at(u, guess)
            seen = np.full(len(self.likelihood.whitening), np.inf) if point is None else point.residuals
            return np.concatenate([seen, stiff @ (u - start.u)])

        def slopes(u: np.ndarray) -> np.ndarray:
            if known is not None:
                return np.concatenate([known, stiff])
            here = self.last if self.last is not None and np.array_equal(self.last.u, u) else self.at(u, guess)
            assert here is not None  # slopes are asked for at points whose residuals are finite
            return self.slopes(here, central=False)  # enough for the solver's steps

        ends = {"ftol": ENOUGH, "xtol": enough, "gtol": LEVEL, "max_nfev": most}
        solved = least_squares(residuals, inside, slopes, bounds=(0, 1), **ends)
        end = self.at(np.clip(solved.x, 0, 1), guess)
        return start if end is None or end.misfit > start.misfit else end

    def curved(self, best: _Point, slopes: np.ndarray) -> bool:
        """Return True if the slopes at a point are wrong by `CURVED` errors, an error away along the least known
        direction.
        """
        inverse = np.linalg.pinv(slopes)
        singular, directions = _directions(slopes)
        for step in (directions[-1] / singular[-1], -directions[-1] / singular[-1]):
            point = self.at(np.clip(best.u + step, 0, 1), best.orbit)
            if point is None:
                return True
            off = inverse @ (point.residuals - best.residuals - slopes @ (point.u - best.u))
            if (np.abs(off) > CURVED * np.linalg.norm(inverse, axis=1)).any():
                return True
        return False

    def valley(self, seeds: list[_Point], slopes: np.ndarray, n_open: int) -> tuple[list[_Point], np.ndarray, Valley]:
        """Return points that give the data about as well as the first seed, their slopes, and the valley of them.

        Points are evenly spread along the `n_open` directions that the data leave open. The walk starts at all seeds.
        `slopes`, shape (m, n), are those at the first seed.
        """
        singular, directions = _directions(slopes)
        step = min(POINTS ** (-1 / n_open), PER_ERROR / max(singular[-n_open], PER_ERROR))
        found: list[tuple[_Point, np.ndarray]] = []
        self.doing = "along the valley"
        ahead = [(seed, directions[-n_open:]) for seed in seeds]

        def near(u: np.ndarray) -> bool:
            return any(np.linalg.norm(u - point.u) < APART_ALONG * step for point, _ in found)

        while ahead:
            point, before = ahead.pop(0)
            if near(point.u) or point.misfit - seeds[0].misfit > FAR_UP:
                continue
            self.tally.expect(self.tally.done + len(ahead) + 2)
            slopes = self.slopes(point)
            found.append((point, slopes))
            self.tally.add({"done": 1})
            there = _directions(slopes)[1][-n_open:].T
            # turned as little as possible against the point before, so that the points form an even net
            along = (there @ orthogonal_procrustes(there, before.T)[0]).T
            for direction in (*along, *-along):
                room = (np.where(direction > 0, 1 - point.u, point.u) / np.maximum(np.abs(direction), INSIDE)).min()
                ahead_u = point.u + min(step, room) * direction
                start = None if near(ahead_u) else self.at(ahead_u, point.orbit)
                if start is not None:
                    ahead.append((self.descended(start, along), along))
        points = [point for point, _ in found]
        known = np.array([each for _, each in found])
        places, residuals = np.array([one.u for one in points]), np.array([one.residuals for one in points])
        return points, known, Valley.of(places, residuals, known, n_open, step)

    def cut_off(self, end: _Point, slopes: np.ndarray) -> bool:
        """Return True if the misfit falls on from the end of a descent, in a direction within the ranges."""
        fall = -2 * slopes.T @ end.residuals
        inward = ((end.u > RIM) | (fall > 0)) & ((end.u < 1 - RIM) | (fall < 0))
        return bool(np.abs(fall[inward]).max(initial=0.0) > FALLS_ON * end.misfit)

    def simplex(self, start: _Point) -> _Point:
        """Return a better point, found by a simplex: it follows a border of the stable orbits that cuts off the
        descent.
        """

        def misfit(u: np.ndarray) -> float:
            point = self.at(u)
            return np.inf if point is None else point.misfit

        n = start.u.size
        found = minimize(misfit, start.u, method="Nelder-Mead", bounds=[(0, 1)] * n, options={"maxfev": 40 * n})
        return self.at(found.x) or start


def _probability(misfit: float, slopes: np.ndarray) -> float:
    """Return the probability that chance gives a greater misfit (chi-squared).

    The degrees of freedom are the number of data less the number of directions in which the data determine the
    parameters. `slopes`, shape (data, parameters), has small singular values in the directions that stay open.
    """
    taken = np.count_nonzero(np.linalg.svd(slopes, compute_uv=False) >= FEW_ERRORS)
    return float(chi2.sf(misfit, max(1, slopes.shape[0] - taken)))


def _others(ends: list[_Point], slopes: np.ndarray) -> list[_Point]:
    """Return the ends of other descents that give the data, too, each far from all better ends."""
    return [
        end
        for k, end in enumerate(ends[1:], 1)
        if _probability(end.misfit, slopes) >= IMPROBABLE
        and all(np.abs(end.u - one.u).max() > APART_BY for one in ends[:k])
    ]


def _at_end(point: _Point) -> np.ndarray:
    """Return the indices of the parameters that are at an end of their ranges."""
    return np.flatnonzero(np.minimum(point.u, 1 - point.u) < RIM)


def _directions(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the singular values of slopes, shape (n,), filled up with zeros, and their directions, shape (n, n)."""
    _, found, directions = np.linalg.svd(slopes, full_matrices=True)
    return np.pad(found, (0, len(directions) - found.size)), directions


def _answer(search: _Search, ends: list[_Point], slopes: np.ndarray) -> Fit:
    """Return the fit in the units of its parameters, with its errors, and sentences on what the data leave open."""
    search.doing = "errors"
    likelihood, best = search.likelihood, ends[0]
    names, low, width = likelihood.names, likelihood.low, search.width
    singular, directions = _directions(slopes)
    n_open = int(np.count_nonzero(singular < FEW_ERRORS))
    impossible = _probability(best.misfit, slopes) < IMPROBABLE
    cut_off = impossible and search.cut_off(best, slopes)
    valley, undetermined, notes = None, [], []
    if impossible and (cut_off or _at_end(best).size):  # no minimum, so the slopes give no errors
        covariance = np.full((width.size, width.size), np.nan)
    elif n_open or search.curved(best, slopes):
        points, known, valley = search.valley(ends, slopes, max(1, n_open))
        if n_open:  # all points of the valley give the data as well: the middle one stands for them
            best, slopes = points[valley.middle], known[valley.middle]
            singular, directions = _directions(slopes)
            undetermined = _open(names, valley.scaled(low, width), known)
        else:
            notes.append("The slopes at the fit would tell other errors: these are those of the profiles.")
        covariance = valley.covariance(best.u)
    else:
        steps = directions / singular[:, None]
        covariance = steps.T @ steps
    others = [] if n_open else [search.values(end) for end in _others(ends, slopes)]
    values, predicted = search.values(best), likelihood.predicted(best.orbit)
    if undetermined and len(predicted) < width.size:
        undetermined.insert(0, f"Fewer values ({len(predicted)}) than free parameters ({width.size}) are measured.")
    if impossible:
        notes.insert(0, _impossible(likelihood.measured, predicted, best.misfit, values))
    if cut_off:
        notes.append("The nearest ones lie at a border of the stable orbits.")
    notes += [
        f"{names[k]} is at the {'lower' if best.u[k] < 0.5 else 'upper'} end of its range: "
        "the true value may lie beyond."
        for k in _at_end(best)
        if not np.isinf(covariance[k, k])
    ]
    notes += [f"These give the data too: {_listed(one)}." for one in others]
    if likelihood.measured.track is not None:
        notes += likelihood.measured.track.notes  # for example on other turns that fit the track
    return Fit(
        values=values,
        covariance=covariance * np.outer(width, width),
        possible=not impossible,
        chi_square=best.misfit,
        probability=_probability(best.misfit, slopes),
        singular_values=singular,
        directions=directions,
        undetermined=tuple(undetermined),
        notes=tuple(notes),
        others=tuple(others),
        valley=None if valley is None else valley.scaled(low, width),
        measured=likelihood.measured,
        predicted=predicted,
        orbit=best.orbit,
        ranges=dict(zip(values, zip(low.tolist(), likelihood.high.tolist(), strict=True), strict=True)),
        cost=search.recorder.periods,
    )


def _impossible(measured: Measured, predicted: np.ndarray, misfit: float, values: dict[str, float]) -> str:
    """Return the sentence that no parameters give the data, and how near the nearest ones come."""
    apart = (predicted - measured.values) / measured.errors
    k = int(np.argmax(np.abs(apart)))
    return (
        f"No parameters found in the ranges give the data (chi-square {misfit:.3g}): {measured.names[k]} comes no nearer to "
        f"{measured.values[k]:.6g} than {predicted[k]:.6g}, {abs(apart[k]):.3g} errors away, at {_listed(values)}."
    )


def _open(names: tuple[str, ...], valley: Valley, slopes: np.ndarray) -> list[str]:
    """Return sentences on what the data leave open: parameters without effect, and parameters only known together."""
    idle = (np.abs(slopes) < NO_ERRORS).all(axis=(0, 1))
    least, most = valley.extent
    moved = (most - least) ** 2 > np.diagonal(valley.across, axis1=1, axis2=2).min(axis=0)
    ends = {names[k]: f"{names[k]} from {least[k]:.6g} to {most[k]:.6g}" for k in np.flatnonzero(moved & ~idle)}
    words = [f"{names[k]} is not determined: it changes no measured value." for k in np.flatnonzero(idle)]
    if ends:
        known = "is not determined" if len(ends) == 1 else "are not determined apart"
        words.append(f"{', '.join(ends)} {known}: the data are given with {', '.join(ends.values())}.")
    return words


def _listed(values: dict[str, float]) -> str:
    """Return names and values as a text."""
    return ", ".join(f"{name} = {value:.4g}" for name, value in values.items())


def unit_of(name: str) -> str:
    """Return the unit of a parameter or of a measured quantity, as it is shown."""
    return units_shown(MEASURABLE[name].units if name in MEASURABLE else PARAMETERS[name].units)
