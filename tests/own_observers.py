"""Observers as a user writes them, outside the package."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dimersweep import observer

PER_PERIOD, PERIODS, LINES = 16, 8, 4
RATE = {"units": "rad s-1", "long_name": "size of lines of theta's rate"}


def lines_of(run):
    """Sizes of the lines of theta's rate at multiples of an eighth of the forcing frequency."""
    cycles = run.n_periods - np.arange(PERIODS * PER_PERIOD) / PER_PERIOD
    rate = run.states(cycles / run.parameters["f"])["theta_rate"].values
    return np.abs(np.fft.rfft(rate - rate.mean())) / rate.size


def die_at_run(number, calls):
    """Count the calls in a file, and have the process die at one of them."""
    time.sleep(0.1)
    with calls.open("a") as file:
        file.write(".")
    if calls.stat().st_size == number:
        os._exit(9)


@observer(
    peak={"units": "Hz", "long_name": "frequency of the largest line of theta's rate"},
    lines=RATE | {"along": {"name": "harmonic", "values": [1, 2, 3, 4]}},
)
def spectral(run):
    """A line spectrum; nothing of a run that is too short."""
    if path := os.environ.get("DIE_AT"):
        die_at_run(20, Path(path))
    if run.n_periods < PERIODS:
        return {}
    sizes = lines_of(run)
    return {
        "peak": sizes.argmax() / PERIODS * run.parameters["f"],
        "lines": sizes[PERIODS : PERIODS * (LINES + 1) : PERIODS],
    }


@observer(turned={"units": "rad", "long_name": "angle that theta turns by"})
def turned(run):
    """Fails where a file says so."""
    if Path("fails").exists() and abs(run.parameters["Gamma"] - 0.9) < 1e-9:
        raise ZeroDivisionError("at 0.9, for one")
    theta = run.states([0.0, run.duration])["theta"].values
    return {"turned": theta[1] - theta[0]}


@dataclass(frozen=True)
class Scaled:
    """One with an argument."""

    factor: float

    def __call__(self, run):
        """Its factor times the number of events."""
        return {"scaled": self.factor * run.n_events}


observer(scaled={"units": "1", "long_name": "events, scaled"})(Scaled)


@observer(wrong={"units": "1", "long_name": "of another shape"})
def misshapen(run):
    """An array in place of a number."""
    return {"wrong": np.zeros(3)}


@observer(last={"units": "1", "long_name": "number of the last period"})
def counted(run):
    """Another one."""
    return {"last": run.n_periods}


@observer(stop_when_settled=True, last={"units": "1", "long_name": "number of the last period"})
def stopped(run):
    """One that is content with a run as far as it was made."""
    return {"last": run.n_periods}


@observer(spans={"units": "m", "long_name": "greatest gap of p2 in the first second"})
def fixed_time(run):
    """Looks at a time that not every run reaches which stops when it has settled."""
    return {"spans": run.states(np.linspace(0, 1, 40))["gap_2"].max()}


def bare(run):
    """Without a declaration."""
    return {}


@observer(mode={"units": "1", "long_name": "a name that cubes have"})
def same_name(run):
    """Named as the mode is."""
    return {"mode": 1.0}


@observer(a={"units": "1", "long_name": "along the axis", "along": {"name": "Gamma", "values": 3}})
def same_axis(run):
    """Along a dimension that cubes have."""
    return {"a": np.zeros(3)}


@observer(nothing={"units": "1", "long_name": "nothing, slowly"})
def slow(run):
    """Takes its time."""
    time.sleep(0.25)
    return {}
