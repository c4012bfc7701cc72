"""The track that the centre of mass draws on the plate, from period boundary to period boundary, once the motion has settled.

Where the centre of a circle moves steadily, the track is a cycloid, r = c + U t + R (cos theta, sin theta) with the heading
theta turned by a fixed angle. Kept are the last whole turn of the heading and what the velocity did in it.
"""

from math import nan, pi

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import TWO_PI, centre
from dimersweep.kernel.model.layout import (
    THETA,
    TR_ARC,
    TR_CIRCLE,
    TR_CUSPS,
    TR_LOOPS,
    TR_NONE,
    TR_REVERSALS,
    TR_STRAIGHT,
    TR_WAVES,
)
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import sincos
from dimersweep.kernel.verdict.past import TRACK_ROW, time_of

TURNED_BACK = 0.1  # turning of the heading [rad] that counts: less is straight, and a reversal comes back by more
STANDS = 0.01  # speed of a circle's centre, in that of the dimer, below which it stands
NO_SPEED = 0.01  # speed in g/omega below which a velocity has no direction

# columns of the row of the track
T_BEGUN, T_KIND, T_U_X, T_U_Y = range(4)  # whether there is one; what it is, and the velocity of its centre [m/s]
T_TIME, T_X, T_Y, T_HEADING = range(4, 8)  # where the turn began
T_LAST_TIME, T_LAST_X, T_LAST_Y, T_LAST_HEADING = range(8, 12)  # at the last period boundary
T_FAR, T_BEND, T_LENGTH, T_CUSP = range(12, 16)  # of the turn: furthest heading, turning of the velocity, path, cusps
T_V_X, T_V_Y = range(16, 18)  # last mean velocity over a period that has a direction [m/s]


@compiled
def note_track(dm, state, past):
    """Note the place and the heading of a period boundary.

    On a level plate the heading is of no consequence, so that the centre of a circle stands: its place is not wanted.
    """
    x, y = 0.0, 0.0
    if dm.sideways != 0.0:
        x, y = centre(dm, state)
    follow_track(past[TRACK_ROW], time_of(dm, state), x, y, state[THETA], NO_SPEED * dm.g / dm.omega)


@compiled
def follow_track(row, time, x, y, heading, no_speed):
    """Take a track on to its next point.

    Parameters
    ----------
    row : float64 array, shape (18,) or longer
        Of the track, all zeros before its first point; modified in place.
    time, x, y, heading : float
        Of the point [s], [m], [rad].
    no_speed : float
        Speed below which a velocity has no direction [m/s].
    """
    if row[T_BEGUN] == 0.0:
        row[T_BEGUN], row[T_KIND], row[T_U_X], row[T_U_Y] = 1.0, TR_NONE, nan, nan
        begin_turn(row, time, x, y, heading)
    else:
        note_velocity(row, time, x, y, no_speed)
        turned = heading - row[T_HEADING]
        if abs(turned) > abs(row[T_FAR]):
            row[T_FAR] = turned
        if abs(turned) >= TWO_PI:
            end_turn(row, time, x, y, heading)
            begin_turn(row, time, x, y, heading)
        elif abs(row[T_FAR]) > TURNED_BACK and abs(row[T_FAR] - turned) > TURNED_BACK:
            row[T_KIND] = TR_CUSPS if row[T_CUSP] != 0.0 else TR_REVERSALS
            row[T_U_X], row[T_U_Y] = nan, nan
            begin_turn(row, time, x, y, heading)
    row[T_LAST_TIME], row[T_LAST_X], row[T_LAST_Y], row[T_LAST_HEADING] = time, x, y, heading


@compiled
def begin_turn(row, time, x, y, heading):
    """Count a turn from here."""
    row[T_TIME], row[T_X], row[T_Y], row[T_HEADING] = time, x, y, heading
    row[T_FAR], row[T_BEND], row[T_LENGTH], row[T_CUSP] = 0.0, 0.0, 0.0, 0.0


