"""Slow families and the edges of basins: against long runs."""

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline

from dimersweep import names, orbits, simulate
from dimersweep.analysis.attractors.edges import uncertainty
from dimersweep.analysis.orbits.continuation.steps import Between, halved, zero
from dimersweep.analysis.orbits.map.lost import OrbitLost, in_steps, require
from dimersweep.analysis.orbits.map.manifold import lag, slow_motion_of
from dimersweep.analysis.orbits.map.orbit import orbit_of
from dimersweep.analysis.orbits.map.solution import fixed_at, solve
from dimersweep.errors import OrbitError, ParameterError
from tests.checks.data import data


@pytest.fixture(scope="module")
def family():
    return orbits.family(spin=(90.0, 150.0), points=40)


# plain runs of the base case: periods, radius [m], period [s], zeta, spin [rad/s]
LONG = [(20_000, 4.247001, 38.75933, 1.605906, 137.6089), (100_000, 4.253879, 46.22265, 1.612550, 115.5474)]


@pytest.mark.parametrize("row", LONG)
def test_later_is_what_a_long_run_comes_to(family, row):
    periods, *known = row
    short = simulate(periods=500, record=False, rtol=1e-10).orbit
    later = orbits.later(family, spin=short.spin, periods=periods - 500)
    assert [later.radius, later.period, later.zeta, later.spin] == pytest.approx(known, rel=1e-5)


@pytest.mark.slow
def test_later_at_another_length():
    family = orbits.family(spin=(100.0, 150.0), points=40, A_r=6.5)
    short, long = (simulate(A_r=6.5, beta0=0.3, periods=n, record=False).orbit for n in (500, 10_000))
    later = orbits.later(family, spin=short.spin, periods=9500)
    told = [later.radius, later.period, later.zeta, later.spin]
    assert told == pytest.approx([long.radius, long.period, long.zeta, long.spin], rel=1e-5)


def test_time_runs_both_ways(family):
    later = orbits.later(family, spin=140.0, periods=30_000)
    assert orbits.later(family, spin=later.spin, periods=-30_000).spin == pytest.approx(140.0, rel=1e-9)
    assert orbits.later(family, spin=140.0, periods=0).spin == 140.0
    assert orbits.later(family, spin=140.0, seconds="20 min") == orbits.later(family, spin=140.0, periods=18_000)


def test_a_family_is_made_of_orbits(family):
    assert family.sizes["spin"] == 40
    assert family["stable"].values.all()
    assert family.attrs["high_end"] == family.attrs["low_end"] == "asked for"
    one = family.isel(spin=17)
    orbit = orbits.find(spin=float(one["spin"]))
    for name in ("radius", "period", "zeta", "speed", "spin_drift"):
        assert float(one[name]) == pytest.approx(getattr(orbit, name), rel=1e-6), name
    assert one["word"].item() == orbit.sequence


@pytest.mark.parametrize(("A_r", "xdot0", "degrees"), [(5.0, 1.0, 19), (5.0, 3.0, 19), (6.0, 3.0, 16), (7.0, 3.0, 13)])
def test_a_drift_of_fig_17_lies_on_the_family_at_its_own_spin(A_r, xdot0, degrees):
    start = {"A_r": A_r, "xdot0": xdot0, "beta0": np.radians(degrees)}
    drift = simulate(**start, periods=400, rtol=1e-10, record=False).orbit
    family = orbits.family(spin=(0.95 * drift.spin, 1.05 * drift.spin), points=9, A_r=A_r)
    for name in ("radius", "period", "zeta"):
        curve = CubicSpline(family["spin"].values, family[name].values)
        assert float(curve(drift.spin)) == pytest.approx(getattr(drift, name), rel=1e-5), name


def test_a_spin_of_a_family_costs_little(family):
    assert float(family.attrs["cost"]) / 40 < 20


def test_a_family_tells_where_it_ends():
    """Just above the fold at 100 rad/s, it reaches the fold on one side."""
    found = orbits.family(spin=(60.0, 140.0), points=9, Gamma=0.78726)
    ends = {found.attrs["low_end"], found.attrs["high_end"]}
    assert any(end.startswith("fold") for end in ends)
    assert 100.0 in found["spin"].values


@pytest.mark.parametrize(("A_r", "spin"), [(5.6, 100.0), (6.0, 400.0), (7.0, 690.0)])
def test_an_orbit_is_the_same_from_every_section(A_r, spin):
    """At 690 rad/s the fixed points of two sections differ by 2 %, as the spin changes by 0.08 rad/s in a period."""
    told = []
    orbit = orbits.find(A_r=A_r, spin=spin)
    for m, z in orbit.fixed.map.sections(orbit.fixed.passage):
        fixed = solve(m, z - lag(fixed_at(m, z)), spin)
        told.append(orbit_of(fixed, slow_motion_of(fixed)))
    assert len(told) > 1
    assert len({len(one.fixed.z) for one in told}) > 1  # one slips, one sticks
    for name in ("radius", "period", "zeta", "speed", "impact_phase"):
        values = [getattr(one, name) for one in told]
        assert values == pytest.approx([values[0]] * len(values), rel=1e-8), name
    assert np.ptp([one.spin_drift for one in told]) < 1e-9  # rad/s a period
    fixed_points = [one.radius for one in (orbit_of(one.fixed) for one in told)]
    assert np.ptp(fixed_points) > 1e-5


