"""Find an orbit from a run, from another orbit, or from the closed form of a ball on a plate."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import acos, cos, sin
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.map.ball import ball_fold
from dimersweep.analysis.orbits.map.lost import OrbitLost, all_found, in_steps, require
from dimersweep.analysis.orbits.map.manifold import slow_motion_of
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import JOINED, Recorder, ReturnMap
from dimersweep.analysis.orbits.map.solution import Solution, multipliers_of, slow_direction, solve, system
from dimersweep.errors import OrbitError, ParameterError, one_line
from dimersweep.inputs import as_number, check_count, check_rtol
from dimersweep.kernel.model.layout import DIP, FREE, N_STATE, PERIOD, PHASE, ROW, ROW_PHI0, STICK, WB, State
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.kernel.section import SPIN_COORDINATE
from dimersweep.parameters import (
    Parameters,
    check_level,
    check_name,
    check_names,
    dimer_from,
    fill_rows,
    updated,
    value_of,
)
from dimersweep.runs.run import Run
from dimersweep.runs.starting import is_point
from dimersweep.symbols import PARAMETERS

Start = tuple[ReturnMap, np.ndarray]  # a map and a point of its section from which Newton's method begins

RTOL = 1e-12  # rtol of the map by default
# periods of the map that are run from the ball's orbit before Newton's method, in the order of trial: after a short run
# the motion is near the ball's orbit, stable or not; after a long run it is near a stable orbit
TRANSIENTS = (1, 30, 200)
ONE_ORBIT = 1e-6  # relative difference in radius and phase up to which two orbits count as one
SAME = 1e-4  # distance from its start, in units of the section, at which a fast part counts as repeated
# turns of the spin in a forcing period beyond which no orbit is looked for: orbits are found up to some 30 turns, and
# far beyond the search takes long
MOST_TURNS = 1e3
SMALLEST_SHARE = 1e-3  # shortest step, as a share of the way from the parameters of one orbit to others
GAPS_AND_RATES = range(4)  # numbers of the gaps and their rates among the coordinates of a section
RUN_IN = 40  # periods in which the fast part of a stable motion settles
SECTION = 0.75 * TURN  # phase of the section of the ball's orbit: well before the double impact in the first quadrant


def rolled_up(parameters: dict[str, float]) -> float:
    """Return the axial spin [rad/s] of a lateral start with `xdot0` once friction has set the end rolling.

    The angular momentum about the contact point is conserved: m v + J_a s/r = m xdot0, with v = r s.
    """
    dm = dimer_from(parameters)
    return parameters["xdot0"] / dm.p1.r / (1 + dm.J_a / (dm.m * dm.p1.r**2))


def first_map(
    given: dict[str, float], periods: int = 1, rtol: float = RTOL, recorder: Recorder | None = None
) -> ReturnMap:
    """Return the map in the section of the ball's orbit: p1 sticks there, and p2 is in the air."""
    return ReturnMap(given, SECTION, np.array([STICK, FREE], dtype=float), periods, rtol, recorder or Recorder())


def ball_state(m: ReturnMap, spin: float) -> np.ndarray:
    """Return the kernel state at `SECTION` if p2 were a ball that bounces once a period, and p1 stayed down."""
    e, Gamma, dm = value_of("e_2", m.parameters), m.parameters["Gamma"], m.dimer
    phase = acos(min(1.0, ball_fold(e) / Gamma)) if Gamma > 0 else 0.0
    kappa = -dm.m * dm.p1.h * dm.l / (dm.J_t + dm.m * dm.p1.h**2)  # acceleration of p2 over gravity while p1 stays down
    tau, leaves = SECTION - phase, 2 * np.pi * e / (1 + e)
    rate = kappa * (leaves - tau - Gamma * (cos(SECTION) - cos(phase)))
    gap = kappa * (leaves * tau - tau**2 / 2 - Gamma * (sin(SECTION) - sin(phase) - tau * cos(phase)))
    v = dm.g / dm.omega
    d2, n2 = max(gap, 0.1) * v / dm.omega, rate * v
    begun = np.array(State(d2=d2, n2=n2, spin=spin, cb=dm.p1.r * spin))
    state = m.section.state(m.section.point(begun), np.full(2, float(FREE)))
    state[WB] = n2 / (dm.l * max(0.1, cos(dm.beta_0 + state[DIP])))
    return m.section.with_ends_at_rest(state, m.modes)


