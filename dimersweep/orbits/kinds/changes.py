"""Changes of the word of an orbit."""

import numpy as np

from dimersweep.kernel.verdict.past import HOP_LINE
from dimersweep.orbits.branch import Mark
from dimersweep.orbits.kinds.kind import Change
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import Image
from dimersweep.orbits.word import Sides, longest_hop

HOP_ASIDE = 1e-9  # how far on this side of a hop of half a period its orbit lies, in forcing periods


def _changed(old: str, new: str) -> set[str]:
    """Symbols that only one of two words has."""
    return set(old.split()) ^ set(new.split())


def _only_far(old: str, new: str) -> bool:
    changed = _changed(old, new)
    return bool(changed) and all(symbol.startswith("far") for symbol in changed)


def _over_line(image: Image, end: int) -> float:
    """How much longer than half a period the longest hop of an end is, in forcing periods."""
    return longest_hop(image.passage.events, end, image.passage.times[-1]) / TURN - HOP_LINE


def _hop_over_line(sides: Sides) -> Mark | None:
    """How much longer than half a period the longest hop of an end is; none if the hops of both ends change."""
    if len(sides.least) != 1:
        return None
    (symbol,) = sides.least
    end, aside = int(symbol[-1]) - 1, HOP_ASIDE if sides.more[symbol] else -HOP_ASIDE
    return lambda _, image: _over_line(image, end) - aside


HOP = Change(
    name="hop",
    meaning="the longest hop of an end passes half a forcing period",
    leads=_only_far,
    begins="far",
    zero=_hop_over_line,
    lines=lambda image: np.array([_over_line(image, end) for end in (0, 1)]),
)
CHATTER = Change(
    name="chatter",
    meaning="the hops of an end begin or cease to die out",
    leads=lambda old, new: any(symbol.startswith(("chatter", "bounces")) for symbol in _changed(old, new)),
)
DOUBLE_IMPACT = Change(
    name="double_impact",
    meaning="the phases of the double impact change",
    leads=lambda old, new: any(symbol.startswith("DI") for symbol in _changed(old, new)),
)
LIFT_OFFS = Change(
    name="lift_off",
    meaning="the number of lift-offs changes",
    leads=lambda old, new: old.split().count("FM") != new.split().count("FM"),
)
STICK_SLIP = Change(
    name="stick_slip",
    meaning="the order of sticking and slipping changes",
    leads=lambda old, new: old != new,
)
WORD = Change(name="word", meaning="any of the changes of word", leads=lambda old, new: old != new)
CHANGES = (HOP, CHATTER, DOUBLE_IMPACT, LIFT_OFFS, STICK_SLIP)  # a change is of the first kind that leads to it


def change_of(old: str, new: str) -> Change:
    """The kind of change that leads from one word to another one."""
    return next(kind for kind in CHANGES if kind.leads(old, new))