def test_a_family_goes_on_where_the_contact_at_its_section_ends():
    """At A_r = 6 the end that rolls comes to stick below 557.5 rad/s only: so it is where a run from above has come to."""
    run = orbits.find(spin=580.0, A_r=6.0).run(120, rtol=1e-11).orbit
    assert 558.0 < run.spin < 572.0
    family = orbits.family(spin=(550.0, run.spin), points=4, A_r=6.0)
    assert family.attrs["high_end"] == "asked for"
    assert "SC1_sk.1" in family["word"].values[0]
    assert "SC1_sk.1" not in family["word"].values[-1]
    told = [float(family[name][-1]) for name in ("radius", "period", "zeta")]
    assert told == pytest.approx([run.radius, run.period, run.zeta], rel=1e-5)


MANY_SEQUENCES = {"e": 0.7, "Gamma": 1.05, "f": 18, "A_r": 7, "r_1": 5.1e-3, "r_2": 5e-3}


def test_a_family_goes_on_beyond_spins_that_have_no_orbit():
    """From 89.0 to 89.8 rad/s there is none: the end that is down ceases to stick after its chatter, and friction falls."""
    found = orbits.family(spin=(88.2, 90.6), points=9, **MANY_SEQUENCES)
    assert found.attrs["low_end"] == found.attrs["high_end"] == "asked for"
    missing = set(np.linspace(88.2, 90.6, 9).round(6)) - set(found["spin"].values.round(6))
    assert {89.1, 89.4, 89.7} <= missing <= {89.1, 89.4, 89.7, 90.3}
    assert len(set(found["word"].values)) > 1


@pytest.mark.parametrize(("near", "spin"), [(80.0, 105.0), (120.0, 60.0), (80.0, 200.0)])
def test_an_orbit_is_found_from_one_of_another_sequence(near, spin):
    begin = orbits.find(spin=near, **MANY_SEQUENCES)
    there, direct = orbits.find(guess=begin, spin=spin), orbits.find(spin=spin, **MANY_SEQUENCES)
    assert there.sequence == direct.sequence != begin.sequence
    assert there.radius == pytest.approx(direct.radius, rel=1e-7)


def test_a_branch_goes_on_in_another_section():
    branch = orbits.follow(orbits.find(A_r=6.0, spin=550.0), "spin", to=575.0)
    assert branch.attrs["end"].startswith("to:")
    assert "stick_slip" in names(branch["change"]).values


def test_what_is_beyond_a_family_is_told(family):
    with pytest.raises(ParameterError, match="goes from 90 to 150"):
        orbits.later(family, spin=200.0, periods=10)
    with pytest.raises(ParameterError, match="comes to the end of the family after"):
        orbits.later(family, spin=100.0, periods=1e6)
    with pytest.raises(OrbitError, match="no orbit found"):
        orbits.family(spin=(10.0, 20.0), Gamma=0.5)


def test_a_motion_comes_to_the_spin_at_which_nothing_drifts_and_keeps_it():
    """A made-up rate, linear in the spin, which has a closed form; and one that is zero everywhere, or at the first spin."""
    spins = np.linspace(50.0, 150.0, 21)

    def made(drift):
        same = np.ones(spins.size)
        columns = {"spin_drift": drift, "radius": same, "period": same, "zeta": same}
        return xr.Dataset({name: ("spin", column) for name, column in columns.items()}, coords={"spin": spins})

    pulled = made(-1e-4 * (spins - 100.0))
    rate = np.log1p(-1e-4)  # of the map s(n + 1) = s(n) + d(s(n))
    for begin in (60.0, 90.0, 140.0):
        for periods in (1e3, 3e4):
            expected = 100.0 + (begin - 100.0) * np.exp(rate * periods)
            assert orbits.later(pulled, spin=begin, periods=periods).spin == pytest.approx(expected, rel=1e-6)
        assert orbits.later(pulled, spin=begin, periods=1e12).spin == pytest.approx(100.0, rel=1e-9)
    assert orbits.later(pulled, spin=100.0, periods=1e6).spin == pytest.approx(100.0, rel=1e-12)
    with pytest.raises(ParameterError, match="comes to the end of the family after"):
        orbits.later(pulled, spin=90.0, periods=-1e5)
    assert orbits.later(made(0.0 * spins), spin=70.0, periods=1e9).spin == 70.0
    assert orbits.later(pulled.isel(spin=slice(None, None, -1)), spin=60.0, periods=10.0).spin > 60.0
    for broken in (made(np.full(spins.size, np.nan)), xr.concat([pulled, pulled], "spin")):
        with pytest.raises(ParameterError, match="needs at least 4, each spin once"):
            orbits.later(broken, spin=60.0, periods=10.0)


