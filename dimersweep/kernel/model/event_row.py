"""The row of an event: what each of its columns holds; names, units and meanings: ``symbols.EVENT_QUANTITIES``.

A phase of an impact is such a row from the start (``impact.phase_log``), and so are events between impacts (``record``).
"""

# beside the names that are told: completed forcing periods; the phase counts from their end
EVENT = (
    "period", "phase", "cause", "kind", "contact_before", "contact_after",
    "gap_1_rate_before", "gap_2_rate_before", "gap_1_rate_after", "gap_2_rate_after", "impulse_1", "impulse_2",
    "beta", "theta", "slip_1_a", "slip_1_b", "slip_2_a", "slip_2_b",
)  # fmt: skip
N_EVENT = len(EVENT)
E_PERIOD, E_PHASE, E_CAUSE, E_KIND, E_BEFORE, E_AFTER = range(6)
E_N1, E_N2, E_N1_AFTER, E_N2_AFTER, E_P1, E_P2, E_BETA, E_THETA, E_A1, E_B1, E_A2, E_B2 = range(6, N_EVENT)
