"""The section of the return map: the point of a state, and the state at a point.

A point has coordinates without the cyclic ones: the gaps and their rates, theta' cos(beta), the axial spin, and the
velocity of the centre of mass along and across the axis, each in a unit of its own.
"""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled, exported
from dimersweep.kernel.model.body import attitude, contact_velocity, set_dimer
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, N1, N2, N_STATE, OK, SPIN, STICK, WB, WP
from dimersweep.kernel.numerics.elementary import atan2

# statuses of a point without a state: an end is below the plate; or an end is higher above the other than the dimer is
# long
SUNK, STEEP = -3, -2
SLOTS = (D1, D2, N1, N2, WP, SPIN, CA, CB)  # slots of the coordinates in a state
N_POINT, SPIN_COORDINATE = len(SLOTS), SLOTS.index(SPIN)


@compiled
def set_point(state, units, point):
    """Write the coordinates of a state, in `units`, into `point`, shape (N_POINT,)."""
    for k in range(N_POINT):
        point[k] = state[SLOTS[k]] / units[k]


@compiled
def dip_of(dm, rise):
    """Return the dip above level [rad] at which p2 is higher over the plate than p1 by `rise` [m]."""
    share = rise / dm.l
    sin_b = min(1.0, max(-1.0, dm.sin_0 + share))
    cos_b = sqrt((1.0 - sin_b) * (1.0 + sin_b))
    sin_d = share * (dm.cos_0 + dm.sin_0 * (sin_b + dm.sin_0) / (cos_b + dm.cos_0))
    return atan2(sin_d, cos_b * dm.cos_0 + sin_b * dm.sin_0)


@compiled
def judge(dm, units, point):
    """Return OK if there is a state at a point, else SUNK or STEEP."""
    if point[0] < 0.0 or point[1] < 0.0:
        return SUNK
    return OK if abs(point[1] - point[0]) * units[0] < dm.l else STEEP


@compiled
def set_state(dm, units, point, modes, state):
    """Write the kernel state at a point into `state`, with the ends that stick at rest.

    The cyclic coordinates are zero. A gap below zero, as by rounding, is set to zero.
    """
    for k in range(N_STATE):
        state[k] = 0.0
    for k in range(N_POINT):
        state[SLOTS[k]] = point[k] * units[k]
    state[D1], state[D2] = max(0.0, state[D1]), max(0.0, state[D2])
    state[DIP] = dip_of(dm, state[D2] - state[D1])
    _, cos_b = attitude(dm, state[DIP])
    state[WB] = (state[N2] - state[N1]) / (dm.l * cos_b)
    hold(dm, modes, state)


@compiled
def hold(dm, modes, state):
    """Bring the ends that stick to rest: the motion of the centre of mass follows from the other rates."""
    if modes[0] == STICK and modes[1] == STICK:
        # with both contact points at rest nothing turns about the vertical: the dimer rolls straight on, or as a cone
        state[WP] = -state[SPIN] * dm.sin_0 / dm.cos_0
    for i in range(2):
        if modes[i] == STICK:
            _, along, across = contact_velocity(dm, state, i)
            state[CA] -= along
            state[CB] -= across


# --- for Python -------------------------------------------------------------------------------------------------------


@exported
def state_at(row, units, point, modes, dimer, state):
    """Write the state at a point, shape (N_POINT,), see `set_state`; without a point, hold the state as it is.

    `row`, shape (N_ROW,), and `units`, shape (N_POINT,), are those of the dimer; `dimer`, an array of one, is scratch.
    Return OK, SUNK or STEEP.
    """
    dm = dimer[0]
    set_dimer(row, dm)
    if point.shape[0] != N_POINT:
        hold(dm, modes, state)
        return OK
    set_state(dm, units, point, modes, state)
    return judge(dm, units, point)
