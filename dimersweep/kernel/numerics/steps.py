"""Take one step of DOP853, which every phase shares, and solve dense equations.

The parts of a step are stage sums, error norms and step control.
"""

from math import inf, sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.numerics.elementary import eighth_root
from dimersweep.kernel.numerics.tableaux import DOP_A, DOP_E3, DOP_E5, DOP_SKIPPED

DOP_STAGES = 12
WIDTH = 8  # entries of a state that DOP853 controls: a loop over them in registers


@compiled
def copy(source, target, n):
    """Copy the first n entries (a slice assignment compiles ten times as slowly)."""
    for k in range(n):
        target[k] = source[k]


@compiled(fuse=True, inline=True)
def stage_sums(i, last, K):
    """Return the slopes K of the stages of DOP853 before number `last`, weighted by row i of its table and summed up.

    They are the sums of the first WIDTH entries.
    """
    a, slope = DOP_A[i, 0] if last > 0 else 0.0, K[0]
    t0, t1, t2, t3 = a * slope[0], a * slope[1], a * slope[2], a * slope[3]
    t4, t5, t6, t7 = a * slope[4], a * slope[5], a * slope[6], a * slope[7]
    for j in range(DOP_SKIPPED[i], last):
        a, slope = DOP_A[i, j], K[j]
        t0 += a * slope[0]
        t1 += a * slope[1]
        t2 += a * slope[2]
        t3 += a * slope[3]
        t4 += a * slope[4]
        t5 += a * slope[5]
        t6 += a * slope[6]
        t7 += a * slope[7]
    return t0, t1, t2, t3, t4, t5, t6, t7


@compiled(fuse=True, inline=True)
def explicit_error(h, K, first, last, scale):
    """Return the error over the tolerance of the entries from `first` up to `last` in a step of DOP853."""
    sum5, sum3 = 0.0, 0.0
    for k in range(first, last):
        e5, e3 = DOP_E5[0] * K[0, k], DOP_E3[0] * K[0, k]
        for j in range(DOP_SKIPPED[DOP_STAGES], DOP_STAGES):
            e5 += DOP_E5[j] * K[j, k]
            e3 += DOP_E3[j] * K[j, k]
        unit = 1.0 / scale[k]
        sum5 += e5 * unit * (e5 * unit)
        sum3 += e3 * unit * (e3 * unit)
    if sum5 == 0.0:
        return 0.0
    # Hairer, Norsett, Wanner (see `tableaux`): the error of order 5 is damped by that of order 3, whose weight is 0.01
    size = sqrt((sum5 + 0.01 * sum3) * (last - first))
    return abs(h) * sum5 / size if size < inf else inf


@compiled(fuse=True, inline=True)
def explicit_finish(h, y, K, n, scale, out):
    """Write the new state into `out`; return the error of the first WIDTH entries over the tolerance (1 is acceptable).

    Entries beyond these only follow from them: whether they are wanted must not change the steps.
    """
    t0, t1, t2, t3, t4, t5, t6, t7 = stage_sums(DOP_STAGES, DOP_STAGES, K)
    out[0], out[1], out[2], out[3] = y[0] + h * t0, y[1] + h * t1, y[2] + h * t2, y[3] + h * t3
    out[4], out[5], out[6], out[7] = y[4] + h * t4, y[5] + h * t5, y[6] + h * t6, y[7] + h * t7
    for k in range(WIDTH, n):
        total = DOP_A[DOP_STAGES, 0] * K[0, k]
        for j in range(DOP_SKIPPED[DOP_STAGES], DOP_STAGES):
            total += DOP_A[DOP_STAGES, j] * K[j, k]
        out[k] = y[k] + h * total
    return explicit_error(h, K, 0, WIDTH, scale)


@compiled(fuse=True, inline=True)
def explicit_step(slopes, problem, h, y, K, n, scale, out):
    """Take one DOP853 step of size h from y into `out`; return the error over the tolerance. K[0] has the slopes at y.

    ``slopes(problem, i, ...)`` returns the slopes of stage i of the first WIDTH entries of the state, from these
    entries. It writes the slopes of the other entries, on which nothing depends, into K[i] itself. The newest slopes
    stay in registers: to write them to K and to read them at once takes a tenth of a step of an impact, and half of the
    rates of a contact.
    """
    k = K[0]
    k0, k1, k2, k3, k4, k5, k6, k7 = k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]
    for i in range(1, DOP_STAGES):
        t0, t1, t2, t3, t4, t5, t6, t7 = stage_sums(i, i - 1, K)
        a = DOP_A[i, i - 1]
        k0, k1, k2, k3, k4, k5, k6, k7 = slopes(
            problem,
            i,
            y[0] + h * (t0 + a * k0),
            y[1] + h * (t1 + a * k1),
            y[2] + h * (t2 + a * k2),
            y[3] + h * (t3 + a * k3),
            y[4] + h * (t4 + a * k4),
            y[5] + h * (t5 + a * k5),
            y[6] + h * (t6 + a * k6),
            y[7] + h * (t7 + a * k7),
        )
        k = K[i]
        k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7] = k0, k1, k2, k3, k4, k5, k6, k7
    return explicit_finish(h, y, K, n, scale, out)


@compiled
def step_factor(error):
    """Return the factor by which to multiply the step after a step with this error over the tolerance."""
    if not error < inf:
        return 0.1
    # an eighth root: the error goes with the eighth power of the step. 0.9 leaves room, and 0.18 = 0.9 / 5 bounds the
    # factor by 5
    root = eighth_root(error)
    return max(0.1, 0.9 / root) if root > 0.18 else 5.0


@compiled(fuse=True)
def lu_factor(A, n, pivots):
    """Factor A by LU with row pivoting, in place; return False when A is singular or not finite."""
    for k in range(n):
        p, big = k, abs(A[k, k])
        for i in range(k + 1, n):
            if abs(A[i, k]) > big:
                p, big = i, abs(A[i, k])
        pivots[k] = p
        if not (0.0 < big < inf):
            return False
        if p != k:
            for j in range(n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, n):
            A[i, k] *= inverse
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]
    return True


@compiled(fuse=True)
def lu_solve(A, n, pivots, b):
    """Solve with the factors of ``lu_factor``; b becomes the solution."""
    for k in range(n):
        p = int(pivots[k])
        if p != k:
            b[k], b[p] = b[p], b[k]
    for k in range(n):
        for i in range(k + 1, n):
            b[i] -= A[i, k] * b[k]
    for k in range(n - 1, -1, -1):
        total = b[k]
        for j in range(k + 1, n):
            total -= A[k, j] * b[j]
        b[k] = total / A[k, k]


@compiled
def on_cubic(start, rates, end, rates_end, s, h, n, out):
    """Write the cubic through the ends of a step of size h at share s into `out`."""
    u = 1.0 - s
    for k in range(n):
        rise = end[k] - start[k]
        out[k] = start[k] + s * rise + s * u * ((2.0 * s - 1.0) * rise + h * (u * rates[k] - s * rates_end[k]))
