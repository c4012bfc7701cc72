"""Fit: the parameters whose orbit is nearest to what was measured, what the data leave open, and whether any give them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
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

FIRST_LOOKS = 8  # points of the ranges that are looked at for each free parameter, and once more
MOST_CORNERED = 3  # free parameters up to which their corners are looked at, too
DESCENTS = 4  # of those that are better than all around, from which the solver starts
MOST_STEPS = 30  # of the solver in a descent
SLOPE_STEP = 1e-4  # of the differences, in ranges: their error is its square, and that of the orbit, 1e-10, over it
FALLS_ON = 0.05  # share of the misfit that a step of a range would gain above which a descent has not come to a minimum
RIM = 1e-3  # distance from an end of its range [ranges] at which a value is called to be there
APART_BY = 0.05  # distance of two minima that are two [ranges]
INSIDE = 1e-9  # distance from the ends of the ranges at which a descent begins at least
ENOUGH = 1e-6  # step of the solver, in ranges, and gain, in the misfit, at which it ends
LEVEL = 1e-3  # slope of half the misfit at which it ends: over FEW_ERRORS, it is what is left of an error
IMPROBABLE = 0.0027  # of a greater misfit by chance: three standard deviations of one value
FINE = 1e-9  # step of the solver, in ranges, at which it ends across a valley, and how many it takes at most
FEW_STEPS = 10
STIFF = 1e3  # errors to a range, by which the solver is held along a valley: the misfit hardly pulls there
POINTS = 20  # of a valley as large as the ranges, about
PER_ERROR = 0.5  # of the error along one that is shorter: the step
APART_ALONG = 0.7  # steps from one point to another at least
FAR_UP = 9.0  # of the misfit above the best one: the end of a valley
CURVED = 0.3  # of an error, by which the slopes at the fit may be wrong an error away
NO_ERRORS = 1e-2  # the same below which a parameter changes no datum


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Fit:
    """The parameters whose orbit is nearest to what was measured.

    Attributes
    ----------
    values : dict
        Of the free parameters.
    covariance : ndarray, shape (n, n)
        Of the free parameters, in their order, from the slopes at the fit and the errors of the data, or from the valley where
        there is one. A parameter about which the data say nothing has the variance inf, and nan beside it; all is nan where
        no parameters give the data and the nearest ones lie at the end of a range or at a border of the stable orbits.
    possible : bool
        Whether the data may come from parameters in the ranges: a misfit as great as this one has a probability of more
        than 0.0027.
    chi_square, probability : float
        The misfit in errors, squared and summed, and the probability of a greater one.
    singular_values : ndarray, shape (n,)
        Of the slopes, the largest first: by how many of their errors the data change for a step of the size of a range.
    directions : ndarray, shape (n, n)
        The steps that belong to them, one a row, in ranges.
    undetermined : tuple of str
        In words, what the data leave open.
    notes : tuple of str
        In words, what else is to be known: no parameters give the data, a value is at the end of its range, there is
        another minimum.
    others : tuple of dict
        Other values that give the data too, where some are found.
    valley : Valley or None
        Points that cover all values that give the data, and the profile of each parameter, where the slopes at one point do not
        tell the errors.
    measured : Measured
    predicted : ndarray, shape (m,)
        The measured quantities of the fitted orbit.
    orbit : PeriodicOrbit
        The fitted orbit.
    ranges : dict
        Of the free parameters.
    cost : float
        Forcing periods that it took.

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
        """Standard deviations of the fitted values: within as much of each 68.27 % of what is possible lies."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def within(self, share: float) -> dict[str, float]:
        """Distances from the fitted values within which a share of what is possible lies: 0.6827 gives `errors`.

        Twice an error holds 95.45 % where all is determined. In a valley it may hold much less.

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
        told = "" if self.possible else "; no parameters in the ranges give the data"
        told += "; not all is determined" if self.undetermined else ""
        return f"<Fit: {words}, chi-square {self.chi_square:.2f} of {n} value{'s' if n > 1 else ''}{told}>"

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """What was fitted and what was measured, and in words what the data leave open, as a text of some lines.

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
        """The regions of one and two standard deviations of each pair of free parameters, with the profile of each.

        The profiles are there where there is a valley. `look` is as in `plots.Look`.

        Examples
        --------
        >>> from dimersweep import fits
        >>> data = {"path_radius": (4.06, 0.02), "zeta": (1.6, 0.002)}
        >>> fits.fit(data, {"e": (0.55, 0.75), "A_r": (5.5, 6.5)}).plot().savefig("fit.png")
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
    """Return the parameters whose orbit is nearest to what was measured.

    The model is the stable orbit of `orbits.find`. Points spread over the ranges are looked at, and
    `scipy.optimize.least_squares` descends from the best of them.

    Parameters
    ----------
    measured : mapping of str to (float, float), Measured or Track
        Values and standard deviations of some of `path_radius` [m], `period` [s], `path_speed` [m s-1], `zeta` [rad], `spin`
        [rad s-1], `impact_phase` [cycles], and `radius` [m] and `speed` [m s-1], which are those of equation (11), right after
        the double impact, and not of the path; or what `circle` or `cycloid` make of a track.
    free : mapping of str to (float, float)
        Least and greatest value of each free parameter; `spin` may be one of them.
    spin : float, optional
        Axial spin [rad s-1] where it is not free; by default what a lateral start with `xdot0` rolls up to.
    rtol : float
        Accuracy of the map [1].
    progress : bool
        Whether to show how far it is: a bar on a terminal and in a notebook, else a line every ten seconds.
    **parameters : float
        Of the model, as far as they are not free; by default the paper's base case.

    Returns
    -------
    Fit

    Raises
    ------
    ParameterError
        For an unknown name, an error that is not above 0, a range that is none, or a value that is not allowed.
    OrbitError
        If there is no stable orbit at any of the points that are looked at.
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
    shown = check_switch("progress", progress) and current_thread() is main_thread()  # two bars at a time are an error
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
    """Return the fit, after a look at the ranges and descents from the best points."""
    starts = search.starts()
    ends = _ordered(map(search.descended, search.steps("descending", starts)))
    slopes = search.slopes(ends[0])
    if _probability(ends[0].misfit, slopes) < IMPROBABLE and search.cut_off(ends[0], slopes):
        ends = _ordered([*map(search.simplex, search.steps("along a border", ends[:1])), *ends])
        slopes = search.slopes(ends[0])
    return _answer(search, ends, slopes)


class _Point(NamedTuple):
    """A point of the ranges, each from 0 to 1, its stable orbit, and how far that is from the data, in errors."""

    u: np.ndarray
    orbit: PeriodicOrbit
    residuals: np.ndarray

    @property
    def misfit(self) -> float:
        """The sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


