"""Works of the contact forces: their kinds, and the works of an impact under way.

The velocity of an end in the room is that of the plate below it and its own relative to the plate. So a force works
with the plate, along the normal (`plate`) and along the plate (`along`), and with the end. There the normal force works
with the gap rate (`rest`, lost to restitution) and friction with the slip. All are works on the dimer [J].
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import PHASE, THETA
from dimersweep.kernel.model.plate import plate_rate, velocity_along
from dimersweep.kernel.numerics.sincos import sincos

PLATE_1, PLATE_2, ALONG, SLIP_1, SLIP_2, REST_1, REST_2 = range(7)
WORK_NAMES = ("plate_1", "plate_2", "plate_along", "slip_1", "slip_2", "restitution_1", "restitution_2")
N_WORK = 7
# number of these in contact: a closed gap has no rate, so the normal force does no work with it
N_CONTACT_WORK = REST_1
STRUCK_ROWS = 64  # rows of the scratch for the phases of one impact


class WorkTally:
    """Velocity of the plate at an impact, for its works; and whether works are wanted."""

    wanted: bool
    rise: float  # velocity of the plate: along its normal, along the axis of the dimer and across it [m s-1]
    along: float
    across: float


@compiled
def begin_tally(dm, state, tally):
    """Set the velocity of the plate at an impact."""
    phase = state[PHASE] + dm.phi0
    tally.rise, tally.along, tally.across = plate_rate(dm, phase), 0.0, 0.0
    if dm.sideways != 0.0:
        v_x, v_y = velocity_along(dm, phase)
        sin_t, cos_t = sincos(state[THETA])
        tally.along, tally.across = v_y * cos_t - v_x * sin_t, v_x * cos_t + v_y * sin_t


@compiled
def note_struck(work, row, energy, rest, slip, impulses):
    """Write the works of a phase of an impact into a row of the scratch.

    Where there is no room for the row, they are added to the last one.

    Parameters
    ----------
    work : Scratch
        Its tally has the velocity of the plate; the row is one of the last STRUCK_ROWS of its scratch.
    row : int
    energy : float
        Unit of the works [J].
    rest, slip : (float, float)
        Works of restitution and of slip at both ends, in this unit.
    impulses : tuple of 5 float
        Normal impulses of both ends, the axial one, the lateral ones [N s].
    """
    rows = work.rows
    tally, to = work.course[0].tally, rows[rows.shape[0] - STRUCK_ROWS + min(row, STRUCK_ROWS - 1)]
    P_1, P_2, A, B_1, B_2 = impulses
    if row < STRUCK_ROWS:
        for k in range(N_WORK):
            to[k] = 0.0
    to[PLATE_1] += tally.rise * P_1
    to[PLATE_2] += tally.rise * P_2
    to[ALONG] += tally.along * A + tally.across * (B_1 + B_2)
    for i in range(2):
        to[REST_1 + i] += energy * rest[i]
        to[SLIP_1 + i] += energy * slip[i]
