"""Fits: tracks against closed forms and runs, fitted values against what made the data, and what cannot be told."""

import pickle
import re
import signal
from contextlib import redirect_stderr
from functools import cache
from io import StringIO
from math import erfc

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import f as f_distribution
from scipy.stats import multivariate_normal

import dimersweep
from dimersweep import fits, orbits, simulate
from dimersweep.analysis.fits import tracks
from dimersweep.analysis.fits.valley import Valley
from dimersweep.errors import OrbitError, ParameterError, Stopped
from tests.seams import before_each_misfit, every_line

RADII = "path_radius", "radius"
SPIRAL = {"mu": 0.164, "mu_s": 0.33}  # the double impact ends in sp_sp
SLIPPY = {"mu": 0.3, "mu_s": 0.6}  # away from mu = mubar, where radius and angle have a kink


def around(radius, rate, n, turns, centre=0.0, velocity=0.0, phase=0.4):
    """Times and places of even motion on a circle, over whole turns from both ends of which one point is left out."""
    t = np.arange(n) * turns * 2 * np.pi / abs(rate) / n
    place = centre + velocity * (t - (t[0] + t[-1]) / 2) + radius * np.exp(1j * (phase + rate * t))
    return t, place.real, place.imag


# --- tracks -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("rate", [0.17, -0.17])
@pytest.mark.parametrize("turns", [0.3, 1, 2.6])
def test_a_circle_is_found_whichever_way_it_turns(rate, turns):
    track = fits.circle(*around(4.2, rate, 120, turns, centre=2 - 1j), sigma=0.01)
    assert_allclose(list(track.values.values()), [4.2, 2 * np.pi / 0.17, 2, -1], rtol=1e-8)
    assert track.sense == np.sign(rate)


def test_a_cycloid_is_found_and_a_circle_is_one_that_stays():
    t, x, y = around(4.2, -0.17, 120, 1.7, centre=2 - 1j, velocity=0.05 - 0.02j)
    track = fits.cycloid(t, x, y, sigma=0.01)
    assert_allclose(list(track.values.values()), [4.2, 2 * np.pi / 0.17, 2, -1, 0.05, -0.02], rtol=1e-7)
    assert fits.circle(t, x, y).sigma > 0.1  # what the circle leaves of it


@pytest.mark.parametrize(
    ("n", "turns", "moving"),
    [(12_000, 1.37, False), (11_000, -5001.3, True), (4_000, 40.6, True), (4_000, -1980.2, False), (7, 2.9, False)],
)
def test_a_circle_is_found_however_many_points_and_turns_there_are(n, turns, moving):
    """As many as there are two points to a turn: the valley of the misfit is a turn wide, whatever the number of points."""
    t = np.linspace(0, 100, n)
    place = (2 - 1j) + (0.03 - 0.02j) * t * moving + 4 * np.exp(1j * (0.3 + 2 * np.pi * turns * t / 100))
    track = (fits.cycloid if moving else fits.circle)(t, place.real, place.imag, sigma=0.01)
    assert track.values["path_radius"] == pytest.approx(4, rel=1e-9)
    assert track.values["period"] == pytest.approx(100 / abs(turns), rel=1e-9)
    assert track.sense == np.sign(turns)


def test_a_circle_is_found_in_bursts_of_pictures():
    """Ten bursts at random times, with errors of a quarter of the radius: the circle is far from orthogonal to its centre."""
    rng, apart = np.random.default_rng(5), []
    for turns in rng.uniform(1, 60, 25):
        t = np.concatenate([rng.uniform(begin, begin + 2, 40) for begin in rng.uniform(0, 100, 10)])
        place = 4 * np.exp(2j * np.pi * turns * t / np.ptp(t)) + rng.normal(0, 1, 400) + 1j * rng.normal(0, 1, 400)
        track = fits.circle(t, place.real, place.imag, 1.0)
        apart.append([(track.values[name] - true) / track.errors[name] for name, true in
                      (("path_radius", 4), ("period", np.ptp(t) / turns), ("x", 0), ("y", 0))])  # fmt: skip
    assert 60 < np.sum(np.square(apart)) < 150  # chi-square of 100: one in 1,000 is beyond


