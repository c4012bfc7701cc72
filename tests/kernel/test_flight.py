"""Free motion: against the oracle's equations, by its invariants, in 50 digits where hops are tiny."""

from math import cos, pi, sin

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from dimersweep.kernel.model.layout import CA, CB, D1, D2, DIP, N1, N2, N_STATE, PHASE, SPIN, THETA, WB, WP, X1
from tests.checks.verbs import angular_momentum, dimer, fly, gap_series, oracle_state, state_of, take_off
from tests.oracle import body
from tests.oracle.contact import Instant, State

PARAMETERS = {"A_r": 5.3, "Gamma": 1.2, "phi0": 0.7}


def flown(dm, state, t):
    state = state.copy()
    fly(dm, state, t)
    return state


def random_motion(seed):
    rng = np.random.default_rng(seed)
    q = np.array([*rng.normal(size=2), 0.03, rng.uniform(-3, 3), rng.uniform(-0.5, 0.5), rng.uniform(-9, 9)])
    return q, rng.normal(size=6) * [1, 1, 0.3, 6, 6, 150]


def axis_and_rate(dm, state):
    """The axis from p1 to p2 and its rate in the frame (a, b, n) of the heading at the start."""
    b = state[DIP]
    axis = np.array([cos(b), 0, sin(b)])
    return axis, np.array([-sin(b) * state[WB], -state[WP], cos(b) * state[WB]])


