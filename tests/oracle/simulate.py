"""One run: free motion, sustained contact and impacts, one after the other, each integrated as the equations stand."""

from collections.abc import Callable, Mapping, Sequence
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from . import body
from .contact import Instant, State, settle
from .friction import stick_excess
from .impact import apply
from .march import march

Array = NDArray[np.float64]

SCALE = np.array([0.01, 0.01, 0.01, 1, 1, 10, 0.1, 0.1, 0.1, 1, 1, 100])
STRIDE = 0.05  # longest step, in forcing periods: at rest the plate may throw the dimer off for a moment only
SLIP_ZERO, SLIP_FREE = 1e-10, 1e-9  # m/s; slip that counts as zero, slip at which a breaking contact is on its own


class Run:
    """The dimer, where it is, and what has happened so far."""

    def __init__(self, params: Mapping[str, float], t_samples: Sequence[float], rtol: float, v_rest: float) -> None:
        p = {**body.DEFAULTS, **params}
        self.d = d = body.dimer(params)
        self.rtol, self.v_rest = rtol, v_rest
        self.t, self.q, self.qdot = 0.0, np.zeros(6), np.zeros(6)
        self.q[3], self.q[4] = p.get("theta0", 0.0), p["beta0"] - d.beta_0
        self.qdot[:2] = p["xdot0"], p.get("ydot0", 0.0)
        self.qdot[3:] = p.get("thetadot0", 0.0), p.get("betadot0", 0.0), p.get("gammadot0", 0.0)
        self.qdot[:3] -= body.plate_velocity(d, 0.0)  # the start is told in the room, the coordinates are the plate's
        self.q[2] = max(0.0, -body.rise(d, self.q)) + p.get("gap0", 0.0)
        self.closed = {int(i) for i in np.flatnonzero(body.gaps(d, self.q) <= 0)}
        self.resting = set[int]()
        self.breaking: dict[int, Array] = {}
        self.t_samples = [float(t) for t in t_samples]
        self.samples: list[Array] = []
        self.t_double: list[float] = []
        self.events: list[dict[str, Any]] = []

    # instants

    def collide(self) -> None:
        """Resolve an impact, if a closed contact approaches, and find who rests on the plate afterwards."""
        closed = sorted(self.closed)
        if len(closed) == 2:
            self.q[2] = self.q[4] = 0.0
        before = body.gap_rates(self.d, self.q, self.qdot)
        if any(before[i] < 0 for i in closed):
            flags = [i in self.closed for i in (0, 1)]
            self.qdot, details = apply(self.d, self.q, self.qdot, flags, tol=max(1e-3 * self.rtol, 1e-13))
            kind = "double" if len(closed) == 2 else f"single {closed[0] + 1}"
            self.events.append({"t": self.t, "kind": kind, **details})
            if len(closed) == 2:
                self.t_double.append(self.t)
            self.breaking = {}
        after = body.gap_rates(self.d, self.q, self.qdot)
        self.resting = {i for i in closed if after[i] < self.v_rest}

    def zero_slip(self) -> list[int]:
        """Resting contacts whose slip counts as zero."""
        slip = body.slips(self.d, self.q, self.qdot)
        return [i for i in sorted(self.resting) if i not in self.breaking and np.hypot(*slip[i]) <= SLIP_ZERO]

    def clean(self, q: Array, qdot: Array, stuck: Sequence[int]) -> tuple[Array, Array]:
        """Remove what round-off and truncation left of zero gaps, gap rates and slips."""
        q, qdot = q.copy(), qdot.copy()
        if len(self.resting) == 2:
            q[2] = q[4] = 0.0
        elif self.resting == {0}:
            q[2] = 0.0
        elif self.resting == {1}:
            q[2] = -body.rise(self.d, q)
        rows = [(i, 0) for i in sorted(self.resting)] + [(i, a) for i in stuck for a in (1, 2)]
        if rows:
            J = np.array([body.jacobian(self.d, q)[row] for row in rows])
            response = np.linalg.solve(body.mass_matrix(self.d, q), J.T)
            qdot -= response @ np.linalg.lstsq(J @ response, J @ qdot, rcond=1e-10)[0]
        if len(self.resting) == 2:
            qdot[2] = qdot[4] = 0.0
        elif self.resting == {0}:
            qdot[2] = 0.0
        return q, qdot

    # smooth motion

    def watches(self, state: State) -> tuple[list[tuple[int, str]], Callable[[float, Array], Array]]:
        """Names and values of the events that end a smooth phase; the open gaps come first."""
        d, t0 = self.d, self.t
        opened = [i for i in (0, 1) if i not in state.active]
        # an end that is just leaving the plate starts from zero whatever round-off says
        offset = [body.gaps(d, self.q)[i] if i in self.closed else 0.0 for i in (0, 1)]
        rough = any(d.mu) or any(d.mu_h)
        free = [i for i in state.active if rough and i in state.breaking]
        slide = [i for i in state.active if rough and i not in state.breaking and i not in state.stick]
        names = [(i, "land") for i in opened] + [(i, "lift") for i in state.active]
        names += [(i, "free") for i in free] + [(i, "stop") for i in slide]
        names += [(i, "unstuck") for i in state.stick[:1]]
        weight = d.m * d.g

        def values(s: float, y: Array) -> Array:
            q, qdot = y[:6], y[6:]
            gap = body.gaps(d, q)
            out = [gap[i] - offset[i] for i in opened]
            if state.active:
                now = Instant(d, t0 + s, q, qdot)
                forces, _ = now.forces(state)
                out += [forces[i, 0] / weight for i in state.active]
                out += [SLIP_FREE - float(now.slip[i] @ state.breaking[i]) for i in free]
                out += [float(np.hypot(*now.slip[i])) - SLIP_ZERO for i in slide]
                if state.stick:
                    out.append(-stick_excess(forces, state.stick, d.mu_h, body.axial_direction(q)) / weight)
            return np.array(out)

        return names, values

    def first_step(self, state: State) -> float:
        """A tenth of the shortest hop about to begin, so that the first step does not jump over it."""
        now = Instant(self.d, self.t, self.q, self.qdot)
        rates, acc = body.gap_rates(self.d, self.q, self.qdot), now.forces(state)[1]
        hops = [
            -2 * rates[i] / acc[i, 0] for i in self.closed if i not in state.active and rates[i] > 0 and acc[i, 0] < 0
        ]
        return min([0.1 * float(h) for h in hops] + [1e-4])

    def move(self, state: State, t_end: float) -> list[tuple[int, str]]:
        """Integrate one smooth phase; take the samples on the way; return the events that ended it."""
        d, t0 = self.d, self.t
        opened = [i for i in (0, 1) if i not in state.active]

        def rhs(s: float, y: Array) -> Array:
            return np.concatenate([y[6:], Instant(d, t0 + s, y[:6], y[6:]).qddot(state)])

        def slopes(_: float, y: Array) -> Array:
            return body.gap_rates(d, y[:6], y[6:])[opened]

        def sample(s: float, dense: Callable[[float], Array]) -> None:
            while len(self.samples) < len(self.t_samples) and self.t_samples[len(self.samples)] <= t0 + s:
                t = self.t_samples[len(self.samples)]
                y = dense(t - t0)
                q, qdot = self.clean(y[:6], y[6:], state.stick)
                q[4] += d.beta_0
                self.samples.append(np.concatenate([[t], q, qdot]))

        names, values = self.watches(state)
        tol = max(1e-2 * self.rtol, 1e-13)
        span = t_end - t0
        solver = DOP853(
            rhs, 0.0, np.concatenate([self.q, self.qdot]), span,
            first_step=min(self.first_step(state), span), max_step=STRIDE * 2 * pi / d.omega, rtol=tol, atol=0.1 * tol * SCALE,
        )  # fmt: skip
        s, y, fired = march(solver, values, slopes, sample)
        self.t = t0 + s if fired else t_end
        self.resting = set(state.active)
        self.q, self.qdot = self.clean(y[:6], y[6:], state.stick)
        return [names[j] for j in fired]

    # the loop

    def run(self, t_end: float, limit: int = 20000) -> str:
        must_break, lifted, stopped = False, set[int](), set[int]()
        for _ in range(limit):
            self.collide()
            self.resting -= lifted
            zero = sorted({*self.zero_slip(), *(stopped & self.resting)})
            self.q, self.qdot = self.clean(self.q, self.qdot, zero)
            zero = sorted({*self.zero_slip(), *zero})  # a flat dimer's ends share the axial slip
            self.breaking = {i: u for i, u in self.breaking.items() if i in self.resting}
            state = settle(self.d, self.t, self.q, self.qdot, sorted(self.resting), zero, self.breaking, must_break)
            self.breaking = state.breaking
            fired = self.move(state, t_end)
            if not fired:
                return "done"
            must_break = all(name == "unstuck" for _, name in fired)
            lifted = {i for i, name in fired if name == "lift"}
            stopped = {i for i, name in fired if name == "stop"}
            for i, name in fired:
                self.events.append({"t": self.t, "kind": f"{name} {i + 1}"})
                if name == "free":
                    del self.breaking[i]
            self.closed = self.resting | {i for i, name in fired if name == "land"} | self.touching()
        return "too many events"

    def touching(self) -> set[int]:
        """Ends so close to the plate that a hop of that height would not be resolved."""
        gap = body.gaps(self.d, self.q)
        rates = body.gap_rates(self.d, self.q, self.qdot)
        return {i for i in (0, 1) if abs(gap[i]) <= self.v_rest**2 / (2 * self.d.g) and rates[i] <= 0}


def simulate(
    params: Mapping[str, float], t_samples: Sequence[float], rtol: float = 1e-9, v_rest: float = 1e-9
) -> dict[str, Any]:
    """Simulate one dimer from its release to the last sample.

    It starts with one end at gap0 over the plate, end 2 where beta0 is below level, ball 1 at rest in the room but for xdot0
    and ydot0.

    Parameters
    ----------
    params : mapping
        Names as `body.dimer` takes them; the paper's values where left out.
    t_samples : sequence of float
        Ascending times, s.
    rtol : float
        Accuracy aimed at, relative to the scales of the state; the integrators run at a hundredth of it.
    v_rest : float
        Separation speed below which a bouncing end counts as resting, m/s.

    Returns
    -------
    dict
        'samples' (n, 13): t, x1, y1, delta1, theta, beta, gamma and the six rates, SI, delta1 relative to the plate;
        't_double': times of the impacts that began with both contacts closed; 'events': a list of dicts with t, kind
        and, for impacts, gap rates before and after, impulses, final stick or slip; 'status': "done" if all went well.
    """
    run = Run(params, t_samples, rtol, v_rest)
    status = run.run(max(run.t_samples))
    return {"samples": np.array(run.samples), "t_double": run.t_double, "events": run.events, "status": status}
