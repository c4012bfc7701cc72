"""Questions about an axis: the order in which its values are tried, when to stop, and the answer that the runs give."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dimersweep.cubes.results import Along, Field
from dimersweep.kernel.model.layout import M_FAILED, M_NOT_RUN, M_UNRESOLVED, MODES
from dimersweep.symbols import QUANTITIES, Quantity

ASKS = ("any", "all", "first", "fraction")
A_NOT_RUN, A_NO, A_YES, A_UNSURE = range(4)
OPEN = (M_NOT_RUN, M_FAILED, M_UNRESOLVED)  # modes of a run that leave the answer open
ANSWER = (
    Field("answer", QUANTITIES["answer"], "<i8"),
    Field("decider", Quantity("1", "number of the value that decided, counted from 1; 0 if none alone did"), "<i8"),
    Field("counts", QUANTITIES["runs"], "<i8", Along("outcome", np.arange(len(MODES)), QUANTITIES["outcome"])),
)


@dataclass(frozen=True)
class Question:
    """A question about the values of one axis: whether, where or how often they lead to a mode.

    Parameters
    ----------
    axis : str
        The parameter that is searched.
    values : ndarray, shape (n,), float64
        The values of the axis, SI units, increasing.
    ask : str
        any: does one value lead to `mode`? all: do all values? first: which is the least value that does? fraction: how
        many values lead to each mode? (This takes a run of every value.)
    mode : int
        Code of the mode in question.
    """

    axis: str
    values: np.ndarray
    ask: str
    mode: int

    def until(self) -> int:
        """Return the modes of a run that end the search, as the sum of 2**mode; 0 if all values are run."""
        if self.ask == "fraction":
            return 0
        if self.ask != "all":
            return 1 << self.mode
        return sum(1 << code for code in range(len(MODES)) if code != self.mode and code not in OPEN)

    @property
    def led(self) -> bool:
        """True if the deciding values of neighbours are tried first: for any and all, whose answers need no order."""
        return self.ask in ("any", "all")

    def stands(self, result: np.void, hints: Sequence[int]) -> bool:
        """Return True if `hints` would give this result bit for bit, the counts of its runs included.

        The result was found with unknown hints. It stands if no hints are used, or if all values were run. It also
        stands if its only run decided, and `hints` try this value first, too.
        """
        decided_first = result["counts"].sum() == 1 and result["decider"] - 1 == self.order(hints)[0]
        return bool(not self.led or not result["decider"] or decided_first)

    def order(self, hints: Sequence[int]) -> np.ndarray:
        """Return the order of trial as indices of the values, shape (n,): `hints` first, the others spread out."""
        if not self.led:
            return np.arange(self.values.size)
        spread = spread_order(self.values.size)
        return np.concatenate([np.array(hints, dtype=int), spread[~np.isin(spread, hints)]])

    def verdict(self, modes: np.ndarray) -> tuple[int, int]:
        """Return the answer that runs with these modes give, and the index of the run that decided it.

        The index is -1 if no run alone decided: all were needed.
        """
        # runs stop at the first mode that decides (`until`), so that only the last one can have decided
        last, unclear = modes[-1], np.isin(modes, OPEN).any()
        if self.ask == "fraction":
            return (A_UNSURE if unclear else A_YES), (0 if self.values.size == 1 else -1)
        if self.ask == "all":
            if self.until() >> int(last) & 1:
                return A_NO, modes.size - 1
            return (A_UNSURE if unclear else A_YES), -1
        if last == self.mode:
            return (A_UNSURE if self.ask == "first" and unclear else A_YES), modes.size - 1
        return (A_UNSURE if unclear else A_NO), -1


def spread_order(n: int) -> np.ndarray:
    """Return 0 to n - 1 in the order of van der Corput (bits reversed), shape (n,).

    Each number is far from all before it, so that a search meets every stretch of an axis early.
    """
    bits = max(1, (n - 1).bit_length())
    turned = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)]
    return np.array([k for k in turned if k < n])
