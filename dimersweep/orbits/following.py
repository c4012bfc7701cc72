"""Follow an orbit along a branch, through folds, with its stability, its words and its special points."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, number
from dimersweep.orbits.branch import Axis, Point, corrected, in_each_section, in_own_section, point_of
from dimersweep.orbits.kinds import Kind
from dimersweep.orbits.kinds.flip import FLIP
from dimersweep.orbits.kinds.kind import Change
from dimersweep.orbits.labelling import dataset
from dimersweep.orbits.manifold import creep_of
from dimersweep.orbits.newton import Fixed, solve
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost, Tape
from dimersweep.orbits.specials import Leap, Special, doubled, specials
from dimersweep.parameters import check_effect, check_name, value_of
from dimersweep.symbols import PARAMETERS

# length of a step, in units of the section and of the parameter, and by how much the next may be longer
FIRST_STEP, LARGEST_STEP, SMALLEST_STEP, STEP_GROWTH = 0.02, 0.25, 1e-6, 1.3
LEAST_SCALE = 1e-3  # of a parameter, where it and its target are both near zero


class BranchRow(NamedTuple):
    """A row of the dataset of a branch."""

    orbit: PeriodicOrbit
    value: float
    kind: Kind | None = None
    jump: float = 0.0


def follow(
    orbit: PeriodicOrbit,
    parameter: str,
    *,
    to: float | str,
    points: int = 200,
    switch: bool = False,
    words: bool = True,
) -> xr.Dataset:
    """The branch of an orbit in a parameter or the spin, by pseudo-arclength steps, through folds.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Where the branch begins.
    parameter : str
        Any parameter of the model, or "spin".
    to : float or str
        Where it ends. A branch that turns round at a fold ends where it comes back to the value it began with.
    points : int
        Points at most, special ones aside.
    switch : bool
        Whether to leave the branch at its first flip for that of twice the period.
    words : bool
        Whether changes of the word are located.

    Returns
    -------
    xarray.Dataset
        Along `point`: the attributes of a `PeriodicOrbit`, the parameter, and `special`: fold, flip, torus or word where the
        row is such a point (1e-8 in the parameter over its scale), with the kind of `change` of a word and the `jump` of the
        orbit. The attribute `end` says why the branch ends, `cost` how many forcing periods of the map it took.

    Raises
    ------
    ParameterError
        For an unknown parameter, or a value that is not allowed.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> branch = orbits.follow(orbits.find(spin=100.0), "Gamma", to=0.88)
    >>> bool(branch["stable"].all())
    True
    """
    trace = traced(orbit, parameter, to, check_count("points", points), switch, words)
    return _dataset(trace.entries, parameter, trace.end, trace.cost)


class Trace(NamedTuple):
    """The points of a branch, why it ends, and the forcing periods of the map that it took."""

    entries: list[BranchRow]
    end: str
    cost: float


def traced(
    orbit: PeriodicOrbit, parameter: str, to: float | str, points: int = 200, switch: bool = False, words: bool = True
) -> Trace:
    """The points of a branch; see `follow`."""
    axis, start, to = _axis(orbit, parameter, to)
    tape = Tape()
    try:
        point = _begin(axis, orbit.fixed._replace(map=replace(orbit.fixed.map, tape=tape)), start, to)
    except OrbitLost as reason:
        return Trace([BranchRow(orbit, start)], f"lost: {reason}", tape.periods)
    entries, step, end = [_entry(point)], FIRST_STEP, ""
    others: list[Point] | None = None  # the point in other sections, at the first place where the branch is lost
    while not end:
        if sum(entry.kind is None for entry in entries) >= points:
            return Trace(entries, f"points: {points} points were asked for", tape.periods)
        try:
            nxt = _stepped(axis, point, step, start, to)
            _same_way(point, nxt)
        except OrbitLost as reason:
            step *= 0.5
            if step < SMALLEST_STEP:  # the contact at the section may be all that does not go on
                others = list(in_each_section(axis, point)) if others is None else others
                if others:
                    point, step = others.pop(0), FIRST_STEP
                else:
                    end = f"lost: {reason}"
            continue
        if others:
            others = []  # one of them goes on
        nxt, end = _window(axis, point, nxt, start, to)
        found, leap = _specials(axis, point, nxt, words)
        flips = [special for special in found if special.kind is FLIP] if switch else []
        kept = found[: found.index(flips[0]) + 1] if flips else found
        entries += [_entry(special.point, special) for special in kept]
        if leap is not None:
            return Trace([*entries, _entry(leap.last)], f"word: {leap}", tape.periods)
        if flips:
            try:
                nxt, switch, end, step = doubled(axis, flips[0].point), False, "", FIRST_STEP
            except OrbitLost as reason:
                return Trace(entries, f"lost: no branch of twice the period was found ({reason})", tape.periods)
        entries.append(_entry(nxt))
        point = in_own_section(axis, nxt, simplest=others is None) if not end else nxt
        step = min(step * STEP_GROWTH, LARGEST_STEP)
    return Trace(entries, end, tape.periods)


def _axis(orbit: PeriodicOrbit, parameter: str, to: float | str) -> tuple[Axis, float, float]:
    """The quantity that changes along the branch, its value at the orbit, and where it ends."""
    if not isinstance(orbit, PeriodicOrbit):
        raise ParameterError(f"orbit = {orbit!r}: must be a PeriodicOrbit")
    if parameter != "spin":
        check_name(parameter)
        check_effect({parameter, *orbit.parameters})
    to = number("to", to, "rad s-1" if parameter == "spin" else PARAMETERS[parameter].units)
    value = orbit.spin if parameter == "spin" else value_of(parameter, orbit.parameters)
    if to == value:
        raise ParameterError(f"to = {to}: must differ from the value {parameter} has")
    return Axis(parameter, max(abs(value), abs(to - value), LEAST_SCALE), orbit.spin), value, to


def _begin(axis: Axis, fixed: Fixed, value: float, to: float) -> Point:
    """The first point of the branch, in its section or, where that has no derivatives, in another one.

    Raises
    ------
    OrbitLost
        If no section has them.
    """
    try:
        start = point_of(axis, fixed, value, None)
    except OrbitLost:
        for m, z in fixed.map.sections(fixed.image.passage):
            with suppress(OrbitLost):
                start = point_of(axis, solve(m, z, axis.spin_at(value)), value, None)
                break
        else:
            raise
    return start if to > value else start._replace(tangent=-start.tangent)


def _same_way(a: Point, b: Point) -> None:
    """Refuse a step over which the branch turns too far."""
    if a.tangent @ b.tangent < 0.7:
        raise OrbitLost("the branch turns too sharply")


def _stepped(axis: Axis, point: Point, step: float, start: float, to: float) -> Point:
    """The point a step further, or where the step leads out of the range from `start` to `to` the one at its edge."""
    y = point.y(axis) + step * point.tangent
    for edge, _ in _edges(start, to):
        if (y[-1] * axis.scale - edge) * (point.value - edge) < 0:
            share = (edge - point.value) / (step * point.tangent[-1] * axis.scale)
            return _at_edge(axis, point, point.y(axis) + share * step * point.tangent, edge)
    return corrected(axis, point, y, point.tangent)


def _edges(start: float, to: float) -> tuple[tuple[float, str], ...]:
    """Values of the parameter at which a branch ends, and why."""
    return (to, "to: the value asked for is reached"), (start, "back: the branch has turned round to its start")


def _at_edge(axis: Axis, near: Point, y: np.ndarray, edge: float) -> Point:
    """The point at a value of the parameter."""
    y[-1] = edge / axis.scale
    return corrected(axis, near, y, np.append(np.zeros(y.size - 1), 1.0))._replace(value=edge)


def _window(axis: Axis, a: Point, b: Point, start: float, to: float) -> tuple[Point, str]:
    """The point, or where the step leads out of the range from `start` to `to` the one at its edge; why the branch ends."""
    for edge, why in _edges(start, to):
        outward = np.sign(edge - (start if edge == to else to))
        if (b.value - edge) * outward >= 0 and (a.value - edge) * outward < 0:
            if b.value == edge:
                return b, why
            share = (edge - a.value) / (b.value - a.value)
            try:
                return _at_edge(axis, b, a.y(axis) + share * (b.y(axis) - a.y(axis)), edge), why
            except OrbitLost:
                return b, why
    return b, ""


def _specials(axis: Axis, a: Point, b: Point, words: bool) -> tuple[list[Special], Leap | None]:
    try:
        return specials(axis, a, b, words), None
    except Leap as leap:
        return leap.found, leap


def _entry(point: Point, special: Special | None = None) -> BranchRow:
    orbit = orbit_of(point.fixed, creep_of(point.fixed))
    return BranchRow(orbit, point.value, special.kind, special.jump) if special else BranchRow(orbit, point.value)


def _dataset(entries: Sequence[BranchRow], parameter: str, end: str, cost: float) -> xr.Dataset:
    table = dataset([entry.orbit for entry in entries], "point")
    kinds = [entry.kind for entry in entries]
    columns: dict[str, tuple[list[str], str]] = {
        "special": (
            ["word" if isinstance(kind, Change) else kind.name if kind else "" for kind in kinds],
            "kind of special point",
        ),
        "change": ([kind.name if isinstance(kind, Change) else "" for kind in kinds], "what changes in the word"),
    }
    for name, (values, meaning) in columns.items():
        table[name] = ("point", np.array(values, dtype=object).astype(str), {"long_name": meaning})
    units = {"units": "1", "long_name": "jump of the orbit, in units of the section"}
    table["jump"] = ("point", np.array([entry.jump for entry in entries]), units)
    if parameter != "spin":
        table[parameter] = ("point", np.array([entry.value for entry in entries]), PARAMETERS[parameter].attributes())
    table.attrs |= {"end": end, "cost": cost, "parameter": parameter}
    return table.set_coords(parameter)
