"""Impacts at one end: against the oracle, in closed form, against a plain integration, and random ones by the thousand."""

from math import acos, copysign, cos, hypot, inf, pi, sin

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dimersweep.kernel.model.contact_code import code_of
from dimersweep.kernel.model.event_row import E_KIND, E_N1, E_N1_AFTER, E_P1
from dimersweep.kernel.model.layout import CA, CB, DIP, IMPACT, N1, N2, N_STATE, OK, SLIP, SPIN, STICK, WB, WP
from tests import oracle
from tests.checks.examine import kinetic
from tests.checks.impacts import STORED, end_names, rates_apart, works_apart
from tests.checks.verbs import (
    collide_single,
    contact_velocity,
    dimer,
    end_law,
    run_down,
    scratch,
    single_phase,
    state_of,
)

SINGLE = [case for case in STORED if not all(case["closed"])]
SIGNS = (-1.0, 1.0)


def struck(dm, state, s, tol=1e-10, works=False):
    """The state after an impact of the end with sign s, its friction mode, the scratch, and the rows of the log."""
    (work, log), state = scratch(), state.copy()
    work.course[0].tally.wanted = works
    status, mode, rows = collide_single(dm, state, s, -float(state[N1] if s < 0 else state[N2]), tol, work, log)
    assert status == OK
    # one row, or two where slip came to rest
    own = 5 if s < 0 else 1
    assert log[:rows, E_KIND].tolist() in ([own * (IMPACT + mode)], [own * (IMPACT + SLIP), own * (IMPACT + STICK)])
    return state, mode, work, log[:rows]


def strike(dm, state, s, tol=1e-10):
    """The state after an impact of the end with sign s, its friction mode and its normal impulse."""
    state, mode, _, log = struck(dm, state, s, tol)
    return state, mode, log[:, E_P1 + (0 if s < 0 else 1)].sum()


def phase(law, n, a, b, tol=1e-12):
    """Outcome of one impact on its own: (n, a, b), (p, t_a, t_b), mode."""
    work, _ = scratch()
    assert single_phase(law, n, a, b, tol, work) == OK
    blow = work.course[0].blow
    assert blow.E == 0.0
    return np.array([blow.n, blow.a, blow.b]), np.array([blow.P, blow.A, blow.B]), blow.mode


@pytest.mark.parametrize("k", range(len(SINGLE)))
def test_stored_impacts(k):
    case = SINGLE[k]
    dm = dimer(**case["params"])
    s = SIGNS[case["closed"].index(True)]
    before = state_of(dm, case["q"], case["qdot_minus"])
    after, mode, _ = strike(dm, before, s)
    assert rates_apart(dm, after, case["qdot_plus"], -contact_velocity(dm, before, s)[0]) < 1e-7
    assert end_names([mode])[0] == next(end for end in case["end"] if end != "-")


@pytest.mark.parametrize("seed", range(40))
def test_random_impacts_against_the_oracle(seed):
    """Velocities and works; that works are wanted changes no bit."""
    rng = np.random.default_rng([7, seed])
    mu, i = rng.uniform(0, 1) * (seed % 8 > 0), seed % 2
    params = {"A_r": rng.uniform(2, 9), "mu": mu, "mu_s": mu * rng.uniform(1, 2), "e": rng.uniform(0, 1)}
    dm = dimer(**params)
    q = np.array([0, 0, 0, rng.uniform(-3, 3), rng.uniform(-1.4, 1.4), 0])
    qdot = rng.normal(size=6) * [0.5, 0.5, 0.1, 2, 5, 80]
    qdot *= -np.sign(state_of(dm, q, qdot)[N1 + i])
    before = state_of(dm, q, qdot)
    after, _, work, log = struck(dm, before, SIGNS[i], works=True)
    np.testing.assert_array_equal(after, strike(dm, before, SIGNS[i])[0])
    expected, told = oracle.impact(params, q, qdot, (i == 0, i == 1))
    assert rates_apart(dm, after, expected, -before[N1 + i]) < 1e-7
    assert works_apart(dm, work, len(log), told, before[N1 + i]) < 1e-8


