"""One passage through a motion: its record, and what is read from it.

The axial spin of an orbit is that after its last impact in a period (of the drift: the end of the double impact), as
`Run.orbit` has it. The bouncer is the end that is in contact for less of the time.
"""

from functools import cached_property
from typing import Any

import numpy as np

from dimersweep.kernel.model.body import slip_at
from dimersweep.kernel.model.contact_code import digits_of
from dimersweep.kernel.model.event_row import E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DI_ENDS, DI_NONE, FREE, IMPACT, N1, PERIOD, PHASE, Dimer
from dimersweep.kernel.record import BEFORE, SEGMENT_MODES
from dimersweep.kernel.verdict.past import double_end, ends_sticking
from dimersweep.orbits.word import TURN, word_of


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
    def word(self) -> str:
        """The word of the motion of which this is one period."""
        return word_of(self.events, self.times[-1])

    @cached_property
    def whole_word(self) -> str:
        """The word with all bounces counted."""
        return word_of(self.events, self.times[-1], whole=True)

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
        state[N1 : CB + 1] = segment[BEFORE:]  # before the hops of a chatter were summed
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
    speed = float(np.hypot(state[CA], state[CB]))
    zeta = float(np.arctan2(abs(state[CB]), state[CA] if bouncer == 1 else -state[CA])) if speed > 0 else float("nan")
    sticks = [ends_sticking(dm, *slip_at(dm, state, end)) for end in (0, 1)]
    end = double_end(sticks[1 - bouncer], sticks[bouncer]) if state[D1] == state[D2] == 0.0 else DI_NONE
    return {"phase": float(state[PHASE]), "speed": speed, "zeta": zeta, "di_end": DI_ENDS[end]}
