"""Numbers of an orbit against those that a run tells of itself, whichever end bounces and whatever the period."""

import pytest

from dimersweep import orbits, simulate
from tests.checks.verdicts import TURN

TOLD = ("radius", "period", "zeta", "speed", "precession_rate", "impact_phase", "beta_rate_after")
UNLIKE = {"mu_1": 0.3, "mu_2": 0.3, "mu_s_1": 0.3, "mu_s_2": 0.3, "e_1": 0.714, "e_2": 0.632, "Gamma": 1.099}
SCENES = {
    "p1 stays down": {"beta0": 0.2793},
    "p2 stays down": {"beta0": -0.2793, "xdot0": -1.0},
    "unlike ends, sk_sp": UNLIKE | {"f": 15.064, "A_r": 6.381, "beta0": -0.036, "xdot0": -0.5, "phi0": 6.02},
}


@pytest.mark.parametrize("name", SCENES)
def test_an_orbit_has_the_numbers_of_the_run_that_came_to_it(name):
    run = simulate(**SCENES[name], periods=300, rtol=1e-10)
    assert run.mode == "drift"
    orbit = orbits.find(guess=run, spin=run.orbit.spin)
    for number in TOLD:
        if hasattr(orbit, number):
            assert getattr(orbit, number) == pytest.approx(getattr(run.orbit, number), rel=1e-4), number
    assert orbit.di_end == run.orbit.di_end
    assert orbit.spin_drift == pytest.approx(run.spin_drift, rel=2e-2)


def test_the_mirror_image_of_a_run_has_its_numbers():
    """Unlike ends with all that is theirs exchanged: what was told of p1 is told of p2."""
    scene = SCENES["unlike ends, sk_sp"]
    other = {name: name[:-1] + {"1": "2", "2": "1"}[name[-1]] for name in scene if name[-1] in "12"}
    image = {other.get(name, name): value for name, value in scene.items()} | {"beta0": -scene["beta0"]}
    run, mirrored = (simulate(**given, periods=100, record=False) for given in (scene, image))
    assert run.mode == mirrored.mode == "drift"
    for name in ("radius", "zeta", "speed", "impact_phase", "zeta_drift", "speed_drift"):
        assert getattr(mirrored.orbit, name) == pytest.approx(getattr(run.orbit, name), rel=1e-6, abs=1e-12), name
    assert mirrored.orbit.di_end == run.orbit.di_end == "sk_sp"  # the end that stays down comes first
    assert (mirrored.down_share_1, mirrored.longest_hop_1) == pytest.approx((run.down_share_2, run.longest_hop_2))
    assert (mirrored.down_share_2, mirrored.longest_hop_2) == pytest.approx((run.down_share_1, run.longest_hop_1))


def test_an_orbit_of_period_two_turns_as_its_path_does():
    run = simulate(Gamma=1.28, beta0=0.2564102564102564, periods=400, rtol=1e-11)
    assert run.mode_period == 2
    two = orbits.find(guess=run, periods=2)
    path = two.run(10, rtol=1e-11)
    theta = path.section()["theta"].values
    rate = (theta[-1] - theta[0]) * path.parameters["f"] / 10
    assert two.precession_rate == pytest.approx(rate, rel=2e-3)
    assert two.period == pytest.approx(TURN / abs(rate), rel=2e-3)
    assert two.radius == pytest.approx(two.speed / abs(rate), rel=2e-3)
    spins = [orbits.find(guess=two.run(periods, rtol=1e-11), periods=2).spin for periods in (10, 30)]
    assert two.spin_drift == pytest.approx((spins[1] - spins[0]) / 20, rel=0.02)
