"""Borders as curves in the plane of two parameters: their turns and meetings, against borders over values and closed forms."""

import numpy as np
import pytest

from dimersweep import orbits

# Gamma at which a hop of a ball that is thrown off lasts half a period
LINE = np.sqrt(1 + (np.pi / 2 - 2 / np.pi) ** 2)


def met(curve, name):
    """The one row of a curve in which it meets another border."""
    (at,) = np.flatnonzero(curve["meets"].values == name)
    return curve.isel(point=at)


@pytest.fixture(scope="module")
def hop():
    return orbits.border_curve("hop", "Gamma", "e", span=(0.38, 0.44), spin=100.0)


def test_a_curve_is_the_border_over_values_of_either_parameter():
    over = orbits.border_curve("flip", "Gamma", "e", span=(0.58, 0.62), spin=100.0)
    back = orbits.border_curve("flip", "e", "Gamma", span=(1.24, 1.28), spin=100.0)
    for curve in (over, back):
        assert curve["loses_stability"].all() and not curve.attrs["ends"].startswith("lost")
        some = curve.isel(point=slice(None, None, 3)).sortby("e")
        told = orbits.border("flip", "Gamma", over={"e": some["e"].values}, spin=100.0)
        assert told["Gamma"].values == pytest.approx(some["Gamma"].values, abs=2e-8)


def test_the_hop_turns_round_where_it_touches_the_fold(hop):
    """A ball that is thrown off at that line meets its fold at e = (pi - line)/(pi + line)."""
    fold = orbits.border_curve("fold", "Gamma", "e", span=(0.385, 0.4), spin=100.0)
    a, b = met(hop, "hop-fold"), met(fold, "fold-hop")
    for name in ("e", "Gamma"):
        assert float(a[name]) == pytest.approx(float(b[name]), abs=1e-6)
    assert float(a["e"]) == pytest.approx((np.pi - LINE) / (np.pi + LINE), abs=1e-3)
    assert float(met(hop, "turn e")["e"]) == pytest.approx(hop["e"].values.min(), abs=1e-9)


def test_after_its_turn_the_hop_is_one_of_the_unstable_orbit(hop):
    assert hop.attrs["ends"] == "; ".join(["e = 0.44 is reached"] * 2)
    assert {bool(hop["stable"][k]) for k in (0, -1)} == {True, False}
    upper = float(hop["Gamma"].where(hop["stable"]).sel(point=[0, hop.sizes["point"] - 1]).max())
    told = orbits.border("hop", "Gamma", over={"e": [0.44]}, spin=100.0)
    assert upper == pytest.approx(float(told["Gamma"][0]), abs=1e-6)
    sequences = [orbits.find(spin=100.0, e=0.44, Gamma=upper + by).sequence for by in (-1e-4, 1e-4)]
    assert "far.1" in sequences[1] and sequences[1].replace("far.1 ", "") == sequences[0]


def test_a_curve_of_hops_is_the_border_in_any_section():
    """The border is found in other sections, in which fixed points differ by more where the spin drifts slowly."""
    hop = orbits.border_curve("hop", "Gamma", "e", span=(0.63, 0.67), spin=100.0)
    some = hop.isel(point=slice(1, None, 4)).sortby("e")
    told = orbits.border("hop", "Gamma", over={"e": some["e"].values}, spin=100.0)
    assert some["Gamma"].values == pytest.approx(told["Gamma"].values, abs=1e-6)


def test_the_flip_and_the_hop_meet_where_one_passes_the_other():
    flip = orbits.border_curve("flip", "Gamma", "e", span=(0.54, 0.56), spin=100.0)
    place = met(flip, "flip-hop")
    assert (float(place["e"]), float(place["Gamma"])) == pytest.approx((0.549188, 1.360806), abs=2e-6)
    e = float(place["e"]) + np.array([-1e-5, 1e-5])
    flips, hops = (orbits.border(kind, "Gamma", over={"e": e}, spin=100.0)["Gamma"].values for kind in ("flip", "hop"))
    assert (flips > hops).tolist() == [True, False]
