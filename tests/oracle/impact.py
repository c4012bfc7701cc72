"""The impact law, eqs. (5)-(7), integrated directly in its regular form.

With F_i = k_i X_i^eta and E_i = k_i X_i^(eta + 1) / (eta + 1), one variable tau with dP_i = F_i dtau serves all contacts:
dX_i/dtau = -delta_i' while compressing, -delta_i'/e_i^2 while restituting. The state is the impulses and the X_i; every
switch (compression, restitution, end, slip, stick, breaking away) is located and the integration restarted there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, LSODA, solve_ivp

from . import body
from .friction import hold_or_break, stick_excess
from .march import TooManySteps, march

Array = NDArray[np.float64]

SLIP_ZERO = 1e-10  # slip speed that counts as zero, in units of the approach speed
SLIP_NOISE = 1e-13  # m/s; slip speed that is round-off however slow the approach
SLIP_FREE = 10.0  # slip speed, in units of the one that counts as zero, at which a breaking contact is on its own
SPEED_LOST = 1e-10  # gap rate that counts as zero where both contacts lose all their energy, same units
COMPRESS, RESTITUTE, IDLE = "compress", "restitute", "idle"


@dataclass
class Law:
    """What the contacts of an impact obey, each in the order of the contacts."""

    e: Sequence[float]  # energetic restitution
    mu: Sequence[float]
    mu_s: Sequence[float]
    k: Sequence[float]  # stiffness, in any unit
    eta: float  # exponent: the force is k X^eta


class _Impact:
    """One impact in units of the approach speed and the normal compliance; `c` are contact velocities, shape (k, 3)."""

    def __init__(self, G: Array, c: Array, law: Law, axial: Array, tol: float, slip_zero: float) -> None:
        self.k, self.c, self.law, self.slip_zero = len(c), c.copy(), law, slip_zero
        self.flat_G = G.reshape(3 * self.k, 3 * self.k)
        self.axial, self.tol = axial, tol
        self.held: dict[tuple[int, ...], tuple[Array, Array]] = {}
        self.rough = any(law.mu) or any(law.mu_s)
        self.X = np.zeros(self.k)
        self.P = np.zeros((self.k, 3))
        self.work = np.zeros((2, self.k))  # of the normal forces and of friction
        self.normal = [COMPRESS if rate < 0 else IDLE for rate in c[:, 0]]
        if self.rough and self.k == 2:  # flat: the ends share the axial velocity, to the last digit
            shared = self.c[:, 1:] @ axial
            self.c[:, 1:] += np.outer(shared.mean() - shared, axial)
        self.zero = {i for i in range(self.k) if np.hypot(*self.c[i, 1:]) <= slip_zero}
        self.stick: list[int] = []
        self.breaking: dict[int, Array] = {}
        self.log: list[str] = []

    def normal_forces(self, X: Array) -> Array:
        """k X^eta of each contact."""
        return np.asarray(self.law.k) * np.maximum(X, 0) ** self.law.eta

    def force_sizes(self) -> Array:
        """Normal forces for the decisions, or their ratios in the limit where all begin; never quite zero."""
        f = self.normal_forces(self.X)
        if not f.any():
            f = self.normal_forces(-self.c[:, 0])
        newly = np.array([n == COMPRESS for n in self.normal]) & (f == 0)
        return np.where(newly, 1e-9 * f.max(), f)

    def respond(self, f: Array, stick: Sequence[int], slip: Mapping[int, Array]) -> tuple[Array, Array]:
        """Forces and contact accelerations (d/dtau) for given normal forces."""
        forces = np.zeros((self.k, 3))
        forces[:, 0] = f
        for i, u in slip.items():
            forces[i, 1:] = -self.law.mu[i] * f[i] * u
        acc = (self.flat_G @ forces.ravel()).reshape(self.k, 3)
        if stick:
            response, inverse = self.holds(tuple(stick))
            t = -inverse @ acc[list(stick), 1:].ravel()
            forces[list(stick), 1:] = t.reshape(-1, 2)
            acc = acc + (response @ t).reshape(self.k, 3)
        return forces, acc

    def holds(self, stick: tuple[int, ...]) -> tuple[Array, Array]:
        """Response to the forces that hold the contacts in `stick`, and the inverse of its part at those contacts.

        Two stuck ends of a flat dimer share one axial velocity: the pseudo-inverse splits that force, which leaves the
        motion unique.
        """
        if stick not in self.held:
            index = [3 * i + a for i in stick for a in (1, 2)]
            response = self.flat_G[:, index]
            self.held[stick] = response, np.asarray(np.linalg.pinv(response[index], rcond=1e-10), dtype=float)
        return self.held[stick]

    def sliding(self, c: Array) -> dict[int, Array]:
        """Slip directions of the contacts that slide (not held, not just breaking away) and may carry force."""
        out = dict(self.breaking)
        for i in range(self.k):
            if i not in self.zero and i not in out and self.normal[i] != IDLE:
                speed = hypot(*c[i, 1:])
                out[i] = c[i, 1:] / speed if speed > 0 else np.zeros(2)
        return out

    def decide(self, must_break: bool) -> None:
        """Stick or break away, for every contact with force and zero slip; a contact without force holds nothing."""
        if not self.rough:
            return
        f = self.force_sizes()
        loaded = [i for i in sorted(self.zero) if self.normal[i] != IDLE]
        choice = hold_or_break(
            lambda stick, slip: self.respond(f, stick, slip),
            loaded, self.sliding(self.c), self.law.mu_s, self.axial, must_break,
        )  # fmt: skip
        if choice is None:
            raise RuntimeError("no consistent slip direction in the impact")
        self.stick, new = choice
        self.breaking.update(new)
        self.zero -= set(new)
        self.c[self.stick, 1:] = 0.0

    def wake_idle(self) -> bool:
        """A contact at rest on the plate that the others press down begins to be compressed."""
        _, acc = self.respond(self.force_sizes(), self.stick, self.sliding(self.c) if self.rough else {})
        woken = [i for i in range(self.k) if self.normal[i] == IDLE and abs(self.c[i, 0]) < 1e-13 and acc[i, 0] < 0]
        for i in woken:
            self.normal[i] = COMPRESS
        return bool(woken)

    def dissipated(self) -> bool:
        """With e = 0 two contacts lose what is left in a geometric series of switches: cut it where nothing is left."""
        slow = float(np.abs(self.c[:, 0]).max()) < SPEED_LOST
        return bool(self.log) and slow and float(self.X.max()) < SPEED_LOST ** (2 / (self.law.eta + 1))

    def watched(self) -> list[tuple[int, str]]:
        """Contact and name of the events that can end the present phase."""
        turn = {COMPRESS: ["turned"], RESTITUTE: ["ended", "recompressed"], IDLE: ["compressed"]}
        names = [(i, name) for i in range(self.k) for name in turn[self.normal[i]]]
        if self.rough:
            names += [(i, "free") for i in self.breaking]
            slide = [
                i for i in range(self.k) if self.normal[i] != IDLE and i not in self.zero and i not in self.breaking
            ]
            names += [(i, "stopped") for i in slide] + [(i, "unstuck") for i in self.stick[:1]]
        return names

    def gauge(self, i: int, name: str, c: Array, X: Array, forces: Array) -> float:
        """Value that falls through zero where the named event happens."""
        if name == "turned":
            return -float(c[i, 0])
        if name == "ended":
            return float(X[i])
        if name in ("recompressed", "compressed"):
            return float(c[i, 0])
        if name == "free":
            return SLIP_FREE * self.slip_zero - float(c[i, 1:] @ self.breaking[i])
        if name == "stopped":
            return hypot(*c[i, 1:]) - self.slip_zero
        # unstuck: relative to the total force, as all force vanishes at both ends of an impact
        total = float(forces[:, 0].sum())
        return -stick_excess(forces, self.stick, self.law.mu_s, self.axial) / total if total > 0 else 1.0

    def run_phase(self) -> list[tuple[int, str]]:
        """Integrate to the next switch; return contact and name of what happened, for each event there."""
        k, c0 = self.k, self.c.copy()

        def unpack(y: Array) -> tuple[Array, Array, Array]:
            X = y[3 * k : 4 * k]
            c = c0 + (self.flat_G @ y[: 3 * k]).reshape(k, 3)
            forces, _ = self.respond(self.normal_forces(X), self.stick, self.sliding(c) if self.rough else {})
            return c, X, forces

        def rhs(_: float, y: Array) -> Array:
            c, _X, forces = unpack(y)
            powers = forces * c
            factor = [{COMPRESS: -1.0, IDLE: 0.0}.get(n) for n in self.normal]
            dX = [(-1 / self.law.e[i] ** 2 if a is None else a) * c[i, 0] for i, a in enumerate(factor)]
            return np.concatenate([forces.ravel(), dX, powers[:, 0], powers[:, 1:].sum(1)])

        names = self.watched()

        def events(_: float, y: Array) -> Array:
            c, X, forces = unpack(y)
            return np.array([self.gauge(i, name, c, X, forces) for i, name in names])

        y0 = np.concatenate([np.zeros(3 * k), self.X, np.zeros(2 * k)])
        options: dict[str, Any] = {
            "t0": 0.0,
            "y0": y0,
            "t_bound": 1e4,
            "first_step": 1e-5,
            "rtol": self.tol,
            "atol": self.tol * 1e-2,
        }
        method = DOP853
        try:
            tau, y, fired = march(DOP853(rhs, **options), events, parts=2, max_steps=2000)
        except TooManySteps:  # a slip that stays slow is stiff
            method = LSODA
            tau, y, fired = march(LSODA(rhs, **options), events, parts=2)
        if any(names[j][1] == "ended" for j in fired):  # the last step went on without force, which is not smooth there
            y = solve_ivp(
                rhs, (0.0, tau), y0, method, rtol=self.tol, atol=self.tol * 1e-2, first_step=min(1e-5, tau)
            ).y[:, -1]
        self.c, X, _ = unpack(y)
        self.X = np.maximum(X, 0)
        self.P += y[: 3 * k].reshape(k, 3)
        self.work += y[4 * k :].reshape(2, k)
        if not fired:
            raise RuntimeError("the impact does not end")
        # an idle contact's slip is not held by anything
        slow = {i for i in range(k) if np.hypot(*self.c[i, 1:]) <= self.slip_zero}
        self.zero = (slow - set(self.breaking)) | set(self.stick)
        return [names[j] for j in fired]

    def switch(self, i: int, name: str) -> None:
        """Change the discrete state after an event."""
        if name == "turned":
            self.c[i, 0] = 0.0
            self.normal[i] = RESTITUTE
            if self.law.e[i] == 0:  # all of the stored energy is lost at once
                self.X[i], self.normal[i] = 0.0, IDLE
        elif name == "ended":
            self.X[i], self.normal[i] = 0.0, IDLE
        elif name in ("recompressed", "compressed"):
            self.c[i, 0] = 0.0
            self.normal[i] = COMPRESS
        elif name == "free":
            del self.breaking[i]
        elif name == "stopped":
            self.halt(i)
        if self.normal[i] == IDLE:
            self.breaking.pop(i, None)

    def halt(self, i: int) -> None:
        """Set a slip to zero; the ends of a flat dimer share the axial velocity, so the other end's goes too."""
        self.c[i, 1:] = 0.0
        self.c[:, 1:] -= np.outer(self.c[:, 1:] @ self.axial, self.axial)
        self.zero |= {j for j in range(self.k) if j not in self.breaking and np.hypot(*self.c[j, 1:]) <= self.slip_zero}

    def run(self) -> None:
        must_break = False
        for _ in range(2000):
            self.stick = []
            self.decide(must_break)
            if self.wake_idle():
                self.decide(False)
            if all(n == IDLE for n in self.normal) or self.dissipated():
                return
            fired = self.run_phase()
            must_break = all(name == "unstuck" for _, name in fired)
            for i, name in fired:
                self.log.append(f"{name} {i + 1}")
                self.switch(i, name)
        raise RuntimeError("too many switches in one impact")