def test_the_errors_of_a_track_are_those_of_linear_least_squares():
    """Over whole turns the radius is orthogonal to all else: its variance is sigma^2/n, whatever the rate."""
    t, x, y = around(3.0, 0.5, 200, 2)
    track = fits.circle(t, x, y, sigma=0.03)
    assert track.errors["path_radius"] == pytest.approx(0.03 / np.sqrt(200), rel=1e-9)
    shorter = fits.circle(t[:50], x[:50], y[:50], sigma=0.03)
    assert shorter.errors["period"] > 4 * track.errors["period"]


def test_the_error_of_a_coordinate_is_read_off_the_residuals():
    rng = np.random.default_rng(3)
    t, x, y = around(3.0, 0.5, 400, 2)
    track = fits.circle(t, x + rng.normal(0, 0.02, 400), y + rng.normal(0, 0.02, 400))
    assert track.sigma == pytest.approx(0.02, rel=4 / np.sqrt(2 * 800))
    for name, true in (("path_radius", 3.0), ("period", 4 * np.pi)):
        assert abs(track.values[name] - true) < 4 * track.errors[name]


def test_a_quicker_turn_fits_about_as_well_if_chance_adds_as_much_to_the_sum_of_squares():
    """With 2 n coordinates, and 1 + 2 k parameters, by the F distribution of 1 and 2 n - 1 - 2 k degrees of freedom."""
    rng = np.random.default_rng(8)
    s, coefficients = np.linspace(-0.5, 0.5, 12), np.array([0.2 - 0.1j, 3.0 + 1.0j])
    noise = rng.normal(0, 0.1, 12) + 1j * rng.normal(0, 0.1, 12)
    _, _, by_chance = tracks._scatter(s, coefficients[0] + coefficients[1] * np.exp(5j * s) + noise, 5.0, coefficients)
    free = 2 * 12 - 1 - 2 * 2
    variance = (noise.real @ noise.real + noise.imag @ noise.imag) / free
    assert by_chance == pytest.approx(variance * f_distribution.isf(tracks.CHANCE_OF_ALIAS, 1, free))


def track_of(run, t, error=0.0, rng=None, sigma=None):
    """The circle through where the centre of mass of a run is at some times, with errors."""
    states = run.states(t)
    x, y = (states[name].values + (rng.normal(0, error, t.size) if error else 0.0) for name in "xy")
    return fits.circle(t, x, y, sigma)


@cache
def whole_run(**scene):
    return simulate(**scene, periods=900)


@cache
def run_up_to(periods, **scene):
    return simulate(**scene, periods=periods, rtol=1e-10)


def orbit_halfway(scene, moment):
    """The orbit of the spin that a run has at a moment [forcing periods], if it drifts slowly and evenly between impacts."""
    run = run_up_to(round(moment), **scene)
    cycles = scene.get("phi0", 0.0) / (2 * np.pi)
    since = moment - round(moment) + (round(moment) + cycles - run.orbit.impact_phase) % 1
    return orbits.find(guess=run, spin=run.orbit.spin + run.orbit.spin_drift * since)


TIMES = {
    "at all phases of the plate": lambda first, last: np.linspace(first, last, 1777),
    "at its start": np.arange,
    "at a third of it": lambda first, last: np.arange(first, last) + 1 / 3,
    "irregular": lambda first, last: first + (last - first) * np.random.default_rng(4).uniform(size=300) ** 2,
}


@pytest.mark.parametrize("times", TIMES.values(), ids=TIMES)
@pytest.mark.parametrize(
    ("scene", "close", "quicker"),  # the swing is 4e-4 m
    [
        ({"xdot0": 0.2}, 1e-5, 2e-6),
        ({"xdot0": -1.5, "phi0": 1.0, "beta0": 0.2, **SLIPPY}, 2e-6, 8e-7),
        ({"xdot0": 2.5}, 2e-5, 2e-6),  # its rate drifts by 1.5 %
        ({"xdot0": 0.2, **SPIRAL}, 1e-5, 3e-6),  # without the turn of its velocity against the heading 1.4e-3 m
        ({"xdot0": -0.4, "beta0": -0.28, "phi0": 0.3, **SPIRAL}, 1e-5, 3e-6),
    ],
)
def test_a_track_has_of_its_orbit_what_is_foretold(times, scene, close, quicker):
    """Without errors: a track of a run, and what one of the orbit at its middle would give; swing and slow drift are seen."""
    run = whole_run(**scene)
    f = run.parameters["f"]
    t = times(300, 900) / f
    track = track_of(run, t, sigma=1e-4)
    orbit = orbit_halfway(scene, 0.5 * (t.min() + t.max()) * f)
    radius, period = track.of(orbit)
    assert track.values["path_radius"] == pytest.approx(radius, abs=close)
    assert track.values["period"] == pytest.approx(period, rel=quicker)
    assert track.sense == np.sign(orbit.precession_rate)


