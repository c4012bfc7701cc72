"""How a period doubles at a flip: its coefficient, against closed forms and the doubled orbit itself."""

from dataclasses import replace

import numpy as np
import pytest

from dimersweep import orbits
from dimersweep.analysis.orbits.borders import bifurcation_curve
from dimersweep.analysis.orbits.borders.bifurcation_curve import DOUBLED_FOLD, BifurcationCurve, doubling
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.analysis.orbits.map.finding import checked
from dimersweep.analysis.orbits.map.lost import OrbitLost
from dimersweep.analysis.orbits.map.solution import newton


class KnownMap:
    def __init__(self, formula):
        self.formula = formula

    def images(self, points):
        return np.array([self.formula(*z) for z in points])


def fixed_point(m, z):
    return newton(lambda z: (m.passage(z).point - z, None), z, lambda z: m.jacobian(z)[0] - np.eye(z.size), 1e-11)[0]


@pytest.mark.parametrize(("b", "c"), [(0.7, 0.3), (0.7, -0.9), (0.0, -0.2)])
def test_the_coefficient_of_a_map_of_the_line_is_known(b, c):
    """Of x -> -x + b x^2 + c x^3 it is c + b^2: the doubling is subcritical where that is negative."""
    found = doubling(KnownMap(lambda x: (-x + b * x**2 + c * x**3,)), np.zeros(1), np.array([[-1.0]]))
    assert found == pytest.approx(c + b**2, rel=1e-4)


def test_the_coefficient_of_henons_map_is_known():
    """At a = 3 (1 - b)^2/4, x = (1 - b)/2a it is a^2/(1 - b^4)."""
    b = 0.3
    a = 3 * (1 - b) ** 2 / 4
    x = (1 - b) / (2 * a)
    henon = KnownMap(lambda x, y: (1 - a * x**2 + y, b * x))
    found = doubling(henon, np.array([x, b * x]), np.array([[-2 * a * x, 1.0], [b, 0.0]]))
    assert found == pytest.approx(a**2 / (1 - b**4), rel=1e-4)


def test_across_a_change_of_contacts_there_is_none():
    bent = KnownMap(lambda x: (-x + 0.5 * max(x - 5e-4, 0.0),))
    assert np.isnan(doubling(bent, np.zeros(1), np.array([[-1.0]])))


def test_derivatives_that_are_no_numbers_are_told():
    with pytest.raises(OrbitLost, match="of no use"):
        doubling(KnownMap(lambda x: (x,)), np.zeros(1), np.array([[np.nan]]))


@pytest.mark.parametrize("e", [0.62, 0.72])
def test_the_orbit_of_twice_the_period_leaves_the_flip_as_its_coefficient_says(e):
    """Where a multiplier is -1 - m, x -> -(1 + m) x + c x^3 has the two points x = +-sqrt(m/c)."""
    flip = BifurcationCurve(BORDER_KINDS["flip"], "Gamma", checked({"e": e}), 100.0, 1e-12).point({}, [], None)
    m = flip.begin.map
    beyond = replace(m, parameters=m.parameters | {"Gamma": flip.value + 1e-4})
    one = fixed_point(beyond, flip.begin.z)
    values, vectors = np.linalg.eig(beyond.jacobian(one)[0])
    k = int(np.argmin(np.abs(values + 1)))
    v, away = vectors[:, k].real, -1 - values[k].real
    x = np.sqrt(away / flip.begin.doubling)
    twice = replace(beyond, periods=2)
    two = fixed_point(twice, one + x * v)
    apart = 0.5 * np.linalg.norm(two - beyond.passage(two).point)
    assert apart == pytest.approx(x * np.linalg.norm(v), rel=0.01)


def test_a_curve_of_flips_has_a_row_where_the_coefficient_is_zero(monkeypatch):
    """The dimer has none, so the coefficient is made to be zero at e = 0.6171."""
    monkeypatch.setattr(bifurcation_curve, "doubling", lambda m, z, matrix: m.parameters["e"] - 0.6171)
    curve = orbits.border_curve("flip", "Gamma", "e", span=(0.605, 0.625), spin=100.0)
    (at,) = np.flatnonzero(curve["meets"].values == DOUBLED_FOLD)
    assert float(curve["e"][at]) == pytest.approx(0.6171, abs=1e-6)
    assert (np.diff(np.sign(curve["doubling"].values[curve["meets"].values == ""])) != 0).sum() == 1


def test_flips_of_the_base_case_lead_to_stable_orbits_and_no_row_is_made_where_the_coefficient_leaps():
    flip = orbits.border_curve("flip", "Gamma", "e", span=(0.6, 0.7), spin=100.0)
    known = flip["doubling"].values[np.isfinite(flip["doubling"].values)]
    assert known.size > 5
    assert ((known > 0.1) & (known < 0.3)).all()
    assert DOUBLED_FOLD not in flip["meets"].values
