"""The return map: whole forcing periods from any state."""

from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.course import motion_of
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.model.body import set_dimer
from dimersweep.kernel.model.layout import PERIOD
from dimersweep.kernel.record import clear_counts
from dimersweep.kernel.verdict.past import begin_past


@exported
def advance(row, state, modes, ask, space, record):
    """Move a state on to the end of a forcing period, over so many such ends, with a record of the way if one is wanted.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units; the start in it is not used.
    state : float64 array, shape (N_STATE,)
        Modified in place; its periods count from zero. From phase zero on these are whole forcing periods.
    modes : float64 array, shape (2,)
        Friction modes of the ends, chosen anew from the state; those at the end are filled in.
    ask : Ask
        What is asked of the periods.
    space : Workspace
        Scratch.
    record : Record
        Filled in place where it has rows; its counts become those of these periods.

    Returns
    -------
    int
        OK or the reason why not.
    """
    motion = motion_of(state, modes, space.past, space)
    begin_past(motion.past[0])
    clear_counts(record.counts)
    state[PERIOD] = 0.0
    set_dimer(row, space.dimer)
    status, _ = evolve(space.dimer, ask, motion, record)
    return status
