"""Borders at which a stable orbit loses its stability: crossed on both sides, and against closed forms and runs."""

import numpy as np
import pytest

from dimersweep import orbits, simulate
from dimersweep.errors import OrbitError
from dimersweep.orbits.ball import ball_flip, ball_fold
from tests.checks.dimers import crossed, random_dimer

FIRST, LAST = 1, 8  # of the random dimers; `benchmarks/evidence/borders_random.py` judges more


@pytest.mark.parametrize("seed", range(FIRST, LAST))
def test_a_random_dimer_drifts_between_its_fold_and_the_end_of_its_stability(seed):
    dimer = random_dimer(seed)
    over, rest = {"e": [dimer["e"]]}, {name: value for name, value in dimer.items() if name != "e"}
    fold, end = (orbits.border(kind, "Gamma", over=over, **rest).isel(e=0) for kind in ("fold", "stable_to"))
    assert fold["loses_stability"] and end["loses_stability"]
    inner, outer = crossed(dimer, float(fold["Gamma"]), -1)
    assert inner == "stable" and outer in ("none", "another motion")
    inner, outer = crossed(dimer, float(end["Gamma"]), 1)
    assert inner == "stable" and outer in ("unstable", "none")


def test_the_ends_of_stability_of_the_base_case_are_its_fold_and_its_flip():
    e = [0.55, 0.6, 0.7]
    for kind, end in (("fold", "stable_from"), ("flip", "stable_to")):
        told, found = (orbits.border(name, "Gamma", over={"e": e}, spin=100.0) for name in (kind, end))
        assert (found["ends_by"] == kind).all() and told["loses_stability"].all()
        assert found["Gamma"].values == pytest.approx(told["Gamma"].values, abs=1e-7)


def test_the_ends_of_stability_of_a_long_light_rod_that_slips_are_those_of_a_ball():
    """Without mass in the rod and with little friction the ends are two balls."""
    light = {"A_r": 100.0, "rho_r": 0.0, "mu": 0.01, "mu_s": 0.01, "spin": 1e-3}
    for end, ball in (("stable_from", ball_fold), ("stable_to", ball_flip)):
        found = orbits.border(end, "Gamma", over={"e": [0.6]}, **light)
        assert float(found["Gamma"][0]) == pytest.approx(ball(0.6), abs=2e-4)


# Its end that is down no longer comes to rest in time beyond Gamma = 1.2292
CHATTERS = {name: value for name, value in random_dimer(1).items() if name != "e"}
CHATTERS_E = random_dimer(1)["e"]


def test_a_drift_may_end_where_an_end_no_longer_comes_to_rest():
    end = orbits.border("stable_to", "Gamma", over={"e": [CHATTERS_E]}, **CHATTERS).isel(e=0)
    Gamma = float(end["Gamma"])
    assert str(end["ends_by"].values) == "chatter"
    assert np.abs(end["multipliers"].values).max() < 0.9
    at = CHATTERS | {"e": CHATTERS_E}
    inside = orbits.find(Gamma=Gamma - 1e-3, **at)
    run = inside.run(400, rtol=1e-10)
    assert run.orbit is not None or run.mode_period == 1
    parameters = {name: value for name, value in at.items() if name != "spin"} | {"Gamma": Gamma + 1e-2}
    beyond = simulate(start=run.states(run.duration), periods=800, rtol=1e-10, **parameters)
    assert beyond.mode_period != 1


def test_a_flip_of_orbits_that_are_unstable_already_says_so():
    dimer = random_dimer(8)
    over, rest = {"e": [dimer["e"]]}, {name: value for name, value in dimer.items() if name != "e"}
    flip, end = (orbits.border(kind, "Gamma", over=over, **rest).isel(e=0) for kind in ("flip", "stable_to"))
    assert not flip["loses_stability"]
    assert float(flip["Gamma"]) > float(end["Gamma"])
    sizes = np.abs(flip["multipliers"].values)
    assert sizes.max() > 1.1 and np.abs(flip["multipliers"].values + 1).min() < 1e-2


def test_where_there_is_no_stable_orbit_it_is_said():
    with pytest.raises(OrbitError, match="no stable orbit was found"):
        orbits.border("stable_to", "Gamma", over={"e": [0.05]}, spin=100.0)
