"""Follow an orbit along a branch, through folds, with its stability, its words and its special points."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, number
from dimersweep.orbits.branch import Axis, Point, point_of
from dimersweep.orbits.continuation import FOLLOWING, steps
from dimersweep.orbits.kinds import FLIP, Kind
from dimersweep.orbits.labelling import Column, dataset
from dimersweep.orbits.manifold import creep_of
from dimersweep.orbits.newton import Fixed, solve
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost, Tape
from dimersweep.orbits.specials import Special, doubled, specials
from dimersweep.parameters import check_effect, check_name, value_of
from dimersweep.symbols import PARAMETERS

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
    edges = {
        to / axis.scale: (to, "to: the value asked for is reached"),
        start / axis.scale: (start, "back: the branch has turned round to its start"),
    }
    entries = [_entry(point)]
    try:
        end = _followed(axis, point, edges, entries, points, switch, words)
    except OrbitLost as reason:
        end = f"lost: {reason}"
    return Trace(entries, end, tape.periods)


def _followed(
    axis: Axis,
    begin: Point,
    edges: dict[float, tuple[float, str]],
    entries: list[BranchRow],
    points: int,
    switch: bool,
    words: bool,
) -> str:
    """Enter the points of a branch from one on; why it ends.

    `edges` has the values of the parameter at which it ends, and why, by those over the scale.

    Raises
    ------
    OrbitLost
        Where it does not go on.
    """
    taken = steps(axis, begin, FOLLOWING, tuple(edges))
    while sum(entry.kind is None for entry in entries) < points:
        a, b, edge = next(taken)
        found, leap = specials(axis, a, b, words)
        flips = [special for special in found if special.kind is FLIP] if switch else []
        kept = found[: found.index(flips[0]) + 1] if flips else found
        entries += [_entry(special.point, special) for special in kept]
        if leap is not None:
            entries.append(_entry(leap.point))
            return f"word: the orbit does not go on beyond its word; the next one found has the word {leap.words[1]}"
        if flips:
            try:
                twice = doubled(axis, flips[0].point)
            except OrbitLost as reason:
                raise OrbitLost(f"no branch of twice the period was found ({reason})") from reason
            entries.append(_entry(twice))
            return _followed(axis, twice, edges, entries, points, False, words)
        if edge is not None:
            value, why = edges[edge]
            entries.append(_entry(b._replace(value=value)))
            return why
        entries.append(_entry(b))
    return f"points: {points} points were asked for"


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


def _entry(point: Point, special: Special | None = None) -> BranchRow:
    orbit = orbit_of(point.fixed, creep_of(point.fixed))
    return BranchRow(orbit, point.value, special.kind, special.jump) if special else BranchRow(orbit, point.value)


def _dataset(entries: Sequence[BranchRow], parameter: str, end: str, cost: float) -> xr.Dataset:
    kinds = [entry.kind for entry in entries]
    special = [("word" if kind.of_word else kind.name) if kind else "" for kind in kinds]
    columns: dict[str, Column] = {
        "special": (special, "kind of special point"),
        "change": ([kind.name if kind and kind.of_word else "" for kind in kinds], "what changes in the word"),
        "jump": ([entry.jump for entry in entries], "jump of the orbit, in units of the section"),
    }
    if parameter != "spin":
        columns[parameter] = ([entry.value for entry in entries], PARAMETERS[parameter])
    table = dataset([entry.orbit for entry in entries], "point", columns)
    table.attrs |= {"end": end, "cost": cost, "parameter": parameter}
    return table.set_coords(parameter)
