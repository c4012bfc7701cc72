"""Curves along which the sequence changes, against orbits found on both sides of them."""

from functools import cache

import numpy as np
import pytest

from dimersweep import names, orbits
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.analysis.orbits.map.passage import rests, sides_of
from dimersweep.errors import OrbitError
from tests.checks.dimers import random_dimer
from tests.checks.tables import multipliers

pytestmark = pytest.mark.slow

# kind: fixed parameters, e, and how far from the border orbits found in sections of their own surely have its sequences
CURVES = {
    "stick_slip": ({"A_r": 6.0}, np.linspace(0.6, 0.64, 2), 2e-4),  # the same symbols on both sides, but other counts
    "chatter": ({"A_r": 8.0}, np.linspace(0.6, 0.66, 4), 5e-6),
    "double_impact": ({"A_r": 6.0}, np.linspace(0.5, 0.6, 3), 5e-5),
    "hop": (
        {"A_r": 6.0},
        np.linspace(0.46, 0.52, 4),
        5e-6,
    ),  # where the hop leaps over its line, and where an end grazes
}


@cache
def curve_of(kind):
    fixed, e, _ = CURVES[kind]
    return orbits.border(kind, "Gamma", over={"e": e}, spin=100.0, **fixed)


def found(curve, point, by):
    """An orbit beside the border, reached from one farther away; none, if it does not exist."""
    at = {"spin": 100.0, "e": float(point["e"]), "A_r": float(curve["A_r"])}
    Gamma = float(point["Gamma"])
    far = orbits.find(Gamma=Gamma + np.sign(by) * 2e-3, **at)
    try:
        return orbits.find(Gamma=Gamma + by, guess=far, **at)
    except OrbitError:
        return None


@pytest.mark.parametrize("kind", CURVES)
def test_orbits_found_beside_it_have_the_sequences_that_it_tells(kind):
    """Where the orbit leaps there may be none beyond for a little way."""
    curve = curve_of(kind)
    assert np.isfinite(curve["Gamma"]).all()
    for k in range(curve.sizes["e"]):
        point = curve.isel(e=k)
        count = int(np.isfinite(point["several"]).sum()) if "several" in curve else 0
        assert str(point["status"].values) == (f"one of {count}" if count else "ok")
        sequence = str(point["word"].values)
        beside = [found(curve, point, by) for by in (-CURVES[kind][2], CURVES[kind][2])]
        sequences = [orbit.sequence for orbit in beside if orbit is not None]
        assert sequences.count(sequence) == 1
        for beyond in set(sequences) - {sequence}:
            assert sides_of(sequence, beyond, BORDER_KINDS[kind].begins).described(sequence) == str(
                point["change"].values
            )


@pytest.mark.parametrize("kind", [kind for kind in CURVES if kind != "chatter"])
def test_its_multipliers_are_those_of_orbits_on_its_side(kind):
    """Across the border the map has a kink or leaps; near that of chatter there is another one."""
    curve, compared = curve_of(kind), 0
    for k in range(curve.sizes["e"]):
        point = curve.isel(e=k)
        beside = [found(curve, point, by) for by in (-2e-4, 2e-4)]
        (near,) = [orbit for orbit in beside if orbit is not None and orbit.sequence == str(point["word"].values)]
        side = np.sign(near.parameters["Gamma"] - float(point["Gamma"]))
        sizes, nearer = (np.sort(np.abs(one.multipliers)) for one in (near, found(curve, point, side * 5e-5)))
        if kind == "hop" and np.abs(sizes - nearer).max() > 5e-3:
            continue  # the rest of p1 between two hops shrinks to nothing: they have no limit there
        told = np.sort(np.abs(multipliers(point)))[-sizes.size :]
        assert np.abs(told - sizes).max() < 5e-3
        compared += 1
    assert compared >= curve.sizes["e"] - 1


def test_a_curve_is_smooth_where_its_change_is_the_same():
    assert np.abs(np.diff(curve_of("chatter")["Gamma"].values, 3)).max() < 2e-4


SHORT = {"r": 3e-3, "A_r": 26 / 6, "mu": 0.3, "f": 30.0}


@cache
def hop(*e, **fixed):
    return orbits.border("hop", "Gamma", over={"e": list(e)}, spin=100.0, **fixed)


