"""Impacts at both ends: three balls in a row, the oracle, mirrored pairs, the limit of stick, energy."""

from itertools import product
from math import hypot

import numpy as np
import pytest

from dimersweep.kernel.model.contact_code import digits_of
from dimersweep.kernel.model.event_row import E_KIND, E_N1_AFTER, E_P1, E_P2
from dimersweep.kernel.model.layout import CA, CB, FREE, IMPACT, N1, N2, N_STATE, OK, SLIP, SPIN, STICK, WB, WP
from tests import oracle
from tests.checks import verbs
from tests.checks.examine import kinetic
from tests.checks.impacts import STORED, end_names, rates_apart, works_apart
from tests.checks.verbs import angular_momentum, contact_velocity, dimer, oracle_state, scratch, set_pair, state_of

DOUBLE = [case for case in STORED if all(case["closed"])]


def struck(dm, state, tol=1e-10, works=False):
    """After an impact of both ends: the state, the friction modes, the scratch, and the log of the phases."""
    (work, log), state, modes = scratch(), state.copy(), np.zeros(2)
    work.course[0].tally.wanted = works
    status, rows = verbs.collide_double(dm, state, -float(min(state[N1], state[N2])), tol, modes, work, log)
    assert status == OK
    return state, tuple(int(mode) for mode in modes), work, log[:rows]


def strike(dm, state, tol=1e-10):
    """The same without the scratch."""
    state, modes, _, log = struck(dm, state, tol)
    return state, modes, log


def assert_as_the_oracle_says(dm, params, before, tol, most):
    """Velocities and works; that works are wanted changes no bit."""
    after, _, work, log = struck(dm, before, tol, works=True)
    np.testing.assert_array_equal(after, strike(dm, before, tol)[0])
    expected, told = oracle.impact(params, *oracle_state(dm, before), tol=min(tol, 1e-11))
    V = min(before[N1], before[N2])
    assert rates_apart(dm, after, expected, -V) < most
    assert works_apart(dm, work, len(log), told, V) < most


def flat(dm, n_1=0.0, n_2=0.0, a=0.0, b_1=0.0, b_2=0.0, spin=0.0):
    """State of a flat dimer with given contact velocities and axial spin."""
    state = np.zeros(N_STATE)
    state[N1], state[N2], state[SPIN] = n_1, n_2, spin
    state[WB], state[WP] = (n_2 - n_1) / (dm.l), (b_1 - b_2) / (dm.l)
    state[CA] = a - dm.p1.r * state[WB]
    state[CB] = 0.5 * (b_1 + b_2) + dm.p1.r * spin
    return state


def velocities(dm, state):
    """Gap rates, axial and lateral slips of a flat dimer, and its spin's speed at the ball's surface."""
    n_1, a_1, b_1 = contact_velocity(dm, state, -1.0)
    n_2, a_2, b_2 = contact_velocity(dm, state, 1.0)
    np.testing.assert_allclose(a_1, a_2, atol=1e-15 + 1e-14 * abs(a_1))
    return np.array([n_1, n_2, a_1, b_1, b_2, dm.p1.r * state[SPIN]])


def random_flat(dm, rng, k):
    """A state before an impact: k turns through landings on either end, rolling, sticking and planar ones."""
    n = [-abs(rng.normal()), rng.normal()]
    if k % 3 == 0:
        n[1] = 0.0
    if k % 2:
        n.reverse()
    a, b_1, b_2, spin = rng.normal(size=4) * [1, 1, 1, 100]
    if k % 5 == 1:
        a, b_1 = 0.0, 0.0  # p1 rolls
    elif k % 5 == 2:
        a, b_2 = 0.0, 0.0
    elif k % 5 == 3:
        a, b_1, b_2 = 0.0, 0.0, 0.0
    elif k % 5 == 4:
        b_1, b_2, spin = 0.0, 0.0, 0.0  # planar
    return flat(dm, *n, a, b_1, b_2, spin)


