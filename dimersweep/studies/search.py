"""Questions about an axis at every point of a grid, such as whether any initial dip angle drifts: points, waves and cube."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import (
    FLAGS,
    build,
    coordinate,
    flatten,
    float_variable,
    label_variable,
)
from dimersweep.cubes.grid import Grid, legal_points, make_grid
from dimersweep.cubes.results import (
    Finished,
    Tile,
    blank_results,
    not_ok,
    runs,
)
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.kernel.model.layout import CODE_MODE, M_NOT_RUN, MODES
from dimersweep.parameters import completed
from dimersweep.runs.settings import run_settings
from dimersweep.studies.deciding import (
    A_NOT_RUN,
    A_UNSURE,
    A_YES,
    ASKS,
    OPEN,
    Question,
    SearchSpec,
    Wave,
)
from dimersweep.studies.making import complete_cube, unfinished_cube
from dimersweep.studies.paths import PathLength, path_length
from dimersweep.studies.reuse import known_points
from dimersweep.symbols import PARAMETERS, QUANTITIES, STATE_QUANTITIES, Quantity
from dimersweep.work.computing import Crew
from dimersweep.work.options import Given, Options, make_options

REGIONS = FLAGS["region"]
MIXED = REGIONS.index("mixed")  # several modes, none of them the one asked for


class Findings:
    """What is known of each point of a grid while it is searched.

    Parameters
    ----------
    question : Question
        What is asked at each of them.
    results : ndarray, shape (n,)
        Results of `SearchSpec.kind`, not run where nothing is known.
    offered : ndarray, shape (n,)
        The same from other cubes, whose points may have been tried in another order.
    """

    def __init__(self, question: Question, results: np.ndarray, offered: np.ndarray | None = None) -> None:
        self.question, self.results = question, results
        self.offered = blank_results(0, results.dtype) if offered is None else offered
        # points whose turn has come: others may be known from a search that was stopped, but nothing may depend on that
        self.reached = np.zeros(results.size, dtype=bool)

    def take(self, finished: Finished) -> None:
        """Enter what was found."""
        self.results[slice(*finished.tile)] = finished.results

    @property
    def modes(self) -> np.ndarray:
        """Mode of each point, shape (n,), codes."""
        modes: np.ndarray = self.results["codes"][:, CODE_MODE]
        return modes

    @property
    def known(self) -> np.ndarray:
        """Where a point was searched, shape (n,), bool."""
        return self.modes != M_NOT_RUN

    def answers(self) -> np.ndarray:
        """Answer at each point, shape (n,): open where the search itself failed."""
        return np.where(self.known & (self.results["answer"] == A_NOT_RUN), A_UNSURE, self.results["answer"])

    def deciders(self) -> np.ndarray:
        """Value of the searched axis that decided at each point, shape (n,); NaN where none did."""
        return np.concatenate(([np.nan], self.question.values))[self.results["decider"]]

    def regions(self) -> np.ndarray:
        """Region of each point: the mode asked for where the answer is yes, else the one mode of all runs, or mixed."""
        question, counts = self.question, self.results["counts"]
        region = np.where(counts.max(axis=1) == question.values.size, counts.argmax(axis=1), MIXED)
        if question.ask != "fraction":
            # the first may be found and yet not be sure
            found = (self.results["decider"] > 0) & (question.ask != "all")
            region[(self.results["answer"] == A_YES) | found] = question.mode
        unsearched = counts.sum(axis=1) == 0
        region[unsearched] = self.modes[unsearched]
        return region

    def search(self, spec: SearchSpec, points: np.ndarray, neighbours: Sequence[list[int]], crew: Crew) -> None:
        """Search at those of `points` where nothing is known, trying first what decided at the `neighbours` of each.

        Each point has its own order of trials, from points of earlier calls alone: whoever searches, and whatever was
        known before, no number changes.
        """
        lacking, deciders = ~self.known, np.where(self.reached, self.results["decider"], 0)
        hints = {
            int(point): list(dict.fromkeys(int(k) - 1 for k in deciders[near] if k))
            for point, near in zip(points, neighbours, strict=True)
            if lacking[point]
        }
        if self.offered.size:
            known = {point for point, tried in hints.items() if self.question.stands(self.offered[point], tried)}
            pieces = [Finished(tile, self.offered[slice(*tile)]) for tile in _ranges(known, lacking.size)]
            crew.take_over(pieces)
            for piece in pieces:
                self.take(piece)
            hints = {point: tried for point, tried in hints.items() if point not in known}
        crew.run(Wave(spec, hints), _ranges(hints, lacking.size), self.take)
        self.reached[points] = True


def _ranges(points: Iterable[int], size: int) -> list[Tile]:
    """The ranges that `points`, of `size` in all, make up."""
    chosen = np.zeros(size, dtype=bool)
    chosen[list(points)] = True
    return runs(chosen)


def waves(shape: tuple[int, ...]) -> Iterator[tuple[np.ndarray, list[list[int]]]]:
    """Points of a grid from coarse to fine, each wave with the neighbours of its points in the waves before.

    Yields
    ------
    points : ndarray, shape (n,), int
        Numbers of the points in C order; every point of the grid comes once.
    neighbours : list of list of int
        Of each of them: points of earlier waves, on both sides along every axis.
    """
    places = np.indices(shape).reshape(len(shape), -1).T
    stride = 1 << max(0, (max(shape) - 1).bit_length() - 2)  # one lone point would keep a single thread busy
    taken = np.zeros(len(places), dtype=bool)
    while stride:
        new = np.flatnonzero(~taken & (places % stride == 0).all(axis=1))
        taken[new] = True
        yield new, [_neighbours(place, stride, shape) for place in places[new].tolist()]
        stride //= 2


def _neighbours(place: list[int], stride: int, shape: tuple[int, ...]) -> list[int]:
    sides = [
        [k] if k % (2 * stride) == 0 else [k + step for step in (-stride, stride) if 0 <= k + step < n]
        for k, n in zip(place, shape, strict=True)
    ]
    near = [int(np.ravel_multi_index(at, shape)) for at in product(*sides)]
    own = int(np.ravel_multi_index(place, shape))
    return [point for point in near if point != own]


def make_spec(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None,
    *,
    over: str,
    ask: str,
    mode: str,
    orbit_periods: int = 0,
    paths: Mapping[str, int] | None = None,
    **how: Any,
) -> SearchSpec:
    """Judge a search and lay it out, see `search`; `how` is what `run_settings` takes."""
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
    question = Question(over, whole.axes[over], ask, MODES.index(mode))
    others = Grid({name: values for name, values in whole.axes.items() if name != over}, whole.fixed)
    followed = 0 if orbit_periods == 0 else check_count("orbit_periods", orbit_periods)
    length = None if paths is None else path_length(**paths)
    if length is not None:
        length.check(others.size)
    return SearchSpec(others, question, run_settings(**how), followed, length)


def run_search(spec: SearchSpec, options: Options) -> xr.Dataset:
    """The cube of a search: what is there already, then what is missing, from coarse to fine.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `search`.
    """
    former = complete_cube(spec, options)
    if former is not None:
        return former
    with unfinished_cube(spec, options, partial(to_search_again, spec)) as cube:
        findings, origin = begin(spec, options, cube.results())
        legal = legal_points(spec.grid)
        cube.crew.expect(int(legal.sum()))
        for points, neighbours in waves(spec.grid.shape):
            kept = np.flatnonzero(legal[points])
            findings.search(spec, points[kept], [neighbours[k] for k in kept], cube.crew)
        return cube.write(as_cube(spec, cube.results(), cube.attributes(origin)))


def begin(spec: SearchSpec, options: Options, results: np.ndarray) -> tuple[Findings, dict[str, str]]:
    """What is known before a search: its own `results` so far and what other cubes offer; and attributes that tell of these.

    Raises
    ------
    StoreError
        If such a cube was made with other settings.
    """
    cubes, origin = known_points(spec, options, partial(results_of, spec))
    offered = blank_results(spec.grid.size if cubes else 0, spec.kind)
    for cube in cubes:
        lacking = runs(offered["codes"][:, CODE_MODE] == M_NOT_RUN)
        for piece in cube.pieces(lacking, options.unwanted):
            offered[slice(*piece.tile)] = piece.results
    return Findings(spec.question, results, offered), origin


def to_search_again(spec: SearchSpec, results: np.ndarray) -> np.ndarray:
    """Which of `results`, shape (n,), a retry forgets: those that failed, and those that a failed neighbour may have led."""
    led = (results["decider"] > 0) & spec.question.led
    return not_ok(results["codes"]) | led


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
    **options: Unpack[Given],
) -> xr.Dataset:
    """Ask a question about one axis at every point of the other ones, and stop at each as soon as its answer is certain.

    Points are taken from coarse to fine; each tries the value that decided at its coarser neighbours first, then the
    others in an order that spreads over the axis. What is recorded depends on neither workers nor their timing.

    With an `out`, finished points are kept in the file ``<out>.tiles`` as by `sweep`, and the same call goes on there.

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
        any: does one of its values lead to `mode`; all: does every one; first: which is the least that does; fraction:
        how many lead to each mode.
    mode : str
        Such as drift or rest.
    periods : int
        Forcing periods each run may take; a run stops when its motion has settled and its numbers stand.
    max_periods : int, optional
        As in `sweep`.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    orbit_periods : int
        If not 0, the deciding run is made once more for that many forcing periods, and its orbit recorded at their
        end: speed and angle of an orbit settle more slowly than the normal motion that the mode depends on.
    paths : mapping of str to int, optional
        ``{"periods": ..., "per_period": ...}``: the path of the centre of mass of each deciding run that drifts is kept,
        for so many forcing periods, with so many positions in each (8 by default).
    out, workers, progress, force, attrs, client, fail_fast, keep_tiles
        As in `sweep`; `out` is a NetCDF file.
    extend : path-like, optional
        A cube of `search` or `refine` whose points are taken over where this grid has them, value by value; same
        question to the same values of `over`, same settings, same kernel. With any and all, a point whose trials began
        with another answer of a neighbour is searched again, mostly in one run, so that the cube is as without `extend`.
    retry : bool
        Whether points of `out` (or `extend`) that failed are searched again, and those that they may have led astray.

    Returns
    -------
    xarray.Dataset
        Over the axes other than `over`: `answer` (no, yes or unsure), the value of `over` that decided, the number of
        runs it took, their modes (`runs`), `region`, and mode, status and orbit of the deciding run. With `paths`: `x`
        and `y` over a new dimension `cycle`, the time in forcing periods, and `axial_velocity`, the mean velocity along
        the axis in the last period; NaN where there is no run that drifts.

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
    spec = make_spec(
        grid,
        fixed,
        over=over,
        ask=ask,
        mode=mode,
        periods=periods,
        max_periods=max_periods,
        rtol=rtol,
        orbit_periods=orbit_periods,
        paths=paths,
    )
    return run_search(spec, make_options(**options))


