"""Sustained spins over parameters: against those found afresh, plain families and runs, and closing like a square root."""

import numpy as np
import pytest

from dimersweep import names, orbits, sweep
from dimersweep.errors import OrbitError

DIMER = {"A_r": 5.0, "f": 22.0, "e": 0.65, "mu": 0.1, "mu_s": 0.15, "Gamma": 0.9}
CHOSEN = {"r": 4.7e-3, "A_r": 6.82, "f": 14.27, "e": 0.626, "mu": 0.111, "mu_s": 0.133, "Gamma": 0.866}


# two sustained spins of stable orbits, and a third one that grows out of a plane
THREE = {"r": 6.46e-3, "A_r": 7.339, "f": 19.49, "e": 0.563, "mu": 0.18, "mu_s": 0.35}


def of(parameters, **others):
    return {name: value for name, value in (parameters | others).items() if value is not None}


@pytest.fixture(scope="module")
def down():
    branch = orbits.follow(orbits.find(spin=86.0, **DIMER), "Gamma", to=0.6, sustained=True)
    return branch, int(np.flatnonzero(names(branch["special"]).values == "fold")[0])


@pytest.mark.parametrize("row", [0, 10, 20])
def test_each_spin_is_the_one_that_is_found_afresh(down, row):
    one = down[0].isel(point=row)
    spin = float(one["spin"])
    told = orbits.sustained(spin=(0.9 * spin, 1.2 * spin), **of(DIMER, Gamma=float(one["Gamma"])))
    assert told["spin"].values == pytest.approx([spin], rel=1e-7)
    assert float(one["slow_multiplier"]) - 1 == pytest.approx(float(told["slow_rate"][0]), rel=1e-4)


def test_two_spins_meet_at_a_fold_like_a_square_root_and_none_is_beyond(down):
    branch, fold = down
    Gamma, spin = branch["Gamma"].values, branch["spin"].values
    for side in (slice(fold - 6, fold - 1), slice(fold + 2, fold + 6)):
        slope, _ = np.polyfit(np.log(np.abs(spin[side] - spin[fold])), np.log(Gamma[side] - Gamma[fold]), 1)
        assert slope == pytest.approx(2, abs=0.1)
    other = orbits.follow(orbits.find(spin=float(spin[-1]), **DIMER), "Gamma", to=0.6).isel(point=-1)  # round the fold
    assert float(other["Gamma"]) == 0.9 and abs(float(other["spin_drift"])) < 1e-9 * spin[-1]
    with pytest.raises(OrbitError):
        orbits.sustained(spin=(100.0, 160.0), **of(DIMER, Gamma=Gamma[fold] - 2e-3))


def test_the_spin_of_a_plane_gives_way_to_one_on_either_side():
    branch = orbits.follow(orbits.find(spin=24.0, **of(DIMER, e=0.6)), "Gamma", to=1.2, sustained=True)
    fold = float(branch["Gamma"].values[names(branch["special"]).values == "fold"][0])
    told = [orbits.sustained(spin=(-60.0, 60.0), **of(DIMER, e=0.6, Gamma=fold + by)) for by in (-1e-2, -4e-2, 1e-2)]
    assert [one["attracts"].values.tolist() for one in told] == [[True, False, True], [True, False, True], [True]]
    assert float(told[1]["spin"][2] / told[0]["spin"][2]) == pytest.approx(2, rel=0.05)


def drift(spin, Gamma, dimer):
    return orbits.find(spin=spin, Gamma=Gamma, **dimer).spin_drift / spin


@pytest.mark.parametrize(
    ("dimer", "begin", "Gamma", "spins"),
    [
        (THREE, 36.05, 1.3195, np.linspace(32, 35, 7)),
        (of(DIMER, e=0.6, Gamma=None), 24.0, 0.9, np.geomspace(0.5, 2.5, 9)),
    ],
)
def test_two_spins_of_stable_orbits_meet_at_a_fold(dimer, begin, Gamma, spins):
    branch = orbits.follow(orbits.find(spin=begin, Gamma=Gamma, **dimer), "Gamma", to=1.33, sustained=True)
    assert branch["stable"].all()
    fold = branch.isel(point=int(np.flatnonzero(names(branch["special"]) == "fold")[0]))
    assert float(fold["slow_multiplier"]) == pytest.approx(1, abs=1e-10)
    # the drift over the spin touches zero there: above it has spins of both signs, beyond it falls at all
    before, beyond = ([drift(spin, float(fold["Gamma"]) + by, dimer) for spin in spins] for by in (-2e-5, 2e-5))
    assert max(before) > 0 > before[0] and before[-1] < 0
    assert max(beyond) < 0