def _ordered(points: Iterable[_Point]) -> list[_Point]:
    return sorted(points, key=lambda point: point.misfit)


class _Search:
    """The likelihood in units of the ranges, with the point that was found last, or why there was none, and the best one."""

    def __init__(self, likelihood: Likelihood, tally: Tally) -> None:
        self.likelihood = likelihood
        self.tally, self.doing = tally, ""
        self.width = likelihood.high - likelihood.low
        self.recorder = Recorder()
        self.last: _Point | None = None
        self.best: _Point | None = None
        self.reason: Exception | None = None

    def at(self, u: np.ndarray, guess: PeriodicOrbit | None = None) -> _Point | None:
        """The point with its orbit, found from one nearby or from nothing; None if there is none."""
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
        """Go through items, each of which counts as a point of what is done."""
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
        """Of the free parameters, in their units."""
        return self.likelihood.values(self.likelihood.low + point.u * self.width)

    def starts(self) -> list[_Point]:
        """Of some points spread over the ranges, those with a stable orbit that are better than all around, the best first.

        Raises
        ------
        OrbitError, ParameterError
            If none of them has a stable orbit.
        """
        n = self.width.size
        spread = Halton(n, scramble=False).random((n + 1) * FIRST_LOOKS + 1)[1:]  # the first one is a corner
        corners = np.array(list(product((0.0, 1.0), repeat=n))) if n <= MOST_CORNERED else np.empty((0, n))
        looks = [np.full(n, 0.5), *spread, *corners]
        found = [point for point in map(self.at, self.steps("looking around", looks)) if point]
        if isinstance(self.reason, ParameterError) and not found:
            raise self.reason
        if not found:
            looked = f"{len(looks)} points of the ranges ({self.recorder.periods:,.0f} forcing periods)"
            raise OrbitError(f"no stable orbit at any of {looked}; at the last one: {self.reason}")
        places, misfits = (np.array(column) for column in zip(*((one.u, one.misfit) for one in found), strict=True))
        near = np.array([np.argsort(np.linalg.norm(places - u, axis=1))[: 2 * n + 1] for u in places])
        least = np.flatnonzero(misfits <= misfits[near].min(axis=1))
        return _ordered(found[k] for k in least)[:DESCENTS]

    def slopes(self, point: _Point) -> np.ndarray:
        """Derivatives of the residuals by the free parameters in their ranges, shape (m, n): central, else one-sided."""
        columns = []
        for step in SLOPE_STEP * np.eye(point.u.size):
            places = (np.clip(point.u + way, 0, 1) for way in (step, -step))
            found = (point if (u == point.u).all() else self.at(u, point.orbit) for u in places)
            ahead, back = (point if each is None else each for each in found)
            width = (ahead.u - back.u).sum()
            columns.append((ahead.residuals - back.residuals) / (width or 1.0))
        return np.column_stack(columns)

    def descended(self, start: _Point, along: np.ndarray | None = None) -> _Point:
        """Where the solver comes to from a point: with steps, shape (d, n), across them, and on the branch of the point."""
        inside = np.clip(start.u, INSIDE, 1 - INSIDE)  # the solver begins within its bounds
        guess, enough, most = (None, ENOUGH, MOST_STEPS) if along is None else (start.orbit, FINE, FEW_STEPS)
        held = np.empty((0, inside.size)) if along is None else STIFF * along
        if self.at(inside, guess) is None:
            return start
        known = None if along is None else self.slopes(start)  # so near that these do

        def residuals(u: np.ndarray) -> np.ndarray:  # inf where no stable orbit is, at which it takes a shorter step
            point = self.at(u, guess)
            seen = np.full(len(self.likelihood.whitening), np.inf) if point is None else point.residuals
            return np.concatenate([seen, held @ (u - start.u)])

        def slopes(u: np.ndarray) -> np.ndarray:
            if known is not None:
                return np.concatenate([known, held])
            here = self.last if self.last is not None and np.array_equal(self.last.u, u) else self.at(u, guess)
            assert here is not None  # as where the solver has been
            return self.slopes(here)

        ends = {"ftol": ENOUGH, "xtol": enough, "gtol": LEVEL, "max_nfev": most}
        solved = least_squares(residuals, inside, slopes, bounds=(0, 1), **ends)
        end = self.at(np.clip(solved.x, 0, 1), guess)
        return start if end is None or end.misfit > start.misfit else end

    def curved(self, best: _Point, slopes: np.ndarray) -> bool:
        """Whether the slopes at a point are wrong by a part of an error, an error away in the direction that is known least."""
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
        """Points that give the data about as well as the first seed, evenly spread along what is open, and the slopes there.

        It looks from all seeds on. `slopes`, shape (m, n), are those at the first one.
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
            along = (there @ orthogonal_procrustes(there, before.T)[0]).T  # turned as little as can be
            for way in (*along, *-along):
                room = (np.where(way > 0, 1 - point.u, point.u) / np.maximum(np.abs(way), INSIDE)).min()
                ahead_u = point.u + min(step, room) * way
                start = None if near(ahead_u) else self.at(ahead_u, point.orbit)
                if start is not None:
                    ahead.append((self.descended(start, along), along))
        points = [point for point, _ in found]
        known = np.array([each for _, each in found])
        places, residuals = np.array([one.u for one in points]), np.array([one.residuals for one in points])
        return points, known, Valley.of(places, residuals, known, n_open, step)

    def cut_off(self, end: _Point, slopes: np.ndarray) -> bool:
        """Whether the misfit falls on from where a descent has ended, within the ranges."""
        fall = -2 * slopes.T @ end.residuals
        inward = ((end.u > RIM) | (fall > 0)) & ((end.u < 1 - RIM) | (fall < 0))
        return bool(np.abs(fall[inward]).max(initial=0.0) > FALLS_ON * end.misfit)

    def simplex(self, start: _Point) -> _Point:
        """A better point that a simplex finds: where a border of the stable orbits cuts off the way down, it goes along it."""

        def misfit(u: np.ndarray) -> float:
            point = self.at(u)
            return np.inf if point is None else point.misfit

        n = start.u.size
        found = minimize(misfit, start.u, method="Nelder-Mead", bounds=[(0, 1)] * n, options={"maxfev": 40 * n})
        return self.at(found.x) or start


def _probability(misfit: float, slopes: np.ndarray) -> float:
    """The probability of a greater misfit, if the directions that are not open take one value each."""
    taken = np.count_nonzero(np.linalg.svd(slopes, compute_uv=False) >= FEW_ERRORS)
    return float(chi2.sf(misfit, max(1, slopes.shape[0] - taken)))


def _others(ends: list[_Point], slopes: np.ndarray) -> list[_Point]:
    """Where other descents have ended that give the data too, each far from all better ones."""
    return [
        end
        for k, end in enumerate(ends[1:], 1)
        if _probability(end.misfit, slopes) >= IMPROBABLE
        and all(np.abs(end.u - one.u).max() > APART_BY for one in ends[:k])
    ]


def _at_end(point: _Point) -> np.ndarray:
    """Numbers of the parameters that are at an end of their ranges."""
    return np.flatnonzero(np.minimum(point.u, 1 - point.u) < RIM)


def _directions(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of slopes, with a 0 for each missing one, shape (n,), and their directions, shape (n, n)."""
    _, found, directions = np.linalg.svd(slopes, full_matrices=True)
    return np.pad(found, (0, len(directions) - found.size)), directions


