"""Many runs one after the other, each to its verdict; what Python calls."""

from math import nan

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.compiler.records import record_type
from dimersweep.kernel.course import Ask, Workspace, motion_of, new_workspace
from dimersweep.kernel.event_loop import evolve, start_state
from dimersweep.kernel.mean_path import note_path
from dimersweep.kernel.model.body import set_dimer
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    FREE,
    M_APERIODIC,
    M_DRIFT,
    M_FAILED,
    M_REST,
    M_ROLLS,
    M_SLIDES,
    M_UNRESOLVED,
    N_CODES,
    N_OUT,
    N_ROW,
    N_STATE,
    OK,
    PERIOD,
    PHASE,
    STOPPED,
    V_SPEED,
    Codes,
    Outcome,
)
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.record import EVENT_COUNT, clear_counts, no_record, without_rows
from dimersweep.kernel.verdict.classify import clear_outcome, verdict
from dimersweep.kernel.verdict.past import begin_past
from dimersweep.kernel.verdict.settling import change

CODES_TYPE, OUTCOME_TYPE = record_type(Codes), record_type(Outcome)
N_START = N_STATE + 2  # numbers that a run starts from: the state, and the friction modes of the ends
EVIDENCE = 64  # periods of a run below which it is not looked for: too few to have settled
# evidence of aperiodic motion: a twin of the run (its plate phase shifted) separates from it by so much, in g/omega and
# g/omega^2. Both are followed over stretches of so many periods, one stretch for so many periods of the run, at least one.
STRETCH, STRETCH_FOR, TWIN_SHIFT, SEPARATED = 24, 200, 1e-6, 1e-2


@exported
def run_rows(rows, starts, ask, until, out, codes, space, record):
    """Verdicts of runs one after the other, and the record of the last of them where it has rows.

    Parameters
    ----------
    rows : float64 array, shape (n, N_ROW)
        Parameters in the order of ``layout.ROW``, SI units.
    starts : float64 array, shape (n, N_START)
        States and friction modes to start from, each at the start of a forcing period, in place of those in
        the rows; no rows for those. Where its periods are not 0 a run goes on, with the past that stands in the workspace.
    ask : Ask
        What is asked of each run; its periods count those before the start.
    until : int
        Set of modes, as a sum of 2**mode: the first run with one of them is the last one made. A run that is stopped is
        not made, and neither are those after it.
    out : float64 array, shape (n, N_OUT)
        Filled in the order of ``layout.OUT``.
    codes : int64 array, shape (n, N_CODES)
        Filled in the order of ``layout.CODES``.
    space : Workspace
        Scratch arrays; ``stop`` ends what runs on them.
    record : Record
        Filled in place where it has rows.

    Returns
    -------
    int
        Number of runs made.
    """
    run = motion_of(space.state, space.modes, space.past, space)
    later = motion_of(space.later_state, space.later_modes, space.later_past, space)
    dm, kept = space.dimer[0], without_rows(record)
    for k in range(rows.shape[0]):
        outcome, code = out[k, :N_OUT].view(OUTCOME_TYPE)[0], codes[k, :N_CODES].view(CODES_TYPE)[0]
        set_dimer(rows[k], dm)
        begin_run(dm, rows[k], starts, k, run)
        path = ask.path or dm.sideways != 0.0  # where the heading counts, the verdict on the track takes it
        run_to_verdict(dm, Ask(ask.periods, ask.rtol, ask.close, ask.settle, path), run, record, outcome, code)
        status = OK
        if code.mode == M_UNRESOLVED and ask.periods >= EVIDENCE:
            twin = motion_of(space.twin_state, space.twin_modes, space.later_past, space)
            status, apart = follow_with_twin(dm, ask, run, later, twin, kept)
            if apart:
                code.mode = M_APERIODIC
        elif code.mode == M_DRIFT:
            copy(rows[k], space.row, N_ROW)
            status = note_path(dm, ask, run, later, space, kept, outcome)
        if status == STOPPED:
            note_failure(status, outcome, code)
        keep_one_nan(out[k])
        if code.status == STOPPED:
            return k
        if until >> code.mode & 1:
            return k + 1
    return rows.shape[0]


