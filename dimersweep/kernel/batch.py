"""Many runs one after the other, each to its verdict; what Python calls."""

from math import nan
from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.event_loop import (
    WORK_COLUMNS,
    WORK_ROWS,
    evolve,
    start_state,
)
from dimersweep.kernel.impact.impact import N_LOG
from dimersweep.kernel.model.body import as_dimer
from dimersweep.kernel.model.layout import (
    FREE,
    M_APERIODIC,
    M_FAILED,
    M_UNRESOLVED,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    ROW,
)
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.verdict.classify import (
    PAST_COLUMNS,
    PAST_ROWS,
    begin_past,
    last_strobe,
    verdict,
)

BETA0, XDOT0 = ROW.index("beta0"), ROW.index("xdot0")
# evidence of aperiodic motion: a twin of the run (its plate phase shifted) separates from it by so much, in g/omega and
# g/omega^2. Both are followed over stretches of so many periods, one stretch for so many periods of the run, at least one.
EVIDENCE = 64  # periods of a run below which it is not looked for: too few to have settled
STRETCH, STRETCH_FOR, TWIN_SHIFT, SEPARATED = 24, 200, 1e-6, 1e-2


@exported
def run_rows(rows, periods, rtol, settle, until, path, out, codes, desk, log, events, segments, counts):
    """Verdicts of runs one after the other, and the record of the last of them where `log`, `events` and `segments` have rows.

    Parameters
    ----------
    rows : float64 array, shape (n, N_ROW)
        Parameters in the order of ``layout.ROW``, SI units.
    periods : int
        Forcing periods of each run at most.
    rtol : float
        The one accuracy knob.
    settle : bool
        Stop each run when its motion has settled.
    until : int
        Set of modes, as a sum of 2**mode: the first run with one of them is the last one made.
    path : bool
        Whether x1, y1 and gamma are wanted.
    out : float64 array, shape (n, N_OUT)
        Filled in the order of ``layout.OUT``.
    codes : int64 array, shape (n, N_CODES)
        Filled in the order of ``layout.CODES``.
    desk : Desk
        Scratch arrays, from ``new_desk``.
    log, events, segments, counts : arrays
        The record, see ``evolve``.

    Returns
    -------
    int
        Number of runs made.
    """
    state, modes, past, work = desk.state, desk.modes, desk.past, desk.work
    for k in range(rows.shape[0]):
        row = rows[k]
        dm = as_dimer(row)
        start_state(dm, row[BETA0], row[XDOT0], state)
        modes[0], modes[1] = FREE, FREE
        begin_past(past)
        counts[0], counts[1], counts[2] = 0, 0, 0
        # the run itself; if it has not settled, a stretch more of it, the same of its twin, and so on in turn
        for leg in range(1 + 2 * max(1, periods // STRETCH_FOR)):
            first, twin = leg == 0, leg > 0 and leg % 2 == 0
            status, at_rest = evolve(
                dm,
                desk.twin if twin else state,
                desk.twin_modes if twin else modes,
                periods if first else codes[k, 5] + STRETCH * ((leg + 1) // 2),
                rtol,
                rtol,
                settle and first,
                path,
                past,
                work,
                log if first else log[:0],
                events if first else events[:0],
                segments if first else segments[:0],
                counts,
            )
            if first:
                mode, p, end = verdict(dm, past, at_rest, out[k])
                if status != OK:
                    mode, p, end = M_FAILED, 0, 0
                    for j in range(out.shape[1]):
                        out[k, j] = nan
                codes[k, 0], codes[k, 1], codes[k, 2], codes[k, 3] = status, mode, p, end
                codes[k, 4], codes[k, 5] = counts[0], int(state[PERIOD])
                if mode != M_UNRESOLVED or periods < EVIDENCE:
                    break
                copy(state, desk.twin, N_STATE)
                copy(modes, desk.twin_modes, 2)
                desk.twin[PHASE] = TWIN_SHIFT
            elif status != OK:
                break
            elif last_strobe(past, desk.strobe) > SEPARATED and twin:
                codes[k, 1] = M_APERIODIC
                break
        if until >> codes[k, 1] & 1:
            return k + 1
    return rows.shape[0]


class Desk(NamedTuple):
    """Scratch arrays of one thread."""

    state: Any
    modes: Any
    past: Any
    work: Any
    twin: Any
    twin_modes: Any
    strobe: Any


def new_desk() -> Desk:
    """Scratch arrays for ``run_rows``: the compiled code allocates nothing."""
    return Desk(
        np.zeros(N_STATE),
        np.zeros(2),
        np.zeros((PAST_ROWS, PAST_COLUMNS)),
        np.zeros((WORK_ROWS, WORK_COLUMNS)),
        np.zeros(N_STATE),
        np.zeros(2),
        np.zeros(4),
    )


def run_many(rows, periods, rtol, settle, out, codes, until=0) -> int:
    """Verdicts of many runs, unrecorded: ``run_rows`` with scratch arrays of its own, so that threads may share nothing."""
    none, counts = np.zeros((0, N_LOG)), np.zeros(3, np.int64)
    return run_rows(rows, periods, rtol, settle, until, False, out, codes, new_desk(), none, none, none, counts)


def run_recorded(rows, periods, rtol, settle, path, out, codes, log, events, segments, counts) -> None:
    """One run with its record: see ``run_rows`` and ``evolve``."""
    run_rows(rows, periods, rtol, settle, 0, path, out, codes, new_desk(), log, events, segments, counts)
