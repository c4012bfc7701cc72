"""Stored impacts, and what tests compare of an impact: its velocities and its works."""

import json
from pathlib import Path

import numpy as np

from dimersweep.kernel.model.layout import STICK
from dimersweep.kernel.model.works import ALONG, N_WORK, PLATE_1, REST_1, SLIP_1, STRUCK_ROWS
from tests.checks.verbs import oracle_state

STORED = json.loads((Path(__file__).parents[1] / "reference" / "small.json").read_text())["impact_cases"]


def end_names(modes):
    """Friction modes as the stored impacts name them."""
    return ["sk" if mode == STICK else "sp" for mode in modes]


def rates_apart(dm, state, expected, V):
    """Largest difference of the generalized rates of a state from others, as speeds of the ends, in units of V."""
    lengths = [1, 1, 1, dm.l, dm.l, dm.p1.r]
    return np.abs((np.asarray(oracle_state(dm, state)[1]) - expected) * lengths).max() / V


def works_apart(dm, work, rows, expected, V):
    """Largest difference of the works of an impact from those of the oracle (normal forces, friction; both ends)."""
    total = work.rows[-STRUCK_ROWS:][:rows, :N_WORK].sum(0)
    assert not total[PLATE_1 : ALONG + 1].any()  # the plate is at rest
    works = np.array([total[REST_1 : REST_1 + 2], total[SLIP_1 : SLIP_1 + 2]])
    return np.abs(works - expected["work"]).max() / max(dm.m * V**2, np.abs(works).max())
