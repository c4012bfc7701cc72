"""Write the state of a contact phase in two charts: by the heading of the rod, and upright.

The upright chart goes by the axis of the rod. It is taken where the rod stands so steeply that the heading turns too
fast, or has no meaning.

By heading, the slip of the leading end (p1 if it is closed, else p2) stands in the state: a slow slip keeps its
relative precision, and sticking is u = 0. Upright, everything horizontal is measured along two fixed axes, those of the
heading when the chart was entered: the axis k from p1 to p2 and chi = gamma +- theta stay regular at the vertical. Both
charts have the slip in the same slots, and the same tolerances suit both.
"""

from math import inf, sqrt
from typing import NamedTuple

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model import body, layout
from dimersweep.kernel.model.body import apart_sideways, attitude, end, levers, turn_of_pair
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, FREE, N1, N2, SLIP, SPIN, STICK, THETA, WB, WP, X1, Y1
from dimersweep.kernel.model.works import N_CONTACT_WORK
from dimersweep.kernel.numerics.elementary import atan2, length
from dimersweep.kernel.numerics.sincos import sincos

N_CLOSED, N_PATH = 8, 11  # entries of a contact state without the path, and with it
N_WORKED = N_PATH + N_CONTACT_WORK  # entries with path and works
N_Y = N_WORKED + 2


class Slots(NamedTuple):
    """Places of the numbers in a contact state."""

    dip: int = 0  # dip above level [rad]
    w_b: int = 1  # beta'
    w_p: int = 2  # theta' cos(beta)
    spin: int = 3
    u_a: int = 4  # slip of the leading end, axial and lateral; upright along a and b of the chart [m s-1]
    u_b: int = 5
    theta: int = 6
    time: int = 7  # time since the start of a step [s]
    x: int = 8  # x1, y1 and gamma; upright, the place along b and a, and chi
    y: int = 9
    gamma: int = 10
    # the first of the works of the contact forces since the phase began, in the order of `model.works`
    work: int = N_PATH
    # BY_HEADING or UPRIGHT, and theta of the axes of that chart: the same throughout a phase
    chart: int = N_WORKED
    axes: int = N_WORKED + 1
    # upright: horizontal parts of the axis k and of its rate, in place of dip, beta', theta' cos(beta) and theta
    k_a: int = 0
    dk_a: int = 1
    dk_b: int = 2
    k_b: int = 6


Y = Slots()
BY_HEADING, UPRIGHT = 0.0, 1.0
# dip beyond which the upright chart is taken [rad]: its cosine is 0.10
STEEP = 1.47
# cosine of the dip from which the upright chart is left: more than that of STEEP, so that no state goes to and fro
LEANS = 0.15


@compiled
def leading(modes):
    """Return the number of the leading end: p1 if it is closed, else p2."""
    return 0 if modes[0] != FREE else 1


@compiled
def contact_state(dm, state, i, y):
    """Write the contact state y of a kernel state, with i the number of the leading end; y is upright beyond STEEP."""
    p = end(dm, i)
    sin_b, cos_b = attitude(dm, state[DIP])
    lv = levers(p, sin_b, cos_b)
    y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.spin] = state[DIP], state[WB], state[WP], state[SPIN]
    y[Y.u_a] = state[CA] + lv.a * state[WB]
    y[Y.u_b] = state[CB] + lv.b * state[WP] + lv.c * state[SPIN]
    y[Y.theta], y[Y.x], y[Y.y], y[Y.gamma] = state[THETA], state[X1], state[Y1], state[layout.GAMMA]
    y[Y.time] = 0.0
    y[Y.chart], y[Y.axes] = BY_HEADING, 0.0
    if abs(dm.beta_0 + y[Y.dip]) > STEEP:
        change_chart(dm, p.s, y)


@compiled
def kernel_state(dm, modes, y, state):
    """Write the kernel state of the contact state y; the gaps and gap rates of closed ends are exactly zero."""
    p = end(dm, leading(modes))
    dip, w_b, w_p, u_a, u_b, theta, x, y_1, gamma = by_heading(dm, p.s, y)
    sin_b, cos_b = attitude(dm, dip)
    lv = levers(p, sin_b, cos_b)
    state[DIP], state[WB], state[WP], state[SPIN] = dip, w_b, w_p, y[Y.spin]
    state[CA] = u_a - lv.a * w_b
    state[CB] = u_b - lv.b * w_p - lv.c * y[Y.spin]
    state[THETA], state[X1], state[Y1], state[layout.GAMMA] = theta, x, y_1, gamma
    gap, rate = dm.l * body.lift(dm, dip), dm.l * cos_b * w_b
    state[D1] = 0.0 if modes[0] != FREE else -gap
    state[N1] = 0.0 if modes[0] != FREE else -rate
    state[D2] = 0.0 if modes[1] != FREE else gap
    state[N2] = 0.0 if modes[1] != FREE else rate


