"""Stiff springs converge to the engine's impacts, with the order 2/5 of a Hertz contact's duration in its stiffness."""

import numpy as np
import pytest

from tests import oracle
from tests.checks.scenes import difference
from tests.oracle import body

from . import hertz, top
from .cases import IMPACTS, Impact, apart, coordinates, engine_impact, impact_errors, order, run_errors


def test_the_top_agrees_with_the_matrices_of_the_paper():
    """Coordinates there and back, gaps, contact velocities and the Delassus matrix of one random state."""
    rng = np.random.default_rng(1)
    d, q, qdot = body.dimer({}), 0.4 * rng.normal(size=6), rng.normal(size=6)
    state, constants = top.state_of(d, q, qdot), top.top_of(d)
    np.testing.assert_allclose(top.coordinates_of(d, state), [*q, *qdot], atol=1e-13)
    velocities = [top.contact_velocity(constants, state, i) for i in (0, 1)]
    rates, slips = body.gap_rates(d, q, qdot), body.slips(d, q, qdot)
    np.testing.assert_allclose(velocities, np.column_stack([slips, rates]), atol=1e-13)
    np.testing.assert_allclose([top.gap(constants, state, i) for i in (0, 1)], body.gaps(d, q), atol=1e-15)
    G, (expected, _) = np.zeros((2, 3, 2, 3)), body.delassus(d, q)
    top.compliance(constants, state, G)
    order = [1, 2, 0]
    np.testing.assert_allclose(G, expected[:, order][:, :, :, order], rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("name", IMPACTS)
def test_springs_converge_to_the_impacts_of_the_engine_and_of_the_oracle(name):
    impact = IMPACTS[name]
    stiffnesses = 10.0 ** np.arange(8, 12)
    errors = impact_errors(impact, stiffnesses, 1000)
    assert errors[-1] < 5e-4
    assert order(stiffnesses, errors) == pytest.approx(-0.4, abs=0.03)
    q, qdot = coordinates(impact)
    expected, _ = oracle.impact(impact.parameters, q, qdot, (True, impact.beta == 0))
    after = engine_impact(impact.parameters, q, qdot)
    assert apart(impact.parameters, q, qdot, after, expected) < 1e-9


def random_impact(rng, k):
    """Both ends or one end lands, sometimes with an end at rest or rolling; mu_s = mu, and no end rises to begin with."""
    mu = rng.choice([0.05, 0.2, 0.5])
    parameters = {"e": rng.uniform(0.2, 1), "A_r": rng.uniform(2.2, 8), "mu": mu, "mu_s": mu}
    n = [-abs(rng.normal()) - 0.1, 0.0 if k % 3 == 0 else -abs(rng.normal())]
    a, b, spin = 0.0 if k % 5 == 1 else rng.normal(), rng.normal(size=2), 100 * rng.normal()
    return Impact(parameters, tuple(n), a, tuple(b), spin, rng.uniform(0.05, 1.2) if k % 2 else 0.0)


def test_springs_converge_to_random_impacts():
    """From k to 100 k every difference falls by the order 2/5 (a factor of 6.3), or to what the time step leaves.

    That is most where a slip stops and starts anew in another direction: a tenth of the friction of one step.
    """
    rng, steps = np.random.default_rng(2), 2000
    errors = np.array([impact_errors(random_impact(rng, k), (1e10, 1e12), steps) for k in range(60)])
    assert (errors[:, 1] < np.maximum(errors[:, 0] / 5, 0.1 / steps)).all()
    assert np.median(errors[:, 0] / errors[:, 1]) == pytest.approx(100**0.4, rel=0.02)
    assert (errors[:, 0] > 0.5 / steps).mean() > 0.5  # most are not blurred by the step


def test_the_time_step_is_of_second_order():
    """An impact and the flight after it. The switches fall between the steps, so that single errors scatter."""
    dt = hertz.contact_time(body.dimer({}), 1e8, 0.1) / 2.0 ** np.arange(3, 9)
    (finest,), _ = hertz.march({}, [0.005], 1e8, dt[-1] / 64)
    errors = [difference(hertz.march({}, [0.005], 1e8, h)[0], finest[None]) for h in dt]
    assert order(dt, np.array(errors)) == pytest.approx(2, abs=0.3)


def test_whole_runs_with_springs_converge_to_the_engine():
    """Chatter, slip, a double impact, and the flight after it, in the base case."""
    stiffnesses = 10.0 ** np.arange(8, 10, 0.5)
    errors = run_errors({}, np.array([1.0, 1.5]) / 15, stiffnesses, 120)
    assert (np.diff(errors[:, 2]) < 0).all()  # when the double impact comes, in forcing periods
    assert errors[-1, 2] < 1e-6
    for k in (0, 1):
        assert errors[-1, k] < 2e-3
        assert order(stiffnesses, errors[:, k]) == pytest.approx(-0.4, abs=0.06)


def test_an_end_at_rest_neither_rings_nor_sinks():
    """Flat on a plate that shakes below Gamma = 1 the dimer stays where its weight has pressed it."""
    times = np.arange(1, 13) / 30
    states, _ = hertz.march({"beta0": 0.0, "Gamma": 0.5, "xdot0": 0.0}, times, 1e10, 1e-6)
    d = body.dimer({})
    rest = (0.5 * d.m * d.g / 1e10) ** (2 / 3)
    assert np.abs(states[:, 2]).max() < 10 * rest
    assert np.abs(states[:, 8]).max() < 1e-5
