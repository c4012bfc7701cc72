"""How the centre of a circle moves on a plate that is not level: against plain runs, and by symmetry."""

import numpy as np
import pytest

from dimersweep import orbits, simulate
from dimersweep.analysis.orbits.map.ball import ball_fold
from dimersweep.errors import OrbitError
from dimersweep.kernel.model.body import dimer_of
from tests.checks.dimers import random_dimer

BASE = {"spin": 144.0}
ALIKE = random_dimer(48)
UNLIKE = random_dimer(51)
UNLIKE |= {"r_1": UNLIKE["r"], "r_2": 1.002 * UNLIKE.pop("r"), "mu_2": 0.9 * UNLIKE["mu"]}
OPPOSITE = {"tilt": {"azimuth": np.pi}, "Gamma_x": {"phi_x": np.pi}}


def found(dimer):
    """The orbit of a dimer, in the middle of its drift unless Gamma is given or the base case's."""
    return orbits.find(**({"Gamma": 1.15 * ball_fold(dimer["e"])} if "e" in dimer else {}) | dimer)


def velocity(drift):
    return complex(drift.centre_velocity_x, drift.centre_velocity_y)


def of_runs(orbit, name, size):
    """The velocity of two runs on opposite plates, whose spirals on the level plate cancel, and their mean spin."""
    rounds, start = orbit.period * orbit.parameters["f"], orbit.run(1).states(0.0)
    runs = [
        simulate(start=start, periods=int(1.4 * rounds) + 40, record=False, rtol=1e-10, **{name: size}, **turned)
        for turned in ({}, OPPOSITE[name])
    ]
    one, other = (complex(run.centre_velocity_x, run.centre_velocity_y) for run in runs)
    return (one - other) / 2, np.mean([run.orbit.spin for run in runs]) - 0.5 * rounds * orbit.spin_drift


@pytest.mark.parametrize("name", ["tilt", "Gamma_x"])
@pytest.mark.parametrize("dimer", [BASE, ALIKE, UNLIKE], ids=["base", "alike", "unlike"])
def test_runs_drift_as_told(dimer, name):
    orbit = found(dimer)
    for size in (1e-4, 3e-4) if dimer is BASE else (3e-4,):
        seen, spin = of_runs(orbit, name, size)
        told = orbits.centre_drift(guess=orbit, spin=spin, **{name: size})
        assert abs(seen / velocity(told) - 1) < 0.01
        assert told.per_unit * size == pytest.approx(abs(velocity(told)), rel=1e-12)


def test_it_holds_as_far_as_told():
    orbit = found(BASE)
    told = orbits.centre_drift(guess=orbit, tilt=1e-3)
    assert 2e-3 < told.holds_to < 3e-3
    seen, spin = of_runs(orbit, "tilt", told.holds_to)
    assert abs(seen / velocity(orbits.centre_drift(guess=orbit, spin=spin, tilt=told.holds_to)) - 1) < 0.05
    assert orbits.centre_drift(guess=orbit, tilt=1e-4).holds_to == pytest.approx(told.holds_to, rel=0.03)


def test_the_spin_pays_for_the_way_uphill():
    """While the dimer rolls at speed v, (m + J_a/r^2) v v' = -m g tilt times the velocity uphill."""
    drift = orbits.centre_drift(tilt=1e-3, **BASE)
    dm = dimer_of(drift.orbit.fixed.map.row)
    uphill = -drift.centre_velocity_x * dm.g * 1e-3 / (1 + dm.J_a / (dm.m * dm.p1.r**2))
    lost = uphill / drift.orbit.path_speed / dm.p1.r * dm.period
    assert drift.spin_drift == pytest.approx(-lost, rel=0.03)


def test_the_velocity_turns_with_the_plate_and_is_mirrored_with_the_spin():
    straight = orbits.centre_drift(tilt=1e-3, **BASE)
    turned = orbits.centre_drift(tilt=1e-3, azimuth=2.0, guess=straight.orbit)
    assert abs(velocity(turned) - velocity(straight) * np.exp(2j)) < 1e-6 * abs(velocity(straight))
    assert turned.direction == pytest.approx(straight.direction, abs=1e-6)
    mirrored = orbits.centre_drift(tilt=1e-3, spin=-BASE["spin"])
    assert abs(velocity(mirrored) - velocity(straight).conjugate()) < 1e-6 * abs(velocity(straight))
    x, y = (orbits.centre_drift(guess=straight.orbit, **{f"Gamma_{axis}": 1e-3}) for axis in "xy")
    assert abs(velocity(y) - 1j * velocity(x)) < 1e-5 * abs(velocity(x))
    assert y.direction == pytest.approx(x.direction, abs=1e-5)
    both = orbits.centre_drift(tilt=1e-3, Gamma_y=1e-3, guess=straight.orbit)
    assert abs(velocity(both) - velocity(straight) - velocity(y)) < 1e-5 * abs(velocity(both))


def test_a_run_on_the_plate_leads_to_the_orbit_of_the_level_one():
    run = simulate(tilt=1e-4, azimuth=1.0, periods=200)
    drift = orbits.centre_drift(guess=run)
    assert "tilt" not in drift.orbit.parameters
    again = orbits.centre_drift(spin=drift.orbit.spin, tilt=1e-4, azimuth=1.0)
    assert abs(velocity(drift) / velocity(again) - 1) < 1e-5


def test_without_a_circle_there_is_none():
    with pytest.raises(OrbitError, match=r"walks straight on"):
        orbits.centre_drift(tilt=1e-3, spin=0.0)
