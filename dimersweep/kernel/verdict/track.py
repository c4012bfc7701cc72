"""Follow the track of the centre of mass on the plate, from period boundary to period boundary.

A track begins when the motion has settled. Where the centre of a circle moves steadily, the track is a cycloid. Its
formula is r = c + U t + R (cos theta, sin theta) with the heading theta turned by a fixed angle. The last whole turn of
the heading is kept, and the changes of the velocity in it.
"""

from math import nan, pi
from typing import Annotated, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import TRACK
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import TWO_PI, sincos

# turning of the heading [rad] that counts: a path that turns by less is straight, and a reversal comes back by more
TURNED_BACK = 0.1
STANDS = 0.01  # speed of a circle's centre, over that of the dimer, below which the centre stands


class Fix(NamedTuple):
    """Point of a track, or the difference of two points [s], [m], [rad]."""

    time: float
    x: float
    y: float
    heading: float


class TrackState:
    """Kind of a track so far, and its turn under way."""

    begun: float  # 1.0 if there is a track
    kind: float  # see `layout.TRACKS`
    u_x: float  # velocity of its centre [m s-1]
    u_y: float
    start: Fix  # point at which the turn began
    last: Fix  # point at the last period boundary
    far: float  # furthest heading of the turn, from its start [rad]
    bend: float  # turning of the velocity in the turn [rad]
    length: float  # length of the path in the turn [m]
    cusp: float  # 1.0 if the turn has a cusp
    v_x: float  # last mean velocity over a period that has a direction [m s-1]
    v_y: float
    spare: Annotated[list[float], 6]


@compiled
def put(now, point):
    """Write a point of a track into its record."""
    point.time, point.x, point.y, point.heading = now.time, now.x, now.y, now.heading


@compiled
def difference_from(now, point):
    """Return the difference between a point and an earlier point in a record."""
    return Fix(now.time - point.time, now.x - point.x, now.y - point.y, now.heading - point.heading)


@compiled
def follow_track(track, now, no_speed):
    """Continue a track to its next point.

    Parameters
    ----------
    track : TrackState
        Not begun before its first point; modified in place.
    now : Fix
    no_speed : float
        Speed below which a velocity has no direction [m/s].
    """
    if track.begun == 0.0:
        track.begun, track.kind, track.v_x, track.v_y = 1.0, TRACK.none, 0.0, 0.0
        track.u_x = track.u_y = nan
        begin_turn(track, now)
    else:
        note_velocity(track, difference_from(now, track.last), no_speed)
        turned = now.heading - track.start.heading
        if abs(turned) > abs(track.far):
            track.far = turned
        if abs(turned) >= TWO_PI:
            end_turn(track, difference_from(now, track.start), difference_from(now, track.last))
            begin_turn(track, now)
        elif turned_back(track.far, turned):
            track.kind = TRACK.cusps if track.cusp != 0.0 else TRACK.reversals
            track.u_x = track.u_y = nan
            begin_turn(track, now)
    put(now, track.last)


@compiled
def turned_back(far, turned):
    """Return True if a heading has come back, so that it reverses.

    It has turned by `far` at most since its turn began, and by `turned` until now.
    """
    return abs(far) > TURNED_BACK and abs(far - turned) > TURNED_BACK


@compiled
def begin_turn(track, now):
    """Begin a turn at this point."""
    put(now, track.start)
    track.far = track.bend = track.length = track.cusp = 0.0


@compiled
def note_velocity(track, step, no_speed):
    """Note the mean velocity over a step: the angle by which it turned, and a cusp if that exceeds a right angle."""
    track.length += length(step.x, step.y)
    v_x, v_y = step.x / step.time, step.y / step.time
    if length(v_x, v_y) <= no_speed:
        return
    w_x, w_y = track.v_x, track.v_y
    if w_x != 0.0 or w_y != 0.0:
        bend = atan2(w_x * v_y - w_y * v_x, w_x * v_x + w_y * v_y)
        track.bend += bend
        if abs(bend) > 0.5 * pi:
            track.cusp = 1.0
    track.v_x, track.v_y = v_x, v_y


@compiled
def end_turn(track, whole_turn, step):
    """Set the velocity of the centre over the whole turn that ended in the last step, and the kind of the track."""
    track.u_x, track.u_y = centre_velocity(whole_turn, step)
    if track.cusp != 0.0:
        track.kind = TRACK.cusps
    # without waves the velocity turns by a whole turn, as the heading does, and with waves by none: half a turn lies
    # between
    elif track.length > 0.0 and abs(whole_turn.heading - track.bend) > pi:
        track.kind = TRACK.waves
    else:
        moved = length(track.u_x, track.u_y) * whole_turn.time
        track.kind = TRACK.loops if moved > STANDS * track.length else TRACK.circle


@compiled
def centre_velocity(whole_turn, step):
    """Return the velocity of the centre of a circle over a whole turn of the heading [m/s].

    It is exact where the track is a cycloid. The last step goes beyond the turn by an angle `over`, and the part w of
    the step that does so is taken off. On a cycloid, with complex places z = c + U t + A exp(i theta), it is w = (1 -
    exp(-i over)) / (1 - exp(-i step)), and

        U = (z - w z_step) / (t - w t_step).

    Parameters
    ----------
    whole_turn, step : Fix
        Difference since the turn began, up to the first point at which it is whole; and that of its last step.
    """
    over = whole_turn.heading - (TWO_PI if whole_turn.heading > 0.0 else -TWO_PI)
    sin_over, _ = sincos(0.5 * over)
    sin_step, _ = sincos(0.5 * step.heading)
    s, c = sincos(0.5 * (step.heading - over))
    w_x, w_y = sin_over / sin_step * c, sin_over / sin_step * s
    z_x, z_y = whole_turn.x - (w_x * step.x - w_y * step.y), whole_turn.y - (w_x * step.y + w_y * step.x)
    t_x, t_y = whole_turn.time - w_x * step.time, -w_y * step.time
    size = t_x * t_x + t_y * t_y
    return (z_x * t_x + z_y * t_y) / size, (z_y * t_x - z_x * t_y) / size


@compiled
def track_of(track, ahead):
    """Return the kind of a track, and the velocity of the circle's centre over the last whole turn.

    The kinds are those of `layout.TRACKS`. The heading turns by the angle `ahead` [rad] in the periods that are left of
    a run that stopped before its end. A run that turns stops early on a level plate only, and there the centre stands.
    """
    if track.begun == 0.0:
        return TRACK.none, nan, nan
    turned, far = track.last.heading - track.start.heading + ahead, track.far
    if abs(turned) >= TWO_PI:
        return TRACK.circle, 0.0, 0.0
    if abs(turned) > abs(far):
        far = turned
    if turned_back(far, turned):
        return TRACK.reversals, nan, nan
    if track.kind != TRACK.none:
        return int(track.kind), track.u_x, track.u_y
    if track.cusp != 0.0:
        return TRACK.cusps, nan, nan
    return TRACK.arc if abs(far) > TURNED_BACK else TRACK.straight, nan, nan
