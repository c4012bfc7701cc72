"""The verbs of the kernel in one compiled loop over many inputs, so that a call from Python costs nothing beside them."""

from collections.abc import Callable
from inspect import signature
from math import hypot, inf
from time import thread_time
from typing import NamedTuple

import numpy as np
from verbs_inputs import CONTACT, DOUBLE, FLIGHT, RTOL, SINGLE, Inputs, record

from dimersweep.kernel import chatter, event_loop, smooth_motion
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.compiler.jit import compiled, exported, plain
from dimersweep.kernel.contact import coordinates, forces, phase, step_control
from dimersweep.kernel.contact.contact_mode import CLOSED
from dimersweep.kernel.contact.events import NO_EVENT, OUT_OF_STEPS, is_failure
from dimersweep.kernel.course import RunRequest, contact_of, motion_of, new_workspace
from dimersweep.kernel.flight import free_motion
from dimersweep.kernel.flight import landing as landings
from dimersweep.kernel.impact import impact, single_impact
from dimersweep.kernel.model import body, friction
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    N1,
    N2,
    N_CODES,
    N_OUT,
    N_STATE,
    OK,
    PHASE,
    SLIP,
)
from dimersweep.kernel.numerics.sincos import TWO_PI
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import no_record
from dimersweep.parameters import Parameters

ALONE, GAP, DELASSUS, LANDING, IMPACT, RATES, STEP, PHASE_OF_CONTACT, CHATTER = range(9)
ROUTE, SLIP_SPEED = range(9, 11)  # not timed: what sorts the inputs
HELD, STRAIGHT, TURNING, FRICTIONLESS = range(4)  # routes of a single impact
MAX_HOPS = 200
CHATTER_HOPS = 3, 40  # of the chatters that are timed
SHARE = 0.02  # length of a contact step, in forcing periods
STRETCH = 2.0  # the same by the rescaled method, in its own time


@compiled
def approach(state):
    """Speed of the closed end that approaches faster."""
    return max(-state[N1] if state[D1] == 0.0 else 0.0, -state[N2] if state[D2] == 0.0 else 0.0)


@compiled
def route(dm, state, tol):
    """By which route an impact at one end begins: HELD, STRAIGHT, TURNING or FRICTIONLESS."""
    i = 0 if state[D1] == 0.0 else 1
    sin_b, cos_b = body.attitude(dm, state[DIP])
    law = impact.end_law(dm, i, 0.0, sin_b, cos_b, body.end(dm, i).e)
    V = approach(state)
    _, a, b = impact.contact_velocity(dm, state, i)
    v = hypot(a, b)
    if law.mu == 0.0:
        return FRICTIONLESS
    if v <= max(impact.IMPACT_SLIP_SCALE * tol * V, impact.slip_rounding(dm, state)):
        return HELD if friction.holds_axially(law.mu_s, law.na, law.aa) else STRAIGHT
    return STRAIGHT if single_impact.is_invariant(law, v / V, a / v, b / v, tol) else TURNING


if "dm" in signature(plain(landings.next_landing)).parameters:
    gap_series, next_landing = free_motion.gap_series, landings.next_landing
else:  # as before the plate had harmonics

    @compiled
    def gap_series(dm, fl, i, t):
        """A gap and its derivatives."""
        return free_motion.gap_series(fl, i, t)

    @compiled
    def next_landing(dm, fl, until):
        """The end that lands first, and when."""
        return landings.next_landing(fl, until)


@compiled
def gap_evaluation(dm, state):
    """One gap with its derivatives, half a flight of a tenth of a period ahead."""
    return gap_series(dm, free_motion.take_off(dm, state), 1, 0.05 * dm.period)[0]


@compiled
def landing(dm, state):
    """The next landing until the end of the forcing period."""
    i, t, _ = next_landing(dm, free_motion.take_off(dm, state), (TWO_PI - state[PHASE]) / dm.omega)
    return t if i >= 0 else 0.0


@compiled
def delassus_of_both(dm, state):
    """Contact Jacobian of both ends and the Delassus operator between them."""
    sin_b, cos_b = body.attitude(dm, state[DIP])
    p, q = body.levers(dm.p1, sin_b, cos_b), body.levers(dm.p2, sin_b, cos_b)
    return body.delassus(dm, p, p).nn + body.delassus(dm, q, p).na


@compiled
def contact_step(dm, motion, method, rtol):
    """One step of a contact phase by a given method."""
    y, control = motion.contact, motion.work.control[0]
    smooth_motion.set_contact(dm, motion.state, motion.modes, y)
    plate, n, work = motion.state[PHASE] + dm.phi0, coordinates.N_CLOSED, motion.work
    b, bracket = work.step[0], work.bracket[0]
    p = step_control.Phase(dm, motion.modes, plate, dm.period, dm.period, rtol, 0.0, n, b, control, bracket, work.meter)
    step_control.begin_at(p, y)
    control.method = method
    control.stiffness = step_control.stiffness(p, max(p.b.start.F[forces.F1], p.b.start.F[forces.F2]))
    return step_control.step_to(p, p.phase, STRETCH if method == step_control.RESCALED else SHARE * dm.period)