@compiled
def note_velocity(row, time, x, y, no_speed):
    """Note the mean velocity since the last point: how far it turned, and whether by more than a right angle at once."""
    s_x, s_y, took = x - row[T_LAST_X], y - row[T_LAST_Y], time - row[T_LAST_TIME]
    row[T_LENGTH] += length(s_x, s_y)
    v_x, v_y = s_x / took, s_y / took
    if length(v_x, v_y) <= no_speed:
        return
    w_x, w_y = row[T_V_X], row[T_V_Y]
    if w_x != 0.0 or w_y != 0.0:
        bend = atan2(w_x * v_y - w_y * v_x, w_x * v_x + w_y * v_y)
        row[T_BEND] += bend
        if abs(bend) > 0.5 * pi:
            row[T_CUSP] = 1.0
    row[T_V_X], row[T_V_Y] = v_x, v_y


@compiled
def end_turn(row, time, x, y, heading):
    """The velocity of the centre over the whole turn that ended since the last point, and what the track was in it."""
    took, step_took = time - row[T_TIME], time - row[T_LAST_TIME]
    turned, step = heading - row[T_HEADING], heading - row[T_LAST_HEADING]
    u_x, u_y = centre_velocity(
        took, x - row[T_X], y - row[T_Y], turned, step_took, x - row[T_LAST_X], y - row[T_LAST_Y], step
    )
    row[T_U_X], row[T_U_Y] = u_x, u_y
    moved = length(u_x, u_y) * took
    if row[T_CUSP] != 0.0:
        row[T_KIND] = TR_CUSPS
    elif row[T_LENGTH] > 0.0 and abs(turned - row[T_BEND]) > pi:
        row[T_KIND] = TR_WAVES
    else:
        row[T_KIND] = TR_LOOPS if moved > STANDS * row[T_LENGTH] else TR_CIRCLE


@compiled
def centre_velocity(took, x, y, turned, step_took, step_x, step_y, step):
    """Velocity of a circle's centre over a whole turn of the heading, exact where the track is a cycloid [m/s].

    The last step goes beyond the turn by an angle `over`. Taken off are the part w of it that does: on a cycloid, where with
    complex places z = c + U t + A exp(i theta), that is w = (1 - exp(-i over)) / (1 - exp(-i step)), and

        U = (z - w z_step) / (t - w t_step).

    Parameters
    ----------
    took, x, y, turned : float
        Time, displacement and turning of the heading since the turn began [s], [m], [rad]; it is the first that is whole.
    step_took, step_x, step_y, step : float
        Those of the last step.
    """
    over = turned - (TWO_PI if turned > 0.0 else -TWO_PI)
    sin_over, _ = sincos(0.5 * over)
    sin_step, _ = sincos(0.5 * step)
    s, c = sincos(0.5 * (step - over))
    w_x, w_y = sin_over / sin_step * c, sin_over / sin_step * s
    z_x, z_y = x - (w_x * step_x - w_y * step_y), y - (w_x * step_y + w_y * step_x)
    t_x, t_y = took - w_x * step_took, -w_y * step_took
    size = t_x * t_x + t_y * t_y
    return (z_x * t_x + z_y * t_y) / size, (z_y * t_x - z_x * t_y) / size


@compiled
def track_of(row, ahead):
    """What a track is, and the velocity of the circle's centre over the last whole turn; see `layout.TRACKS`.

    The heading turns by the angle `ahead` [rad] in the periods that are left of a run that stopped before: only on a level
    plate does a run that turns do so, and there the centre stands.
    """
    if row[T_BEGUN] == 0.0:
        return TR_NONE, nan, nan
    turned, far = row[T_LAST_HEADING] - row[T_HEADING] + ahead, row[T_FAR]
    if abs(turned) >= TWO_PI:
        return TR_CIRCLE, 0.0, 0.0
    if abs(turned) > abs(far):
        far = turned
    if abs(far) > TURNED_BACK and abs(far - turned) > TURNED_BACK:
        return TR_REVERSALS, nan, nan
    if row[T_KIND] != TR_NONE:
        return int(row[T_KIND]), row[T_U_X], row[T_U_Y]
    if row[T_CUSP] != 0.0:
        return TR_CUSPS, nan, nan
    return TR_ARC if abs(far) > TURNED_BACK else TR_STRAIGHT, nan, nan
