"""What a search does at one point: try values of an axis in a fixed order until the answer to its question is certain."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import RESULT, Bundle
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.kernel.model.layout import (
    CODE_MODE,
    CODE_STATUS,
    M_DRIFT,
    M_FAILED,
    M_NOT_RUN,
    M_UNRESOLVED,
    MODES,
    OK,
)
from dimersweep.parameters import fill_rows
from dimersweep.runs.settings import SLOW_MODES, RunSettings, run_patiently
from dimersweep.studies.paths import PathLength, path_of
from dimersweep.work.tiles import around

ASKS = ("any", "all", "first", "fraction")
A_NOT_RUN, A_NO, A_YES, A_UNSURE = range(4)
OPEN = (M_NOT_RUN, M_FAILED, M_UNRESOLVED)  # verdicts that leave an answer open
CHUNK_RUNS = 16  # in one call of the kernel: it can be stopped only between calls
# the answer, the index of the value that decided it, counted from 1 (0: none did), and the number of runs in each mode
ANSWER_FIELDS: list[tuple[Any, ...]] = [("answer", "<i8"), ("decider", "<i8"), ("counts", "<i8", (len(MODES),))]


@dataclass(frozen=True)
class Question:
    """What is asked of an axis.

    Parameters
    ----------
    axis : str
        The parameter that is searched.
    values : ndarray, shape (n,), float64
        Its values, SI units, increasing.
    ask : str
        any: does one value lead to `mode`; all: does every one; first: which is the least that does; fraction: how
        many lead to each mode (that takes every run).
    mode : int
        The mode asked for, a code.
    """

    axis: str
    values: np.ndarray
    ask: str
    mode: int

    def until(self) -> int:
        """The modes that end a search, as the sum of 2**mode."""
        if self.ask == "fraction":
            return 0
        if self.ask != "all":
            return 1 << self.mode
        return sum(1 << code for code in range(len(MODES)) if code != self.mode and code not in OPEN)

    @property
    def led(self) -> bool:
        """Whether the answers of neighbours decide where the trials begin."""
        return self.ask in ("any", "all")

    def stands(self, result: np.void, hints: Sequence[int]) -> bool:
        """Whether a result found with unknown hints is what `hints` lead to: bit for bit, the counts of its runs included."""
        if result["codes"][CODE_MODE] == M_NOT_RUN:
            return False
        alone = result["counts"].sum() == 1 and result["decider"] - 1 == self.order(hints)[0]
        return bool(not self.led or not result["decider"] or alone)

    def order(self, hints: Sequence[int]) -> np.ndarray:
        """The order in which values are tried, shape (n,), indices: `hints` first, then spread over the axis."""
        if not self.led:
            return np.arange(self.values.size)
        spread = spread_order(self.values.size)
        return np.concatenate([np.array(hints, dtype=int), spread[~np.isin(spread, hints)]])


@dataclass(frozen=True)
class SearchSpec:
    """All that decides the numbers of a search.

    Parameters
    ----------
    grid : Grid
        The points at which the question is asked; it has no axis of that name.
    question : Question
        What is asked.
    how : RunSettings
        How long each run may be, and how accurate it is.
    orbit_periods : int
        If not 0, the deciding run is made once more for that many forcing periods, and its orbit recorded at their end.
    paths : PathLength, optional
        How much of the path of each deciding run that drifts is kept.
    """

    grid: Grid
    question: Question
    how: RunSettings
    orbit_periods: int = 0
    paths: PathLength | None = None

    by_blocks = False

    @property
    def summary(self) -> str:
        """What its cube shows."""
        return f"search over {self.question.axis} for a 3D dimer on a vibrating plate"

    @property
    def kind(self) -> np.dtype:
        """Of the result of one point: that of the deciding run, and how it was found."""
        return np.dtype(RESULT.descr + ANSWER_FIELDS + (self.paths.fields if self.paths else []))

    def configuration(self) -> dict[str, Any]:
        """All that decides the numbers, as plain numbers, lists and strings, with the version of the kernel."""
        question = self.question
        settings = {
            "grid": {name: values.tolist() for name, values in self.grid.axes.items()},
            "fixed": self.grid.fixed,
            "search": {
                "axis": question.axis,
                "values": question.values.tolist(),
                "ask": question.ask,
                "mode": MODES[question.mode],
                "orbit_periods": self.orbit_periods,
            },
            "periods": self.how.periods,
            "rtol": self.how.rtol,
            "kernel_version": kernel_version(),
        }
        if self.how.max_periods > self.how.periods:
            settings["max_periods"] = self.how.max_periods
        if self.paths:
            settings["paths"] = vars(self.paths)
        return settings


@dataclass(frozen=True)
class Wave:
    """A search at points that need not know of each other; see `Work`.

    Parameters
    ----------
    spec : SearchSpec
    hints : mapping of int to sequence of int
        Of each point, by its number: the indices on the searched axis to try first.
    """

    spec: SearchSpec
    hints: Mapping[int, Sequence[int]]

    line = 1

    @property
    def grid(self) -> Grid:
        """The points."""
        return self.spec.grid

    @property
    def kind(self) -> np.dtype:
        """See `SearchSpec`."""
        return self.spec.kind

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """See `Work`."""
        for k, point in enumerate(points.tolist()):
            if not decide(self.spec, point, self.hints[point], results[k : k + 1], space):
                return k
        return points.size

    def narrowed(self, tiles: Bundle) -> tuple["Wave", Bundle, int]:
        """See `Work`."""
        grid, moved, shift = around(self.grid, tiles)
        hints = {point: self.hints[point + shift] for tile in moved for point in range(*tile)}
        return Wave(replace(self.spec, grid=grid), hints), moved, shift


def spread_order(n: int) -> np.ndarray:
    """The numbers 0 to n - 1 in the order of van der Corput: each new one far from those before it, shape (n,)."""
    bits = max(1, (n - 1).bit_length())
    turned = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)]
    return np.array([k for k in turned if k < n])


def _verdict(question: Question, modes: np.ndarray) -> tuple[int, int]:
    """Answer, and which of the runs made decides it (-1: none alone)."""
    last = modes[-1]
    unclear = np.isin(modes, OPEN).any()
    if question.ask == "fraction":
        return (A_UNSURE if unclear else A_YES), (0 if question.values.size == 1 else -1)
    hit = last == question.mode
    if question.ask == "all":
        if question.until() >> int(last) & 1:
            return A_NO, modes.size - 1
        return (A_UNSURE if unclear else A_YES), -1
    if hit:
        return (A_UNSURE if question.ask == "first" and unclear else A_YES), modes.size - 1
    return (A_UNSURE if unclear else A_NO), -1


def _tried(spec: SearchSpec, rows: np.ndarray, out: np.ndarray, codes: np.ndarray, space: Workspace) -> int:
    """Make the runs of `rows`, in short calls, until the answer is certain; their number, 0 if `space` was stopped."""
    made, ends = 0, spec.question.until()
    while made < len(rows):
        part = slice(made, made + CHUNK_RUNS)
        made += run_patiently(rows[part], spec.how, out[part], codes[part], until=ends | SLOW_MODES, space=space)
        if is_stopped(space):
            return 0
        if ends >> int(codes[made - 1, CODE_MODE]) & 1:
            break
    return made


def decide(spec: SearchSpec, point: int, hints: Sequence[int], result: np.ndarray, space: Workspace) -> bool:
    """Search at one point.

    Parameters
    ----------
    spec : SearchSpec
    point : int
        Its number.
    hints : sequence of int
        Indices on the searched axis to try first.
    result : ndarray, shape (1,)
        Filled.
    space : Workspace
        Scratch arrays; if they are stopped, the search ends there.

    Returns
    -------
    bool
        Whether it came to its end.
    """
    question = spec.question
    order = question.order(hints)
    here = spec.grid.fixed | {name: float(value) for name, value in spec.grid.values(point).items()}
    rows = fill_rows(here | {question.axis: question.values[order]}, order.size)
    out, codes = blank(order.size)
    made = _tried(spec, rows, out, codes, space)
    if not made:
        return False
    modes = codes[:made, CODE_MODE]
    counts = np.bincount(modes, minlength=len(MODES))
    answer, which = _verdict(question, modes)
    result["answer"], result["counts"] = answer, counts
    if which < 0:  # no run alone decides: the most frequent mode, and no orbit
        result["codes"][0, [CODE_MODE, CODE_STATUS]] = counts.argmax(), OK
        return True
    if spec.orbit_periods:
        last = slice(which, which + 1)
        longer = RunSettings(spec.orbit_periods, spec.orbit_periods, spec.how.rtol, stop_when_settled=False)
        run_patiently(rows[last], longer, out[last], codes[last], space=space)
    result["out"], result["codes"], result["decider"] = out[which], codes[which], order[which] + 1
    if spec.paths and codes[which, CODE_MODE] == M_DRIFT:
        value = float(question.values[order[which]])
        result["x"], result["y"], result["axial_velocity"] = path_of(
            here | {question.axis: value}, spec.paths, spec.how.rtol, space
        )
    return not is_stopped(space)
