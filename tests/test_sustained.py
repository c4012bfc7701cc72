"""Sustained spins and cycles of the spin: against plain runs, which know of neither."""

import numpy as np
import pytest

from dimersweep import orbits
from dimersweep.errors import OrbitError, ParameterError

# a spin whose slow time is short; a cycle of the spin between two motions; one that lies between the ends of sheets
CHOSEN = {"r": 4.7e-3, "A_r": 6.82, "f": 14.27, "e": 0.626, "mu": 0.111, "mu_s": 0.133, "Gamma": 0.866}
TO_AND_FRO = {"r": 4.7e-3, "A_r": 5.55, "f": 18.40, "e": 0.699, "mu": 0.172, "mu_s": 0.276, "Gamma": 0.633}


@pytest.fixture(scope="module")
def chosen():
    return orbits.sustained(spin=(0.0, 260.0), **CHOSEN)


@pytest.fixture(scope="module")
def cycle():
    return orbits.sustained(spin=(130.0, 160.0), **TO_AND_FRO)


def spins_of_run(start, parameters, periods, parts):
    """The spin of a plain run from the orbit of a spin, after equal parts of its length [rad/s]."""
    run, spins = orbits.find(spin=start, **parameters).run(50), []
    for _ in range(parts):
        run = run.go_on(periods // parts)
        spins.append(run.orbit.spin if run.orbit else np.nan)
    return np.array(spins)


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0.97, 1.03])
def test_runs_from_below_and_above_come_to_it_at_its_rate(chosen, aside):
    one = chosen.isel(sustained=1)
    assert one["kind"] == "spin" and bool(one["attracts"])
    spin, slow = float(one["spin"]), float(one["slow_periods"])
    off = spins_of_run(aside * spin, CHOSEN, 6 * round(slow), 3) / spin - 1
    assert abs(off[-1]) < 1e-4
    assert np.log(off[0] / off[1]) * slow / (2 * round(slow)) == pytest.approx(1, rel=0.02)


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
    (one,) = (cycle.isel(sustained=k) for k in np.flatnonzero(cycle["kind"] == "cycle"))
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


def test_a_base_case_that_loses_spin_comes_to_a_plane():
    found = orbits.sustained(spin=(0.0, 200.0))
    assert found["spin"].values == pytest.approx([0.0], abs=1e-6)
    assert found["attracts"].values.tolist() == [True]


def test_what_is_no_range_or_has_no_orbit_is_refused():
    with pytest.raises(ParameterError, match="the first must be below the second"):
        orbits.sustained(spin=(100.0, 50.0))
    with pytest.raises(OrbitError, match="no sustained spin"):
        orbits.sustained(spin=(100.0, 150.0), Gamma=0.3)
