"""The meter of a run: the work that it has done and may do, and whether it is to stop.

All that works on the same scratch arrays charges the same meter. Whatever takes many steps looks at the meter in every
step. So a run ends soon after its bound is reached, or after another thread has set `stop`.
"""

from dimersweep.kernel.compiler.jit import compiled


class Meter:
    """Work done, and the most that may be done, in hops of one end."""

    spent: float
    bound: float
    stop: bool  # the run is to stop


@compiled(inline=True)
def charge(meter, work):
    """Add work that has been done, in hops of one end."""
    meter[0].spent += work


@compiled(inline=True)
def is_over(meter):
    """Return True if the work has to end: its bound is exceeded, or it is to stop."""
    return meter[0].spent > meter[0].bound or meter[0].stop


@compiled
def set_bound(meter, bound):
    """Begin with no work done and a bound on the work to come; inf for no bound."""
    meter[0].spent, meter[0].bound = 0.0, bound
