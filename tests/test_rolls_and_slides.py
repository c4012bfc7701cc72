"""A dimer whose ends both stay down rests, rolls or slides: closed forms of its speed, and the same word however it is run."""

import numpy as np
import pytest

from dimersweep import simulate
from tests.checks.data import data

pytestmark = pytest.mark.jit
# without a rod they roll as if they had 7/5 of their mass
BALLS = {"beta0": 0.0, "xdot0": 0.0, "D_r": 0.0, "periods": 60, "record": False}


def both_of(**scene):
    """The run that may stop and the whole one."""
    return [simulate(**scene, stop_when_settled=settle) for settle in (True, False)]


def gained(scene, mode):
    """Speed that a dimer has gained in the last ten of its periods, which it has in that mode however it is run."""
    stopped, whole = both_of(**scene)
    assert stopped.mode == whole.mode == mode
    assert stopped.end_speed == whole.end_speed
    assert whole.change_ahead == 0
    return whole.end_speed - simulate(**scene | {"periods": scene["periods"] - 10}).end_speed


@pytest.mark.parametrize(
    "scene",
    [{"tilt": 0.05}, {"tilt": 1e-6}, {"tilt": 0.15, "azimuth": 0.4, "theta0": -0.3, "phi0": np.pi / 2, "Gamma": 0.2}],
    ids=["as given", "hardly at all", "askew"],
)
def test_a_dimer_rolls_down_a_slope_as_balls_do(scene):
    scene = BALLS | {"f": 15, "Gamma": 0.5} | scene
    across = np.sin(scene["tilt"]) * np.cos(scene.get("azimuth", 0.0) - scene.get("theta0", 0.0))
    assert gained(scene, "rolls") == pytest.approx(9.81 * across / 1.4 * 10 / scene["f"], rel=1e-7)


@pytest.mark.parametrize("mu", [0.0, 0.05])
@pytest.mark.parametrize("tilt", [0.1, 0.6])
def test_a_dimer_slides_down_a_slope_that_does_not_hold_it(mu, tilt):
    """Its axis points downhill; over a whole period the plate presses as hard as one that does not move."""
    scene = BALLS | {"f": 15, "Gamma": 0.5, "theta0": -np.pi / 2, "tilt": tilt, "mu": mu, "mu_s": mu}
    fall = 9.81 * (np.sin(tilt) - mu * np.cos(tilt))
    assert gained(scene, "slides") == pytest.approx(fall * 10 / 15, rel=1e-7)


def test_a_slide_on_a_level_plate_lasts_until_friction_has_ended_it():
    scene = {"Gamma": 0.5, "mu": 0.02, "mu_s": 0.02, "xdot0": 3.0, "record": False}
    for periods, mode in ((40, "slides"), (300, "rest")):
        stopped, whole = both_of(**scene, periods=periods)
        assert stopped.mode == whole.mode == mode
        assert stopped.end_speed == pytest.approx(whole.end_speed, rel=1e-12)
    assert 40 < stopped.n_periods < 100
    unheld = simulate(**scene | {"mu": 0.0, "mu_s": 0.0}, periods=60)
    assert (unheld.mode, unheld.end_speed) == ("slides", pytest.approx(3.0, rel=1e-2))


@pytest.mark.parametrize("scene", data("scenes")["resting"].values(), ids=data("scenes")["resting"])
def test_what_keeps_its_speed_rests(scene):
    stopped, whole = both_of(**BALLS | {"Gamma": 0.5, "periods": 300} | scene)
    assert stopped.mode == whole.mode == "rest"
    assert stopped.end_speed == pytest.approx(whole.end_speed, rel=1e-6, abs=1e-7)
    assert stopped.n_periods < 40


@pytest.mark.parametrize("sideways", [{"tilt": 0.02}, {"Gamma_x": 0.1}], ids=str)
def test_a_cone_whose_speed_goes_with_its_heading_rolls(sideways):
    stopped, whole = both_of(**BALLS | {"Gamma": 0.5, "r_1": 5e-3, "r_2": 6e-3, "xdot0": 0.2} | sideways)
    assert stopped.mode == whole.mode == "rolls"
    assert stopped.end_speed == whole.end_speed