def as_cube(spec: SearchSpec, results: np.ndarray, attributes: Mapping[str, Any]) -> xr.Dataset:
    """What was found as a labelled cube.

    Parameters
    ----------
    spec : SearchSpec
    results : ndarray, shape (spec.grid.size,)
        Of ``spec.kind``.
    attributes : mapping
        Global ones.
    """
    question, shape, dims = spec.question, spec.grid.shape, tuple(spec.grid.axes)
    findings, counts = Findings(question, results), results["counts"]
    cube = build(spec.grid, results["out"], results["codes"], attributes)
    cube["answer"] = label_variable("answer", dims, findings.answers().reshape(shape))
    cube["region"] = label_variable("region", dims, findings.regions().reshape(shape))
    known = {name: each.variable for name, each in cube.coords.items() if name in PARAMETERS}
    known[question.axis] = xr.Variable(dims, findings.deciders().reshape(shape))
    for name, values in completed(known).items():  # the one that decided, and what is as that one
        if name not in cube.coords:
            cube[name] = float_variable(values.dims, values.values, PARAMETERS[name])
    cube["n_runs"] = label_variable("n_runs", dims, counts.sum(axis=1).reshape(shape))
    cube["runs"] = label_variable("runs", (*dims, "outcome"), counts.reshape(*shape, len(MODES)))
    cube = cube.assign_coords(outcome=label_variable("outcome", ("outcome",), np.arange(len(MODES))))
    return cube if spec.paths is None else _with_paths(cube, results, spec.paths)


