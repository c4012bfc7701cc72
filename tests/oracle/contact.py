"""Forces and accelerations in free motion and sustained contact, eqs. (2)-(4), by enumeration of the contact states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from . import body
from .friction import hold_or_break

Array = NDArray[np.float64]


@dataclass
class State:
    """A contact state: who carries force, who of them sticks, who is just breaking away (in a fixed direction)."""

    active: tuple[int, ...] = ()
    stick: tuple[int, ...] = ()
    breaking: dict[int, Array] = field(default_factory=dict)


class Instant:
    """Everything that the forces at one instant need: free accelerations of the contacts and Delassus blocks."""

    def __init__(self, d: body.Dimer, t: float, q: Array, qdot: Array) -> None:
        self.d = d
        self.slip = body.slips(d, q, qdot)
        J = body.jacobian(d, q).reshape(6, 6)
        normal, tangential = body.normal_bias(d, q, qdot), body.tangential_bias(d, q, qdot)
        bias = np.array([[normal[i], tangential[i], tangential[2 + i]] for i in (0, 1)])
        load = body.inertial_forces(d, q, qdot) + body.uniform_forces(d, q, body.felt(d, t))
        solved: Array = np.linalg.solve(body.mass_matrix(d, q), np.column_stack([load, J.T])).astype(float)
        self.qddot_free: Array = solved[:, 0]
        self.response: Array = solved[:, 1:].reshape(6, 2, 3)
        self.free = (J @ self.qddot_free).reshape(2, 3) + bias
        self.G = (J @ solved[:, 1:]).reshape(2, 3, 2, 3)

    def respond(self, active: Sequence[int], stick: Sequence[int], slip: Mapping[int, Array]) -> tuple[Array, Array]:
        """Contact forces and accelerations, (2, 3), normal, x, y: active gaps stay closed, stuck ends stay."""
        rows, units = [], []
        for i in active:
            unit = np.zeros((2, 3))
            unit[i, 0] = 1.0
            if i not in stick:
                unit[i, 1:] = -self.d.mu[i] * slip[i]
            units.append(unit)
            rows.append((i, 0))
        for i in stick:
            for a in (1, 2):
                unit = np.zeros((2, 3))
                unit[i, a] = 1.0
                units.append(unit)
                rows.append((i, a))
        if not units:
            return np.zeros((2, 3)), self.free
        columns = [np.einsum("iajb,jb->ia", self.G, unit) for unit in units]
        A = np.array([[column[row] for column in columns] for row in rows])
        b = -np.array([self.free[row] for row in rows])
        # least squares: two stuck ends of a flat dimer share one axial velocity; only the split of that force is free
        x = np.linalg.lstsq(A, b, rcond=1e-10)[0] if len(stick) == 2 else np.linalg.solve(A, b)
        forces = sum(unit * value for unit, value in zip(units, x, strict=True))
        return forces, self.free + sum(column * value for column, value in zip(columns, x, strict=True))

    def directions(self, state: State) -> dict[int, Array]:
        """Slip directions of the sliding contacts."""
        out = {}
        for i in state.active:
            if i in state.breaking:
                out[i] = state.breaking[i]
            elif i not in state.stick:
                speed = float(np.hypot(*self.slip[i]))
                out[i] = self.slip[i] / speed if speed > 0 else np.zeros(2)
        return out

    def forces(self, state: State) -> tuple[Array, Array]:
        """Contact forces and accelerations in a given contact state."""
        return self.respond(state.active, state.stick, self.directions(state))

    def qddot(self, state: State) -> Array:
        """Generalized accelerations in a given contact state."""
        if not state.active:
            return self.qddot_free
        reaction: Array = np.einsum("kia,ia->k", self.response, self.forces(state)[0])
        return self.qddot_free + reaction


def settle(
    d: body.Dimer,
    t: float,
    q: Array,
    qdot: Array,
    resting: Sequence[int],
    zero: Sequence[int],
    breaking: Mapping[int, Array],
    must_break: bool,
) -> State:
    """The contact state that satisfies the complementarity conditions.

    Parameters
    ----------
    d, t, q, qdot
        Dimer, time and motion.
    resting : sequence of int
        Contacts with zero gap and zero gap rate.
    zero : sequence of int
        Those of them with zero slip.
    breaking : mapping
        Those that have just broken away.
    must_break : bool
        The hold of those at zero slip has just been found to fail.

    Returns
    -------
    State
    """
    now = Instant(d, t, q, qdot)
    axial = body.axial_direction(q)
    subsets = [s for s in ((0, 1), (0,), (1,), ()) if set(s) <= set(resting)]
    for active in subsets:
        moving = now.directions(State(active, tuple(zero), dict(breaking)))
        choice = hold_or_break(
            partial(now.respond, active), [i for i in active if i in zero], moving, d.mu_h, axial, must_break,
        )  # fmt: skip
        if choice is None:
            continue
        stick, new = choice
        kept = {i: u for i, u in breaking.items() if i in active}
        state = State(active, tuple(stick), {**kept, **new})
        forces, acc = now.forces(state)
        weight = d.m * d.g
        pressed = all(forces[i, 0] >= -1e-12 * weight for i in active)
        leaving = all(acc[i, 0] >= -1e-10 * d.g for i in resting if i not in active)
        if pressed and leaving:
            return state
    raise RuntimeError("no consistent contact state")
