"""Masses and inertias to all digits; contact velocities and Delassus operator against the appendix' own matrices."""

from math import cos, pi, sin

import numpy as np
import pytest

from dimersweep.kernel.compiler.jit import plain
from dimersweep.kernel.compiler.records import as_object
from dimersweep.kernel.model.body import dimer_of, extent
from dimersweep.parameters import Parameters
from tests.checks.verbs import contact_velocity, delassus, dimer, levers, oracle_state, state_of
from tests.oracle import body

BODIES = [{}, {"A_r": 2.0}, {"A_r": 4.3, "r": 3e-3, "rho_b": 2500.0, "rho_r": 2700.0, "D_r": 6e-3}, {"A_r": 9.0}]
UNLIKE = {"r_1": 6e-3, "r_2": 3.5e-3, "rho_b_1": 2500.0, "A_r": 4.0}
BODIES += [UNLIKE, UNLIKE | {"r_1": 3e-3, "rho_r": 9000.0}]


def at(dm, s, beta):
    return levers(dm, s, sin(beta), cos(beta))


def random_motion(rng):
    q = np.concatenate([rng.normal(size=3), rng.uniform(-1.4, 1.4, 3)])
    return q, rng.normal(size=6) * [1, 1, 1, 3, 10, 80]


def test_constants_of_the_base_case():
    dm = dimer()
    assert dm.m == pytest.approx(8.813633469891e-3, rel=1e-12)
    assert dm.J_t == pytest.approx(5.299695485087e-6, rel=1e-12)
    assert dm.J_a == pytest.approx(8.339127315493e-8, rel=1e-12)
    assert dm.p2.h == pytest.approx(0.025, rel=1e-15)
    assert (dm.omega, dm.period) == (2 * pi * 15, 1 / 15)
    assert dm.A[0] * dm.omega**2 == pytest.approx(0.9 * 9.81, rel=1e-15)
    assert (dm.p1.e, dm.p2.e, dm.p1.mu, dm.g, dm.p1.r) == (0.6, 0.6, 0.2, 9.81, 5e-3)
    assert 0.4 <= dm.p1.mu_s <= 0.4 * (1 + 2e-9)  # a hair above, so that slip out of rest accelerates if mu = mu_s


@pytest.mark.parametrize(("phi0", "reduced"), [(0.5, 0.5), (2 * pi + 0.5, 0.5), (-0.5, 2 * pi - 0.5)])
def test_the_phase_at_the_start_is_reduced(phi0, reduced):
    assert dimer(phi0=phi0).phi0 == pytest.approx(reduced, rel=1e-15)


@pytest.mark.parametrize("change", BODIES)
def test_constants_against_the_oracle(change):
    dm, d = dimer(**change), body.dimer(change)
    np.testing.assert_allclose((dm.m, dm.J_t, dm.J_a, dm.l, dm.A[0]), (d.m, d.J1, d.J2, d.l, d.A[0, 2]), rtol=1e-14)