@compiled
def contact_phase(dm, motion, rtol):
    """A contact phase to its first event or the end of the forcing period."""
    state = motion.state
    smooth_motion.set_contact(dm, state, motion.modes, motion.contact)
    motion.course[0].slip_tol = smooth_motion.no_slip(dm, state, rtol)
    span = (TWO_PI - state[PHASE]) / dm.omega
    t, event = phase.sustain_contact(dm, contact_of(dm, motion), span, span, False, rtol, motion.work)
    return t if event != OUT_OF_STEPS else np.nan


@compiled
def whole_chatter(dm, motion, ask, record):
    """Impacts and hops of one end until its chatter is closed; the number of impacts, 0 if something else happens first."""
    state, modes, course = motion.state, motion.modes, motion.course[0]
    for hop in range(1, MAX_HOPS):
        energy = body.kinetic(dm, state)
        status, _ = event_loop.collide(dm, state, modes, ask.rtol, dm.v_scale, motion.work, record.log)
        course.slip_tol = smooth_motion.no_slip(dm, state, ask.rtol)
        if chatter.come_to_rest(dm, contact_of(dm, motion), state, ask.close, 1.0 * hop, energy) >= 0.0:
            return hop
        course.contact_is_set = smooth_motion.find_contact(dm, contact_of(dm, motion), state, NO_EVENT) == CLOSED
        event = smooth_motion.move_to_next_event(dm, ask, motion)
        if status != OK or is_failure(event) or approach(state) == 0.0:
            return 0
    return 0


@exported
def loop(verb, rows, scene, states, modes, option, rtol, turns, space, record, answers):
    """Call a verb on each input, so many times over.

    Parameters
    ----------
    verb : int
    rows, scene, states, modes : arrays
        See ``Inputs``.
    option : int
        What the verb has to choose from (the method of a contact step).
    rtol : float
    turns : int
    space, record : Workspace, Record
        Scratch, without rows.
    answers : float64 array, shape (m,)
        A number of each call, filled in place: else the compiler might leave the call out.
    """
    motion = motion_of(space.state, space.modes, space.past, space)
    state, mode, work = motion.state, motion.modes, motion.work
    ask = RunRequest(1, rtol, rtol, False, False)
    dm = space.dimer[0]
    for _ in range(turns):
        last = -1
        for k in range(scene.shape[0]):
            if scene[k] != last:
                last = scene[k]
                body.set_dimer(rows[last], dm)
            copy(states[k], state, N_STATE)
            mode[0], mode[1] = modes[k, 0], modes[k, 1]
            answer = 0.0
            if verb == ALONE:
                answer = state[N1]
            elif verb == GAP:
                answer = gap_evaluation(dm, state)
            elif verb == DELASSUS:
                answer = delassus_of_both(dm, state)
            elif verb == LANDING:
                answer = landing(dm, state)
            elif verb == IMPACT:
                status, _ = event_loop.collide(dm, state, mode, rtol, dm.v_scale, work, record.log)
                answer = state[N1] + state[N2] if status == OK else np.nan
            elif verb == RATES:
                smooth_motion.set_contact(dm, state, mode, motion.contact)
                forces.contact_rates(dm, mode, state[PHASE], motion.contact, False, motion.rates, motion.forces)
                answer = motion.forces[forces.F1] + motion.forces[forces.F2]
            elif verb == STEP:
                answer = contact_step(dm, motion, option, rtol)
            elif verb == PHASE_OF_CONTACT:
                answer = contact_phase(dm, motion, rtol)
            elif verb == CHATTER:
                answer = whole_chatter(dm, motion, ask, record)
            elif verb == ROUTE:
                answer = route(dm, state, rtol)
            elif verb == SLIP_SPEED:
                smooth_motion.set_contact(dm, state, mode, motion.contact)
                answer = hypot(motion.contact[coordinates.Y.u_a], motion.contact[coordinates.Y.u_b])
            answers[k] = answer


def call(verb: int, inputs: Inputs, *, option: int = 0, rtol: float = RTOL, turns: int = 1) -> np.ndarray:
    """Call a verb on each input, and return what it answers, shape (m,)."""
    answers = np.zeros(inputs.scene.size)
    loop(verb, *inputs, option, rtol, turns, new_workspace(), no_record(), answers)
    return answers


