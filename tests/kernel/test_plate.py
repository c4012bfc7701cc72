"""The plate: every function of it against the derivatives of its height, with and without higher harmonics."""

from itertools import product
from math import pi

import mpmath
import numba
import numpy as np
import pytest

from dimersweep.kernel.compiler.jit import plain
from dimersweep.kernel.model import layout
from dimersweep.kernel.model import plate as plate_of
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import (
    D1,
    D2,
    DIP,
    FREE,
    HARMONICS,
    N1,
    N2,
    PHASE,
    ROW_PHI0,
    SLIP,
    STICK,
    WAVES,
    WB,
    WP,
)
from dimersweep.kernel.model.plate import motion, motion_along, started_at
from tests.checks import verbs
from tests.checks.verbs import dimer, gap_series, lightest, plate_bounds, plate_rate, rests_for_good, row_of, take_off
from tests.oracle import body as slow

PLATES = [
    {"Gamma": 0.9},
    {"Gamma": 0.9, "phi0": 2.0, "Gamma_2": 0.5, "phi_2": 1.0},
    {"Gamma": 0.0, "Gamma_2": 0.8, "phi_2": 4.0},
    {"Gamma": 1.3, "phi0": 1.0, "Gamma_2": 1e-3, "phi_2": 0.3},
    {"Gamma": 0.2, "phi0": 5.0, "Gamma_2": 2.5, "phi_2": 2.0},
]
# a saw-tooth of all harmonics, those of a shaker, and the highest one beside the first
SAW = {Gamma: 1.2 / k for k, (Gamma, _) in enumerate(WAVES[0], 1)}
SAW |= {phi: 0.7 * k + pi * (k % 2) for k, (_, phi) in enumerate(WAVES[0], 1)}
PLATES += [
    SAW,
    {"Gamma": 1.1, "phi0": 0.4, "Gamma_2": 0.03, "phi_2": 1.0, "Gamma_3": 0.01, "phi_3": 5.0},
    {"Gamma": 0.6, f"Gamma_{HARMONICS}": 0.5, f"phi_{HARMONICS}": 2.0},
]
plates = pytest.mark.parametrize("plate", PLATES)
CYCLE = np.linspace(0.0, 2 * pi, 4001)


def height(plate, t):
    """z_p as declared, in 40 digits."""
    omega = 2 * mpmath.pi * 15
    return mpmath.fsum(
        plate[Gamma] * mpmath.mpf("9.81") / (k * omega) ** 2 * mpmath.sin(k * omega * t + plate.get(phi, 0.0))
        for k, (Gamma, phi) in enumerate(WAVES[0], 1)
        if Gamma in plate
    )


def made(plate, **others):
    """The dimer on a plate, its row, and the phases of a cycle."""
    row = row_of(**plate, **others)
    dm = dimer_of(row)
    return dm, row, CYCLE + dm.phi0


@plates
def test_height_and_its_derivatives(plate):
    dm, _, _ = made(plate)
    with mpmath.workdps(40):
        for t in (0.0, 0.013, 0.05):
            phase = dm.omega * t + dm.phi0
            exact = [float(mpmath.diff(lambda x: height(plate, x), mpmath.mpf(t), n)) for n in range(3)]
            np.testing.assert_allclose(motion(dm, phase), exact, rtol=1e-12, atol=1e-13)
            assert plate_rate(dm, phase) == pytest.approx(exact[1], rel=1e-12, abs=1e-14)
            assert verbs.effective_gravity(dm, phase) == pytest.approx(dm.g + exact[2], rel=1e-12, abs=1e-13)


@plates
def test_the_oracles_plate_is_the_same(plate):
    dm, _, _ = made(plate)
    d = slow.dimer(plate)
    for t in (0.0, 0.01, 0.04):
        phase = dm.omega * t + dm.phi0
        assert slow.plate_velocity(d, t)[2] == pytest.approx(plate_rate(dm, phase), rel=1e-12, abs=1e-14)
        assert slow.felt(d, t)[2] == pytest.approx(-verbs.effective_gravity(dm, phase), rel=1e-12, abs=1e-13)


@plates
def test_the_least_gravity_of_a_cycle(plate):
    """It is reached, but for a share of 1e-9 by which it may be taken too low."""
    dm, _, phases = made(plate)
    gravity = dm.g + motion(dm, phases)[2]
    around = phases[np.argmin(gravity)] + np.linspace(-2e-3, 2e-3, 20_001)
    least = min(gravity.min(), (dm.g + motion(dm, around)[2]).min())
    assert lightest(dm) <= least + 1e-12
    assert lightest(dm) == pytest.approx(least, abs=1e-6 * dm.g)


