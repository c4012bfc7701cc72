"""The track that the centre of mass draws on the plate, from period boundary to period boundary, once the motion has settled.

Where the centre of a circle moves steadily, the track is a cycloid, r = c + U t + R (cos theta, sin theta) with the heading
theta turned by a fixed angle. Kept are the last whole turn of the heading and what the velocity did in it.
"""

from math import nan, pi
from typing import Annotated, NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import TRACK
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import TWO_PI, sincos

TURNED_BACK = 0.1  # turning of the heading [rad] that counts: less is straight, and a reversal comes back by more
STANDS = 0.01  # speed of a circle's centre, in that of the dimer, below which it stands


class Fix(NamedTuple):
    """A point of a track, or the way from one to another [s], [m], [rad]."""

    time: float
    x: float
    y: float
    heading: float


class TrackState:
    """What is kept of a track: what it is, and a turn under way."""

    begun: float  # whether there is one
    kind: float  # see `layout.TRACKS`
    u_x: float  # velocity of its centre [m s-1]
    u_y: float
    start: Fix  # where the turn began
    last: Fix  # at the last period boundary
    far: float  # of the turn: furthest heading [rad]
    bend: float  # turning of the velocity [rad]
    length: float  # of the path [m]
    cusp: float  # whether it has one
    v_x: float  # last mean velocity over a period that has a direction [m s-1]
    v_y: float
    spare: Annotated[list[float], 6]


@compiled
def put(now, point):
    """Write a point of a track into its record."""
    point.time, point.x, point.y, point.heading = now.time, now.x, now.y, now.heading


@compiled
def way_to(now, point):
    """The way to a point from one in a record."""
    return Fix(now.time - point.time, now.x - point.x, now.y - point.y, now.heading - point.heading)


@compiled
def follow_track(track, now, no_speed):
    """Take a track on to its next point.

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
        note_velocity(track, way_to(now, track.last), no_speed)
        turned = now.heading - track.start.heading
        if abs(turned) > abs(track.far):
            track.far = turned
        if abs(turned) >= TWO_PI:
            end_turn(track, way_to(now, track.start), way_to(now, track.last))
            begin_turn(track, now)
        elif turned_back(track.far, turned):
            track.kind = TRACK.cusps if track.cusp != 0.0 else TRACK.reversals
            track.u_x = track.u_y = nan
            begin_turn(track, now)
    put(now, track.last)


@compiled
def turned_back(far, turned):
    """Whether a heading that has turned so `far` from where its turn began, and is at `turned` from there now, comes back."""
    return abs(far) > TURNED_BACK and abs(far - turned) > TURNED_BACK


@compiled
def begin_turn(track, now):
    """Count a turn from here."""
    put(now, track.start)
    track.far = track.bend = track.length = track.cusp = 0.0


@compiled
def note_velocity(track, step, no_speed):
    """Note the mean velocity over a step: how far it turned, and whether by more than a right angle at once."""
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
def end_turn(track, way, step):
    """The velocity of the centre over the whole turn that ended in the last step, and what the track was in it."""
    track.u_x, track.u_y = centre_velocity(way, step)
    if track.cusp != 0.0:
        track.kind = TRACK.cusps
    elif track.length > 0.0 and abs(way.heading - track.bend) > pi:
        track.kind = TRACK.waves
    else:
        moved = length(track.u_x, track.u_y) * way.time
        track.kind = TRACK.loops if moved > STANDS * track.length else TRACK.circle


@compiled
def centre_velocity(way, step):
    """Velocity of a circle's centre over a whole turn of the heading, exact where the track is a cycloid [m/s].

    The last step goes beyond the turn by an angle `over`. Taken off are the part w of it that does: on a cycloid, where with
    complex places z = c + U t + A exp(i theta), that is w = (1 - exp(-i over)) / (1 - exp(-i step)), and

        U = (z - w z_step) / (t - w t_step).

    Parameters
    ----------
    way, step : Fix
        Since the turn began, which is the first that is whole; and the last step of it.
    """
    over = way.heading - (TWO_PI if way.heading > 0.0 else -TWO_PI)
    sin_over, _ = sincos(0.5 * over)
    sin_step, _ = sincos(0.5 * step.heading)
    s, c = sincos(0.5 * (step.heading - over))
    w_x, w_y = sin_over / sin_step * c, sin_over / sin_step * s
    z_x, z_y = way.x - (w_x * step.x - w_y * step.y), way.y - (w_x * step.y + w_y * step.x)
    t_x, t_y = way.time - w_x * step.time, -w_y * step.time
    size = t_x * t_x + t_y * t_y
    return (z_x * t_x + z_y * t_y) / size, (z_y * t_x - z_x * t_y) / size


@compiled
def track_of(track, ahead):
    """What a track is, and the velocity of the circle's centre over the last whole turn; see `layout.TRACKS`.

    The heading turns by the angle `ahead` [rad] in the periods that are left of a run that stopped before: only on a level
    plate does a run that turns do so, and there the centre stands.
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
