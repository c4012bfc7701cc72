"""What tests replace inside the package, each in one place: a renaming there is mended here.

The kernel that studies call, that which is proven before, where the runs of the kernel are stopped, the compiling, the lengths
and the clock of their tasks, the chunks of cubes above memory, the version of the kernel, and the end of a process.
"""

import sys
from functools import partial
from threading import Event
from time import sleep

import numpy as np
import pytest

from dimersweep.kernel.batch import is_stopped
from dimersweep.kernel.model.event_row import E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import (
    CODE_MODE,
    CODE_N_EVENTS,
    CODE_N_PERIODS,
    CODE_STATUS,
    M_FAILED,
    PERIOD,
    PHASE,
    STOPPED,
)
from dimersweep.kernel.record import EVENT_ROWS, SEGMENT_ROWS
from dimersweep.runs import solving
from dimersweep.work import progress, proving
from dimersweep.work.scheduling import IN_FLIGHT
from dimersweep.work.tiles import TILE_SECONDS


def use_kernel(patch, run_many):
    """Let studies call another kernel, which needs no compiling."""
    patch.setattr("dimersweep.runs.solving.run_many", run_many)


def rows_made(patch, run_many):
    """Let studies call `run_many`, without a warm-up; the rows of the points that it makes, each call one item."""
    made = []

    def counting(rows, *rest, until=0, space=None):
        done = run_many(rows, *rest, until=until)
        made.append(rows[:done].copy())
        return done

    use_kernel(patch, counting)
    no_warm_up(patch)
    return made


def before_each_misfit(patch, call):
    """Call `call(orbit)` before a fit compares an orbit with the data."""
    from dimersweep.analysis.fits import Likelihood  # here: few tests need what it brings, which takes a second

    residuals = Likelihood.residuals
    patch.setattr(Likelihood, "residuals", lambda self, orbit: (call(orbit), residuals(self, orbit))[1])


def every_line(patch):
    """Let a log show each step of the work, and not one in ten seconds."""
    patch.setattr(progress, "in_lines", partial(progress.in_lines, seconds=0.0))


def no_work(patch):
    """Fail where a point or a run is made."""
    for kernel in ("run_many", "run_recorded"):
        patch.setattr(f"dimersweep.runs.solving.{kernel}", lambda *_, **__: pytest.fail("work was done"))


def cut_back(record, phases):
    """Leave in a record what a run has written that was stopped in its smooth phase of this number, 0 for before the first."""
    begun = record.segments[phases - 1]
    noted = record.events[: record.counts[EVENT_ROWS]]
    later = (noted[:, E_PERIOD] > begun[PERIOD]) | (
        (noted[:, E_PERIOD] == begun[PERIOD]) & (noted[:, E_PHASE] > begun[PHASE])
    )
    record.counts[EVENT_ROWS], record.counts[SEGMENT_ROWS] = (~later).sum() if phases else 0, phases


def stop_runs(patch, phases):
    """Stop each recorded run, as the end of its time would, in its smooth phase of this number; 0: before the first event."""
    run_recorded = solving.run_recorded

    def stopped(row, ask, out, codes, record, space=None, start=None):
        run_recorded(row, ask, out, codes, record, space, start)
        if len(record.segments):
            cut_back(record, phases)
            out[:], codes[:] = np.nan, 0
            codes[0, CODE_STATUS], codes[0, CODE_MODE] = STOPPED, M_FAILED
            codes[0, CODE_N_PERIODS] = record.segments[phases - 1, PERIOD] if phases else 0
            codes[0, CODE_N_EVENTS] = record.counts[EVENT_ROWS]

    patch.setattr(solving, "run_recorded", stopped)


def begin_when_stopped(patch):
    """Let recorded runs begin when they have been stopped, however fast the machine is."""
    run_recorded = solving.run_recorded

    def late(row, ask, out, codes, record, space=None, start=None):
        while not is_stopped(space):
            sleep(1e-3)
        run_recorded(row, ask, out, codes, record, space, start)

    patch.setattr(solving, "run_recorded", late)


def prove_with(patch, run_many):
    """Let processes begin with another kernel, which is proven anew."""
    patch.setattr(proving, "run_many", run_many)
    prove_anew(patch)


def prove_anew(patch):
    """Have the kernel not proven yet in this process."""
    patch.setattr(proving, "PROVEN", Event())


def set_clock(patch, clock):
    """Let tasks read their time from another clock."""
    patch.setattr("dimersweep.work.tiles.perf_counter", clock)


def set_chunks(patch, points):
    """Have chunks of so many points in cubes above memory."""
    patch.setattr("dimersweep.storage.blocks.CHUNK_POINTS", points)


def no_warm_up(patch):
    """Let work begin without the kernel being compiled."""
    patch.setattr("dimersweep.studies.making.prepare_kernel", lambda progress: None)


def another_version(patch, version="another"):
    """As if the kernel had been edited."""
    for place in ("studies.study", "runs.accessor"):
        patch.setattr(f"dimersweep.{place}.kernel_version", lambda *code: version)


def exit_plainly(patch):
    """Let a command that a signal has stopped end as Python does."""
    patch.setattr("dimersweep.cli.interrupting.os._exit", sys.exit)


class SteadyPace:
    """In place of `Pace`: tasks of a given length."""

    seconds = TILE_SECONDS

    def __init__(self, length, workers=lambda: 1):
        self.length, self.workers = length, workers

    @property
    def in_flight(self):
        """As of `Pace`."""
        return IN_FLIGHT * self.workers()

    def note(self, points, seconds):
        """Learn nothing."""


def set_pace(patch, length):
    """Cut sweeps into tasks of `length` points."""
    patch.setattr("dimersweep.work.computing.Pace", lambda size, workers, demand: SteadyPace(length, workers))
