"""Sustained contact: forces and rates against the oracle in every mode, the choice of mode, a whole phase."""

from math import cos, hypot, sin

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from dimersweep import names, simulate
from dimersweep.kernel.contact.contact_mode import CLOSED, INCONSISTENT, SEPARATES
from dimersweep.kernel.contact.coordinates import N_CLOSED, N_PATH, N_Y, UPRIGHT, Y
from dimersweep.kernel.contact.events import HOLD_END, JAM, LANDING, LIFT_OFF, NO_EVENT, SLIP_END
from dimersweep.kernel.contact.forces import A1, COMPLIANCE, F1, F2, L1, L2, N_F
from dimersweep.kernel.contact.slip_onset import PAIR_SPEED
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, FREE, N1, N2, SLIP, SPIN, STICK, THETA, WB, WP, X1, Y1
from tests.checks import verbs
from tests.checks.verbs import contact_rates, contact_state, dimer, kernel_state, oracle_state, scratch, sustain_contact
from tests.oracle import body
from tests.oracle.contact import Instant, State, settle

SLIP_TOL = 1e-10
TIME = 0.013  # any plate phase will do
SINGLE = [(STICK, FREE), (SLIP, FREE), (FREE, STICK), (FREE, SLIP)]
DOUBLE = [(STICK, STICK), (STICK, SLIP), (SLIP, STICK), (SLIP, SLIP)]


def at_rest(dm, state, i):
    """The state with the slip of end i removed by moving the whole body, exactly zero for p1."""
    _, a, b = verbs.contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
    state = state.copy()
    state[CA] -= a
    state[CB] -= b
    return state


def closed_state(dm, modes, rng, fast=1.0):
    """A random state that fits the contact modes: gaps, gap rates and held slips are zero."""
    q = np.array([*rng.normal(size=2), 0, rng.uniform(-3, 3), rng.uniform(0.02, 1.2), rng.uniform(-3, 3)])
    qdot = rng.normal(size=6) * [1, 1, 0, 2, 3, 60] * fast
    double = FREE not in modes
    if double:
        q[4] = qdot[4] = 0.0
    state = verbs.state_of(dm, q, qdot)
    if modes[0] == FREE:  # p2 stands on the plate: the dimer leans the other way
        state[[DIP, D1, D2]] = -q[4], dm.l * sin(q[4]), 0
        state[[N1, N2]] = state[N1] - state[N2], 0
        state[WB] = -state[N1] / (dm.l * cos(q[4]))
    for i in (0, 1):
        if modes[i] == STICK:
            state = at_rest(dm, state, i)
    if modes == (STICK, STICK):
        state[WP] = 0.0
        state = at_rest(dm, state, 0)
    return state


def loaded(dm, modes, state):
    """Modes and contact state as arrays."""
    y = np.zeros(N_Y)
    contact_state(dm, state, -1.0 if modes[0] != FREE else 1.0, y)
    if modes[0] == STICK or modes[1] == STICK:
        y[Y.u_a] = 0.0
    if STICK in (modes[0], modes[1]) and (modes[0] == STICK or modes[0] == FREE):
        y[Y.u_b] = 0.0
    return np.array(modes, dtype=float), y


def lateral_levers(dm, state):
    """Lateral velocity of both contact points per theta' cos(beta) and per spin, from the rod's geometry."""
    beta = dm.beta_0 + state[DIP]
    return [(p.r * sin(beta) - p.h, -p.r * cos(beta)) for p in (dm.p1, dm.p2)]


ONE_SLIP = [(modes, False) for modes in ((SLIP, FREE), (FREE, SLIP), (SLIP, STICK), (STICK, SLIP), (SLIP, SLIP))]


@pytest.mark.parametrize(("modes", "both"), [*ONE_SLIP, ((SLIP, SLIP), True)])
def test_a_slip_is_set_by_impulses_of_friction(modes, both):
    """What changes across the axis are momentum and spins by (5), with an impulse at each end that is meant, none elsewhere."""
    dm, rng = dimer(r_1=0.006, r_2=0.004, A_r=6.0), np.random.default_rng(5)
    state = np.zeros(layout.N_STATE)
    state[[CA, CB, WP, SPIN]] = rng.normal(size=4) * [0.1, 1.0, 3.0, 60.0]
    state[DIP] = 0.0 if FREE not in modes else (0.4 if modes[0] != FREE else -0.4)
    levers = lateral_levers(dm, state)
    slips = [lambda at, of=of: at[CB] + of[0] * at[WP] + of[1] * at[SPIN] for of in levers]
    if STICK in modes:
        state[CB] -= slips[modes.index(STICK)](state)
    codes, y = np.array(modes, dtype=float), np.zeros(N_Y)
    contact_state(dm, state, -1.0 if modes[0] != FREE else 1.0, y)
    i, later = modes.index(SLIP), state.copy()
    if both:
        verbs.set_slips(dm, codes, y, y[Y.u_a], 0.7, -0.3)
    else:
        verbs.set_slip(dm, codes, y, i, y[Y.u_a], 0.7)
    kernel_state(dm, codes, y, later)
    change = (later - state)[[CB, WP, SPIN]] * [dm.m, dm.J_t, dm.J_a]
    columns = np.array([[1.0, *of] for of in levers]).T
    impulses, *_ = np.linalg.lstsq(columns, change, rcond=None)
    np.testing.assert_allclose(columns @ impulses, change, atol=1e-14 * np.abs(change).max())
    assert slips[i](later) == pytest.approx(0.7, rel=1e-13)
    if both:
        assert slips[1 - i](later) == pytest.approx(-0.3, rel=1e-13)
    elif STICK in modes:
        assert slips[1 - i](later) == pytest.approx(0.0, abs=1e-14)
    else:
        assert impulses[1 - i] == pytest.approx(0.0, abs=1e-13 * abs(impulses[i]))
    assert later[CA] == pytest.approx(state[CA], rel=1e-13)


