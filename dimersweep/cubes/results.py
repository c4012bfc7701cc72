"""Lay out the results of grid points: their types, ranges of points, and which points have failed or were never run."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.model.layout import (
    CODE_MODE,
    CODE_STATUS,
    M_FAILED,
    M_NOT_RUN,
    MODES,
    N_CODES,
    N_OUT,
    NOT_RUN,
    OK,
    STATUS_MESSAGES,
    STATUSES,
)
from dimersweep.symbols import Quantity

# statuses of points: those of the kernel, and one more for an observer that failed
OBSERVER_FAILED = len(STATUSES)
POINT_STATUSES = (*STATUSES, "observer")
POINT_MESSAGES = (
    *STATUS_MESSAGES,
    "the run reached its end, and the observer of one's own raised, or gave what it had not declared",
)
MESSAGE_BYTES = 100  # length of an observer's error in a result; the rest of the message is cut
# the result of the run of one point
RESULT = np.dtype([("out", "<f8", (N_OUT,)), ("codes", "<i8", (N_CODES,))])


class Along(NamedTuple):
    """Dimension that a field has besides those of the points: its name, the values along it, and their quantity."""

    name: str
    values: np.ndarray
    quantity: Quantity


class Field(NamedTuple):
    """Quantity that is stored for each point besides the result of its run, as a variable of the cube.

    Attributes
    ----------
    name : str
    quantity : Quantity
        Its unit and meaning.
    type : str
        Type in numpy's notation: floats, or integers for flags and counts.
    along : Along, optional
        Its own dimension.
    about : str
        Name of the variable that this one describes further, or "".
    """

    name: str
    quantity: Quantity
    type: str = "<f8"
    along: Along | None = None
    about: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its values at one point."""
        return () if self.along is None else (self.along.values.size,)

    @property
    def size(self) -> int:
        """Number of its values at one point."""
        return 1 if self.along is None else self.along.values.size


def kind_with(fields: Iterable[Field]) -> np.dtype:
    """Return the type of a result with `fields` behind those of `RESULT`."""
    return np.dtype([*RESULT.descr, *((each.name, each.type, each.shape) for each in fields)])


def blank_results(n: int, kind: np.dtype = RESULT) -> np.ndarray:
    """Return results of `n` points that were not run, shape (n,): floats are NaN, integers 0, the mode is not_run.

    `kind` has the fields of `RESULT`, and perhaps more.
    """
    results = np.zeros(n, kind)
    for name in kind.names or ():
        if kind[name].base.kind == "f":
            results[name] = np.nan
    results["codes"][:, CODE_MODE] = M_NOT_RUN
    return results


class Tile(NamedTuple):
    """Range of grid points from `start` to `stop` - 1, in C order."""

    start: int
    stop: int


class Finished(NamedTuple):
    """Tile with its results, shape (n,), and the time of their computation [s]."""

    tile: Tile
    results: np.ndarray
    seconds: float = 0.0

    @property
    def codes(self) -> np.ndarray:
        """Integer results, shape (n, N_CODES)."""
        codes: np.ndarray = self.results["codes"]
        return codes

    def part(self, tile: Tile) -> "Finished":
        """Return the results of the points in `tile`, which must lie within this one; their time is 0."""
        return Finished(tile, self.results[tile.start - self.tile.start : tile.stop - self.tile.start])


def split(ranges: Iterable[Tile], length: int) -> Iterator[Tile]:
    """Yield tiles of at most `length` points that cover `ranges`."""
    return (Tile(at, min(at + length, stop)) for start, stop in ranges for at in range(start, stop, length))


def gaps(size: int, done: Iterable[Tile]) -> Iterator[Tile]:
    """Yield the ranges of `size` points that no tile of `done` covers."""
    reached = 0
    for start, stop in sorted(done):
        if start > reached:
            yield Tile(reached, start)
        reached = max(reached, stop)
    if reached < size:
        yield Tile(reached, size)