def resolve(G: Array, c: Array, law: Law, axial: Array, tol: float = 1e-11) -> tuple[Array, dict[str, Any]]:
    """Impulses of an impact at k contacts.

    Parameters
    ----------
    G : (k, 3, k, 3) array
        Delassus blocks, kg^-1; rows and columns normal, x, y of each contact.
    c : (k, 3) array
        Contact velocities before: gap rate, x, y, m/s.
    law : Law
        Where all friction coefficients are zero there are normal impulses only, for any k.
    axial : (2,) array
        Heading of the dimer's axis.
    tol : float
        Relative tolerance of the integration.

    Returns
    -------
    P : (k, 3) array
        Impulses, N s.
    details : dict
        'stuck' (contacts without slip at the end), 'log' (the switches), 'work' of the normal forces and of friction, J.
    """
    G, c = np.asarray(G, dtype=float), np.asarray(c, dtype=float)
    first = int(np.argmin(c[:, 0]))
    speed, compliance = -c[first, 0], G[first, 0, first, 0]
    if speed <= 0:
        return np.zeros_like(c), {"stuck": [], "log": [], "work": np.zeros((2, len(c)))}
    slip_zero = max(SLIP_ZERO, SLIP_NOISE / speed)
    state = _Impact(G / compliance, c / speed, law, axial, tol, slip_zero)
    state.run()
    stuck = [i for i in range(len(c)) if i in state.zero]
    details = {"stuck": stuck, "log": state.log, "work": state.work * speed**2 / compliance}
    return state.P * speed / compliance, details