def heading_frame(q):
    """Columns n, a, b in terms of the oracle's normal, x, y."""
    along = body.axial_direction(q)
    frame = np.zeros((3, 3))
    frame[0, 0], frame[1:, 1], frame[1:, 2] = 1, along, [along[1], -along[0]]
    return frame


@pytest.mark.parametrize("modes", SINGLE + DOUBLE)
@pytest.mark.parametrize("seed", range(8))
def test_forces_and_rates_are_those_of_the_oracle(modes, seed):
    params = {"A_r": 4.7, "mu_1": 0.3, "mu_2": 0.18, "mu_s_1": 0.5, "mu_s_2": 0.6, "Gamma": 0.8, "phi0": 0.4}
    dm, d = dimer(**params), body.dimer(params)
    state = closed_state(dm, modes, np.random.default_rng(seed))
    codes, y = loaded(dm, modes, state)
    dy, F = np.zeros(N_Y), np.zeros(N_F)
    contact_rates(dm, codes, dm.omega * TIME + dm.phi0, y, dy, F)

    q, qdot = oracle_state(dm, state)
    active = tuple(i for i in (0, 1) if modes[i] != FREE)
    held = tuple(i for i in (0, 1) if modes[i] == STICK)
    now = Instant(d, TIME, q, qdot)
    forces, acc = now.forces(State(active, held))
    qddot = now.qddot(State(active, held))
    frame = heading_frame(q)
    expected = forces @ frame  # rows: ends; columns n, a, b
    got = F[:COMPLIANCE].reshape(2, 3)
    weight = dm.m * dm.g
    np.testing.assert_allclose(got[:, [0, 2]], expected[:, [0, 2]], atol=1e-11 * weight)
    assert got[:, 1].sum() == pytest.approx(expected[:, 1].sum(), abs=1e-11 * weight)

    turn, cos_b, sin_b = qdot[3], cos(q[4]), sin(q[4])
    leading = active[0]
    slip, slip_rate = body.slips(d, q, qdot)[leading] @ frame[1:, 1:], acc[leading] @ frame
    rates = {
        Y.dip: qdot[4],
        Y.w_b: qddot[4],
        Y.w_p: qddot[3] * cos_b - turn * sin_b * qdot[4],
        3: qddot[5] + qddot[3] * sin_b + turn * cos_b * qdot[4],
        Y.u_a: slip_rate[1] - turn * slip[1],
        Y.u_b: slip_rate[2] + turn * slip[0],
        Y.theta: turn,
        Y.time: 1.0,
        Y.x: qdot[0],
        Y.x + 1: qdot[1],
        10: qdot[5],
    }
    size = max(1.0, np.abs(qddot).max())
    np.testing.assert_allclose(dy[list(rates)], list(rates.values()), rtol=1e-10, atol=1e-11 * size)


@pytest.mark.parametrize("modes", SINGLE + DOUBLE)
def test_contact_states_survive_the_way_there_and_back(modes):
    dm = dimer()
    state = closed_state(dm, modes, np.random.default_rng(1))
    codes, y = loaded(dm, modes, state)
    back = np.zeros(16)
    kernel_state(dm, codes, y, back)
    np.testing.assert_allclose(back, state, atol=1e-14)
    for i in (0, 1):
        if modes[i] != FREE:
            assert back[D1 + i] == back[N1 + i] == 0


def chosen(dm, state, closed, time=TIME, event=NO_EVENT):
    """The contact mode that the kernel chooses: answer, modes, contact state, its rates and forces."""
    modes, y, dy, F = np.zeros(2), np.zeros(N_Y), np.zeros(N_Y), np.zeros(N_F)
    contact_state(dm, state, -1.0 if closed[0] else 1.0, y)
    answer = verbs.contact_mode(dm, *closed, dm.omega * time + dm.phi0, y, modes, SLIP_TOL, event, dy, F)
    if answer == CLOSED:
        contact_rates(dm, modes, dm.omega * time + dm.phi0, y, dy, F)
    return answer, tuple(int(mode) for mode in modes), y, dy, F