@pytest.mark.parametrize(
    ("scene", "close", "quicker"),
    [
        ({"xdot0": 0.16, "A_r": 5.76, "e": 0.608, **SPIRAL}, 3e-6, 5e-6),  # 12 % slower at its end
        ({"xdot0": 0.11, "mu": 0.154, "mu_s": 0.308}, 3e-6, 5e-6),
    ],
)
def test_a_long_spiral_is_foretold(scene, close, quicker):
    t = np.linspace(300, 2700, 4001) / 15
    track = track_of(simulate(**scene, periods=2700), t, sigma=1e-3)
    orbit = orbit_halfway(scene, 1500)
    radius, period = track.of(orbit)
    assert track.values["path_radius"] == pytest.approx(radius, abs=close)
    assert track.values["period"] == pytest.approx(period, rel=quicker)
    less = orbit.path.bend.imag / abs(orbit.precession_rate)  # than the rate of the heading is that of the velocity
    assert 1e-3 < abs(less) == pytest.approx(abs(track.values["path_radius"] / orbit.path_radius - 1), rel=0.3)


def test_the_swing_is_that_of_the_phase_of_the_plate():
    """A camera in step with the plate sees a circle of another radius at each phase; all of them are foretold."""
    run = simulate(periods=900)
    orbit = orbits.find(guess=simulate(periods=600))
    tracks = [track_of(run, (np.arange(300, 900) + share) / 15, sigma=1e-4) for share in np.arange(8) / 8]
    seen, foretold = np.array([[track.values["path_radius"], track.of(orbit)[0]] for track in tracks]).T
    assert np.ptp(seen) > 5e-4
    assert_allclose(seen, foretold, atol=0.02 * np.ptp(seen))


@pytest.mark.parametrize(
    ("scene", "periods"), [({"xdot0": 2.0}, 900), ({"xdot0": 0.16, **SPIRAL}, 4500), ({"xdot0": 0.12, **SPIRAL}, 4500)]
)
def test_the_slow_drift_of_a_run_counts_to_no_error_of_a_coordinate(scene, periods):
    rng = np.random.default_rng(8)
    run = simulate(**scene, periods=periods)
    track = track_of(run, rng.uniform(300, periods, 400) / 15, 1e-3, rng)
    assert track.sigma == pytest.approx(1e-3, rel=0.15)


# --- fits -------------------------------------------------------------------------------------------------------------
def test_what_made_the_data_is_found():
    true = {"e": 0.65, "A_r": 5.9, "spin": 120.0}
    orbit = orbits.find(**SLIPPY, **true)
    names = {"radius": 0.04, "zeta": 0.002, "impact_phase": 0.003, "speed": 0.004}
    measured = {name: (getattr(orbit, name), error) for name, error in names.items()}
    fit = fits.fit(measured, {"e": (0.58, 0.72), "A_r": (5.4, 6.6), "spin": (90, 150)}, **SLIPPY)
    assert fit.possible
    assert fit.undetermined == ()
    assert fit.valley is None
    for name, value in true.items():
        assert abs(fit.values[name] - value) < 0.01 * fit.errors[name], name
    assert fit.orbit.sequence == orbit.sequence
    assert fit.cost > fit.orbit.cost > 0


def test_an_error_is_that_of_the_datum_over_the_slope():
    slope = np.diff([orbits.find(e=e).radius for e in (0.6495, 0.6505)])[0] / 1e-3
    fit = fits.fit({"radius": (orbits.find(e=0.65).radius, 0.01)}, {"e": (0.55, 0.75)})
    assert fit.errors["e"] == pytest.approx(abs(0.01 / slope), rel=1e-3)
    assert fit.singular_values[0] == pytest.approx(0.2 / fit.errors["e"])