def test_from_below_and_above_motions_come_to_the_spin_that_is_kept():
    family = orbits.family(spin=(100.0, 108.0), points=9, **MANY_SEQUENCES)
    assert float(family["spin_drift"][0]) > 0 > float(family["spin_drift"][-1])
    ends = [orbits.later(family, spin=spin, periods=1e8).spin for spin in (101.0, 107.5)]
    assert ends == pytest.approx([106.8, 106.8], abs=0.02)


def test_a_motion_in_a_plane_stays_there():
    family = orbits.family(spin=(0.0, 40.0), points=9)
    later = orbits.later(family, spin=0.0, periods=1e5)
    assert later.spin == pytest.approx(0.0, abs=1e-6)


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


def test_ends_of_angles_may_be_in_degrees():
    assert orbits.edge("beta0", ("14 deg", "16 deg"), within=1e-3).bracket == pytest.approx((0.267, 0.267), abs=2e-3)
    orbit = orbits.find(spin=100.0, phi_2=0.1, Gamma_2=0.01)
    branch = orbits.follow(orbit, "phi_2", to="10 deg", sequences=False)
    assert float(branch["phi_2"][-1]) == pytest.approx(np.deg2rad(10), abs=1e-12)


def test_one_fate_has_no_edge():
    with pytest.raises(ParameterError, match="both lead to rest"):
        orbits.edge("beta0", (0.05, 0.1))


def test_a_way_is_gone_by_halves_where_the_orbit_is_lost():
    tried = []

    def step(here, to):
        tried.append((here, to))
        require(here >= 0.5 or to - here <= 0.125, "the step is too long")
        return to

    assert in_steps(step, 0.0, 1 / 8) == 1.0
    assert tried == [
        (0, 1),
        (0, 1 / 2),
        (0, 1 / 4),
        (0, 1 / 8),
        (1 / 8, 1 / 4),
        (1 / 4, 1 / 2),
        (1 / 4, 3 / 8),
        (3 / 8, 1 / 2),
        (1 / 2, 1),
    ]
    with pytest.raises(OrbitLost, match="too long"):
        in_steps(step, 0.0, 1 / 4)


def test_no_zero_is_located_where_a_function_has_no_value():
    line = Between(-1.0, 1.0, lambda a, b, part, _: a + part * (b - a))
    assert zero(line, lambda x: x + 0.2, 1e-9) == pytest.approx(0.4, abs=1e-9)
    assert zero(line, lambda x: np.nan if abs(x) < 0.1 else x, 1e-9) is None


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


@pytest.mark.parametrize("side", [-1, 1])
def test_runs_beside_the_family_of_unlike_balls_come_to_it(side):
    """The runs begin with p2 above and below where it is on the family, and settle to its radius, period and angle."""
    unlike = {"r_1": 5e-3, "r_2": 5.05e-3}
    family = orbits.family(spin=(90.0, 110.0), points=9, **unlike)
    assert family["stable"].values.all()
    orbit = orbits.find(spin=100.0, **unlike)
    begin = orbit.run(2).start
    start = {name: begin[name] for name in ("beta", "beta_rate", "theta_rate", "x1_rate", "y1_rate", "gamma_rate")}
    start["beta"] *= 1 + 0.1 * side
    beside = simulate(start=start, periods=400, rtol=1e-10, **unlike).orbit
    for name in ("radius", "period", "zeta"):
        curve = CubicSpline(family["spin"].values, family[name].values)
        assert float(curve(100.0)) == pytest.approx(getattr(orbit, name), rel=1e-6)
        assert float(curve(beside.spin)) == pytest.approx(getattr(beside, name), rel=1e-5), name


def test_a_run_leaves_its_family_where_its_double_impact_ends_another_way():
    """It settled after 72 periods; the spin drifts on, past the end of the family, and the run goes over to the next one."""
    settled, before, beyond = (
        simulate(**data("scenes")["motions"]["passes a border"], periods=n) for n in (72, 320, 350)
    )
    branch = orbits.follow(orbits.find(guess=settled), "spin", to=145.0)
    assert branch["word"].values[-1].startswith("DI_sp_sp>DI_sp_sk ")
    assert "the next one found has the sequence DI_sp_sp " in branch.attrs["end"]
    assert settled.orbit.spin < branch["spin"].values[-1] == pytest.approx(before.orbit.spin, rel=0.02)
    kinds = [names(run.events["kind"]).values for run in (before, beyond)]
    assert [each[np.char.startswith(each, "DI")][-1] for each in kinds] == ["DI_sp_sk", "DI_sp_sp"]
    assert orbits.find(guess=beyond, periods=1).sequence.startswith("DI_sp_sp ")
