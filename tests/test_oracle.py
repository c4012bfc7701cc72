"""Quick checks of the slow oracle itself: its matrices, its impact law, and one stored run."""

import json
import os
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest

from tests.oracle import body, impact, simulate, three_balls

HERE = Path(__file__).resolve().parent
SMALL = json.loads((HERE / "reference" / "small.json").read_text())
SHARED = Path(os.environ.get("DIMERSWEEP_SHARED", HERE.parents[1] / "shared"))
D = body.dimer({"r_1": 6e-3, "r_2": 4e-3, "rho_b_2": 5000.0, "l": 0.05, "mu": 0.3})


def random_motion(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.2, 1.2, 6), rng.normal(size=6) * [1, 1, 1, 3, 4, 20]


def rotation(q):
    """Body axes as columns: e1 from end 1 to end 2, then two that turn with gamma."""
    beta = D.beta_0 + q[4]
    st, ct, sb, cb, sg, cg = sin(q[3]), cos(q[3]), sin(beta), cos(beta), sin(q[5]), cos(q[5])
    e1, b = np.array([-cb * st, cb * ct, sb]), np.array([ct, st, 0.0])
    return np.column_stack([e1, cg * b + sg * np.cross(e1, b), cg * np.cross(e1, b) - sg * b])


def centre(q, along):
    """Point of the axis at `along` from the centre of ball 1."""
    return q[:3] + along * rotation(q)[:, 0]


def rate(function, q, qdot, h=1e-6):
    """Central difference of function(q) along qdot."""
    return (function(q + h * qdot) - function(q - h * qdot)) / (2 * h)


def spin(q, qdot):
    """Angular velocity in body axes, from the rotation matrix alone."""
    S = rotation(q).T @ rate(rotation, q, qdot)
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


@pytest.mark.parametrize("seed", range(3))
def test_contact_matrices_are_velocities_of_the_contact_points(seed):
    q, qdot = random_motion(seed)
    W, N = body.normal_matrix(D, q), body.tangential_matrix(D, q)
    for i, along in enumerate((0.0, D.l)):
        down = rotation(q).T @ np.array([0, 0, -D.r[i]])  # the material point that touches the plate now
        v = rate(lambda s, along=along, down=down: centre(s, along) + rotation(s) @ down, q, qdot)
        assert [N[:, i] @ qdot, N[:, 2 + i] @ qdot, W[:, i] @ qdot] == pytest.approx(v, abs=1e-7)
    assert body.gap_rates(D, q, qdot) == pytest.approx(rate(lambda s: body.gaps(D, s), q, qdot), abs=1e-7)
    assert body.gap_rates(D, q, qdot) == pytest.approx(W.T @ qdot)