def test_the_probability_of_a_misfit_is_that_of_the_data_less_the_free_parameters():
    """Two values and a free parameter leave one degree of freedom: the square of one normal deviation."""
    orbit = orbits.find(e=0.65)
    measured = {"radius": (orbit.radius + 0.02, 0.01), "zeta": (orbit.zeta + 0.002, 0.001)}
    fit = fits.fit(measured, {"e": (0.55, 0.75)})
    assert 0.1 < fit.chi_square < 30
    assert fit.probability == pytest.approx(erfc((fit.chi_square / 2) ** 0.5), rel=1e-9)
    assert fit.possible == (fit.chi_square < 9)


def test_tracks_of_runs_give_restitution_and_spin():
    """The sum of six squared deviations in errors is chi-square: below 22 in 999 of 1,000 cases."""
    apart = []
    for seed, (xdot0, model, e) in enumerate([(0.1, {}, 0.6), (0.3, {}, 0.6), (-0.8, SLIPPY, 0.66)]):
        rng = np.random.default_rng([11, seed])
        run = simulate(xdot0=xdot0, e=e, **model, periods=1500)
        t = np.sort(rng.uniform(300, 1500, 250)) / run.parameters["f"]
        middle = simulate(xdot0=xdot0, e=e, **model, periods=round(7.5 * (t[0] + t[-1])), record=False)
        spin = abs(middle.orbit.spin)
        free = {"e": (e - 0.04, e + 0.05), "spin": (0.8 * spin, 1.2 * spin)}
        fit = fits.fit(track_of(run, t, 2e-3, rng), free, **model)
        assert fit.possible
        assert fit.errors["e"] < 1e-3 and fit.errors["spin"] < 2e-3 * spin
        apart += [(fit.values["e"] - e) / fit.errors["e"], (fit.values["spin"] - spin) / fit.errors["spin"]]
    assert 0.3 < np.sum(np.square(apart)) < 22


def test_the_radius_of_equation_11_is_not_that_of_a_track():
    orbit = orbits.find(spin=14.3)
    by_path, by_other = (fits.Likelihood({name: (4.2663, 1e-3)}, {"e": (0.55, 0.65)}, spin=14.3) for name in RADII)
    assert abs(by_path.residuals(orbit)[0]) < 0.1 < 200 < abs(by_other.residuals(orbit)[0])
    track = fits.circle(*around(4.2663, 0.017, 300, 0.7), sigma=1e-3)
    assert track.measured.names == ("path_radius", "period")
    assert track.measured.also(zeta=(1.9, 0.01)).track is track


@pytest.mark.slow
def test_true_values_lie_within_the_errors_as_often_as_they_should():
    """Eight sets of one free parameter: the sum of their squared deviations is chi-square, 1.3 to 22 in 99 of 100 cases."""
    apart = []
    for seed in range(8):
        rng = np.random.default_rng([27, seed])
        true = rng.uniform(0.62, 0.68)
        radius = orbits.find(e=true, **SLIPPY).radius + rng.normal(0, 0.02)
        fit = fits.fit({"radius": (radius, 0.02)}, {"e": (0.6, 0.72)}, **SLIPPY)
        apart.append((fit.values["e"] - true) / fit.errors["e"])
    assert 1.3 < np.sum(np.square(apart)) < 22
    assert np.min(apart) < 0 < np.max(apart)


def test_no_restitution_and_friction_give_a_radius_below_the_least():
    """The least of a grid of orbits, which no solver has chosen, is what the fit comes to."""
    free = {"e": (0.5, 0.85), "mu": (0.05, 0.4)}
    fit = fits.fit({"radius": (3.1, 0.02)}, free)
    assert not fit.possible
    assert "No parameters found" in fit.notes[0] and "3.1" in fit.notes[0]
    assert np.isnan(fit.covariance).all()
    assert [note.split(":")[0] for note in fit.notes[1:]] == [
        "e is at the upper end of its range",
        "mu is at the lower end of its range",
    ]
    least = min(orbits.find(e=e, mu=mu).radius for e in np.linspace(0.65, 0.85, 5) for mu in np.linspace(0.05, 0.4, 4))
    assert fit.predicted[0] == pytest.approx(least, abs=1e-4)
    assert fit.predicted[0] == pytest.approx(3.745, abs=2e-3)


