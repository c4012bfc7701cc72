"""Sustained spins, cycles of the spin, and motions after any time: against plain runs, which know of none of this."""

from datetime import timedelta

import numpy as np
import pytest

from dimersweep import attractors, names, orbits, simulate
from dimersweep.errors import OrbitError, ParameterError

# a spin whose slow time is short; a cycle of the spin between two motions; one that lies between the ends of sheets
CHOSEN = {"r": 4.7e-3, "A_r": 6.82, "f": 14.27, "e": 0.626, "mu": 0.111, "mu_s": 0.133, "Gamma": 0.866}
TO_AND_FRO = {"r": 4.7e-3, "A_r": 5.55, "f": 18.40, "e": 0.699, "mu": 0.172, "mu_s": 0.276, "Gamma": 0.633}
# a family that ends in a fold, to which the spin rises
DIES = {"r": 6.968e-3, "A_r": 4.895, "f": 21.95, "e": 0.7142, "mu": 0.3468, "mu_s": 0.6005, "Gamma": 0.53164}
# a spin that goes to and fro over 0.011 rad/s between two motions, of which one slips for a while
SLIPS = {"f": 20.0}


@pytest.fixture(scope="module")
def chosen():
    return orbits.sustained(spin=(0.0, 260.0), **CHOSEN)


@pytest.fixture(scope="module")
def cycle():
    return orbits.sustained(spin=(130.0, 160.0), **TO_AND_FRO)


@pytest.fixture(scope="module")
def between():
    """An orbit between the ends of sheets: its family is followed once for all times."""
    return orbits.find(spin=145.0, **TO_AND_FRO)


def spins_of_run(start, parameters, periods, parts):
    """The spin of a plain run from the orbit of a spin, after equal parts of its length [rad/s]."""
    run, spins = orbits.find(spin=start, **parameters).run(50, record=False), []
    for _ in range(parts):
        run = run.go_on(periods // parts)
        spins.append(run.orbit.spin if run.orbit else np.nan)
    return np.array(spins)


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0.998, 1.002])
def test_runs_from_below_and_above_come_to_it_at_its_rate(chosen, aside):
    one = chosen.isel(sustained=1)
    assert names(one["kind"]) == "spin" and bool(one["attracts"])
    spin, slow = float(one["spin"]), float(one["slow_periods"])
    off = spins_of_run(aside * spin, CHOSEN, 3 * round(slow), 3) / spin - 1
    assert abs(off[-1]) < 1e-4
    assert np.log(off[0] / off[1]) * slow / round(slow) == pytest.approx(1, rel=0.01)


def test_it_is_the_spin_at_which_nothing_drifts(chosen):
    one = chosen.isel(sustained=1)
    spin, error = float(one["spin"]), float(one["spin_error"])
    assert error < 1e-6 * spin
    at = orbits.find(spin=spin, **CHOSEN)
    assert abs(at.spin_drift) < 1e-9 * spin
    assert at.radius == pytest.approx(float(one["radius"]), rel=1e-8)
    coarse = orbits.sustained(spin=(205.0, 225.0), rtol=1e-11, **CHOSEN)
    assert abs(float(coarse["spin"][0]) - spin) < error + float(coarse["spin_error"][0])


def test_what_moves_in_a_plane_stays_there_or_does_not(chosen):
    still = chosen.isel(sustained=0)
    assert float(still["spin"]) == pytest.approx(0, abs=1e-6)
    beside = orbits.find(spin=1.0, **CHOSEN)
    assert bool(still["attracts"]) == (beside.spin_drift < 0)
    assert float(still["slow_rate"]) == pytest.approx(beside.spin_drift, rel=0.01)


def test_the_mirror_image_has_the_opposite_spins():
    found = orbits.sustained(spin=(-220.0, 220.0), **CHOSEN)["spin"].values
    assert found.size == 3
    np.testing.assert_allclose(found, -found[::-1], rtol=1e-7, atol=1e-5)


@pytest.mark.slow
def test_a_run_goes_to_and_fro_as_the_cycle_says(cycle):
    (one,) = (cycle.isel(sustained=k) for k in np.flatnonzero(names(cycle["kind"]) == "cycle"))
    low, high, around = (float(one[name]) for name in ("spin_low", "spin_high", "slow_periods"))
    parts = 130
    spins = spins_of_run(0.5 * (low + high), TO_AND_FRO, parts * round(around / 50), parts)  # 2.6 times round
    assert np.nanmin(spins) > low - 0.5 and np.nanmax(spins) < high + 0.5
    rises = np.flatnonzero((spins[:-1] < 145.5) & (spins[1:] >= 145.5))
    assert np.diff(rises).mean() / 50 == pytest.approx(1, rel=0.1)
    radii = float(one["radius_low"]), float(one["radius_high"])
    assert radii == pytest.approx((4.634, 5.008), abs=0.01)


def test_the_ends_of_sheets_lead_to_one_another(cycle):
    assert "spin = 147.38" in " ".join(cycle["high_leads"].values)
    assert (cycle["sheet_low"] < cycle["sheet_high"]).all()


