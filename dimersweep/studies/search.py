"""Search an axis at every point of a grid, for example whether any initial dip angle leads to a drift."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Self, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import FLAGS, build, variable, with_fields
from dimersweep.cubes.grid import Grid, legal_points, make_grid
from dimersweep.cubes.results import not_ok, not_run, ranges_of
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.kernel.model.layout import CODE_MODE, CODE_STATUS, M_NOT_RUN, MODES, OK
from dimersweep.parameters import completed, fill_rows
from dimersweep.runs.solving import exactly, run_all_patiently, run_settings
from dimersweep.studies.deciding import A_NOT_RUN, A_UNSURE, A_YES, ANSWER, ASKS, OPEN, Question
from dimersweep.studies.making import in_memory, make_cube
from dimersweep.studies.observers import FinishedRuns, Longer, Observer, paths_of
from dimersweep.studies.observing import own_of
from dimersweep.studies.study import Batch, Sample, Study
from dimersweep.symbols import PARAMETERS
from dimersweep.work.options import OptionKeywords
from dimersweep.work.parts import SweepPart

REGIONS = FLAGS["region"]
MIXED = REGIONS.index("mixed")  # region of a point whose runs have several modes, none of them the mode in question


@dataclass(frozen=True, kw_only=True)
class Search(Study):
    """A question about one axis, asked at every point of a grid of the other axes; see `Study`.

    Observers look at the deciding runs.

    Parameters
    ----------
    question : Question
        The question, the same at all points.
    hints : mapping of int to sequence of int
        Indices on the searched axis that are tried first, for each point by its number. They are set anew for each
        batch and are no part of the configuration.
    """

    grid: Grid
    question: Question
    hints: Mapping[int, Sequence[int]] = field(default_factory=dict)

    own_fields = ANSWER

    @property
    def summary(self) -> str:
        """Title of the cube, unless a user gives another one."""
        return f"search over {self.question.axis} for a 3D dimer on a vibrating plate"

    def configuration(self) -> dict[str, Any]:
        """Return the settings of `Study.configuration`, with the length of the orbits among those of the search."""
        settings = super().configuration()
        settings["search"]["orbit_periods"] = settings.pop("orbit_periods", 0)
        return settings

    def asked(self) -> dict[str, Any]:
        """Return the settings of the question, and length and accuracy of its runs."""
        question = self.question
        search = {
            "axis": question.axis,
            "values": question.values.tolist(),
            "ask": question.ask,
            "mode": MODES[question.mode],
        }
        return {"search": search, "periods": self.how.periods, "rtol": self.how.rtol}

    def narrowed(self, points: np.ndarray) -> tuple[Self, np.ndarray]:
        """Return the search on the smallest window that holds `points`, with their hints, and their numbers there."""
        small, there = super().narrowed(points)
        hints = {new: self.hints.get(old, ()) for new, old in zip(there.tolist(), points.tolist(), strict=True)}
        return replace(small, hints=hints), there

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """Search at `points` in order, fill in `results`, and return the number of points that are done."""
        for k, point in enumerate(points.tolist()):
            runs = self._decided(point, results[k : k + 1], space)
            if runs is None or not self.observed(runs, space):
                return k
        return points.size

    def _decided(self, point: int, result: np.ndarray, space: Workspace) -> FinishedRuns | None:
        """Search at one point, fill in its result, and return the deciding run.

        Returns
        -------
        FinishedRuns or None
            The deciding run; no rows (n = 0) if no run alone decides. None if the search was stopped.
        """
        order = self.question.order(self.hints.get(point, ()))
        here = self.grid.given(point)
        rows = fill_rows(here | {self.question.axis: self.question.values[order]}, order.size)
        out, codes = run_all_patiently(rows, self.how, space, until=self.question.until())
        if is_stopped(space):
            return None
        modes = codes[~not_run(codes), CODE_MODE]
        counts = np.bincount(modes, minlength=len(MODES))
        answer, which = self.question.verdict(modes)
        result["answer"], result["counts"] = answer, counts
        if which < 0:  # no run stands for the point: it gets the most frequent mode, and no orbit
            result["codes"][0, [CODE_MODE, CODE_STATUS]] = counts.argmax(), OK
            return FinishedRuns(rows[:0], self.how, result[:0])
        result["out"], result["codes"], result["decider"] = out[which], codes[which], order[which] + 1
        given = here | {self.question.axis: float(self.question.values[order[which]])}
        return FinishedRuns(rows[which : which + 1], self.how, result, given=given)

    def batches(self, results: Callable[[], np.ndarray]) -> Iterator[Batch]:
        """Yield the points from coarse to fine, a batch for each wave, with hints from the waves before."""
        legal = legal_points(self.grid)
        reached = np.zeros(legal.size, dtype=bool)
        for wave in waves(self.grid.shape):
            near = {point: neighbours for point, neighbours in wave.items() if legal[point]}
            yield self.led(near, results(), reached, int(legal.sum()))

    def cut(self, part: SweepPart) -> Self:
        """Refuse to be cut into parts: points of one part would depend on neighbours in another one."""
        raise ParameterError(f"part = {part}: is for sweeps; the points of a search and of a map lead one another")

    def led(self, near: Mapping[int, Collection[int]], results: np.ndarray, reached: np.ndarray, wanted: int) -> Batch:
        """Return a batch of points, each of which tries first the values that decided at neighbours.

        `near` has the points, in order, with their neighbours. Hints come from `reached` points alone, those of earlier
        batches. Other results may be there from a search that was stopped. Since they are not used, the numbers are the
        same whatever was known.
        """
        # deciders are counted from 1, as 0 stands for none
        deciders = np.where(reached, results["decider"], 0)
        hints = {
            point: list(dict.fromkeys(int(k) - 1 for k in deciders[list(neighbours)] if k)) or self.hints.get(point, ())
            for point, neighbours in near.items()
        }
        points = np.fromiter(near, dtype=np.int64)
        reached[points] = True
        return Batch(replace(self, hints=hints), ranges_of(points), wanted)

    def stands(self, points: np.ndarray, results: np.ndarray) -> np.ndarray:
        """Return True for each result that does not depend on the hints, or was found with hints that decide alike."""
        same = (self.question.stands(result, self.hints[k]) for k, result in zip(points.tolist(), results, strict=True))
        return np.fromiter(same, dtype=bool)

    def sample(self, rng: np.random.Generator) -> Sample:
        """Return single random points as a sample; each has a hint from a neighbour, as most points of a search have."""
        self.check_fits()
        legal = legal_points(self.grid)
        numbers = rng.permutation(np.flatnonzero(legal)).tolist()
        return Sample(len(numbers), "random points", ((self._led(k, legal), np.ones(1)) for k in numbers))

    def _led(self, point: int, legal: np.ndarray) -> Self:
        """Return the search at a point alone, with the deciding value of a point beside it as its hint."""
        neighbour, hints = point - 1 if point else min(1, legal.size - 1), {}
        if self.question.led and legal[neighbour]:
            decider = int(in_memory(self.narrowed(np.array([neighbour]))[0])[0]["decider"][0])
            hints = {point: [decider - 1]} if decider else {}
        return replace(self, hints=hints).narrowed(np.array([point]))[0]

    def again(self, results: np.ndarray) -> np.ndarray:
        """Return True for results that failed, and for those whose hints a failed neighbour may have changed."""
        return not_ok(results["codes"]) | ((results["decider"] > 0) & self.question.led)

    def regions(self, results: np.ndarray) -> np.ndarray:
        """Return the region of each point, codes, shape (n,).

        It is the mode in question where the answer is yes, else the one mode of all runs, or `MIXED`.
        """
        question, counts = self.question, results["counts"]
        region = np.where(counts.max(axis=1) == question.values.size, counts.argmax(axis=1), MIXED)
        if question.ask != "fraction":
            # the first value may be found while the answer is unsure, since an earlier run was left open
            found = (results["decider"] > 0) & (question.ask != "all")
            region[(results["answer"] == A_YES) | found] = question.mode
        unsearched = counts.sum(axis=1) == 0
        region[unsearched] = results["codes"][unsearched, CODE_MODE]
        return region

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """Return the results as a cube, with the answer and the deciding value of each point."""
        shape, dims, counts = self.grid.shape, tuple(self.grid.axes), results["counts"]
        cube = build(self.grid, results["out"], results["codes"])
        # a search that itself failed at a point leaves the answer open
        failed = ~not_run(results["codes"]) & (results["answer"] == A_NOT_RUN)
        cube["answer"] = variable("answer", dims, np.where(failed, A_UNSURE, results["answer"]).reshape(shape))
        cube["region"] = variable("region", dims, self.regions(results).reshape(shape))
        known = {name: each.variable for name, each in cube.coords.items() if name in PARAMETERS}
        deciders = np.concatenate(([np.nan], self.question.values))[results["decider"]]
        known[self.question.axis] = xr.Variable(dims, deciders.reshape(shape))
        for name, values in completed(known).items():  # the deciding value, and parameters that follow from it
            if name not in cube.coords:
                cube[name] = variable(name, values.dims, values.values, PARAMETERS[name])
        cube["n_runs"] = variable("n_runs", dims, counts.sum(axis=1).reshape(shape))
        cube["runs"] = variable("runs", (*dims, "outcome"), counts.reshape(*shape, len(MODES)))
        cube = cube.assign_coords(outcome=variable("outcome", ("outcome",), np.arange(len(MODES))))
        return with_fields(cube, results, self.fields)

    def results_of(self, cube: xr.Dataset) -> np.ndarray:
        """Return the results of a cube; points that a refined map did not compute count as not run."""
        results = super().results_of(cube)
        results["counts"] = cube["runs"].values.reshape(results["counts"].shape)
        results["answer"] = np.where(cube["n_runs"].values > 0, cube["answer"].values, A_NOT_RUN).ravel()
        values = cube[self.question.axis].values.ravel()
        results["decider"] = np.where(np.isnan(values), 0, np.searchsorted(self.question.values, values) + 1)
        if "computed" in cube:
            results["codes"][cube["computed"].values.ravel() == 0, CODE_MODE] = M_NOT_RUN
        return results


def waves(shape: tuple[int, ...]) -> Iterator[dict[int, list[int]]]:
    """Yield the points of a grid from coarse to fine, each with its neighbours in earlier waves.

    Points are numbered in C order. Every point comes once, in increasing order within a wave. Neighbours lie on both
    sides along every axis, at the stride of the wave.
    """
    places = np.indices(shape).reshape(len(shape), -1).T
    # the first wave has three or four points along the longest axis: one lone point would keep a single thread busy
    stride = 1 << max(0, (max(shape) - 1).bit_length() - 2)
    taken = np.zeros(len(places), dtype=bool)
    while stride:
        new = np.flatnonzero(~taken & (places % stride == 0).all(axis=1))
        taken[new] = True
        neighbours = (_neighbours(place, stride, shape) for place in places[new].tolist())
        yield dict(zip(new.tolist(), neighbours, strict=True))
        stride //= 2


def _neighbours(place: list[int], stride: int, shape: tuple[int, ...]) -> list[int]:
    """Return the numbers of the points of earlier waves around `place`.

    Along axes on which `place` is no multiple of 2 `stride`, neighbours are `stride` away on both sides; along others
    they share its place.
    """
    sides = [
        [k] if k % (2 * stride) == 0 else [k + step for step in (-stride, stride) if 0 <= k + step < n]
        for k, n in zip(place, shape, strict=True)
    ]
    near = [int(np.ravel_multi_index(at, shape)) for at in product(*sides)]
    own = int(np.ravel_multi_index(place, shape))
    return [point for point in near if point != own]


def study_of(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None,
    *,
    over: str,
    ask: str,
    mode: str,
    orbit_periods: int = 0,
    paths: Mapping[str, int] | None = None,
    observe: Any = None,
    observe_with: Mapping[str, Any] | None = None,
    **how: Any,
) -> Search:
    """Check a search and return it as a study, see `search`; `how` has the arguments of `run_settings`."""
    if over not in grid:
        raise ParameterError(f"over = {over!r}: must be one of the axes ({', '.join(grid)})")
    if ask not in ASKS:
        raise ParameterError(f"ask = {ask!r}: must be {', '.join(ASKS)}")
    if mode not in MODES or MODES.index(mode) in OPEN:
        words = [name for code, name in enumerate(MODES) if code not in OPEN]
        raise ParameterError(f"mode = {mode!r}: must be {', '.join(words)}")
    if len(grid) < 2:
        raise ParameterError(f"grid: has the axis {over} only; a search needs one more")
    whole = make_grid(grid, fixed, gaps=set(grid) - {over})
    others = Grid({name: values for name, values in whole.axes.items() if name != over}, whole.fixed)
    observers: list[Observer] = [] if orbit_periods == 0 else [Longer(check_count("orbit_periods", orbit_periods))]
    observers += [] if paths is None else [paths_of(others.size, **paths)]
    question, settings = Question(over, whole.axes[over], ask, MODES.index(mode)), run_settings(**how)
    seen: dict[str, Any] = {"others": observers, "axes": (*whole.axes, "outcome"), "arguments": observe_with}
    own = own_of(observe, others.size, exactly(orbit_periods, settings.rtol) if orbit_periods else settings, **seen)
    return Search(grid=others, how=settings, observers=(*observers, *own), question=question)


def search(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    over: str,
    ask: str = "any",
    mode: str = "drift",
    periods: int,
    max_periods: int | None = None,
    rtol: float = 1e-8,
    orbit_periods: int = 0,
    paths: Mapping[str, int] | None = None,
    observe: Any = None,
    **options: Unpack[OptionKeywords],
) -> xr.Dataset:
    """Ask a question about one axis at every point of the other axes, and stop at each point when the answer is
    certain.

    Points are taken from coarse to fine. Each point tries the value that decided at its coarser neighbours first, then
    the other values in an order that spreads over the axis. The results depend neither on the workers nor on their
    timing.

    With an `out`, finished points are kept in the file ``<out>.tiles`` as by `sweep`, and the same call resumes there.

    Parameters
    ----------
    grid : mapping of str to array_like or mapping
        The axes, as in `sweep`, the searched one among them. Points that break a rule between two of them (mu_s below
        mu) are left out.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    over : str
        The axis to search.
    ask : str
        any: does one of its values lead to `mode`? all: do all values? first: which is the least value that does?
        fraction: how many values lead to each mode?
    mode : str
        Mode in question, such as drift or rest.
    periods : int
        Longest run in forcing periods; a run stops when its motion has settled and its numbers stand.
    max_periods : int, optional
        As in `sweep`.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    orbit_periods : int
        If not 0, the deciding run is repeated for that many forcing periods, and its orbit is recorded at their end.
        Speed and angle of an orbit settle more slowly than the normal motion, on which the mode depends.
    paths : mapping of str to int, optional
        ``{"periods": ..., "per_period": ...}``: keep the path of the centre of mass of each deciding run that drifts,
        for `periods` forcing periods, with `per_period` positions in each (8 by default).
    observe : callable or str, optional
        Observer of the deciding runs, as in `sweep`; with `orbit_periods` of their longer repetitions.
    out, workers, progress, force, attrs, client, fail_fast, keep_tiles
        As in `sweep`; `out` is a NetCDF file.
    extend : path-like, optional
        A cube of `search` or `refine` whose points are taken over where this grid has them, value by value. Question,
        values of `over`, settings and kernel must be the same. With any and all, a point whose neighbours give another
        first trial is searched again, mostly in one run, so that the cube is the same as without `extend`.
    retry : bool
        If True, points of `out` (or `extend`) that failed are searched again, and points whose first trial they may
        have set.

    Returns
    -------
    xarray.Dataset
        Over the axes other than `over`: `answer` (no, yes or unsure), the value of `over` that decided, the number of
        runs, their modes (`runs`), `region`, and mode, status and orbit of the deciding run. With `paths`: `x` and `y`
        over a new dimension `cycle`, the time in forcing periods, and `axial_velocity`, the mean velocity along the
        axis in the last period; NaN where no run drifts.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError, KernelError, PointError, UnfinishedError, Stopped
        As by `sweep`.

    Examples
    --------
    Does any of nine dip angles drift, at two intensities?

    >>> from dimersweep import names, search
    >>> angles = {"start": 10, "stop": 50, "step": 5, "unit": "deg"}
    >>> grid = {"Gamma": [0.5, 0.9], "beta0": angles}
    >>> found = search(grid, over="beta0", periods=100, progress=False)
    >>> names(found["answer"]).values.tolist()
    ['no', 'yes']
    """
    asked: dict[str, Any] = {"over": over, "ask": ask, "mode": mode, "orbit_periods": orbit_periods, "paths": paths}
    study = study_of(grid, fixed, **asked, observe=observe, periods=periods, max_periods=max_periods, rtol=rtol)
    return make_cube(study, **options)