@pytest.mark.parametrize("scene", [{}, SHORT], ids=["base case", "a short dimer"])
def test_a_border_of_a_bouncing_motion_is_the_same_over_any_grid_and_says_that_there_are_more(scene):
    """From e = 0.69 on both ends bounce on, and their hops pass half a period at many values of Gamma.

    All of them lie beyond where an end last comes to rest, which is the point that is told.
    """
    alone, along = hop(0.7, **scene), hop(0.65, 0.7, **scene)
    assert float(alone["Gamma"][0]) == pytest.approx(float(along["Gamma"][1]), abs=1e-9)
    assert str(along["status"][0].values) == "ok"
    for one in (alone["status"][0], along["status"][1]):
        assert str(one.values) == "several beyond, of motions that come to no rest"
    Gamma = float(alone["Gamma"][0])
    branch = orbits.follow(orbits.find(Gamma=1.0, e=0.7, spin=100.0, **scene), "Gamma", to=Gamma + 0.01)
    rests = np.char.find(branch["word"].values.astype(str), "SC1") >= 0
    assert Gamma - 1e-3 < branch["Gamma"].values[rests].max() < Gamma + 1e-5  # the short one leaps before


# scene, values of e, and lists of them in which each has to be the border that it is alone
ORDERS = {
    "a short dimer": (SHORT, [0.65, 0.67, 0.7], [[0.7, 0.67, 0.65]]),
    "base case": ({}, [0.65, 0.7], [[0.7, 0.65]]),
    "a corner of the curve": ({}, [0.49, 0.5], [[0.5, 0.49, 0.47], [0.45, 0.5]]),
}


@pytest.mark.parametrize(
    "scene",
    [
        "a corner of the curve",
        *(pytest.param(each, marks=pytest.mark.release) for each in ("a short dimer", "base case")),
    ],
)
def test_a_border_is_the_same_alone_and_in_any_list_in_any_order(scene):
    fixed, values, lists = ORDERS[scene]
    alone = {e: hop(e, **fixed).isel(e=0) for e in values}
    for order in lists:
        told = hop(*order, **fixed)
        for e in set(order) & set(alone):
            row = told.isel(e=order.index(e))
            assert float(row["Gamma"]) == pytest.approx(float(alone[e]["Gamma"]), abs=1e-6)
            assert str(row["status"].values) == str(alone[e]["status"].values)
            if "several" in alone[e]:
                assert row["several"].values[:3] == pytest.approx(alone[e]["several"].values, abs=1e-6)


def test_three_hops_of_one_motion_are_numbered():
    """The hop of p1 passes its line, falls below it again, and leaps across it where its first bounce grazes the plate."""
    told = hop(0.49).isel(e=0)
    assert str(told["status"].values) == "one of 3" and float(told["Gamma"]) in told["several"].values
    orbit, at, sequences = orbits.find(spin=100.0, e=0.49, Gamma=1.32), told["several"].values, []
    for Gamma in (1.345, at[0] - 1e-5, at[0] + 1e-5, at[1] - 1e-5, at[1] + 1e-5, at[2] - 1e-5, at[2] + 1e-5):
        orbit = orbits.find(guess=orbit, Gamma=float(Gamma))
        sequences.append("far.1" in orbit.sequence)
    assert sequences == [False, False, True, True, False, False, True]


@pytest.mark.parametrize("kind", ["word", "lift_off"])
def test_changes_that_a_motion_has_at_several_values_are_all_told(kind):
    """A branch passes the same ones."""
    e = 0.6
    alone = orbits.border(kind, "Gamma", over={"e": [e]}, spin=100.0)
    along = orbits.border(kind, "Gamma", over={"e": [e - 0.05, e]}, spin=100.0)
    assert float(alone["Gamma"][0]) == pytest.approx(float(along["Gamma"][1]), abs=1e-9)
    several = alone["several"].values[0]
    assert float(alone["Gamma"][0]) in several and (np.diff(several) > 0).all()
    assert str(alone["status"][0].values) == str(along["status"][1].values) == f"one of {several.size}"
    base, values = orbits.find(spin=100.0), []
    for to in (0.78, 1.28):
        branch = orbits.follow(base, "Gamma", to=to)
        stable = np.cumprod(branch["stable"].values.astype(bool)).astype(bool)
        met = names(branch["special" if kind == "word" else "change"]).values == kind
        values += branch["Gamma"].values[met & stable].tolist()
    within = [value for value in several if value < 1.264]  # up to the flip, beyond which the last step may lead
    assert sorted(value for value in values if value < 1.264) == pytest.approx(within, abs=1e-4)  # in other sections


