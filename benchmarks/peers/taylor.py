"""The peer on heyoka: Taylor series with events for each smooth phase, and a compiled law of its own (`law`) between two."""

import math
from functools import partial

import heyoka as hy
import law
import numpy as np
from blow import DESK
from passage import N_PATH, P_END, YTIME, body_of, start_state, state_at
from phases import N_OF_PHASE, TIME_UP, constants_of, integrator

from dimersweep.kernel.model.layout import FREE, N_STATE
from tests.checks.verbs import dimer, oracle_state
from tests.oracle.body import DEFAULTS

LONGEST = 0.125  # longest step of a contact, in forcing periods: forces follow the plate where the state may not
HOP = 1.5  # first step of a flight that leaves the plate, in times of the hop to be expected
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


class Heyoka:
    """heyoka with a law of its own, at one tolerance."""

    copies = 1

    def __init__(self, scene, tol):
        self.dm = dimer(**scene)
        accuracy = law.Accuracy(*(max(share * tol, least) for share, least in ACCURACY))
        cross = partial(law.cross, np.array([*body_of(scene), *accuracy]), np.zeros(N_PATH), np.zeros(DESK))
        self.full, self.bare = (March(scene, tol, cross, path) for path in (True, False))

    def follow(self, times):
        """States and times of double impacts."""
        states, doubles = self.full.to(times)
        return np.array([np.concatenate(oracle_state(self.dm, state)) for state in states]), doubles

    def run(self, end):
        """One run without the cyclic coordinates, as the engine's."""
        self.bare.to([end])
