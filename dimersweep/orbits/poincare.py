"""The Poincaré map of the dimer: from a section to itself, in the coordinates that contact leaves free there.

The section is a phase of the plate that lies away from the events of the orbit. A point of it is the row of those
coordinates of `period_map.NAMES` that are free in the contact there, in their units; the axial spin is one of them, the
rest is the fast part. The cost of all that is asked here is counted in forcing periods.

Whatever is asked of the map, or of what is built on it, may be lost (`OrbitLost`): where the kernel cannot go on, or the motion
comes to another contact. A fault of the kernel is none of this (`KernelError`).
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from dimersweep.errors import KernelError, OrbitError, ParameterError
from dimersweep.kernel.batch import ask_for
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import (
    JAMMED,
    MAX_EVENTS,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    RECORD_FULL,
    SPIN,
    STATUS_MESSAGES,
    THETA,
)
from dimersweep.kernel.model.plate import started_at
from dimersweep.kernel.record import EVENT_ROWS, SEGMENT_MODES, SEGMENT_ROWS, new_record, no_record
from dimersweep.kernel.return_map import advance
from dimersweep.kernel.sample import sample
from dimersweep.orbits.passage import TURN, Passage
from dimersweep.parameters import bounds, check, fill_rows
from dimersweep.runs.period_map import NAMES, Section, free_coordinates
from dimersweep.runs.solving import MAX_ROWS, RECORD_GROWTH, RECORD_ROWS

SPIN_COORDINATE = NAMES.index("spin")
MARGIN = 0.03  # distance of the section from the next event that is too small, in forcing periods
LONG = 0.1  # length of a smooth phase from which on the simpler contact counts for more than more length

T = TypeVar("T")


class OrbitLost(OrbitError):
    """The map cannot be taken here, or leads to another contact: in one line, why."""


@contextmanager
def singular_lost() -> Iterator[None]:
    """Matrices that have no inverse or no eigenvectors, as an orbit that is lost; also for functions, as their decorator."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise OrbitLost(f"the derivatives there are of no use ({error})") from error


def first_found(ways: Iterable[Callable[[], T]]) -> T:
    """What the first of some ways leads to that leads anywhere; if none does, it is lost for the last one's reason."""
    reason: OrbitError = OrbitLost("there is nothing to begin with")
    for way in ways:
        try:
            return way()
        except OrbitError as error:
            reason = error
    raise reason


def in_steps(step: Callable[[T, float], T], begin: T, least: float) -> T:
    """Where steps lead, each from where the one before has led, up to a share of the way; half as long where one is lost.

    It is lost where steps would have to be shorter than `least`.
    """
    here, done, length = begin, 0.0, 1.0
    while done < 1.0:
        to = min(1.0, done + length)
        try:
            here, done, length = step(here, to), to, 2 * length
        except OrbitLost as reason:
            length *= 0.5
            if length < least:
                raise OrbitLost(f"{reason}, {done:.0%} of the way") from reason
    return here


class Image(NamedTuple):
    """Where a point goes: the image in the free coordinates, the spin [rad/s], the change of theta [rad], the record."""

    point: np.ndarray
    spin: float
    theta: float
    passage: Passage


class Recorder:
    """What the maps of one task share: the record that the kernel writes, grown when it is full, and the count of periods."""

    def __init__(self) -> None:
        self.space = new_workspace()
        self.periods = 0.0  # forcing periods that have been run
        self.bounds: dict[tuple[object, ...], tuple[float, float]] = {}  # of a parameter beside the others
        self.record = new_record(RECORD_ROWS)

    def run(
        self, row: np.ndarray, start: np.ndarray, periods: int, rtol: float, path: bool = False
    ) -> tuple[np.ndarray, np.ndarray, Passage]:
        """State and friction modes after whole periods, and the record."""
        self.periods += periods - start[PHASE] / TURN
        while True:
            state, modes = start.copy(), np.zeros(2)
            status = advance(row, state, modes, ask_for(periods, rtol, path=path), self.space, self.record)
            if status != RECORD_FULL or len(self.record.events) >= MAX_ROWS:
                break
            self.record = new_record(RECORD_GROWTH * len(self.record.events))
        _check(status)
        events, segments = (self.record.counts[which] for which in (EVENT_ROWS, SEGMENT_ROWS))
        passage = Passage(self.record.events[:events].copy(), self.record.segments[:segments].copy())
        return state, modes, passage


