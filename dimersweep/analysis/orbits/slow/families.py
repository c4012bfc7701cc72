"""The slow family: the orbits of one set of parameters at all spins, along which a motion slowly drifts.

A dimer on a circular orbit gains or loses spin, so slowly that all other coordinates follow: the motion goes through
the orbits of the family one after the other. The family is followed on the slow manifold. The fixed points of the
fast part lie beside it.
"""

from functools import partial
from math import prod

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.continuation.following import traced
from dimersweep.analysis.orbits.continuation.kinds import FOLD
from dimersweep.analysis.orbits.map.finding import RTOL, checked, checked_spin, orbit_at, settled_near
from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, first_found, in_steps, require
from dimersweep.analysis.orbits.map.manifold import NEAR, has_fast_part, slow_motion_near, slow_motion_of
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, dataset, orbit_of
from dimersweep.analysis.orbits.map.poincare import JOINED, ReturnMap
from dimersweep.analysis.orbits.map.solution import SlowMotion, fixed_at, slow_direction, solve, system
from dimersweep.cubes.cube import column, finished
from dimersweep.cubes.grid import evenly
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import check_count, check_rtol, pair_of
from dimersweep.symbols import Quantity

MISSING_OVER = 0.02  # part of the spin over which orbits may be missing, where a sequence just changes
SHORTEST = 1 / 128  # shortest step between two spins asked for, as a part of their distance
THROUGH = 3  # points of the family through which a parabola leads to the next one
# parts of the range of spins at which a first orbit is looked for, in the order of trial
BEGIN_AT = (0.5, 0.25, 0.75, 0.0, 1.0)


def family(*, spin: tuple[float, float], points: int = 50, rtol: float = RTOL, **parameters: float) -> xr.Dataset:
    """Find the orbits of one set of parameters over a range of spins.

    Parameters
    ----------
    spin : tuple of float
        Least and greatest axial spin after the double impact [rad s-1].
    points : int
        Number of spins, evenly spaced.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along `spin`: the attributes of a `PeriodicOrbit`, as far as the family goes, over changes of sequence. Spins at
        which the sequence just changes may be missing. The attributes `low_end` and `high_end` say why the family ends
        ("asked for" where it does not), `cost` how many forcing periods of the map were run.

    Raises
    ------
    ParameterError
        For an unknown parameter, or if the first spin is not below the second.
    OrbitError
        If there is no orbit at any of the spins.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> family = orbits.family(spin=(100.0, 110.0), points=3)
    >>> family["radius"].values.round(3).tolist()
    [4.259, 4.257, 4.256]
    """
    given = checked(parameters)
    spins = evenly(*spin_range(spin, given), check_count("points", points))
    rtol = check_rtol(rtol)
    numbers = dict.fromkeys(round(share * (points - 1)) for share in BEGIN_AT)

    def begun(k: int) -> tuple[PeriodicOrbit, int]:
        return orbit_at(given, float(spins[k]), rtol=rtol), k

    try:
        first, begin = first_found(partial(begun, k) for k in numbers)
    except OrbitError as reason:
        raise OrbitError(f"spin = ({spins[0]:g}, {spins[-1]:g}): no orbit found; {reason}") from None
    recorder = first.fixed.map.recorder
    start = recorder.periods
    orbits, ends = {begin: on_family(first.fixed.map, first.slow_motion)}, {}
    for name, order in (("high_end", range(begin + 1, spins.size)), ("low_end", range(begin - 1, -1, -1))):
        found, ends[name] = walk(orbits[begin], spins[order])
        orbits |= {order[k]: one for k, one in found.items()}
    kept = sorted(orbits)
    table = dataset([orbits[k] for k in kept], "spin_").drop_vars(["spin", "cost"])
    coordinate = column("spin", spins[kept], Quantity("rad s-1", "axial spin after the double impact"))
    table = table.rename_dims({"spin_": "spin"}).assign_coords(spin=coordinate)
    told = ends | {"cost": recorder.periods - start + first.cost, "rtol": rtol}
    return finished(table.assign_attrs(told), "Periodic orbits over the axial spin")


def spin_range(spin: tuple[float, float], given: dict[str, float]) -> tuple[float, float]:
    """Return the least and the greatest spin [rad/s]; raise ParameterError if `spin` is no range of spins."""
    both = pair_of("spin", spin, "the least and the greatest spin")
    low, high = (checked_spin(each, given) for each in both)
    if low >= high:
        raise ParameterError(f"spin = ({low:g}, {high:g}): the first must be below the second")
    return low, high