def apply(
    d: body.Dimer, q: Array, qdot: Array, closed: Sequence[bool], tol: float = 1e-11
) -> tuple[Array, dict[str, Any]]:
    """Velocities after the impact of the closed contacts; see `impact`."""
    contacts = [i for i in (0, 1) if closed[i]]
    if len(contacts) == 2 and q[4] != 0:
        raise ValueError("both contacts can be closed at level only")
    G, response = body.delassus(d, q)
    c = np.einsum("iak,k->ia", body.jacobian(d, q), qdot)
    P, details = resolve(
        G[np.ix_(contacts, range(3), contacts, range(3))], c[contacts],
        Law(*([values[i] for i in contacts] for values in (d.e, d.mu, d.mu_s, d.k)), d.eta), body.axial_direction(q), tol,
    )  # fmt: skip
    impulse, work = np.zeros((2, 3)), np.zeros((2, 2))
    impulse[contacts], work[:, contacts] = P, details["work"]
    after = qdot + np.einsum("kia,ia->k", response, impulse)
    stuck = [contacts[i] for i in details["stuck"]]
    return after, {
        "impulse": impulse,
        "work": work,
        "gap_rates_minus": body.gap_rates(d, q, qdot),
        "gap_rates_plus": body.gap_rates(d, q, after),
        "end": tuple("-" if i not in contacts else "sk" if i in stuck else "sp" for i in (0, 1)),
        "log": details["log"],
    }


