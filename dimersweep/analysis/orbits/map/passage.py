"""One passage through a motion: its record, and what is read from it.

The axial spin of an orbit is that after its last impact in a period (of the drift: the end of the double impact), as
`Run.orbit` has it. The bouncer is the end that is in contact for less of the time.

The symbol sequence, sequence for short, has the contact states of a period in their order, chatter counted as one symbol. A
symbol is a state of sustained contact with its end (``SC_sk.1``), an impact with all its contact states
(``DI_sp_sp>DI_sp_sk``), ``chatter.1`` for hops that die out, ``FM`` for a lift-off, and ``far.2`` for an end that is in the air
for more than half a forcing period: the line from which a ball counts as flying. The sequence begins with its double impact.
"""

from collections import Counter
from collections.abc import Sequence
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.model.contact_code import CONTACT_STATES, code_of, digits_of
from dimersweep.kernel.model.layout import C_CHATTER_END, C_END, C_IMPACT, C_START, IMPACT, PERIOD, PHASE
from dimersweep.kernel.passage import PER_STATE, SAME_IMPACT, Read
from dimersweep.kernel.verdict.past import HOP_LINE

TURN = 2 * np.pi
MANY = 4  # bounces that do not die out are counted so far: beyond, their number changes without end
SPELT_ONCE = 4096  # sequences that are spelt once


@lru_cache(SPELT_ONCE)
def spelt(codes: bytes, far: tuple[bool, bool], whole: bool = False) -> str:
    """The sequence of one period of a motion, from the symbols of its events (``kernel.passage``) and whether the ends are far.

    A `whole` one has all its bounces counted.
    """
    events = np.frombuffer(codes, dtype=np.int64).tolist()
    symbols = _chatter_as_one(_symbols(events), len(events) if whole else MANY)
    # it begins at its first double impact, or without one at the rotation that sorts first
    turns = [symbols[k:] + symbols[:k] for k in range(len(symbols))] or [[]]
    begun = min(turns, key=lambda turn: (not (turn and turn[0].startswith("DI")), turn))
    return " ".join(begun + [f"far.{end + 1}" for end in (0, 1) if far[end]])


def _name(code: int) -> str:
    ends = digits_of(code)
    name = CONTACT_STATES[code]
    return name if 0 not in ends or not any(ends) else f"{name}.{1 if ends[0] else 2}"


def _symbols(events: Sequence[int]) -> list[str]:
    """One symbol an impact or a change of contact."""
    symbols: list[str] = []
    last = 0
    for event in events:
        joined, (kind, cause) = event >= SAME_IMPACT, divmod(event % SAME_IMPACT, PER_STATE)
        if cause == C_IMPACT and max(digits_of(kind)) > IMPACT:
            name = _name(kind)
            if joined and symbols and symbols[-1].startswith(("DI", "SI")):
                if not symbols[-1].endswith(name):
                    symbols[-1] += f">{name}"
            else:
                symbols.append(name)
            last = 0
            continue
        if cause in (C_START, C_END):
            last = kind
            continue
        if cause == C_CHATTER_END:
            symbols.append("chatter")
        if kind != last or cause == C_CHATTER_END:
            symbols.append(_name(kind))
        last = kind
    return symbols


def _chatter_as_one(symbols: Sequence[str], most: int) -> list[str]:
    """Symbols with the hops of a chatter joined to one symbol; other impacts of an end in a row are counted to `most`."""
    kept: list[tuple[str, int]] = []
    for symbol in symbols:
        name = f"bounces.{symbol[-1]}" if symbol.startswith("SI") else symbol
        last, count = kept[-1] if kept else ("", 0)
        if symbol == "chatter":
            if last.startswith("bounces"):
                kept[-1] = last.replace("bounces", "chatter"), 1
        elif name == last and name.startswith("bounces"):
            kept[-1] = name, count + 1
        else:
            kept.append((name, 1))
    return [name if count == 1 else f"{name}*{min(most, count)}" for name, count in kept]


def far_ends(sequence: str) -> int:
    """Number of ends that are in the air for more than half a forcing period at a time."""
    return sum(symbol.startswith("far") for symbol in sequence.split())


def rests(sequence: str) -> bool:
    """Whether an end stays on the plate for a part of the period."""
    return any(symbol.startswith(("SC", "DC")) for symbol in sequence.split())


