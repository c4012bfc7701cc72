"""What a run keeps of its past, for the verdict on it.

Kept are the last strobes (normal state and spin at the period boundaries), double events (landings of one ball while the
other one is down, with the state after the last impact of each burst) and long landings. Lines drawn here, in forcing
periods: a ball is down while it is closed or in hops shorter than HOP_LINE; impacts of one double event lie within BURST.
"""

from math import nan, pi, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import contact_velocity, extent
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DI_SK_SK,
    DI_SK_SP,
    DI_SP_SK,
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
from dimersweep.kernel.numerics.steps import clear

HOP_LINE = 0.5
NOTED = 0.4  # hops from which on landings are kept: one just below the line may go with one just above it
BURST = 0.05
SLIP_LINE = 1e-7  # slip, in g/omega, from which an end slips at the end of a double impact

RING = 64
# rows of the past: scalars, the track (``verdict.track``), strobes, double events, long landings
SCALARS, TRACK_ROW, STROBES, DOUBLES, LANDINGS = 0, 2, 3, 3 + RING, 3 + 2 * RING
PAST_ROWS, PAST_COLUMNS = 3 + 3 * RING, 24
# scalars
S_OFF_1, S_OFF_2, S_DOWN_1, S_DOWN_2, S_DOUBLES, S_LANDINGS, S_STROBES, S_CLOSED, S_HOP_1, S_HOP_2 = range(10)
S_FASTEST = 10  # greatest speed in the plate's frame so far [m/s], by which an impact is slow
S_HELD = 11  # for how many periods both ends have stuck
RUNS = 1  # this row holds, in column p, for how many periods the motion has repeated with period p
# columns of a strobe
P_D1, P_D2, P_N1, P_N2, P_SPIN, P_DOWN_1, P_DOWN_2, P_DOUBLES, P_TIME, P_OFF_1, P_OFF_2, P_HOP_1, P_HOP_2 = range(13)
P_HEADING, P_THETA = 13, 14  # the heading where it counts, and in any case
N_NORMAL = P_N2 + 1  # those up to here are the normal state, which a motion repeats
# columns of a double event
DE_TIME, DE_PHASE, DE_SPEED, DE_ZETA, DE_THETA, DE_SPIN, DE_WB, DE_END, DE_BOUNCER = range(9)
# columns of a landing
G_TIME, G_END, G_LONG = range(3)


@compiled
def time_of(dm, state):
    """Time since the start [s]."""
    return state[PERIOD] * dm.period + state[PHASE] / dm.omega


@compiled
def begin_past(past):
    """An empty past; both balls down."""
    clear(past, STROBES, PAST_COLUMNS)  # the other rows are read no further than they are counted here
    past[SCALARS, S_OFF_1] = past[SCALARS, S_OFF_2] = -1.0


@compiled
def note_contact_modes(dm, past, state, modes):
    """Note the ends that slip or are off the plate from now on."""
    for i in range(2):
        if modes[i] == SLIP:
            past[SCALARS, S_HELD] = -1.0
        if modes[i] == FREE:
            past[SCALARS, S_CLOSED] = -1.0
            if past[SCALARS, S_OFF_1 + i] < 0.0:
                past[SCALARS, S_OFF_1 + i] = time_of(dm, state)


@compiled
def note_landing(dm, past, i, now):
    """End i is back on the plate; returns whether its flight was a long one."""
    off = past[SCALARS, S_OFF_1 + i]
    if off < 0.0:
        return False
    past[SCALARS, S_OFF_1 + i] = -1.0
    hop = now - off
    past[SCALARS, S_HOP_1 + i] = max(past[SCALARS, S_HOP_1 + i], hop)
    if hop < HOP_LINE * dm.period:  # it counts as down after all, and crosses the last period boundary at most
        strobe = STROBES + (int(past[SCALARS, S_STROBES]) + RING - 1) % RING
        if past[strobe, P_OFF_1 + i] == off:
            past[strobe, P_OFF_1 + i] = -1.0
    if hop < NOTED * dm.period:
        return False
    is_long = hop >= HOP_LINE * dm.period
    row = LANDINGS + int(past[SCALARS, S_LANDINGS]) % RING
    past[row, G_TIME], past[row, G_END], past[row, G_LONG] = now, i, 1.0 if is_long else 0.0
    past[SCALARS, S_LANDINGS] += 1.0
    if is_long:
        past[SCALARS, S_DOWN_1 + i] -= hop
    return is_long


