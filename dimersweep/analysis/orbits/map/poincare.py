"""The Poincaré map of the dimer: from a section to itself, in the coordinates that contact leaves free there.

The section is a phase of the plate away from the events of the orbit. A point of the section is the row of those
coordinates of `period_map.NAMES` that are free in the contact there, in their units. The axial spin is one of them; the
others are the fast part. The cost of all runs is counted in forcing periods.

Where the kernel cannot go on, or the motion comes to the section in another contact, the orbit is lost (see `lost`).
A fault of the kernel raises `KernelError` instead.
"""

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from dimersweep.analysis.orbits.map.lost import OrbitLost, attempt, require
from dimersweep.analysis.orbits.map.passage import TURN, Passage
from dimersweep.errors import KernelError, ParameterError
from dimersweep.kernel.batch import run_request
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import (
    JAMMED,
    MAX_EVENTS,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    RECORD_FULL,
    STATUS_MESSAGES,
    Dimer,
)
from dimersweep.kernel.model.plate import started_at
from dimersweep.kernel.passage import R_SPIN, Read, Reading, new_reading
from dimersweep.kernel.record import SEGMENT_MODES, Record, new_record, no_record
from dimersweep.kernel.return_map import OTHER_CONTACT, advance, images
from dimersweep.kernel.sample import sample
from dimersweep.kernel.section import SPIN_COORDINATE, STEEP, SUNK
from dimersweep.parameters import bounds, check, fill_rows, slots_of
from dimersweep.runs.period_map import Section, free_coordinates
from dimersweep.runs.solving import MAX_ROWS, RECORD_GROWTH, RECORD_ROWS

# longest leap over a change of sequence within one branch, in units of the section: beyond a longer one lies another
# orbit
JOINED = 0.1
MARGIN = 0.03  # least distance of a section from the next event, in forcing periods: nearer, another section is better
# length of a smooth phase, in forcing periods, from which on fewer free coordinates make a better section than more
# length
LONG = 0.1

WHY_NONE = {
    SUNK: "an end meets the plate at the section",
    STEEP: "no dimer is so steep",
    OTHER_CONTACT: "the contact at the section changes",
    **{status: STATUS_MESSAGES[status] for status in (MAX_EVENTS, JAMMED, RECORD_FULL)},
}

T = TypeVar("T")


class Recorder:
    """The scratch arrays, the record and the count of forcing periods that all maps of one task share.

    The kernel writes into the record, which grows when it is full.
    """

    def __init__(self) -> None:
        self.space = new_workspace()
        self.periods = 0.0  # forcing periods that have been run
        self.record = new_record(RECORD_ROWS)

    def run(
        self, row: np.ndarray, start: np.ndarray, periods: int, rtol: float, path: bool = False
    ) -> tuple[np.ndarray, np.ndarray, Passage]:
        """Return the state and the friction modes after `periods` ends of forcing periods, and the record of the run.

        With `path`, the run follows x1, y1 and gamma, too.
        """
        self.periods += periods - start[PHASE] / TURN
        ask = run_request(periods, rtol, path=path)

        def made(record: Record, reading: Reading) -> tuple[int, np.ndarray, np.ndarray]:
            state, modes = start.copy(), np.zeros(2)
            return advance(row, state, modes, ask, self.space, record, reading), state, modes

        (status, state, modes), reading = self._recorded(1, made)
        _check(status)
        return state, modes, self.passages(reading, [np.empty(0)])[0]

    def images(self, m: "ReturnMap", points: np.ndarray, chained: bool) -> tuple[np.ndarray, Reading]:
        """Return the images of points of a map, shape (n, k), and the numbers that are read off the record.

        With `chained`, each point but the first is the image of the one before, see ``return_map.images``.
        """
        own = (m.plain_row, m.section.units, points, m.free, m.of_section, m.modes, m.ask)
        found = np.empty(points.shape)

        def made(record: Record, reading: Reading) -> tuple[int, int]:
            return images(*own, chained, self.space, record, reading, found)

        (status, count), reading = self._recorded(len(points), made)
        self.periods += m.periods * count
        _check(status)
        return found, reading

    def _recorded(self, passages: int, made: Callable[[Record, Reading], tuple[Any, ...]]) -> tuple[Any, Reading]:
        """Call `made` with larger and larger records until one is not full; return its result and the reading."""
        while True:
            rows = len(self.record.events)
            reading = new_reading(passages, rows)
            told = made(self.record, reading)
            if told[0] != RECORD_FULL or rows >= MAX_ROWS:
                return told, reading
            self.record = new_record(RECORD_GROWTH * rows)

    def passages(self, reading: Reading, points: Iterable[np.ndarray]) -> list[Passage]:
        """Return a copy of each passage in the record, with the image that it leads to."""
        found, event, segment = [], 0, 0
        for read, point in zip(map(Read._make, reading.rows.tolist()), points, strict=True):
            events, segments = slice(event, int(read.events)), slice(segment, int(read.segments))
            rows = self.record.events[events].copy(), self.record.segments[segments].copy()
            found.append(Passage(*rows, reading.symbols[events].copy(), read, point))
            event, segment = events.stop, segments.stop
        return found


