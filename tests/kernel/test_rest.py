"""A dimer that slides on both ends: what is told of its coming to rest, against runs in full."""

import numpy as np
import pytest

from dimersweep.kernel.model.layout import (
    CA,
    CB,
    FREE,
    N_STATE,
    PHASE,
    SLIP,
    SPIN,
    STICK,
    WP,
)
from dimersweep.kernel.record import HOP_TIME, MODES
from tests.checks.launch import launch
from tests.checks.verbs import (
    dimer,
    is_calm,
    rests_for_good,
    row_of,
    sliding_speed,
)

# slides that lift, though for long they seem not to: an end nearly stops, the moment falls to a trace, or it grows slowly
LIFTING = [  # Gamma, f, A_r, mu, mu_s; v_a, v_b, w, s, phase; phi0
    (
        0.9996842,
        35.80794,
        4.620539,
        0.3204815,
        0.4878604,
        -0.01833941,
        0.08655785,
        6.624712,
        -18.02963,
        0.4497256,
        2.213272,
    ),
    (
        0.9996544,
        39.88843,
        5.649449,
        1.292895,
        2.460356,
        0.07418007,
        0.10001798,
        6.356567,
        -18.26807,
        0.433498,
        4.720971,
    ),
    (
        0.6431324,
        9.605337,
        3.378588,
        0.9184543,
        0.9201247,
        -0.1855326,
        -0.0859825,
        -93.63443,
        -17.13127,
        5.628025,
        1.918647,
    ),
    (
        0.999074,
        21.22255,
        4.252586,
        0.2808631,
        0.519642,
        0.01392128,
        0.06771081,
        11.08975,
        -7.757620,
        0.2451663,
        3.176559,
    ),
    (
        0.9994133,
        20.10029,
        3.865574,
        0.08853865,
        0.1594474,
        -0.01311905,
        0.05719184,
        6.012467,
        -6.165245,
        1.417743,
        2.594063,
    ),
    (
        0.9996793,
        11.04876,
        2.657417,
        0.1961613,
        0.2509137,
        -0.04984723,
        -0.0008458474,
        20.80249,
        -0.1660765,
        0.9024614,
        1.854335,
    ),
    (
        0.9998446,
        19.20407,
        2.505392,
        0.1172121,
        0.2184352,
        3.90913,
        2.07403e-4,
        3.618026e-4,
        0.04152942,
        0.9775796,
        2.130838,
    ),
]
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
    return run.status != "ok" or bool((run.segments[:, MODES:HOP_TIME] == FREE).any())


@pytest.mark.jit
def test_what_is_told_to_rest_never_lifts():
    rng = np.random.default_rng(7)
    told, lifted = [], 0
    for _ in range(320):
        scene, state = random_slide(rng)
        if rests_for_good(dimer(**scene), state, BOTH_SLIP):
            told.append((scene, state))
        elif lifted < 3:
            lifted += lifts(scene, state)
    assert len(told) > 30
    assert lifted == 3  # the draw goes beyond the border
    assert not [scene for scene, state in told if lifts(scene, state)]


def slide_of(Gamma, f, A_r, mu, mu_s, v_a, v_b, turn, spin, phase, phi0=0.0):
    """A scene, and a slide in it."""
    scene = {"Gamma": Gamma, "f": f, "A_r": A_r, "mu": mu, "mu_s": mu_s, "phi0": phi0}
    return scene, sliding(v_a, v_b, turn, spin, phase)


@pytest.mark.jit
@pytest.mark.parametrize("slide", LIFTING)
def test_a_slide_that_lifts_late_is_not_told(slide):
    scene, state = slide_of(*slide)
    assert lifts(scene, state)
    assert not rests_for_good(dimer(**scene), state, BOTH_SLIP)


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
        if is_calm(dm, state) and not sliding_speed(dm, state) < 1e-3:
            calm += 1
            segments = launch(row_of(**scene), state, 10, rtol=1e-7).segments
            later = [sliding_speed(dm, segment[:N_STATE]) for segment in segments]
            assert max(later) <= sliding_speed(dm, state) + dm.mu * dm.A_z * dm.omega


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
