"""The log of an impact: a row for each of its phases."""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.impact.double_equations import ZA, ZB1, ZB2, ZN1, ZN2
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.layout import FREE

# a row: contact state; gap rates before, after; impulses; slips (a_1, b_1, a_2, b_2) after
LOG_STATE, LOG_N1, LOG_N2, LOG_N1_AFTER, LOG_N2_AFTER, LOG_P1, LOG_P2, LOG_A1, LOG_B1, LOG_A2, LOG_B2 = range(11)
N_LOG = 11


@compiled
def log_phase(log, count, code, before_1, before_2, z, V, P_1, P_2):
    """Add a row to the log of the impact's phases (a log without rows is not kept); returns the count."""
    if count < log.shape[0]:
        row = log[count]
        row[LOG_STATE] = code
        row[LOG_N1], row[LOG_N2] = before_1 * V, before_2 * V
        row[LOG_N1_AFTER], row[LOG_N2_AFTER] = z[ZN1] * V, z[ZN2] * V
        row[LOG_P1], row[LOG_P2] = P_1, P_2
        row[LOG_A1], row[LOG_B1], row[LOG_A2], row[LOG_B2] = z[ZA] * V, z[ZB1] * V, z[ZA] * V, z[ZB2] * V
        return count + 1
    return count


@compiled
def log_single(log, count, i, digit, n, n_j, n_after, n_j_after, P, a, b):
    """Add a row for a phase of an impact at end i, the other one being off the plate; returns the count."""
    if count >= log.shape[0]:
        return count
    row = log[count]
    for k in range(N_LOG):
        row[k] = 0.0
    row[LOG_STATE] = coded(digit, FREE) if i == 0 else coded(FREE, digit)
    row[LOG_N1 + i], row[LOG_N1 + 1 - i] = n, n_j
    row[LOG_N1_AFTER + i], row[LOG_N1_AFTER + 1 - i] = n_after, n_j_after
    row[LOG_P1 + i], row[LOG_A1 + 2 * i], row[LOG_B1 + 2 * i] = P, a, b
    return count + 1
