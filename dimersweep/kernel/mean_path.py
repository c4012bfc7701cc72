"""The mean path of a drift: the circle that the centre of mass goes round, as a camera sees it.

Within a forcing period the centre of mass swings to and fro about that circle. The speed in (11) is that of one moment,
right after the double impact, and most of its part along the axis is undone within the period. So the radius of (11) is
larger than that of the path where zeta is far from a right angle, as it is where the spin is slow.
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.course import RunRequest
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.model.body import centre, set_dimer
from dimersweep.kernel.model.layout import GAMMA, N_STATE, OK, PERIOD, PHASE, THETA, V_RATE, X1, Y1
from dimersweep.kernel.model.plate import start_later
from dimersweep.kernel.numerics.elementary import length
from dimersweep.kernel.numerics.sincos import TWO_PI, sincos
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.verdict.past import begin_past

ARCS = 4  # parts of a forcing period: with these the radius of the base case's path is known to 1e-5 m


@compiled
def note_path(dm, request, run, later, space, record, out):
    """Write radius and speed of the mean path of a drift into its outcome.

    They are taken from the forcing period that follows the run. The period is cut in ARCS parts. Their chords are
    turned back, by the precession up to the middle of each of them. Let the places be z = c + e^(i w t) (R + s(t)),
    where the swing s repeats in each period and has the mean 0. Let a = w T be the turn of a period. Then the sum of
    the chords is 2 i ARCS sin(a / (2 ARCS)) times the mean of R + s over the ends of the parts.

    Parameters
    ----------
    run, later : Motion
        The run at its end, which stays as it is, and the motion that goes on from there.
    space : Workspace
        Scratch; the run stands in it, and its parameters, which change.
    record : Record
        Without rows.

    Returns
    -------
    int
        OK or the status of a motion that could not go on.
    """
    state, moved = later.state, space.later_dimer[0]
    copy(run.state, state, N_STATE)
    copy(run.modes, later.modes, 2)
    state[X1] = state[Y1] = state[GAMMA] = 0.0  # only their changes count
    begin_past(later.past[0])
    step, part = out.orbit[V_RATE] * dm.period / ARCS, TWO_PI / ARCS
    start_later(space.row, part - TWO_PI)
    heading, (x, y) = state[THETA], centre(dm, state)
    along, across = 0.0, 0.0
    # each part is the last of a forcing period, of a plate whose phase is ahead by as much: `evolve` ends at period
    # ends
    for k in range(ARCS):
        state[PHASE], state[PERIOD] = TWO_PI - part, 0.0
        set_dimer(space.row, moved)
        status, _ = evolve(moved, RunRequest(1, request.rtol, request.close, False, True), later, record)
        if status != OK:
            return status
        start_later(space.row, part)
        next_x, next_y = centre(dm, state)
        s, c = sincos((k + 0.5) * step)
        along += c * (next_x - x) + s * (next_y - y)
        across += c * (next_y - y) - s * (next_x - x)
        x, y = next_x, next_y
    turn = state[THETA] - heading
    s, _ = sincos(0.5 * turn / ARCS)
    # the factor is that of an arc over its chord
    path_length = length(along, across) * (0.5 * turn / ARCS / s if s != 0.0 else 1.0)
    out.path_speed = path_length / dm.period
    if turn != 0.0:
        out.path_radius = path_length / abs(turn)
    return OK