def test_improbable_data_have_the_errors_that_probable_ones_have():
    """The data may be off by more than their errors say; those of the parameters follow from the slopes all the same."""
    orbit, free = orbits.find(e=0.65, spin=120.0, **SLIPPY), {"e": (0.6, 0.7)}
    true = {"radius": (orbit.radius, 0.02), "speed": (orbit.speed, 0.002)}
    fit = fits.fit(true, free, spin=120.0, **SLIPPY)
    off = fits.fit(true | {"speed": (orbit.speed + 0.03, 0.002)}, free, spin=120.0, **SLIPPY)
    assert fit.possible and not off.possible
    assert "No parameters found" in off.notes[0]
    assert off.errors["e"] == pytest.approx(fit.errors["e"], rel=0.3)


@pytest.mark.slow
def test_where_the_stable_orbits_end_it_says_so():
    fit = fits.fit({"radius": (6.0, 0.1)}, {"e": (0.553, 0.6)}, spin=100.0)
    assert not fit.possible
    assert "border of the stable orbits" in " ".join(fit.notes)
    with pytest.raises(OrbitError):
        orbits.find(e=fit.values["e"] - 1e-4, spin=100.0)
    assert fit.predicted[0] < 6.0 - 0.1


def test_a_value_at_the_end_of_its_range_is_told():
    fit = fits.fit({"radius": (4.06, 0.02)}, {"e": (0.55, 0.648)})
    assert fit.possible
    assert fit.notes == ("e is at the upper end of its range: the true value may lie beyond.",)


# --- what the data leave open -----------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def in_a_valley():
    """A fit of two parameters to one radius, and the lines that it prints."""
    free, printed = {"e": (0.58, 0.75), "A_r": (5.8, 6.2)}, StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stderr(printed):
        every_line(patch)
        fit = fits.fit({"radius": (4.06, 0.02)}, free, **SLIPPY)
    return fit, printed.getvalue().splitlines()


def test_one_radius_does_not_tell_two_parameters(in_a_valley):
    fit, _ = in_a_valley
    assert fit.possible
    assert fit.singular_values[1] == 0
    assert len(fit.undetermined) == 2
    assert "e, A_r are not determined apart" in fit.undetermined[1]
    assert fit.errors["e"] == np.inf  # all of its range gives the radius
    least, most = fit.valley.extent[:, 1]
    assert 0.2 * (most - least) < fit.errors["A_r"] < 0.4 * (most - least) < 0.4 * 0.4
    step = fit.directions[1] * [0.17, 0.4]  # along it the radius stays, to first order
    values = np.array(list(fit.values.values()))
    ahead, back = (
        orbits.find(**dict(zip(fit.values, values + s * step, strict=True)), **SLIPPY).radius for s in (1e-3, -1e-3)
    )
    assert abs(ahead - back) / 2e-3 < 0.02 * fit.singular_values[0] * 0.02


def test_a_parameter_without_effect_is_named():
    data = {"radius": (4.06, 0.02), "speed": (0.72, 0.005)}
    fit = fits.fit(data, {"e": (0.58, 0.75), "beta0": (0.1, 0.3)}, **SLIPPY)
    assert [each.split(":")[0] for each in fit.undetermined] == ["beta0 is not determined"]
    assert fit.errors["beta0"] == np.inf
    assert np.isfinite(fit.errors["e"])


def test_radius_period_and_speed_are_two_numbers():
    orbit = orbits.find(spin=120.0, e=0.65, **SLIPPY)
    data = {name: (getattr(orbit, name), 1e-3 * getattr(orbit, name)) for name in ("radius", "period", "speed")}
    fit = fits.fit(data, {"e": (0.6, 0.7), "A_r": (5.8, 6.2), "spin": (110, 130)}, **SLIPPY)
    assert fit.possible
    assert fit.singular_values[2] < 12**0.5 < fit.singular_values[1]
    assert any("not determined apart" in each for each in fit.undetermined)


