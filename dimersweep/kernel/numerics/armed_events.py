"""Event functions that have been positive: a phase ends where the first of these falls to zero.

Contact phases and impacts march alike: a step (`steps.explicit_step`), what it has armed, and, where the least of the armed
functions has fallen to zero, its place (`root_bracket.locate`). Each gives its own rates and event functions.
"""

from math import inf

from dimersweep.kernel.compiler.jit import compiled


@compiled(inline=True)
def arm(value, problem, armed, n):
    """Arm those of n event functions that have become positive. ``value(problem, k)`` is function k."""
    for k in range(n):
        if armed[k] == 0.0 and value(problem, k) > 0.0:
            armed[k] = 1.0


@compiled(inline=True)
def least_armed(value, problem, armed, n):
    """Least of those of n event functions that are armed, and its number (inf and -1 if none is)."""
    least, which = inf, -1
    for k in range(n):
        if armed[k] > 0.0:
            g = value(problem, k)
            if g < least:
                least, which = g, k
    return least, which
