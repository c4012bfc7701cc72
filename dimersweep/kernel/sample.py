"""States of a recorded run at any time: each is moved again from the start of the smooth phase it lies in."""

from dimersweep.kernel.body import as_dimer
from dimersweep.kernel.charts import load, unload
from dimersweep.kernel.engine import ROW_Y, hold_rest, no_slip
from dimersweep.kernel.flight import fly, take_off
from dimersweep.kernel.glide import OUT_OF_STEPS, glide
from dimersweep.kernel.jit import compiled, exported
from dimersweep.kernel.layout import CONTACT_STEPS, FREE, N_STATE, OK, PERIOD, PHASE
from dimersweep.kernel.steps import copy


@compiled
def before(segment, period, phase):
    """Whether a segment starts at or before a time."""
    return segment[PERIOD] < period or (segment[PERIOD] == period and segment[PHASE] <= phase)


@compiled
def last_before(segments, period, phase):
    """Number of the last segment that starts at or before a time (bisection; the first if none does)."""
    low, high = 0, segments.shape[0]
    while high - low > 1:
        mid = (low + high) // 2
        if before(segments[mid], period, phase):
            low = mid
        else:
            high = mid
    return low


@exported
def sample(row, segments, periods, phases, rtol, work, states, modes):
    """Kernel states of a run at given times.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
    segments : float64 array, shape (n, N_STATE + 2)
        Starts of the smooth phases (``record``).
    periods, phases : float64 arrays, shape (k,)
        Completed forcing periods and plate phase since then [rad] of each time.
    rtol : float
    work : float64 array, shape (WORK_ROWS, WORK_COLUMNS)
    states : float64 array, shape (k, N_STATE)
        Filled in place.
    modes : float64 array, shape (k, 2)
        Friction modes of the ends, filled in place.

    Returns
    -------
    int
        OK or the reason why not.
    """
    dm = as_dimer(row)
    y = work[ROW_Y]
    for k in range(periods.shape[0]):
        segment = segments[last_before(segments, periods[k], phases[k])]
        state, mode = states[k], modes[k]
        copy(segment, state, N_STATE)
        mode[0], mode[1] = segment[N_STATE], segment[N_STATE + 1]
        span = (phases[k] - state[PHASE]) / dm.omega + (periods[k] - state[PERIOD]) * dm.T
        if span <= 0.0:
            continue
        if mode[0] == FREE and mode[1] == FREE:
            fly(dm, take_off(dm, state), state, span, True)
            continue
        unload(dm, state, -1.0 if mode[0] != FREE else 1.0, y)
        hold_rest(dm, mode, y)
        t, event = glide(dm, mode, y, state[PHASE] + dm.phi0, span, True, rtol, no_slip(dm, state, rtol), False, work)
        load(dm, mode, y, state)
        state[PHASE] += dm.omega * t
        if event == OUT_OF_STEPS:
            return CONTACT_STEPS
    return OK
