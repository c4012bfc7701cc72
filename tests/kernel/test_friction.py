"""The law of friction: its statements, and each closed form of it against them."""

from math import hypot

import numpy as np
import pytest

from dimersweep.kernel.contact.coordinates import N_Y, Y
from dimersweep.kernel.contact.forces import A1, A2, F1, F2, L1, L2, N_F
from dimersweep.kernel.model.layout import FREE, SLIP, STICK
from tests.checks import verbs
from tests.checks.verbs import dimer, end_law, hold_left, hold_reserve, outward_slip, scratch, slip_force, straight_leg

seeds = pytest.mark.parametrize("seed", range(6))


def scene(seed):
    """Random numbers, and a dimer whose three coefficients differ, and those of one end from those of the other."""
    rng = np.random.default_rng(seed)
    mu_1, mu_2 = rng.uniform(0.05, 0.8, 2)
    first = {"mu_1": mu_1, "mu_s_1": 2.0 * mu_1, "mu_h_1": 1.5 * mu_1}
    second = {"mu_2": mu_2, "mu_s_2": 2.2 * mu_2, "mu_h_2": 1.3 * mu_2}
    return rng, dimer(**first, **second, A_r=rng.uniform(2.5, 8.0))


@seeds
def test_friction_of_a_slip_opposes_it(seed):
    rng, dm = scene(seed)
    u, F = rng.normal(size=2), rng.uniform(0.1, 5.0)
    force = np.array(slip_force(dm.p1.mu, F, *(u / hypot(*u))))
    assert hypot(*force) == pytest.approx(dm.p1.mu * F, rel=1e-14)
    assert force @ u == pytest.approx(-dm.p1.mu * F * hypot(*u), rel=1e-14)


@seeds
@pytest.mark.parametrize("draws", [15, pytest.param(50, marks=pytest.mark.release)])
def test_two_held_ends_hold_where_some_split_of_the_axial_force_does(seed, draws):
    rng, dm = scene(seed)
    for _ in range(draws):
        F, L, A = rng.uniform(0.1, 2.0, 2), rng.normal(size=2) * 0.3, rng.normal()
        splits = A * np.linspace(-3.0, 4.0, 20_001)
        best = max(
            min(hold_left(dm.p1.mu_h, F[0], a, L[0]), hold_left(dm.p2.mu_h, F[1], A - a, L[1])) for a in splits[::20]
        )
        left = verbs.hold_left_of_pair(dm.p1.mu_h, F[0], L[0], dm.p2.mu_h, F[1], L[1], A)
        assert (best >= 0.0) == (left >= 0.0) or abs(left) < 1e-2


def test_a_lasting_contact_is_held_by_its_own_coefficient():
    """One end, both ends, and the law of an impact, which keeps mu_s."""
    dm = dimer(mu=0.2, mu_s=0.7, mu_h_1=0.4, mu_h_2=0.3)
    F = np.zeros(N_F)
    F[[F1, A1, L1]] = 1.0, 0.3, -0.1
    assert hold_reserve(dm, np.array([STICK, FREE], float), 0, F) == pytest.approx(0.4 - hypot(0.3, 0.1), rel=1e-14)
    F[[F2, A2, L2]] = 1.0, 0.2, 0.1
    assert hold_reserve(dm, np.array([FREE, STICK], float), 1, F) == pytest.approx(0.3 - hypot(0.2, 0.1), rel=1e-14)
    F[[F2, A1, L2]] = 2.0, 1.0, 0.0
    expected = (0.4**2 - 0.1**2) ** 0.5 + 0.6 - 1.0
    assert hold_reserve(dm, np.array([STICK, STICK], float), 0, F) == pytest.approx(expected, rel=1e-14)
    assert (end_law(dm, -1.0, 0.2).mu_s, dm.p1.mu_s, dm.p2.mu_s) == (0.7, 0.7, 0.7)


