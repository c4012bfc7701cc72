"""Follow an orbit along a branch, through folds, with its stability, sequences and special points."""

from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.continuation.branch import point_of
from dimersweep.analysis.orbits.continuation.events import Event, doubled, events_in, on_its_border, pitchfork_in
from dimersweep.analysis.orbits.continuation.kinds import FLIP, kind_words
from dimersweep.analysis.orbits.continuation.stability_end import GAP, beyond_gap, furthest, kind_beyond
from dimersweep.analysis.orbits.continuation.steps import FOLLOWING, LOCATED, steps
from dimersweep.analysis.orbits.map.finding import units_along
from dimersweep.analysis.orbits.map.lost import OrbitLost, first_found
from dimersweep.analysis.orbits.map.manifold import slow_motion_of
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, dataset, orbit_of
from dimersweep.analysis.orbits.map.poincare import Recorder, ReturnMap
from dimersweep.analysis.orbits.map.solution import Axis, Solution, solve, without_drift
from dimersweep.cubes.cube import Column, finished
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count
from dimersweep.parameters import check_effect, value_of
from dimersweep.symbols import PARAMETERS

BEYOND_SEQUENCE = "word: the orbit does not go on beyond its sequence; the next one found has the sequence"
MIRRORED = "plane: the spin is zero; beyond lies the mirror image of the branch"
LEAST_SCALE = 1e-3  # least scale of a parameter, for a branch whose values are all near zero


