"""The contact mode of ends that rest on the plate: which stay closed, which stick, which slip, by enumeration."""

from math import copysign, cos, hypot, sin

from dimersweep.kernel.body import delassus, levers
from dimersweep.kernel.contact import (
    A1,
    F1,
    F2,
    L1,
    L2,
    YB,
    YUA,
    YUB,
    YWP,
    contact_rates,
    free_rates,
    hold_reserve,
    slip_onset,
)
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import FREE, SLIP, STICK
from dimersweep.kernel.plate import effective_gravity

CLOSED, SEPARATES, INCONSISTENT = 0, 1, 2


@compiled
def single_mode(dm, i, phase, y, modes, slip_tol, lost, dy, F):
    """Mode of the one closed end i into modes; y gets the slip that goes with it.

    Parameters
    ----------
    slip_tol : float
        Slip that counts as none [m/s].
    lost : bool
        The hold at rest has just been lost.

    Returns
    -------
    int
        CLOSED, SEPARATES, or INCONSISTENT when no force satisfies the law (Painleve: only an impact can follow).
    """
    s = -1.0 if i == 0 else 1.0
    modes[0], modes[1] = FREE, FREE
    if hypot(y[YUA], y[YUB]) > slip_tol:
        modes[i] = SLIP
        contact_rates(dm, modes, phase, y, False, dy, F)
        lv = levers(dm, s, sin(y[YB]), cos(y[YB]))
        w = delassus(dm, lv, lv)
        if w.nn <= dm.mu * w.na * y[YUA] / hypot(y[YUA], y[YUB]):
            _, _, n, _, _ = free_rates(dm, s, y, effective_gravity(dm, phase), sin(y[YB]), cos(y[YB]))
            modes[i] = FREE
            return INCONSISTENT if n < 0.0 else SEPARATES
    else:
        y[YUA], y[YUB] = 0.0, 0.0
        modes[i] = STICK
        contact_rates(dm, modes, phase, y, False, dy, F)
        if lost or hold_reserve(dm, modes, i, F) < 0.0:
            modes[i] = SLIP
            hold_a, hold_b, pressed = F[A1 + 3 * i], F[L1 + 3 * i], F[F1 + 3 * i] > 0.0
            if not slip_onset(dm, s, y, phase, 0.5 * slip_tol):
                hold = hypot(hold_a, hold_b)
                if not pressed or hold == 0.0:
                    modes[i] = FREE
                    return SEPARATES
                # at the limit slip may have no acceleration yet; it sets out against the force that held
                y[YUA], y[YUB] = -0.5 * slip_tol * hold_a / hold, -0.5 * slip_tol * hold_b / hold
            contact_rates(dm, modes, phase, y, False, dy, F)
    if F[F1 + 3 * i] > 0.0:
        return CLOSED
    modes[i] = FREE
    return SEPARATES


@compiled
def double_mode(dm, phase, y, modes, slip_tol, lost, dy, F):
    """Friction modes with both ends on the plate into modes, and the forces into F; y gets the slips that go with them."""
    two_h = 2.0 * dm.h
    rest_1 = hypot(y[YUA], y[YUB]) <= slip_tol
    rest_2 = hypot(y[YUA], y[YUB] - two_h * y[YWP]) <= slip_tol
    if rest_1 or rest_2:
        y[YUA] = 0.0
    if rest_1:
        y[YUB] = 0.0
    if rest_2:
        y[YWP] = y[YUB] / two_h
    modes[0] = STICK if rest_1 else SLIP
    modes[1] = STICK if rest_2 else SLIP
    contact_rates(dm, modes, phase, y, False, dy, F)
    if rest_1 and rest_2:
        if lost or hold_reserve(dm, modes, 0, F) < 0.0:
            loosen_pair(dm, y, modes, slip_tol, F)
    elif rest_1 and (lost or hold_reserve(dm, modes, 0, F) < 0.0):
        loosen_one(dm, y, modes, 0, slip_tol, F)
    elif rest_2 and (lost or hold_reserve(dm, modes, 1, F) < 0.0):
        loosen_one(dm, y, modes, 1, slip_tol, F)
    contact_rates(dm, modes, phase, y, False, dy, F)


@compiled
def loosen_pair(dm, y, modes, slip_tol, F):
    """Both ends at rest and not both held: an end whose lateral hold is exceeded slips laterally, else both axially."""
    over_1 = abs(F[L1]) > dm.mu_s * F[F1]
    over_2 = abs(F[L2]) > dm.mu_s * F[F2]
    small = 0.5 * slip_tol
    if over_1 or over_2:
        u_1 = -copysign(small, F[L1]) if over_1 else 0.0
        u_2 = -copysign(small, F[L2]) if over_2 else 0.0
        y[YUB], y[YWP] = u_1, (u_1 - u_2) / (2.0 * dm.h)
        modes[0] = SLIP if over_1 else STICK
        modes[1] = SLIP if over_2 else STICK
    else:
        y[YUA] = -copysign(small, F[A1])
        modes[0], modes[1] = SLIP, SLIP


@compiled
def loosen_one(dm, y, modes, i, slip_tol, F):
    """End i loses its hold beside an end that slips laterally: it starts against the friction that held it."""
    axial, lateral = F[A1], F[L1] if i == 0 else F[L2]
    size = hypot(axial, lateral)
    u_a, u_b = -0.5 * slip_tol * axial / size, -0.5 * slip_tol * lateral / size
    y[YUA] = u_a
    if i == 0:
        shift = u_b - y[YUB]
        y[YUB] = u_b
        y[YWP] += shift / (2.0 * dm.h)
    else:
        y[YWP] = (y[YUB] - u_b) / (2.0 * dm.h)
    modes[i] = SLIP


@compiled
def contact_mode(dm, closed_1, closed_2, phase, y, modes, slip_tol, lost, dy, F):
    """Which of the closed ends stay closed, and in which friction modes, into modes (y with p1 leading if it is closed).

    With both ends on the plate the double contact is tried first, then each end alone where its force points outward.

    Returns
    -------
    int
        CLOSED, SEPARATES or INCONSISTENT.
    """
    if not (closed_1 and closed_2):
        return single_mode(dm, 0 if closed_1 else 1, phase, y, modes, slip_tol, lost, dy, F)
    double_mode(dm, phase, y, modes, slip_tol, lost, dy, F)
    if F[F1] > 0.0 and F[F2] > 0.0:
        return CLOSED
    if F[F1] <= 0.0 and F[F2] <= 0.0:
        modes[0], modes[1] = FREE, FREE
        return SEPARATES
    stays = 1 if F[F1] <= 0.0 else 0
    if stays == 1:
        y[YUB] -= 2.0 * dm.h * y[YWP]
    return single_mode(dm, stays, phase, y, modes, slip_tol, lost, dy, F)