class Sides(NamedTuple):
    """How the sequences on the two sides of a change differ: those on this side of it, and those beyond."""

    least: dict[str, int]  # how often a symbol, or a pair of symbols, occurs on the side on which it occurs less often
    more: dict[str, bool]  # whether it occurs more often on this side

    def here(self, sequence: str) -> bool:
        """Whether a sequence is one of this side."""
        return all(self._alike(sequence).values())

    def beyond(self, sequence: str) -> bool:
        """Whether a sequence is one of the other side.

        It is if it lacks all that goes there; if nothing goes, if it has all that comes. A sequence may belong to neither side.
        """
        alike = self._alike(sequence)
        going = [alike[symbol] for symbol, more in self.more.items() if more]
        return not any(going or alike.values())

    def described(self, sequence: str) -> str:
        """The symbols that go (-) and come (+) from the side of a sequence to the other one."""
        here = self.here(sequence)
        return " ".join(f"{'-' if more == here else '+'}{name.replace(' ', '/')}" for name, more in self.more.items())

    def between(self, a: str, b: str) -> bool:
        """Whether the change lies between two sequences."""
        return (self.here(a) and self.beyond(b)) or (self.here(b) and self.beyond(a))

    def _alike(self, sequence: str) -> dict[str, bool]:
        """Of each symbol, whether it occurs in a sequence as on this side."""
        counts = _counted(sequence)
        return {symbol: (counts[symbol] > least) == self.more[symbol] for symbol, least in self.least.items()}


def sides_of(this: str, beyond: str, begins: str = "") -> Sides:
    """How two sequences differ: in the symbols that occur, or in how often they do, or else in how often one follows another.

    Only symbols that begin with `begins` count.
    """
    old, new = _counted(this), _counted(beyond)
    differ = [symbol for symbol in sorted(old | new) if old[symbol] != new[symbol] and symbol.startswith(begins)]
    single = [symbol for symbol in differ if " " not in symbol]
    come_or_go = [symbol for symbol in single if not old[symbol] or not new[symbol]]
    decisive = come_or_go or single or differ
    return Sides(
        {symbol: min(old[symbol], new[symbol]) for symbol in decisive},
        {symbol: old[symbol] > new[symbol] for symbol in decisive},
    )


def _counted(sequence: str) -> Counter[str]:
    """How often each symbol occurs, and each pair."""
    symbols = sequence.split()
    return Counter(symbols) + Counter(f"{a} {b}" for a, b in pairwise(symbols))


class Passage:
    """The record of some forcing periods from a section point.

    Parameters
    ----------
    events, segments : ndarray
        Rows of the kernel's record; they belong to the passage.
    symbols : ndarray of int64
        Those of the events.
    read : Read
        What is read off the record.
    """

    def __init__(self, events: np.ndarray, segments: np.ndarray, symbols: np.ndarray, read: Read) -> None:
        self.events, self.segments, self.symbols, self.read = events, segments, symbols, read

    @cached_property
    def times(self) -> np.ndarray:
        """Phases since the section at which smooth phases begin [rad]."""
        return self.segments[:, PERIOD] * TURN + self.segments[:, PHASE]

    @property
    def hops(self) -> tuple[float, float]:
        """Longest time for which each end is off the plate, in the motion of which this is one period [rad]."""
        return self.read.hop_1, self.read.hop_2

    @property
    def _far(self) -> tuple[bool, bool]:
        one, two = (hop > HOP_LINE * TURN for hop in self.hops)
        return one, two

    @property
    def sequence(self) -> str:
        """The sequence of the motion of which this is one period."""
        return spelt(self.symbols.tobytes(), self._far)

    @property
    def whole_sequence(self) -> str:
        """The sequence with all bounces counted."""
        return spelt(self.symbols.tobytes(), self._far, whole=True)

    @property
    def mirrored_sequence(self) -> str:
        """The sequence with the ends in each other's place."""
        kinds, causes = np.divmod(self.symbols % SAME_IMPACT, PER_STATE)
        first, second = digits_of(kinds)
        symbols = self.symbols // SAME_IMPACT * SAME_IMPACT + PER_STATE * code_of(second, first) + causes
        return spelt(symbols.tobytes(), self._far[::-1])