def impact(
    params: Mapping[str, float],
    q: Sequence[float],
    qdot: Sequence[float],
    closed: Sequence[bool] = (True, True),
    tol: float = 1e-11,
) -> tuple[Array, dict[str, Any]]:
    """The impact law alone.

    Parameters
    ----------
    params : mapping
        The dimer's parameters, names as in `body.DEFAULTS`.
    q, qdot : (6,) sequences
        x1, y1, delta1, theta, dip, gamma and their rates before (delta1' relative to the plate), SI; see `body`. Only theta
        and the dip of q matter; the dip is 0 where both contacts are closed.
    closed : pair of bool
        Which contacts are closed.
    tol : float
        Relative tolerance of the integration.

    Returns
    -------
    qdot_after : (6,) array
    details : dict
        'impulse' (2, 3) normal, x, y in N s (where both ends stick the split of the axial part is arbitrary), gap rates
        before and after in m/s, 'end' (sk, sp, or - where not closed), 'log' of the switches, 'work' (2, 2) of the normal
        forces and of friction in J.
    """
    return apply(body.dimer(params), np.asarray(q, dtype=float), np.asarray(qdot, dtype=float), closed, tol)


def three_balls(e: float, v: Sequence[float] = (1.0, 0.0, 0.0), eta: float = 1.5, tol: float = 1e-12) -> Array:
    """Velocities after the collision of three equal balls in a row, all touching, with velocities `v` before.

    Returns
    -------
    (3,) array
    """
    B = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])  # gap rates of the two contacts, unit masses
    G, c = np.zeros((2, 3, 2, 3)), np.zeros((2, 3))
    G[:, 0, :, 0] = B @ B.T
    c[:, 0] = B @ np.asarray(v, dtype=float)
    P, _ = resolve(G, c, Law((e, e), (0, 0), (0, 0), (1, 1), eta), np.array([1.0, 0.0]), tol)
    return np.asarray(v, dtype=float) + B.T @ P[:, 0]
