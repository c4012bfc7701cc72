"""Questions about an axis at every point of a grid, such as whether any initial dip angle drifts: points, threads and cube."""

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from dask.system import CPU_COUNT

from dimersweep.cube import FLAGS, blank, build, float_variable, label_variable
from dimersweep.deciding import A_YES, ASKS, OPEN, Decided, Question, Spec, Task, decide
from dimersweep.errors import ParameterError
from dimersweep.grid import Grid, legal_points, make_grid
from dimersweep.kernel.layout import CODES, MODES
from dimersweep.parameters import check_count, check_rtol
from dimersweep.progress import Silent, tell_of_compiling, watch
from dimersweep.provenance import attributes
from dimersweep.store import check_writable, write_cube
from dimersweep.symbols import PARAMETERS
from dimersweep.threads import run_each

REGIONS = FLAGS["region"]
MIXED = REGIONS.index("mixed")  # several modes, none of them the one asked for
BATCH = 8  # points of one task at most: some tenths of a second where each takes a whole axis
_MODE = CODES.index("mode")


class Findings:
    """What is known of each point of a grid: nothing to begin with."""

    def __init__(self, size: int) -> None:
        self.answer = np.zeros(size, dtype=np.int8)
        self.chosen = np.full(size, -1)
        self.counts = np.zeros((size, len(MODES)), dtype=np.int32)
        self.out, self.codes = blank(size)
        self.errors: list[str] = []

    def take(self, decided: Decided) -> None:
        """Enter what was found at some points."""
        at = decided.points
        self.answer[at], self.chosen[at], self.counts[at] = decided.answer, decided.chosen, decided.counts
        self.out[at], self.codes[at] = decided.out, decided.codes
        if decided.error:
            self.errors.append(f"points {at[0]} to {at[-1]}: {decided.error}")

    def regions(self, question: Question) -> np.ndarray:
        """Region of each point: the mode asked for where the answer is yes, else the one mode of all runs, or mixed."""
        made = self.counts.sum(axis=1)
        region = np.where(self.counts.max(axis=1) == question.values.size, self.counts.argmax(axis=1), MIXED)
        if question.ask != "fraction":
            found = (self.chosen >= 0) & (question.ask != "all")  # a first one may be found and yet not be sure
            region[(self.answer == A_YES) | found] = question.mode
        region[made == 0] = self.codes[made == 0, _MODE]
        return region


def search_points(
    spec: Spec, points: np.ndarray, hints: Sequence[list[int]], findings: Findings, workers: int, shown: Silent
) -> None:
    """Search at `points`, enter what is found into `findings`, and tell `shown`.

    Each point gets its own order of trials from its own hints, so that neither threads nor batches change a number.
    """
    length = max(1, min(BATCH, len(points) // (4 * workers)))
    tasks = [
        Task(list(map(int, points[k : k + length])), list(hints[k : k + length])) for k in range(0, len(points), length)
    ]

    def take(decided: Decided) -> None:
        findings.take(decided)
        shown.add(decided.codes[:, _MODE])

    run_each(partial(decide, spec), tasks, workers, take)


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


def hints_from(findings: Findings, neighbours: Sequence[list[int]]) -> list[list[int]]:
    """For each point, the indices that decided at its neighbours, each once."""
    return [list(dict.fromkeys(int(k) for k in findings.chosen[near] if k >= 0)) for near in neighbours]


def make_spec(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None,
    *,
    over: str,
    ask: str,
    mode: str,
    periods: int,
    rtol: float,
    orbit_periods: int,
) -> Spec:
    """Judge a search and lay it out; see `search`."""
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
    kept = 0 if orbit_periods == 0 else check_count("orbit_periods", orbit_periods)
    return Spec(others, question, check_count("periods", periods), check_rtol(rtol), kept)


def search(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    over: str,
    ask: str = "any",
    mode: str = "drift",
    periods: int,
    rtol: float = 1e-8,
    orbit_periods: int = 0,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    force: bool = False,
    attrs: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Ask a question about one axis at every point of the other ones, and stop at each as soon as its answer is certain.

    Points are taken from coarse to fine; each tries the value that decided at its coarser neighbours first, then the
    others in an order that spreads over the axis. What is recorded depends on neither threads nor their timing.

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
        Forcing periods each run may take; a run stops when its motion has settled.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    orbit_periods : int
        If not 0, the deciding run is made once more for that many forcing periods, and its orbit recorded at their
        end: speed and angle of an orbit settle more slowly than the normal motion that the mode depends on.
    out, workers, progress, force, attrs
        As in `sweep`.

    Returns
    -------
    xarray.Dataset
        Over the axes other than `over`: `answer` (no, yes or unsure), the value of `over` that decided, the number of
        runs it took, their modes (`runs`), `region`, and mode, status and orbit of the deciding run.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError
        For an `out` that cannot be written, before any work.
    """
    spec = make_spec(
        grid, fixed, over=over, ask=ask, mode=mode, periods=periods, rtol=rtol, orbit_periods=orbit_periods
    )
    workers = CPU_COUNT if workers is None else check_count("workers", workers)
    if out is not None:
        check_writable(out, force=force)
    if progress:
        tell_of_compiling()
    started, findings = perf_counter(), Findings(spec.grid.size)
    legal = legal_points(spec.grid)
    with watch(int(legal.sum()), show=progress) as shown:
        for points, neighbours in waves(spec.grid.shape):
            kept = np.flatnonzero(legal[points])
            hints = hints_from(findings, [neighbours[k] for k in kept])
            search_points(spec, points[kept], hints, findings, workers, shown)
    cube = as_cube(spec, findings, spec.configuration(), perf_counter() - started, attrs)
    if out is not None:
        write_cube(cube, out, force=force)
    return cube


def as_cube(
    spec: Spec,
    findings: Findings,
    configuration: Mapping[str, Any],
    wall_time: float,
    attrs: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """What was found as a labelled cube; warns of points that failed."""
    question, shape, dims = spec.question, spec.grid.shape, tuple(spec.grid.axes)
    failures = sorted(findings.errors)
    if failures:
        told = f"{len(failures)} batches of points failed; {failures[0]}"
        warnings.warn(told, RuntimeWarning, stacklevel=3)
    title = f"search over {question.axis} for a 3D dimer on a vibrating plate"
    about = attributes(configuration, title, wall_time) | dict(attrs or {})
    if failures:
        about["failures"] = "; ".join(failures)
    cube = build(spec.grid, findings.out, findings.codes, about)
    cube["answer"] = label_variable("answer", dims, findings.answer.reshape(shape))
    cube["region"] = label_variable("region", dims, findings.regions(question).reshape(shape))
    decided = np.where(findings.chosen >= 0, question.values[findings.chosen], np.nan).reshape(shape)
    cube[question.axis] = float_variable(dims, decided, PARAMETERS[question.axis])
    cube["n_runs"] = label_variable("n_runs", dims, findings.counts.sum(axis=1).reshape(shape))
    cube["runs"] = label_variable("runs", (*dims, "outcome"), findings.counts.reshape(*shape, len(MODES)))
    return cube.assign_coords(outcome=label_variable("outcome", ("outcome",), np.arange(len(MODES))))
