"""What tests replace inside the package, each in one place: a renaming there is mended here.

The kernel that studies call, that which is proven before, the compiling, the lengths and the clock of their tasks, the chunks
of cubes above memory, the version of the kernel, and the end of a process.
"""

import sys

import pytest

from dimersweep.work.proving import proof
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


def no_work(patch):
    """Fail where a point or a run is made."""
    for kernel in ("run_many", "run_recorded"):
        patch.setattr(f"dimersweep.runs.solving.{kernel}", lambda *_, **__: pytest.fail("work was done"))


def prove_with(patch, run_many):
    """Let processes begin with another kernel, which is proven anew."""
    patch.setattr("dimersweep.work.proving.run_many", run_many)
    proof.cache_clear()


def set_clock(patch, clock):
    """Let tasks read their time from another clock."""
    patch.setattr("dimersweep.work.tiles.perf_counter", clock)


def set_chunks(patch, points):
    """Have chunks of so many points in cubes above memory."""
    patch.setattr("dimersweep.storage.blocks.CHUNK_POINTS", points)


def no_warm_up(patch):
    """Let work begin without the kernel being compiled."""
    patch.setattr("dimersweep.studies.making.settle_way", lambda progress: None)


def another_version(patch, version="another"):
    """As if the kernel had been edited."""
    for place in ("studies.study", "runs.accessor"):
        patch.setattr(f"dimersweep.{place}.kernel_version", lambda: version)


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
    patch.setattr("dimersweep.work.computing.Pace", lambda size, workers: SteadyPace(length, workers))