def expected_modes(params, dm, state, closed):
    """The modes that the oracle chooses."""
    q, qdot = oracle_state(dm, state)
    resting = [i for i in (0, 1) if closed[i]]
    slips = body.slips(body.dimer(params), q, qdot)
    zero = [i for i in resting if hypot(*slips[i]) <= SLIP_TOL]
    found = settle(body.dimer(params), TIME, q, qdot, resting, zero, {}, False)
    return tuple(FREE if i not in found.active else STICK if i in found.stick else SLIP for i in (0, 1))


@pytest.mark.parametrize("modes", SINGLE + DOUBLE)
@pytest.mark.parametrize("seed", range(12))
def test_choice_of_the_mode_is_the_oracles(modes, seed):
    rng = np.random.default_rng([3, seed])
    mu = rng.uniform(0.02, 0.4)
    params = {"A_r": rng.uniform(3, 8), "Gamma": rng.choice([0.5, 1.3]), "f": 20.0}
    params |= {"mu_1": mu, "mu_2": 0.6 * mu, "mu_s_1": mu * 1.4, "mu_s_2": mu * 0.8}
    dm = dimer(**params)
    state = closed_state(dm, modes, rng, rng.choice([0.1, 1, 3]))
    closed = tuple(mode != FREE for mode in modes)
    answer, found, y, dy, F = chosen(dm, state, closed)
    assert found == expected_modes(params, dm, state, closed)
    assert answer == (CLOSED if any(found) else SEPARATES)
    if answer == CLOSED:
        assert all(F[F1 + 3 * i] > 0 for i in (0, 1) if found[i] != FREE)
        complementary(dm, found, closed, y, dy)
        slip_starts_outward(dm, found, modes, y, dy)


def complementary(dm, found, closed, y, dy):
    """An end that was closed and is let go is not drawn into the plate."""
    for i in (0, 1):
        if closed[i] and found[i] == FREE:
            sign = 1 if i == 1 else -1
            assert sign * (dy[Y.w_b] * cos(y[Y.dip]) - sin(y[Y.dip]) * y[Y.w_b] ** 2) > 0


def slip_starts_outward(dm, found, modes, y, dy):
    """Slip out of rest is small, and speeds up along itself: only a single contact has one direction for it."""
    for i in (0, 1):
        if modes[i] == STICK and found[i] == SLIP:
            shift = dm.l * np.array([y[Y.w_p], dy[Y.w_p]]) * (i == 1 and found[0] != FREE)
            slip, rate = np.array([y[Y.u_a], y[Y.u_b] - shift[0]]), np.array([dy[Y.u_a], dy[Y.u_b] - shift[1]])
            assert 0 < hypot(*slip) <= SLIP_TOL * (PAIR_SPEED if modes == (STICK, STICK) else 1)
            assert slip @ rate > 0
            if FREE in found:
                assert abs(slip[0] * rate[1] - slip[1] * rate[0]) < 1e-6 * (slip @ rate)


@pytest.mark.parametrize("modes", SINGLE)
def test_with_large_friction_a_law_fits_every_end_at_rest(modes):
    """It leaves only where nothing drives it into the plate; none fits a slip alone, whose friction drives it in the more."""
    rng, answers = np.random.default_rng(8), {CLOSED: 0, SEPARATES: 0, INCONSISTENT: 0}
    i = 0 if modes[0] != FREE else 1
    for _ in range(300):
        mu = rng.uniform(1, 5)
        params = {
            "A_r": rng.uniform(2, 5),
            "mu": mu,
            "mu_s": mu * rng.uniform(1, 1.5),
            "Gamma": rng.uniform(0, 2),
            "f": 20.0,
        }
        dm, d = dimer(**params), body.dimer(params)
        state = closed_state(dm, modes, rng, rng.choice([0.1, 1]))
        answer, found, *_ = chosen(dm, state, (i == 0, i == 1))
        answers[answer] += 1
        now = Instant(d, TIME, *oracle_state(dm, state))
        _, free = now.forces(State((), ()))
        if answer == SEPARATES:
            assert free[i][0] > 0.0
        elif answer == CLOSED:
            assert now.forces(State((i,), (i,) if found[i] == STICK else ()))[0][i][0] > 0.0 or modes[i] == STICK
        else:
            assert modes[i] == SLIP
            assert free[i][0] < 0.0
            assert now.forces(State((i,), ()))[0][i][0] < 0.0
    assert (answers[INCONSISTENT] > 0) == (modes[i] == SLIP)
    assert min(answers[CLOSED], answers[SEPARATES]) > 30