@compiled
def keep_one_nan(values):
    """Replace what is no number by the one nan: the sign of 0/0, which no number has, is the processor's."""
    for k in range(N_OUT):
        if values[k] != values[k]:
            values[k] = nan


@compiled
def begin_run(dm, row, starts, k, run):
    """The start of a run: that of its row, or the k-th of `starts`."""
    if starts.shape[0] == 0:
        start_state(dm, row, run.state)
        run.modes[0], run.modes[1] = FREE, FREE
    else:
        copy(starts[k], run.state, N_STATE)
        run.modes[0], run.modes[1] = starts[k, N_STATE], starts[k, N_STATE + 1]
    if run.state[PERIOD] == 0.0:
        begin_past(run.past[0])


@compiled
def run_to_verdict(dm, ask, run, record, out, codes):
    """A run from its start to its verdict; fills its outcome."""
    clear_counts(record.counts)
    status, at_rest = evolve(dm, ask, run, record)
    codes.status, codes.n_events, codes.n_periods = status, record.counts[EVENT_COUNT], int(run.state[PERIOD])
    verdict(dm, run.state, run.past[0], at_rest, ask.periods - codes.n_periods, codes, out)
    # one of BOTH_DOWN: `in` has Numba compile functions of its own
    if codes.mode == M_REST or codes.mode == M_ROLLS or codes.mode == M_SLIDES:
        out.orbit[V_SPEED] = length(run.state[CA], run.state[CB])
    if status != OK:
        note_failure(status, out, codes)


@compiled
def note_failure(status, out, codes):
    """The outcome of a run that could not go on."""
    clear_outcome(codes, out)
    codes.status, codes.mode = status, M_FAILED


@compiled
def follow_with_twin(dm, ask, run, later, twin, record):
    """Follow a run that has not settled on as `later`, and a `twin` that starts beside it, in stretches until they are apart.

    The run itself stays as it ended. The two share their past, of which only the last strobe is looked at.

    Returns
    -------
    status, apart : int, bool
        OK or why the two could not go on; whether they came apart.
    """
    begin_past(later.past[0])
    later.past[0].fastest = run.past[0].fastest
    for which in range(2):
        motion = later if which == 0 else twin
        copy(run.state, motion.state, N_STATE)
        copy(run.modes, motion.modes, 2)
    twin.state[PHASE] = TWIN_SHIFT
    begun = int(run.state[PERIOD])
    for stretch in range(max(1, ask.periods // STRETCH_FOR)):
        further = Ask(begun + STRETCH * (stretch + 1), ask.rtol, ask.close, False, ask.path)
        for which in range(2):
            status, _ = evolve(dm, further, later if which == 0 else twin, record)
            if status != OK:
                return status, False
        if change(later.past[0], STRETCH, 0) > SEPARATED:  # from the last strobe of the one to that of the other
            return OK, True
    return OK, False


def ask_for(periods, rtol, settle=False, path=False) -> Ask:
    """What is asked of a run, in the types that the compiled code expects."""
    return Ask(int(periods), float(rtol), float(rtol), bool(settle), bool(path))


def stop(space: Workspace) -> None:
    """Have the runs on the scratch arrays of a thread end within a few steps; they stay stopped."""
    space.work.meter[0].stop = True


def is_stopped(space: Workspace) -> bool:
    """Whether the runs on these scratch arrays were stopped."""
    return bool(space.work.meter[0].stop)


def run_many(rows, periods, rtol, settle, out, codes, until=0, space: Workspace | None = None) -> int:
    """Verdicts of many runs, unrecorded: ``run_rows``, with scratch arrays of its own unless some are given."""
    ask, nowhere = ask_for(periods, rtol, settle), np.zeros((0, N_START))
    return run_rows(rows, nowhere, ask, until, out, codes, space or new_workspace(), no_record())


def run_recorded(row, ask, out, codes, record, space: Workspace | None = None, start=None) -> None:
    """One run with its record, see ``run_rows``; its end and its past stand in the workspace, if one is given."""
    starts = np.zeros((0, N_START)) if start is None else start
    run_rows(row[None], starts, ask, 0, out, codes, space or new_workspace(), record)
