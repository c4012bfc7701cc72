"""What is asked of an axis: values in a fixed order, tried until the answer is certain, and the answer that runs give."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dimersweep.cubes.results import Along, Field
from dimersweep.kernel.model.layout import M_FAILED, M_NOT_RUN, M_UNRESOLVED, MODES
from dimersweep.symbols import QUANTITIES, Quantity

ASKS = ("any", "all", "first", "fraction")
A_NOT_RUN, A_NO, A_YES, A_UNSURE = range(4)
OPEN = (M_NOT_RUN, M_FAILED, M_UNRESOLVED)  # verdicts that leave an answer open
ANSWER = (
    Field("answer", QUANTITIES["answer"], "<i8"),
    Field("decider", Quantity("1", "number of the value that decided, counted from 1; 0 if none alone did"), "<i8"),
    Field("counts", QUANTITIES["runs"], "<i8", Along("outcome", np.arange(len(MODES)), QUANTITIES["outcome"])),
)


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
        alone = result["counts"].sum() == 1 and result["decider"] - 1 == self.order(hints)[0]
        return bool(not self.led or not result["decider"] or alone)

    def order(self, hints: Sequence[int]) -> np.ndarray:
        """The order in which values are tried, shape (n,), indices: `hints` first, then spread over the axis."""
        if not self.led:
            return np.arange(self.values.size)
        spread = spread_order(self.values.size)
        return np.concatenate([np.array(hints, dtype=int), spread[~np.isin(spread, hints)]])

    def verdict(self, modes: np.ndarray) -> tuple[int, int]:
        """The answer that runs with these modes give, and which of them decides it (-1: none alone)."""
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
    """The numbers 0 to n - 1 in the order of van der Corput: each new one far from those before it, shape (n,)."""
    bits = max(1, (n - 1).bit_length())
    turned = [int(f"{k:0{bits}b}"[::-1], 2) for k in range(1 << bits)]
    return np.array([k for k in turned if k < n])
