"""Close a chatter: bounces whose remainder lasts too short to matter are summed as a plastic close.

The rest of a chatter, a geometric series of hops, takes t = 2 n / (a (1 - e)). Beside an end that is closed from now
on, a bouncing end lacks at each moment the impulse that goes with its gap rate: n now, none at the end, and on the
average none, since the gap is zero at both ends. So the end is closed now by the (negative) impulse that cancels n,
with the friction of the contact to come. The error is the change of that friction and of the levers in the meantime, of
the order of n (omega t)^2. Beside an end that sticks that friction may set a slow slip going, which would have stopped
within the hops. A close that gains energy, the impact before it included, waits for a fainter hop.

Hops without end (e near 1), of one end or of both in turn, are followed one by one, up to millions in a forcing period.
Each is known to the tolerance, and the errors add up: an end is closed where its rate is no more than a small part of
that sum. Only the hops are left out; the motion about which they hop goes on as a contact phase.
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.contact_mode import CLOSED, contact_mode
from dimersweep.kernel.contact.coordinates import Y, contact_state
from dimersweep.kernel.contact.events import NO_EVENT
from dimersweep.kernel.contact.forces import A1, A2, F1, F2, L1, L2, double_forces, put_forces
from dimersweep.kernel.impact.impact import apply_impulse
from dimersweep.kernel.model import body
from dimersweep.kernel.model.body import attitude, contact_velocity, delassus, end, levers
from dimersweep.kernel.model.friction import single_forces, slip_mu
from dimersweep.kernel.model.layout import D1, D2, DIP, FREE, N1, N2, N_STATE, SPIN, WB, WP
from dimersweep.kernel.model.plate import heaviest
from dimersweep.kernel.model.works import begin_tally, note_struck
from dimersweep.kernel.numerics.elementary import length, raised
from dimersweep.kernel.numerics.steps import copy

CLOSE_COST = 4.0  # error that the close of a chatter may make, in tolerances
# sum of the errors of the events of a period, in tolerances for each event
SPREAD = 0.03
# number of hops of one end over which the other end stays off the plate if it has no part in the rattle
OTHER_OFF_HOPS = 20.0
NOTHING = -1.0  # time of hops where no hops are summed, or may be summed
# separation speed, in g/omega, below which round-off rules the hops; and share of energy that round-off may give
FLOOR = 1e-13


@compiled
def rest_of_chatter(dm, c, state, i, faint, tol):
    """Return the time that the rest of the chatter of end i under the contact force takes [s].

    It is NOTHING if the hops are not to be summed. It is 0.0 if the gap rate n is faint enough to be left out, or is
    ruled by round-off, and for an end that is off the plate.

    While the force changes slowly, hops without loss keep n^3 / force constant: they grow with the force. No hop is
    summed where hops do not end, where the plate could take the force away before, or where the error of the close
    exceeds the tolerance. An impact may hold an end by another friction than a lasting contact does. Then a close lets
    an end slip that hops would have held, or holds an end that would have slipped. That error is of the order of n:
    there only faint hops are closed.
    """
    if c.modes[i] == FREE:
        return 0.0
    p, n = end(dm, i), state[N1 + i]
    lv = levers(p, *attitude(dm, state[DIP]))
    press = c.F[F1 + 3 * i] * delassus(dm, lv, lv).nn
    if n <= FLOOR * dm.v_scale or (press > 0.0 and n * n * n * heaviest(dm) <= faint * faint * faint * press):
        return 0.0
    if p.e >= 1.0 or press <= 0.0 or p.mu_h != p.mu_s:
        return NOTHING
    time = 2.0 * n / (press * (1.0 - p.e))
    turn = dm.tempo * time
    slow = dm.most_jerk * time < 0.5 * press and n * turn * turn <= CLOSE_COST * tol * dm.v_scale
    return time if slow else NOTHING


@compiled
def stays_open(dm, state, j, time):
    """Return True if end j certainly stays off the plate for the time [s]."""
    _, far = body.extent(dm)
    fall = heaviest(dm) + far * (state[WB] * state[WB] + state[WP] * state[WP] + state[SPIN] * state[SPIN])
    return state[D1 + j] + time * (state[N1 + j] - fall * time) >= 0.0


@compiled
def lands_slowly(dm, state, rate):
    """Return True if an end that lands within the next hops of a rattle lands no faster than `rate` [m/s]."""
    most = heaviest(dm)
    for j in range(2):
        fast = state[N1 + j] * state[N1 + j] + 2.0 * most * state[D1 + j] > rate * rate
        if fast and not stays_open(dm, state, j, OTHER_OFF_HOPS * rate / dm.g):
            return False
    return True


@compiled
def open_ends_stay_so(dm, c, state, time):
    """Return True if the ends that are off the plate certainly stay off it for the time [s]."""
    stays = c.modes[0] != FREE or stays_open(dm, state, 0, time)
    return stays and (c.modes[1] != FREE or stays_open(dm, state, 1, time))


@compiled(inline=True)
def slow_ends(state, fast):
    """Return for each end whether it leaves the plate no faster than `fast`; False for both if all rest on it."""
    may_1 = state[D1] == 0.0 and 0.0 <= state[N1] <= fast
    may_2 = state[D2] == 0.0 and 0.0 <= state[N2] <= fast
    moves = (may_1 and state[N1] > 0.0) or (may_2 and state[N2] > 0.0)
    return may_1 and moves, may_2 and moves


@compiled(inline=True)
def faint_rate(dm, state, tol, events):
    """Return the gap rate that may be left out [m/s].

    It is the error that one close may make. If the errors of `events` events add up to more, it is their sum, provided
    that no end lands faster than that.
    """
    faint, spread = CLOSE_COST * tol * dm.v_scale, SPREAD * events * tol * dm.v_scale
    return spread if spread > faint and lands_slowly(dm, state, spread) else faint


@compiled
def come_to_rest(dm, c, state, tol, events, energy):
    """Close the ends whose chatter is as good as over; the state is updated.

    Parameters
    ----------
    c : Contact
        Scratch but for its plate phase and slip; its modes are those of the ends that were closed.
    tol : float
        Accuracy of the close.
    events : float
        Number of events since the forcing period began.
    energy : float
        Kinetic energy before the impact that has led to this state [J].

    Returns
    -------
    float
        Time that the hops which are summed would have taken [s]; below zero if no end was closed.
    """
    modes = c.modes
    # phase that a chatter takes per gap rate, at the least: with e = 0 and the greatest weight
    quickest = 2.0 * dm.tempo / heaviest(dm)
    # no faster end can obey n (omega t)^2 <= CLOSE_COST tol v_scale
    fast = raised(CLOSE_COST * tol * dm.v_scale / (quickest * quickest), 1.0 / 3.0)
    may_1, may_2 = slow_ends(state, fast)
    if not may_1 and not may_2:
        return NOTHING
    faint = faint_rate(dm, state, tol, events)
    for _ in range(4):  # each turn takes an end out of the candidates, or ends
        if not may_1 and not may_2:
            break
        contact_state(dm, state, 0 if may_1 else 1, c.y)
        if contact_mode(dm, c, may_1, may_2, NO_EVENT) != CLOSED:
            drop_round_off(dm, state)
            break
        rest_1, rest_2 = rest_of_chatter(dm, c, state, 0, faint, tol), rest_of_chatter(dm, c, state, 1, faint, tol)
        time, down_1, down_2 = max(rest_1, rest_2), modes[0] != FREE, modes[1] != FREE
        if min(rest_1, rest_2) < 0.0:  # one end is not to be summed: the other one alone
            may_1, may_2 = may_1 and down_1 and rest_1 >= 0.0, may_2 and down_2 and rest_2 >= 0.0
        elif not open_ends_stay_so(dm, c, state, time):
            break
        elif close(dm, c, state, tol, energy):
            drop_round_off(dm, state)
            return time
        elif down_1 and down_2:
            may_1, may_2 = state[N1] < state[N2], state[N2] < state[N1]  # the slower end alone
        else:
            may_1, may_2 = may_1 and not down_1, may_2 and not down_2
    return NOTHING


@compiled
def close(dm, c, state, tol, energy):
    """Close the ends that have a contact mode, if that is allowed; return True if it was.

    It is not allowed if the kinetic energy is then greater than `energy`, that before the impact, by more than the
    tolerance. Nor is it allowed if an open end on the plate then moves into the plate. Rates of round-off are always
    closed. If it is not allowed, the state stays as it was.
    """
    before = c.dy
    copy(state, before, N_STATE)
    if c.modes[0] != FREE and c.modes[1] != FREE:
        close_both(dm, c, state)
    else:
        close_one(dm, c, state, 0 if c.modes[0] != FREE else 1)
    limit = energy + max(tol, FLOOR) * (energy + 0.5 * dm.m * (dm.most_speed * dm.most_speed))
    gains = body.kinetic(dm, state) > limit
    drives = (state[D1] == 0.0 and state[N1] < 0.0) or (state[D2] == 0.0 and state[N2] < 0.0)
    if (not gains and not drives) or max(before[N1], before[N2]) <= FLOOR * dm.v_scale:
        return True
    copy(before, state, N_STATE)
    return False


@compiled
def drop_round_off(dm, state):
    """Set the gap rate of ends that leave the plate at a rate of round-off to 0: a hop at no weight would never end."""
    for i in range(2):
        if state[D1 + i] == 0.0 and 0.0 < state[N1 + i] <= FLOOR * dm.v_scale:
            state[N1 + i] = 0.0


@compiled
def close_one(dm, c, state, i):
    """Cancel the gap rate of end i by an impulse with the friction of its contact mode; write the impulses into c.F."""
    p, (sin_b, cos_b) = end(dm, i), attitude(dm, state[DIP])
    lv, lj = levers(p, sin_b, cos_b), levers(end(dm, 1 - i), sin_b, cos_b)
    wj, u_a, u_b = delassus(dm, lj, lv), c.y[Y.u_a], c.y[Y.u_b]
    mu, w = slip_mu(p, length(u_a, u_b)), delassus(dm, lv, lv)
    P, A, L, _ = single_forces(dm, mu, c.modes[i], w, u_a, u_b, state[N1 + i], 0.0, 0.0)
    apply_impulse(dm, state, lv, P, A, L)
    put_forces(i, P, A, L, 0.0, c.F)
    state[N2 - i] += wj.nn * P + wj.na * A
    state[N1 + i] = 0.0


@compiled
def close_both(dm, c, state):
    """Cancel both gap rates by impulses with the friction of the contact modes; write the impulses into c.F."""
    F = c.F
    double_forces(dm, c.modes, c.y, (state[N1], state[N2], 0.0, 0.0), F)
    p, q = body.level_levers(dm)
    apply_impulse(dm, state, p, F[F1], F[A1], F[L1])
    apply_impulse(dm, state, q, F[F2], F[A2], F[L2])
    state[N1], state[N2] = 0.0, 0.0
    state[DIP], state[WB] = 0.0, 0.0


@compiled
def note_close(dm, before, state, F, work):
    """Note the works of the impulses F of a close in the first of the rows for the works of an impact.

    An impulse that acts at once works with the mean of the velocities before and after it. The axial impulse that two
    closed ends share works half at each.
    """
    n_1, a_1, b_1 = mean_velocity(dm, before, state, 0)
    n_2, a_2, b_2 = mean_velocity(dm, before, state, 1)
    A = F[A1] + F[A2]
    share_1 = 0.5 if F[F1] != 0.0 and F[F2] != 0.0 else (1.0 if F[F1] != 0.0 else 0.0)
    rest = F[F1] * n_1, F[F2] * n_2
    slip = share_1 * A * a_1 + F[L1] * b_1, (1.0 - share_1) * A * a_2 + F[L2] * b_2
    begin_tally(dm, state, work.course[0].tally)
    note_struck(work, 0, 1.0, rest, slip, (F[F1], F[F2], A, F[L1], F[L2]))


@compiled
def mean_velocity(dm, before, state, i):
    """Return the mean of the velocities (gap rate, axial, lateral) of the contact point of end i in two states."""
    n_0, a_0, b_0 = contact_velocity(dm, before, i)
    n, a, b = contact_velocity(dm, state, i)
    return 0.5 * (n_0 + n), 0.5 * (a_0 + a), 0.5 * (b_0 + b)