@pytest.mark.parametrize("change", BODIES)
@pytest.mark.parametrize("seed", range(5))
def test_contact_velocities_are_those_of_the_appendix(change, seed):
    dm, d = dimer(**change), body.dimer(change)
    q, qdot = random_motion(np.random.default_rng(seed))
    state = state_of(dm, q, qdot)
    along = body.axial_direction(q)
    rates, slips = body.gap_rates(d, q, qdot), body.slips(d, q, qdot)
    for i, s in enumerate((-1.0, 1.0)):
        expected = rates[i], slips[i] @ along, slips[i] @ [along[1], -along[0]]
        np.testing.assert_allclose(contact_velocity(dm, state, s), expected, rtol=1e-12, atol=1e-13)
    for given, back in zip((q, qdot), oracle_state(dm, state), strict=True):
        np.testing.assert_allclose(back, given, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("change", BODIES)
@pytest.mark.parametrize("beta", [0.0, 1e-3, -0.4, 0.7, 1.4])
def test_delassus_operator_is_that_of_the_appendix(change, beta):
    dm, d = dimer(**change), body.dimer(change)
    q = np.array([0, 0, 0, 0.8, beta - d.beta_0, 0.3])
    along = body.axial_direction(q)
    frame = np.zeros((3, 3))  # columns n, a, b in terms of the oracle's normal, x, y
    frame[0, 0], frame[1:, 1], frame[1:, 2] = 1, along, [along[1], -along[0]]
    blocks = np.einsum("ka,ikjl,lb->iajb", frame, body.delassus(d, q)[0], frame) * d.m
    for i, s in enumerate((-1.0, 1.0)):
        for j, t in enumerate((-1.0, 1.0)):
            w = delassus(dm, at(dm, s, beta), at(dm, t, beta))
            expected = blocks[i, :, j]
            matrix = np.array([[w.nn, w.na, 0], [w.an, w.aa, 0], [0, 0, w.bb]]) * d.m
            np.testing.assert_allclose(matrix, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("A_r", "mubar"), [(4, 0.29643), (5, 0.23932), (6, 0.19958), (7, 0.17103)])
def test_axial_stick_ratio_of_a_flat_dimer(A_r, mubar):
    dm = dimer(A_r=A_r)
    for s in (-1.0, 1.0):
        w = delassus(dm, at(dm, s, 0.0), at(dm, s, 0.0))
        assert abs(w.an) / w.aa == pytest.approx(mubar, abs=5e-6)
        assert abs(w.an) / w.aa == pytest.approx(dm.p2.h * dm.p1.r / (dm.J_t / dm.m + dm.p1.r**2), rel=1e-14)
    assert dm.pair.na_2 / dm.pair.aa == pytest.approx(mubar, abs=5e-6)


def test_coupling_of_the_normals_changes_sign_between_aspect_ratios_4_and_5():
    couplings = [dimer(A_r=A_r).pair.nn_12 for A_r in (3, 4, 5, 6)]
    assert [value > 0 for value in couplings] == [True, True, False, False]


@pytest.mark.parametrize(("tilt", "azimuth"), [(0.0, 0.0), (0.2, 0.0), (0.2, 0.7), (0.05, 4.0)])
def test_gravity_of_a_tilted_plate_is_one_vector(tilt, azimuth):
    """Along the normal and the axes of the plate: of the length of gravity, at the tilt, in the direction of the azimuth."""
    dm = dimer(**({"tilt": tilt, "azimuth": azimuth} if tilt else {}))
    np.testing.assert_allclose([dm.g, dm.fall_x, dm.fall_y], 9.81 * np.array(way_down(tilt, azimuth)), atol=1e-15)
    assert dm.A[0] * dm.omega**2 == pytest.approx(0.9 * 9.81, rel=1e-14)  # an intensity counts in the whole of gravity


def way_down(tilt, azimuth):
    """Unit vector of gravity in the axes normal (into the plate), X, Y of the plate."""
    return cos(tilt), sin(tilt) * cos(azimuth), sin(tilt) * sin(azimuth)


@pytest.mark.parametrize(
    ("given", "sideways"),
    [({}, 0.0), ({"tilt": 0.1}, 1.0), ({"Gamma_x": 0.1}, 1.0), ({"Gamma_y": 0.1}, 1.0), ({"Gamma_2": 0.3}, 0.0)],
)
def test_the_heading_counts_where_anything_acts_along_the_plate(given, sideways):
    assert dimer(**given).sideways == sideways


@pytest.mark.parametrize("change", [{}, UNLIKE, UNLIKE | {"r_1": 3e-3}, {"r_1": 3e-3, "r_2": 5e-3}])
def test_the_extent_is_that_of_the_greater_ball_and_of_the_farther_one(change):
    dm = dimer(**change)
    assert plain(extent)(dm) == (max(dm.p1.r, dm.p2.r), max(abs(dm.p1.h), abs(dm.p2.h)))


def test_a_dimer_as_a_plain_object_has_the_numbers_of_its_record():
    """With the JIT off it is one already."""
    record = dimer_of(Parameters(A_r=5.0, Gamma_2=0.1, phi_2=0.3).row())
    plainly = as_object(record)
    assert (plainly.l, plainly.p2.r, plainly.n_z) == (record.l, record.p2.r, record.n_z)
    np.testing.assert_array_equal(plainly.A_cos, record.A_cos)
    assert plainly.A_cos[1] != 0 and as_object(plainly) is plainly