def test_a_warm_point_of_a_hop_costs_little():
    """Between the corners of the curve, where the hop leaps (e = 0.48) and where both ends begin to bounce on (e = 0.69)."""
    curve = orbits.border("hop", "Gamma", over={"e": np.linspace(0.5, 0.68, 19)}, spin=100.0)
    cost = np.sort(curve["cost"].values)
    assert cost[-3] <= 120  # the first is not warm, nor one beyond the corner at 0.51
    assert np.median(cost) <= 40


def test_the_sides_of_a_change_are_told_by_what_comes_and_goes():
    sides = sides_of("DI_sp_sp chatter.1 SC1_sp.1", "DI_sp_sp>DI_sp_sk chatter.1 SC1_sp.1")
    assert sides.described("DI_sp_sp") == "-DI_sp_sp +DI_sp_sp>DI_sp_sk"
    assert sides.here("DI_sp_sp FM") and sides.beyond("DI_sp_sp>DI_sp_sk>DI_sk_sk FM")
    assert not sides.beyond("DI_sp_sp FM")


def test_the_sides_of_a_change_are_told_by_counts_where_nothing_comes_or_goes():
    sides = sides_of("DI_sp_sp SC1_sp.1 SC1_sk.1 SC1_sp.1 SC1_sk.1 SC1_sp.1", "DI_sp_sp SC1_sp.1 SC1_sk.1 SC1_sp.1")
    assert sides.described("DI_sp_sp SC1_sp.1") == "+SC1_sk.1 +SC1_sp.1"
    neither = "DI_sp_sp SC1_sk.1 SC1_sp.1 SC1_sk.1 SC1_sp.1"
    assert not sides.here(neither) and not sides.beyond(neither)


def test_the_sides_of_a_change_are_told_by_pairs_where_counts_are_equal():
    sides = sides_of("DI_sp_sp SC1_sp.1 SC1_sk.1", "DI_sp_sp SC1_sk.1 SC1_sp.1")
    assert sides.here("DI_sp_sp SC1_sp.1 SC1_sk.1") and sides.beyond("DI_sp_sp SC1_sk.1 SC1_sp.1")
    assert "-SC1_sp.1/SC1_sk.1" in sides.described("DI_sp_sp SC1_sp.1 SC1_sk.1")


def test_an_event_that_comes_to_the_section_of_a_branch_is_not_where_its_motion_comes_to_no_rest():
    """At e = 0.72 p1 no longer sticks at the section of the branch from Gamma = 1.1919 on, but still comes to rest."""
    Gamma = float(hop(0.72, **SHORT)["Gamma"][0])
    inside = orbits.find(Gamma=1.21, e=0.72, spin=100.0, **SHORT)
    for by, at_rest in ((-1e-3, True), (-1e-4, True), (2e-3, False)):
        assert rests(orbits.find(guess=inside, Gamma=Gamma + by).sequence) == at_rest


def test_changes_are_listed_beyond_where_an_orbit_leaps_to_another_contact():
    """From Gamma = 0.698 on its p1 slips as long as it is down: no section is left in which it sticks on both sides."""
    dimer = random_dimer(67)
    rest = {name: value for name, value in dimer.items() if name != "e"}
    slips, bounces = (
        orbits.border(kind, "Gamma", over={"e": [dimer["e"]]}, **rest).isel(e=0) for kind in ("stick_slip", "chatter")
    )
    assert str(slips["status"].values) == "ok" and str(slips["change"].values) == "-SC1_sk.1"
    assert not slips["loses_stability"]
    assert str(bounces["status"].values) == "one of 2"
    before, beyond = orbits.find(Gamma=0.69, **dimer), orbits.find(Gamma=0.7, **dimer)
    at, then = float(slips["Gamma"]), float(bounces["Gamma"])
    sequences = [
        orbits.find(guess=guess, **dimer | {"Gamma": Gamma}).sequence
        for guess, Gamma in ((before, at - 1e-5), (beyond, at + 1e-5), (None, then - 2e-4), (None, then + 2e-4))
    ]
    assert ["SC1_sk.1" in sequence for sequence in sequences] == [True, False, False, False]
    assert ["bounces.2" in sequence for sequence in sequences] == [False, False, False, True]
    over = orbits.find(guess=before, Gamma=at + 1e-5)
    assert over.sequence == sequences[1] and "SC1_sk.1" in before.sequence
