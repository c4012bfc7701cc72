"""What a search does at one point: try values of an axis in a fixed order until the answer to its question is certain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dimersweep.cube import blank
from dimersweep.grid import Grid
from dimersweep.kernel import kernel_version
from dimersweep.kernel.engine import run_many
from dimersweep.kernel.layout import CODES, M_FAILED, M_NOT_RUN, M_UNRESOLVED, MODES, N_CODES, N_OUT, OK
from dimersweep.parameters import fill_rows

ASKS = ("any", "all", "first", "fraction")
A_NOT_RUN, A_NO, A_YES, A_UNSURE = range(4)
OPEN = (M_NOT_RUN, M_FAILED, M_UNRESOLVED)  # verdicts that leave an answer open
_MODE, _STATUS = CODES.index("mode"), CODES.index("status")


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

    def order(self, hints: Sequence[int]) -> np.ndarray:
        """The order in which values are tried, shape (n,), indices: `hints` first, then spread over the axis."""
        if self.ask in ("first", "fraction"):
            return np.arange(self.values.size)
        spread = spread_order(self.values.size)
        return np.concatenate([np.array(hints, dtype=int), spread[~np.isin(spread, hints)]])


@dataclass(frozen=True)
class Spec:
    """All that decides the numbers of a search.

    Parameters
    ----------
    grid : Grid
        The points at which the question is asked; it has no axis of that name.
    question : Question
        What is asked.
    periods : int
        Forcing periods each run may take; it stops earlier when it has settled.
    rtol : float
        Accuracy [1].
    orbit_periods : int
        If not 0, the deciding run is made once more for that many forcing periods, and its orbit recorded at their end.
    """

    grid: Grid
    question: Question
    periods: int
    rtol: float
    orbit_periods: int = 0

    def configuration(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, with the version of the kernel that gives the results."""
        question = self.question
        return {
            "grid": {name: values.tolist() for name, values in self.grid.axes.items()},
            "fixed": self.grid.fixed,
            "search": {
                "axis": question.axis,
                "values": question.values.tolist(),
                "ask": question.ask,
                "mode": MODES[question.mode],
                "orbit_periods": self.orbit_periods,
            },
            "periods": self.periods,
            "rtol": self.rtol,
            "kernel_version": kernel_version(),
        }


class Task(NamedTuple):
    """Points of the grid, by their numbers, each with the indices on the searched axis to try first."""

    points: list[int]
    hints: list[list[int]]


class Decided(NamedTuple):
    """What a search found at some points, shape (n, ...) each, or the error that kept it from anything."""

    points: list[int]
    answer: np.ndarray
    chosen: np.ndarray
    counts: np.ndarray
    out: np.ndarray
    codes: np.ndarray
    error: str


def spread_order(n: int) -> np.ndarray:
    """The numbers 0 to n - 1 in the order of van der Corput: each new one far from those before it, shape (n,)."""
    bits = max(1, (n - 1).bit_length())
    turned = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)]
    return np.array([k for k in turned if k < n])


def _verdict(question: Question, modes: np.ndarray, order: np.ndarray) -> tuple[int, int]:
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


def _decide(spec: Spec, point: int, hints: list[int]) -> tuple[int, int, np.ndarray, np.ndarray, np.ndarray]:
    """Answer at one point, index that decides it, tally of the runs' modes, and results of the deciding run."""
    question = spec.question
    order = question.order(hints)
    columns = spec.grid.fixed | spec.grid.values(point) | {question.axis: question.values[order]}
    rows = fill_rows(columns, order.size)
    out, codes = blank(order.size)
    made = run_many(rows, spec.periods, spec.rtol, True, out, codes, question.until())
    modes = codes[:made, _MODE]
    counts = np.bincount(modes, minlength=len(MODES))
    answer, which = _verdict(question, modes, order)
    if which >= 0:
        if spec.orbit_periods:
            run_many(rows[which : which + 1], spec.orbit_periods, spec.rtol, False, out[which:], codes[which:])
        return answer, int(order[which]), counts, out[which], codes[which]
    # no run alone decides: the most frequent mode, and no orbit
    nothing, code = np.full(N_OUT, np.nan), np.zeros(N_CODES, dtype=np.int64)
    code[_MODE], code[_STATUS] = counts.argmax(), OK
    return answer, -1, counts, nothing, code


def decide(spec: Spec, task: Task) -> Decided:
    """Search at each point of `task`; an exception marks its points as failed and goes no further."""
    n = len(task.points)
    try:
        found = [_decide(spec, point, hints) for point, hints in zip(task.points, task.hints, strict=True)]
        answer, chosen, counts, out, codes = (np.array(part) for part in zip(*found, strict=True))
        return Decided(task.points, answer, chosen, counts, out, codes, "")
    except Exception as error:  # whatever it is, it must not cost the other points
        out, codes = blank(n)
        codes[:, _MODE] = M_FAILED
        counts = np.zeros((n, len(MODES)), dtype=np.int32)
        told = f"{type(error).__name__}: {error}"
        return Decided(task.points, np.full(n, A_UNSURE), np.full(n, -1), counts, out, codes, told)
