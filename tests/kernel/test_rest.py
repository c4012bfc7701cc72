"""A dimer that slides on both ends: what is told of its coming to rest, against runs in full."""

import numpy as np
import pytest
from launch import launch
from verbs import (
    commotion,
    contact_rates,
    dimer,
    is_calm,
    least_gravity,
    mean_gravity,
    rests_for_good,
    row_of,
    slide_rates,
    unload,
)

from dimersweep.kernel.charts import N_Y, YS, YUA, YUB, YWP
from dimersweep.kernel.contact import A1, N_F
from dimersweep.kernel.layout import CA, CB, FREE, N_STATE, PHASE, SLIP, SPIN, STICK, WP
from dimersweep.kernel.record import MODES, REST

BOTH_SLIP, BOTH_STICK = np.array([SLIP, SLIP], float), np.array([STICK, STICK], float)
PERIODS = 60


def sliding(v_a, v_b, turn, spin, phase=0.0):
    """A state with both ends on the plate."""
    state = np.zeros(N_STATE)
    state[[CA, CB, WP, SPIN, PHASE]] = v_a, v_b, turn, spin, phase
    return state


def least_room(dm):
    """What the gyroscopic moment may be at most, with all friction against it [N m]."""
    return dm.m * (dm.g - dm.A_z * dm.omega**2) * (dm.h - dm.r * dm.mu_s)


def random_slide(rng):
    """A scene, and a slide in it whose gyroscopic moment is now a hundredth of what it may be to all of it."""
    mu = float(rng.choice([rng.uniform(0.02, 0.4), rng.uniform(0.4, 2.0)]))
    scene = {
        "Gamma": float(rng.choice([rng.uniform(0.0, 0.9), 1.0 - 10.0 ** rng.uniform(-4.0, -1.0)])),
        "f": float(rng.uniform(5.0, 60.0)),
        "A_r": float(rng.choice([2.0, rng.uniform(2.0, 3.0), rng.uniform(3.0, 9.0)])),
        "mu": mu,
        "mu_s": mu * float(rng.uniform(1.0, 2.0)),
        "phi0": float(rng.uniform(0.0, 2.0 * np.pi)),
    }
    v, way = 10.0 ** rng.uniform(-2.0, 0.8), rng.uniform(0.0, 2.0 * np.pi)
    dm = dimer(**scene)
    spin = rng.normal() * v / dm.r * 10.0 ** rng.uniform(-1.0, 0.5)
    turn = 10.0 ** rng.uniform(-2.0, 0.0) * max(0.0, least_room(dm)) / (dm.J_a * spin)
    return scene, sliding(v * np.cos(way), v * np.sin(way), np.clip(turn, -80.0, 80.0), spin, rng.uniform(0.0, 6.28))


def lifts(scene, state):
    """Whether an end leaves the plate, or the run fails."""
    run = launch(row_of(**scene), state, PERIODS, rtol=1e-7)
    return run.status != "ok" or bool((run.segments[:, MODES:REST] == FREE).any())


@pytest.mark.jit
def test_what_is_told_to_rest_never_lifts():
    rng = np.random.default_rng(7)
    told, lifted = [], 0
    for _ in range(160):
        scene, state = random_slide(rng)
        if rests_for_good(dimer(**scene), state, BOTH_SLIP):
            told.append((scene, state))
        elif lifted < 3:
            lifted += lifts(scene, state)
    assert len(told) > 30
    assert lifted == 3  # the draw goes beyond the border
    assert not [scene for scene, state in told if lifts(scene, state)]


@pytest.mark.jit
def test_a_slide_whose_turning_grows_until_it_lifts_is_not_told():
    scene = {"Gamma": 0.0454, "f": 21.55, "A_r": 2.0, "mu": 0.0588, "phi0": 0.204}
    state = sliding(-3.4472, 0.1588, 0.2317, -837.8, 0.8317)
    dm = dimer(**scene)
    assert abs(dm.J_a * state[SPIN] * state[WP]) < 0.05 * least_room(dm)
    assert not rests_for_good(dm, state, BOTH_SLIP)
    assert lifts(scene, state)