def test_an_error_leaves_out_nothing_that_is_open():
    """Radius alone, with e and mu free: by the slopes at one point e had an error of 5e-6, 1,000 times too small."""
    scene = {"mu_s": 0.5, "Gamma": 0.9738, "f": 22, "r": 4e-3, "A_r": 5.75, "spin": 180.65}
    radius, error = orbits.find(e=0.63, mu=0.25, **scene).path_radius, 1.65e-5
    fit = fits.fit({"path_radius": (radius, error)}, {"e": (0.5, 0.8), "mu": (0.2, 0.5)}, **scene)
    assert abs(fit.values["e"] - 0.63) < 2 * fit.errors["e"] < 0.01
    assert fit.errors["mu"] == np.inf
    assert "e, mu are not determined apart" in fit.undetermined[-1]
    assert "not all is determined" in repr(fit)
    for e, mu in fit.valley.values[::7]:  # each gives the datum
        assert orbits.find(e=e, mu=mu, **scene).path_radius == pytest.approx(radius, abs=error)
    e, mu = fit.valley.values.T
    assert np.ptp(mu) > 0.9 * 0.3
    assert min(e) < 0.63 < max(e)
    alone, _, pair, _ = fit.plot().axes
    profile = alone.lines[0].get_xdata()
    assert [min(profile), max(profile)] == [min(e), max(e)]
    seen = np.concatenate([path.vertices for region in pair.collections for path in region.get_paths()])
    assert (np.abs(np.ptp(seen, axis=0) - np.ptp(fit.valley.values, axis=0)) < 0.2 * np.ptp(seen, axis=0)).all()


def test_the_errors_in_a_valley_are_those_of_the_density_in_the_ranges():
    """A curved valley across a square, wider at one end: evenly drawn points that are weighted by the likelihood."""

    def residuals(x, y):
        return (y - 0.2 - 0.6 * x**2) / 0.03 * (1 + x), (x - 0.4) / 0.4

    fine = np.linspace(0, 1, 100_001)
    lengths = np.concatenate([[0], np.cumsum(np.hypot(np.diff(fine), np.diff(0.6 * fine**2)))])
    x = np.interp(np.arange(0.01, lengths[-1], 0.02), lengths, fine)
    places = np.column_stack([x, 0.2 + 0.6 * x**2])
    slopes = np.array([[[-1.2 * a / 0.03 * (1 + a), (1 + a) / 0.03], [1 / 0.4, 0]] for a in x])
    valley = Valley.of(places, np.column_stack(residuals(*places.T)), slopes, 1, 0.02)
    drawn = np.random.default_rng(2).uniform(size=(2, 1_000_000))
    weights = np.exp(-0.5 * np.sum(np.square(residuals(*drawn)), axis=0))
    values = places[valley.middle]
    errors = np.sqrt(np.diag(valley.covariance(values)))
    inside = np.abs(drawn - values[:, None]) < errors[:, None]
    assert (inside @ weights / weights.sum()) == pytest.approx(0.6827, abs=0.01)


# --- the likelihood ---------------------------------------------------------------------------------------------------
def test_the_likelihood_is_the_normal_density_of_the_data():
    measured = fits.Measured(("radius", "zeta"), np.array([4.06, 1.6]), np.array([[4e-4, 1e-5], [1e-5, 4e-6]]))
    measured = measured.also(speed=(0.72, 0.005))
    density = fits.Likelihood(measured, {"e": (0.55, 0.75), "spin": (100, 160)}, **SLIPPY)
    orbit = orbits.find(e=0.66, spin=140.0, **SLIPPY)
    seen = [orbit.radius, orbit.zeta, orbit.speed]
    wanted = multivariate_normal(measured.values, measured.covariance).logpdf(seen)
    assert density([0.66, 140.0]) == pytest.approx(wanted, rel=1e-8)
    assert pickle.loads(pickle.dumps(density))([0.66, 140.0]) == density([0.66, 140.0])
    assert density([0.5, 140.0]) == -np.inf  # beyond the range


def test_the_likelihood_is_zero_where_no_stable_orbit_is():
    density = fits.Likelihood({"radius": (4.06, 0.02)}, {"Gamma": (0.3, 1.5)})
    assert density([0.4]) == density([1.4]) == -np.inf  # below the fold, beyond the flip
    assert np.isfinite(density([0.9]))


def test_a_phase_is_measured_round_the_clock():
    orbit = orbits.find()
    density = fits.Likelihood({"impact_phase": (1 - 0.01, 0.01)}, {"e": (0.55, 0.75)})
    assert_allclose(density.residuals(orbit), (orbit.impact_phase + 0.01) / 0.01)
    for late in (-0.003, 0.003):
        density = fits.Likelihood({"impact_phase": (orbit.impact_phase + late, 0.01)}, {"e": (0.55, 0.75)})
        assert_allclose(density.residuals(orbit), -late / 0.01)


