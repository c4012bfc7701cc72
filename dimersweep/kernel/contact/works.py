"""Works over the steps of a contact phase, where they are wanted: they ride along, and must not change the steps.

The plate moves on while the state may rest, so that a step which suits the state may be too long for the works. Their error
is estimated as that of the state is. Where it counts, the step is taken in equal parts once more, for its works alone.
"""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import N_WORKED, YTIME, YWORK
from dimersweep.kernel.contact.powers import phase_rates
from dimersweep.kernel.contact.step_control import IMPLICIT, RESCALED, implicit_error, step_to
from dimersweep.kernel.numerics.steps import copy, error_beyond

WORK_PARTS = 64  # into which a step is taken for its works


@compiled
def work_error(h, method, b):
    """Error of the works over what they may be off, in the step of h seconds that was taken last."""
    if method == RESCALED:  # in xi all is slow, and the slip falls: its power is as smooth as itself
        return 0.0
    if method == IMPLICIT:
        return implicit_error(h, YWORK, N_WORKED, b)
    return error_beyond(h, b.K, YWORK, N_WORKED, b.scale)


@compiled
def settle_works(dm, p, b):
    """Make the works in the step that is to be accepted as good as the state, and note what flows in it."""
    h, method = b.out[YTIME], b.control[0].method
    if work_error(h, method, b) > 1.0:
        works_in_parts(dm, p, h, b)
    for k in range(YWORK, N_WORKED):
        b.flows[k - YWORK] += flow(b.out[k] - b.start[k], b.dy[k], b.dy_out[k], h)


@compiled
def flow(work, first, last, h):
    """Integral of the size of a power over h seconds in which it does a work: of the parabola with its values at both ends.

    Where the power turns in a step it is known to a hundredth, which will do for a unit of residuals.
    """
    if first * last >= 0.0:
        return abs(work)
    bend = 6.0 * (work / h - 0.5 * (first + last))  # power = first + (last - first) s + bend s (1 - s)
    slope = last - first + bend
    root = sqrt(slope * slope + 4.0 * bend * first)
    s = -2.0 * first / (slope + (root if slope > 0.0 else -root))
    turned = h * s * (first + s * (0.5 * slope - bend * s / 3.0))
    return abs(turned) + abs(work - turned)


@compiled
def works_in_parts(dm, p, h, b):
    """Take the step of h seconds from b.start in parts until its works are good enough; all but these stays as it was."""
    c, n, parts, kept = b.control[0], p.n, 1, b.kept
    step = (b.start, b.dy, b.F, b.out, b.dy_out, b.F_out)
    for k in range(6):
        copy(step[k], kept[k], n)
    while parts < WORK_PARTS:
        parts *= 2
        part, worst = h / parts, 0.0
        for j in range(parts):
            for k in range(3):  # from the start of the step, then from the end of the part before
                copy(kept[k] if j == 0 else step[k + 3], step[k], n)
            b.start[YTIME] = 0.0
            step_to(dm, p.modes, c.now + dm.omega * part * j, part, n, c.method, c.stiffness, b)
            worst = max(worst, work_error(part, c.method, b))
        if worst <= 1.0:
            break
    for k in range(YWORK, N_WORKED):
        kept[3, k] = b.out[k]
    for k in range(6):
        copy(kept[k], step[k], n)


@compiled
def works_to_slip_end(dm, p, t, b):
    """Works over a straight line of t seconds from b.start, by the midpoint rule: a slip that ends falls to zero."""
    for k in range(p.n):
        b.probe[k] = b.start[k] + 0.5 * t * b.dy[k]
    phase_rates(dm, p.modes, b.control[0].now + 0.5 * dm.omega * t, b.probe, p.n, b.dy_probe, b.F_probe)
    for k in range(YWORK, N_WORKED):
        p.y[k] = b.start[k] + t * b.dy_probe[k]
        b.flows[k - YWORK] += abs(p.y[k] - b.start[k])
