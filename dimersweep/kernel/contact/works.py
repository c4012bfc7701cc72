"""Integrate the works over the steps of a contact phase, where they are wanted.

The works must not change the steps. The plate moves on while the state may rest, so that a step which suits the state
may be too long for the works. So each step is taken once more in equal parts, for its works alone, until these agree
with those of fewer parts.
"""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import N_PATH, N_WORKED, Y
from dimersweep.kernel.contact.forces import phase_rates
from dimersweep.kernel.contact.step_control import RESCALED, step_to
from dimersweep.kernel.numerics.steps import copy

WORK_PARTS = 64  # parts, at most, in which a step is taken for its works


@compiled
def settle_works(p):
    """Make the works in the step that is to be accepted as accurate as `control.doubt` asks, and add up their sizes."""
    start, out, h = p.b.start, p.b.out, p.b.out.y[Y.time]
    # in xi all is slow, and the slip falls: its power is as smooth as the slip itself
    if p.control.method != RESCALED:
        works_in_parts(p, h)
    for k in range(N_PATH, N_WORKED):
        p.b.flows[k - N_PATH] += flow(out.y[k] - start.y[k], start.dy[k], out.dy[k], h)


@compiled
def flow(work, first, last, h):
    """Return the integral of the size of a power over h seconds in which it does the work `work`.

    The power is taken for the parabola with the values `first` and `last` at both ends. Where the power changes its
    sign in a step, the result is good to a hundredth, which is enough for a unit of residuals.
    """
    if first * last >= 0.0:
        return abs(work)
    # power = first + (last - first) s + bend s (1 - s)
    bend = 6.0 * (work / h - 0.5 * (first + last))
    slope = last - first + bend
    root = sqrt(slope * slope + 4.0 * bend * first)
    # the root of the parabola inside the step, in the form that needs no difference of numbers of like size
    s = -2.0 * first / (slope + (root if slope > 0.0 else -root))
    turned = h * s * (first + s * (0.5 * slope - bend * s / 3.0))
    return abs(turned) + abs(work - turned)


@compiled
def works_in_parts(p, h):
    """Take the step of h seconds in parts until its works no longer change; all but the works stays as it was.

    Parts of an implicit step may fail where the whole step does not: the works of such parts do not count.
    """
    start, out, parts, kept = p.b.start, p.b.out, 1, p.b.kept
    step = (start.y, start.dy, start.F, out.y, out.dy, out.F)
    for k in range(6):
        copy(step[k], kept[k], p.n)
    while parts < WORK_PARTS:
        # twice as many parts each time: the change from half as many bounds the error
        parts *= 2
        sound = True
        for j in range(parts):
            # from the start of the step, then from the end of the part before
            for k in range(3):
                if j == 0:
                    copy(kept[k], step[k], p.n)
                else:
                    copy(step[k + 3], step[k], p.n)
            start.y[Y.time] = 0.0
            sound = sound and step_to(p, p.control.now + p.dm.omega * h / parts * j, h / parts) < inf
        if not sound:
            continue
        change = 0.0
        for k in range(N_PATH, N_WORKED):
            change = max(change, abs(out.y[k] - kept[3, k]) / p.b.scale[k])
            kept[3, k] = out.y[k]
        if change <= 1.0:
            break
    for k in range(6):
        copy(kept[k], step[k], p.n)


@compiled
def works_to_slip_end(p, t):
    """Add the works over the straight line of t seconds on which a slip ends, by the midpoint rule.

    The slip falls to zero on it, so that its power is linear.
    """
    start, probe = p.b.start, p.b.probe
    for k in range(p.n):
        probe.y[k] = start.y[k] + 0.5 * t * start.dy[k]
    phase_rates(p, p.control.now + 0.5 * p.dm.omega * t, probe)
    for k in range(N_PATH, N_WORKED):
        before = start.y[k]
        start.y[k] += t * probe.dy[k]
        p.b.flows[k - N_PATH] += abs(start.y[k] - before)
