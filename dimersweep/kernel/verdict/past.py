"""Keep the past of a run, for the verdict on it.

It has three rings. Strobes are the normal state and the spin at the period boundaries. Double events are landings of
one ball while the other ball is down, with the state after the last impact of each burst. The third ring has long
landings. Two lines are drawn here, in forcing periods. A ball is down while it is closed or in hops shorter than
HOP_LINE; impacts of one double event lie within BURST.
"""

from math import nan, pi, sqrt
from typing import Annotated

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import contact_velocity, extent
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DI_SP_SP,
    FREE,
    N1,
    N2,
    PERIOD,
    PHASE,
    SLIP,
    SPIN,
    STICK,
    THETA,
    WB,
)
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.verdict.track import TrackState

HOP_LINE = 0.5  # hop, in forcing periods, from which on a ball is not down
# hop, in forcing periods, from which on its landing is kept: one just below HOP_LINE may be paired with one just above
# it
NOTED = 0.4
BURST = 0.05  # forcing periods within which impacts are one double event
# slip, in g/omega, above which an end counts as slipping at the end of a double impact
SLIP_LINE = 1e-7

RING = 64  # entries of a ring: more than the 55 periods that `settling` looks back
N_NORMAL = 4
# shape of a past in a file: rows for itself, its runs and the track, and for the three rings
PAST_SHAPE = (3 + 3 * RING, 24)
Ends = Annotated[list[float], 2]  # numbers of p1 and p2


class Strobe:
    """State of the motion at a period boundary."""

    x: Annotated[list[float], N_NORMAL]  # gaps and gap rates, which a motion repeats [g/omega^2], [g/omega]
    spin: float  # r s [g/omega]
    long: Ends  # minus the time in long hops that are over [s]
    doubles: float  # number of double events so far
    time: float  # since the start [s]
    off: Ends  # time at which the ends left the plate; below zero where they are down, or in a short hop [s]
    hop: Ends  # longest hops that ended in the period before [s]
    heading: float  # heading where it counts, else 0 [rad]
    theta: float  # heading in any case [rad]
    spare: Annotated[list[float], 9]


class Double:
    """State after the last impact of a double event."""

    time: float
    phase: float  # phase of the plate [cycles]
    speed: float  # speed of the centre of mass [m s-1]
    zeta: float  # angle of (9) [rad]
    theta: float
    spin: float
    beta_rate: float
    end: float  # end state of its impact: a code in ``layout.DI_ENDS``
    bouncer: float
    spare: Annotated[list[float], 15]


class Landing:
    """End of a hop that is nearly long, or longer."""

    time: float
    end: float
    long: float  # 1.0 for a long hop
    spare: Annotated[list[float], 21]  # fills up a row of a file, as in the others


class Past:
    """Past of a run. The entries of a kind stand in a ring: the n-th in place n % RING."""

    off: Ends  # as in a strobe
    long: Ends
    n_doubles: float
    n_landings: float
    n_strobes: float
    closed: float  # number of periods for which both ends have been closed
    hop: Ends
    fastest: float  # greatest speed in the plate's frame so far [m/s]: the measure of slow impacts
    stuck: float  # number of periods for which both ends have stuck
    spare: Annotated[list[float], 12]
    runs: Annotated[list[float], 24]  # place p: number of periods for which the motion has repeated with period p
    track: TrackState
    strobes: Annotated[list[Strobe], RING]
    doubles: Annotated[list[Double], RING]
    landings: Annotated[list[Landing], RING]


@compiled
def strobe(past, back):
    """Return the place of the strobe `back` periods before the last strobe."""
    return (int(past.n_strobes) - 1 - back) % RING


@compiled
def double(past, back):
    """Return the place of the double event `back` events before the last one."""
    return (int(past.n_doubles) - 1 - back) % RING


@compiled
def time_of(dm, state):
    """Return the time since the start [s]."""
    return state[PERIOD] * dm.period + state[PHASE] / dm.omega


@compiled
def begin_past(past):
    """Empty a past, with both balls down. Entries of the rings are read no further than they are counted here."""
    for i in range(2):
        past.off[i], past.long[i], past.hop[i] = -1.0, 0.0, 0.0
    past.n_doubles = past.n_landings = past.n_strobes = past.closed = past.fastest = past.stuck = past.track.begun = 0.0
    for p in range(len(past.runs)):
        past.runs[p] = 0.0


@compiled
def note_contact_modes(dm, past, state, modes):
    """Note the ends that slip or are off the plate from now on."""
    for i in range(2):
        # -1.0: the period under way does not count, and its end brings the number to zero
        if modes[i] == SLIP:
            past.stuck = -1.0
        if modes[i] == FREE:
            past.closed = -1.0
            if past.off[i] < 0.0:
                past.off[i] = time_of(dm, state)