def as_a_row_of_balls(dm):
    """Give the dimer the transverse inertia at which its normals couple as in a row of three equal balls."""
    dm.J_t, dm.it = dm.m * dm.p2.h**2 / 3, 3 / (dm.m * dm.p2.h**2)
    set_pair(dm)


@pytest.mark.parametrize(
    ("e", "eta", "expected", "digits"),
    [
        (1.0, 1.5, (-0.070952354, 0.076403039, 0.994549315), 8),
        (0.6, 1.5, (0.167595879, 0.182847277, 0.649556845), 8),
        (1.0, 1.0, (-0.13026, 0.15023, 0.98003), 5),
    ],
)
def test_three_equal_balls(e, eta, expected, digits):
    """Balls of no size with J_t = m h^2/3 make W_12 = -W_11/2 and uncouple the friction: three equal balls in a row.

    The contacts 1-2 and 2-3 are p1 and p2; W_11 = 4/m = 2/(m/2) is that of balls of mass m/2.
    """
    dm = dimer(mu=0, e=e, eta=eta)
    dm.p1.r = dm.p2.r = 0.0
    as_a_row_of_balls(dm)
    w = dm.pair
    np.testing.assert_allclose((w.nn_1, w.nn_2, w.nn_12, w.na_1, w.na_2), (4, 4, -2, 0, 0), rtol=1e-15)
    state, _, log = strike(dm, flat(dm, -1.0, 0.0))
    ball = dm.m / 2
    P_1, P_2 = log[:, E_P1].sum(), log[:, E_P2].sum()
    balls = np.array([1 - P_1 / ball, (P_1 - P_2) / ball, P_2 / ball])
    np.testing.assert_allclose(balls, expected, atol=10.0**-digits)
    np.testing.assert_allclose(np.diff(balls), state[[N1, N2]], atol=1e-12)


@pytest.mark.parametrize(
    ("e", "expected"), [(1.0, (0.9181463, 0.1473554)), (0.9, (0.8003297, 0.1127581)), (0.6, (0.4667095, 0.0152514))]
)
def test_an_end_that_lands_beside_one_at_rest_in_a_row_of_balls(e, expected):
    """Rebound of the end at rest, and of that which lands, in units of its speed."""
    dm = dimer(mu=0, e=e)
    as_a_row_of_balls(dm)
    state, _, _ = strike(dm, flat(dm, 0.0, -1.0))
    np.testing.assert_allclose(state[[N1, N2]], expected, atol=6e-8)


@pytest.mark.parametrize("eta", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("k_ratio", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.long_uncompiled) for k in (2, 3))])
def test_unlike_ends_and_contacts_against_the_oracle(eta, k_ratio, seed):
    rng = np.random.default_rng([seed, 26])
    mu = rng.uniform(0.05, 0.6, 2) * (seed % 2)
    params = {name: rng.uniform(3e-3, 6e-3) for name in ("r_1", "r_2")}
    params |= {"rho_b_2": rng.uniform(2e3, 9e3), "A_r": rng.uniform(3, 8), "eta": eta, "k_ratio": k_ratio}
    params |= {"e_1": rng.uniform(0.3, 1), "e_2": rng.uniform(0.3, 1)}
    params |= {"mu_1": mu[0], "mu_2": mu[1], "mu_s_1": 1.5 * mu[0], "mu_s_2": 1.2 * mu[1]}
    dm = dimer(**params)
    q, qdot = np.zeros(6), rng.normal(size=6) * [1, 1, 1, 5, 20, 100]
    qdot[2] = -abs(qdot[2])
    assert_as_the_oracle_says(dm, params, state_of(dm, q, qdot), 1e-12, 1e-9)


@pytest.mark.parametrize("k", range(len(DOUBLE)))
def test_stored_impacts(k):
    case = DOUBLE[k]
    dm = dimer(**case["params"])
    before = state_of(dm, case["q"], case["qdot_minus"])
    after, modes, _ = strike(dm, before)
    assert rates_apart(dm, after, case["qdot_plus"], -min(before[N1], before[N2])) < 1e-7
    assert end_names(modes) == case["end"]


