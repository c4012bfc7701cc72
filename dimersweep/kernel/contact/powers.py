"""Powers of the contact forces: the rates of the works that ride along with a contact phase where they are wanted."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import (
    N_CLOSED,
    N_PATH,
    UPRIGHT,
    YAXES,
    YCHART,
    YTHETA,
    YWORK,
    slip_of,
)
from dimersweep.kernel.contact.forces import A1, F1, F2, L1, contact_rates
from dimersweep.kernel.model.body import end
from dimersweep.kernel.model.friction import direction, slip_force
from dimersweep.kernel.model.layout import SLIP
from dimersweep.kernel.model.plate import plate_rate, velocity_along
from dimersweep.kernel.model.works import ALONG, PLATE_1, PLATE_2, SLIP_1
from dimersweep.kernel.numerics.sincos import sincos


@compiled(inline=True)
def phase_rates(dm, modes, phase, y, n, dy, F):
    """Rates of the first n entries of y into dy, and the forces into F; see `contact_rates`."""
    contact_rates(dm, modes, phase, y, n > N_CLOSED, dy, F)
    if n > N_PATH:
        work_rates(dm, modes, phase, y, F, dy)


@compiled
def work_rates(dm, modes, phase, y, F, dy):
    """Powers of the forces F at a contact state, into the places of the works in dy [W]."""
    rise = plate_rate(dm, phase)
    dy[YWORK + PLATE_1], dy[YWORK + PLATE_2], dy[YWORK + ALONG] = F[F1] * rise, F[F2] * rise, 0.0
    if dm.sideways != 0.0:
        axial, lateral = F[A1] + F[A1 + 3], F[L1] + F[L1 + 3]
        v_x, v_y = velocity_along(dm, phase)
        sin_t, cos_t = sincos(y[YAXES] if y[YCHART] == UPRIGHT else y[YTHETA])
        dy[YWORK + ALONG] = axial * (v_y * cos_t - v_x * sin_t) + lateral * (v_x * cos_t + v_y * sin_t)
    both_slip = modes[0] == SLIP and modes[1] == SLIP
    for i in range(2):
        dy[YWORK + SLIP_1 + i] = 0.0
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            axial = F[A1 + 3 * i]
            if both_slip:  # F has the sum of the axial forces
                axial, _ = slip_force(end(dm, i).mu, F[F1 + 3 * i], *direction(a, b))
            dy[YWORK + SLIP_1 + i] = axial * a + F[L1 + 3 * i] * b