def contact(rng, both):
    """A contact state in the chart by heading."""
    y = np.zeros(N_Y)
    y[[Y.dip, Y.w_b]] = (0.0, 0.0) if both else (rng.uniform(0.05, 1.2), rng.normal())
    y[[Y.w_p, Y.spin, Y.u_a, Y.u_b]] = rng.normal(size=4) * [3, 40, 0.5, 0.5]
    return y


@seeds
def test_the_contact_of_two_slipping_ends(seed):
    """``double_forces``: each end has the friction of its own slip, and no gap opens."""
    rng, dm = scene(seed)
    y, dy, F = contact(rng, both=True), np.zeros(N_Y), np.zeros(N_F)
    verbs.contact_rates(dm, np.array([SLIP, SLIP], float), 0.0, y, dy, F)
    slips = [(y[Y.u_a], y[Y.u_b]), (y[Y.u_a], y[Y.u_b] - dm.l * y[Y.w_p])]
    friction = np.array(
        [
            slip_force(p.mu, F[k], *(np.array(u) / hypot(*u)))
            for p, k, u in zip((dm.p1, dm.p2), (F1, F2), slips, strict=True)
        ]
    )
    np.testing.assert_allclose(F[[A1, L1, L2]], [friction[:, 0].sum(), *friction[:, 1]], rtol=1e-12, atol=1e-14)
    assert F[F1] + F[F2] == pytest.approx(dm.m * dm.g, rel=1e-12)
    moment = dm.p2.h * (F[F1] - F[F2]) - dm.p1.r * F[A1]
    assert moment == pytest.approx(dm.J_a * y[Y.spin] * y[Y.w_p], rel=1e-11)


@seeds
def test_the_friction_of_an_impact_at_both_ends(seed):
    rng, dm = scene(seed)
    f_1, f_2, a, b_1, b_2 = rng.uniform(0.1, 2.0), rng.uniform(0.1, 2.0), *rng.normal(size=3)
    first, second = (
        slip_force(p.mu, f, a / hypot(a, b), b / hypot(a, b)) for p, f, b in ((dm.p1, f_1, b_1), (dm.p2, f_2, b_2))
    )
    expected = first[0] + second[0], first[1], second[1]
    np.testing.assert_allclose(verbs.pair_friction(dm, (SLIP, SLIP), f_1, f_2, a, b_1, b_2), expected, rtol=1e-13)


@seeds
@pytest.mark.parametrize("stick", [True, False])
def test_a_leg_at_constant_rates(seed, stick):
    """``straight_leg``: along the axis, where slip keeps its direction, with the impulses of the law."""
    rng, dm = scene(seed)
    law = end_law(dm, -1.0, rng.uniform(0.1, 1.0))
    a = 0.0 if stick else rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 5.0)
    c = 1.0 if a >= 0.0 else -1.0
    work, _ = scratch()
    straight_leg(law, -1.0, a, 0.0, STICK if stick else SLIP, c, 0.0, work)
    blow = work.course[0].blow
    expected = (-law.na / law.aa, 0.0) if stick else slip_force(law.mu, 1.0, c, 0.0)
    assert pytest.approx(expected, rel=1e-13) == (blow.A / blow.P, blow.B / blow.P)
    assert blow.n == pytest.approx(-1.0 + law.nn * blow.P + law.na * blow.A, abs=1e-13)
    assert (blow.a, blow.b) == pytest.approx((a + law.na * blow.P + law.aa * blow.A, 0.0), abs=1e-13)


@seeds
def test_a_slip_out_of_rest_is_driven_along_itself(seed):
    """What drives the contact, less the friction of that slip, points along the slip."""
    rng, _ = scene(seed)
    for _ in range(50):
        drive, k = rng.normal(size=2), rng.uniform(0.1, 1.0, 2)
        drive *= rng.uniform(1.0, 3.0) / hypot(*(drive / k))  # more than friction can hold
        d = np.array(outward_slip(*drive, *k))
        assert hypot(*d) == pytest.approx(1.0, rel=1e-14)
        left = drive - k * d
        assert left @ d >= -1e-12 and abs(left[0] * d[1] - left[1] * d[0]) <= 1e-12 * hypot(*drive)
