"""What the verbs of the kernel are timed on: states before landings, impacts and contact phases of recorded runs."""

from typing import NamedTuple

import numpy as np

from dimersweep import simulate
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import (
    D1,
    D2,
    DIP,
    FREE,
    N1,
    N2,
    N_STATE,
    PERIOD,
    PHASE,
)
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES, no_record
from dimersweep.kernel.sample import sample
from dimersweep.runs.run import Run
from tests.checks.scenes import random_scene

RTOL = 1e-8
FLIGHT, SINGLE, DOUBLE, CONTACT = "flight", "single", "double", "contact"


class Inputs(NamedTuple):
    """Scenes, and m states that occur in them.

    Attributes
    ----------
    rows : ndarray, shape (s, N_ROW)
        Parameters of each scene in the kernel's order.
    scene : ndarray, shape (m,), int64
        The scene that each state is of, ascending.
    states : ndarray, shape (m, N_STATE)
    modes : ndarray, shape (m, 2)
        Friction modes of the ends.
    """

    rows: np.ndarray
    scene: np.ndarray
    states: np.ndarray
    modes: np.ndarray

    def only(self, chosen: np.ndarray) -> "Inputs":
        """The states where `chosen` holds."""
        return Inputs(self.rows, self.scene[chosen], self.states[chosen], self.modes[chosen])


def before_landings(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """States just before the events that end the smooth phases of a run, and which ends land there, shape (n, 2)."""
    record = run.record("inputs")
    row, segments = record.row, record.segments
    starts, ends = segments[:-1].copy(), segments[1:]
    starts[:, SEGMENT_HOP_TIME] = 0.0  # hops that were summed stay so
    states, modes = np.zeros((len(starts), N_STATE)), np.zeros((len(starts), 2))
    # one rounding below its end a phase still goes on; across the end of a forcing period nothing happens
    same = starts[:, PERIOD] == ends[:, PERIOD]
    phases = np.where(same, np.nextafter(ends[:, PHASE], 0.0), starts[:, PHASE])
    which, none = np.arange(len(phases)), np.zeros((0, 0))
    sample(row, starts, which, phases, run.rtol, new_workspace(), no_record(), states, modes, none)
    open_before = starts[:, SEGMENT_MODES:SEGMENT_HOP_TIME] == FREE
    lands = open_before & (ends[:, [D1, D2]] == 0.0) & same[:, None] & (states[:, [N1, N2]] < 0.0)
    return states, lands


def closed(states: np.ndarray, shut: np.ndarray) -> np.ndarray:
    """The states with the gaps where `shut`, shape (n, 2), set to zero, and the dip where both are."""
    states = states.copy()
    states[:, [D1, D2]] = np.where(shut, 0.0, states[:, [D1, D2]])
    states[:, DIP] = np.where(shut.all(axis=1), 0.0, states[:, DIP])
    return states


def occurring(run: Run) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """States and friction modes of one run, by what begins with them."""
    segments = run.record("inputs").segments
    modes, starts = segments[:, SEGMENT_MODES:SEGMENT_HOP_TIME], segments[:, :N_STATE]
    free = (modes == FREE).all(axis=1)
    states, lands = before_landings(run)
    shut = lands | (modes[:-1] != FREE)
    hits = closed(states, shut)
    double = lands.any(axis=1) & shut.all(axis=1)
    single = lands.any(axis=1) & ~double
    none = np.zeros((len(hits), 2))
    return {
        FLIGHT: (starts[free], modes[free]),
        CONTACT: (starts[~free], modes[~free]),
        SINGLE: (hits[single], none[single]),
        DOUBLE: (hits[double], none[double]),
    }


def harvest(runs: list[Run]) -> dict[str, Inputs]:
    """The states of all runs, by what begins with them."""
    rows = np.array([run._record.row for run in runs])
    found = [occurring(run) for run in runs]
    inputs = {}
    for kind in (FLIGHT, SINGLE, DOUBLE, CONTACT):
        counts = [len(one[kind][0]) for one in found]
        inputs[kind] = Inputs(
            rows,
            np.repeat(np.arange(len(runs)), counts),
            np.concatenate([one[kind][0] for one in found]),
            np.concatenate([one[kind][1] for one in found]),
        )
    return inputs


def scenes(random: int, frictionless: bool = False) -> list[dict[str, float]]:
    """The paper's base case and a number of random scenes."""
    rub = {"mu": 0.0, "mu_s": 0.0} if frictionless else {}
    return [rub, *(random_scene(seed) | rub for seed in range(random))]


def record(random: int, periods: int, frictionless: bool = False) -> dict[str, Inputs]:
    """Inputs from runs of the base case and of random scenes."""
    made = [simulate(**scene, periods=periods, rtol=RTOL) for scene in scenes(random, frictionless)]
    return harvest([run for run in made if run.status == "ok"])