@pytest.mark.parametrize("seed", range(3))
def test_biases_are_rates_of_the_contact_matrices(seed):
    q, qdot = random_motion(seed)
    tangential = rate(lambda s: body.tangential_matrix(D, s).T @ qdot, q, qdot)
    normal = rate(lambda s: body.normal_matrix(D, s).T @ qdot, q, qdot)
    assert body.tangential_bias(D, q, qdot) == pytest.approx(tangential, rel=1e-6, abs=1e-7)
    assert body.normal_bias(D, q, qdot) == pytest.approx(normal, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_mass_matrix_and_inertial_forces_follow_from_the_kinetic_energy(seed):
    q, qdot = random_motion(seed)
    v, w = rate(lambda s: centre(s, D.h), q, qdot), spin(q, qdot)
    energy = (D.m * v @ v + D.J2 * w[0] ** 2 + D.J1 * (w[1] ** 2 + w[2] ** 2)) / 2
    M = body.mass_matrix(D, q)
    assert qdot @ M @ qdot / 2 == pytest.approx(energy, rel=1e-7)
    # Euler and Lagrange: M q'' = h with h = dT/dq - M' q'
    gradient = [rate(lambda s: qdot @ body.mass_matrix(D, s) @ qdot / 2, q, unit) for unit in np.eye(6)]
    h = np.array(gradient) - rate(lambda s: body.mass_matrix(D, s) @ qdot, q, qdot)
    assert body.inertial_forces(D, q, qdot) == pytest.approx(h, abs=1e-8)


@pytest.mark.parametrize(("A_r", "mubar"), [(4, 0.29643), (5, 0.23932), (6, 0.19958), (7, 0.17103)])
def test_axial_stick_ratio(A_r, mubar):
    G, _ = body.delassus(body.dimer({"A_r": A_r}), np.zeros(6))  # theta = 0: the axis lies along y
    assert abs(G[0, 0, 0, 2]) / G[0, 2, 0, 2] == pytest.approx(mubar, abs=1e-5)


def test_three_balls():
    assert three_balls(1.0, eta=1.0) == pytest.approx([-0.13026, 0.15023, 0.98003], abs=5e-6)
    assert three_balls(1.0) == pytest.approx([-0.070952354, 0.076403039, 0.994549315], abs=1e-8)
    assert three_balls(0.6) == pytest.approx([0.167595879, 0.182847277, 0.649556845], abs=1e-8)
    assert three_balls(0.6, (1, 0, -1)) == pytest.approx([-0.6, 0, 0.6], abs=1e-10)  # by symmetry
    assert three_balls(0.0) == pytest.approx([1 / 3] * 3, abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
def test_single_smooth_impact_is_newtons(e):
    q, qdot = random_motion(5)
    _, details = impact({"e": e, "mu": 0.0, "mu_s": 0.0}, q, [*qdot[:2], -0.3, *qdot[3:]], (True, False))
    assert details["gap_rates_plus"][0] == pytest.approx(0.3 * e, abs=1e-10)


def test_energetic_restitution_with_friction():
    """While the slip direction stays, the effective compliance is constant and energetic restitution is Newton's."""
    params = {"A_r": 6, "e": 0.7, "mu": 0.1, "mu_s": 0.1}
    q = [0, 0, 0, 0, 0.3, 0]
    fast = 1e6  # along the axis, so that it goes on slipping
    after, _ = impact(params, q, [0, fast, -0.2, 0, 0, 0], (True, False))
    assert after[2] == pytest.approx(0.7 * 0.2, abs=1e-8)


def test_energy_never_grows():
    rng = np.random.default_rng(3)
    for k in range(15):
        double = k % 3 > 0
        mu = rng.uniform(0, 0.5)
        params = {"A_r": rng.uniform(2.5, 8), "mu": mu, "mu_s": mu * rng.uniform(1, 2)}
        params |= {"e_1": rng.uniform(0, 1), "e_2": rng.uniform(0, 1)}
        if k % 5 == 0:
            params |= {"e_1": 1.0, "e_2": 1.0, "mu": 0.0, "mu_s": 0.0}
        q = np.array([0, 0, 0, rng.uniform(-pi, pi), 0 if double else rng.uniform(-1, 1), 0])
        qdot = rng.normal(size=6) * [1, 1, 0.1, 1, 5, 100]
        qdot[2] = -abs(qdot[2])
        after, details = impact(params, q, qdot, (True, double))
        M = body.mass_matrix(body.dimer(params), q)
        ratio = (after @ M @ after) / (qdot @ M @ qdot)
        assert ratio <= 1 + 1e-10
        if k % 5 == 0:
            assert ratio == pytest.approx(1, abs=1e-9)
        assert min(details["gap_rates_plus"][: 1 + double]) >= -1e-9


def test_double_impact_with_one_end_at_rest_leaves_the_spurious_solution():
    """End 1 rests, end 2 lands, their normals repel: end 1 must take an impulse although its energy starts at zero."""
    _, details = impact({"A_r": 6}, np.zeros(6), [1, 0, 0, 0, -5, 0])
    assert details["impulse"][0, 0] > 0.01 * details["impulse"][1, 0]
    assert details["gap_rates_plus"][0] > 0


@pytest.mark.parametrize("k", range(0, 40, 5))
def test_stored_impacts(k):
    case = SMALL["impact_cases"][k]
    after, details = impact(case["params"], case["q"], case["qdot_minus"], case["closed"])
    assert np.abs(after - case["qdot_plus"]) / SMALL["scale"][6:] == pytest.approx(np.zeros(6), abs=1e-7)
    assert list(details["end"]) == case["end"]


@pytest.mark.parametrize("states", [2, pytest.param(3, marks=pytest.mark.release)])
@pytest.mark.parametrize("name", ["base", "strong shaking"])
def test_stored_run(name, states):
    case = next(c for c in SMALL["cases"] if c["name"] == name)
    stored = np.array(case["samples"])[:states]
    out = simulate(case["params"], stored[:, 0], rtol=1e-8, v_rest=1e-8)
    assert out["status"] == "done"
    assert np.abs(out["samples"] - stored)[:, 1:].T / np.array(SMALL["scale"])[:, None] == pytest.approx(0, abs=1e-6)


def test_dead_dimer_stays_on_the_plate():
    out = simulate({"Gamma": 0.3, "beta0": 0.02, "e": 0.3, "f": 25.0}, [0.06], rtol=1e-7, v_rest=1e-6)
    assert list(out["samples"][0, [3, 5, 9, 11]]) == [0, 0, 0, 0]


@pytest.mark.skipif(not (SHARED / "reference" / "states.json").exists(), reason="external reference not here")
@pytest.mark.parametrize("k", [2, 6, 10, 14])
def test_external_reference(k):
    reference = json.loads((SHARED / "reference" / "states.json").read_text())
    case = reference["cases"][k]
    expected = np.array(case["samples"])
    out = simulate(case["params"], expected[:, 0], rtol=1e-10)
    error = np.abs(out["samples"] - expected)[:, 1:] / np.array(reference["scale"])
    assert error.max() < 1e-6


@pytest.mark.skipif(not (SHARED / "reference" / "states_general.json").exists(), reason="external reference not here")
@pytest.mark.parametrize(("number", "samples"), [(0, 2), (3, 8), (5, 8), (6, 8), (8, 8), (10, 2)])
def test_external_reference_of_the_general_dimer(number, samples):
    cases = json.loads((SHARED / "reference" / "states_general.json").read_text())["cases"]
    case = next(case for case in cases if case["case"] == number)
    expected = np.array(case["samples"])[:samples]
    out = simulate(case["params"], expected[:, 0], rtol=1e-10, v_rest=1e-8)
    assert out["status"] == "done"
    assert (np.abs(out["samples"] - expected)[:, 1:] / SMALL["scale"]).max() < case["accuracy"]