@pytest.mark.parametrize("seed", range(6))
def test_against_the_oracles_equations(seed):
    """All twelve coordinates, with precession and spin, as long as the axis stays away from the vertical."""
    dm, d = dimer(**PARAMETERS), body.dimer(PARAMETERS)
    q, qdot = random_motion(seed)
    phase = 1.1
    t_start = phase / dm.omega
    steep = _steep(1.2)

    def rates(t, y):
        return np.concatenate([y[6:], Instant(d, t, y[:6], y[6:]).qddot(State())])

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "events": steep}
    path = solve_ivp(rates, (t_start, t_start + 0.3), np.concatenate([q, qdot]), **options)
    t, y = path.t[-1] - t_start, path.y[:, -1]
    assert t > 0.02
    end_q, end_rates = oracle_state(dm, flown(dm, state_of(dm, q, qdot, phase), t))
    np.testing.assert_allclose(end_q, y[:6], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(end_rates, y[6:], rtol=1e-10, atol=1e-10)


def _steep(limit):
    def event(_, y):
        return limit - abs(y[4])

    event.terminal = True
    return event


@pytest.mark.parametrize("seed", range(6))
def test_gaps_of_a_tumbling_dimer(seed):
    """Past the vertical, where the dip angle turns back, the gaps follow from the turning of the axis about L."""
    dm = dimer(**PARAMETERS)
    q, qdot = random_motion(seed)
    state = state_of(dm, q, qdot * [1, 1, 1, 1, 30, 1], 0.4)
    axis, rate = axis_and_rate(dm, state)
    momentum = -np.array(angular_momentum(dm, state))  # the frame (a, b, n) is left-handed
    np.testing.assert_allclose(np.cross(momentum, axis), rate, atol=1e-12)
    climb = 0.5 * (state[N1] + state[N2]) + dm.A[0] * dm.omega * cos(0.4 + dm.phi0)
    passed = False
    for t in np.linspace(0.01, 0.6, 40):
        end = flown(dm, state, t)
        turned = Rotation.from_rotvec(momentum * t).apply(axis)
        height = climb * t - 0.5 * dm.g * t**2
        plate = dm.A[0] * (sin(dm.omega * t + 0.4 + dm.phi0) - sin(0.4 + dm.phi0))
        centre = 0.5 * (state[D1] + state[D2]) + height - plate
        expected = centre + np.array([-1, 1]) * dm.p2.h * turned[2]
        np.testing.assert_allclose(end[[D1, D2]], expected, atol=1e-14)
        assert sin(end[DIP]) == pytest.approx(turned[2], abs=1e-13)
        passed = passed or abs(end[DIP]) > 1.2
    assert passed


@pytest.mark.parametrize("seed", range(6))
def test_invariants(seed):
    dm = dimer(**PARAMETERS)
    state = state_of(dm, *random_motion(seed))
    energy, momentum, drift = _invariants(dm, state)
    for t in (1e-4, 0.02, 0.3, 2.0):
        end = _invariants(dm, flown(dm, state, t))
        height = 0.5 * dm.g * t**2
        assert end[0] == pytest.approx(energy, abs=1e-13 * (abs(energy) + dm.m * dm.g * height))
        np.testing.assert_allclose(end[1], momentum, atol=1e-12 * np.abs(momentum).max())
        np.testing.assert_allclose(end[2], drift, atol=1e-12 * np.abs(drift).max())


def _invariants(dm, state):
    """Energy in the lab, angular momentum and horizontal momentum in fixed axes."""
    phase = state[PHASE] + dm.phi0
    climb = 0.5 * (state[N1] + state[N2]) + dm.A[0] * dm.omega * cos(phase)
    height = 0.5 * (state[D1] + state[D2]) + dm.A[0] * sin(phase)
    moving = dm.m * (state[CA] ** 2 + state[CB] ** 2 + climb**2 + 2 * dm.g * height)
    energy = 0.5 * (moving + dm.J_t * (state[WB] ** 2 + state[WP] ** 2) + dm.J_a * state[SPIN] ** 2)
    L_a, L_b, L_n = angular_momentum(dm, state)
    s, c = sin(state[THETA]), cos(state[THETA])
    momentum = np.array([c * L_b - s * L_a, c * L_a + s * L_b, L_n])
    drift = np.array([c * state[CB] - s * state[CA], c * state[CA] + s * state[CB]])
    return energy, momentum, drift


@pytest.mark.parametrize("hop", [1e-12, 1e-9, 1e-5, 1e-3, 0.05])
@pytest.mark.parametrize("s", [-1.0, 1.0])
def test_gaps_of_hops_of_any_size_keep_ten_digits(hop, s):
    dm = dimer(Gamma=0.8, phi0=0.3)
    state = np.zeros(N_STATE)
    state[[DIP, WB, WP, SPIN]] = -0.2 * s, 3.0, 4.0, 90.0
    own, other = (0, 1) if s < 0 else (1, 0)
    state[D1 + other] = -s * dm.l * sin(state[DIP])
    state[N1 + own] = 0.5 * 9.0 * hop
    state[N1 + other] = state[N1 + own] - s * dm.l * cos(state[DIP]) * state[WB]
    gap, rate, _, _ = gap_series(dm, take_off(dm, state), s, hop)
    with mpmath.workdps(50):
        exact = _exact_gap(dm, state, s, own)
        t = mpmath.mpf(hop)
        assert gap == pytest.approx(float(exact(t)), rel=1e-10)
        assert rate == pytest.approx(float(mpmath.diff(exact, t, h=t * mpmath.mpf("1e-15"))), rel=1e-10)
    assert gap != 0


def _exact_gap(dm, state, s, own):
    """The gap over time in 50 digits: ballistic centre, axis turned about L, harmonic plate."""
    mp = mpmath.mpf
    beta, w_b, w_p, spin = (mp(float(state[k])) for k in (DIP, WB, WP, SPIN))
    ratio = mp(float(dm.J_a)) / mp(float(dm.J_t))
    sb, cb = mpmath.sin(beta), mpmath.cos(beta)
    L = (-sb * w_p + cb * ratio * spin, w_b, cb * w_p + sb * ratio * spin)
    Omega = mpmath.sqrt(sum(x**2 for x in L))
    along = (cb * L[0] + sb * L[2]) * L[2] / Omega**2
    h, g, A, omega = (mp(float(x)) for x in (dm.p2.h, dm.g, dm.A[0], dm.omega))
    phi = mp(float(dm.phi0))

    def rest(t):
        dip = along + (sb - along) * mpmath.cos(Omega * t) + cb * w_b / Omega * mpmath.sin(Omega * t)
        return mp(s) * h * dip - A * mpmath.sin(omega * t + phi)

    slope = mp(s) * h * cb * w_b - A * omega * mpmath.cos(phi)
    rate = mp(float(state[N1 + own]))
    return lambda t: (rate - slope) * t - g * t**2 / 2 + rest(t) - rest(mp(0))


def test_planar_motion_stays_planar_exactly():
    dm = dimer(Gamma=1.1)
    state = np.zeros(N_STATE)
    state[[D1, D2]] = 0.01, 0.01 + dm.l * sin(0.3)
    state[[DIP, WB, CA, N1, N2]] = 0.3, 5.0, 0.4, 0.5, 0.5 + dm.l * cos(0.3) * 5
    end = flown(dm, state, 0.1)
    assert not end[[CB, WP, SPIN, THETA, X1]].any()
    assert end[DIP] == pytest.approx(0.8, rel=1e-14)
    assert (end[CA], end[WB]) == (pytest.approx(0.4, rel=1e-15), pytest.approx(5.0, rel=1e-15))


def test_a_flight_without_rotation():
    dm = dimer(Gamma=0.5)
    state = np.zeros(N_STATE)
    state[[D1, D2, N1, N2, CA, CB]] = 0.01, 0.01, 0.2, 0.2, 0.3, -0.4
    end = flown(dm, state, 0.02)
    plate = dm.A[0] * sin(dm.omega * 0.02)
    height = 0.01 + (0.2 + dm.A[0] * dm.omega) * 0.02 - 0.5 * dm.g * 0.02**2 - plate
    np.testing.assert_allclose(end[[D1, D2]], height, rtol=1e-13)
    np.testing.assert_allclose(end[[CA, CB, DIP, THETA]], (0.3, -0.4, 0, 0), rtol=1e-15)
    assert end[X1] == pytest.approx(-0.4 * 0.02, rel=1e-14)


def test_the_heading_is_followed_over_many_turns():
    """Fast precession about the vertical: theta counts whole turns, and so does the spinning angle."""
    dm = dimer()
    state = np.zeros(N_STATE)
    state[[WP, SPIN]] = 40.0, 0.0
    end = flown(dm, state, 2.0)
    assert end[THETA] == pytest.approx(80.0, rel=1e-13)
    assert end[THETA] > 12 * 2 * pi
    assert end[14] == pytest.approx(0.0, abs=1e-12)


def test_flights_in_pieces_are_the_flight_in_one():
    dm = dimer(Gamma=1.5)
    state = state_of(dm, *random_motion(3))
    once = flown(dm, state, 0.09)
    pieces = state
    for t in (0.01, 0.05, 0.03):
        pieces = flown(dm, pieces, t)
    np.testing.assert_allclose(pieces, once, rtol=1e-11, atol=1e-13)


@pytest.mark.jit
@pytest.mark.parametrize("draws", [20, pytest.param(60, marks=pytest.mark.release)])
@pytest.mark.parametrize("upright", [False, True], ids=["anywhere", "close past the vertical"])
def test_the_heading_turns_as_in_many_small_flights_however_far(upright, draws):
    rng, dm = np.random.default_rng(5), dimer(Gamma=0.0)
    for _ in range(draws):
        state = np.zeros(N_STATE)
        state[WB], state[WP], state[SPIN] = rng.normal(size=3) * 10 ** rng.uniform(0, 2, 3)
        if upright:  # the axis turns in a plane that is a little off the vertical
            state[WP], state[SPIN] = 1e-3 * state[WP], 1e-3 * state[SPIN]
        state[DIP], state[D1], state[D2] = rng.uniform(-1.5, 1.5), 1.0, 1.0
        rate = take_off(dm, state).Omega
        t, pieces, small, whole = rng.uniform(0, 60) / rate, 4000, state.copy(), state.copy()
        fly(dm, whole, t)
        for _ in range(pieces):
            fly(dm, small, t / pieces)
        assert whole[THETA] == pytest.approx(small[THETA], abs=1e-6)


@pytest.mark.jit
def test_a_flight_of_a_billion_turns_takes_no_longer_than_its_formula():
    """Each turn of an axis around the vertical is one of the heading; a loop over them would take minutes for 1,000 flights."""
    dm, state = dimer(Gamma=0.0), np.zeros(N_STATE)
    state[WP], state[D1], state[D2] = 1e9, 1.0, 1.0
    for _ in range(1000):
        flown = state.copy()
        fly(dm, flown, 2 * np.pi)
        assert flown[THETA] == pytest.approx(2e9 * np.pi, rel=1e-14)