@pytest.mark.parametrize(("i", "beta"), [(0, 0.3), (1, -0.3), (0, 0.9), (1, -0.05)])
def test_an_end_at_rest_holds_up_to_its_limit(i, beta):
    modes = (STICK, FREE) if i == 0 else (FREE, STICK)
    rough = dimer(mu=0.0, mu_s=10.0)
    state = closed_state(rough, modes, np.random.default_rng(4), 0.0)
    state[DIP] = beta
    state[[D1, D2]] = max(0.0, -rough.l * sin(beta)), max(0.0, rough.l * sin(beta))
    closed = i == 0, i == 1
    _, _, _, _, F = chosen(rough, state, closed)
    ratio = hypot(F[A1 + 3 * i], F[L1 + 3 * i]) / F[F1 + 3 * i]
    assert ratio > 0.01
    for factor, mode in ((1 + 1e-8, STICK), (1 - 1e-8, SLIP)):
        answer, found, *_ = chosen(dimer(mu=0.9 * ratio, mu_s=ratio * factor), state, closed)
        assert (answer, found[i], found[1 - i]) == (CLOSED, mode, FREE)


@pytest.mark.parametrize("k", range(-4, 5))
def test_a_hold_just_lost_turns_into_slip_when_both_coefficients_agree(k):
    """With mu = mu_s the acceleration out of rest is zero at the limit, and of either sign once it is rounded."""
    rough = dimer(mu=0.0, mu_s=10.0)
    state = closed_state(rough, (STICK, FREE), np.random.default_rng(4))
    _, _, _, _, F = chosen(rough, state, (True, False))
    mu = hypot(F[A1], F[L1]) / F[F1] * (1 + k * 1e-15)
    answer, found, *_ = chosen(dimer(mu=mu, mu_s=mu), state, (True, False), event=HOLD_END)
    assert (answer, found) == (CLOSED, (SLIP, FREE))


@pytest.mark.parametrize("lateral", [0.3, 0.99, 1.01])
def test_two_ends_at_rest_share_the_axial_force_only(lateral):
    """Both stick if and only if |A| <= sqrt((mu_s f_1)^2 - L_1^2) + sqrt((mu_s f_2)^2 - L_2^2), both roots real."""
    dm = dimer(mu=0.05)
    for p in (dm.p1, dm.p2):
        p.mu_s = p.mu_h = 0.1
    codes = np.array([STICK, STICK], dtype=float)
    F = np.array([1.0, 0.0, 0.1 * lateral, 2.0, 0.0, 0.1 * lateral])
    room = np.sqrt(0.01 * np.array([1, 4]) - (0.1 * lateral) ** 2) if lateral < 1 else None
    for part in (0.0, 0.999, 1.001):
        if room is None:
            assert verbs.hold_reserve(dm, codes, 0, F) < 0
        else:
            F[A1] = -part * room.sum()
            left = min((1 - part) * room.sum(), 0.1 * 1.0 - 0.1 * lateral)  # along the axis; of p1 to the side
            assert verbs.hold_reserve(dm, codes, 0, F) == pytest.approx(left, abs=1e-14)


SHAKEN = {"Gamma": 0.3, "Gamma_x": 0.2, "Gamma_y": 0.15, "phi_y": 0.6}


def held_pair(seed, rougher=1.0):
    """A scene with both ends held, its state, the forces, and the friction at which these are the limit.

    That of p2 is `rougher` times as much as that of p1.
    """
    rng = np.random.default_rng(seed)
    scene = SHAKEN | {"rho_b_2": rng.uniform(4000, 7000), "theta0": rng.uniform(0, 6)}
    rough = dimer(mu=0.0, mu_s=10.0, **scene)
    state = closed_state(rough, (STICK, STICK), rng, 0.3)
    _, _, _, _, F = chosen(rough, state, (True, True))

    def reserve(mu):
        return verbs.hold_left_of_pair(mu, F[F1], F[L1], rougher * mu, F[F2], F[L2], F[A1])

    return scene, state, F, brentq(reserve, 1e-3, 10.0, xtol=1e-16, rtol=1e-15)


@pytest.mark.parametrize(
    ("seed", "rougher"), [*((seed, 1.0) for seed in range(6)), *((seed, 1.2) for seed in (0, 1, 5))]
)
def test_two_ends_at_their_limits_set_out_against_what_held_them(seed, rougher):
    """With mu = mu_s the friction of the slip is then the one that held, so that no slip has an acceleration yet."""
    scene, state, F, mu = held_pair(seed, rougher)
    assert min(abs(F[L1]), abs(F[L2]), abs(F[A1])) > 1e-2 * mu * (F[F1] + F[F2])
    dm = dimer(mu_1=mu, mu_s_1=mu, mu_2=rougher * mu, mu_s_2=rougher * mu, **scene)
    answer, found, _, dy, slipping = chosen(dm, state, (True, True), event=HOLD_END)
    assert (answer, found) == (CLOSED, (SLIP, SLIP))
    assert slipping[A1] == pytest.approx(F[A1], rel=1e-6)
    assert slipping[[L1, L2]] == pytest.approx(F[[L1, L2]], rel=1e-6)
    assert np.abs(dy[[Y.u_a, Y.u_b, Y.w_p]] * [1, 1, dm.l]).max() < 1e-6 * dm.g


