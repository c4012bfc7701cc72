"""The meter of a run: the work that it has done and may do, and whether it is to stop.

It is the last row of every work array, so that all that works on one charges the same meter. What takes many steps looks at
it in every one of them: a run so ends soon after its bound is reached, or after another thread has written a one into STOP.
"""

from math import inf

from dimersweep.kernel.compiler.jit import compiled

METER = -1  # row of a work array
SPENT, BOUND, STOP = range(
    3
)  # work done and the most that may be done, in hops of one end; not zero: the run is to stop


@compiled(inline=True)
def charge(meter, work):
    """Add work that has been done."""
    meter[SPENT] += work


@compiled(inline=True)
def is_over(meter):
    """Whether the work has to end: its bound is reached, or it is to stop."""
    return meter[SPENT] > meter[BOUND] or meter[STOP] != 0.0


@compiled(inline=True)
def is_to_stop(meter):
    """Whether the work is to stop because another thread says so."""
    return meter[STOP] != 0.0


@compiled
def set_bound(meter, bound):
    """Begin with no work done, of which so much may be; inf for no bound."""
    meter[SPENT], meter[BOUND] = 0.0, bound


def has_no_bound(work):
    """Take the bound off the meter of a work array, in place; returns the array."""
    work[METER, BOUND] = inf
    return work
