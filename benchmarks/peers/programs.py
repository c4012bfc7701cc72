"""The programs that are compared beside heyoka's (`taylor`): the engine, the slow oracle of the tests, and stiff springs.

Each takes a scene (parameters by name) and one setting of its accuracy, and has

    follow(times)   states (n, 12) at ascending times, columns as in `tests.checks.scenes`, and the times of double impacts
    run(end)        the same run to one time with nothing kept: what is timed
    copies          how many runs of the scene `run` makes at once
"""

import numpy as np

from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import CODES, N_CODES, N_OUT, OK
from dimersweep.parameters import Parameters
from tests import oracle
from tests.checks.scenes import engine_states
from tests.limits.hertz import contact_time, march
from tests.oracle.body import dimer

SPEED = 0.3  # approach speed of a double impact, for the duration of a contact of springs [m/s]


class Engine:
    """The engine at one `rtol`; timed without a record, many runs in a batch, as sweeps run it."""

    copies = 16

    def __init__(self, scene, rtol):
        self.scene, self.rtol = scene, rtol
        self.rows = np.tile(Parameters(**scene).row(), (self.copies, 1))
        self.out, self.codes = np.zeros((self.copies, N_OUT)), np.zeros((self.copies, N_CODES), np.int64)

    def follow(self, times):
        return engine_states(self.scene, times, self.rtol)

    def run(self, end):
        run_many(self.rows, round(end * self.scene["f"]), self.rtol, False, self.out, self.codes)
        assert (self.codes[:, CODES.index("status")] == OK).all()


class Oracle:
    """The oracle at one accuracy; it rests a bouncing end below the same number of m/s."""

    copies = 1

    def __init__(self, scene, rtol):
        self.scene, self.rtol = scene, rtol

    def follow(self, times):
        done = oracle.simulate(self.scene, times, rtol=self.rtol, v_rest=self.rtol)
        return done["samples"][:, 1:], np.array(done["t_double"])

    def run(self, end):
        """Make one run; the oracle cannot but keep its events."""
        self.follow([end])


class Springs:
    """Hertz springs of one stiffness [N m^-1.5], with so many time steps in the time scale of a contact."""

    copies = 1

    def __init__(self, scene, setting):
        self.scene, (self.stiffness, steps) = scene, setting
        self.dt = contact_time(dimer(scene), self.stiffness, SPEED) / steps

    def follow(self, times):
        return march(self.scene, times, self.stiffness, self.dt)

    def run(self, end):
        self.follow([end])
