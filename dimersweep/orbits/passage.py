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
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.model.body import slip_at
from dimersweep.kernel.model.contact_code import CONTACT_STATES, digits_of
from dimersweep.kernel.model.event_row import E_AFTER, E_BEFORE, E_CAUSE, E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import (
    C_CHATTER_END,
    C_END,
    C_IMPACT,
    C_START,
    CB,
    DI_ENDS,
    DI_NONE,
    FREE,
    IMPACT,
    N1,
    PERIOD,
    PHASE,
    Dimer,
    State,
)
from dimersweep.kernel.record import BEFORE, SEGMENT_MODES, SEGMENT_SLIP
from dimersweep.kernel.verdict.past import HOP_LINE, double_end, ends_sticking

TURN = 2 * np.pi
MANY = 4  # bounces that do not die out are counted so far: beyond, their number changes without end


def sequence_of(events: np.ndarray, length: float, whole: bool = False) -> str:
    """The sequence of one period of a motion, so long [rad], from its events; a `whole` one has all its bounces counted."""
    symbols = _chatter_as_one(_symbols(events), len(events) if whole else MANY)
    # it begins at its first double impact, or without one at the rotation that sorts first
    turns = [symbols[k:] + symbols[:k] for k in range(len(symbols))] or [[]]
    begun = min(turns, key=lambda turn: (not (turn and turn[0].startswith("DI")), turn))
    far = [f"far.{end + 1}" for end in (0, 1) if longest_hop(events, end, length) > HOP_LINE * TURN]
    return " ".join(begun + far)


def _name(code: int) -> str:
    ends = digits_of(code)
    name = CONTACT_STATES[code]
    return name if 0 not in ends or not any(ends) else f"{name}.{1 if ends[0] else 2}"


def _symbols(events: np.ndarray) -> list[str]:
    """One symbol an impact or a change of contact."""
    symbols: list[str] = []
    last, last_time = 0, -1.0
    for row in events:
        cause, kind, time = int(row[E_CAUSE]), int(row[E_KIND]), row[E_PERIOD] * TURN + row[E_PHASE]
        if cause == C_IMPACT and max(digits_of(kind)) > IMPACT:
            name = _name(kind)
            if time == last_time and symbols and symbols[-1].startswith(("DI", "SI")):
                if not symbols[-1].endswith(name):
                    symbols[-1] += f">{name}"
            else:
                symbols.append(name)
            last, last_time = 0, time
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


def longest_hop(events: np.ndarray, end: int, length: float) -> float:
    """Longest time [rad] for which an end is off the plate."""
    struck = digits_of(events[:, E_KIND])[end] > IMPACT
    before, after = (digits_of(events[:, column])[end] for column in (E_BEFORE, E_AFTER))
    touched = (events[:, E_CAUSE] != C_START) & (struck | (before > 0) | (after > 0))
    if not touched.any():
        return 0.0
    times = (events[:, E_PERIOD] * TURN + events[:, E_PHASE])[touched]
    leaves = (after[touched] == 0) | (after[touched] > IMPACT)  # after each touch
    return float(np.diff(times, append=times[0] + length)[leaves].max(initial=0.0))


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
    """

    def __init__(self, events: np.ndarray, segments: np.ndarray) -> None:
        self.events, self.segments = events, segments
        self.times = segments[:, PERIOD] * TURN + segments[:, PHASE]  # phases since the section [rad]

    @cached_property
    def sequence(self) -> str:
        """The sequence of the motion of which this is one period."""
        return sequence_of(self.events, self.times[-1])

    @cached_property
    def whole_sequence(self) -> str:
        """The sequence with all bounces counted."""
        return sequence_of(self.events, self.times[-1], whole=True)

    @cached_property
    def bouncer(self) -> int:
        """The end that is in the air for longer: 0 or 1."""
        spans = np.diff(self.times)
        free = self.segments[:-1, SEGMENT_MODES : SEGMENT_MODES + 2] == FREE
        airborne = spans @ free
        return int(airborne[1] >= airborne[0])

    def last_impact(self, end: int) -> np.ndarray | None:
        """Kernel state right after the last impact of an end, or None if there is none."""
        (rows,) = np.nonzero(digits_of(self.events[:, E_KIND])[end] > IMPACT)
        if not rows.size:
            return None
        row = self.events[rows[-1]]
        at = np.searchsorted(self.times, row[E_PERIOD] * TURN + row[E_PHASE])
        if at >= len(self.segments):
            return None
        segment = self.segments[at]
        state = segment[: PERIOD + 1].copy()
        state[N1 : CB + 1] = segment[BEFORE:SEGMENT_SLIP]  # before the hops of a chatter were summed
        return state


def strike_of(passage: Passage, dm: Dimer) -> dict[str, Any]:
    """State after the impact that ends a period of a drift, the last one of the bouncer; NaN without one.

    That is `phase` since the section [rad], `speed` of the centre of mass [m s-1] and its angle `zeta` from the axis, in the
    sense from the end that is down to the other one [rad], and `di_end`, the friction of the end that is down and of the
    bouncer, see ``layout.DI_ENDS``.
    """
    bouncer = passage.bouncer
    state = passage.last_impact(bouncer)
    if state is None:
        return dict.fromkeys(("phase", "speed", "zeta"), float("nan")) | {"di_end": DI_ENDS[0]}
    s = State(*state.tolist())
    speed = float(np.hypot(s.ca, s.cb))
    zeta = float(np.arctan2(abs(s.cb), s.ca if bouncer == 1 else -s.ca)) if speed > 0 else float("nan")
    sticks = [ends_sticking(dm, *slip_at(dm, state, end)) for end in (0, 1)]
    end = double_end(sticks[1 - bouncer], sticks[bouncer]) if s.d1 == s.d2 == 0.0 else DI_NONE
    return {"phase": s.phase, "speed": speed, "zeta": zeta, "di_end": DI_ENDS[end]}
