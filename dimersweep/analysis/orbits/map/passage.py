"""The record of a motion from a section to its image, and the symbol sequence that is read off it.

The axial spin of an orbit is the spin after the last impact of the bouncer in a period, as in `Run.orbit`. In the drift
this impact is the end of the double impact. The bouncer is the end that is in contact for the shorter time.

The symbol sequence, sequence for short, lists the contact states of a period in their order, from the double impact on.
Its symbols are:

* ``SC_sk.1``: a state of sustained contact, with its end;
* ``DI_sp_sp>DI_sp_sk``: an impact, with all its contact states;
* ``bounces.1``: an impact of one end, with the number of such impacts in a row;
* ``chatter.1``: hops that die out;
* ``FM``: a lift-off;
* ``far.2``: last, an end in the air for more than half a forcing period, from which on a ball counts as flying.
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
# highest count of bounces in a row in a sequence: without a bound, the sequence of an end whose hops nearly die out
# would change without end along a branch
MANY = 4
SPELT_ONCE = 4096  # sequences that are kept after they are spelt; the number decides on time alone


@lru_cache(SPELT_ONCE)
def spelt(codes: bytes, far: tuple[bool, bool], whole: bool = False) -> str:
    """Return the sequence of a period in words.

    Parameters
    ----------
    codes : bytes
        Symbols of the events of the period, int64, see ``kernel.passage``.
    far : tuple of bool
        True for each end that is in the air for more than half a forcing period.
    whole : bool
        Count all bounces in a row, not only up to `MANY`.
    """
    events = np.frombuffer(codes, dtype=np.int64).tolist()
    symbols = _chatter_as_one(_symbols(events), len(events) if whole else MANY)
    # which event of the period comes first depends on the section, and the sequence must not: it begins at a double
    # impact; of several, or without one, at the rotation that sorts first
    turns = [symbols[k:] + symbols[:k] for k in range(len(symbols))] or [[]]
    begun = min(turns, key=lambda turn: (not (turn and turn[0].startswith("DI")), turn))
    return " ".join(begun + [f"far.{end + 1}" for end in (0, 1) if far[end]])


def _name(code: int) -> str:
    """Return the name of a contact state, with the number of the end if only one end is in contact."""
    ends = digits_of(code)
    name = CONTACT_STATES[code]
    return name if 0 not in ends or not any(ends) else f"{name}.{1 if ends[0] else 2}"


def _symbols(events: Sequence[int]) -> list[str]:
    """Return a symbol for each impact and each change of contact, from the codes of the events."""
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
    """Return the symbols with the bounces of each chatter joined to one symbol.

    Other impacts of one end in a row become one symbol, with their number up to `most`.
    """
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
    """Return the number of ends that are in the air for more than half a forcing period at a time."""
    return sum(symbol.startswith("far") for symbol in sequence.split())


def rests(sequence: str) -> bool:
    """Return True if an end stays on the plate for a part of the period."""
    return any(symbol.startswith(("SC", "DC")) for symbol in sequence.split())


class Sides(NamedTuple):
    """The difference between the sequences on this side of a change and the sequences beyond it."""

    # number of a symbol, or of a pair of neighbouring symbols, in a sequence of the side where it occurs less often
    least: dict[str, int]
    more: dict[str, bool]  # True if the symbol or pair occurs more often on this side

    def here(self, sequence: str) -> bool:
        """Return True if a sequence belongs to this side."""
        return all(self._alike(sequence).values())

    def beyond(self, sequence: str) -> bool:
        """Return True if a sequence belongs to the other side.

        It then has none of the symbols that end at the change or, if none ends there, all symbols that begin there. A
        sequence may belong to neither side.
        """
        alike = self._alike(sequence)
        going = [alike[symbol] for symbol, more in self.more.items() if more]
        return not any(going or alike.values())

    def described(self, sequence: str) -> str:
        """Return in words which symbols end (-) and begin (+) at the change, seen from the side of a sequence."""
        here = self.here(sequence)
        return " ".join(f"{'-' if more == here else '+'}{name.replace(' ', '/')}" for name, more in self.more.items())

    def between(self, a: str, b: str) -> bool:
        """Return True if two sequences belong to different sides of the change."""
        return (self.here(a) and self.beyond(b)) or (self.here(b) and self.beyond(a))

    def _alike(self, sequence: str) -> dict[str, bool]:
        """Return, for each symbol or pair that differs, True if a sequence has it as the sequences of this side do."""
        counts = _counted(sequence)
        return {symbol: (counts[symbol] > least) == self.more[symbol] for symbol, least in self.least.items()}


def sides_of(this: str, beyond: str, begins: str = "") -> Sides:
    """Return the difference between a sequence on this side of a change and a sequence beyond it.

    They differ in the symbols that occur, else in how often a symbol occurs, else in how often one symbol follows
    another. Only symbols that begin with `begins` are compared.
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
    """Count each symbol of a sequence, and each pair of neighbouring symbols."""
    symbols = sequence.split()
    return Counter(symbols) + Counter(f"{a} {b}" for a, b in pairwise(symbols))


class Passage:
    """The record of the forcing periods from a point of a section to its image.

    Parameters
    ----------
    events, segments : ndarray
        Rows of the kernel's record; the passage keeps the arrays, which nobody else may change.
    symbols : ndarray of int64
        Symbols of the events, see ``kernel.passage``.
    read : Read
        Numbers that are read off the record.
    point : ndarray, shape (n,)
        Image in the coordinates that are free in the section; empty for a run that was not asked for it.
    """

    def __init__(
        self, events: np.ndarray, segments: np.ndarray, symbols: np.ndarray, read: Read, point: np.ndarray
    ) -> None:
        self.events, self.segments, self.symbols, self.read, self.point = events, segments, symbols, read, point

    @property
    def spin(self) -> float:
        """Spin after the last impact of the bouncer or, without one, at the end before it is put back [rad/s]."""
        return self.read.spin

    @property
    def theta(self) -> float:
        """Change of theta over the passage [rad]."""
        return self.read.theta

    @cached_property
    def times(self) -> np.ndarray:
        """Phases since the section at which smooth phases begin [rad]."""
        return self.segments[:, PERIOD] * TURN + self.segments[:, PHASE]

    @property
    def hops(self) -> tuple[float, float]:
        """Longest time for which each end is off the plate [rad], in the motion that repeats the passage."""
        return self.read.hop_1, self.read.hop_2

    @property
    def _far(self) -> tuple[bool, bool]:
        one, two = (hop > HOP_LINE * TURN for hop in self.hops)
        return one, two

    @property
    def sequence(self) -> str:
        """Sequence of the motion that repeats the passage, with bounces in a row counted up to `MANY`."""
        return spelt(self.symbols.tobytes(), self._far)

    @property
    def whole_sequence(self) -> str:
        """Sequence with all bounces counted."""
        return spelt(self.symbols.tobytes(), self._far, whole=True)

    @property
    def mirrored_sequence(self) -> str:
        """Sequence with the ends exchanged: that of the mirror image of the motion."""
        kinds, causes = np.divmod(self.symbols % SAME_IMPACT, PER_STATE)
        first, second = digits_of(kinds)
        symbols = self.symbols // SAME_IMPACT * SAME_IMPACT + PER_STATE * code_of(second, first) + causes
        return spelt(symbols.tobytes(), self._far[::-1])