@pytest.mark.parametrize("k", range(-3, 4))
@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_the_end_whose_lateral_hold_ends_slips_alone(seed, end, k):
    """The moment of the loss is known to rounding: a last rest of the lateral hold changes nothing."""
    scene, state, F, _ = held_pair(seed)
    limit = [10.0, 10.0]
    limit[end] = abs(F[[L1, L2]][end]) / F[[F1, F2]][end] * (1 + k * 1e-15)
    dm = dimer(mu=0.0, **scene)
    dm.p1.mu_h, dm.p2.mu_h = limit
    answer, found, y, *_ = chosen(dm, state, (True, True), event=HOLD_END)
    assert (answer, found) == (CLOSED, (SLIP, STICK) if end == 0 else (STICK, SLIP))
    slip = slip_at_contact(dm, y, end)
    assert slip[0] == 0.0 and slip[1] * F[[L1, L2]][end] < 0.0


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("seed", range(6))
def test_an_end_that_is_held_no_more_beside_one_that_slips_sets_out_with_it(seed, end):
    """Friction falls from mu_s to mu where an end slips: the other one has to hold the rest, and cannot."""
    scene, state, F, _ = held_pair(seed)
    needed = np.abs(F[[L1, L2]]) / F[[F1, F2]]
    dm = dimer(mu=0.2 * needed.min(), **scene)
    limit = np.full(2, 10.0)
    limit[end] = 0.999 * needed[end]
    dm.p1.mu_h, dm.p2.mu_h = limit
    _, found, _, _, F = chosen(dm, state, (True, True))
    assert found == ((SLIP, STICK) if end == 0 else (STICK, SLIP))
    limit[1 - end] = 0.99 * hypot(F[A1], F[L2 if end == 0 else L1]) / F[F2 if end == 0 else F1]
    dm.p1.mu_h, dm.p2.mu_h = limit
    answer, found, y, dy, _ = chosen(dm, state, (True, True))
    assert (answer, found) == (CLOSED, (SLIP, SLIP))
    for i in range(2):
        u, v = slip_at_contact(dm, y, i), slip_at_contact(dm, dy, i)
        assert u @ v == pytest.approx(np.linalg.norm(u) * np.linalg.norm(v), rel=1e-6)


@pytest.mark.parametrize("share", [0.99, 0.5])
@pytest.mark.parametrize("seed", range(6))
def test_two_ends_beyond_their_limits_set_out_in_the_direction_of_their_rates(seed, share):
    """Slips that grow from nothing keep their directions: those of their rates, under the friction of these directions."""
    scene, state, F, limit = held_pair(seed)
    least = max(abs(F[L1]) / F[F1], abs(F[L2]) / F[F2])  # below it an end slips to the side alone
    mu = least + share * (limit - least)
    dm = dimer(mu=mu, mu_s=mu, **scene)
    answer, found, y, dy, _ = chosen(dm, state, (True, True))
    assert (answer, found) == (CLOSED, (SLIP, SLIP))
    for i in range(2):
        u, v = slip_at_contact(dm, y, i), slip_at_contact(dm, dy, i)
        assert u @ v > 0.0
        rounding = 1e-15 / np.linalg.norm(u)  # of a slip that is a difference of velocities
        assert abs(u[0] * v[1] - u[1] * v[0]) < (1e-4 + rounding) * np.linalg.norm(u) * np.linalg.norm(v)


def slip_at_contact(dm, y, i):
    """Slip of end i, or its rate, of a contact state with both ends down and p1 leading."""
    apart = dm.l * dm.cos_0 * (dm.cos_0 * y[Y.w_p] + dm.sin_0 * y[Y.spin])
    return np.array([y[Y.u_a], y[Y.u_b] - (apart if i else 0.0)])


def test_a_plate_that_falls_away_is_left():
    dm = dimer(Gamma=1.5, phi0=np.pi / 2)
    for modes in (STICK, FREE), (FREE, STICK), (STICK, STICK):
        state = closed_state(dm, modes, np.random.default_rng(0), 0.0)
        answer, found, *_ = chosen(dm, state, tuple(mode != FREE for mode in modes), 0.0)
        assert (answer, found) == (SEPARATES, (FREE, FREE))


def test_a_configuration_without_a_force_is_reported():
    """Painleve: steep and rough, sliding so that friction presses the end down faster than it can give way."""
    dm = dimer(mu=3.0, A_r=9)
    state = np.zeros(16)
    state[[DIP, CA]] = 0.9, -1.0
    state[D2] = dm.l * sin(0.9)
    answers = set()
    for speed in (-1.0, 1.0):
        state[CA] = speed
        answers.add(chosen(dm, state, (True, False))[0])
    assert INCONSISTENT in answers