def follow(
    orbit: PeriodicOrbit,
    parameter: str,
    *,
    to: float | str,
    points: int = 200,
    switch: bool = False,
    sequences: bool = True,
    sustained: bool = False,
) -> xr.Dataset:
    """Follow the branch of an orbit in a parameter or the spin, by pseudo-arclength steps, through folds.

    Parameters
    ----------
    orbit : PeriodicOrbit
        First orbit of the branch.
    parameter : str
        Any parameter of the model, or "spin".
    to : float or str
        Value at which the branch ends. A branch that turns round at a fold ends where it comes back to its first value.
    points : int
        Largest number of points; special points are not counted.
    switch : bool
        Leave the branch at its first flip for the branch of twice the period.
    sequences : bool
        Locate changes of the symbol sequence.
    sustained : bool
        Leave the spin free, and follow a sustained spin, which does not drift; the first one is found from the orbit.

    Returns
    -------
    xarray.Dataset
        Along `point`: the attributes of a `PeriodicOrbit`, the parameter, and `special`: fold, flip, torus, pitchfork
        or word where the row is such a point (to 1e-8 in the parameter over its scale), else none. At a word, `change`
        is the kind of change of the sequence, and `jump` the jump of the orbit. Words are flags (see `names`). The
        attribute `end` says why the branch ends; `cost` is the number of forcing periods of the map that it took.

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
    rows, end, cost = traced(orbit, parameter, to, check_count("points", points), switch, sequences, sustained)
    kinds, allowed = [event.kind for _, event in rows], kind_words()
    special = [("word" if kind.of_sequence else kind.name) if kind else "none" for kind in kinds]
    change = [kind.name if kind and kind.of_sequence else "none" for kind in kinds]
    columns = [
        Column("special", "kind of special point", special, allowed),
        Column("change", "what changes in the sequence", change, allowed),
        Column("jump", "jump of the orbit, in units of the section", [event.jump for _, event in rows]),
    ]
    if parameter != "spin":
        columns.append(Column(parameter, PARAMETERS[parameter], [event.solution.value for _, event in rows]))
    table = dataset([orbit for orbit, _ in rows], "point", columns)
    table.attrs |= {"end": end, "cost": cost, "parameter": parameter}
    return finished(table.set_coords(parameter), f"Branch of periodic orbits in {parameter}")


def traced(
    orbit: PeriodicOrbit,
    parameter: str,
    to: float | str,
    points: int = 200,
    switch: bool = False,
    sequences: bool = True,
    sustained: bool = False,
) -> tuple[list[tuple[PeriodicOrbit, Event]], str, float]:
    """Follow a branch as `follow` does.

    Return its rows, why it ends, in words, and the forcing periods of the map that it took.
    """
    axis, start, to = _axis(orbit, parameter, to, sustained)
    free = axis.spin is None
    edges = {
        to / axis.scale: (to, "to: the value asked for is reached"),
        start / axis.scale: (start, "back: the branch has turned round to its start"),
    }
    rows, end, recorder = [(orbit, Event(None, orbit.fixed._replace(value=start)))], "", Recorder()
    fixed = without_drift(orbit.fixed.on_map(replace(orbit.fixed.map, recorder=recorder)), axis)
    try:
        point = _begin(axis, fixed, start).towards(to - start)
        rows, taken = [_row(Event(None, point))], steps(point, FOLLOWING, tuple(edges))
        while not end and sum(event.kind is None for _, event in rows) < points:
            try:
                a, b, edge = next(taken)
            except OrbitLost:
                if not free:
                    raise
                point, end = _over_kink(point, *sorted((start, to)))
                rows.append(_row(Event(None, point)))
                taken = steps(point, FOLLOWING, tuple(edges))
                continue
            if free and a.passage.spin * b.passage.spin < 0:
                fork, end = pitchfork_in(a, b), MIRRORED
                rows += [_row(fork)] if fork else []
                continue
            found, leap = events_in(a, b, sequences)
            flip = next((k for k, event in enumerate(found) if switch and event.kind is FLIP), None)
            rows += [_row(event) for event in found[: None if flip is None else flip + 1]]
            if leap is not None:
                point, end = leap.solution, f"{BEYOND_SEQUENCE} {leap.sequences[1]}"
            elif flip is not None:
                point, switch = doubled(found[flip].solution), False
                taken = steps(point, FOLLOWING, tuple(edges))
            elif edge is not None:
                value, end = edges[edge]
                point = b._replace(value=value)
            else:
                point = b
            rows.append(_row(Event(None, point)))
    except OrbitLost as reason:
        end = f"lost: {reason}"
    return rows, end or f"points: {points} points were asked for", recorder.periods


def _axis(orbit: PeriodicOrbit, parameter: str, to: float | str, sustained: bool) -> tuple[Axis, float, float]:
    """Return the quantity that changes along the branch, its value at the orbit, and its value at the end."""
    if not isinstance(orbit, PeriodicOrbit):
        raise ParameterError(f"orbit = {orbit!r}: must be a PeriodicOrbit")
    to = as_number("to", to, units_along(parameter))
    if parameter != "spin":
        check_effect({parameter, *orbit.parameters})
    value = orbit.spin if parameter == "spin" else value_of(parameter, orbit.parameters)
    if sustained and parameter == "spin":
        raise ParameterError("parameter = 'spin': is free on a branch of sustained spins")
    if to == value:
        raise ParameterError(f"to = {to}: must differ from the value {parameter} has")
    in_plane = parameter != "spin" and abs(orbit.spin) <= LOCATED * orbit.fixed.map.unit
    spin = 0.0 if in_plane else None if sustained else orbit.spin
    return Axis(parameter, max(abs(value), abs(to - value), LEAST_SCALE), spin), value, to


def _over_kink(point: Solution, low: float, high: float) -> tuple[Solution, str]:
    """Go on over a kink of the drift, by steps of the parameter between `low` and `high`.

    Return a point with a sustained spin beyond, and ""; or the last point, and the reason for the end of the branch.
    """
    sense = float(np.sign(point.tangent[-1]))
    last, goes_on = furthest(lambda other: low <= other.value <= high, point, sense)
    if goes_on:
        return last, ""
    if min(abs(last.value - low), abs(last.value - high)) < LEAST_SCALE * GAP * last.axis.scale:
        return last, "to: the value asked for is nearly reached"
    given_spin = last.axis._replace(spin=last.passage.spin)
    given = last._replace(problem=last.problem._replace(axis=given_spin))
    drifts = beyond_gap(lambda _: True, given, sense) is not None
    return last, f"{kind_beyond(last).name}: {'the drift leaps over zero' if drifts else 'the family ends'}"


def _begin(axis: Axis, fixed: Solution, value: float) -> Solution:
    """Return the first point of the branch, in its own section or, if it has no derivatives there, in another one."""

    def begun(m: ReturnMap, z: np.ndarray) -> Solution:
        return point_of(axis, solve(m, z, axis.spin_at(value)), value)

    others = fixed.map.sections(fixed.passage)
    return first_found(chain([partial(point_of, axis, fixed, value)], (partial(begun, *place) for place in others)))


def _row(event: Event) -> tuple[PeriodicOrbit, Event]:
    """Return the row of a point of the branch: its orbit, and what happens there."""
    at = event.solution
    orbit = orbit_of(at, slow_motion_of(at))
    return on_its_border(event.kind, orbit, at.axis.spin is None) if event.kind else orbit, event