def results_of(spec: SearchSpec, cube: xr.Dataset) -> np.ndarray:
    """The results that `as_cube` made `cube` of, of ``spec.kind``; not run where a refined map was not computed."""
    results = blank_results(cube["mode"].size, spec.kind)
    results["out"], results["codes"] = flatten(cube)
    results["counts"] = cube["runs"].values.reshape(results["counts"].shape)
    results["answer"] = np.where(cube["n_runs"].values > 0, cube["answer"].values, A_NOT_RUN).ravel()
    values = cube[spec.question.axis].values.ravel()
    results["decider"] = np.where(np.isnan(values), 0, np.searchsorted(spec.question.values, values) + 1)
    if spec.paths is not None:
        for name in ("x", "y", "axial_velocity"):
            results[name] = cube[name].values.reshape(results[name].shape)
    if "computed" in cube:
        results["codes"][cube["computed"].values.ravel() == 0, CODE_MODE] = M_NOT_RUN
    return results


def _with_paths(cube: xr.Dataset, results: np.ndarray, length: PathLength) -> xr.Dataset:
    """`cube` with the paths of its deciding runs, along `cycle`."""
    shape, dims = cube["mode"].shape, tuple(map(str, cube["mode"].dims))
    for name in ("x", "y"):
        cube[name] = float_variable(
            (*dims, "cycle"), results[name].reshape(*shape, length.moments), STATE_QUANTITIES[name]
        )
    velocity = results["axial_velocity"].reshape(shape)
    cube["axial_velocity"] = float_variable(dims, velocity, QUANTITIES["axial_velocity"])
    cycles = np.arange(length.moments) / length.per_period
    return cube.assign_coords(cycle=coordinate("cycle", cycles, Quantity("1", "time in forcing periods")))
