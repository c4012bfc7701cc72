"""Slow families and the edges of basins: against long runs."""

import numpy as np
import pytest

from dimersweep import orbits, simulate
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.edges import halved, uncertainty


@pytest.fixture(scope="module")
def family():
    return orbits.family(spin=(90.0, 150.0), points=40)


# plain runs of the base case: periods, radius [m], period [s], zeta, spin [rad/s]
LONG = [(20_000, 4.247001, 38.75933, 1.605906, 137.6089), (100_000, 4.253879, 46.22265, 1.612550, 115.5474)]


@pytest.mark.parametrize("row", LONG)
def test_later_is_what_a_long_run_comes_to(family, row):
    periods, *known = row
    short = simulate(periods=500, record=False, rtol=1e-10).orbit
    later = orbits.later(family, spin=short.spin_rate, periods=periods - 500)
    assert [later.radius, later.period, later.zeta, later.spin] == pytest.approx(known, rel=1e-5)


@pytest.mark.slow
def test_later_at_another_length():
    family = orbits.family(spin=(100.0, 150.0), points=40, A_r=6.5)
    short, long = (simulate(A_r=6.5, beta0=0.3, periods=n, record=False).orbit for n in (500, 20_000))
    later = orbits.later(family, spin=short.spin_rate, periods=19_500)
    told = [later.radius, later.period, later.zeta, later.spin]
    assert told == pytest.approx([long.radius, long.period, long.zeta, long.spin_rate], rel=1e-5)


def test_time_runs_both_ways(family):
    later = orbits.later(family, spin=140.0, periods=30_000)
    assert orbits.later(family, spin=later.spin, periods=-30_000).spin == pytest.approx(140.0, rel=1e-9)
    assert orbits.later(family, spin=140.0, periods=0).spin == 140.0


def test_a_family_is_made_of_orbits(family):
    assert family.sizes["spin"] == 40
    assert family["stable"].values.all()
    assert family.attrs["high_end"] == family.attrs["low_end"] == "asked for"
    one = family.isel(spin=17)
    orbit = orbits.find(spin=float(one["spin"]))
    for name in ("radius", "period", "zeta", "speed", "spin_drift"):
        assert float(one[name]) == pytest.approx(getattr(orbit, name), rel=1e-6), name
    assert one["word"].item() == orbit.word


def test_a_spin_of_a_family_costs_little(family):
    assert float(family.attrs["cost"]) / 40 < 20


def test_a_family_tells_where_it_ends():
    """Just above the fold at 100 rad/s, it reaches the fold on one side."""
    found = orbits.family(spin=(60.0, 140.0), points=9, Gamma=0.78726)
    ends = {found.attrs["low_end"], found.attrs["high_end"]}
    assert any(end.startswith("fold") for end in ends)
    assert 100.0 in found["spin"].values


def test_what_is_beyond_a_family_is_told(family):
    with pytest.raises(ParameterError, match="goes from 90 to 150"):
        orbits.later(family, spin=200.0, periods=10)
    with pytest.raises(ParameterError, match="comes to the end of the family after"):
        orbits.later(family, spin=100.0, periods=1e6)
    with pytest.raises(ParameterError, match="must be below the second"):
        orbits.family(spin=(3.0, 2.0))
    with pytest.raises(OrbitError, match="no orbit found"):
        orbits.family(spin=(10.0, 20.0), Gamma=0.5)


def test_the_edge_of_a_basin_is_the_unstable_orbit_of_the_fold():
    edge = orbits.edge("beta0", (0.24, 0.28))
    assert edge.fates == ("rest", "drift")
    assert abs(edge.bracket[1] - edge.bracket[0]) <= 1e-10
    assert edge.clean
    assert np.isnan(edge.exponent)
    assert edge.stays > 10
    assert edge.partner
    assert (np.abs(edge.near.multipliers) > 1).sum() == 1
    for value, fate in zip(edge.bracket, edge.fates, strict=True):
        assert simulate(beta0=value, periods=300, rtol=1e-11, record=False).mode == fate
    branch = orbits.follow(orbits.find(spin=edge.near.spin), "Gamma", to=0.7)
    assert float(branch["radius"][-1]) == pytest.approx(edge.near.radius, rel=1e-5)


def test_one_fate_has_no_edge():
    with pytest.raises(ParameterError, match="both lead to rest"):
        orbits.edge("beta0", (0.05, 0.1))


def test_halving_and_the_exponent_of_fractal_fates():
    low, high = halved(lambda x: "a" if x < np.pi else "b", 0.0, 4.0, 1e-9)
    assert low < np.pi <= high <= low + 1e-9

    def cantor(x: float) -> str:
        """Whether a number lies in a gap of the Cantor set that opens at an even step."""
        for step in range(40):
            x *= 3
            if 1 < x < 2:
                return str(step % 2)
            x -= 2 * (x >= 2)
        return "0"

    smooth = uncertainty(lambda x: str(x > 0.4), 0.0, 1.0)
    assert 1 - np.log(2) / np.log(3) == pytest.approx(0.37, abs=0.01)
    assert uncertainty(cantor, 0.0, 1.0) < 0.7 < smooth