@pytest.mark.parametrize("e", [0.0, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("s", SIGNS)
def test_without_friction_the_gap_rate_is_turned_exactly(e, s):
    rng = np.random.default_rng(11)
    dm = dimer(mu=0, e=e)
    for _ in range(20):
        before = np.zeros(N_STATE)
        before[DIP], before[CB], before[WB], before[WP], before[SPIN] = rng.normal(size=5) * [0.6, 1, 5, 5, 100]
        own, other = (N1, N2) if s < 0 else (N2, N1)
        before[own] = -abs(rng.normal())
        before[other] = before[own] + s * -dm.l * cos(before[DIP]) * before[WB]
        after, _, p = strike(dm, before, s)
        assert after[own] == pytest.approx(-e * before[own], rel=1e-15, abs=1e-15)
        np.testing.assert_array_equal(after[[CB, WP, SPIN]], before[[CB, WP, SPIN]])
        dip = s * (after[N2] - after[N1]) - s * dm.l * cos(before[DIP]) * after[WB]
        assert dip == pytest.approx(0, abs=1e-13)
        assert p * end_law(dm, s, before[DIP]).nn == pytest.approx(-(1 + e) * before[own] * dm.m, rel=1e-13)


@pytest.mark.parametrize("tol", [1e-3, 1e-8, 1e-12])
@pytest.mark.parametrize("e", [0.05, 0.34, 1.0])
def test_a_hop_fainter_than_any_slip_still_loses_its_part(tol, e):
    """The impulse is too small a part of the one that would stop the slip to turn it, so that all rates are constant."""
    law = end_law(dimer(e=e), -1.0, 0.0)
    for size in 10.0 ** np.arange(3, 13):
        (n, _, _), (p, _, _), mode = phase(law, -1.0, 0.03 * size, size, tol)
        drive = law.nn - law.mu * law.na * 0.03 / hypot(0.03, 1.0)
        assert mode == SLIP
        assert n == pytest.approx(e, abs=1e-3 * tol + 10.0 / size)
        assert p * drive == pytest.approx(1 + e, abs=1e-3 * tol + 10.0 / size)


@pytest.mark.parametrize("s", SIGNS)
@pytest.mark.parametrize("beta", [0.0, -0.3, 0.25])
def test_a_sticking_end_bounces_in_closed_form(s, beta):
    law = end_law(dimer(mu=0.9, e_1=0.7, e_2=0.7), s, beta)
    assert abs(law.na) < law.mu_s * law.aa
    (n, a, b), (p, t_a, t_b), mode = phase(law, -1.0, 0.0, 0.0)
    assert mode == STICK
    assert (a, b, t_b) == (0, 0, 0)
    assert n == pytest.approx(0.7, rel=1e-15)
    assert p == pytest.approx(1.7 / (law.nn - law.na**2 / law.aa), rel=1e-14)
    assert t_a == pytest.approx(-law.na / law.aa * p, rel=1e-15)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_fast_axial_slip_bounces_in_closed_form(direction):
    law = end_law(dimer(mu=0.3), -1.0, 0.2)
    (n, a, b), (p, t_a, t_b), mode = phase(law, -1.0, 10 * direction, 0.0)
    assert mode == SLIP
    assert (b, t_b) == (0, 0)
    assert n == pytest.approx(0.6, rel=1e-15)
    assert p == pytest.approx(1.6 / (law.nn - 0.3 * direction * law.na), rel=1e-14)
    assert t_a == pytest.approx(-0.3 * direction * p, rel=1e-14)
    assert a == pytest.approx(10 * direction + law.na * p + law.aa * t_a, rel=1e-14)


def test_axial_slip_that_stops_and_sticks_follows_two_straight_lines():
    law = end_law(dimer(mu=0.9, e=0.5), -1.0, 0.1)
    a = 0.1
    k_1, w_1 = law.na - 0.9 * law.aa, law.nn - 0.9 * law.na  # rates of a and n while it slips
    w_2 = law.nn - law.na**2 / law.aa  # rate of n while it sticks
    P_stop = -a / k_1
    n_stop = -1 + w_1 * P_stop
    assert n_stop < 0  # it comes to rest during compression
    work = -(P_stop * (-1 + n_stop) / 2) + n_stop**2 / (2 * w_2)
    P_2 = -n_stop / w_2 + 0.5 * (2 * work / w_2) ** 0.5
    expected = 0.5 * (2 * work * w_2) ** 0.5
    (n, a, b), (p, _, _), mode = phase(law, -1.0, a, 0.0)
    assert mode == STICK
    assert (a, b) == (0, 0)
    assert n == pytest.approx(expected, rel=1e-12)
    assert p == pytest.approx(P_stop + P_2, rel=1e-12)


@pytest.mark.parametrize("s", SIGNS)
def test_an_end_that_cannot_hold_slips_out_of_rest_along_the_axis(s):
    law = end_law(dimer(mu=0.1, mu_s=0.15), s, 0.0)
    assert abs(law.na) > law.mu_s * law.aa
    c = copysign(1.0, law.na)
    (n, a, b), (p, t_a, t_b), mode = phase(law, -1.0, 0.0, 0.0)
    assert mode == SLIP
    assert (b, t_b) == (0, 0)
    assert n == pytest.approx(0.6, rel=1e-14)
    assert p == pytest.approx(1.6 / (law.nn - 0.1 * abs(law.na)), rel=1e-12)
    assert t_a == pytest.approx(-0.1 * c * p, rel=1e-12)
    assert a == pytest.approx(c * (abs(law.na) - 0.1 * law.aa) * p, rel=1e-12)


def test_slip_along_an_oblique_invariant_direction_keeps_it():
    law = end_law(dimer(mu=0.2), -1.0, 0.0)
    c = law.na / (0.2 * (law.aa - law.bb))
    assert abs(c) < 1
    angle = acos(c)
    v = 5.0
    (n, a, b), (p, t_a, t_b), mode = phase(law, -1.0, v * c, v * sin(angle))
    assert mode == SLIP
    assert n == pytest.approx(0.6, rel=1e-14)
    assert p == pytest.approx(1.6 / (law.nn - 0.2 * law.na * c), rel=1e-13)
    np.testing.assert_allclose((t_a, t_b), (-0.2 * c * p, -0.2 * sin(angle) * p), rtol=1e-12)
    v_plus = v + (law.na * c - 0.2 * (law.aa * c**2 + law.bb * sin(angle) ** 2)) * p
    np.testing.assert_allclose((a, b), (v_plus * c, v_plus * sin(angle)), rtol=1e-12)


def integrated(law, n, a, b):
    """An impact by a plain integration in the normal impulse, for slip that does not stop."""

    def slopes(_, y):
        v = hypot(y[1], y[2])
        t_a, t_b = -law.mu * y[1] / v, -law.mu * y[2] / v
        return [law.nn + law.na * t_a, law.na + law.aa * t_a, law.bb * t_b, -y[0]]

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    turn = solve_ivp(slopes, (0, 10), [n, a, b, 0.0], events=_ending(lambda y: y[0]), **options)
    y = turn.y_events[0][0]
    left = (1 - law.e**2) * y[3]
    end = solve_ivp(slopes, (0, 10), y, events=_ending(lambda y: left - y[3]), **options)
    return end.y_events[0][0][:3], turn.t_events[0][0] + end.t_events[0][0]


def _ending(value):
    def event(_, y):
        return value(y)

    event.terminal, event.direction = True, 1.0
    return event


@pytest.mark.parametrize("seed", range(12))
def test_turning_slip_against_a_plain_integration(seed):
    rng = np.random.default_rng(seed)
    law = end_law(dimer(mu=rng.uniform(0.05, 0.4), e=rng.uniform(0.1, 1)), SIGNS[seed % 2], rng.uniform(-0.5, 0.5))
    angle = rng.uniform(-3, 3)
    v = rng.uniform(4, 6)  # fast enough not to stop
    expected, P_expected = integrated(law, -1.0, v * cos(angle), v * sin(angle))
    velocity, (p, t_a, t_b), _ = phase(law, -1.0, v * cos(angle), v * sin(angle))
    np.testing.assert_allclose(velocity, expected, atol=1e-10)
    assert p == pytest.approx(P_expected, abs=1e-10)
    gained = law.nn * p + law.na * t_a, law.na * p + law.aa * t_a, law.bb * t_b
    np.testing.assert_allclose(velocity - [-1, v * cos(angle), v * sin(angle)], gained, atol=1e-11)


@pytest.mark.parametrize("tol", [1e-6, 1e-8, 1e-10, 1e-12])
def test_the_error_stays_near_the_tolerance(tol):
    law = end_law(dimer(mu=0.4), -1.0, 0.15)
    expected, _ = integrated(law, -1.0, 2.5, 3.0)
    velocity, _, _ = phase(law, -1.0, 2.5, 3.0, tol)
    assert np.abs(velocity - expected).max() < 20 * tol + 1e-13


@pytest.mark.parametrize("tol", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("v", [0.05, 5.0])
@pytest.mark.parametrize("e", [0.2, 0.9])
@pytest.mark.parametrize("share", [1e-2, 1e-4])
def test_slip_near_the_axis_is_followed(share, e, v, tol):
    """Where s^3 v is so small a share of the tolerance, and s^2 v far above it, so that the turning counts.

    It is expanded at the greater share, and summed in closed form at the smaller one.
    """
    for s, direction in ((s, direction) for s in SIGNS for direction in SIGNS):
        law = end_law(dimer(mu=0.25, e=e), s, 0.1)
        drive = copysign(law.na, direction * law.na)
        assert law.mu * (law.aa - law.bb) < drive  # attracting, whether the slip grows or dies out
        off = 0.95 * (share * tol / v) ** (1 / 3)
        a, b = direction * v * (1 - off**2) ** 0.5, v * off
        velocity, (p, _, _), _ = phase(law, -1.0, a, b, tol)
        expected, (p_exact, _, _), _ = phase(law, -1.0, a, b, 1e-13)
        if v > 1:
            expected, p_exact = integrated(law, -1.0, a, b)
        assert np.abs(velocity - expected).max() < 0.2 * tol
        assert p == pytest.approx(p_exact, abs=0.2 * tol)


@pytest.mark.parametrize("seed", range(30))
def test_a_slip_that_dies_out_is_summed_in_closed_form(seed):
    """Against an integration with the slip's own clock, in which it falls exponentially."""
    rng = np.random.default_rng([7, seed])
    law = end_law(dimer(mu=rng.uniform(0.05, 1.0), A_r=rng.uniform(2, 8)), SIGNS[seed % 2], rng.uniform(-0.7, 0.7))
    found = 0
    for angle in rng.uniform(-pi, pi, 12):
        a, b = 0.3 * cos(angle), 0.3 * sin(angle)
        impulse, swept = run_down(law, a, b, 1e-14)
        if impulse == inf:
            continue
        found += 1

        def slopes(_, y):
            v = hypot(y[0], y[1])
            return [law.na * v - law.mu * law.aa * y[0], -law.mu * law.bb * y[1], v, y[0] * v]

        gone = _ending(lambda y: 1e-15 - hypot(y[0], y[1]))
        end = solve_ivp(slopes, (0, 1e4), [a, b, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-17, events=gone)
        assert end.y_events[0].size  # it does die out
        assert impulse == pytest.approx(end.y[2, -1], rel=1e-10)
        assert swept == pytest.approx(end.y[3, -1], rel=1e-10)
    assert found or law.mu * law.aa < abs(law.na)


@pytest.mark.parametrize("seed", range(6))
def test_mirrored_impacts_have_mirrored_outcomes(seed):
    rng = np.random.default_rng(seed)
    dm = dimer(mu=0.35, mu_s=0.5)
    beta, a, b = rng.uniform(-0.5, 0.5), *rng.normal(size=2)
    velocity, impulse, mode = phase(end_law(dm, -1.0, beta), -1.0, a, b)
    lateral = phase(end_law(dm, -1.0, beta), -1.0, a, -b)
    np.testing.assert_allclose(lateral[0] * [1, 1, -1], velocity, atol=1e-12)
    np.testing.assert_allclose(lateral[1] * [1, 1, -1], impulse, atol=1e-12)
    # exchange of the ends is a half turn about the normal: the other end, at the opposite dip
    ends = phase(end_law(dm, 1.0, -beta), -1.0, -a, -b)
    np.testing.assert_allclose(ends[0] * [1, -1, -1], velocity, atol=1e-12)
    assert lateral[2] == ends[2] == mode


@pytest.mark.jit
@pytest.mark.parametrize("impacts", [1000, pytest.param(10000, marks=pytest.mark.release)])
def test_random_impacts_never_gain_energy(impacts):
    rng = np.random.default_rng(5)
    worst, cone = -np.inf, -np.inf
    for k in range(impacts):
        mu = rng.uniform(0, 1) * (k % 10 > 0)
        e_1, e_2 = rng.choice([0, 1, rng.uniform()]), rng.uniform()
        dm = dimer(A_r=rng.uniform(2, 9), mu=mu, mu_s=mu * rng.choice([1, 1.5]), e_1=e_1, e_2=e_2)
        i = k % 2
        before = np.zeros(N_STATE)
        before[DIP] = rng.uniform(-1.5, 1.5) * (k % 5 > 0)
        before[[WB, WP, SPIN]] = rng.normal(size=3) * [5, 5, 100]
        before[9:11] = rng.normal(size=2)
        if k % 7 == 0:  # planar
            before[[WP, SPIN, CB]] = 0
        before[N1] = rng.normal() * rng.choice([1e-6, 0.1, 1])
        before[N2] = before[N1] + dm.l * cos(before[DIP]) * before[WB]
        if before[N1 + i] > 0:
            before *= -1
            before[DIP] *= -1
        _, a, b = contact_velocity(dm, before, SIGNS[i])
        if k % 3 == 0:  # no slip
            before[9:11] -= a, b
        after, _, p = strike(dm, before, SIGNS[i])
        unit = dm.m * before[N1 + i] ** 2
        gain = (kinetic(dm, after) - kinetic(dm, before)) / unit
        noise = 1e-15 * kinetic(dm, before) / unit
        worst = max(worst, gain - 8 * noise)
        push = hypot(*(after[9:11] - before[9:11])) * dm.m
        cone = max(cone, push / p - dm.p1.mu_s - 1e-15 * hypot(*before[9:11]) * dm.m / p)
        assert after[N1 + i] >= 0
        if dm.p1.mu == 0:
            e = (dm.p1.e, dm.p2.e)[i]
            law = end_law(dm, SIGNS[i], before[DIP])
            assert gain == pytest.approx(-(1 - e**2) / law.nn / 2, abs=1e-12 + 8 * noise)
    # friction takes energy, and restitution gives at most back what was stored, up to the tolerance of the integration
    assert worst < 1e-9
    assert cone < 1e-9


@pytest.mark.parametrize(("slip", "kinds"), [(0.0, [STICK]), (0.01, [SLIP, STICK]), (3.0, [SLIP])])
def test_the_log_tells_what_happened(slip, kinds):
    dm = dimer(mu=0.5)
    work, log = scratch()
    before = np.zeros(N_STATE)
    before[[DIP, CA, N1, N2]] = 0.1, slip, -0.3, -0.3
    state = before.copy()
    status, mode, rows = collide_single(dm, state, -1.0, 0.3, 1e-10, work, log)
    assert (status, mode) == (OK, kinds[-1])
    assert log[:rows, E_KIND].tolist() == [code_of(IMPACT + kind, 0) for kind in kinds]
    assert (log[0, E_N1], log[rows - 1, E_N1_AFTER]) == (before[N1], pytest.approx(state[N1], rel=1e-14))
    np.testing.assert_allclose(log[1:rows, E_N1], log[: rows - 1, E_N1_AFTER], rtol=1e-15)
    momentum = dm.m * 0.5 * (state[N1] + state[N2] - before[N1] - before[N2])
    assert log[:rows, E_P1].sum() == pytest.approx(momentum, rel=1e-12)


def least_slip(law, a, b):
    """Least slip under a force that lasts, and whether it grows again: integrated as log v and phi in the clock dP / v."""
    spread = law.mu * (law.aa - law.bb)

    def rates(xi, y):
        c = np.cos(y[1])
        return [
            law.na * c - law.mu * (law.aa * c * c + law.bb * (1 - c * c)),
            np.sin(y[1]) * (spread * c - law.na),
        ]

    course = solve_ivp(rates, (0, 80), [np.log(hypot(a, b)), np.arctan2(b, a)], rtol=1e-11, atol=1e-11, method="DOP853")
    return np.exp(course.y[0].min()), course.y[0][-1] > course.y[0].min() + 1.0


@pytest.mark.parametrize("lateral", [-0.00456, 0.02])
def test_a_slip_that_only_turns_round_near_zero_does_not_stick_at_any_tolerance(lateral):
    """|W_na| is between mu W_aa and mu_s W_aa, and no attracting direction leads to rest: the slip has a least value."""
    dm = dimer(e=0.7, A_r=3.253, mu=0.2345, mu_s=0.4299)
    law = end_law(dm, -1.0, 0.485)
    a = copysign(0.25, -law.na)
    assert law.mu * law.aa < abs(law.na) <= law.mu_s * law.aa
    least, grows = least_slip(law, a, lateral)
    assert grows
    assert least < 1e-7
    answers = [phase(law, -1.0, a, lateral, 10.0**-k) for k in range(4, 15)]
    assert {mode for _, _, mode in answers} == {SLIP}
    for k, (velocity, _, _) in enumerate(answers, 4):
        np.testing.assert_allclose(velocity, answers[-1][0], atol=30 * 10.0**-k)
    # without a lateral slip it does come to rest, and friction holds it
    assert {phase(law, -1.0, a, 0.0, 10.0**-k)[2] for k in range(4, 15)} == {STICK}