@compiled
def note_landing(dm, past, i, now):
    """Note that end i is back on the plate; return True if its flight was a long one."""
    off = past.off[i]
    if off < 0.0:
        return False
    past.off[i] = -1.0
    hop = now - off
    past.hop[i] = max(past.hop[i], hop)
    is_long = hop >= HOP_LINE * dm.period
    # an end in a short hop counts as down after all; such a hop crosses no boundary but the last
    if not is_long:
        last = past.strobes[strobe(past, 0)]
        if last.off[i] == off:
            last.off[i] = -1.0
    if hop < NOTED * dm.period:
        return False
    landing = past.landings[int(past.n_landings) % RING]
    landing.time, landing.end, landing.long = now, i, 1.0 if is_long else 0.0
    past.n_landings += 1.0
    if is_long:
        past.long[i] -= hop
    return is_long


@compiled
def note_landings(dm, past, state):
    """Note the ends that are back on the plate before their impact.

    Returns
    -------
    end, begins : int, bool
        The end that has landed, that from a long flight if there is one; and True if a double event begins with it:
        it comes from a long flight, and the other ball is down.
    """
    now = time_of(dm, state)
    long_flight, end = False, 0
    for i in range(2):
        if state[D1 + i] == 0.0:
            if note_landing(dm, past, i, now):
                long_flight, end = True, i
            elif state[N1 + i] < 0.0 and not long_flight:
                end = i
    other_off = past.off[1 - end]
    return end, long_flight and (other_off < 0.0 or now - other_off < HOP_LINE * dm.period)


@compiled
def zeta_of(c_a, c_b, bouncer):
    """Return the angle of (9) from the rod, towards the bouncer, to the centre's velocity [rad]; NaN without motion."""
    forward = c_a if bouncer == 1 else -c_a
    return atan2(abs(c_b), forward) if c_a != 0.0 or c_b != 0.0 else nan


@compiled
def sticks(dm, state, i):
    """Return True if end i sticks at the end of a double impact: slip below SLIP_LINE is of no consequence."""
    _, a, b = contact_velocity(dm, state, i)
    return sqrt(a * a + b * b) <= SLIP_LINE * dm.g / dm.omega


@compiled
def double_end(dm, state, i):
    """Return the code in ``layout.DI_ENDS`` of the end of a double impact.

    The code names the end that stays down first and the bouncer, i, second.
    """
    return DI_SP_SP + 2 * sticks(dm, state, 1 - i) + sticks(dm, state, i)


@compiled
def note_impact(dm, state, past, both, i, begins):
    """Keep the state after an impact that is, begins or continues a double event.

    Parameters
    ----------
    both : bool
        True if the impact began with both ends closed.
    i, begins : int, bool
        Results of `note_landings`: the end that landed, and True if a double event begins with it.
    """
    now = time_of(dm, state)
    event = past.doubles[double(past, 0)]
    if past.n_doubles > 0.0 and now - event.time < BURST * dm.period:
        if not both and event.bouncer != i:
            return
        i = int(event.bouncer)
    elif both or begins:
        past.n_doubles += 1.0
        event = past.doubles[double(past, 0)]
        event.bouncer = i
    else:
        return
    event.time = now
    event.phase = (state[PHASE] + dm.phi0) / (2.0 * pi) % 1.0
    event.speed = length(state[CA], state[CB])
    event.zeta = zeta_of(state[CA], state[CB], i)
    event.theta, event.spin, event.beta_rate = state[THETA], state[SPIN], state[WB]
    event.end = double_end(dm, state, i)


@compiled
def note_strobe(dm, state, modes, past):
    """Keep the strobe of a period boundary."""
    past.n_strobes += 1.0
    row = past.strobes[strobe(past, 0)]
    speed = dm.g / dm.omega
    unit = speed / dm.omega
    row.x[0], row.x[1] = state[D1] / unit, state[D2] / unit
    row.x[2], row.x[3] = state[N1] / speed, state[N2] / speed
    row.spin = extent(dm)[0] * state[SPIN] / speed
    row.theta = state[THETA]
    row.heading = state[THETA] if dm.sideways != 0.0 else 0.0  # else it is of no consequence
    row.doubles = past.n_doubles
    row.time = time_of(dm, state)
    for i in range(2):
        row.long[i], row.off[i], row.hop[i] = past.long[i], past.off[i], past.hop[i]
        past.hop[i] = 0.0
    past.closed = past.closed + 1.0 if modes[0] != FREE and modes[1] != FREE else 0.0
    past.stuck = past.stuck + 1.0 if modes[0] == STICK and modes[1] == STICK else 0.0
