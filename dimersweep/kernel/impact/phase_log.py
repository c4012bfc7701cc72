"""The log of an impact: an event row for each of its phases."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import ZA, ZB1, ZB2, ZN1, ZN2
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.event_row import write_phase
from dimersweep.kernel.model.layout import FREE


@compiled
def log_phase(log, count, code, before_1, before_2, z, V, P_1, P_2):
    """Add a row to the log of the impact's phases (a log without rows is not kept); returns the count."""
    if count >= log.shape[0]:
        return count
    rates = before_1 * V, before_2 * V, z[ZN1] * V, z[ZN2] * V
    write_phase(log[count], code, rates, (P_1, P_2), (z[ZA] * V, z[ZB1] * V, z[ZA] * V, z[ZB2] * V))
    return count + 1


@compiled
def log_single(log, count, i, digit, n, n_j, n_after, n_j_after, P, a, b):
    """Add a row for a phase of an impact at end i, the other one being off the plate; returns the count."""
    if count >= log.shape[0]:
        return count
    if i == 0:
        write_phase(log[count], coded(digit, FREE), (n, n_j, n_after, n_j_after), (P, 0.0), (a, b, 0.0, 0.0))
    else:
        write_phase(log[count], coded(FREE, digit), (n_j, n, n_j_after, n_after), (0.0, P), (0.0, 0.0, a, b))
    return count + 1