def test_a_spin_goes_to_and_fro_between_motions_of_which_one_slips_for_a_while():
    """Their phases of impact are the same to 1e-4. Runs turn where the two sheets end, which they know nothing of."""
    found = orbits.sustained(spin=(145.0, 150.0), **SLIPS)
    (one,) = (found.isel(sustained=k) for k in np.flatnonzero(names(found["kind"]) == "cycle"))
    low, high, around = (float(one[name]) for name in ("spin_low", "spin_high", "slow_periods"))
    sticks, slips = (orbits.find(spin=spin, **SLIPS) for spin in (low - 1e-3, high + 1e-3))
    begin, step = orbits.find(spin=0.25 * low + 0.75 * high, guess=sticks, **SLIPS), 400
    up, down = (high - low) / sticks.spin_drift, (low - high) / slips.spin_drift
    assert around == pytest.approx(up + down, rel=0.01)
    run = begin.run(1, rtol=1e-12, record=False)
    spins = np.array([(run := run.go_on(step)).orbit.spin for _ in range(round((0.3 * up + 1.1 * down) / step))])
    top = int(spins.argmax())
    assert spins[top] == pytest.approx(high, abs=2 * step * sticks.spin_drift)
    assert spins[top:].min() == pytest.approx(low, abs=-step * slips.spin_drift)
    assert spins[-1] > low + 1e-4 and (spins[:top] > spins[0] - 1e-9).all()


def test_a_base_case_that_loses_spin_comes_to_a_plane():
    found = orbits.sustained(spin=(0.0, 200.0))
    assert names(found["kind"]).values.tolist() == ["plane"]
    assert found["spin"].values == pytest.approx([0.0], abs=1e-6)
    assert found["attracts"].values.tolist() == [True]
    later = orbits.later(orbits.find(spin=20.0), periods=np.inf)
    assert abs(later.spin) < 1e-7 and np.isnan([later.radius, later.period]).all()


def test_what_is_no_range_or_has_no_orbit_is_refused():
    with pytest.raises(ParameterError, match="the first must be below the second"):
        orbits.sustained(spin=(100.0, 50.0))
    with pytest.raises(OrbitError, match="no sustained spin"):
        orbits.sustained(spin=(100.0, 150.0), Gamma=0.3)


# --------------------------------------------------------------------------------------------------- after any time


@pytest.mark.parametrize("begin", [170.0, 240.0, -170.0])
def test_a_motion_is_where_a_run_is(begin):
    orbit = orbits.find(spin=begin, **CHOSEN)
    run = orbit.run(10_000, record=False).orbit
    later = orbits.later(orbit, periods=10_000)
    told, known = ([one.spin, one.radius, one.period, one.zeta] for one in (later, run))
    assert told == pytest.approx(known, rel=1e-5)
    assert later.mode == "" and later.leaps == ()


def test_an_infinite_time_leads_to_the_sustained_spin(chosen):
    orbit, spin = orbits.find(spin=170.0, **CHOSEN), float(chosen["spin"][1])
    assert orbits.later(orbit, periods=np.inf).spin == pytest.approx(spin, rel=1e-9)
    assert orbits.later(orbit, periods=1e9).spin == pytest.approx(spin, rel=1e-9)
    assert orbits.later(orbit, seconds="inf") == orbits.later(orbit, periods=np.inf)


def test_a_time_may_be_given_in_hours():
    orbit = orbits.find(spin=170.0, **CHOSEN)
    after, recorder = orbits.later(orbit, periods=7200 * orbit.parameters["f"]), orbit.fixed.map.recorder
    followed = recorder.periods
    for seconds in ("2 h", "120 min", 7200, timedelta(hours=2)):
        assert orbits.later(orbit, seconds=seconds) == after
    assert recorder.periods - followed < 0.2 * followed  # the family is followed once for all times
    for given in ({}, {"seconds": "2 h", "periods": 10}):
        with pytest.raises(ParameterError, match=r"^periods: give either periods or seconds, such as seconds='3 h'$"):
            orbits.later(orbit, **given)


def test_time_runs_back_as_far_as_the_family_goes():
    there = orbits.later(orbits.find(spin=200.0, **DIES), periods=50_000).spin
    back = orbits.later(orbits.find(spin=there, **DIES), periods=-50_000)
    assert there > 202 and back.spin == pytest.approx(200.0, rel=1e-6)
    with pytest.raises(ParameterError, match="comes to the end of the family after"):
        orbits.later(orbits.find(spin=230.0, **CHOSEN), periods=-1e9)


@pytest.mark.slow
def test_a_motion_goes_round_a_cycle_as_a_run_does(cycle, between):
    around = float(cycle["slow_periods"].values[names(cycle["kind"]) == "cycle"][0])
    many = orbits.later(between, periods=3000 + 40 * around)
    leaps = many.leaps
    assert len(leaps) == 2 and leaps[0].spin[1] == pytest.approx(leaps[0].spin[0], rel=0.01)
    assert sorted(np.ravel([leap.radius for leap in leaps])) == pytest.approx([4.63, 4.63, 4.96, 5.01], abs=0.01)
    for periods, told in ((1000, orbits.later(between, periods=1000)), (3000, many)):
        assert told.spin == pytest.approx(between.run(periods).orbit.spin, abs=0.1)
    with pytest.raises(ParameterError, match="the spin goes to and fro, from 1"):
        orbits.later(between, periods=np.inf)


