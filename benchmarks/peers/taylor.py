"""The peer on heyoka: Taylor series with events for each smooth phase, and a compiled law of its own (`law`) between two."""

from math import inf

import heyoka as hy
import numpy as np
from law import BEGUN, N_STATE, TIME, arrive, body_of, coordinates, cross, start_state
from phases import N_MOTION, N_PHASE, TIME_UP, integrator

from tests.limits.regular import FREE, SPACE

LONGEST = 0.125  # longest step of a contact, in forcing periods: forces follow the plate where the state may not
HOP = 1.5  # first step of a flight that leaves the plate, in times of the hop to be expected
# tolerance of its own impacts, slip that counts as none, cost of the close of a chatter: in units of the tolerance of the
# series, and at least [m/s]
ACCURACY = (0.01, 1e-16), (1.0, 1e-14), (4.0, 1e-16)
MAX_STEPS, MAX_DOUBLES, FOREVER = 100_000, 10_000, 1e300
STEPPED = (hy.taylor_outcome.success, hy.taylor_outcome.time_limit)


class Heyoka:
    """Runs of one scene (a mapping of parameters by name) at one tolerance of the Taylor series."""

    copies = 1

    def __init__(self, scene, tol):
        self.scene, self.tol = scene, tol
        self.body = body_of(scene, *(max(share * tol, least) for share, least in ACCURACY))
        self.row, self.space, self.modes = np.array(self.body), np.zeros(SPACE), np.zeros(2)
        self.doubles, self.start = np.zeros(MAX_DOUBLES), np.zeros(N_STATE)

    def follow(self, times):
        """Return states (n, 12) at ascending times, and the times of double impacts."""
        states = np.array([coordinates(self.body, state) for state in self._states(times, True)])
        return states, self.doubles[: self.count].copy()

    def run(self, end):
        """Run to one time without the place and the angle of the dimer, as the engine's timed runs."""
        for _ in self._states([end], False):
            pass

    def _states(self, times, with_path):
        """Yield the states at ascending times."""
        self.state = start_state(self.body, self.scene["beta0"], self.scene["xdot0"])
        self.modes[:], self.count, self.integrators, self.with_path = FREE, 0, {}, with_path
        self._cross(self.start, 0, TIME_UP)
        for t in times:
            while (event := self._phase(t - self.state[BEGUN])) != TIME_UP:
                self._cross(self.now.state, self.now.slots.start, event)
            state = self.state.copy()
            arrive(self.body, self.modes, self.now.state, self.now.slots.start, TIME_UP, state)
            yield state

    def _cross(self, ended, first, event):
        """Lead from one phase to the next."""
        self.count, self.hop = cross(
            self.row, self.space, self.state, self.modes, ended, first, event, self.doubles, self.count, self.start
        )
        if self.hop < 0.0:
            raise RuntimeError("no contact law holds")
        code = (self.modes[0], self.modes[1])
        now = self.integrators.get(code)
        if now is None:
            now = self.integrators[code] = integrator(*code, self.tol, self.with_path)
            now.pars[N_PHASE:] = self.row[:N_MOTION]
            now.pars[1] = self.body.slip_zero
        now.state[:] = self.start[now.slots]
        now.pars[0] = self.body.omega * self.state[BEGUN] + self.body.phi0
        now.taylor.time = 0.0
        now.taylor.reset_cooldowns()
        self.now = now

    def _phase(self, span):
        """Integrate the present phase until it has lasted `span` or an event ends it; return the event."""
        now, taylor = self.now, self.now.taylor
        now.pars[2] = span
        end = FOREVER if now.slip_clock else span
        outcome = hy.taylor_outcome.time_limit
        if self.hop > 0.0:
            outcome = taylor.step(min(HOP * self.hop, end))[0]
            self.hop = 0.0
        if outcome in STEPPED:
            longest = LONGEST / self.scene["f"] if now.forced else inf
            outcome = taylor.propagate_until(end, max_delta_t=longest, max_steps=MAX_STEPS)[0]
        self.state[TIME] = taylor.time
        if outcome == hy.taylor_outcome.time_limit:
            return TIME_UP
        if int(outcome) < 0 and -int(outcome) - 1 < len(now.numbers):
            return now.numbers[-int(outcome) - 1]
        raise RuntimeError(f"heyoka stopped with {outcome}")