@compiled
def slip_of(dm, modes, y, i):
    """Return the axial and lateral slip of end i, which is closed; where y holds rates, the rates of the slip."""
    if i == 0 or modes[0] == FREE:
        return y[Y.u_a], y[Y.u_b]
    return y[Y.u_a], y[Y.u_b] - apart_sideways(dm, y[Y.w_p], y[Y.spin])


@compiled(inline=True)
def change_of_slip(dm, modes, y, dy, i):
    """Return the speed of the slip of end i, and its rates along the slip and across it, both times that speed."""
    a, b = slip_of(dm, modes, y, i)
    d_a, d_b = slip_of(dm, modes, dy, i)
    return length(a, b), a * d_a + b * d_b, a * d_b - b * d_a


@compiled
def slip_speed(dm, modes, y, dy):
    """Return the speed of the end that slips most slowly, and the rate of that speed.

    They are inf, 0.0 if no end has a slip that turns. Beside an end that sticks the other end slips along a fixed line.
    """
    least, rate = inf, 0.0
    if modes[0] == STICK or modes[1] == STICK:
        return least, rate
    for i in range(2):
        if modes[i] == SLIP:
            v, along, _ = change_of_slip(dm, modes, y, dy, i)
            if v < least:
                least, rate = v, along / v
    return least, rate


@compiled
def slip_limit(dm, modes, y, dy):
    """Return the time [s] before which no slip comes to rest at its present rate; inf if no slip decreases."""
    h = inf
    for i in range(2):
        if modes[i] == SLIP:
            v, along, _ = change_of_slip(dm, modes, y, dy, i)
            if along < 0.0:
                h = min(h, -v / (along / v))
    return h


@compiled
def put_slip(dm, modes, y, i, a, b):
    """Write the slip (a, b) of end i, which is closed; the spin stays.

    If the other end sticks, it sticks still. If it slips, its lateral slip changes as it would by an impulse at end i.
    """
    if modes[0] == FREE or modes[1] == FREE:
        y[Y.u_a], y[Y.u_b] = a, b
        return
    b_1, b_2 = y[Y.u_b], y[Y.u_b] - apart_sideways(dm, y[Y.w_p], y[Y.spin])
    if i == 0:
        b_2 = 0.0 if modes[1] == STICK else b_2 + dm.pair.bb_12 / dm.pair.bb_1 * (b - b_1)
        put_slips(dm, y, a, b, b_2)
    else:
        b_1 = 0.0 if modes[0] == STICK else b_1 + dm.pair.bb_12 / dm.pair.bb_2 * (b - b_2)
        put_slips(dm, y, a, b_1, b)


@compiled
def put_slips(dm, y, a, b_1, b_2):
    """Write the slips of both closed ends, the axial slip a and the lateral slips b_1, b_2; the spin stays."""
    y[Y.u_a], y[Y.u_b], y[Y.w_p] = a, b_1, turn_of_pair(dm, b_1 - b_2, y[Y.spin])


@compiled
def give_impulses(dm, modes, y, u_b, w_p):
    """Change the spin as impulses would that bring about the lateral slips just written into y.

    So a rod that rolls fast gets no energy from a slip, however small, that is set or taken away. In the upright chart
    the spin stays. u_b and w_p are the lateral slip of the leading end and theta' cos(beta) before the slips were
    written.
    """
    b = y[Y.u_b]
    if modes[0] != FREE and modes[1] != FREE:
        apart = apart_sideways(dm, y[Y.w_p], y[Y.spin])
        B_1, B_2 = body.lateral_impulses(
            dm, dm.m * (b - u_b), dm.m * (b - apart - u_b + apart_sideways(dm, w_p, y[Y.spin]))
        )
        p, q = body.level_levers(dm)
        y[Y.spin] += (p.c * B_1 + q.c * B_2) * dm.ia
        y[Y.w_p] = turn_of_pair(dm, apart, y[Y.spin])
    elif y[Y.chart] == BY_HEADING:
        sin_b, cos_b = attitude(dm, y[Y.dip])
        lv = levers(end(dm, leading(modes)), sin_b, cos_b)
        impulse = (b - u_b) / body.delassus(dm, lv, lv).bb
        y[Y.w_p] = w_p + lv.b * dm.it * impulse
        y[Y.spin] += lv.c * dm.ia * impulse