@compiled
def note_landings(dm, past, state):
    """Note the ends that are back on the plate before their impact.

    Returns
    -------
    end, begins : int, bool
        The end that has landed, the one from a long flight if there is one; and whether a double event begins with it: it
        comes from a long flight, and the other ball is down.
    """
    now = time_of(dm, state)
    long_flight, end = False, 0
    for i in range(2):
        if state[D1 + i] == 0.0:
            if note_landing(dm, past, i, now):
                long_flight, end = True, i
            elif state[N1 + i] < 0.0 and not long_flight:
                end = i
    other_off = past[SCALARS, S_OFF_1 + 1 - end]
    return end, long_flight and (other_off < 0.0 or now - other_off < HOP_LINE * dm.period)


@compiled
def zeta_of(c_a, c_b, bouncer):
    """Angle of (9) between the rod, towards the bouncer, and the velocity of the centre of mass [rad]; NaN without motion."""
    forward = c_a if bouncer == 1 else -c_a
    return atan2(abs(c_b), forward) if c_a != 0.0 or c_b != 0.0 else nan


def ends_sticking(dm, a, b):
    """Whether an end with this slip ends a double impact sticking: below the line drawn here slip is of no consequence."""
    return sqrt(a * a + b * b) <= SLIP_LINE * dm.g / dm.omega


def double_end(other_sticks, bouncer_sticks):
    """How a double impact ends: the code in ``layout.DI_ENDS``, which names the end that stays down before the bouncer."""
    if other_sticks:
        return DI_SK_SK if bouncer_sticks else DI_SK_SP
    return DI_SP_SK if bouncer_sticks else DI_SP_SP


_ends_sticking, _double_end = compiled(ends_sticking), compiled(double_end)


@compiled
def sticks(dm, state, i):
    """Whether end i ends a double impact sticking."""
    _, a, b = contact_velocity(dm, state, i)
    return _ends_sticking(dm, a, b)


@compiled
def note_impact(dm, state, past, double, i, begins):
    """Keep the state after an impact that is, begins or continues a double event.

    Parameters
    ----------
    double : bool
        The impact began with both ends closed.
    i, begins : int, bool
        See `note_landings`.
    """
    now = time_of(dm, state)
    count = int(past[SCALARS, S_DOUBLES])
    row = DOUBLES + (count - 1) % RING if count > 0 else DOUBLES
    burst = count > 0 and now - past[row, DE_TIME] < BURST * dm.period
    if burst:
        if not double and past[row, DE_BOUNCER] != i:
            return
        i = int(past[row, DE_BOUNCER])
    elif double or begins:
        row = DOUBLES + count % RING
        past[SCALARS, S_DOUBLES] += 1.0
        past[row, DE_BOUNCER] = i
    else:
        return
    past[row, DE_TIME] = now
    past[row, DE_PHASE] = (state[PHASE] + dm.phi0) / (2.0 * pi) % 1.0
    past[row, DE_SPEED] = length(state[CA], state[CB])
    past[row, DE_ZETA] = zeta_of(state[CA], state[CB], i)
    past[row, DE_THETA] = state[THETA]
    past[row, DE_SPIN] = state[SPIN]
    past[row, DE_WB] = state[WB]
    past[row, DE_END] = _double_end(sticks(dm, state, 1 - i), sticks(dm, state, i))


@compiled
def note_strobe(dm, state, modes, past):
    """Keep the strobe of a period boundary."""
    scalars = past[SCALARS]
    row = past[STROBES + int(scalars[S_STROBES]) % RING]
    speed = dm.g / dm.omega
    length = speed / dm.omega
    row[P_D1], row[P_D2] = state[D1] / length, state[D2] / length
    row[P_N1], row[P_N2] = state[N1] / speed, state[N2] / speed
    row[P_SPIN] = extent(dm)[0] * state[SPIN] / speed
    row[P_THETA] = state[THETA]
    row[P_HEADING] = state[THETA] if dm.sideways != 0.0 else 0.0  # else it is of no consequence
    row[P_DOWN_1], row[P_DOWN_2] = scalars[S_DOWN_1], scalars[S_DOWN_2]
    row[P_DOUBLES] = scalars[S_DOUBLES]
    row[P_TIME] = time_of(dm, state)
    row[P_OFF_1], row[P_OFF_2] = scalars[S_OFF_1], scalars[S_OFF_2]
    row[P_HOP_1], row[P_HOP_2] = scalars[S_HOP_1], scalars[S_HOP_2]
    scalars[S_HOP_1] = scalars[S_HOP_2] = 0.0
    scalars[S_STROBES] += 1.0
    scalars[S_CLOSED] = scalars[S_CLOSED] + 1.0 if modes[0] != FREE and modes[1] != FREE else 0.0
    scalars[S_HELD] = scalars[S_HELD] + 1.0 if modes[0] == STICK and modes[1] == STICK else 0.0