class Timed(NamedTuple):
    """A verb with what it is timed on."""

    verb: int
    inputs: Inputs
    option: int = 0

    def run(self, turns: int) -> np.ndarray:
        """Call the verb on all inputs, so many times over; what it answers the last time."""
        return call(self.verb, self.inputs, option=self.option, turns=turns)

    def calls(self, turns: int) -> int:
        """How many calls that is."""
        return turns * self.inputs.scene.size


class Drift(NamedTuple):
    """Whole forcing periods of the base drift, early stop left out."""

    row: np.ndarray
    at_once: int

    def run(self, turns: int) -> np.ndarray:
        """Run from the start for so many times `at_once` periods; the outcome."""
        out, codes = np.zeros((1, N_OUT)), np.zeros((1, N_CODES), np.int64)
        run_many(self.row[None], self.calls(turns), RTOL, False, out, codes)
        return out[0, :6]

    def calls(self, turns: int) -> int:
        """How many periods that is."""
        return turns * self.at_once


def without_slip(inputs: Inputs, axial: bool) -> Inputs:
    """Impacts with the lateral slip of the end that lands taken away, and the axial one too if `axial`."""
    states = inputs.states.copy()
    for state, row in zip(states, inputs.rows[inputs.scene], strict=True):
        along, across = body.slip_at(body.dimer_of(row), state, 0 if state[D1] == 0.0 else 1)
        state[CA] -= along if axial else 0.0
        state[CB] -= across
    return inputs._replace(states=states)


def by_route(inputs: Inputs, wanted: int) -> Inputs:
    """The impacts at one end that take a given route."""
    return inputs.only(call(ROUTE, inputs) == wanted)


class Harvest:
    """States that occur in runs of the base case and of so many random scenes, with friction and without."""

    def __init__(self, random: int, periods: int) -> None:
        self.rough, self.smooth = (record(random, periods, frictionless) for frictionless in (False, True))

    def slipping(self, least: float, most: float) -> Inputs:
        """Contact phases of one end that begin with a slip between two speeds [m/s]."""
        inputs = self.rough[CONTACT]
        lone = (inputs.modes == FREE).any(axis=1) & (inputs.modes == SLIP).any(axis=1)
        speed = call(SLIP_SPEED, inputs)
        return inputs.only(lone & (speed >= least) & (speed < most))

    def chatters(self) -> Inputs:
        """The first impact of each chatter of one end that goes to its close, but for the longest (at high restitution)."""
        inputs = self.rough[SINGLE]
        hops = call(CHATTER, inputs)
        begins = np.diff(hops, prepend=0.0) != -1.0  # the next impact of a chatter has one fewer before it
        return inputs.only((hops >= CHATTER_HOPS[0]) & (hops <= CHATTER_HOPS[1]) & begins)


VERBS: dict[str, Callable[[Harvest], Timed | Drift]] = {
    "loop alone": lambda found: Timed(ALONE, found.rough[FLIGHT]),
    "gap evaluation": lambda found: Timed(GAP, found.rough[FLIGHT]),
    "Delassus": lambda found: Timed(DELASSUS, found.rough[FLIGHT]),
    "next event in flight": lambda found: Timed(LANDING, found.rough[FLIGHT]),
    "single impact, held": lambda found: Timed(IMPACT, by_route(without_slip(found.rough[SINGLE], True), HELD)),
    "single impact, straight slip": lambda found: Timed(
        IMPACT, by_route(without_slip(found.rough[SINGLE], False), STRAIGHT)
    ),
    "single impact, frictionless": lambda found: Timed(IMPACT, by_route(found.smooth[SINGLE], FRICTIONLESS)),
    "single impact, general": lambda found: Timed(IMPACT, by_route(found.rough[SINGLE], TURNING)),
    "double impact": lambda found: Timed(IMPACT, found.rough[DOUBLE]),
    "double impact, frictionless": lambda found: Timed(IMPACT, found.smooth[DOUBLE]),
    "contact rates": lambda found: Timed(RATES, found.rough[CONTACT]),
    "contact step, plain": lambda found: Timed(STEP, found.slipping(1e-2, inf), step_control.PLAIN_METHOD),
    "contact step, slow": lambda found: Timed(STEP, found.slipping(1e-9, 1e-2), step_control.RESCALED),
    "contact step, slide": lambda found: Timed(STEP, found.slipping(1e-9, 1e-2), step_control.IMPLICIT),
    "contact phase": lambda found: Timed(PHASE_OF_CONTACT, found.rough[CONTACT]),
    "chatter": lambda found: Timed(CHATTER, found.chatters()),
    "drift period": lambda _: Drift(Parameters().row(), 60),
}


def tuned(timed: Timed | Drift, seconds: float) -> int:
    """How many turns take about so long."""
    turns = 1
    timed.run(turns)  # the first call of a process loads the kernel
    while True:
        begun = thread_time()
        timed.run(turns)
        taken = thread_time() - begun
        if taken > 0.3 * seconds:
            return max(1, round(turns * seconds / taken))
        turns *= 4