def settled_on(m: ReturnMap, state: np.ndarray, periods: int) -> tuple[ReturnMap, np.ndarray]:
    """Run from a state at the section of `m`; return the map in the best section of the motion, and the point there."""
    for _ in range(periods // m.periods):
        state[[PHASE, PERIOD]] = 0.0
        state, _, passage = m.recorder.run(m.row, state, m.periods, m.rtol)
    in_air = (passage.segments[:, SEGMENT_MODES : SEGMENT_MODES + 2] == FREE).any()
    require(in_air, "the motion dies: both ends stay on the plate")
    return m.moved(passage)


def settled_near(at: Solution, m: ReturnMap, spin: float, most: float = JOINED) -> Iterator[Start]:
    """Run from a stable orbit at other parameters or another spin; yield the settled motion in each of its sections.

    The fast part settles while the spin is put back once a period, whatever contacts occur meanwhile.

    Parameters
    ----------
    at : Solution
        Orbit from which the run begins.
    m : ReturnMap
        Map of the other parameters in the section of the orbit.
    spin : float
        Spin of the motion after the last impact of a period [rad/s].
    most : float
        Longest distance of the motion from the start of the run, in units of the section.
    """
    require((np.abs(multipliers_of(at)[0]) < 1).all(), "the orbit is unstable: no run stays near it")
    along, _ = slow_direction(at)
    state = begin = m.state(at.z + along * (spin - at.passage.spin) / m.unit)
    for _ in range(RUN_IN):
        state[PHASE] = 0.0
        state, modes, passage = m.recorder.run(m.row, state, m.periods, m.rtol)
        require(passage.read.strikes, "the motion dies: nothing strikes the plate")
        there = replace(m, modes=modes)
        z = there.section.point(state)[there.free]
        z[there.slow] += (spin - passage.read.spin) / there.unit
        state = there.state(z)
    leap = np.delete(np.abs(m.section.point(state) - m.section.point(begin)), SPIN_COORDINATE)
    require(leap.max() <= most, "the run leaves for another motion")
    yield from m.sections(passage)


def of_run(run: Run, m: ReturnMap, number: int = -1) -> Start:
    """Return the map and the point of the motion that a recorded run has come to at the start of a segment.

    `number` is that of the segment, by default of the last one. It begins with a forcing period. The parameters are
    those of `m`, which may differ from those of the run.
    """
    record = run.record("guess")
    segment = record.segments[number]
    m = replace(m, phase=record.row[ROW_PHI0], modes=segment[SEGMENT_MODES:SEGMENT_HOP_TIME].copy())
    return settled_on(m, segment[:N_STATE].copy(), m.periods)


def find(
    guess: Run | PeriodicOrbit | xr.Dataset | None = None,
    *,
    spin: float | str | None = None,
    periods: int | None = None,
    rtol: float = RTOL,
    **parameters: Any,
) -> PeriodicOrbit:
    """Find the orbit at an axial spin, or the orbit of a run: a fixed point of the fast part of the map, stable or not.

    Without a guess the search begins from three starts in turn, until one leads to a stable orbit. If none does, the
    first orbit found is returned. Orbits that were found before the one returned are its `others`.

    Parameters
    ----------
    guess : Run, PeriodicOrbit or xarray.Dataset, optional
        A recorded run, whose settled motion is on the orbit, or an orbit nearby, or one point of a cube, which stands
        for its run. Parameters that are not given are those of the guess.
    spin : float, optional
        Axial spin after the double impact [rad s-1]. By default it is the spin of the guess or, without a guess, the
        spin that a lateral start with `xdot0` rolls up to. 0.0 is the dimer that moves in a plane.
    periods : int, optional
        Forcing periods after which the motion repeats; by default those of the guess, or 1 without a guess. Where they
        are given, a run need not have settled: the search begins at its end.
    rtol : float
        Accuracy of the map [1].
    **parameters : float
        Parameters of the model; by default the paper's base case.

    Returns
    -------
    PeriodicOrbit

    Raises
    ------
    ParameterError
        For an unknown parameter or a value that is not allowed, and for a run whose motion does not repeat.
    OrbitError
        If Newton's method does not come to an orbit; the message lists the starts that were tried.

    Examples
    --------
    >>> from dimersweep import orbits, simulate
    >>> orbit = orbits.find(Gamma=0.9, spin=100.0)
    >>> abs(orbit.multipliers).round(3).tolist()
    [0.599, 0.599, 0.308]
    >>> run = simulate(f=16, periods=200)
    >>> orbits.find(run).stable, round(orbits.find(run).radius, 4), round(run.orbit.radius, 4)
    (True, 4.9165, 4.9165)
    """
    known: Any = guess.dimersweep.run() if is_point(guess) else guess
    given = checked(parameters, known)
    return orbit_at(
        given,
        None if spin is None else checked_spin(spin, given),
        _periods_of(known) if periods is None else check_count("periods", periods),
        known,
        check_rtol(rtol),
    )


def _periods_of(guess: Run | PeriodicOrbit | None) -> int:
    """Return the forcing periods after which a guess repeats, 1 without one; raise a ParameterError if it does not."""
    if not isinstance(guess, Run):
        return 1 if guess is None else guess.periods
    if guess.mode_period:
        return guess.mode_period
    near = "; periods=1 looks near its end nonetheless"
    ways = {"unresolved": f"; let it go on, as by run.go_on(400){near}", "aperiodic": near}
    why = guess.message if guess.status != "ok" else f"its motion is {guess.mode}"
    raise ParameterError(f"guess: the run has settled on no orbit ({why}){ways.get(guess.mode, '')}")


def orbit_at(
    given: dict[str, float],
    spin: float | None = None,
    periods: int = 1,
    guess: Run | PeriodicOrbit | None = None,
    rtol: float = RTOL,
    recorder: Recorder | None = None,
) -> PeriodicOrbit:
    """Find an orbit as `find` does, for arguments that have been checked; a `recorder` goes on counting its periods."""
    m = first_map(given, periods, rtol, recorder)
    tried: list[str] = []
    found: list[PeriodicOrbit] = []
    for name, start in _starts(m, spin, guess):
        try:
            orbit = _found(start())
        except OrbitLost as reason:
            tried.append(f"{name}: {reason}")
            continue
        if orbit.stable:
            return replace(orbit, others=tuple(found))
        told = [orbit.radius, orbit.impact_phase]
        if not any(
            np.isclose(told, [other.radius, other.impact_phase], ONE_ORBIT, equal_nan=True).all() for other in found
        ):
            found.append(orbit)
    if found:
        return replace(found[0], others=tuple(found[1:]))
    where = "" if spin is None else f" at spin = {spin:g} rad/s"
    least, why = ball_fold(value_of("e_2", given)), ""
    if given["Gamma"] < least:
        why = f" (a ball that bounces once a period needs Gamma >= pi (1 - e)/(1 + e) = {least:.4f})"
    raise OrbitError(f"no orbit of period {periods}{where}{why}; tried {'; '.join(tried)}")


def checked(parameters: dict[str, Any], guess: Run | PeriodicOrbit | None = None) -> dict[str, float]:
    """Return all parameters, with those of the guess where they are not given.

    Raise a ParameterError for an unknown parameter, or a value that is not allowed.
    """
    check_names(parameters)
    if guess is not None and not isinstance(guess, Run | PeriodicOrbit):
        raise ParameterError(f"guess = {one_line(repr(guess))}: must be a Run, a PeriodicOrbit or one point of a cube")
    given = Parameters(**updated({} if guess is None else guess.parameters, parameters)).given()
    check_level(given, "orbits", "; orbits.centre_drift has what a small one does to a circle")
    return given


def units_along(name: str) -> str:
    """Return the unit of a parameter or of the `spin`; raise a ParameterError if it is neither."""
    if name != "spin":
        check_name(name)
    return "rad s-1" if name == "spin" else PARAMETERS[name].units


def checked_spin(spin: Any, given: dict[str, float]) -> float:
    """Return an axial spin [rad/s]; by default the spin that a lateral start with `xdot0` rolls up to.

    Raise a ParameterError if it is no number, or so fast that no orbit has it.
    """
    spin = rolled_up(given) if spin is None else as_number("spin", spin, "rad s-1")
    most = MOST_TURNS * TURN * given["f"]
    if abs(spin) > most:
        raise ParameterError(f"spin = {spin:g}: must be at most {most:.3g} rad/s in size")
    return spin


def at_end(
    parameters: Mapping[str, float], start: np.ndarray, periods: int, rtol: float, recorder: Recorder
) -> tuple[ReturnMap, np.ndarray]:
    """Return the map over `periods` in the section where a run has ended, and the kernel's state there.

    `start` is the end of the run, at the start of a forcing period: state and friction modes, shape (N_START,).
    """
    m = ReturnMap(dict(parameters), parameters["phi0"], start[N_STATE:].copy(), periods, rtol, recorder)
    state = start[:N_STATE].copy()
    state[PHASE] = 0.0
    return m, state


def orbit_through(m: ReturnMap, z: np.ndarray) -> PeriodicOrbit:
    """Find the orbit of a settled motion near a point of its section."""
    fixed = solve(m, z, m.passage(z).spin)
    return orbit_of(fixed, slow_motion_of(fixed))


def _starts(
    m: ReturnMap, spin: float | None, guess: Run | PeriodicOrbit | None
) -> Iterator[tuple[str, Callable[[], Solution]]]:
    """Yield the name and the call of each way to an orbit of the map, in any section, in the order of trial."""
    if isinstance(guess, Run):
        yield "the end of the run", partial(_from_run, guess, m, spin)
    elif isinstance(guess, PeriodicOrbit):
        yield "the orbit given", partial(_from_orbit, guess, m, guess.spin if spin is None else spin)
    else:
        spin = rolled_up(m.parameters) if spin is None else spin
        for transient in TRANSIENTS:
            name = f"the ball's orbit in closed form, {transient} period{'s' if transient > 1 else ''} on"
            yield name, partial(_from_ball, m, spin, transient)


def _found(fixed: Solution) -> PeriodicOrbit:
    """Return the orbit of a fixed point that does not repeat after fewer periods."""
    fixed = centred(fixed)
    shorter = repeats_after(fixed)
    again = f"the motion found repeats after {shorter} already; ask for periods={shorter}"
    require(shorter == fixed.map.periods, again)
    slow_motion = slow_motion_of(fixed)
    # the multipliers that a run shows are those at its own points: on the slow manifold, not at the fixed point
    seen = fixed._replace(rows=fixed.map.differences(slow_motion.z))
    return replace(orbit_of(seen, slow_motion), fixed=fixed)


def centred(fixed: Solution) -> Solution:
    """Return the fixed point in a section that suits it better, if there is one and it is found there, else itself."""
    passage = fixed.passage
    return fixed.map.in_own_section(fixed, passage, lambda m, z: solve(m, z, passage.spin))


def repeats_after(fixed: Solution) -> int:
    """Return the least number of forcing periods after which a motion comes back to its point of the section."""
    m = fixed.map
    for k in range(1, m.periods):
        if m.periods % k == 0:
            state, _ = m.sampled(fixed.passage, TURN * k)
            # gaps and their rates are compared whether they are free or not: an end that is down here may be in the air
            # then
            fast = np.union1d(GAPS_AND_RATES, np.delete(m.free, m.slow))
            if np.abs(m.section.point(state) - m.section.point(m.state(fixed.z)))[fast].max() < SAME:
                return k
    return m.periods


def _from_ball(m: ReturnMap, spin: float, transient: int) -> Solution:
    """Find the fixed point at a spin from the ball's orbit, after a transient of `transient` times the map."""
    state = ball_state(m, spin)
    return solve(*settled_on(m, state, transient * m.periods), spin)


def _from_run(run: Run, m: ReturnMap, spin: float | None) -> Solution:
    """Find the fixed point from the end of a run, at a spin or, by default, at the spin of the run."""
    m, z = of_run(run, m)
    return solve(m, z, m.passage(z).spin if spin is None else spin)


def _from_orbit(orbit: PeriodicOrbit, m: ReturnMap, spin: float) -> Solution:
    """Find the fixed point from another orbit, at a spin and the parameters of `m`.

    Newton's method begins at the point of the orbit. If it fails, the parameters and the spin go there in steps.
    """
    old, given = orbit.fixed.map, m.parameters
    begin = orbit.fixed.on_map(replace(m, parameters=old.parameters, phase=old.phase, modes=old.modes))

    def step(here: tuple[Solution, float], there: float) -> tuple[Solution, float]:
        fixed, done = here
        values = given
        if there < 1.0:
            first, last = (
                dict(zip(ROW, fill_rows(one, 1)[0].tolist(), strict=True)) for one in (old.parameters, given)
            )
            values = {name: first[name] + there * (last[name] - first[name]) for name in ROW}
        alike = fixed is not begin or m.periods == old.periods
        known = system(fixed.map, fixed.matrix, fixed.gradient) if alike else None
        there_spin = orbit.spin + there * (spin - orbit.spin)
        try:
            return _beside(fixed, replace(fixed.map, parameters=values), there_spin, known), there
        except OrbitLost as reason:
            raise OrbitLost(f"{reason}, {done:.0%} of the way") from reason

    return in_steps(step, (begin, 0.0), SMALLEST_SHARE)[0]


def _beside(fixed: Solution, m: ReturnMap, spin: float, known: np.ndarray | None) -> Solution:
    """Find the fixed point at other parameters or another spin from one nearby.

    Newton's method begins at the point nearby or, over a change of sequence, at the motion that a run settles on.
    """
    try:
        return centred(solve(m, fixed.z, spin, known))
    except OrbitLost:
        if known is None:
            raise
        settled = settled_near(fixed, m, spin)
        for found, z in all_found(partial(lambda own, z: (solve(own, z, spin), z), *each) for each in settled):
            if np.abs(found.z - z).max() < JOINED:
                return centred(found)
        raise
