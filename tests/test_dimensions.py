"""Units by dimensions: in other units of length, time and mass every parameter and every result is another number.

A dimer that is so many times as long, with times so many times as long, of so much more mass, is the same dimer in other units.
So each result must change as its unit says; a unit that is written wrong, or a number in another one, does not.
"""

import re

import numpy as np
import pytest

from dimersweep import orbits, simulate, stability, sweep
from dimersweep.analysis.orbits.map.orbit import dataset
from dimersweep.studies.search import search
from dimersweep.symbols import PARAMETERS

LENGTH, TIME, MASS = 4.0, 2.5, 3.0
UNITS = {
    "1": 1.0,
    "rad": 1.0,
    "m": LENGTH,
    "s": TIME,
    "kg": MASS,
    "Hz": 1 / TIME,
    "N": MASS * LENGTH / TIME**2,
    "J": MASS * LENGTH**2 / TIME**2,
}
BASE = {"f": 15.0, "xdot0": 1.0, "r": 5e-3, "rho_b": 7850.0, "rho_r": 1180.0, "D_r": 4e-3, "g": 9.81}
WALKS = BASE | {"A_r": 5.0, "f": 22.0, "e": 0.65, "mu": 0.1, "mu_s": 0.15}  # to a spin at which nothing drifts


def times(units):
    """By how much a number of these units is greater; no unit here has a prefix."""
    found = [re.fullmatch(r"(1|[A-Za-z]+)(-?\d)?", each) for each in units.split()]
    return float(np.prod([UNITS[each[1]] ** int(each[2] or 1) for each in found]))


def in_other_units(given):
    return {name: value * times(PARAMETERS[name].units) for name, value in given.items()}


def compared(one, other, rtol=1e-6):
    """Compare all numbers of two datasets, of which the other one is in other units; names of those that have a unit."""
    seen = set()
    for name, variable in one.variables.items():
        units, values = variable.attrs.get("units"), variable.values
        if units is None or "flag_meanings" in variable.attrs or name in ("kernel", "made_with"):
            continue
        size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        wanted = values * times(units)
        np.testing.assert_allclose(
            other[name].values, wanted, rtol=rtol, atol=rtol * size * times(units), err_msg=f"{name} [{units}]"
        )
        seen |= {name} if size else set()
    return seen


SCENES = {
    "drift": {"Gamma": 0.9},
    "tilted": {"tilt": 0.003, "azimuth": 0.5, "Gamma_x": 0.1, "phi_x": 0.3, "ydot0": 0.2},
    "thrown": {"gap0": 1e-3, "betadot0": 3.0, "thetadot0": 2.0, "gammadot0": 5.0, "ydot0": -0.1, "Gamma": 1.2},
}


@pytest.mark.parametrize("scene", SCENES)
def test_a_run_is_the_same_in_other_units(scene):
    given = BASE | SCENES[scene]
    periods = {"drift": 150, "tilted": 30, "thrown": 4}[scene]
    one, other = (simulate(**each, periods=periods, rtol=1e-11) for each in (given, in_other_units(given)))
    assert (one.mode, one.n_events) == (other.mode, other.n_events)
    times_of = np.linspace(0, 3 / 15, 50)
    seen = compared(one.states(times_of), other.states(TIME * times_of))
    assert {"x", "y", "z", "beta_rate", "gap_2_rate", "plate", "kinetic_energy", "potential_energy"} <= seen
    head = {"event": slice(30)}
    assert {"time", "impulse_1", "slip_1_a"} <= compared(one.events.isel(head), other.events.isel(head))
    assert {"plate_2", "energy"} <= compared(
        *(each.energy().drop_vars("residual").isel(n=slice(4)) for each in (one, other))
    )
    compared(one.section().isel(n=slice(4)), other.section().isel(n=slice(4)))
    assert other.duration == pytest.approx(TIME * one.duration)
    assert other.end_speed == pytest.approx(LENGTH / TIME * one.end_speed, rel=1e-5)


def test_a_cube_is_the_same_in_other_units():
    how = {"periods": 200, "rtol": 1e-11, "sustained": True, "strobes": 2, "progress": False}
    one, other = (sweep({"beta0": [0.28]}, given, **how) for given in (WALKS, in_other_units(WALKS)))
    seen = compared(one, other, 1e-3)
    assert {"radius", "period", "zeta", "speed", "path_radius", "path_speed", "spin", "longest_hop_2"} <= seen
    assert {"sustained_spin", "sustained_radius", "sustained_time", "spin_drift", *BASE} <= seen


def test_the_velocity_of_a_planar_drift_is_the_same_in_other_units():
    how = {"over": "beta0", "ask": "first", "periods": 100, "orbit_periods": 100, "rtol": 1e-11, "progress": False}
    paths = {"periods": 20, "per_period": 4}
    grid, planar = {"A_r": [6.0], "beta0": [0.2, 0.28]}, BASE | {"xdot0": 0.0}
    one, other = (search(grid, given, paths=paths, **how) for given in (planar, in_other_units(planar)))
    some = ["y", "axial_velocity"]
    assert {*some} <= compared(one[some], other[some], 1e-5)


def test_orbits_are_the_same_in_other_units():
    spin = 100.0
    one, other = (
        dataset([orbits.find(spin=s, **given)], "orbit")
        for s, given in ((spin, BASE), (spin / TIME, in_other_units(BASE)))
    )
    compared(one.drop_vars(["residual", "cost"]), other, 1e-5)


def test_sustained_spins_are_the_same_in_other_units():
    low, high = 60.0, 110.0
    one = orbits.sustained(spin=(low, high), **WALKS)
    other = orbits.sustained(spin=(low / TIME, high / TIME), **in_other_units(WALKS))
    seen = compared(one.drop_vars(["residual", "spin_error", "spin_drift"]), other, 1e-4)
    assert {"slow_time", "slow_periods", "slow_rate", "radius_low", "sheet_low", "sheet_high"} <= seen


def test_exponents_are_the_same_in_other_units():
    chaos = BASE | {"Gamma": 3.0, "e": 0.8}
    one, other = (
        stability.lyapunov(simulate(**each, periods=20), periods=25) for each in (chaos, in_other_units(chaos))
    )
    assert other.exponent / other.per_period == pytest.approx(one.exponent / one.per_period / TIME)
    assert one.exponent / one.per_period == pytest.approx(15.0)
    assert one.error > 0 and other.error > 0
