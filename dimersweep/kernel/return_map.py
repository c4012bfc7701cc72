"""The return map: whole forcing periods from any state, and the images of points of a section (``section``)."""

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.course import RunRequest, motion_of
from dimersweep.kernel.event_loop import evolve
from dimersweep.kernel.model.body import set_dimer
from dimersweep.kernel.model.layout import N_ROW, OK, PERIOD, PHASE, ROW_PHI0, SPIN, THETA
from dimersweep.kernel.model.plate import start_later
from dimersweep.kernel.numerics.sincos import TWO_PI
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.passage import R_SPIN, read_passage
from dimersweep.kernel.record import EVENT_ROWS, SEGMENT_ROWS, clear_counts, without_rows
from dimersweep.kernel.section import N_POINT, SPIN_COORDINATE, judge, set_point, set_state
from dimersweep.kernel.verdict.past import begin_past

# status without an image, beside those of `section.judge`: the motion comes to the section in another contact
OTHER_CONTACT = -1


@compiled
def move_on(dm, state, modes, request, space, record):
    """Move a state on as `advance` does, with the dimer already set; return the status.

    Rows are added to the record, and nothing is read off it.
    """
    motion = motion_of(state, modes, space.past, space)
    begin_past(motion.past[0])
    state[PERIOD] = 0.0
    return evolve(dm, request, motion, record)[0]


@exported
def advance(row, state, modes, request, space, record, reading):
    """Move a state on to the end of a forcing period, over a number of such ends, with a record if one is wanted.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units; the start in it is not used.
    state : float64 array, shape (N_STATE,)
        Modified in place; its periods count from zero. From phase zero on these are whole forcing periods.
    modes : float64 array, shape (2,)
        Friction modes of the ends, chosen anew from the state; those at the end are filled in.
    request : RunRequest
        Request for the periods.
    space : Workspace
        Scratch.
    record : Record
        Filled in place where it has rows; its counts become those of these periods.
    reading : Reading
        Reading of one passage; filled in from the record.

    Returns
    -------
    int
        OK or the status of a motion that could not go on.
    """
    set_dimer(row, space.dimer[0])
    clear_counts(record.counts)
    status = move_on(space.dimer[0], state, modes, request, space, record)
    if status == OK:
        read_passage(space.dimer[0], state, record, 0, 0, 0, space.later_state, reading)
    return status


@exported
def images(row, units, points, free, section, modes, request, chained, space, record, reading, found):
    """Find the images of points of a section after the same periods, one after the other.

    Parameters
    ----------
    row : float64 array, shape (N_ROW,)
        Parameters in the order of ``layout.ROW``, SI units; the start in it is not used.
    units : float64 array, shape (N_POINT,)
        Units of the coordinates of the section.
    points : float64 array, shape (n, k)
        Points in the coordinates that are free in the contact at the section.
    free : int64 array, shape (k,)
        Numbers of these coordinates.
    section : float64 array, shape (3,)
        Phase of the plate at the section [rad]; the phase at which the spin is put back in each period [rad]; and the
        spin [rad/s], NaN if it is not put back.
    modes : float64 array, shape (2,)
        Friction modes of the ends at the section.
    request : RunRequest
        Request for the periods.
    chained : bool
        True if each point but the first is the image of the point before, filled in here.
    space : Workspace
        Scratch.
    record : Record
        Filled in place: the rows of all passages, one after the other; of each after the spin was last put back.
    reading : Reading
        Reading of n passages; filled in. If the spin is put back, it has the spin before that.
    found : float64 array, shape (n, k)
        Images, filled in.

    Returns
    -------
    status, made : int, int
        OK or the status of the last image, which is none then; number of images, the last one counted.
    """
    phase, back, spin = section[0], section[1], section[2]
    dm = space.dimer[0]
    set_started(row, phase, space.row, dm)
    if spin == spin:
        set_started(row, back, space.row, space.later_dimer[0])
    clear_counts(record.counts)
    for k in range(points.shape[0]):
        if chained and k > 0:
            copy(found[k - 1], points[k], points.shape[1])
        status = image(units, points[k], free, section, modes, request, space, record, reading, k, found[k])
        if status != OK:
            return status, k + 1
    return OK, points.shape[0]


@compiled
def set_started(row, phase, later, dm):
    """Set the dimer of a row on a plate that is at `phase` at the start; the row `later` is scratch."""
    copy(row, later, N_ROW)
    start_later(later, phase - row[ROW_PHI0])
    later[ROW_PHI0] = phase % TWO_PI
    set_dimer(later, dm)


@compiled
def image(units, z, free, section, modes, request, space, record, reading, k, found):
    """Find the k-th of the images, see `images`; return OK or a status without an image."""
    dm, state, reached, point = space.dimer[0], space.state, space.modes, space.twin_state[:N_POINT]
    for j in range(N_POINT):
        point[j] = 0.0
    for j in range(free.shape[0]):
        point[free[j]] = z[j]
    status = judge(dm, units, point)
    if status != OK:
        return status
    set_state(dm, units, point, modes, state)
    begin, fixed, before = request, section[2] == section[2], 0.0
    if fixed:
        status, before = to_fixed_spin(units, section, request, space, record, point)
        if status != OK:
            return status
        begin = RunRequest(1, request.rtol, request.close, request.settle, request.path)
    first_event, first_segment = record.counts[EVENT_ROWS], record.counts[SEGMENT_ROWS]
    reached[0], reached[1] = 0.0, 0.0
    status = move_on(dm, state, reached, begin, space, record)
    if status != OK:
        return status
    read_passage(dm, state, record, first_event, first_segment, k, space.later_state, reading)
    if fixed:
        reading.rows[k, R_SPIN] = before
    if reached[0] != modes[0] or reached[1] != modes[1]:
        return OTHER_CONTACT
    set_point(state, units, point)
    for j in range(free.shape[0]):
        found[j] = point[free[j]]
    return OK


@compiled
def to_fixed_spin(units, section, request, space, record, point):
    """Move the state of the workspace on from the section to where the spin is put back for the last time.

    That is in the last of the periods. Return the status, and the spin before it was put back. `point` is scratch.
    """
    state, reached, none = space.state, space.modes, without_rows(record)
    phase, back, spin = section[0], section[1], section[2]
    since, before = (phase - back) % TWO_PI, 0.0
    period = RunRequest(1, request.rtol, request.close, request.settle, request.path)
    for k in range(request.periods):
        state[PHASE] = since if k == 0 else 0.0
        reached[0], reached[1] = 0.0, 0.0
        status = move_on(space.later_dimer[0], state, reached, period, space, none)
        if status != OK:
            return status, before
        theta, before = state[THETA], state[SPIN]
        set_point(state, units, point)
        point[SPIN_COORDINATE] = spin / units[SPIN_COORDINATE]
        set_state(space.dimer[0], units, point, reached, state)
        state[THETA] = theta
    state[PHASE] = TWO_PI - since
    return OK, before