@pytest.mark.slow
@pytest.mark.jit
@pytest.mark.parametrize(  # each kind of `random_flat` is there in 30
    "seed", [*range(30), *(pytest.param(seed, marks=pytest.mark.release) for seed in range(30, 60))]
)
def test_random_impacts_against_the_oracle(seed):
    rng = np.random.default_rng([9, seed])
    mu = rng.uniform(0, 0.8)
    params = {"A_r": rng.uniform(2.2, 9), "mu": mu, "mu_s": mu * rng.choice([1, 1.5])}
    e = rng.uniform(0.05, 1)
    params |= {"e": e} if seed % 4 else {"e_1": rng.uniform(0.05, 1), "e_2": rng.uniform(0.05, 1)}
    dm = dimer(**params)
    assert_as_the_oracle_says(dm, params, random_flat(dm, rng, seed), 1e-10, 1e-7)


@pytest.mark.parametrize("e", [1.0, 0.5, 0.0])
def test_equal_approach_without_friction_is_turned_at_both_ends(e):
    dm = dimer(mu=0, e=e)
    before = flat(dm, -0.4, -0.4, 0.3, 0.2, -0.1, 20.0)
    after, _, _ = strike(dm, before)
    expected = before.copy()
    expected[[N1, N2]] = 0.4 * e
    np.testing.assert_allclose(after, expected, atol=4e-11)


@pytest.mark.parametrize("seed", range(8))
def test_elastic_impacts_without_friction_keep_the_energy(seed):
    rng = np.random.default_rng(seed)
    dm = dimer(mu=0, e=1, A_r=rng.uniform(2, 9))
    before = random_flat(dm, rng, seed)
    after, _, _ = strike(dm, before)
    V = min(before[N1], before[N2])
    # a few times the tolerance of the integration, 1e-10 a step
    assert kinetic(dm, after) - kinetic(dm, before) == pytest.approx(0, abs=1e-8 * dm.m * V**2)


def test_impulses_of_the_log_make_the_change_of_momentum():
    dm = dimer()
    before = flat(dm, 0.0, -0.3, 0.01, 0.3, 0.2, 10.0)
    after, _, log = strike(dm, before)
    total = log[:, E_P1].sum() + log[:, E_P2].sum()
    assert total == pytest.approx(dm.m * 0.5 * (after[N1] + after[N2] - before[N1] - before[N2]), rel=1e-12)
    np.testing.assert_allclose(log[-1, E_N1_AFTER : E_N1_AFTER + 2], after[[N1, N2]], rtol=1e-15)
    codes = log[:, E_KIND].astype(int)
    assert ((digits_of(codes)[0] >= IMPACT) | (digits_of(codes)[1] > IMPACT)).all()


def test_an_end_at_rest_that_is_pressed_down_takes_an_impulse():
    """The spurious solution E_1 = 0 of the equations (6)-(7): p1 rests, p2 lands, their normals repel each other."""
    dm = dimer(A_r=6)
    assert dm.pair.nn_12 < 0
    after, _, log = strike(dm, flat(dm, 0.0, -0.3, 0.0, 1.0, 1.0))
    assert log[:, E_P1].sum() > 0.01 * log[:, E_P2].sum()
    assert after[N1] > 0


def test_an_end_at_rest_that_is_lifted_takes_none():
    dm = dimer(A_r=4, mu=0)
    assert dm.pair.nn_12 > 0
    after, _, log = strike(dm, flat(dm, 0.0, -0.3))
    assert log[:, E_P1] == pytest.approx(0, abs=1e-16)
    np.testing.assert_allclose(after[[N1, N2]], (1.6 * 0.3 * dm.pair.nn_12 / dm.pair.nn_1, 0.18), rtol=1e-14)


def first_phase(dm, n_1, n_2):
    """Digits of both ends in the contact state of the first phase of an impact that begins at rest."""
    return digits_of(int(strike(dm, flat(dm, n_1, n_2))[2][0, E_KIND]))


