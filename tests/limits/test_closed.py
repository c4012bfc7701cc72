"""The engine against motions known in closed form: bouncing ball, falling, rolling and rocking rod."""

from itertools import islice
from math import pi

import numpy as np
import pytest
from mpmath import mpf

from dimersweep import names, simulate
from tests.oracle.body import dimer

from .cases import Impact, coordinates, engine_impact
from .closed import Ball, fall_rate, fall_time, rocking_times

UPRIGHT = {"beta0": pi / 2 - 1e-6, "xdot0": 0.0, "mu": 0.0, "mu_s": 0.0}  # then p1 bounces like a ball
FLAT = {"beta0": 0.0, "xdot0": 0.0}
RTOL = 1e-11


def run_of(periods=1, **parameters):
    """A run; its events' times, causes, and gap rates of p1 before."""
    run = simulate(periods=periods, rtol=RTOL, **parameters)
    assert run.status == "ok"
    events = names(run.events)
    return run, events["time"].values, events["cause"].values, events["gap_1_rate_before"].values


@pytest.mark.parametrize(("e", "Gamma"), [(0.6, 0.5), (0.6, 0.9), (0.8, 0.3), (0.4, 1.3)])
def test_impacts_of_a_bouncing_ball(e, Gamma):
    parameters = {"e": e, "Gamma": Gamma, **UPRIGHT}
    _, times, causes, rates = run_of(**parameters)
    struck = causes == "impact"
    n = struck.sum()
    expected = np.array([[float(t), float(v)] for t, v in islice(Ball(dimer(parameters)).impacts(), int(n))])
    assert n > 9
    np.testing.assert_allclose(times[struck], expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(rates[struck], expected[:, 1], atol=1e-11)


@pytest.mark.parametrize(("e", "Gamma"), [(0.6, 0.5), (0.6, 0.9), (0.8, 0.3)])
def test_a_chatter_ends_when_its_bounces_have_accumulated(e, Gamma):
    """Hops of a geometric series are left after the last impact that the engine resolves."""
    parameters = {"e": e, "Gamma": Gamma, **UPRIGHT}
    run, times, causes, _ = run_of(**parameters)
    end = float(Ball(dimer(parameters)).rest_time())
    (closed,) = times[causes == "chatter_end"]
    assert closed == pytest.approx(end, abs=1e-12)
    after = run.states(np.linspace(closed, 1 / 15, 9))
    assert not after["gap_1"].values.any()  # Gamma < 1: it stays


def test_accumulation_of_small_bounces():
    """For a small Gamma the plate is still at rest, as it were, when the chatter ends: 2 e V / ((1 - e) g)."""
    for e in (0.2, 0.7):
        d = dimer({"e": e, "Gamma": 1e-4})
        assert float(Ball(d).rest_time()) == pytest.approx(2 * e * 1e-4 / ((1 - e) * d.omega), rel=1e-3)


@pytest.mark.parametrize("Gamma", [1.2, 1.5, 2.5])
def test_a_plastic_ball_is_thrown_off_and_lands(Gamma):
    parameters = {"e": 0.0, "Gamma": Gamma, **FLAT}
    _, times, causes, _ = run_of(**parameters)
    ball = Ball(dimer(parameters))
    off = ball.lift_off(mpf(0))
    hop, _ = ball.hop(off, mpf(0))
    assert times[causes == "lift_off"][0] == pytest.approx(float(off), abs=1e-12)
    assert times[(causes == "impact") & (times > 0)][0] == pytest.approx(float(off + hop), abs=1e-12)


def test_a_flat_drop_bounces_as_one_ball_and_rests():
    parameters = {"e": 0.8, "Gamma": 0.05, **FLAT}
    run, times, causes, _ = run_of(periods=2, **parameters)
    expected = [float(t) for t, _ in islice(Ball(dimer(parameters)).impacts(), 12)]
    np.testing.assert_allclose(np.unique(times[causes == "impact"])[:12], expected, atol=1e-12)
    assert run.mode == "rest"


def test_nearly_equal_approach_is_turned_at_both_ends():
    """Without friction equal approach ends with e at both ends, and a small difference changes that by no more than itself."""
    parameters = {"e": 0.6, "mu": 0.0, "mu_s": 0.0, "A_r": 6.0}
    for apart in (0.0, 1e-12, 1e-10, 1e-8):
        q, qdot = coordinates(Impact(parameters, (-1.0, -1.0 - apart), 0.0, (0.0, 0.0), 0.0))
        for tol in 10.0 ** -np.arange(6, 14):
            after = engine_impact(parameters, q, qdot, tol)
            assert after[2] == pytest.approx(0.6, abs=10 * tol + apart)
            assert after[4] * dimer(parameters).l == pytest.approx(0, abs=10 * tol + 2 * apart)


@pytest.mark.parametrize("A_r", [2.0, 3.0, 3.5])
def test_a_rod_rocks_without_friction(A_r):
    """Times of the double impacts while the rod goes from end to end, and the angles to which it rises."""
    parameters = {"e": 0.0, "Gamma": 0.0, "A_r": A_r, "beta0": 0.6, "xdot0": 0.0, "mu": 0.0, "mu_s": 0.0}
    _, times, causes, _ = run_of(**parameters)
    struck = np.unique(times[(causes == "impact") & (times > 0)])
    assert len(struck) >= 3
    expected = [float(t) for t in rocking_times(dimer(parameters), mpf(0.6), len(struck))]
    np.testing.assert_allclose(struck, expected, atol=1e-12)


@pytest.mark.parametrize("rolling", [False, True])
def test_a_rod_falls_about_its_end(rolling):
    mu = 5.0 if rolling else 0.0
    parameters = {"e": 0.0, "Gamma": 0.0, "beta0": 0.6, "xdot0": 0.0, "mu": mu, "mu_s": mu}
    run, times, _, _ = run_of(periods=2, **parameters)
    d, start = dimer(parameters), mpf(0.6)
    landing = float(fall_time(d, rolling, start, mpf(0)))
    assert times[times > 0][0] == pytest.approx(landing, abs=1e-12)
    angles = np.array([0.5, 0.3, 0.1])
    states = run.states([float(fall_time(d, rolling, start, mpf(angle))) for angle in angles])
    np.testing.assert_allclose(states["beta"], angles, atol=1e-10)
    np.testing.assert_allclose(
        states["beta_rate"], [float(fall_rate(d, rolling, start, mpf(x))) for x in angles], atol=1e-8
    )
    if rolling:  # the ball runs back under the falling rod, without slip
        np.testing.assert_allclose(states["y1"], d.r[0] * (0.6 - angles), atol=1e-11)
    else:
        np.testing.assert_allclose(states["y"], d.l / 2 * np.cos(0.6), atol=1e-12)
