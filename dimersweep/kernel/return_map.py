"""The return map of the start of a forcing period: whole periods from any state there."""

from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.course import Ask, motion_of
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.model.body import as_dimer
from dimersweep.kernel.model.layout import PERIOD, PHASE
from dimersweep.kernel.record import clear_counts
from dimersweep.kernel.verdict.classify import begin_past


@exported
def advance(row, state, modes, periods, rtol, space, record):
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
    space : Workspace
        Scratch.
    record : Record
        Of the periods, where it has rows; its counts become those of these periods.

    Returns
    -------
    int
        OK or the reason why not.
    """
    begin_past(space.past)
    clear_counts(record.counts)
    state[PHASE], state[PERIOD] = 0.0, 0.0
    ask = Ask(periods, rtol, rtol, False, False)
    status, _ = evolve(as_dimer(row), ask, motion_of(state, modes, space.past, space), record)
    return status