@pytest.mark.parametrize(("n_1", "n_2"), [(0.0, -0.3), (-0.3, 0.0), (-0.1, -0.3), (-0.3, -0.2)])
@pytest.mark.parametrize("A_r", [5.5, 6.0, 7.0])
def test_two_ends_at_rest_hold_up_to_the_sum_of_their_limits(n_1, n_2, A_r):
    """Both hold if and only if |A| <= mu_s (f_1 + f_2), where A = W_an (f_2 - f_1) / W_aa and f_i ~ (-n_i)^(3/2)."""
    w = dimer(A_r=A_r).pair
    f_1, f_2 = (-n_1) ** 1.5, (-n_2) ** 1.5
    limit = w.na_2 / w.aa * abs(f_2 - f_1) / (f_1 + f_2)
    for factor, mode in ((1 + 1e-8, STICK), (1 - 1e-8, SLIP)):
        digits = first_phase(dimer(A_r=A_r, mu=0.5 * limit, mu_s=limit * factor), n_1, n_2)
        hit = [digit for digit, n in zip(digits, (n_1, n_2), strict=True) if n < 0]
        assert hit == [IMPACT + mode] * len(hit)


@pytest.mark.parametrize(("n_1", "n_2"), [(-0.1, -0.3), (-0.3, -0.2)])
def test_each_end_holds_by_its_own_normal_force(n_1, n_2):
    """Both hold if and only if |A| <= mu_s_1 f_1 + mu_s_2 f_2, here with mu_s_2 half as large as mu_s_1."""
    w = dimer(A_r=6.0).pair
    f_1, f_2 = (-n_1) ** 1.5, (-n_2) ** 1.5
    limit = w.na_2 / w.aa * abs(f_2 - f_1) / (f_1 + 0.5 * f_2)
    for factor, mode in ((1 + 1e-8, STICK), (1 - 1e-8, SLIP)):
        held = {"mu_s_1": limit * factor, "mu_s_2": 0.5 * limit * factor}
        digits = first_phase(dimer(A_r=6.0, mu_1=0.5 * limit, mu_2=0.25 * limit, **held), n_1, n_2)
        assert digits == (IMPACT + mode, IMPACT + mode)


@pytest.mark.parametrize("seed", range(2))
def test_within_an_impact_an_end_is_held_by_mu_s_whatever_holds_a_lasting_contact(seed):
    """Also one at rest beside an end that slips; with another mu_s some of these come to another outcome."""
    rng = np.random.default_rng([36, seed])
    mu = float(rng.uniform(0.1, 0.4))
    one, other, stickier = (
        dimer(mu=mu, mu_s=1.1 * mu * hold, mu_h=mu_h * mu, e_1=0.5, e_2=0.7)
        for hold, mu_h in ((1, 1.1), (1, 8.0), (6, 8.0))
    )
    changed = 0
    for k in range(20):
        state = random_flat(one, rng, k)
        after, modes, _ = strike(one, state)
        again, other_modes, _ = strike(other, state)
        np.testing.assert_array_equal(again, after)
        assert other_modes == modes
        changed += (strike(stickier, state)[0] != after).any()
    assert changed > 0


