"""The mean path of a drift: its radius and speed in runs, cubes and orbits, against circles fitted to where runs went."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from dimersweep import orbits, simulate, sweep
from tests.checks.data import data

CIRCLES = data("scenes")["circles"]["scenes"]
SPIRAL = {"mu": 0.05, "mu_s": 0.1}


def circle_through(t, x, y):
    """Radius, speed and rate of the even motion on a circle that is nearest to a track."""

    def off(p):
        angle = p[4] * (t - t[0])
        cos, sin = np.cos(angle), np.sin(angle)
        return np.concatenate([p[0] + p[2] * cos - p[3] * sin - x, p[1] + p[2] * sin + p[3] * cos - y])

    turned = np.unwrap(np.arctan2(np.gradient(y, t), np.gradient(x, t)))
    rate = (turned[-100:].mean() - turned[:100].mean()) / (t[-50] - t[50])
    start = [x.mean(), y.mean(), np.hypot(x[-1] - x[0], y[-1] - y[0]) / (t[-1] - t[0]) / rate, 0.0, rate]
    a, b, rate = least_squares(off, start, x_scale=np.abs(start) + 1e-3, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[2:]
    return np.hypot(a, b), np.hypot(a, b) * abs(rate), rate


@pytest.mark.parametrize(("scene", "close"), [*((scene, 2e-5) for scene in CIRCLES), (SPIRAL, 3e-4)])
def test_the_path_is_the_circle_through_where_the_centre_of_mass_is_at_all_moments(scene, close):
    run = simulate(**scene, periods=600, rtol=1e-10)
    t = np.linspace(200, 600, 401 * 12 + 5) / run.parameters["f"]  # at all phases of the plate
    states = run.states(t)
    radius, speed, rate = circle_through(t, states["x"].values, states["y"].values)
    halfway = simulate(**scene, periods=400, record=False, rtol=1e-10).orbit
    assert halfway.path_radius == pytest.approx(radius, rel=close)
    assert halfway.path_speed == pytest.approx(speed, rel=close)
    assert halfway.precession_rate == pytest.approx(rate, rel=close)  # so the period is that of either circle


def test_the_equivalent_radius_is_another_where_zeta_is_far_from_a_right_angle():
    orbit = simulate(xdot0=0.1, periods=300, record=False).orbit
    assert orbit.radius / orbit.path_radius == pytest.approx(1.0545, abs=1e-4)
    assert orbit.radius * np.sin(orbit.zeta) == pytest.approx(orbit.path_radius, rel=1e-3)
    assert orbit.radius == pytest.approx(orbit.speed / abs(orbit.precession_rate), rel=1e-12)


@pytest.mark.parametrize("scene", CIRCLES[:3])
def test_an_orbit_has_the_path_of_a_run_on_it(scene):
    at_rtol = {"rtol": 1e-11, "periods": 300}
    run = simulate(**scene, **at_rtol)
    orbit, of_run = orbits.find(guess=run), run.orbit
    for name in ("path_radius", "path_speed"):
        assert getattr(orbit, name) == pytest.approx(getattr(of_run, name), rel=1e-5), name
    assert orbit.precession_rate_drift == pytest.approx(of_run.precession_rate_drift, rel=2e-2)
    swing = orbit.path.swing
    assert 2e-5 < np.abs(swing).max() < 5e-4  # fractions of a millimetre of four metres
    assert abs(swing.mean()) < 1e-12


@pytest.mark.parametrize("spin", [19.7, -40.0, 60.0])  # at 19.7 no motion that drifts slowly is found
def test_the_rate_of_an_orbit_drifts_with_its_spin(spin):
    orbit = orbits.find(**data("scenes")["motions"]["drifts elsewhere"], spin=spin)
    ratio = orbit.spin_drift / orbit.spin
    assert -2e-6 < ratio < -2e-7
    assert orbit.precession_rate_drift / orbit.precession_rate == pytest.approx(ratio, rel=1e-2)


def test_a_straight_path_has_a_speed_and_no_radius():
    straight = simulate(xdot0=0.0, e=0.66, mu=0.3, mu_s=0.6, periods=200)
    x, y = (np.diff(straight.states([100 / 15, 200 / 15])[name]).item() for name in ("x", "y"))
    assert np.isnan(straight.orbit.path_radius)
    assert straight.orbit.path_speed == pytest.approx(np.hypot(x, y) * 15 / 100, rel=1e-5)
    plane = orbits.find(spin=0.0, e=0.66, mu=0.3, mu_s=0.6)
    assert np.isnan(plane.path_radius)
    assert plane.path_speed == pytest.approx(straight.orbit.path_speed, rel=1e-5)


def test_a_cube_has_the_path_of_its_drifts_and_of_nothing_else():
    cube = sweep({"xdot0": [0.1, 1.0], "Gamma": [0.5, 0.9]}, periods=100, progress=False)
    for name in ("path_radius", "path_speed"):
        values = cube[name]
        assert np.isnan(values.sel(Gamma=0.5)).all()
        for xdot0 in (0.1, 1.0):
            run = cube.dimersweep.run(xdot0=xdot0, Gamma=0.9)  # recorded, where a point of a cube is not
            assert values.sel(xdot0=xdot0, Gamma=0.9).item() == getattr(run.orbit, name)
    assert cube["path_radius"].attrs["units"] == "m"
