"""What the kernel answers in some scenes: modes, and states after a few forcing periods; ``python ways.py FILE`` saves it.

Without a file, it answers each line that it is given by the time of a forcing period.
"""

import gc
import sys
from time import thread_time

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import run_many, run_recorded, run_request
from dimersweep.kernel.compiler.pipelines import pipeline
from dimersweep.kernel.model.layout import CODES, N_STATE, PHASE, State
from dimersweep.kernel.record import new_record, rows_of
from dimersweep.parameters import Parameters
from tests.checks.data import data

RTOL = 1e-8
SPEEDS = dict.fromkeys(("n1", "n2", "ca", "cb"), 0.1)
SCALE = State(*[1.0] * N_STATE)._replace(d1=0.01, d2=0.01, **SPEEDS, wb=10.0, wp=10.0, spin=100.0)  # SI units


def last_state(row, periods):
    """Kernel state at the end of some forcing periods, in its scales."""
    record = new_record(20_000)
    run_recorded(row, run_request(periods, RTOL, path=True), *blank(1), record)
    _, segments = rows_of(record)
    state = segments[-1, :N_STATE]
    state[PHASE] = np.round(state[PHASE], 12)  # 0 or the end of the period
    return state / SCALE


def answers(periods=200, few=4):
    """Integer outcomes of the scenes, shape (n, N_CODES), and states after `few` periods, shape (n, N_STATE)."""
    rows = np.array([Parameters(**scene).row() for scene in data("scenes")["ways"]["scenes"]])
    out, codes = blank(len(rows))
    run_many(rows, periods, RTOL, True, out, codes)
    return codes[:, : CODES.index("n_events")], np.array([last_state(row, few) for row in rows])


def period_time(periods=1000):
    """Time on the processor of a forcing period of the base case [s]."""
    out, codes = blank(1)
    begun = thread_time()
    run_many(Parameters().row()[None], periods, RTOL, False, out, codes)
    return (thread_time() - begun) / periods


if __name__ == "__main__":
    if sys.argv[1:]:
        gc.disable()  # a compiler leaves little garbage, and looking for it takes a while
        codes, states = answers()
        np.savez(sys.argv[1], codes=codes, states=states, way=pipeline())
    for _ in sys.stdin if not sys.argv[1:] else ():
        print(period_time(), flush=True)
