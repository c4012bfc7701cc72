"""Borders at which a stable orbit loses its stability: crossed on both sides, and against closed forms and runs."""

import numpy as np
import pytest

from dimersweep import names, orbits, simulate
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.errors import OrbitError
from tests.checks.dimers import crossed, random_dimer
from tests.checks.tables import multipliers

FIRST, LAST = 1, 8  # of the random dimers; `benchmarks/evidence/borders_random.py` judges more
QUICK = 4  # of these in each run of the tests


def dimer_without_e(dimer):
    """The parameters of a dimer that a border over e is given."""
    return {name: value for name, value in dimer.items() if name != "e"}


def carried(run, dimer, Gamma, periods):
    """The run of a dimer that goes on from the end of another one."""
    parameters = {name: value for name, value in dimer.items() if name != "spin"} | {"Gamma": Gamma}
    return simulate(start=run.states(run.duration), periods=periods, rtol=1e-9, **parameters)


@pytest.mark.parametrize(
    "seed",
    [*range(FIRST, QUICK + 1), *(pytest.param(seed, marks=pytest.mark.release) for seed in range(QUICK + 1, LAST))],
)
def test_a_random_dimer_drifts_between_its_fold_and_the_end_of_its_stability(seed):
    dimer = random_dimer(seed)
    over, rest = {"e": [dimer["e"]]}, dimer_without_e(dimer)
    fold, end = (orbits.border(kind, "Gamma", over=over, **rest).isel(e=0) for kind in ("fold", "stable_to"))
    assert fold["loses_stability"] and end["loses_stability"]
    inner, outer = crossed(dimer, float(fold["Gamma"]), -1)
    assert inner == "stable" and outer in ("none", "another motion")
    inner, outer = crossed(dimer, float(end["Gamma"]), 1)
    assert inner == "stable" and outer in ("unstable", "none")


@pytest.mark.parametrize(("seed", "Gamma"), [(1, 1.22200992), pytest.param(45, 1.13401395, marks=pytest.mark.release)])
def test_a_flip_beyond_changes_of_section_and_of_the_sense_of_the_parameter_is_found(seed, Gamma):
    """Where the section is changed the sense of the branch is that of a motion a little ahead, not that of the parameter."""
    dimer = random_dimer(seed)
    flip = orbits.border("flip", "Gamma", over={"e": [dimer["e"]]}, **dimer_without_e(dimer)).isel(e=0)
    assert flip["Gamma"] == pytest.approx(Gamma, abs=1e-7)
    assert flip["loses_stability"]


def test_the_ends_of_stability_of_the_base_case_are_its_fold_and_its_flip():
    e = [0.55, 0.6, 0.7]
    for kind, end in (("fold", "stable_from"), ("flip", "stable_to")):
        told, found = (orbits.border(name, "Gamma", over={"e": e}, spin=100.0) for name in (kind, end))
        assert (names(found["ends_by"]) == kind).all() and told["loses_stability"].all()
        assert found["Gamma"].values == pytest.approx(told["Gamma"].values, abs=1e-7)


def test_the_ends_of_stability_of_a_long_light_rod_that_slips_are_those_of_a_ball():
    """Without mass in the rod and with little friction the ends are two balls."""
    light = {"A_r": 100.0, "rho_r": 0.0, "mu": 0.01, "mu_s": 0.01, "spin": 1e-3}
    for end, ball in (("stable_from", ball_fold), ("stable_to", ball_flip)):
        found = orbits.border(end, "Gamma", over={"e": [0.6]}, **light)
        assert float(found["Gamma"][0]) == pytest.approx(ball(0.6), abs=2e-4)


# Its end that is down no longer comes to rest in time beyond Gamma = 1.2292
CHATTERS = random_dimer(1)


def test_a_drift_may_end_where_an_end_no_longer_comes_to_rest():
    end = orbits.border("stable_to", "Gamma", over={"e": [CHATTERS["e"]]}, **dimer_without_e(CHATTERS)).isel(e=0)
    Gamma = float(end["Gamma"])
    assert str(names(end["ends_by"]).values) == "chatter"
    assert np.abs(multipliers(end)).max() < 0.9
    run = orbits.find(Gamma=Gamma - 1e-3, **CHATTERS).run(400, rtol=1e-10)
    assert run.orbit or run.mode_period == 1
    assert carried(run, CHATTERS, Gamma + 1e-2, 800).mode_period != 1


def test_where_the_end_that_is_down_begins_to_slip_the_orbit_leaps_a_little_and_stays_stable():
    """Just above Gamma = 0.698 it slips as long as it is down, and runs drift on up to a flip."""
    dimer = random_dimer(67)
    end = orbits.border("stable_to", "Gamma", over={"e": [dimer["e"]]}, **dimer_without_e(dimer)).isel(e=0)
    assert str(names(end["ends_by"]).values) == "flip"
    low = orbits.find(Gamma=0.697, **dimer)
    run = carried(low.run(50), dimer, 0.7, 200)
    drifting = orbits.find(guess=run, spin=dimer["spin"])
    assert "SC1_sk.1" in low.sequence and "SC1_sk.1" not in drifting.sequence and drifting.stable
    assert crossed(dimer, float(end["Gamma"]), 1) == ("stable", "unstable")


