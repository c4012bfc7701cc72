"""One step of a contact phase, at each of three paces.

Plain: DOP853 in time. Slow: DOP853 in xi with dt = (v / gamma) dxi, for a slip v on its way to rest, whose direction turns
at the rate gamma / v: per xi nothing is stiff and the slip falls exponentially. Slide: Radau IIA in time, for slip that is
slow and stays so, or sets out from rest: its direction follows the forces at once, and the step need not resolve how.
"""

from math import hypot, inf, sqrt
from typing import Any, NamedTuple

from dimersweep.kernel.collocation import NEXT, NODES, RADAU_A, RADAU_C, TOP
from dimersweep.kernel.contact import (
    N_CLOSED,
    YB,
    YGAMMA,
    YS,
    YTHETA,
    YTIME,
    YUA,
    YUB,
    YWB,
    YWP,
    YX,
    YY,
    contact_rates,
    slip_of,
)
from dimersweep.kernel.jit import compiled
from dimersweep.kernel.layout import FREE, SLIP
from dimersweep.kernel.steps import DOP_STAGES, copy, explicit_method, lu_factor, lu_solve

PLAIN, SLOW, SLIDE = 0, 1, 2
MAX_TURNS = 14  # Newton iterations of a slide
TURN = 1e-6  # change of a slip, in units of itself, in its finite differences
SLIPS = (YUA, YUB, YWP)  # what turns with a slip: the first two with one end down, all with both
glide_stage, glide_finish = explicit_method(N_CLOSED)

BENCH_ROWS = 69


class Bench(NamedTuple):
    """Rows of the work array, by what they hold during a step."""

    K: Any  # slopes of the stages
    Y: Any  # states at the nodes of a slide, and what they lack
    R: Any
    J: Any  # derivatives of the slopes with respect to the slips, and the Newton matrix
    LU: Any
    start: Any  # state, rates and forces at the start of the step, and at its end
    dy: Any
    F: Any
    out: Any
    dy_out: Any
    F_out: Any
    scale: Any  # tolerances of the state
    armed: Any  # event functions that have been positive
    values: Any  # event functions in the course of the step
    probe: Any
    dy_probe: Any
    F_probe: Any
    pivots: Any
    change: Any


@compiled
def lay_out(work):
    """The bench on a work array of at least BENCH_ROWS rows."""
    return Bench(
        work[0:12],
        work[12:17],
        work[17:22],
        work[22:37],
        work[37:52],
        work[52],
        work[53],
        work[54],
        work[55],
        work[56],
        work[57],
        work[58],
        work[59],
        work[60:64],
        work[64],
        work[65],
        work[66],
        work[67],
        work[68],
    )


@compiled
def set_scales(dm, tol, scale):
    """Tolerances of the contact state: angles, rates, slips and lengths in the scales of the scene."""
    scale[YB] = scale[YTHETA] = tol
    scale[YWB] = scale[YWP] = tol * dm.w_scale
    scale[YS] = 10.0 * tol * dm.w_scale
    scale[YUA] = scale[YUB] = tol * dm.v_scale
    scale[YTIME] = tol * dm.T
    scale[YX] = scale[YY] = tol * dm.r
    scale[YGAMMA] = 10.0 * tol


@compiled
def stiffness(dm, force):
    """gamma: the rate at which friction under a normal force turns a slip, times its speed [m s-2]."""
    return dm.mu * (1.0 / dm.m + dm.h * dm.h / dm.J_t + dm.r * dm.r / dm.J_a) * force


@compiled
def slowness(dm, modes, y):
    """Slip speed of the slow pace: that of the one slipping end, or half the harmonic mean of both."""
    inverse = 0.0
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            inverse += 1.0 / hypot(a, b)
    return 1.0 / inverse


@compiled
def explicit_step(dm, modes, phase, h, n, pace, gamma, b):
    """One DOP853 step from b.start into b.out, of h seconds or, at the slow pace, h units of xi; returns the error."""
    for i in range(DOP_STAGES):
        if i == 0:
            copy(b.dy, b.K[0], n)
            copy(b.start, b.out, n)
        else:
            glide_stage(i, h, b.start, b.K, n, b.out)
            contact_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, n > N_CLOSED, b.K[i], b.F_out)
        if pace == SLOW:
            share = slowness(dm, modes, b.out) / gamma
            for k in range(n):
                b.K[i, k] *= share
    return glide_finish(h, b.start, b.K, n, b.scale, b.out)


