"""The two programs of this repository: the engine, through the entry that sweeps use, and the slow oracle of the tests."""

import numpy as np

from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import (
    CODES,
    N_CODES,
    N_OUT,
    OK,
)
from dimersweep.parameters import Parameters
from tests import oracle
from tests.checks.scenes import engine_states


class Engine:
    """The engine at one `rtol`; timed without a record, many runs in a batch."""

    copies = 16

    def __init__(self, scene, rtol):
        self.scene, self.rtol = scene, rtol
        self.rows = np.tile(Parameters(**scene).row(), (self.copies, 1))
        self.out, self.codes = np.zeros((self.copies, N_OUT)), np.zeros((self.copies, N_CODES), np.int64)

    def follow(self, times):
        """States and times of double impacts."""
        return engine_states(self.scene, times, self.rtol)

    def run(self, end):
        """A batch of unrecorded runs, each to its end."""
        run_many(self.rows, round(end * self.scene["f"]), self.rtol, False, self.out, self.codes)
        assert (self.codes[:, CODES.index("status")] == OK).all()


class Oracle:
    """The oracle at one accuracy; it rests a bouncing end below the same number of m/s."""

    copies = 1

    def __init__(self, scene, rtol):
        self.scene, self.rtol = scene, rtol

    def follow(self, times):
        """States and times of double impacts."""
        done = oracle.simulate(self.scene, times, rtol=self.rtol, v_rest=self.rtol)
        return done["samples"][:, 1:], np.array(done["t_double"])

    def run(self, end):
        """One run; the oracle cannot but keep its events."""
        oracle.simulate(self.scene, [end], rtol=self.rtol, v_rest=self.rtol)