@compiled
def set_slip(dm, modes, y, i, a, b):
    """Set the slip (a, b) of end i, which is closed; its lateral part comes about by an impulse there."""
    u_b, w_p = y[Y.u_b], y[Y.w_p]
    put_slip(dm, modes, y, i, a, b)
    give_impulses(dm, modes, y, u_b, w_p)


@compiled
def axis(s, y):
    """Return five numbers of the rod in the upright chart.

    These are the vertical component of the axis k and of its rate, cos(beta), and the components of the heading along
    the axes a, b of the chart. At the vertical the heading is that of the chart.
    """
    cos_b = length(y[Y.k_a], y[Y.k_b])
    k_n = -s * sqrt(max(0.0, 1.0 - cos_b * cos_b))
    c, d = (y[Y.k_a] / cos_b, y[Y.k_b] / cos_b) if cos_b > 0.0 else (1.0, 0.0)
    return k_n, -(y[Y.k_a] * y[Y.dk_a] + y[Y.k_b] * y[Y.dk_b]) / k_n, cos_b, c, d


@compiled
def by_heading(dm, s, y):
    """Return nine numbers by heading of a contact state in either chart.

    These are the dip above level, beta', theta' cos(beta), u_a, u_b, theta, x1, y1 and gamma. In the upright chart
    whole turns of theta about the vertical are not counted.
    """
    if y[Y.chart] == BY_HEADING:
        return y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.u_a], y[Y.u_b], y[Y.theta], y[Y.x], y[Y.y], y[Y.gamma]
    k_n, _, cos_b, c, d = axis(s, y)
    w_b = -(y[Y.dk_a] * c + y[Y.dk_b] * d) / k_n
    w_p = y[Y.dk_a] * d - y[Y.dk_b] * c
    turn = atan2(-d, c)
    sin_0, cos_0 = sincos(y[Y.axes])
    x, y_1 = y[Y.x] * cos_0 - y[Y.y] * sin_0, y[Y.x] * sin_0 + y[Y.y] * cos_0
    theta = y[Y.axes] + turn
    gamma = y[Y.gamma] + s * theta
    dip = atan2(k_n, cos_b) - dm.beta_0
    return dip, w_b, w_p, y[Y.u_a] * c + y[Y.u_b] * d, y[Y.u_b] * c - y[Y.u_a] * d, theta, x, y_1, gamma


@compiled
def change_chart(dm, s, y):
    """Rewrite a contact state in the other chart, in place."""
    dip, w_b, w_p, u_a, u_b, theta, x, y_1, gamma = by_heading(dm, s, y)
    y[Y.u_a], y[Y.u_b] = u_a, u_b
    if y[Y.chart] == UPRIGHT:
        y[Y.dip], y[Y.w_b], y[Y.w_p], y[Y.theta] = dip, w_b, w_p, theta
        y[Y.x], y[Y.y], y[Y.gamma] = x, y_1, gamma
        y[Y.chart] = BY_HEADING
        return
    sin_0, cos_0 = sincos(theta)
    sin_b, cos_b = attitude(dm, dip)
    y[Y.k_a], y[Y.k_b], y[Y.dk_a], y[Y.dk_b] = cos_b, 0.0, -sin_b * w_b, -w_p
    y[Y.x], y[Y.y] = x * cos_0 + y_1 * sin_0, y_1 * cos_0 - x * sin_0
    y[Y.gamma] = gamma - s * theta
    y[Y.chart], y[Y.axes] = UPRIGHT, theta


@compiled
def to_border(dm, y):
    """Return a distance to the border of the chart: positive while the chart describes the contact state well."""
    if y[Y.chart] == BY_HEADING:
        return STEEP - abs(dm.beta_0 + y[Y.dip])
    return LEANS * LEANS - (y[Y.k_a] * y[Y.k_a] + y[Y.k_b] * y[Y.k_b])


@compiled
def same_chart(y, other):
    """Mark the contact state `other` as a state in the chart of y."""
    other[Y.chart], other[Y.axes] = y[Y.chart], y[Y.axes]