def common(some: Iterable[Tile], others: Sequence[Tile]) -> Iterator[Tile]:
    """Yield the ranges of points that lie in both sequences.

    The tiles of each sequence increase and do not overlap.
    """
    first = 0
    for start, stop in some:
        while first < len(others) and others[first].stop <= start:
            first += 1
        for low, high in islice(others, first, None):
            if low >= stop:
                break
            yield Tile(max(start, low), min(stop, high))


def chunks(ranges: Iterable[Tile], length: Callable[[], int], line: int = 1) -> Iterator[np.ndarray]:
    """Yield the numbers of the points of `ranges` in pieces, each of as many points as `length()` then returns.

    A piece has whole lines of `line` points, at least one; so must `ranges`. The last piece may be shorter.
    """
    parts: list[np.ndarray] = []
    room = 0
    for start, stop in ranges:
        at = start
        while at < stop:
            room = room or line * max(1, length() // line)
            parts.append(np.arange(at, min(stop, at + room)))
            at, room = at + parts[-1].size, room - parts[-1].size
            if not room:
                yield np.concatenate(parts)
                parts = []
    if parts:
        yield np.concatenate(parts)


def ranges_of(points: np.ndarray) -> list[Tile]:
    """Return increasing numbers of points as ranges of consecutive points."""
    ends = [0, *(np.flatnonzero(np.diff(points) != 1) + 1).tolist(), points.size]
    return [Tile(int(points[a]), int(points[b - 1]) + 1) for a, b in pairwise(ends) if a < b]


def runs(chosen: np.ndarray, start: int = 0) -> list[Tile]:
    """Return the ranges of points where `chosen`, shape (n,), bool, is True; its first item is point `start`."""
    return ranges_of(np.flatnonzero(chosen) + start)


def pieces(points: np.ndarray, results: np.ndarray, seconds: float = 0.0) -> Iterator[Finished]:
    """Yield the results of increasing points, shape (n,), as one tile for each range of consecutive points.

    The first tile has the whole time [s], the others 0.
    """
    first = 0
    for tile in ranges_of(points):
        last = first + tile.stop - tile.start
        yield Finished(tile, results[first:last], seconds)
        first, seconds = last, 0.0


def not_run(codes: np.ndarray) -> np.ndarray:
    """Return a mask of the points that have never been run, shape (n,), bool, from codes of shape (n, N_CODES)."""
    return codes[:, CODE_MODE] == M_NOT_RUN


def failed(codes: np.ndarray) -> np.ndarray:
    """Return a mask of the points that ran without a result, shape (n,), bool, from codes of shape (n, N_CODES)."""
    # a refined map gives points without runs the mode of their cell: their status NOT_RUN is no failure
    return (codes[:, CODE_MODE] == M_FAILED) | ~np.isin(codes[:, CODE_STATUS], (OK, NOT_RUN))


def not_ok(codes: np.ndarray) -> np.ndarray:
    """Return a mask of the points without a result, shape (n,), bool, from codes of shape (n, N_CODES).

    They have failed or have never been run.
    """
    return failed(codes) | not_run(codes)


def why_failed(result: np.void) -> str:
    """Return the status of a failed point, and what it means or the error of the observer."""
    status = int(result["codes"][CODE_STATUS])
    reason = bytes(result["observer_error"]).decode() if status == OBSERVER_FAILED else POINT_MESSAGES[status]
    return f"{POINT_STATUSES[status]}: {reason}"


def tally(codes: np.ndarray) -> dict[str, int]:
    """Return the number of points in each mode, by its word, from codes of shape (n, N_CODES).

    Points that ran without a result count as failed, whatever their mode.
    """
    values, counts = np.unique(np.where(failed(codes), M_FAILED, codes[:, CODE_MODE]), return_counts=True)
    return {MODES[value]: int(count) for value, count in zip(values, counts, strict=True)}
