"""Results of grid points: their layout, ranges of points, and which of them have failed or never run."""

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

# statuses of points: those of the kernel, and one that it does not know
OBSERVER_FAILED = len(STATUSES)
POINT_STATUSES = (*STATUSES, "observer")
POINT_MESSAGES = (
    *STATUS_MESSAGES,
    "the run reached its end, and the observer of one's own raised, or gave what it had not declared",
)
MESSAGE_BYTES = 100  # of what is kept of an error of an observer
RESULT = np.dtype([("out", "<f8", (N_OUT,)), ("codes", "<i8", (N_CODES,))])  # of the run of one point


class Along(NamedTuple):
    """A dimension that a field has besides those of the points: its name, the values along it, and what these are."""

    name: str
    values: np.ndarray
    quantity: Quantity


class Field(NamedTuple):
    """What is known of each point besides the result of its run: a variable of the cube, and how it is kept.

    Attributes
    ----------
    name : str
    quantity : Quantity
        Its unit and meaning.
    type : str
        Of numpy: floats, or integers for flags and counts.
    along : Along, optional
        Its own dimension.
    about : str
        The variable that it tells more of, if there is one.
    """

    name: str
    quantity: Quantity
    type: str = "<f8"
    along: Along | None = None
    about: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of its values at one point."""
        return () if self.along is None else (self.along.values.size,)

    @property
    def size(self) -> int:
        """Number of its values at one point."""
        return 1 if self.along is None else self.along.values.size


def kind_with(fields: Iterable[Field]) -> np.dtype:
    """The type of a result with these fields besides those of `RESULT`."""
    return np.dtype([*RESULT.descr, *((each.name, each.type, each.shape) for each in fields)])


def blank_results(n: int, kind: np.dtype = RESULT) -> np.ndarray:
    """Results of `n` points that have none, shape (n,): NaN and 0, with the mode of what was not run.

    `kind` has the fields of `RESULT`, and perhaps more.
    """
    results = np.zeros(n, kind)
    for name in kind.names or ():
        if kind[name].base.kind == "f":
            results[name] = np.nan
    results["codes"][:, CODE_MODE] = M_NOT_RUN
    return results


class Tile(NamedTuple):
    """The grid points `start` to `stop` - 1, in C order."""

    start: int
    stop: int


class Finished(NamedTuple):
    """A tile with its results, shape (n,), and its time [s]."""

    tile: Tile
    results: np.ndarray
    seconds: float = 0.0

    @property
    def codes(self) -> np.ndarray:
        """Integer results, shape (n, N_CODES)."""
        codes: np.ndarray = self.results["codes"]
        return codes

    def part(self, tile: Tile) -> "Finished":
        """The points that lie in `tile`, which is covered."""
        return Finished(tile, self.results[tile.start - self.tile.start : tile.stop - self.tile.start])


def split(ranges: Iterable[Tile], length: int) -> Iterator[Tile]:
    """Tiles of at most `length` points that cover `ranges`."""
    return (Tile(at, min(at + length, stop)) for start, stop in ranges for at in range(start, stop, length))


def gaps(size: int, done: Iterable[Tile]) -> Iterator[Tile]:
    """The ranges of `size` points that no tile of `done` covers."""
    reached = 0
    for start, stop in sorted(done):
        if start > reached:
            yield Tile(reached, start)
        reached = max(reached, stop)
    if reached < size:
        yield Tile(reached, size)


def common(some: Iterable[Tile], others: Sequence[Tile]) -> Iterator[Tile]:
    """The ranges that lie in both; each in order, and apart from one another."""
    first = 0
    for start, stop in some:
        while first < len(others) and others[first].stop <= start:
            first += 1
        for low, high in islice(others, first, None):
            if low >= stop:
                break
            yield Tile(max(start, low), min(stop, high))


def chunks(ranges: Iterable[Tile], length: Callable[[], int], line: int = 1) -> Iterator[np.ndarray]:
    """Numbers of the points of `ranges`, each time as many as `length` then says; the last ones may be fewer.

    Each time they are whole lines of so many points, at least one; `ranges` have whole ones.
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
    """The ranges that increasing numbers of points make up."""
    ends = [0, *(np.flatnonzero(np.diff(points) != 1) + 1).tolist(), points.size]
    return [Tile(int(points[a]), int(points[b - 1]) + 1) for a, b in pairwise(ends) if a < b]


def runs(chosen: np.ndarray, start: int = 0) -> list[Tile]:
    """The ranges where `chosen`, shape (n,), bool, holds; its first item is point `start`."""
    return ranges_of(np.flatnonzero(chosen) + start)


def pieces(points: np.ndarray, results: np.ndarray, seconds: float = 0.0) -> Iterator[Finished]:
    """Results of increasing points, shape (n,), range by range; their time [s] stands with the first one."""
    first = 0
    for tile in ranges_of(points):
        last = first + tile.stop - tile.start
        yield Finished(tile, results[first:last], seconds)
        first, seconds = last, 0.0


def not_run(codes: np.ndarray) -> np.ndarray:
    """Where points of codes, shape (n, N_CODES), have never been run; shape (n,), bool."""
    return codes[:, CODE_MODE] == M_NOT_RUN


def failed(codes: np.ndarray) -> np.ndarray:
    """Where points of codes, shape (n, N_CODES), were run without a result; shape (n,), bool."""
    # a point of a refined map that is as its cell has a mode, but no status
    return (codes[:, CODE_MODE] == M_FAILED) | ~np.isin(codes[:, CODE_STATUS], (OK, NOT_RUN))


def not_ok(codes: np.ndarray) -> np.ndarray:
    """Where points of codes, shape (n, N_CODES), have no result: failed, or never run; shape (n,), bool."""
    return failed(codes) | not_run(codes)


def why_failed(result: np.void) -> str:
    """The status of a point that has failed, and what that means."""
    status = int(result["codes"][CODE_STATUS])
    told = bytes(result["observer_error"]).decode() if status == OBSERVER_FAILED else POINT_MESSAGES[status]
    return f"{POINT_STATUSES[status]}: {told}"


def tally(codes: np.ndarray) -> dict[str, int]:
    """Number of points in each mode, from codes of shape (n, N_CODES); all that have no result count as failed."""
    values, counts = np.unique(np.where(failed(codes), M_FAILED, codes[:, CODE_MODE]), return_counts=True)
    return {MODES[value]: int(count) for value, count in zip(values, counts, strict=True)}
