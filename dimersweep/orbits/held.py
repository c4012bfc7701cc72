"""The fast part with the spin put back at the start of each forcing period, where the plate passes its mean upwards.

A flip is told of the fast part, so it matters, in the sixth digit, where the spin is held: the spin swings within a period by
some hundred times what it loses. Here it is held where a forcing period starts, whatever the section.
"""

import numpy as np

from dimersweep.kernel.model.layout import PERIOD, PHASE, SPIN, THETA
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.return_map import SPIN_COORDINATE, Image, ReturnMap
from dimersweep.runs.stability import Section


class HeldMap(ReturnMap):
    """The return map, whose spin is that at the start of a forcing period."""

    def image(self, z: np.ndarray) -> Image:
        """The image of a point; its spin is that where the plate first passes phase zero [rad/s]."""
        start, _ = self.to_start(z)
        return self.from_start(start)

    def to_start(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Kernel state and friction modes where the next forcing period starts."""
        state = self.state(z)
        state[PHASE] = self.phase
        state, modes, _ = self.tape.run(self.row_at(0.0), state, 1, self.rtol)
        return state, modes

    def from_start(self, start: np.ndarray) -> Image:
        """The image from there on."""
        spin = float(start[SPIN])
        start = start.copy()
        start[PHASE], start[PERIOD] = TURN - self.phase, 0.0
        state, modes, passage = self.tape.run(self.row, start, self.periods, self.rtol)
        self._same(modes)
        return Image(self.section.point(state)[self.free], spin, float(state[THETA]), passage)

    def kick(self, z: np.ndarray) -> np.ndarray:
        """Derivative of the image by the spin at the start of the period (in its unit), all else there as it is."""
        start, modes = self.to_start(z)
        there = Section(self.parameters, self.row, self.rtol, self.tape.space)
        point, images = there.point(start), []
        for sign in (1.0, -1.0):
            moved = point.copy()
            moved[SPIN_COORDINATE] += sign * self.step
            images.append(self.from_start(there.held(there.state(moved), modes)).point)
        return (images[0] - images[1]) / (2 * self.step)