@pytest.mark.jit
def test_a_calm_slide_keeps_its_bound():
    rng = np.random.default_rng(3)
    calm = 0
    while calm < 10:
        scene, state = random_slide(rng)
        dm = dimer(**scene)
        if is_calm(dm, state) and not commotion(dm, state) < 1e-3:
            calm += 1
            segments = launch(row_of(**scene), state, 10, rtol=1e-7).segments
            later = [commotion(dm, segment[:N_STATE]) for segment in segments]
            assert max(later) <= commotion(dm, state) + dm.mu * dm.A_z * dm.omega


@pytest.mark.parametrize("seed", range(5))
def test_rates_of_a_slide(seed):
    rng = np.random.default_rng(seed)
    dm = dimer(Gamma=float(rng.uniform(0.0, 0.9)), mu=float(rng.uniform(0.0, 1.0)), A_r=float(rng.uniform(2.5, 8.0)))
    state, phase = sliding(*rng.normal(size=3), 100.0 * rng.normal()), rng.uniform(0.0, 2.0 * np.pi)
    y, dy, F = np.zeros(N_Y), np.zeros(N_Y), np.zeros(N_F)
    unload(dm, state, -1.0, y)
    contact_rates(dm, BOTH_SLIP, phase, y, dy, F)
    weight = dm.m * (dm.g - dm.A_z * dm.omega**2 * np.sin(phase))
    d_a, d_b, d_w, d_s, axial = slide_rates(dm, weight / dm.m, state, 0.0)
    found = np.array([d_a, d_b + dm.h * d_w - dm.r * d_s, d_w, d_s, axial])
    assert found == pytest.approx(np.append(dy[[YUA, YUB, YWP, YS]], F[A1] / weight), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_gravity_over_a_step(seed):
    rng = np.random.default_rng(seed)
    dm = dimer(Gamma=float(rng.uniform(0.0, 1.0)))
    phase, swing = rng.uniform(-10.0, 10.0), 10.0 ** rng.uniform(-2.0, 1.0)
    gravity = dm.g - dm.A_z * dm.omega**2 * np.sin(phase + np.linspace(0.0, swing, 20_001))
    assert least_gravity(dm, phase, swing) == pytest.approx(gravity.min(), abs=1e-6)
    assert mean_gravity(dm, phase, swing) == pytest.approx(np.trapezoid(gravity) / 20_000, abs=1e-6)


def test_without_friction_only_the_spin_of_the_turning_rod_counts():
    dm = dimer(Gamma=0.3, mu=0.0)
    most = least_room(dm) / dm.J_a
    for v_a in (0.0, 5.0):
        assert rests_for_good(dm, sliding(v_a, 1.0, 2.0, 0.499 * most), BOTH_SLIP)
        assert not rests_for_good(dm, sliding(v_a, 1.0, 2.0, 0.501 * most), BOTH_SLIP)


def test_a_plate_that_falls_away_lets_nothing_rest():
    for mu_s in (0.4, 6.0):  # with the second one friction would lift the rod over its front end
        dm = dimer(Gamma=1.0001, mu=0.2, mu_s=mu_s)
        for modes in (BOTH_STICK, BOTH_SLIP):
            assert not rests_for_good(dm, sliding(0.0, 0.0, 0.0, 0.0), modes)
    still = dimer(Gamma=0.9999)
    assert rests_for_good(still, sliding(0.0, 0.0, 0.0, 0.0), BOTH_STICK)
    assert rests_for_good(still, sliding(0.0, 0.0, 0.0, 0.0), BOTH_SLIP)
    assert not rests_for_good(still, sliding(0.0, 0.0, 0.0, 0.0), np.array([SLIP, FREE], float))