# --- input, output ----------------------------------------------------------------------------------------------------
def test_a_point_of_another_number_of_values_is_refused():
    density = fits.Likelihood({"radius": (4.06, 0.02)}, {"e": (0.55, 0.75), "A_r": (5, 6)})
    for point in ([0.6], [0.6, 5.5, 1.0], 0.6):
        with pytest.raises(ParameterError, match="point: must have 2 values: e, A_r"):
            density(point)
    assert density([0.6, np.nan]) == -np.inf


def test_where_no_orbit_is_it_says_why():
    with pytest.raises(OrbitError, match=r"no stable orbit at any of \d+ points of the ranges .* needs Gamma >="):
        fits.fit({"radius": (4.06, 0.02)}, {"Gamma": (0.3, 0.4)})


def test_a_fit_is_shown_as_a_line_a_table_and_a_picture():
    assert dimersweep.fit is fits.fit
    orbit = orbits.find(e=0.65, A_r=6.1, **SLIPPY)
    data = {"radius": (orbit.radius, 0.02), "impact_phase": (orbit.impact_phase, 0.003)}
    fit = fits.fit(data, {"e": (0.6, 0.7), "A_r": (5.8, 6.4)}, **SLIPPY)
    assert repr(fit).startswith("<Fit: e ") and "\n" not in repr(fit)
    rows = {line.split()[0]: line.split() for line in str(fit).splitlines()}
    for name in fit.values:
        assert float(rows[name][1]) == pytest.approx(fit.values[name], rel=1e-5)
        assert float(rows[name][2]) == pytest.approx(fit.errors[name], rel=0.05)
    assert float(rows["radius"][3]) == pytest.approx(fit.predicted[0], rel=1e-5)
    assert rows["cost:"][1] == f"{fit.cost:,.0f}"
    (axes,) = fit.plot().axes
    corners = axes.collections[0].get_paths()[0].vertices  # two standard deviations: extents of the parameters
    assert np.ptp(corners, axis=0) == pytest.approx([4 * error for error in fit.errors.values()], rel=1e-2)


@pytest.mark.parametrize("last", [0, 12, 25])
def test_a_fit_that_is_stopped_tells_the_best_values_so_far(monkeypatch, last):
    """Ctrl-C comes before an orbit was found, in the looks at the ranges, or in a descent."""
    measured, free, seen = {"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)}, []

    def interrupted(orbit):
        if len(seen) == last:
            signal.raise_signal(signal.SIGINT)
        seen.append((((orbit.path_radius - 4.06) / 0.02) ** 2, orbit.parameters["e"]))

    before_each_misfit(monkeypatch, interrupted)
    with pytest.raises(Stopped) as stop:
        fits.fit(measured, free, progress=False)
    assert stop.value.signal == signal.SIGINT and isinstance(stop.value, KeyboardInterrupt)
    told = "the fit has found no stable orbit so far"
    if seen:
        least, e = min(seen)
        told = f"the best values of the fit so far are e = {e:.6g} (chi-square {least:.4g}), without errors"
    assert str(stop.value) == told


@pytest.mark.parametrize("last", ["errors", "along the valley"])
def test_a_fit_tells_how_far_it_is_and_what_it_does(monkeypatch, capsys, last, request):
    if last == "errors":
        data, free = {"path_radius": (4.06, 0.02)}, {"e": (0.58, 0.75)}
        every_line(monkeypatch)
        fits.fit(data, free, **SLIPPY)
        lines = capsys.readouterr().err.splitlines()
    else:
        _, lines = request.getfixturevalue("in_a_valley")
    for doing in ("looking around", "descending", last):
        assert any(re.search(rf": {doing}: chi-square \S+$", line) for line in lines), doing
    counts = [[*map(int, re.match(r"(\d+)/(\d+) points, \d+ %, elapsed", line).groups())] for line in lines]
    assert [done for done, total in counts if done >= total] == [counts[-1][1]]
    if last == "errors":
        fits.fit(data, free, progress=False, **SLIPPY)
        assert capsys.readouterr().err == ""
