"""The map of the fast part alone: the spin is put back at the start of each forcing period, as the plate rises.

Within a period the spin swings by some hundred times its loss, so a border depends in its sixth digit on where the spin is put
back. That place does not depend on the section, and so the border does not either.
"""

from dataclasses import dataclass

import numpy as np

from dimersweep.kernel.model.layout import PERIOD, PHASE, THETA
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import SPIN_COORDINATE, Image, ReturnMap
from dimersweep.runs.period_map import Section


@dataclass(eq=False)
class HeldMap(ReturnMap):
    """The return map with the spin put back to `spin` [rad/s]: all its fixed points close, the spin included.

    It is put back where the plate has the phase `back` [rad].
    """

    spin: float
    back: float = 0.0

    def let_go(self) -> ReturnMap:
        """The map in the same section with the spin let go: its passage is whole."""
        return ReturnMap(self.parameters, self.phase, self.modes, self.periods, self.rtol, self.tape)

    def image(self, z: np.ndarray) -> Image:
        """The image of a point; its spin is the one before it is put back [rad/s]."""
        state, row = self.state(z), self.row_at(self.back)
        since = (self.phase - self.back) % TURN  # of the section since the spin is put back
        for k in range(self.periods):
            state[PHASE] = since if k == 0 else 0.0
            state, modes, _ = self.tape.run(row, state, 1, self.rtol)
            there = Section(row, self.rtol, self.tape.space)
            point = there.point(state)
            spin = float(point[SPIN_COORDINATE]) * self.unit
            point[SPIN_COORDINATE] = self.spin / self.unit
            theta = state[THETA]
            state = there.held(there.state(point), modes)
            state[THETA] = theta
        state[PHASE], state[PERIOD] = TURN - since, 0.0
        state, modes, passage = self.tape.run(self.row, state, 1, self.rtol)
        self._same(modes)
        return Image(self.section.point(state)[self.free], spin, float(state[THETA]), passage)


def held(m: ReturnMap, spin: float, back: float = 0.0) -> HeldMap:
    """The map in the same section with the spin put back to `spin` [rad/s], where the plate has the phase `back` [rad]."""
    return HeldMap(m.parameters, m.phase, m.modes, m.periods, m.rtol, m.tape, spin, back)