def _answer(search: _Search, ends: list[_Point], slopes: np.ndarray) -> Fit:
    """The fit in the units of its parameters and in words."""
    search.doing = "errors"
    likelihood, best = search.likelihood, ends[0]
    names, low, width = likelihood.names, likelihood.low, search.width
    singular, directions = _directions(slopes)
    n_open = int(np.count_nonzero(singular < FEW_ERRORS))
    impossible = _probability(best.misfit, slopes) < IMPROBABLE
    cut_off = impossible and search.cut_off(best, slopes)
    valley, undetermined, notes = None, [], []
    if impossible and (cut_off or _at_end(best).size):  # the slopes tell no errors
        covariance = np.full((width.size, width.size), np.nan)
    elif n_open or search.curved(best, slopes):
        points, known, valley = search.valley(ends, slopes, max(1, n_open))
        if n_open:  # any of its points is as good
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
        notes += likelihood.measured.track.notes  # such as other turns that fit it
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
    """In words, that no parameters give the data, and how near the nearest ones come."""
    apart = (predicted - measured.values) / measured.errors
    k = int(np.argmax(np.abs(apart)))
    return (
        f"No parameters found in the ranges give the data (chi-square {misfit:.3g}): {measured.names[k]} comes no nearer to "
        f"{measured.values[k]:.6g} than {predicted[k]:.6g}, {abs(apart[k]):.3g} errors away, at {_listed(values)}."
    )


def _open(names: tuple[str, ...], valley: Valley, slopes: np.ndarray) -> list[str]:
    """In words, what the data leave open: parameters without effect at any point, and those that are known together."""
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
    return ", ".join(f"{name} = {value:.4g}" for name, value in values.items())


def unit_of(name: str) -> str:
    return units_shown(MEASURABLE[name].units if name in MEASURABLE else PARAMETERS[name].units)
