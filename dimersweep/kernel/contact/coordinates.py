"""The state of a contact phase in two charts: by the heading of the rod, and by its axis where it stands so steeply that
the heading turns too fast, or has no meaning.

By heading: y = (dip above level, beta', theta' cos(beta), spin, u_a, u_b, theta, t, x1, y1, gamma), u the slip of the leading
end (p1 if it is closed, else p2), so that slow slip keeps its relative precision and sticking is u = 0; t counts from the
start of a step. Upright: everything horizontal is measured along two fixed axes, those of the heading when the chart was
entered: y = (k_a, k_a', k_b', spin, u_a, u_b, k_b, t, x_b, x_a, chi), k the axis from p1 to p2 and chi = gamma +- theta, which
stay regular at the vertical. Both have the slip in the same slots, and the same tolerances suit both.

Behind them stand the works of the contact forces since the phase began (``works``), where these are wanted.
"""

from math import sqrt

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.body import (
    apart_sideways,
    attitude,
    delassus,
    end,
    lateral_impulses,
    level_levers,
    levers,
    lift,
    turn_of_pair,
)
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D1,
    D2,
    DIP,
    FREE,
    GAMMA,
    N1,
    N2,
    SPIN,
    STICK,
    THETA,
    WB,
    WP,
    X1,
    Y1,
)
from dimersweep.kernel.model.works import N_CONTACT_WORK
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import sincos

YDIP, YWB, YWP, YS, YUA, YUB, YTHETA, YTIME, YX, YY, YGAMMA = range(11)
KA, KDA, KDB, _, _, _, KB = range(7)  # of the upright chart, where they differ in meaning
YWORK = 11  # the first of the works, in the order of `model.works`
# entries without the path, with it, and with the works
N_CLOSED, N_PATH, N_WORKED = 8, 11, YWORK + N_CONTACT_WORK
YCHART, YAXES = N_WORKED, N_WORKED + 1  # constants of a phase: the chart, and theta of its axes
N_Y = N_WORKED + 2
BY_HEADING, UPRIGHT = 0.0, 1.0
STEEP = 1.47  # dip beyond which the upright chart is taken [rad]
LEANS = 0.15  # cosine of the dip from which it is left


@compiled
def leading(modes):
    """Number of the leading end: p1 if it is closed, else p2."""
    return 0 if modes[0] != FREE else 1


@compiled
def contact_state(dm, state, i, y):
    """Contact state y from the kernel state, i the number of the leading end."""
    p = end(dm, i)
    sin_b, cos_b = attitude(dm, state[DIP])
    lv = levers(p, sin_b, cos_b)
    y[YDIP], y[YWB], y[YWP], y[YS] = state[DIP], state[WB], state[WP], state[SPIN]
    y[YUA] = state[CA] + lv.a * state[WB]
    y[YUB] = state[CB] + lv.b * state[WP] + lv.c * state[SPIN]
    y[YTHETA], y[YX], y[YY], y[YGAMMA] = state[THETA], state[X1], state[Y1], state[GAMMA]
    y[YTIME] = 0.0
    y[YCHART], y[YAXES] = BY_HEADING, 0.0
    if abs(dm.beta_0 + y[YDIP]) > STEEP:
        change_chart(dm, p.s, y)


@compiled
def kernel_state(dm, modes, y, state):
    """Kernel state from the contact state y: closed gaps and their rates are exactly zero."""
    p = end(dm, leading(modes))
    dip, w_b, w_p, u_a, u_b, theta, x, y_1, gamma = by_heading(dm, p.s, y)
    sin_b, cos_b = attitude(dm, dip)
    lv = levers(p, sin_b, cos_b)
    state[DIP], state[WB], state[WP], state[SPIN] = dip, w_b, w_p, y[YS]
    state[CA] = u_a - lv.a * w_b
    state[CB] = u_b - lv.b * w_p - lv.c * y[YS]
    state[THETA], state[X1], state[Y1], state[GAMMA] = theta, x, y_1, gamma
    gap, rate = dm.l * lift(dm, dip), dm.l * cos_b * w_b
    state[D1] = 0.0 if modes[0] != FREE else -gap
    state[N1] = 0.0 if modes[0] != FREE else -rate
    state[D2] = 0.0 if modes[1] != FREE else gap
    state[N2] = 0.0 if modes[1] != FREE else rate


@compiled
def slip_of(dm, modes, y, i):
    """Axial and lateral slip of end i (0 or 1), which is closed."""
    if i == 0 or modes[0] == FREE:
        return y[YUA], y[YUB]
    return y[YUA], y[YUB] - apart_sideways(dm, y[YWP], y[YS])


@compiled
def put_slip(dm, modes, y, i, a, b):
    """Write the slip (a, b) of end i, which is closed; the spin stays.

    An end that sticks beside it does so still; of one that slips the lateral slip changes as it would by an impulse at end i.
    """
    if modes[0] == FREE or modes[1] == FREE:
        y[YUA], y[YUB] = a, b
        return
    b_1, b_2 = y[YUB], y[YUB] - apart_sideways(dm, y[YWP], y[YS])
    if i == 0:
        b_2 = 0.0 if modes[1] == STICK else b_2 + dm.pair.bb_12 / dm.pair.bb_1 * (b - b_1)
        put_slips(dm, y, a, b, b_2)
    else:
        b_1 = 0.0 if modes[0] == STICK else b_1 + dm.pair.bb_12 / dm.pair.bb_2 * (b - b_2)
        put_slips(dm, y, a, b_1, b)