def test_crests_of_random_waves_are_certain():
    """Also of two that are equally high, and of flat ones (Gamma_2 = Gamma / 4 at a lag of 90 degrees)."""
    rng = np.random.default_rng(3)
    special = [(1.0, 0.5, pi / 2), (1.0, 0.5, 0.0), (1.0, 0.25, 1.5 * pi), (1.0, 0.25, pi / 2), (0.0, 1.0, 0.7)]
    drawn = [(rng.uniform(0, 2), rng.uniform(1e-6, 2), rng.uniform(0, 2 * pi)) for _ in range(60)]
    for Gamma, Gamma_2, phi_2 in special + drawn:
        dm, _, phases = made({"Gamma": Gamma, "Gamma_2": Gamma_2, "phi_2": phi_2})
        least = (dm.g + motion(dm, phases)[2]).min()
        bend = (Gamma + 4 * Gamma_2) * dm.g
        assert lightest(dm) <= least + 1e-12
        assert lightest(dm) >= least - bend * (CYCLE[1] / 2) ** 2 / 2 - 2e-9 * bend


@pytest.mark.skipif(not numba.config.DISABLE_JIT, reason="counts the calls of plain Python")
def test_a_crest_is_found_in_few_steps_wherever_it_lies(monkeypatch):
    """Also where it is flat, or another one is nearly as high."""
    asked, wave = [], plate_of.wave

    def counted(*arguments):
        asked.append(arguments)
        return wave(*arguments)

    monkeypatch.setattr(plate_of, "wave", counted)
    rng = np.random.default_rng(4)
    lags = np.append(np.linspace(0.0, 2 * pi, 41), rng.uniform(0.0, 2 * pi, 60))
    for ratio in (1e-4, 0.21, 0.25, 1.0, 4.83, 1e2, 1e4):
        for lag in lags:
            asked.clear()
            plate_of.crest(made({"Gamma": 1.0, "Gamma_2": ratio, "phi_2": lag})[0])
            assert len(asked) < 2000, (ratio, lag)  # a flat crest takes the most, others below 200


@plates
def test_bounds_of_the_derivatives(plate):
    """No derivative exceeds its bound, and a single harmonic reaches it."""
    dm, _, phases = made(plate)
    speed, heaviest, jerk, snap = plate_bounds(dm)
    _, rate, acceleration = motion(dm, phases)
    step = (phases[1] - phases[0]) / dm.omega
    third = np.gradient(acceleration, step)
    seen = [
        np.abs(rate).max(),
        (dm.g + acceleration).max(),
        np.abs(third).max(),
        np.abs(np.gradient(third, step)).max(),
    ]
    bounds = [speed, heaviest, jerk, snap]
    assert (np.array(seen) <= np.array(bounds) * (1 + 1e-9)).all()
    if (dm.A != 0.0).sum() == 1:
        np.testing.assert_allclose(seen, bounds, rtol=1e-4)


@plates
def test_a_later_start_is_the_same_plate_later(plate):
    """Shifting both phases, one twice as far, is waiting."""
    dm, row, _ = made(plate)
    later = dimer_of(started_at(row, row[ROW_PHI0] + 0.7))
    np.testing.assert_allclose(motion(later, later.phi0 + 0.2), motion(dm, dm.phi0 + 0.9), atol=1e-13)


def hop(plate, seed):
    """A flight that starts on the plate."""
    dm, _, _ = made(plate)
    rng = np.random.default_rng(seed)
    state = np.zeros(layout.N_STATE)
    state[PHASE], state[DIP] = rng.uniform(0, 2 * pi), rng.uniform(0.0, 0.4)
    state[[WB, WP, layout.SPIN]] = rng.normal(size=3) * [5, 5, 60]
    state[N1] = 10.0 ** rng.uniform(-6, 0)
    state[D2] = state[D1] + dm.l * np.sin(state[DIP])
    state[N2] = state[N1] + dm.l * np.cos(state[DIP]) * state[WB]
    return dm, state


@plates
@pytest.mark.parametrize("seed", range(4))
def test_the_gap_of_a_flight(plate, seed):
    """Its derivatives, and the plate's part in it, which grows from nothing to all digits."""
    dm, state = hop(plate, seed)
    fl, still = take_off(dm, state), made({"Gamma": 0.0})[0]
    at_rest = still, take_off(still, state)
    start = state[PHASE] + dm.phi0
    with mpmath.workdps(40):
        t_0 = (mpmath.mpf(float(start)) - plate.get("phi0", 0.0)) / (2 * mpmath.pi * 15)
        for t in (1e-7, 1e-4, 3e-3, 0.1):
            z, rate = height(plate, t_0), mpmath.diff(lambda x: height(plate, x), t_0)
            moved = float(height(plate, t_0 + t) - z - rate * t)
            apart = np.array(gap_series(*at_rest, -1.0, t)) - gap_series(dm, fl, -1.0, t)
            assert apart[0] == pytest.approx(moved, rel=1e-9, abs=1e-16 * max(1.0, state[N1]))
            higher = [float(mpmath.diff(lambda x: height(plate, x), t_0 + t, n)) for n in (1, 2, 3)]
            higher[0] -= float(rate)
            np.testing.assert_allclose(apart[1:], higher, rtol=1e-9, atol=1e-12)
            fourth = abs(float(mpmath.diff(lambda x: height(plate, x), t_0 + t, 4)))
            assert fourth + fl.bound4 - plate_bounds(dm)[3] <= fl.bound4 * (1 + 1e-12)