def test_a_branch_keeps_its_sense_where_its_section_changes_and_the_parameter_moves_the_gap():
    """At A_r = 4.03 the section changes: the branch once turned back there, and a border above was told as the one below."""
    branch = orbits.follow(orbits.find(spin=100.0, Gamma=0.9, f=20.0, A_r=6.0), "A_r", to=4.0)
    assert branch.attrs["end"].startswith("to:") and (np.diff(branch["A_r"]) < 0).all()
    low = orbits.border("stable_from", "A_r", over={"e": [0.6, 0.605]}, spin=100.0, Gamma=0.85)
    assert low["A_r"].values == pytest.approx([3.531165, 3.244917], abs=1e-5)
    for e, A_r in zip(low["e"].values, low["A_r"].values, strict=True):
        assert orbits.find(spin=100.0, Gamma=0.85, e=float(e), A_r=1.1 * float(A_r)).stable
        with pytest.raises(OrbitError):
            orbits.find(spin=100.0, Gamma=0.85, e=float(e), A_r=0.98 * float(A_r))


def test_an_orbit_that_is_stable_but_that_no_run_comes_to_is_none_that_goes_on():
    """Beyond the leap there is one at a distance of 0.15, but runs from the last orbit settle on a motion of period 3."""
    dimer = random_dimer(19)
    end = orbits.border("stable_to", "Gamma", over={"e": [dimer["e"]]}, **dimer_without_e(dimer)).isel(e=0)
    Gamma = float(end["Gamma"])
    run = orbits.find(Gamma=Gamma - 2e-4, **dimer).run(400)
    assert run.mode == "drift"
    assert carried(run, dimer, Gamma + 1e-3, 400).mode_period == 3


def test_a_flip_of_orbits_that_are_unstable_already_says_so():
    dimer = random_dimer(8)
    over, rest = {"e": [dimer["e"]]}, dimer_without_e(dimer)
    flip, end = (orbits.border(kind, "Gamma", over=over, **rest).isel(e=0) for kind in ("flip", "stable_to"))
    assert not flip["loses_stability"]
    assert float(flip["Gamma"]) > float(end["Gamma"])
    sizes = np.abs(multipliers(flip))
    assert sizes.max() > 1.1 and np.abs(multipliers(flip) + 1).min() < 1e-2


def test_where_there_is_no_stable_orbit_it_is_said():
    with pytest.raises(OrbitError, match="no stable orbit was found"):
        orbits.border("stable_to", "Gamma", over={"e": [0.05]}, spin=100.0)


@pytest.mark.parametrize(
    ("kind", "parameter", "over", "given", "end"),
    [
        ("stable_to", "mu", {"e": [0.6]}, {"spin": 120.0, "f": 20.0, "mu_s": 0.3}, "mu = 0.3"),
        ("stable_from", "mu_s", {"e": [0.6]}, {"spin": 100.0, "mu": 0.2}, "mu_s = 0.2"),
        ("stable_to", "e", {"f": [20.0]}, {"spin": 100.0, "Gamma": 0.5}, "e = 1"),
    ],
)
def test_the_end_of_what_a_parameter_may_be_is_no_border(kind, parameter, over, given, end):
    told = f"no end of stability was found; the orbit is stable up to {end}, the end of its range"
    with pytest.raises(OrbitError, match=told):
        orbits.border(kind, parameter, over=over, **given)


@pytest.mark.parametrize(
    ("last", "passes"),
    [
        (0.204, [("flip", "stick_slip")]),
        # the second one amid others nearby
        pytest.param(0.22, [("flip", "stick_slip"), ("stick_slip", "chatter")], marks=pytest.mark.release),
    ],
)
def test_where_the_end_of_stability_passes_to_another_kind_is_located(last, passes):
    dimer = random_dimer(1) | {"mu_s": 0.4}
    del dimer["mu"]
    ends = orbits.border("stable_to", "Gamma", over={"mu": [0.2, last]}, **dimer)
    assert names(ends["ends_by"]).values.tolist() == [passes[0][0], passes[-1][1]]
    assert [tuple(meets.split("-")) for meets in ends["meets"].values.tolist()] == passes
    mu, Gamma = (float(ends[f"{name}_at_meeting"][0]) for name in ("mu", "Gamma"))
    assert 0.2 < mu < last
    for by, kind in zip((-1e-4, 1e-4), passes[0], strict=True):
        end = orbits.border("stable_to", "Gamma", over={"mu": [mu + by]}, **dimer).isel(mu=0)
        assert names(end["ends_by"]) == kind
        assert float(end["Gamma"]) == pytest.approx(Gamma, abs=1e-3)