def test_two_ends_that_rub_hard_stay_down_only_where_that_is_stable():
    """At a negative compliance both forces may point outward (here they are equal), and the force at one end alone, too."""
    dm = dimer(mu=5.0, mu_s=5.0, A_r=2.0)
    rng = np.random.default_rng(3)
    codes, state, F = np.array([SLIP, SLIP], dtype=float), np.zeros(16), np.zeros((2, N_F))
    seen = 0
    for _ in range(200):
        y, dy = np.zeros(N_Y), np.zeros(N_Y)
        y[[Y.u_a, Y.u_b, Y.w_p]] = rng.normal(size=3) * [1e-3, 1e-3, 1e-3 / dm.p2.h]
        for spin in (0, 1):
            y[Y.spin] = spin
            contact_rates(dm, codes, dm.omega * TIME, y, dy, F[spin])
        apart = F[:, F2] - F[:, F1]
        y[Y.spin] = apart[0] / (apart[0] - apart[1])
        kernel_state(dm, codes, y, state)
        answer, modes, y, dy, force = chosen(dm, state, (True, True))
        if F[0, COMPLIANCE] > 0:
            assert (answer, modes) == (CLOSED, (SLIP, SLIP))
            continue
        seen += 1
        assert answer == CLOSED
        assert FREE in modes
        assert force[COMPLIANCE] > 0
        assert max(force[F1], force[F2]) > 0
        assert (1 if modes[1] == FREE else -1) * dy[Y.w_b] > 0  # the other end is driven off
    assert seen > 20


def compliance(d, t, q, qdot, i):
    """Normal acceleration of end i per normal force and the friction that goes with it, less that of the oracle's bodies."""
    now = Instant(d, t, q, qdot)
    unit = np.array([1.0, *-d.mu[i] * now.slip[i] / np.hypot(*now.slip[i])])
    return now.G[i, 0, i] @ unit / now.G[i, 0, i, 0]


@pytest.mark.parametrize(
    "start",
    [
        (1.197, 0.004, -0.233, -0.219, -3.738),
        (0.398, -0.131, 0.109, -0.051, -0.849),
        (0.882, -0.063, -0.038, -1.091, -3.833),
    ],
)
def test_a_jam_is_where_the_oracles_compliance_vanishes(start):
    """A slip that turns to where its force is infinite, against the oracle in coordinates fixed in space.

    The clock dt = ds / (1 + F / m g) passes smoothly through the infinite force.
    """
    params = {"mu": 2.6, "mu_s": 3.4, "A_r": 3.2, "Gamma": 0.0}
    dm, d = dimer(**params), body.dimer(params)
    state = np.zeros(16)
    state[[DIP, CA, CB, WB, WP]] = start
    state[D2], state[N2] = dm.l * sin(state[DIP]), dm.l * cos(state[DIP]) * state[WB]
    codes, y = loaded(dm, (SLIP, FREE), state)
    q, qdot = oracle_state(dm, state)

    def rates(s, z):
        now, mode = Instant(d, z[12], z[:6], z[6:12]), State((0,), ())
        force = now.forces(mode)[0][0, 0]
        return np.array([*z[6:12], *now.qddot(mode), 1.0]) / (1.0 + force / (dm.m * dm.g))

    def jam(s, z):
        return compliance(d, z[12], z[:6], z[6:12], 0)

    jam.terminal = True
    expected = solve_ivp(rates, (0, 0.05), [*q, *qdot, 0.0], events=jam, method="DOP853", rtol=1e-11, atol=1e-13)
    assert expected.status == 1
    t, event = sustain_contact(dm, codes, y, 0.0, dm.period, 1e-10, 1e-11, scratch()[0])
    assert event == JAM
    assert t == pytest.approx(expected.y[12, -1], rel=1e-8)
    kernel_state(dm, codes, y, state)
    np.testing.assert_allclose(np.concatenate(oracle_state(dm, state)), expected.y[:12, -1], rtol=1e-8, atol=1e-8)