@dataclass(eq=False)
class ReturnMap:
    """The map of one dimer on one plate over the periods of a motion."""

    parameters: dict[str, float]  # of the model, validated
    phase: float  # phase of the plate at the section [rad]
    modes: np.ndarray  # friction modes of the ends there, shape (2,)
    periods: int  # forcing periods of the motion
    rtol: float  # accuracy [1]
    recorder: Recorder
    # to which the spin is put back at the start of each forcing period [rad/s]: the map of the fast part alone, all of
    # whose fixed points close; without it the spin drifts slowly
    spin: float | None = None
    # phase of the plate at which that is done [rad]: within a period the spin swings by some hundred times its loss, so a
    # border depends in its sixth digit on it, but not on the section
    back: float = 0.0

    def __post_init__(self) -> None:
        self.row = self.row_at(self.phase)
        self.section = Section(self.row, self.rtol, self.recorder.space)
        self.dimer = self.section.dm
        self.free = np.array(free_coordinates(self.modes))
        self.slow = int(np.flatnonzero(self.free == SPIN_COORDINATE)[0])
        self.unit = float(self.section.units[SPIN_COORDINATE])  # of the spin [rad/s]
        # they balance the error of differences, step^2 of central and step of one-sided ones, with that of the map, rtol/step
        self.step, self.one_sided = self.rtol ** (1 / 3), self.rtol**0.5

    def at(self, name: str, value: float) -> "ReturnMap":
        """The map in the same section at another value of a parameter; lost if it is not allowed beside the others."""
        if value == self.parameters.get(name):
            return self
        others = (name, *(item for item in self.parameters.items() if item[0] != name))
        if others not in self.recorder.bounds:
            self.recorder.bounds[others] = bounds(name, self.parameters)
        low, high = self.recorder.bounds[others]
        parameters = self.parameters | {name: value}
        if not low <= value <= high:
            try:
                check(parameters)
            except ParameterError as error:
                raise OrbitLost(str(error)) from error
        return replace(self, parameters=parameters)

    def row_at(self, phase: float) -> np.ndarray:
        """The kernel's row of the parameters, with the plate at `phase` [rad] at the start."""
        return started_at(fill_rows(self.parameters, 1)[0], phase)

    def state(self, z: np.ndarray) -> np.ndarray:
        """The kernel's state at a point.

        It is lost if an end is below the plate, or higher above the other one than the dimer is long.
        """
        point = np.zeros(len(NAMES))
        point[self.free] = z
        if point[0] < 0 or point[1] < 0:
            raise OrbitLost("an end meets the plate at the section")
        if not abs(point[1] - point[0]) * self.section.units[0] < self.dimer.l:
            raise OrbitLost("no dimer is so steep")
        return self.section.held(self.section.state(point), self.modes)

    def image(self, z: np.ndarray) -> Image:
        """The image of a point after the periods of the motion.

        Its spin is that after the last impact of the bouncer, or the one before it is put back. It is lost in another contact.
        """
        if self.spin is not None:
            state, modes, passage, spin = self._at_fixed_spin(self.state(z), self.spin)
        else:
            state, modes, passage = self.recorder.run(self.row, self.state(z), self.periods, self.rtol)
            struck = passage.last_impact(passage.bouncer)
            spin = state[SPIN] if struck is None else struck[SPIN]
        if (modes != self.modes).any():
            raise OrbitLost("the contact at the section changes")
        return Image(self.section.point(state)[self.free], float(spin), float(state[THETA]), passage)

    def _at_fixed_spin(self, state: np.ndarray, spin: float) -> tuple[np.ndarray, np.ndarray, Passage, float]:
        """State and friction modes after the periods, the way from where the spin was last put back, and the spin before."""
        row, since = self.row_at(self.back), (self.phase - self.back) % TURN
        there = Section(row, self.rtol, self.recorder.space)
        for k in range(self.periods):
            state[PHASE] = since if k == 0 else 0.0
            state, modes, _ = self.recorder.run(row, state, 1, self.rtol)
            theta, before, point = state[THETA], float(state[SPIN]), there.point(state)
            point[SPIN_COORDINATE] = spin / self.unit
            state = there.held(there.state(point), modes)
            state[THETA] = theta
        state[PHASE], state[PERIOD] = TURN - since, 0.0
        return *self.recorder.run(self.row, state, 1, self.rtol), before

    def jacobian(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the image, shape (n, n), and of the spin (in its unit), shape (n,), by central differences."""
        rows = self.differences(z, lambda image: np.append(image.point, image.spin / self.unit))
        return rows[:-1], rows[-1]

    def differences(
        self, z: np.ndarray, read: Callable[[Image], np.ndarray], senses: np.ndarray | None = None
    ) -> np.ndarray:
        """Derivatives by the coordinates of what `read` returns of an image, one row each.

        They are central, or with `senses` (1 or -1) of the coordinates to one side only, as where an end grazes.
        """
        if senses is None:
            widths = np.full(z.size, 2 * self.step)
            pairs = [(self.image(z + d), self.image(z - d)) for d in self.step * np.eye(z.size)]
        else:
            widths, here = self.one_sided * senses, self.image(z)
            pairs = [(self.image(z + d), here) for d in np.diag(widths)]
        return np.array([read(ahead) - read(back) for ahead, back in pairs]).T / widths

    def in_own_section(
        self, now: T, passage: Passage, make: Callable[["ReturnMap", np.ndarray], T], simplest: bool = True
    ) -> T:
        """`now`, or, if this section does not suit the motion, what `make(map, point)` returns for a better one.

        A section does not suit if events have come near, or (`simplest`) if simpler contact lasts elsewhere in the period. If
        `make` finds no orbit in the better section, `now` is returned.
        """
        inner = passage.times[np.mod(passage.times, TURN) > 0]
        near = inner.size and min(inner[0], self.periods * TURN - inner[-1]) <= MARGIN * TURN
        if near or (simplest and self.free.size > best_phase(passage, self.periods).free):
            with suppress(OrbitLost):
                return make(*self.moved(passage))
        return now

    def moved(self, passage: Passage) -> tuple["ReturnMap", np.ndarray]:
        """The map with its section halfway through the best smooth phase of the motion, and the motion's point there."""
        return self.moved_to(passage, best_phase(passage, self.periods).middle)

    def sections(self, passage: Passage) -> Iterator[tuple["ReturnMap", np.ndarray]]:
        """The map with its section halfway through each smooth phase that is long enough and leaves more free than the spin."""
        for phase in sorted(smooth_phases(passage, self.periods), key=lambda phase: -phase.length):
            if 0.5 * phase.length > MARGIN * TURN and phase.free > 1:
                yield self.moved_to(passage, phase.middle)

    def moved_to(self, passage: Passage, at: float) -> tuple["ReturnMap", np.ndarray]:
        """The map with its section at a phase since the one it has [rad], and the motion's point there."""
        at %= TURN * self.periods
        state, contact = self.sampled(passage, at)
        moved = replace(self, phase=(self.phase + at) % TURN, modes=contact)
        return moved, moved.section.point(state)[moved.free]

    def sampled(self, passage: Passage, phase: float) -> tuple[np.ndarray, np.ndarray]:
        """Kernel state and friction modes at a phase since the section [rad]."""
        states, modes = self.states(passage, np.array([phase]))
        return states[0], modes[0]

    def states(self, passage: Passage, phases: np.ndarray, which: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Kernel states and friction modes at phases since the section [rad], all in one smooth phase or each in its own."""
        segments = passage.segments
        if which is None:
            which = np.searchsorted(passage.times, phases, side="right") - 1
        states, modes = np.zeros((phases.size, N_STATE)), np.zeros((phases.size, 2))
        at, which, space = phases - TURN * segments[which, PERIOD], np.full(phases.size, which), self.recorder.space
        status = sample(self.row, segments, which, at, self.rtol, space, no_record(), states, modes, np.zeros((0, 0)))
        _check(status)
        return states, modes


def _check(status: int) -> None:
    """Refuse what the kernel has come to: a motion that does not go on is no orbit, a fault of the kernel is an error."""
    if status in (MAX_EVENTS, JAMMED, RECORD_FULL):
        raise OrbitLost(STATUS_MESSAGES[status])
    if status != OK:
        raise KernelError(STATUS_MESSAGES[status])


class SmoothPhase(NamedTuple):
    """A stretch of a motion without an event."""

    middle: float  # since the section [rad]
    length: float  # [rad]
    free: int  # number of coordinates that contact leaves free there


def smooth_phases(passage: Passage, periods: int) -> list[SmoothPhase]:
    """The smooth phases of a motion; that in which the section lies is counted once, in its full length."""
    (events,) = np.nonzero(np.mod(passage.times, TURN) > 0)
    starts = passage.times[events] if events.size else np.zeros(1)
    lengths = np.diff(np.append(starts, starts[0] + TURN * periods))
    modes = passage.segments[events if events.size else [0], SEGMENT_MODES : SEGMENT_MODES + 2]
    free = [len(free_coordinates(pair)) for pair in modes]
    return [
        SmoothPhase(*phase) for phase in zip((starts + 0.5 * lengths).tolist(), lengths.tolist(), free, strict=True)
    ]


def best_phase(passage: Passage, periods: int) -> SmoothPhase:
    """A smooth phase that suits a section: of those longer than `LONG` one with the fewest free coordinates, the longest."""
    phases = smooth_phases(passage, periods)
    return min(phases, key=lambda phase: (phase.length < LONG * TURN, phase.free, -phase.length))
