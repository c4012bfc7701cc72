"""The return map of the section at the start of a forcing period: whole periods from any state there."""

from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.model.body import as_dimer
from dimersweep.kernel.model.layout import PERIOD, PHASE
from dimersweep.kernel.verdict.classify import begin_past


@exported
def advance(row, state, modes, periods, rtol, past, work, none, counts):
    """Move a state at the start of a forcing period over whole periods.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units; the start in it is not used.
    state : float64 array, shape (N_STATE,)
        Modified in place; its phase counts as zero, and its periods from zero.
    modes : float64 array, shape (2,)
        Friction modes of the ends, chosen anew from the state; those at the end are filled in.
    periods : int
    rtol : float
    past, work : float64 arrays, shapes (PAST_ROWS, PAST_COLUMNS), (WORK_ROWS, WORK_COLUMNS)
    none : float64 array, shape (0, n)
        In place of a record.
    counts : int64 array, shape (3,)
        The first entry becomes the number of events.

    Returns
    -------
    int
        OK or the reason why not.
    """
    dm = as_dimer(row)
    begin_past(past)
    counts[0], counts[1], counts[2] = 0, 0, 0
    state[PHASE], state[PERIOD] = 0.0, 0.0
    status, _ = evolve(dm, state, modes, periods, rtol, rtol, False, False, past, work, none, none, none, counts)
    return status