def reference_phase(dm, modes, y, phase, span):
    """A contact phase by a plain integration."""

    def rates(t, z):
        dy = np.zeros(N_Y)
        contact_rates(dm, modes, phase + dm.omega * t, z.copy(), dy, np.zeros(N_F))
        return dy

    return solve_ivp(rates, (0, span), y, method="LSODA", rtol=1e-12, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("modes", [*SINGLE, (SLIP, SLIP)])
@pytest.mark.parametrize("tol", [1e-6, 1e-9])
def test_a_phase_against_a_plain_integration(modes, tol):
    dm = dimer(mu=0.1, mu_s=3.0, Gamma=0.3)
    state = closed_state(dm, modes, np.random.default_rng(2), 0.5)
    if modes == (SLIP, SLIP):
        state[CA] += 1.0
    codes, y = loaded(dm, modes, state)
    start, span = y.copy(), 0.004
    t, event = sustain_contact(dm, codes, y, 0.3, span, tol, 1e-12, scratch()[0])
    assert (t, event) == (span, NO_EVENT)
    expected = reference_phase(dm, codes, start, 0.3, span)[:N_PATH]
    expected[Y.time] = y[Y.time]
    scale = np.array([1, dm.w_scale, dm.w_scale, 10 * dm.w_scale, dm.v_scale, dm.v_scale, 1, 1, dm.p1.r, dm.p1.r, 10])
    assert (np.abs(y[:N_PATH] - expected) / scale).max() < 20 * tol


def test_events_of_a_phase_are_where_their_functions_vanish():
    """The other end lands, the slip stops, the hold is lost, the end lifts off: each in a phase made for it."""
    seen = {
        LANDING: ({"Gamma": 0.2}, (STICK, FREE), {DIP: 0.05, CA: 0.0}),
        SLIP_END: ({"mu": 0.5, "mu_s": 0.9, "Gamma": 0.0}, (SLIP, SLIP), {CA: 0.05}),
        HOLD_END: ({"mu_s": 0.195, "mu": 0.1, "Gamma": 0.0}, (STICK, FREE), {DIP: 1.2}),
        LIFT_OFF: ({"Gamma": 1.5, "mu": 0.5}, (STICK, STICK), {}),
    }
    for event, (params, modes, start) in seen.items():
        dm = dimer(**params)
        state = np.zeros(16)
        for slot, value in start.items():
            state[slot] = value
        state[D2] = dm.l * sin(state[DIP])
        state[N2] = dm.l * cos(state[DIP]) * state[WB]
        if modes == (STICK, FREE):
            state = at_rest(dm, state, 0)
        codes, y = loaded(dm, modes, state)
        t, found = sustain_contact(dm, codes, y, 0.0, dm.period, 1e-10, 1e-11, scratch()[0])
        assert found - found % 2 == event, (event, found)
        assert 0 < t < dm.period
        dy, F = np.zeros(N_Y), np.zeros(N_F)
        contact_rates(dm, codes, dm.omega * t, y, dy, F)
        value = {
            LANDING: y[Y.dip],
            SLIP_END: hypot(y[Y.u_a], y[Y.u_b]),
            HOLD_END: verbs.hold_reserve(dm, codes, 0, F) / (dm.m * dm.g),
            LIFT_OFF: min(F[F1], F[F2]) / (dm.m * dm.g),
        }[event]
        assert value == pytest.approx(0, abs=1e-12)
    assert sin(dm.omega * t) == pytest.approx(1 / 1.5, rel=1e-12)  # both lift where the effective gravity vanishes
    assert not state[[CB, WP, SPIN]].any()


@pytest.mark.parametrize("modes", [*SINGLE, (SLIP, SLIP)])
def test_whether_the_path_is_wanted_does_not_change_the_motion(modes):
    dm = dimer(mu=0.1, mu_s=3.0, Gamma=0.3)
    state = closed_state(dm, modes, np.random.default_rng(2), 0.5)
    codes, y = loaded(dm, modes, state)
    other = y.copy()
    told = sustain_contact(dm, codes, y, 0.3, 0.02, 1e-6, 1e-9, scratch()[0])
    assert told == sustain_contact(dm, codes, other, 0.3, 0.02, 1e-6, 1e-9, scratch()[0], False)
    assert (y[:N_CLOSED] == other[:N_CLOSED]).all()
    assert (y[Y.x : Y.x + 2] != other[Y.x : Y.x + 2]).all()


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("modes", [(SLIP, FREE), (STICK, STICK), (SLIP, SLIP)])
def test_a_brief_pull_within_a_step_is_found(tol, modes):
    """The plate falls faster than the dimer for a thousandth of a period, or almost as fast; one that tips is light before."""
    for Gamma in (1.0 + 1e-5, 1.0 - 1e-4):
        dm = dimer(Gamma=Gamma, mu=1e-9, mu_s=3.0)
        state = np.zeros(16)
        state[CB] = 1.0 if SLIP in modes else 0.0
        if FREE in modes:
            state[[DIP, D2]] = 0.3, dm.l * sin(0.3)
        codes, y = loaded(dm, modes, state)
        phase = 0.5 * np.pi - 0.6
        t, event = sustain_contact(dm, codes, y, phase, 1.2 / dm.omega, tol, 0.1 * tol * dm.v_scale, scratch()[0])
        if Gamma > 1:
            assert event in (LIFT_OFF, LIFT_OFF + 1)
            assert sin(phase + dm.omega * t) == pytest.approx(1 / Gamma, abs=max(tol, 1e-5))
        else:
            assert event == NO_EVENT


@pytest.mark.parametrize("tol", [1e-4, 1e-7, 1e-10])
def test_slip_beside_an_end_that_sticks_comes_to_rest_on_a_line(tol):
    """p1 is the pivot, p2 slips around it: the time is right to what the tolerance says of the speed."""
    dm = dimer(mu=0.2, mu_s=3.0, Gamma=0.5)
    state, times = np.zeros(16), []
    state[WP] = 0.05 / (dm.l)
    state = at_rest(dm, state, 0)
    for accuracy in (tol, 1e-13):
        codes, y = loaded(dm, (STICK, SLIP), state)
        t, event = sustain_contact(dm, codes, y, 0.0, dm.period, accuracy, 0.1 * accuracy * dm.v_scale, scratch()[0])
        assert event == SLIP_END + 1
        assert y[Y.w_p] == y[Y.u_b] == 0.0
        times.append(t)
    assert times[0] == pytest.approx(times[1], abs=tol * dm.v_scale / (dm.p1.mu * dm.g))


@pytest.mark.jit
def test_a_hold_that_is_lost_and_regained_before_a_landing_is_not_missed():
    """The step that ends with the landing of the other end is as long as both together at this accuracy."""
    scene = {"e": 0.368, "Gamma": 0.959, "f": 15.75, "A_r": 7.99, "mu": 0.392, "mu_s": 0.448, "beta0": 0.3083}
    for rtol in (5e-8, 7e-8, 1e-7, 1.3e-7):
        events = names(simulate(**scene, xdot0=1.786, periods=4, rtol=rtol).events)
        periods, cause = events["time"].values * scene["f"], events["cause"].values
        assert periods[cause == "slip"] == pytest.approx([3.21717], abs=1e-4)
        assert periods[cause == "stick"][1] == pytest.approx(3.32370, abs=1e-4)


# --- a steep rod: in the upright chart its rates are those by the heading, where both describe it --------------------------


UNLIKE = {"r_1": 5e-3, "r_2": 6e-3, "mu_1": 0.3, "mu_2": 0.2, "mu_s_1": 0.5, "mu_s_2": 0.5}
ALONG = {"tilt": 0.1, "azimuth": 0.8, "Gamma_x": 0.2, "phi_x": 0.3, "Gamma_y": 0.4, "phi_y": 2.0}
MOVING = [DIP, WB, WP, SPIN, CA, CB, THETA, X1, Y1, layout.GAMMA]


def steep(dm, i, mode, seed):
    """A state of a rod that stands on end i, beyond the border of the charts."""
    rng, state = np.random.default_rng(seed), np.zeros(layout.N_STATE)
    state[DIP] = (1.49 if i == 0 else -1.49) - dm.beta_0
    state[[WB, WP, SPIN, CA, CB]] = rng.normal(size=5) * [2.0, 0.3, 60.0, 0.3, 0.3]
    state[[THETA, X1, Y1, layout.GAMMA]] = rng.uniform(-1, 1, 4)
    if mode == STICK:
        _, a, b = verbs.contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
        state[CA], state[CB] = state[CA] - a, state[CB] - b
    return state


def by_heading(dm, i, state):
    """The contact state in the chart by heading, which `contact_state` leaves there."""
    y = np.zeros(N_Y)
    _, a, b = verbs.contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
    y[: Y.u_a + 2] = *state[[DIP, WB, WP, SPIN]], a, b
    y[[Y.x - 2, Y.x, Y.y, Y.gamma]] = state[[THETA, X1, Y1, layout.GAMMA]]
    return y


def change_of(dm, modes, y, step):
    """Rate of the kernel state where a contact state goes on at its rates, and the size of the forces."""
    dy, F, ends = np.zeros(N_Y), np.zeros(N_F), np.zeros((2, layout.N_STATE))
    contact_rates(dm, modes, 0.7, y, dy, F)
    for end, by in zip(ends, (step, -step), strict=True):
        kernel_state(dm, modes, y + by * dy, end)
    forces = F[:COMPLIANCE].reshape(2, 3)
    return ((ends[0] - ends[1]) / (2 * step))[MOVING], forces[:, 0], np.hypot(forces[:, 1], forces[:, 2]), F[COMPLIANCE]


@pytest.mark.parametrize("mode", [STICK, SLIP])
@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_both_charts_give_a_rod_the_same_rates_and_forces(seed, i, mode):
    dm = dimer(**UNLIKE, **ALONG)
    modes = np.full(2, float(FREE))
    modes[i] = mode
    state = steep(dm, i, mode, seed)
    heading, upright = by_heading(dm, i, state), np.zeros(N_Y)
    contact_state(dm, state, -1.0 if i == 0 else 1.0, upright)
    assert upright[Y.chart] == UPRIGHT != heading[Y.chart]
    expected, found = (change_of(dm, modes, y, 1e-6) for y in (heading, upright))
    for one, other in zip(expected, found, strict=True):
        scale = np.abs(one).max()
        np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-7 * scale)
    assert Y.dip < Y.time < Y.x
