"""The map of the fast part alone: the spin is put back at the start of each forcing period, as the plate rises.

Within a period the spin swings by some hundred times its loss, so a border depends in its sixth digit on where the spin is put
back. That place does not depend on the section, and so the border does not either.
"""

from dataclasses import dataclass

import numpy as np

from dimersweep.kernel.model.layout import PERIOD, PHASE, THETA
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import SPIN_COORDINATE, Image, ReturnMap
from dimersweep.runs.stability import Section


@dataclass(eq=False)
class HeldMap(ReturnMap):
    """The return map with the spin put back to `spin` [rad/s]: all its fixed points close, the spin included."""

    spin: float

    def let_go(self) -> ReturnMap:
        """The map in the same section with the spin let go: its passage is whole."""
        return ReturnMap(self.parameters, self.phase, self.modes, self.periods, self.rtol, self.tape)

    def image(self, z: np.ndarray) -> Image:
        """The image of a point; its spin is the one at the start of the period, before it is put back [rad/s]."""
        state, row = self.state(z), self.row_at(0.0)
        for k in range(self.periods):
            state[PHASE] = self.phase if k == 0 else 0.0
            state, modes, _ = self.tape.run(row, state, 1, self.rtol)
            there = Section(self.parameters, row, self.rtol, self.tape.space)
            point = there.point(state)
            spin = float(point[SPIN_COORDINATE]) * self.unit
            point[SPIN_COORDINATE] = self.spin / self.unit
            theta = state[THETA]
            state = there.held(there.state(point), modes)
            state[THETA] = theta
        state[PHASE], state[PERIOD] = TURN - self.phase, 0.0
        state, modes, passage = self.tape.run(self.row, state, 1, self.rtol)
        self._same(modes)
        return Image(self.section.point(state)[self.free], spin, float(state[THETA]), passage)


def held(m: ReturnMap, spin: float) -> HeldMap:
    """The map in the same section with the spin put back to `spin` [rad/s]."""
    return HeldMap(m.parameters, m.phase, m.modes, m.periods, m.rtol, m.tape, spin)