@dataclass(eq=False)
class ReturnMap:
    """The return map of one dimer on one plate, over the forcing periods after which a motion repeats."""

    parameters: dict[str, float]  # parameters of the model, validated
    phase: float  # phase of the plate at the section [rad]
    modes: np.ndarray  # friction modes of the ends at the section, shape (2,)
    periods: int  # forcing periods of the motion
    rtol: float  # accuracy [1]
    recorder: Recorder
    # value to which the spin is put back once in each forcing period [rad/s]. This makes the map of the fast part
    # alone, whose fixed points are periodic in all coordinates. If it is None, the spin drifts slowly
    spin: float | None = None
    # phase of the plate at which the spin is put back [rad]. Within a period the spin swings by some hundred times its
    # loss. So the sixth digit of a border depends on this phase, but not on the section
    back: float = 0.0

    def __post_init__(self) -> None:
        # for the parameter that changes along a curve: its bounds beside the other parameters, and its slots in a row
        self.judged: dict[str, tuple[float, float, list[int]]] = {}
        # steps of differences, in units of the section. They balance the error of a difference, step^2 if it is central
        # and step if it is one-sided, with the error from the map, rtol/step
        self.step, self.one_sided = self.rtol ** (1 / 3), self.rtol**0.5
        self.free = np.array(free_coordinates(self.modes))
        self.slow = int(np.flatnonzero(self.free == SPIN_COORDINATE)[0])
        self.of_section = np.array([self.phase, self.back, np.nan if self.spin is None else self.spin])
        self.ask = run_request(self.periods, self.rtol)
        self._take_row(fill_rows(self.parameters, 1)[0])

    def _take_row(self, row: np.ndarray) -> None:
        """Take the kernel's row of the parameters, with the plate at `phi0` at the start."""
        self.plain_row, self.section = row, Section(row, self.rtol, self.recorder.space)
        self.unit = float(self.section.units[SPIN_COORDINATE])  # unit of the spin [rad/s]
        vars(self).pop("row", None)

    @cached_property
    def row(self) -> np.ndarray:
        """Row of parameters for the kernel, with the plate at the phase of the section at the start."""
        return self.row_at(self.phase)

    @property
    def dimer(self) -> Dimer:
        """Dimer of the kernel."""
        return dimer_of(self.row)

    def at(self, name: str, value: float) -> "ReturnMap":
        """Return the map in the same section at another value of a parameter, if it is allowed beside the others."""
        if value == self.parameters.get(name):
            return self
        parameters = self.parameters | {name: value}
        if name not in self.judged:
            self.judged = {name: (*bounds(name, self.parameters), slots_of(name, parameters))}
        low, high, slots = self.judged[name]
        if not low <= value <= high:
            try:
                check(parameters)
            except ParameterError as error:
                raise OrbitLost(str(error)) from error
        moved = copy(self)
        moved.parameters = parameters
        row = self.plain_row.copy() if slots else fill_rows(parameters, 1)[0]
        row[slots] = value
        moved._take_row(row)
        return moved

    def row_at(self, phase: float) -> np.ndarray:
        """Return the row of parameters for the kernel, with the plate at `phase` [rad] at the start."""
        return started_at(self.plain_row, phase)

    def state(self, z: np.ndarray) -> np.ndarray:
        """Return the kernel's state at a point of the section.

        There is none where an end is below the plate, or higher above the other end than the dimer is long.
        """
        point = np.zeros(self.section.units.size)
        point[self.free] = z
        state, status = self.section.judged_state(point, self.modes)
        _check(status)
        return state

    def passage(self, z: np.ndarray) -> Passage:
        """Return the passage from a point to its image, after the periods of the motion."""
        return self.chain(z, 1)[0]

    def chain(self, z: np.ndarray, count: int) -> list[Passage]:
        """Return the passage from a point to its image, from there to the image of that, and so on, `count` in all."""
        points = np.empty((count, z.size))
        points[0] = z
        found, reading = self.recorder.images(self, points, True)
        return self.recorder.passages(reading, found)

    def images(self, points: np.ndarray) -> np.ndarray:
        """Return the images of points, shape (n, k), with the spins in their unit as a last column."""
        found, reading = self.recorder.images(self, points, False)
        return np.column_stack([found, reading.rows[:, R_SPIN] / self.unit])

    def jacobian(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the image, shape (n, n), and of the spin (in its unit), shape (n,), at a point."""
        rows = self.differences(z)
        return rows[:-1], rows[-1]

    def differences(
        self,
        z: np.ndarray,
        senses: np.ndarray | None = None,
        mark: Callable[["ReturnMap", Passage], float] | None = None,
    ) -> np.ndarray:
        """Return the derivatives of the image, of the spin in its unit, and of a `mark`, by the coordinates.

        Parameters
        ----------
        z : ndarray, shape (n,)
            Point of the section.
        senses : ndarray, shape (n,), optional
            Side, 1 or -1, to which the difference by each coordinate is taken, as where an end grazes; by default the
            differences are central.
        mark : callable, optional
            Function of a map and a passage.

        Returns
        -------
        ndarray, shape (n + 1, n) or, with a mark, (n + 2, n)
            One row for each coordinate of the image, for the spin, and for the mark.
        """
        steps = np.diag(np.full(z.size, self.step) if senses is None else self.one_sided * senses)
        back = z - steps if senses is None else [z]
        points = np.concatenate([z + steps, back])
        if mark is None:
            seen = self.images(points)
        else:
            along = [self.passage(point) for point in points]
            seen = np.array([[*passage.point, passage.spin / self.unit, mark(self, passage)] for passage in along])
        return (seen[: z.size] - seen[z.size :]).T / (np.diag(steps) * (2 if senses is None else 1))

    def in_own_section(
        self, now: T, passage: Passage, make: Callable[["ReturnMap", np.ndarray], T], simplest: bool = True
    ) -> T:
        """Return ``make(map, point)`` in a better section if this one does not suit the motion, else `now`.

        A section does not suit if an event has come near or, with `simplest`, if fewer coordinates are free elsewhere
        in the period. `now` is returned, too, if `make` finds no orbit in the better section.
        """
        inner = passage.times[np.mod(passage.times, TURN) > 0]
        near = inner.size and min(inner[0], self.periods * TURN - inner[-1]) <= MARGIN * TURN
        if near or (simplest and self.free.size > best_phase(passage, self.periods).free):
            better = attempt(lambda: make(*self.moved(passage)))
            return now if better is None else better
        return now

    def moved(self, passage: Passage) -> tuple["ReturnMap", np.ndarray]:
        """Return the map with its section in the middle of the best smooth phase, and the point of the motion there."""
        return self.moved_to(passage, best_phase(passage, self.periods).middle)

    def sections(self, passage: Passage) -> Iterator[tuple["ReturnMap", np.ndarray]]:
        """Yield the map with its section in the middle of each smooth phase of a motion, and the motion's point there.

        The longest phase comes first. Phases are left out that are too short, or in which the spin alone is free.
        """
        for phase in sorted(smooth_phases(passage, self.periods), key=lambda phase: -phase.length):
            if 0.5 * phase.length > MARGIN * TURN and phase.free > 1:
                yield self.moved_to(passage, phase.middle)

    def moved_to(self, passage: Passage, at: float) -> tuple["ReturnMap", np.ndarray]:
        """Return the map with its section later by the phase `at` [rad], and the motion's point there."""
        at %= TURN * self.periods
        state, contact = self.sampled(passage, at)
        moved = replace(self, phase=(self.phase + at) % TURN, modes=contact)
        return moved, moved.section.point(state)[moved.free]

    def sampled(self, passage: Passage, phase: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the kernel state and the friction modes at a phase since the section [rad]."""
        states, modes = self.states(passage, np.array([phase]))
        return states[0], modes[0]

    def states(self, passage: Passage, phases: np.ndarray, which: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the kernel states and the friction modes at phases since the section [rad].

        `which` is the number of the smooth phase, or of the smooth phase for each; by default they are looked up.
        """
        segments = passage.segments
        if which is None:
            which = np.searchsorted(passage.times, phases, side="right") - 1
        states, modes = np.zeros((phases.size, N_STATE)), np.zeros((phases.size, 2))
        at, which, space = phases - TURN * segments[which, PERIOD], np.full(phases.size, which), self.recorder.space
        status = sample(self.row, segments, which, at, self.rtol, space, no_record(), states, modes, np.zeros((0, 0)))
        _check(status)
        return states, modes


def _check(status: int) -> None:
    """Require that a motion goes on, by its status; raise KernelError for a fault of the kernel."""
    require(status not in WHY_NONE, WHY_NONE.get(status, ""))
    if status != OK:
        raise KernelError(STATUS_MESSAGES[status])


class SmoothPhase(NamedTuple):
    """A stretch of a motion without an event."""

    middle: float  # phase of its middle since the section [rad]
    length: float  # its length [rad]
    free: int  # number of coordinates that contact leaves free there


def smooth_phases(passage: Passage, periods: int) -> list[SmoothPhase]:
    """Return the smooth phases of a motion.

    The phase in which the section lies begins before the section and ends after it. It comes last, in its full length.
    """
    (events,) = np.nonzero(np.mod(passage.times, TURN) > 0)
    starts = passage.times[events] if events.size else np.zeros(1)
    lengths = np.diff(np.append(starts, starts[0] + TURN * periods))
    modes = passage.segments[events if events.size else [0], SEGMENT_MODES : SEGMENT_MODES + 2]
    free = [len(free_coordinates(pair)) for pair in modes]
    return [
        SmoothPhase(*phase) for phase in zip((starts + 0.5 * lengths).tolist(), lengths.tolist(), free, strict=True)
    ]


def best_phase(passage: Passage, periods: int) -> SmoothPhase:
    """Return the smooth phase of a motion that suits a section best.

    It has the fewest free coordinates of those that are longer than `LONG` or, if none is, of all. The longest of
    several is taken.
    """
    phases = smooth_phases(passage, periods)
    return min(phases, key=lambda phase: (phase.length < LONG * TURN, phase.free, -phase.length))
