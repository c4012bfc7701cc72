"""Make many runs one after the other, each to its verdict; Python calls the functions of this module."""

from math import nan

import numpy as np

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.compiler.records import record_type
from dimersweep.kernel.course import RunRequest, Workspace, motion_of, new_workspace
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
# shortest run, in forcing periods, that is tested for aperiodic motion: a shorter run has not had the time to settle
EVIDENCE = 64
# test for aperiodic motion: the run and a twin, whose plate phase is shifted by TWIN_SHIFT [rad], are followed over
# stretches of STRETCH periods, one stretch for every STRETCH_FOR periods of the run, at least one. The motion is
# aperiodic if the two come apart by SEPARATED, in g/omega^2 (gaps) and g/omega (gap rates).
STRETCH, STRETCH_FOR, TWIN_SHIFT, SEPARATED = 24, 200, 1e-6, 1e-2


@exported
def run_rows(rows, starts, request, until, out, codes, space, record):
    """Make runs one after the other, each to its verdict; record the last of them where the record has rows.

    Parameters
    ----------
    rows : float64 array, shape (n, N_ROW)
        Parameters in the order of ``layout.ROW``, SI units.
    starts : float64 array, shape (n, N_START)
        States and friction modes to start from, each at the start of a forcing period, in place of the starts in
        `rows`; without rows, those count. Where its periods are not 0 a run goes on, with the past in the workspace.
    request : RunRequest
        Request for each run; its periods include those before the start.
    until : int
        Set of modes, as a sum of 2**mode: the first run with one of them is the last run made. A run that is stopped
        is not made, and neither are the runs after it.
    out : float64 array, shape (n, N_OUT)
        Filled in the order of ``layout.OUT``.
    codes : int64 array, shape (n, N_CODES)
        Filled in the order of ``layout.CODES``.
    space : Workspace
        Scratch arrays; ``stop`` ends the runs on them.
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
        # where the heading counts, the verdict on the track needs the path
        path = request.path or dm.sideways != 0.0
        whole = RunRequest(request.periods, request.rtol, request.close, request.settle, path)
        run_to_verdict(dm, whole, run, record, outcome, code)
        status = OK
        if code.mode == M_UNRESOLVED and request.periods >= EVIDENCE:
            twin = motion_of(space.twin_state, space.twin_modes, space.later_past, space)
            status, apart = follow_with_twin(dm, request, run, later, twin, kept)
            if apart:
                code.mode = M_APERIODIC
        elif code.mode == M_DRIFT:
            copy(rows[k], space.row, N_ROW)
            status = note_path(dm, request, run, later, space, kept, outcome)
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
    """Replace every nan by the nan of Python: the sign bit of 0/0 depends on the processor."""
    for k in range(N_OUT):
        if values[k] != values[k]:
            values[k] = nan


@compiled
def begin_run(dm, row, starts, k, run):
    """Set the start of a run: that of its row, or the k-th of `starts`."""
    if starts.shape[0] == 0:
        start_state(dm, row, run.state)
        run.modes[0], run.modes[1] = FREE, FREE
    else:
        copy(starts[k], run.state, N_STATE)
        run.modes[0], run.modes[1] = starts[k, N_STATE], starts[k, N_STATE + 1]
    if run.state[PERIOD] == 0.0:
        begin_past(run.past[0])


@compiled
def run_to_verdict(dm, request, run, record, out, codes):
    """Make a run from its start to its verdict; fill its outcome."""
    clear_counts(record.counts)
    status, at_rest = evolve(dm, request, run, record)
    codes.status, codes.n_events, codes.n_periods = status, record.counts[EVENT_COUNT], int(run.state[PERIOD])
    verdict(dm, run.state, run.past[0], at_rest, request.periods - codes.n_periods, codes, out)
    # the mode is one of BOTH_DOWN: for `in` Numba would compile functions of its own
    if codes.mode == M_REST or codes.mode == M_ROLLS or codes.mode == M_SLIDES:
        out.orbit[V_SPEED] = length(run.state[CA], run.state[CB])
    if status != OK:
        note_failure(status, out, codes)


@compiled
def note_failure(status, out, codes):
    """Fill the outcome of a run that could not go on: its status, and no numbers."""
    clear_outcome(codes, out)
    codes.status, codes.mode = status, M_FAILED


@compiled
def follow_with_twin(dm, request, run, later, twin, record):
    """Continue a run that has not settled, once as `later` and once as its `twin`, until both have come apart.

    The plate phase of the twin is shifted at the start. Both go on in stretches. The run itself stays as it ended. Both
    share one past, of which only the last strobes count: one of each, after each stretch.

    Returns
    -------
    status, apart : int, bool
        OK or the status of a motion that could not go on; True if the two came apart.
    """
    begin_past(later.past[0])
    later.past[0].fastest = run.past[0].fastest
    for which in range(2):
        motion = later if which == 0 else twin
        copy(run.state, motion.state, N_STATE)
        copy(run.modes, motion.modes, 2)
    twin.state[PHASE] = TWIN_SHIFT
    begun = int(run.state[PERIOD])
    for stretch in range(max(1, request.periods // STRETCH_FOR)):
        further = RunRequest(begun + STRETCH * (stretch + 1), request.rtol, request.close, False, request.path)
        for which in range(2):
            status, _ = evolve(dm, further, later if which == 0 else twin, record)
            if status != OK:
                return status, False
        # the strobes of `later` and `twin` over this stretch follow each other in the past: STRETCH strobes back is the
        # last strobe of `later`
        if change(later.past[0], STRETCH, 0) > SEPARATED:
            return OK, True
    return OK, False


def run_request(periods, rtol, settle=False, path=False) -> RunRequest:
    """Return the request for a run, in the types that the compiled code expects."""
    return RunRequest(int(periods), float(rtol), float(rtol), bool(settle), bool(path))


def stop(space: Workspace) -> None:
    """Stop the runs on the scratch arrays of a thread: they end within a few steps, and stay stopped."""
    space.work.meter[0].stop = True


def is_stopped(space: Workspace) -> bool:
    """Return True if the runs on these scratch arrays were stopped."""
    return bool(space.work.meter[0].stop)


def run_many(rows, periods, rtol, settle, out, codes, until=0, space: Workspace | None = None) -> int:
    """Make many runs to their verdicts, unrecorded; return the number of runs made.

    See ``run_rows``. Without `space` it has scratch arrays of its own.
    """
    request, nowhere = run_request(periods, rtol, settle), np.zeros((0, N_START))
    return run_rows(rows, nowhere, request, until, out, codes, space or new_workspace(), no_record())


def run_recorded(row, request, out, codes, record, space: Workspace | None = None, start=None) -> None:
    """Make one run with its record; see ``run_rows``.

    The end of the run and its past stand in the workspace, if one is passed.
    """
    starts = np.zeros((0, N_START)) if start is None else start
    run_rows(row[None], starts, request, 0, out, codes, space or new_workspace(), record)
