"""The log of an impact: an event row for each of its phases."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import ZA, ZB1, ZB2, ZN1, ZN2
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.event_row import (
    E_A1,
    E_A2,
    E_B1,
    E_B2,
    E_KIND,
    E_N1,
    E_N1_AFTER,
    E_N2,
    E_N2_AFTER,
    E_P1,
    E_P2,
)
from dimersweep.kernel.model.layout import FREE


@compiled
def log_phase(log, count, code, before_1, before_2, z, V, P_1, P_2):
    """Add a row to the log of the impact's phases (a log without rows is not kept); returns the count."""
    if count >= log.shape[0]:
        return count
    row = log[count]
    row[E_KIND] = code
    row[E_N1], row[E_N2], row[E_N1_AFTER], row[E_N2_AFTER] = before_1 * V, before_2 * V, z[ZN1] * V, z[ZN2] * V
    row[E_P1], row[E_P2] = P_1, P_2
    row[E_A1], row[E_B1], row[E_A2], row[E_B2] = z[ZA] * V, z[ZB1] * V, z[ZA] * V, z[ZB2] * V
    return count + 1


@compiled
def log_single(log, count, i, digit, n, n_j, n_after, n_j_after, P, a, b):
    """Add a row for a phase of an impact at end i, the other one being off the plate; returns the count."""
    if count >= log.shape[0]:
        return count
    row, j = log[count], 1 - i
    row[E_KIND] = coded(digit, FREE) if i == 0 else coded(FREE, digit)
    row[E_N1 + i], row[E_N1 + j], row[E_N1_AFTER + i], row[E_N1_AFTER + j] = n, n_j, n_after, n_j_after
    row[E_P1 + i], row[E_A1 + 2 * i], row[E_B1 + 2 * i] = P, a, b
    row[E_P1 + j], row[E_A1 + 2 * j], row[E_B1 + 2 * j] = 0.0, 0.0, 0.0
    return count + 1