def walk(first: PeriodicOrbit, spins: np.ndarray, runs: bool = False) -> tuple[dict[int, PeriodicOrbit], str]:
    """Follow the family from an orbit through `spins`, in their order.

    The walk leads over changes of sequence, and over a short range of spins without an orbit. The first orbit is from
    `on_family`. With `runs` the walk goes where runs go. Then it goes on with another family where the spin of a motion
    drifts over the end of this one, but not along the branch of fixed points.

    Return the orbits by the number of their spin, and why the family ends before the last spin;
    "asked for" if it does not.
    """
    found: dict[int, PeriodicOrbit] = {}
    last, k, missed = [first], 0, 0
    while k < len(spins):
        spin = float(spins[k])
        nxt = attempt(_next, last, spin, runs)
        if nxt is None:
            missed += 1
            if k + 1 < len(spins) and (missed == 1 or abs(last[0].spin - spin) <= MISSING_OVER * abs(spin)):
                k += 1
                continue
            k -= missed - 1  # back to the first spin that was missed
            if runs:
                return found, "the run comes to no orbit"
            try:
                nxt = _along_branch(last[0], float(spins[k]))
            except OrbitLost as reason:
                return found, str(reason)
        found[k], last, missed = nxt, [nxt, *last[:2]], 0
        k += 1
    return found, "asked for"


def _next(last: list[PeriodicOrbit], spin: float, leaps: bool) -> PeriodicOrbit:
    """Find the orbit at another spin, along the family or by a run; where both fail, by way of spins between.

    `last` has the orbits before, the nearest first. With `leaps`, a run in the sense of the drift may
    lead to another family.
    """
    begin = last[0].spin

    def step(before: list[PeriodicOrbit], share: float) -> list[PeriodicOrbit]:
        at, to = before[0], spin if share == 1.0 else begin + share * (spin - begin)
        most = np.inf if leaps and (to - at.spin) * at.spin_drift > 0 else JOINED
        return [first_found([partial(step_along, before, to), partial(run_onto, at, to, most)]), *before[:2]]

    return in_steps(step, last, max(SHORTEST, 0.5 * MISSING_OVER * abs(spin / ((spin - begin) or 1.0))))[0]


def step_along(last: list[PeriodicOrbit], spin: float) -> PeriodicOrbit:
    """Find the orbit at another spin, along the family; `last` has the orbits before, the nearest first.

    One that lies so far from its guess that it may belong to another family counts as lost. Where an event lies near
    its section, the orbit is returned in another section in which it is found.
    """
    near = last[0].fixed
    m = near.map
    z = near.z + slow_direction(near)[0] * (spin - near.passage.spin) / m.unit
    same = {one.spin: one.fixed.z for one in last if one.fixed.map.phase == m.phase and one.fixed.z.size == near.z.size}
    if len(same) == THROUGH:  # the parabola by Lagrange's formula
        z = np.sum([prod((spin - s) / (at - s) for s in same if s != at) * there for at, there in same.items()], axis=0)
    if has_fast_part(near):
        slow_motion = slow_motion_near(near, z, spin)
    else:
        slow_motion = slow_motion_of(solve(m, z, spin, system(m, near.matrix, near.gradient)))
    require(np.abs(slow_motion.z - z).max() <= NEAR, "the next orbit lies aside of the family")
    orbit = on_family(m, slow_motion)
    return m.in_own_section(
        orbit,
        slow_motion.passage,
        lambda own, z: on_family(own, slow_motion_near(fixed_at(own, z), z, spin)),
    )


def run_onto(last: PeriodicOrbit, spin: float, most: float) -> PeriodicOrbit:
    """Return the motion at another spin that a run from an orbit settles on.

    It lies at most `most` from where the orbit leads, in units of the section. The orbit must be stable.
    """

    def found(there: ReturnMap, z: np.ndarray) -> PeriodicOrbit:
        slow_motion = slow_motion_near(fixed_at(there, z), z, spin)
        require(np.delete(np.abs(slow_motion.z - z), there.slow).max() <= NEAR, "the run comes to another motion")
        return on_family(there, slow_motion)

    settled = settled_near(last.fixed, last.fixed.map, spin, most)
    return first_found((partial(found, *place) for place in settled), "the run comes to no orbit")


def _along_branch(last: PeriodicOrbit, spin: float) -> PeriodicOrbit:
    """Find the orbit at another spin along the branch of fixed points; if it is lost, the reason says why the family ends."""
    fixed = solve(last.fixed.map, last.fixed.z, last.spin)
    rows, end, _ = traced(orbit_of(fixed), "spin", spin, sequences=False)
    folds = [f"fold at spin = {row.solution.value:.6g} rad/s" for _, row in rows if row.kind is FOLD]
    require(end.startswith("to:"), folds[-1] if folds else f"{end}, at spin = {rows[-1][1].solution.value:.6g} rad/s")
    orbit = rows[-1][0]
    drifts = orbit.slow_motion.z is not orbit.fixed.z or not has_fast_part(orbit.fixed)
    require(drifts, f"no motion drifts by the fixed point, at spin = {spin:.6g} rad/s")
    return on_family(orbit.fixed.map, orbit.slow_motion)


def on_family(m: ReturnMap, slow_motion: SlowMotion) -> PeriodicOrbit:
    """Return the orbit of a motion on the slow manifold; its `fixed` has the point and derivatives of that motion."""
    return orbit_of(fixed_at(m, slow_motion.z, slow_motion.passage, slow_motion.residual), slow_motion)
