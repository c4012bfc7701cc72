"""Grazing: where an end begins to strike, and where a sequence changes at a leap, against orbits found on both sides."""

import numpy as np
import pytest

from dimersweep import names, orbits
from dimersweep.analysis.orbits.continuation.branch import least_gap
from dimersweep.analysis.orbits.continuation.events import NO_GAP
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.errors import OrbitError

GRAZING = {"A_r": 7.0, "e": 0.46}  # p1 begins to strike on its way down, and its hop falls from 0.529 to 0.455 periods
LEAP = {"A_r": 7.0, "e": 0.59}  # p1 is so far off the plate that p2 strikes alone, and the map leaps


def gap_of(orbit):
    return least_gap(orbit.fixed.map, orbit.fixed.passage)


def hop_of(orbit):
    return orbit.fixed.passage.hops[0] / TURN


@pytest.fixture(scope="module")
def misses():
    """An orbit on which p1 just misses the plate."""
    return orbits.find(spin=100.0, Gamma=1.345, **GRAZING)


@pytest.fixture(scope="module")
def curve():
    return orbits.border(
        "hop", "Gamma", over={"e": np.linspace(0.45, 0.47, 6)}, spin=100.0, A_r=7.0,
        start=orbits.find(spin=100.0, Gamma=1.33, **GRAZING),
    )  # fmt: skip


def test_the_least_gap_is_that_of_a_dense_sample(misses):
    m = misses.fixed.map
    states = misses.run(1).states(np.linspace(0.0, 1.0, 4001) / misses.parameters["f"])
    gaps, rates = states["gap_1"].values / m.section.units[0], states["gap_1_rate"].values
    inner = (gaps[1:-1] < gaps[:-2]) & (gaps[1:-1] < gaps[2:]) & (np.abs(rates[1:-1]) < 5e-4)  # faster: an impact
    turns = gaps[1:-1][inner & (gaps[1:-1] > 1e-4)]  # less: the end of a chatter
    assert gap_of(misses) == pytest.approx(turns.min(), rel=1e-3)


def test_the_border_is_where_the_gap_of_orbits_beside_it_closes(curve):
    near = curve.sel(e=0.458, method="nearest")
    Gamma, e = float(near["Gamma"]), float(near["e"])
    beside = Gamma + 1e-4 * np.arange(1, 6)
    gaps = [gap_of(orbits.find(spin=100.0, A_r=7.0, e=e, Gamma=value)) for value in beside]
    zero = np.roots(np.polyfit(beside - Gamma, gaps, 3))
    assert np.abs(zero).min() < 1e-8


def test_the_hop_leaps_over_its_line_at_the_border(curve):
    assert (curve["status"] == "ok").all()
    for e, Gamma in zip(curve["e"].values, curve["Gamma"].values, strict=True):
        on = {"spin": 100.0, "A_r": 7.0, "e": float(e)}
        below, above = (hop_of(orbits.find(Gamma=Gamma + by, **on)) for by in (-1e-5, 1e-5))
        assert below < 0.49 < 0.51 < above


def test_a_warm_point_where_an_end_grazes_costs_little(curve):
    first = curve.sizes["e"] // 2 - 1  # which is not warm
    assert np.delete(curve["cost"].values, first).max() <= 120


def test_a_branch_meets_the_graze_from_both_sides_at_one_place(misses):
    below = orbits.find(spin=100.0, Gamma=1.335, **GRAZING)
    up = orbits.follow(below, "Gamma", to=1.345)
    down = orbits.follow(misses, "Gamma", to=1.335)
    values = [float(branch["Gamma"][names(branch["special"]) == "word"][0]) for branch in (up, down)]
    assert values[0] == pytest.approx(values[1], abs=1e-8)
    assert names(up["change"]).values[names(up["special"]).values == "word"].tolist() == ["hop"]


def test_orbits_exist_up_to_a_leap_and_not_beyond():
    below = orbits.find(spin=100.0, Gamma=1.2825, **LEAP)
    branch = orbits.follow(below, "Gamma", to=1.2836)
    Gamma = float(branch["Gamma"][names(branch["special"]) == "word"][-1])
    assert Gamma == pytest.approx(1.28320835, abs=2e-8)
    inside = orbits.find(spin=100.0, Gamma=Gamma - 1e-6, guess=below, **LEAP)
    assert inside.sequence.startswith("DI")
    with pytest.raises(OrbitError):
        orbits.find(spin=100.0, Gamma=Gamma + 1e-6, guess=inside, **LEAP)


def test_no_gap_is_told_where_no_end_turns():
    orbit = orbits.find(spin=100.0, Gamma=1.33, **GRAZING)
    assert gap_of(orbit) == np.inf
    assert NO_GAP < gap_of(orbits.find(spin=100.0, Gamma=1.341, **GRAZING)) < 1e-3