@compiled
def turn_slopes(dm, modes, phase, h, n, m, j, b):
    """Derivatives of the slopes at node j with respect to each slip, by forward differences, into b.J."""
    y, f = b.Y[j], b.K[j]
    a_1, b_1 = slip_of(dm, modes, y, 0)
    v = hypot(a_1, b_1)
    if m > 2:
        a_2, b_2 = slip_of(dm, modes, y, 1)
        v = min(v, hypot(a_2, b_2)) if v > 0.0 else hypot(a_2, b_2)
    for i in range(m):
        slot = SLIPS[i]
        size = TURN * v / (2.0 * dm.h) if slot == YWP else TURN * v
        kept = y[slot]
        y[slot] = kept + size
        size = y[slot] - kept
        contact_rates(dm, modes, phase + dm.omega * h * RADAU_C[j], y, n > N_CLOSED, b.dy_probe, b.F_probe)
        y[slot] = kept
        row = b.J[j * m + i]
        for k in range(n):
            row[k] = (b.dy_probe[k] - f[k]) / size if size != 0.0 else 0.0


@compiled
def newton_matrix(h, m, b):
    """1 - h A dq'/dq over the slips q at all nodes, factored, in b.LU; returns whether it could be."""
    for j in range(NODES):
        for i in range(m):
            for k in range(NODES):
                for q in range(m):
                    entry = -h * RADAU_A[j, k] * b.J[k * m + q, SLIPS[i]]
                    b.LU[j * m + i, k * m + q] = entry + 1.0 if j == k and i == q else entry
    return lu_factor(b.LU, NODES * m, b.pivots)


@compiled
def improve(h, n, m, b):
    """One Newton iteration of the states at the nodes; returns the largest change over the tolerance.

    Only the turning of the slips is stiff: the other derivatives are left out, and what the slips change is carried over.
    """
    for j in range(NODES):
        for k in range(n):
            total = 0.0
            for i in range(NODES):
                total += RADAU_A[j, i] * b.K[i, k]
            b.R[j, k] = b.start[k] + h * total - b.Y[j, k]
        for i in range(m):
            b.change[j * m + i] = b.R[j, SLIPS[i]]
    lu_solve(b.LU, NODES * m, b.pivots, b.change)
    largest = 0.0
    for j in range(NODES):
        for k in range(n):
            d = b.R[j, k]
            for i in range(NODES):
                for q in range(m):
                    d += h * RADAU_A[j, i] * b.J[i * m + q, k] * b.change[i * m + q]
            b.Y[j, k] += d
            if k < N_CLOSED:
                largest = max(largest, abs(d) / b.scale[k])
    return largest


@compiled
def slide_error(h, b):
    """Error of a slide over the tolerance, from how fast the slopes' expansion in Chebyshev polynomials falls off."""
    total = 0.0
    for k in range(N_CLOSED):
        top, near = TOP[0] * b.dy[k], 0.0
        for j in range(NODES):
            top += TOP[j + 1] * b.K[j, k]
            near += NEXT[j] * b.K[j, k]
        ratio = min(1.0, abs(top / near)) if near != 0.0 else 1.0
        total += (h * top * ratio / b.scale[k]) ** 2
    return sqrt(total / N_CLOSED)


@compiled
def slide_step(dm, modes, phase, h, n, b):
    """One Radau IIA step of h seconds from b.start into b.out; returns the error over the tolerance, inf if it fails."""
    m = 3 if modes[0] != FREE and modes[1] != FREE else 2
    for j in range(NODES):
        for k in range(n):
            b.Y[j, k] = b.start[k] + h * RADAU_C[j] * b.dy[k]
    before = inf
    for turn in range(MAX_TURNS):
        for j in range(NODES):
            at = phase + dm.omega * h * RADAU_C[j]
            contact_rates(dm, modes, at, b.Y[j], n > N_CLOSED, b.K[j], b.F_out)
        if turn == 0 or turn == 5:
            for j in range(NODES):
                turn_slopes(dm, modes, phase, h, n, m, j, b)
            if not newton_matrix(h, m, b):
                return inf
        change = improve(h, n, m, b)
        if change <= 0.01:
            copy(b.Y[NODES - 1], b.out, n)
            b.out[YTIME] = h
            return slide_error(h, b)
        if not change < inf or (turn > 2 and turn != 5 and change > before):
            return inf
        before = change
    return inf


@compiled
def step_to(dm, modes, phase, h, n, pace, gamma, b):
    """One step; the rates (per time) and forces at its end are left in b.dy_out, b.F_out. Returns the error."""
    if pace == SLIDE:
        error = slide_step(dm, modes, phase, h, n, b)
    else:
        error = explicit_step(dm, modes, phase, h, n, pace, gamma, b)
    contact_rates(dm, modes, phase + dm.omega * b.out[YTIME], b.out, n > N_CLOSED, b.dy_out, b.F_out)
    return error