def test_where_a_spin_falls_to_zero_is_where_a_plane_begins_to_attract():
    spin, plane = (
        orbits.follow(orbits.find(spin=begin, Gamma=Gamma, **THREE), "Gamma", to=1.32, sustained=True)
        for begin, Gamma in ((9.0, 1.312), (0.0, 1.3))
    )
    forks = [float(branch["Gamma"].values[names(branch["special"]) == "pitchfork"].item()) for branch in (spin, plane)]
    assert names(spin["special"])[-1] == "pitchfork" and spin.attrs["end"].startswith("plane")
    assert forks[0] == pytest.approx(forks[1], abs=1e-8)
    assert drift(0.3, forks[0] - 1e-5, THREE) > 0 > drift(0.3, forks[0] + 1e-5, THREE)
    start, fixed = orbits.find(spin=9.0, Gamma=1.312, **THREE), of(THREE, e=None)
    end = orbits.border("stable_to", "Gamma", over={"e": [0.563]}, start=start, sustained=True, **fixed)
    assert (names(end["ends_by"]).item(), float(end["Gamma"][0])) == ("pitchfork", pytest.approx(forks[0], abs=1e-8))


def test_pitchforks_are_a_border_where_the_drift_is_smooth():
    start = orbits.find(spin=0.0, Gamma=1.3, **THREE)
    border = orbits.border("pitchfork", "Gamma", over={"e": [0.563, 0.565]}, start=start, **of(THREE, e=None))
    there = float(border["Gamma"][1])
    assert drift(0.3, there - 1e-5, of(THREE, e=0.565)) > 0 > drift(0.3, there + 1e-5, of(THREE, e=0.565))
    with pytest.raises(OrbitError, match="slips through the turn of its slip"):
        orbits.border("pitchfork", "Gamma", over={"e": [0.6]}, **of(DIMER, e=None, Gamma=None))


def test_a_border_that_is_not_met_is_told():
    with pytest.raises(OrbitError, match="no hop"):
        orbits.border("hop", "Gamma", over={"e": [0.65]}, spin=86.0, sustained=True, **of(DIMER, e=None, Gamma=None))


def test_a_spin_leaves_where_its_family_ends_or_its_drift_leaps():
    for dimer, spin, end in (DIMER, 86.0, "the family ends"), (CHOSEN, 213.0, "the drift leaps over zero"):
        branch = orbits.follow(orbits.find(spin=spin, **dimer), "mu_s", to=0.4, sustained=True)
        assert branch.attrs["end"] == f"double_impact: {end}"
        last, beyond = float(branch["spin"][-1]), of(dimer, mu_s=1.01 * float(branch["mu_s"][-1]))
        try:
            drift = orbits.find(spin=last, guess=orbits.find(spin=last, **dimer), **beyond).spin_drift
        except OrbitError:
            drift = None
        assert drift is None if "ends" in end else abs(drift) > 1e-5 * last


@pytest.mark.slow
def test_a_fold_over_another_parameter_is_that_of_the_branch(down):
    fold, start = float(down[0]["Gamma"][down[1]]), orbits.find(spin=125.0, **of(DIMER, Gamma=0.705))
    asked = {"spin": 125.0, "start": start, "sustained": True, **of(DIMER, Gamma=None)}
    curve = orbits.border_curve("fold", "Gamma", "mu", span=(0.095, 0.105), points=4, **of(asked, mu=None))
    assert float(curve["Gamma"].values[curve["mu"].values == 0.1][0]) == pytest.approx(fold, abs=1e-7)
    end = orbits.border("stable_from", "Gamma", over={"e": [0.65]}, **of(asked, e=None))
    assert float(end["Gamma"][0]) == pytest.approx(fold, abs=1e-6)


def test_a_map_has_the_spin_that_each_point_chooses():
    grid = {"Gamma": [0.6, 0.9], "mu": [0.1]}
    cube = sweep(grid, of(DIMER, Gamma=None, mu=None), periods=200, sustained=True, progress=False, workers=2)
    assert cube["sustained"].values.tolist() == [[0], [2]]
    told = [float(cube[f"sustained_{name}"][1, 0]) for name in ("spin", "radius", "time")]
    assert told == pytest.approx([87.1111, 6.39880, 1 / (1.01546e-5 * 22)], rel=1e-5)
