"""The two peers on heyoka: Taylor series with events for each smooth phase, and a compiled law for what happens between two.

`Heyoka` has a law of its own (`law`), as its users would write it. `Borrower` takes all that happens at an instant from the
engine (`borrowed`): what is compared then is integration, the location of events and the passage between phases alone.
"""

import math
import time
from functools import partial

import borrowed
import heyoka as hy
import law
import numpy as np
from blow import DESK
from passage import N_PATH, P_END, YTIME, body_of, start_state, state_at
from phases import N_OF_PHASE, TIME_UP, constants_of, integrator

from dimersweep.inputs import RTOL_RANGE
from dimersweep.kernel.course import ROW_CONTACT, new_workspace
from dimersweep.kernel.model.layout import FREE, N_STATE
from dimersweep.kernel.record import no_record
from dimersweep.parameters import Parameters
from tests.checks.verbs import dimer, oracle_state
from tests.oracle.body import DEFAULTS

LONGEST = 0.125  # longest step of a contact, in forcing periods: forces follow the plate where the state may not
HOP = 1.5  # first step of a flight that leaves the plate, in times of the hop to be expected
IMPACTS = 100.0  # tolerance of the engine's impacts, in units of that of the series
# tolerance of its own impacts, slip that counts as none, cost of the close of a chatter, separation that is none in any
# case: in units of the tolerance of the series, and at least [m/s]
ACCURACY = (0.01, 1e-16), (1.0, 1e-14), (4.0, 1e-16), (0.0, 1e-14)
MAX_STEPS, FOREVER = 100_000, 1e300
MAX_DOUBLES = 10_000
STEPPED = (hy.taylor_outcome.success, hy.taylor_outcome.time_limit)


class March:
    """Runs of one scene.

    Parameters
    ----------
    scene : dict
        Parameters by name.
    tol : float
        Tolerance of the Taylor series.
    cross : callable
        What leads from one phase to the next.
    path : bool
        Whether x1, y1 and gamma are wanted.
    """

    def __init__(self, scene, tol, cross, path):
        self.tol, self.path = tol, path
        self.given, self.body = DEFAULTS | scene, body_of(scene)
        self.T = 1.0 / self.given["f"]
        self.modes, self.start, self.pars = np.zeros(2), np.zeros(N_STATE), np.zeros(N_OF_PHASE)
        self.doubles, self.y = np.zeros(MAX_DOUBLES), np.zeros(N_PATH)
        self.cross = cross
        self.constants = constants_of(self.body)

    def to(self, times):
        """States at ascending times, shape (n, N_STATE), and the times of the double impacts."""
        self.state = start_state(self.body, self.given["beta0"], self.given["xdot0"])
        self.modes[:] = FREE
        self.count, self.begun = 0, 0.0
        self.integrators = {}
        self._cross(self.start, TIME_UP, 0.0)
        states = np.empty((len(times), N_STATE))
        for k, t in enumerate(times):
            event, dt = self._phase(t - self.begun)
            while event != TIME_UP:
                self._cross(self.now.state, event, dt)
                event, dt = self._phase(t - self.begun)
            state_at(self.body, self.state, self.modes, self.now.state, event, dt, self.y, states[k])
        return states, self.doubles[: self.count].copy()

    def _cross(self, ended, event, dt):
        """From one phase to the next."""
        self.count, self.hop = self.cross(
            self.state, self.modes, ended, event, dt, self.doubles, self.count, self.start, self.pars
        )
        if self.hop < 0.0:
            raise RuntimeError("no contact law holds")
        self.begun += dt
        code = (self.modes[0], self.modes[1])
        now = self.integrators.get(code)
        if now is None:
            now = self.integrators[code] = integrator(*code, self.tol, self.path)
            now.constants[:] = self.constants
        now.state[:] = self.start[: now.state.size]
        now.pars[:] = self.pars
        now.taylor.time = 0.0
        now.taylor.reset_cooldowns()
        self.now = now

    def _phase(self, span):
        """Integrate the present phase until it has lasted `span` or an event ends it; the event and the duration so far."""
        now, taylor = self.now, self.now.taylor
        now.pars[P_END] = span
        end = FOREVER if now.slip_clock else span
        outcome = hy.taylor_outcome.time_limit
        if self.hop > 0.0:
            outcome = taylor.step(min(HOP * self.hop, end))[0]
            self.hop = 0.0
        if outcome in STEPPED:
            longest = LONGEST * self.T if now.forced else math.inf
            outcome = taylor.propagate_until(end, max_delta_t=longest, max_steps=MAX_STEPS)[0]
        dt = now.state[YTIME] if now.slip_clock else taylor.time
        if outcome == hy.taylor_outcome.time_limit:
            return TIME_UP, dt
        if int(outcome) < 0 and -int(outcome) - 1 < len(now.numbers):
            return now.numbers[-int(outcome) - 1], dt
        raise RuntimeError(f"heyoka stopped with {outcome}")


class _Peer:
    """heyoka at one tolerance."""

    copies = 1

    def __init__(self, scene, tol):
        self.dm = dimer(**scene)
        self.full, self.bare = (March(scene, tol, self.crossing(scene, tol), path) for path in (True, False))

    def follow(self, times):
        """States and times of double impacts."""
        states, doubles = self.full.to(times)
        return np.array([np.concatenate(oracle_state(self.dm, state)) for state in states]), doubles

    def run(self, end):
        """One run without the cyclic coordinates, as the engine's."""
        self.bare.to([end])


class Heyoka(_Peer):
    """heyoka with a law of its own."""

    def crossing(self, scene, tol):
        """What leads from one phase to the next."""
        accuracy = law.Accuracy(*(max(share * tol, least) for share, least in ACCURACY))
        return partial(law.cross, np.array([*body_of(scene), *accuracy]), np.zeros(N_PATH), np.zeros(DESK))


class Borrower(_Peer):
    """heyoka with the engine's impacts, close of a chatter and choice of contact modes."""

    def crossing(self, scene, tol):
        """What leads from one phase to the next."""
        self.rtol = min(max(IMPACTS * tol, RTOL_RANGE[0]), RTOL_RANGE[1])
        self.row, self.constants = Parameters(**scene).row(), np.array(body_of(scene))
        self.space, self.log = new_workspace(), no_record().log
        return partial(borrowed.cross, self.constants, self.row, self.rtol, self.space, self.log)

    def borrowed_seconds(self, end):
        """Processor time that what is borrowed takes of one run: all its instants, settled once more in one compiled loop."""
        march, instants = self.bare, []
        cross = march.cross

        def recording(state, modes, ended, event, dt, *rest):
            before = state.copy(), modes.copy()
            lost = borrowed.arrive(self.constants, *before, ended, event, dt, self.space.work.rows[ROW_CONTACT])
            instants.append((*before, lost))
            return cross(state, modes, ended, event, dt, *rest)

        march.cross = recording
        self.run(end)
        march.cross = cross
        states, modes, lost = (np.array(each) for each in zip(*instants, strict=True))
        return min(self._settling(states, modes, lost) for _ in range(5))

    def _settling(self, states, modes, lost):
        arguments = self.row, states.copy(), modes.copy(), lost, self.rtol, self.space, self.log
        begun = time.process_time()
        borrowed.settle_all(*arguments)
        return time.process_time() - begun
