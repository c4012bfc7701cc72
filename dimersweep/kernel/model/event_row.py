"""Write the row of an event. Names, units and meanings of its columns: ``symbols.EVENT_QUANTITIES``.

Each phase of an impact is such a row from the start (`log_phase`), and so are events between impacts (``record``).
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.contact_code import coded
from dimersweep.kernel.model.layout import DIP, FREE, PERIOD, PHASE, THETA

# `period` is the number of completed forcing periods, and `phase` counts from the end of the last of them
EVENT = (
    "period", "phase", "cause", "kind", "contact_before", "contact_after",
    "gap_1_rate_before", "gap_2_rate_before", "gap_1_rate_after", "gap_2_rate_after", "impulse_1", "impulse_2",
    "beta", "theta", "slip_1_a", "slip_1_b", "slip_2_a", "slip_2_b",
)  # fmt: skip
N_EVENT = len(EVENT)
E_PERIOD, E_PHASE, E_CAUSE, E_KIND, E_BEFORE, E_AFTER = range(6)
E_N1, E_N2, E_N1_AFTER, E_N2_AFTER, E_P1, E_P2, E_BETA, E_THETA, E_A1, E_B1, E_A2, E_B2 = range(6, N_EVENT)


@compiled(inline=True)
def write_moment(dm, row, state, cause, before, after):
    """Write time and cause of an event, the contact states before and after it, and the attitude of the dimer."""
    row[E_PERIOD], row[E_PHASE], row[E_CAUSE] = state[PERIOD], state[PHASE], cause
    row[E_BEFORE], row[E_AFTER], row[E_BETA], row[E_THETA] = before, after, dm.beta_0 + state[DIP], state[THETA]


@compiled(inline=True)
def write_phase(row, kind, rates, impulses, slips):
    """Write the numbers of a phase: contact state, gap rates before and after, normal impulses, and slips after it."""
    row[E_KIND] = kind
    for k in range(4):
        row[E_N1 + k], row[E_A1 + k] = rates[k], slips[k]
    row[E_P1], row[E_P2] = impulses


@compiled
def log_phase(log, count, kind, rates, impulses, slips):
    """Add a row to the log of the phases of an impact, where there is room; return the number of rows."""
    if count >= log.shape[0]:
        return count
    write_phase(log[count], kind, rates, impulses, slips)
    return count + 1


@compiled
def log_single(log, count, i, digit, rates, P, slip):
    """Add a row to the log for a phase at end i with the other end off the plate; return the number of rows.

    `rates` have those of end i first.
    """
    (n, n_j, n_after, n_j_after), (a, b) = rates, slip
    if i == 0:
        return log_phase(log, count, coded(digit, FREE), rates, (P, 0.0), (a, b, 0.0, 0.0))
    return log_phase(log, count, coded(FREE, digit), (n_j, n, n_j_after, n_after), (0.0, P), (0.0, 0.0, a, b))