@compiled
def put_slips(dm, y, a, b_1, b_2):
    """Write the slips of both ends, which are closed: the axial one a, the lateral ones b_1, b_2; the spin stays."""
    y[YUA], y[YUB], y[YWP] = a, b_1, turn_of_pair(dm, b_1 - b_2, y[YS])


@compiled
def give_impulses(dm, modes, y, u_b, w_p):
    """Have the lateral slips that were put into y come about by impulses: the spin takes its part in them.

    So a rod that rolls fast gets no energy from a slip, however small, that is set or taken away. In the upright chart the
    spin stays.

    Parameters
    ----------
    u_b, w_p : float
        Lateral slip of the leading end and theta' cos(beta) before.
    """
    b = y[YUB]
    if modes[0] != FREE and modes[1] != FREE:
        apart = apart_sideways(dm, y[YWP], y[YS])
        B_1, B_2 = lateral_impulses(dm, dm.m * (b - u_b), dm.m * (b - apart - u_b + apart_sideways(dm, w_p, y[YS])))
        p, q = level_levers(dm)
        y[YS] += (p.c * B_1 + q.c * B_2) * dm.ia
        y[YWP] = turn_of_pair(dm, apart, y[YS])
    elif y[YCHART] == BY_HEADING:
        sin_b, cos_b = attitude(dm, y[YDIP])
        lv = levers(end(dm, leading(modes)), sin_b, cos_b)
        impulse = (b - u_b) / delassus(dm, lv, lv).bb
        y[YWP] = w_p + lv.b * dm.it * impulse
        y[YS] += lv.c * dm.ia * impulse


@compiled
def set_slip(dm, modes, y, i, a, b):
    """Give end i, which is closed, the slip (a, b), across the axis by an impulse there."""
    u_b, w_p = y[YUB], y[YWP]
    put_slip(dm, modes, y, i, a, b)
    give_impulses(dm, modes, y, u_b, w_p)


@compiled
def axis(s, y):
    """In the upright chart: vertical component of the axis k and of its rate, and the heading (zero turn at the vertical).

    Returns
    -------
    k_n, k_n', cos(beta), c, d : float
        c, d are the components of the heading along the axes a, b of the chart.
    """
    cos_b = length(y[KA], y[KB])
    k_n = -s * sqrt(max(0.0, 1.0 - cos_b * cos_b))
    c, d = (y[KA] / cos_b, y[KB] / cos_b) if cos_b > 0.0 else (1.0, 0.0)
    return k_n, -(y[KA] * y[KDA] + y[KB] * y[KDB]) / k_n, cos_b, c, d


@compiled
def by_heading(dm, s, y):
    """The dip above level, beta', theta' cos(beta), u_a, u_b, theta, x1, y1, gamma of a contact state in either chart.

    Whole turns of theta about the vertical are not counted in the upright chart.
    """
    if y[YCHART] == BY_HEADING:
        return y[YDIP], y[YWB], y[YWP], y[YUA], y[YUB], y[YTHETA], y[YX], y[YY], y[YGAMMA]
    k_n, _, cos_b, c, d = axis(s, y)
    w_b = -(y[KDA] * c + y[KDB] * d) / k_n
    w_p = y[KDA] * d - y[KDB] * c
    turn = atan2(-d, c)
    sin_0, cos_0 = sincos(y[YAXES])
    x, y_1 = y[YX] * cos_0 - y[YY] * sin_0, y[YX] * sin_0 + y[YY] * cos_0
    theta = y[YAXES] + turn
    gamma = y[YGAMMA] + s * theta
    dip = atan2(k_n, cos_b) - dm.beta_0
    return dip, w_b, w_p, y[YUA] * c + y[YUB] * d, y[YUB] * c - y[YUA] * d, theta, x, y_1, gamma


@compiled
def change_chart(dm, s, y):
    """Write a contact state in the other chart, in place."""
    dip, w_b, w_p, u_a, u_b, theta, x, y_1, gamma = by_heading(dm, s, y)
    y[YUA], y[YUB] = u_a, u_b
    if y[YCHART] == UPRIGHT:
        y[YDIP], y[YWB], y[YWP], y[YTHETA] = dip, w_b, w_p, theta
        y[YX], y[YY], y[YGAMMA] = x, y_1, gamma
        y[YCHART] = BY_HEADING
        return
    sin_0, cos_0 = sincos(theta)
    sin_b, cos_b = attitude(dm, dip)
    y[KA], y[KB], y[KDA], y[KDB] = cos_b, 0.0, -sin_b * w_b, -w_p
    y[YX], y[YY] = x * cos_0 + y_1 * sin_0, y_1 * cos_0 - x * sin_0
    y[YGAMMA] = gamma - s * theta
    y[YCHART], y[YAXES] = UPRIGHT, theta


@compiled
def to_border(dm, y):
    """Positive while a contact state is well described in its chart."""
    if y[YCHART] == BY_HEADING:
        return STEEP - abs(dm.beta_0 + y[YDIP])
    return LEANS * LEANS - (y[KA] * y[KA] + y[KB] * y[KB])


@compiled
def same_chart(y, other):
    """Mark a state as one in the chart of y."""
    other[YCHART], other[YAXES] = y[YCHART], y[YAXES]