def test_a_leap_goes_from_where_a_motion_is_before_it_to_where_it_is_after_it(between):
    leaps = orbits.later(between, periods=6000).leaps
    assert len(leaps) == 2 and 0 < leaps[0].after < leaps[1].after < 6000
    for leap, falls in zip(leaps, (False, True), strict=True):
        before = orbits.later(between, periods=leap.after - 1e-3)
        assert (leap.spin[0], leap.radius[0]) == pytest.approx((before.spin, before.radius), abs=1e-4)
        assert (before.spin < 145) == falls


def test_what_cannot_be_followed_is_refused():
    orbit = orbits.find(spin=170.0, **CHOSEN)
    with pytest.raises(ParameterError, match="the orbit has its own"):
        orbits.later(orbit, spin=170.0, periods=10)
    with pytest.raises(ParameterError, match="periods = nan"):
        orbits.later(orbit, periods=np.nan)
    with pytest.raises(ParameterError, match="is an unstable orbit"):
        orbits.later(orbits.find(spin=100.0, Gamma=1.6), periods=10)


@pytest.mark.parametrize("mirror", [True, False])
def test_starts_are_told_apart_by_where_their_spin_goes(mirror):
    starts = {"beta0": (0.35, 0.6, 0.5, 0.3, 0.02), "xdot0": (1.1, 1.6, -1.1, 1.3, 1.0)}
    starts = {name: np.array(column) for name, column in starts.items()}
    found = attractors(points=starts, fixed=CHOSEN, periods=400, mirror=mirror, slow=True, progress=False)
    drifts = found.isel(attractor=names(found["fate"]).values == "spin")
    spins = {True: [216.236], False: [-216.236, 216.236]}[mirror]
    assert sorted(drifts["spin_low"].values) == pytest.approx(spins, abs=1e-3)
    assert (drifts["spin_low"] == drifts["spin_high"]).all()
    assert np.abs(drifts["spin"].values) == pytest.approx(216.236, abs=1e-3)


def test_a_motion_in_which_both_ends_stick_keeps_any_spin():
    """Jumps of a dimer that come to one motion at the spins that they are left with."""
    jumping = {"r": 0.0062, "A_r": 8.6, "f": 26.1, "mu": 0.223, "mu_s": 0.318, "e": 0.513, "Gamma": 1.163}
    starts = {"beta0": [0.3, 0.5, 0.1], "gammadot0": [-80.0, 40.0, 20.0]}
    found = attractors(points=starts, fixed=jumping, periods=400, slow=True, progress=False)
    jumps = found.isel(attractor=names(found["mode"]).values == "jump").squeeze()
    assert (str(names(jumps["fate"]).values), float(jumps["spin_high"])) == ("kept", np.inf)
    start = {name: values[int(jumps["representative"])] for name, values in starts.items()}
    orbit = orbits.find(guess=simulate(**jumping, **start, periods=400))
    assert abs(orbit.spin) > 1 and orbits.later(orbit, periods=np.inf).spin == orbit.spin
    end = orbit.run(3000).states([3000 / jumping["f"]]).isel(time=0)
    assert float(end["gamma_rate"] + end["theta_rate"] * np.sin(end["beta"])) == pytest.approx(orbit.spin, rel=1e-9)


def test_where_the_drift_dies_a_motion_comes_to_rest():
    """At 229.2 rad/s the family ends in a fold."""
    orbit = orbits.find(spin=229.0, **DIES)
    alive, dead = (orbits.later(orbit, periods=periods) for periods in (2000, 5000))
    assert alive.spin == pytest.approx(orbit.run(2000, record=False).orbit.spin, rel=1e-5) and alive.mode == ""
    assert dead.mode == orbit.run(5000, record=False).mode == orbits.later(orbit, periods=np.inf).mode == "rest"
    assert np.isnan(dead.spin)


def test_a_motion_in_a_plane_has_no_circle():
    """The spin of this plane is found as 3e-11 rad/s, beside which the path turns once in a million years."""
    dimer = {"A_r": 6.707, "f": 13.398, "e": 0.661, "mu": 0.104, "mu_s": 0.111, "Gamma": 1.114}
    found = orbits.sustained(**dimer)
    assert names(found["kind"]).values.tolist() == ["plane", "spin"]
    for name in ("radius", "path_radius", "period", "radius_low", "radius_high"):
        assert np.isnan(found[name].values).tolist() == [True, False], name
    assert abs(found["spin"].values[0]) < 1e-7 and found["precession_rate"].values[0] == 0
    orbit = orbits.find(spin=1e-9, **dimer)
    assert np.isnan([orbit.radius, orbit.path_radius, orbit.period]).all()
    assert ", in a plane, zeta" in repr(orbit) and "none: straight" in orbit._repr_html_()
    assert orbits.find(spin=1e-3, **dimer).radius > 1  # a circle, though a wide one