@plates
@pytest.mark.parametrize("seed", range(10))
def test_landings_are_the_first_ones(plate, seed):
    dm, state = hop(plate, seed)
    fl = take_off(dm, state)
    t, _ = verbs.first_landing(dm, fl, -1.0, 3.0)
    before = t * np.linspace(1e-6, 1.0 - 1e-9, 1001)
    gaps = np.array([gap_series(dm, fl, -1.0, x)[0] for x in before])
    assert (gaps > 0.0).all()
    gap, rate, _, _ = gap_series(dm, fl, -1.0, t)
    assert abs(gap) <= 1e-13 * (abs(rate) + 1.0) and rate < 0.0


def test_what_rests_for_good_is_told_by_the_least_gravity_of_the_cycle():
    """Not by the intensities: two harmonics of 0.7 leave the dimer down, or throw it off, as their phases have it."""
    held = np.array([STICK, STICK], float)
    told = {}
    for phi_2 in (0.0, pi / 2, 1.5 * pi):
        dm, _, phases = made({"Gamma": 0.7, "Gamma_2": 0.7, "phi_2": phi_2})
        told[phi_2] = rests_for_good(dm, held)
        assert told[phi_2] == ((dm.g + motion(dm, phases)[2]).min() > 0.0)
    assert True in told.values() and False in told.values()


def test_only_two_ends_that_stick_rest_for_good():
    for modes in product((FREE, STICK, SLIP), repeat=2):
        assert rests_for_good(dimer(Gamma=0.9999), np.array(modes, float)) == (modes == (STICK, STICK))
        assert not rests_for_good(dimer(Gamma=1.0001), np.array(modes, float))


ALONG = {
    "Gamma_y": {"Gamma_y": 0.3, "phi_y": 0.4},
    "Gamma_x": {"Gamma_x": 0.3, "phi_x": 0.4},
    "tilt": {"tilt": 0.2, "azimuth": 0.7},
    "all": {"tilt": 0.1, "azimuth": 0.7, "Gamma_x": 0.2, "phi_x": 1.2, "Gamma_y": 0.3, "phi_y": 1.2},
}


@pytest.mark.parametrize("name", ALONG)
def test_the_bound_of_the_acceleration_along_the_plate_is_its_greatest(name):
    """Over all phases and headings; where both axes are in phase with each other it is reached."""
    g, scene = 9.81, ALONG[name]
    tilt, azimuth = scene.get("tilt", 0.0), scene.get("azimuth", 0.0)
    x, y = (
        g * np.sin(tilt) * way + scene.get(f"Gamma_{axis}", 0.0) * g * np.sin(CYCLE + scene.get(f"phi_{axis}", 0.0))
        for axis, way in (("x", np.cos(azimuth)), ("y", np.sin(azimuth)))
    )
    assert plain(plate_of.most_along)(dimer(**scene)) == pytest.approx(np.hypot(x, y).max(), rel=1e-5)


@pytest.mark.parametrize("phi0", [0.0, 2.3])
def test_velocity_and_acceleration_along_the_plate_are_derivatives_of_its_place(phi0):
    """With another phase and intensity along each axis; seen from the plate a body is accelerated the other way."""
    tilt, azimuth, g = 0.1, 0.7, 9.81
    shaken = {"Gamma_x": 0.2, "phi_x": 1.2, "Gamma_y": 0.5, "phi_y": 4.0}
    third = {"Gamma_x_3": 0.07, "phi_x_3": 2.2, "Gamma_y_3": 0.04, "phi_y_3": 0.5}
    dm = dimer(**third, tilt=tilt, azimuth=azimuth, phi0=phi0, **shaken)
    fall = g * np.sin(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
    for phase in np.linspace(0, 2 * np.pi, 7):
        step = 1e-5
        ahead, here, back = (np.array(motion_along(dm, phase + by)) for by in (step, 0.0, -step))
        rates = (ahead - back) / (2 * step) * dm.omega
        np.testing.assert_allclose(here[2:], rates[:2], atol=1e-9)
        angles = phase + np.array([shaken["phi_x"], shaken["phi_y"]])
        velocity = g * np.array([0.2, 0.5]) / dm.omega * np.cos(angles)
        velocity += g * np.array([0.07, 0.04]) / (3 * dm.omega) * np.cos(3 * phase + np.array([2.2, 0.5]))
        np.testing.assert_allclose(here[2:], velocity, atol=1e-14)
        for theta in (0.0, 0.9):
            a_a, a_b, v_x, v_y = verbs.along_plate(dm, phase, theta)
            np.testing.assert_allclose([v_x, v_y], here[2:], atol=1e-14)
            room = fall - rates[2:]
            axis, across = [-np.sin(theta), np.cos(theta)], [np.cos(theta), np.sin(theta)]
            np.testing.assert_allclose([a_a, a_b], [room @ axis, room @ across], atol=3e-7)
