"""Which contacts at zero slip hold, and in which direction the others break away (Coulomb's law at zero speed).

The rules are the same inside an impact and in sustained contact; only the response to a given assignment differs. It
comes in as a function ``respond(stick, slip) -> (forces, accelerations)``, both of shape (k, 3), columns normal, x, y,
with the contacts listed in `stick` held and those in `slip` (contact -> unit vector) sliding in the given direction.
"""

from collections.abc import Callable, Mapping, Sequence
from math import atan2, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, fsolve

Array = NDArray[np.float64]
Respond = Callable[[Sequence[int], Mapping[int, Array]], tuple[Array, Array]]


def stick_excess(forces: Array, stick: Sequence[int], mu_s: Sequence[float], axial: Array) -> float:
    """How far the holding forces exceed the stick limit (admissible where <= 0), in units of force.

    One contact: |t| - mu_s f. Two (then the dimer lies on both ends): only the total A of their axial forces is determined, and
    they hold if and only if *some* split of it does.
    """
    if len(stick) == 1:
        i = stick[0]
        return float(np.hypot(*forces[i, 1:]) - mu_s[i] * forces[i, 0])
    lateral = np.array([axial[1], -axial[0]])
    A = abs(sum(float(forces[i, 1:] @ axial) for i in stick))
    noise = 1e-12 * sum(float(forces[i, 0]) for i in stick)  # an end about to lose its force, in planar motion
    over = [abs(float(forces[i, 1:] @ lateral)) - mu_s[i] * forces[i, 0] - noise for i in stick]
    room = [sqrt(max(0.0, (mu_s[i] * forces[i, 0]) ** 2 - (forces[i, 1:] @ lateral) ** 2)) for i in stick]
    return float(max(A - sum(room), *over))


def hold_or_break(
    respond: Respond,
    zero: Sequence[int],
    moving: Mapping[int, Array],
    mu_s: Sequence[float],
    axial: Array,
    must_break: bool = False,
) -> tuple[list[int], dict[int, Array]] | None:
    """Decide for the contacts at zero slip.

    Parameters
    ----------
    respond : callable
        See the module's text.
    zero : sequence of int
        Contacts at zero slip.
    moving : mapping
        Sliding contacts and their directions.
    mu_s : sequence of float
        Stick coefficients of the contacts.
    axial : (2,) array
        Heading of the axis.
    must_break : bool
        The present hold has just been found to fail: do not try it again.

    Returns
    -------
    stick, breaking : list of int, dict
        Contacts that hold; contacts that break away and their directions. None where no consistent choice exists.
    """
    zero = list(zero)
    if not zero:
        return [], {}
    forces, _ = respond(zero, moving)
    if not must_break and stick_excess(forces, zero, mu_s, axial) <= 0:
        return zero, {}
    if len(zero) == 1:
        direction = _outward_one(respond, zero[0], moving, forces[zero[0], 1:])
        return None if direction is None else ([], {zero[0]: direction})
    return _break_pair(respond, zero, forces, mu_s, axial)


def _unit(phi: float) -> Array:
    return np.array([cos(phi), sin(phi)])


def _cross(u: Array, a: Array) -> float:
    return float(u[0] * a[1] - u[1] * a[0])


def _outward_one(respond: Respond, i: int, moving: Mapping[int, Array], hold: Array) -> Array | None:
    """Direction u of slip from rest such that the contact's acceleration is parallel to u and outward."""

    def acceleration(phi: float) -> Array:
        return respond([], {**moving, i: _unit(phi)})[1][i, 1:]

    def turning(phi: float) -> float:
        return _cross(_unit(phi), acceleration(phi))

    # the scan starts at the direction opposite to the holding force: exact in planar motion and near it otherwise
    start = atan2(-hold[1], -hold[0])
    grid = start + np.linspace(-pi, pi, 97)
    values = [turning(phi) for phi in grid]
    found = []
    for a, b, va, vb in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
        if va == 0 or va * vb < 0:
            phi = a if va == 0 else brentq(turning, a, b, xtol=1e-15)
            found.append((float(acceleration(phi) @ _unit(phi)), phi))
    best = max(found, default=(-1.0, start))
    if best[0] > 0:
        return _unit(best[1])
    # at the very limit of stick with mu = mu_s the outward acceleration is still zero
    push = float(acceleration(start) @ _unit(start))
    driven = respond([], {**moving, i: np.zeros(2)})[1][i, 1:]
    return _unit(start) if push > -1e-6 * float(np.hypot(*driven)) else None


def _break_pair(
    respond: Respond, pair: list[int], hold: Array, mu_s: Sequence[float], axial: Array
) -> tuple[list[int], dict[int, Array]] | None:
    """Two contacts at zero slip, the dimer flat, that cannot both hold."""
    lateral = np.array([axial[1], -axial[0]])
    for i, j in (pair, pair[::-1]):
        L = float(hold[i, 1:] @ lateral)
        if abs(L) >= mu_s[i] * hold[i, 0] * (1 - 1e-9):  # no axial force at all could help this end
            u = -np.sign(L) * lateral
            forces, acc = respond([j], {i: u})
            if stick_excess(forces, [j], mu_s, axial) <= 0 and acc[i, 1:] @ u >= 0:
                return [j], {i: u}
    both = _outward_two(respond, pair, hold, mu_s, axial)
    return None if both is None else ([], both)


def _outward_two(
    respond: Respond, pair: list[int], hold: Array, mu_s: Sequence[float], axial: Array
) -> dict[int, Array] | None:
    """Directions of both ends leaving zero slip together, each parallel to its own acceleration."""
    lateral = np.array([axial[1], -axial[0]])
    sign = np.sign(sum(hold[i, 1:] @ axial for i in pair))

    def guess(i: int) -> float:
        L = float(hold[i, 1:] @ lateral)
        A = sign * sqrt(max(0.0, (mu_s[i] * hold[i, 0]) ** 2 - L**2))
        u = -(A * axial + L * lateral)
        return atan2(u[1], u[0])

    def turning(phi: Array) -> list[float]:
        directions = {i: _unit(p) for i, p in zip(pair, phi, strict=True)}
        acc = respond([], directions)[1]
        size = max(1e-300, *(float(np.hypot(*acc[i, 1:])) for i in pair))
        return [_cross(directions[i], acc[i, 1:]) / size for i in pair]

    first = np.array([guess(i) for i in pair])
    at_limit = {i: _unit(p) for i, p in zip(pair, first, strict=True)}
    acc, driven = respond([], at_limit)[1], respond([], {i: np.zeros(2) for i in pair})[1]
    if float(np.abs(acc[pair, 1:]).max()) < 1e-6 * float(np.abs(driven[pair, 1:]).max()):
        return at_limit  # the very limit of stick with mu = mu_s: the outward acceleration is still zero
    coarse = np.linspace(0, 2 * pi, 12, endpoint=False)
    for start in [first, *(first + np.array([p, q]) for p in coarse for q in coarse)]:
        phi = fsolve(turning, start, xtol=1e-14, full_output=True)[0]
        directions = {i: _unit(p) for i, p in zip(pair, phi, strict=True)}
        acc = respond([], directions)[1]
        small = -1e-9 * float(np.abs(acc[:, 1:]).max())
        if max(np.abs(turning(phi))) < 1e-9 and all(acc[i, 1:] @ directions[i] >= small for i in pair):
            return directions
    return None