def test_two_held_ends_do_not_slip():
    dm = dimer(A_r=7, mu=0.3, mu_s=0.4)
    after, modes, _ = strike(dm, flat(dm, 0.0, -0.3, spin=40.0))
    assert modes == (STICK, STICK)
    np.testing.assert_allclose(velocities(dm, after)[2:], (0, 0, 0, 40 * dm.p1.r), atol=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_mirrored_impacts_have_mirrored_outcomes(seed):
    rng = np.random.default_rng(seed)
    e_1, e_2, mu = rng.uniform(0.1, 1), rng.uniform(0.1, 1), rng.uniform(0.05, 0.5)
    dm, exchanged = (dimer(e_1=e, e_2=f, mu=mu, mu_s=1.3 * mu) for e, f in ((e_1, e_2), (e_2, e_1)))
    before = random_flat(dm, rng, seed)
    after, modes, _ = strike(dm, before)
    lateral = np.ones(N_STATE)
    lateral[[CB, WP, SPIN]] = -1
    mirrored, mirrored_modes, _ = strike(dm, before * lateral)
    np.testing.assert_allclose(mirrored * lateral, after, atol=1e-12)
    assert mirrored_modes == modes

    def turned(state):
        """A state seen from the other side: half a turn about the normal."""
        state = state.copy()
        state[[N1, N2]] = state[[N2, N1]]
        state[[CA, CB, WB, SPIN]] *= -1
        return state

    other, other_modes, _ = strike(exchanged, turned(before))
    # the same steps, but rounded differently: at the events that is felt as the tolerance is
    np.testing.assert_allclose(velocities(dm, turned(other)), velocities(dm, after), atol=1e-9)
    assert other_modes == modes[::-1]


@pytest.mark.parametrize("k", [4, 9])
def test_planar_impacts_stay_planar(k):
    dm = dimer(mu=0.3)
    after, _, _ = strike(dm, random_flat(dm, np.random.default_rng(k), k))
    assert not after[[CB, WP, SPIN]].any()


@pytest.mark.jit
@pytest.mark.parametrize("impacts", [1000, pytest.param(10000, marks=pytest.mark.release)])
def test_random_impacts_never_gain_energy(impacts):
    rng = np.random.default_rng(6)
    gains, rates, cone = [], [], []
    for k in range(impacts):
        mu = rng.uniform(0, 1) * (k % 10 > 0)
        e_1, e_2 = rng.choice([1, rng.uniform()]), rng.uniform(0.05, 1)
        dm = dimer(A_r=rng.uniform(2, 9), mu=mu, mu_s=mu * rng.choice([1, 1.5]), e_1=e_1, e_2=e_2)
        before = random_flat(dm, rng, k) * rng.choice([1e-6, 0.1, 1])
        before[WB] = (before[N2] - before[N1]) / (dm.l)
        after, _, log = strike(dm, before)
        unit = dm.m * min(before[N1], before[N2]) ** 2
        noise = 1e-15 * kinetic(dm, before) / unit
        gains.append((kinetic(dm, after) - kinetic(dm, before)) / unit - 8 * noise)
        rates.append(min(after[N1], after[N2]))
        P = log[:, [E_P1, E_P2]].sum()
        cone.append(hypot(*(after[[CA, CB]] - before[[CA, CB]])) * dm.m / P - dm.p1.mu_s)
    # the bound is what the tolerance of the integration, 1e-10, may amount to
    assert max(gains) < 1e-8
    assert min(rates) >= 0
    assert max(cone) < 1e-8


@pytest.mark.parametrize(("A_r", "e_1", "e_2"), list(product([4.0, 6.0, 8.0], [0.0, 0.5], [0.0])))
def test_impacts_without_restitution_end(A_r, e_1, e_2):
    dm = dimer(A_r=A_r, e_1=e_1, e_2=e_2)
    for k in range(10):
        before = random_flat(dm, np.random.default_rng(k), k)
        after, _, _ = strike(dm, before)
        assert min(after[N1], after[N2]) >= 0
        assert kinetic(dm, after) < kinetic(dm, before)


def test_the_vertical_moment_belongs_to_the_lateral_friction():
    """L_n changes by the lateral impulses at the two ends, which also turn the spin: the axis stays level."""
    dm = dimer(mu=0.2)
    before = flat(dm, -0.1, -0.3, 0.2, 1.5, -0.5, 30.0)
    after, _, _ = strike(dm, before)
    turn = dm.J_t * (np.array(angular_momentum(dm, after)) - angular_momentum(dm, before))
    push = dm.m * (after[CB] - before[CB])
    assert turn[0] == pytest.approx(-dm.p1.r * push, rel=1e-9)
    assert turn[2] == pytest.approx(dm.J_t * (after[WP] - before[WP]), rel=1e-12)
    assert abs(turn[2]) > 0.01 * dm.p2.h * abs(push)


def test_modes_are_free_or_closed():
    _, modes, _ = strike(dimer(), flat(dimer(), -0.1, -0.3))
    assert FREE not in modes
