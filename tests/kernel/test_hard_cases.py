"""Cases in which event-driven codes fail, each with the reason why, at three accuracies.

Most are compared with a closed form; all must end, sink nowhere and gain no energy from nothing (``examine``).
"""

import os
from itertools import product
from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from dimersweep import simulate
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.contact_code import CONTACT_STATES, digits_of
from dimersweep.kernel.model.layout import C_IMPACT, C_LIFT_OFF, DIP, N1, N2, N_STATE, OK, PHASE, SPIN, THETA, WB, State
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from tests import oracle
from tests.checks.data import data
from tests.checks.examine import examine, kinetic, lies, states_at
from tests.checks.launch import launch
from tests.checks.scenes import difference, engine_states
from tests.checks.verbs import collide_double, dimer, row_of, scratch

RTOLS = (1e-6, 1e-8, 1e-11)


everywhere = pytest.mark.parametrize("rtol", RTOLS)  # with the JIT on and off


def accuracies(test):
    """With the JIT on only."""
    return pytest.mark.jit(everywhere(test))


def honest(rtol, periods, **parameters):
    """Examination of a run that must be ok and show nothing wrong."""
    look = examine(row_of(**parameters), periods, rtol)
    assert (look["status"], lies(look)) == ("ok", []), look
    return look


def lifted(dm, beta, height, c_n=0.0, **rates):
    """A free state: p1 at a height above the plate, the rod at an angle; `rates` by the names of the slots."""
    spread = dm.p2.h * cos(beta) * rates.get("wb", 0.0)
    gaps = {"d1": height, "d2": height + dm.l * sin(beta), "n1": c_n - spread, "n2": c_n + spread}
    return np.array(State(dip=beta, **gaps, **rates))


def standing(dm, beta, **rates):
    """A state in which p1 stands on the plate, its gap and gap rate zero."""
    return lifted(dm, beta, 0.0, c_n=dm.p2.h * cos(beta) * rates.get("wb", 0.0), **rates)


def launched(dm_row, state, periods, rtol):
    """A launch that must be ok and show nothing wrong."""
    run = launch(dm_row, state, periods, rtol)
    assert (run.status, lies(run.look())) == ("ok", []), run.look()
    return run


def causes(run):
    return run.column("cause")


# --- the intensity at which the plate just carries no weight ------------------------------------------------------------


@pytest.mark.jit
@pytest.mark.parametrize("phi0", [0.0, 0.5 * pi, 4.0])
@accuracies
def test_at_gamma_1_a_plastic_dimer_never_leaves_the_plate(rtol, phi0):
    """The normal force touches zero once a period and is positive on either side: a lift-off there would be a lie."""
    row = row_of(Gamma=1.0, beta0=0.0, e=0.0, phi0=phi0)
    run = launched(row, standing(dimer_of(row), 0.0), 5, rtol)
    assert C_LIFT_OFF not in causes(run)
    assert not run.segments[:, [layout.D1, layout.D2, N1, N2, DIP, WB]].any()


def hop_phases(excess):
    """Plate phases at which a body at rest leaves a plate of intensity 1 + excess, and lands again (50 digits)."""
    with mp.workdps(50):
        Gamma = 1 + mpf(excess)
        off = mp.asin(1 / Gamma)

        def gap(s):
            return Gamma * (mp.sin(off) - mp.sin(off + s)) + Gamma * mp.cos(off) * s - s * s / 2

        about = 4 * mp.cot(off)  # where its cubic and quartic terms cancel
        return float(off), float(off + mp.findroot(gap, (0.8 * about, 1.2 * about), solver="anderson", tol=1e-60))


@everywhere
@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6, 1e-9, 1e-12])
def test_just_above_gamma_1_it_hops_as_the_plate_throws_it(rtol, excess):
    """The hop is tiny, of the third order in time: the normal force dips below zero between two steps."""
    row = row_of(Gamma=1.0 + excess, beta0=0.0, e=0.0)
    run = launched(row, standing(dimer_of(row), 0.0), 1, rtol)
    off, on = hop_phases(excess)
    phases = run.column("phase")
    # the force goes through zero at a slope of about sqrt(2 excess)
    assert phases[causes(run) == C_LIFT_OFF] == pytest.approx([off], abs=(1e-14 + 1e-3 * rtol) / sqrt(excess))
    assert phases[causes(run) == C_IMPACT][0] == pytest.approx(on, abs=(1e-13 + 3e-3 * rtol) / sqrt(excess))


# --- the ends of the ranges of restitution and friction -----------------------------------------------------------------


@accuracies
@pytest.mark.parametrize("beta0", [0.0, 0.3, 1.2])
def test_without_restitution_an_end_that_lands_alone_stays(rtol, beta0):
    """At e = 0 restitution has no duration: the step from compression to rest must not be divided by it."""
    row = row_of(e=0.0, Gamma=1.3, beta0=beta0)
    run = launched(row, lifted(dimer_of(row), beta0, 1e-3), 6, rtol)
    kinds = [CONTACT_STATES[int(kind)] for kind in run.column("kind")]
    alone = np.array([kind.startswith("SI") for kind in kinds]) & (run.column("contact_after") == 0)
    ends = np.array([digits_of(int(kind)) for kind in run.column("kind")])
    for i in (0, 1):
        after = run.column(f"gap_{i + 1}_rate_after")
        assert not after[alone & (ends[:, i] > layout.SLIP)].any()
    assert alone.any() or beta0 == 0.0


@accuracies
def test_without_loss_every_impact_keeps_the_energy(rtol):
    """At e = 1 and mu = 0 nothing ever comes to rest; hops of any smallness must not gain or lose."""
    row = row_of(e=1.0, mu=0.0, Gamma=0.3, beta0=0.7)
    dm = dimer_of(row)
    run = launched(row, lifted(dm, 0.7, 2e-3, wb=3.0, spin=40.0), 20, rtol)
    _, before, after = flights(row, run)
    old, new = kinetic(dm, before), kinetic(dm, after)
    assert len(run.segments) > 20
    np.testing.assert_allclose(new, old, rtol=0, atol=(1e-13 + 1e-2 * rtol) * max(old.max(), new.max()))


def flights(row, run):
    """States at the start of each flight that ends with an impact, and just before and just after that."""
    free = (run.segments[:-1, SEGMENT_MODES:SEGMENT_HOP_TIME] == layout.FREE).all(1)
    times = run.segments[:, layout.PERIOD] + run.segments[:, PHASE] / (2 * pi)
    struck = free & (np.diff(times) > 0) & (run.segments[1:, PHASE] > 0.0)
    starts, after = run.segments[:-1][struck], run.segments[1:][struck][:, :N_STATE]
    return starts[:, :N_STATE], states_at(row, starts, after[:, PHASE, None], run.rtol)[:, 0], after


@accuracies
def test_on_a_smooth_plate_nothing_pushes_sideways(rtol):
    """At mu = 0 friction has no direction: momentum in the plane and the axial spin are those of the start for ever."""
    row = row_of(mu=0.0, mu_s=0.0, Gamma=1.2, beta0=0.5)
    dm = dimer_of(row)
    run = launched(row, lifted(dm, 0.5, 1e-3, ca=0.3, cb=0.7, spin=100.0, wp=2.0), 20, rtol)
    s = State(*run.segments.T[:N_STATE])
    np.testing.assert_allclose(s.cb * np.cos(s.theta) - s.ca * np.sin(s.theta), 0.7, atol=10 * rtol)
    np.testing.assert_allclose(s.ca * np.cos(s.theta) + s.cb * np.sin(s.theta), 0.3, atol=10 * rtol)
    np.testing.assert_allclose(s.spin, 100.0, rtol=10 * rtol)
    up = upright_moment(dm, s)
    np.testing.assert_allclose(up, up[0], rtol=0, atol=10 * rtol * abs(up[0]))


def upright_moment(dm, s):
    """Vertical angular momentum about the centre of mass."""
    return dm.J_t * s.wp * np.cos(s.dip) + dm.J_a * s.spin * np.sin(s.dip)


@accuracies
@pytest.mark.parametrize("mu", [0.05, 0.2, 1.0])
def test_equal_coefficients_are_the_limit_of_unequal_ones(rtol, mu):
    """At mu_s = mu an end whose hold is exceeded slips with the force that held it, and hardly accelerates."""
    ends = []
    for mu_s in (mu, mu * (1 + 1e-9)):
        row = row_of(mu=mu, mu_s=mu_s, beta0=0.4)
        ends.append(launched(row, lifted(dimer_of(row), 0.4, 1e-3, cb=0.5), 3, rtol).state)
    assert (np.abs(ends[1] - ends[0]) <= 1e-7 * np.maximum(1.0, np.abs(ends[0]))).all()


@accuracies
def test_an_end_held_by_any_force_slips_at_impacts_only(rtol):
    """A stick coefficient of a million: the cone is a half-space, squares of its limit are large but finite."""
    row = row_of(mu=0.2, mu_s=1e6, Gamma=0.9)
    run = launched(row, lifted(dimer_of(row), 0.3, 1e-3, cb=1.0), 10, rtol)
    assert layout.C_STICK in causes(run)
    assert layout.C_SLIP not in causes(run)


# --- edges of the impact law ------------------------------------------------------------------------------------------


def axial_ratio(dm):
    """mubar: the axial over the normal force that holds a lone end of a flat dimer."""
    return dm.p2.h * dm.p1.r / (dm.J_t / dm.m + dm.p1.r**2)


def flat_impact(dm, n_1, n_2, tol, **rates):
    """State after a double impact with these approaches, and the friction modes of its end."""
    work, log = scratch()
    state, modes = lifted(dm, 0.0, 0.0, **rates), np.zeros(2)
    state[N1], state[N2] = n_1, n_2
    state[WB] = (n_2 - n_1) / (dm.l)
    status, _ = collide_double(dm, state, max(-n_1, -n_2), tol, modes, work, log)
    assert status == OK
    return state, modes


@everywhere
@pytest.mark.parametrize("n_2", [0.0, -0.2, -1.0])
def test_friction_at_the_edge_of_holding_an_end(rtol, n_2):
    """Where mu = mubar to 1e-12 (the base case nearly is) slip grows or decays by 1e-12 of the impulse: a verdict of
    round-off, that must not show in the outcome. The stick limit there is also that of a double stick."""
    dm = dimer()
    mubar = axial_ratio(dm)
    ends = []
    for mu in (mubar * (1 - 1e-12), mubar, mubar * (1 + 1e-12)):
        edge = dimer(mu=mu, mu_s=mu)
        for ca in (0.0, 1e-14, -1e-14):
            # the contact points at rest along the axis, or nearly
            start = {"ca": ca - dm.p1.r * (n_2 + 1.0) / (dm.l), "cb": 0.3}
            ends.append(flat_impact(edge, -1.0, n_2, rtol, **start)[0])
    ends = np.array(ends)
    assert (np.ptp(ends, axis=0) <= 10 * rtol * np.maximum(1.0, np.abs(ends).max(0))).all()


@accuracies
def test_a_drift_at_the_edge_is_one_motion(rtol):
    """Sixty periods of drift, on both sides of mu = mubar to 1e-12, end on one orbit."""
    mubar = axial_ratio(dimer())
    runs = [simulate(mu=mubar * (1 + side), periods=60, rtol=rtol, record=False) for side in (-1e-12, 0.0, 1e-12)]
    assert {run.mode for run in runs} == {"drift"}
    radii = [run.orbit.radius for run in runs]
    assert np.ptp(radii) < 1e-3 * radii[0] if rtol > 1e-7 else np.ptp(radii) < 1e-6 * radii[0]


UNCOUPLED = list(product(RTOLS, (-1e-12, 0.0, 1e-12), [(-1.0, 0.0), (0.0, -0.3), (-1.0, -1e-9), (-0.5, -0.5)]))


@pytest.mark.parametrize(("rtol", "side", "approach"), UNCOUPLED)
def test_uncoupled_ends_do_not_feel_each_other(rtol, side, approach):
    """Where W_12 = 0 the normals are uncoupled: without friction each gap rate is turned on its own."""
    low, high = 4.0, 5.0
    for _ in range(60):
        mid = 0.5 * (low + high)
        dm = dimer(A_r=mid, mu=0.0, e=0.7)
        low, high = (mid, high) if dm.im > dm.p2.h**2 * dm.it else (low, mid)
    dm = dimer(A_r=low * (1 + side), mu=0.0, e=0.7)
    assert abs(dm.im - dm.p2.h**2 * dm.it) < 1e-10 * dm.im
    state, _ = flat_impact(dm, *approach, rtol)
    for rate, n in zip(state[[N1, N2]], approach, strict=True):
        assert rate == pytest.approx(-0.7 * n, abs=10 * rtol * max(1e-12, *np.abs(approach)) + 1e-11)


# --- slip that turns, ends that meet the plate together or hardly -------------------------------------------------------

FALLING = {"f": 15.0, "Gamma": 0.0, "mu": 0.1, "mu_s": 0.1, "beta0": 1.2, "A_r": 8.0, "xdot0": 0.0, "e": 0.5}


@pytest.fixture(scope="module")
def falling():
    """The slow program's states of a rod that falls over on a dead plate, planar."""
    times = np.linspace(0.01, 0.2, 20)
    return times, oracle.simulate(FALLING, times, rtol=1e-9, v_rest=1e-9)["samples"][:, 1:]


@accuracies
def test_a_planar_slip_that_reverses(rtol, falling):
    """A rod that falls over drags its foot one way, then the other: in one dimension slip must pass zero to turn."""
    times, expected = falling
    states, _ = engine_states(FALLING, times, rtol)
    assert difference(states, expected) < 1e3 * rtol + 1e-7
    honest(rtol, 4, **FALLING)
    dm = dimer(**FALLING)
    foot = states[:, 7] + dm.p1.r * states[:, 10]
    assert foot.min() < -1e-3
    assert foot.max() > 1e-3


@accuracies
@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-13, 1e-12, 1e-11, -1e-12])
def test_ends_that_land_within_a_picosecond(rtol, apart):
    """One impact at two ends or two impacts at one end each: different laws, 1e-12 s from each other."""
    row = row_of(e=0.5, Gamma=0.0)
    dm = dimer_of(row)
    speed = 0.3
    run = launched(row, lifted(dm, speed * apart / (dm.l), 1e-3, c_n=-speed, cb=0.2), 2, rtol)
    struck = (
        run.column("period")[causes(run) == C_IMPACT] * dm.period
        + run.column("phase")[causes(run) == C_IMPACT] / dm.omega
    )
    fall = (sqrt(speed**2 + 2 * dm.g * 1e-3) - speed) / dm.g
    assert struck[0] == pytest.approx(fall, abs=2e-11)
    assert not run.state[[layout.D1, layout.D2, DIP]].any()


@everywhere
@pytest.mark.parametrize("miss", [1e-9, 1e-12, -1e-12, -1e-9])
def test_an_end_that_grazes_the_plate(rtol, miss):
    """A turning end that comes down to the plate and goes up again within a microsecond: a double root of its gap."""
    row = row_of(e=0.5, Gamma=0.0)
    dm = dimer_of(row)
    rate = 60.0  # of the rod: its end turns away from the plate faster than the centre falls
    state = lifted(dm, 0.5, 0.0, wb=rate, c_n=0.0)
    # the height of p1 is h0 - g t^2/2 - h sin(0.5 + rate t): find where its rate is zero, and lift it to the miss
    low, high = 0.0, (0.5 * pi - 0.5) / rate * 1.5
    for _ in range(200):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if -dm.g * mid - dm.p2.h * rate * cos(0.5 + rate * mid) < 0 else (low, mid)
    drop = 0.5 * dm.g * low**2 + dm.p2.h * (sin(0.5 + rate * low) - sin(0.5))
    state = lifted(dm, 0.5, drop + miss, wb=rate, c_n=0.0)
    run = launched(row, state, 1, rtol)
    times = run.column("phase")[causes(run) == C_IMPACT] / dm.omega
    near = np.abs(times - low) < 1e-4
    assert near.any() == (miss < 0)


@accuracies
def test_a_chatter_that_ends_when_the_other_end_lands(rtol):
    """Two clusters of events run into each other: found by bisection of the speed of the first bounce, to the last bit."""
    row = row_of(e=0.5, Gamma=0.0, mu=0.1)
    dm = dimer_of(row)

    def bounce(speed):
        run = launched(row, lifted(dm, 0.05, 0.0, c_n=speed), 1, rtol)  # p1 leaves the plate, the rod not turning
        ends = [digits_of(int(kind)) for kind in run.column("kind")]
        landed = [k for k, (_, b) in enumerate(ends) if b > layout.SLIP]
        closed = np.flatnonzero(causes(run) == layout.C_CHATTER_END)
        return closed.size > 0 and closed[0] < landed[0]

    low, high = 1e-4, 1.0
    assert bounce(low)
    assert not bounce(high)
    for _ in range(70):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if bounce(mid) else (low, mid)
    assert high - low < 1e-15


# --- fast spin, vertical rods -------------------------------------------------------------------------------------------


@everywhere
@pytest.mark.parametrize("over", [-1e-6, 1e-6])
def test_a_fast_spin_lifts_an_end_of_a_lying_dimer(rtol, over):
    """Gyroscopic lift-off at 10^4 rad/s: J_a spin theta' h-wise against m g h, without friction to turn it."""
    row = row_of(mu=0.0, mu_s=0.0, Gamma=0.0)
    dm = dimer_of(row)
    spin = 1e4
    turn = dm.m * dm.g * dm.p2.h / (dm.J_a * spin) * (1 + over)
    run = launched(row, lifted(dm, 0.0, 0.0, spin=spin, wp=turn), 1, rtol)
    assert (C_LIFT_OFF in causes(run) or run.column("contact_after")[0] != 12) == (over > 0)
    np.testing.assert_allclose(run.segments[:, SPIN], spin, rtol=1e-15)


@accuracies
@pytest.mark.parametrize("spin", [1e3, 1e4, -1e4])
def test_a_fast_spinning_dimer_keeps_its_balance(rtol, spin):
    """The nutation of a fast top is thousands of times faster than the plate; friction must not drive it."""
    row = row_of(Gamma=0.5, beta0=0.3)
    run = launched(row, lifted(dimer_of(row), 0.3, 1e-4, spin=spin, cb=0.1, wp=1.0), 2, rtol)
    assert abs(run.state[SPIN]) < abs(spin)


def time_to_fall(dm, tilt):
    """Time in which a rod at rest, p1 on a smooth dead plate, falls flat from a tilt: by the energy integral."""

    def per_u(u):  # the tilt now is tilt + u^2, which takes the root out of the integrand
        now = tilt + u * u
        fall = sin(tilt + 0.5 * u * u) * (sin(0.5 * u * u) / (0.5 * u * u) if u > 0.0 else 1.0)  # in units of u^2
        return 2.0 * sqrt((dm.m * (dm.p2.h * sin(now)) ** 2 + dm.J_t) / (2.0 * dm.m * dm.g * dm.p2.h * fall))

    width, end = 10 * sqrt(tilt), sqrt(0.5 * pi - tilt)
    return sum(quad(per_u, *ends, epsabs=1e-14, epsrel=1e-13, limit=400)[0] for ends in ((0.0, width), (width, end)))


@accuracies
@pytest.mark.parametrize("tilt", [1e-2, 1e-4, 1e-6])
def test_a_rod_that_starts_vertical_falls_in_its_time(rtol, tilt):
    """Near pi/2 the fall grows from a tilt: each digit of it is a digit of the time."""
    row = row_of(mu=0.0, mu_s=0.0, Gamma=0.0, e=0.0, f=2.0)
    dm = dimer_of(row)
    run = launched(row, standing(dm, 0.5 * pi - tilt), 4, rtol)
    landed = np.flatnonzero(causes(run) == C_IMPACT)[0]
    time = run.column("period")[landed] * dm.period + run.column("phase")[landed] / dm.omega
    assert time == pytest.approx(time_to_fall(dm, tilt), abs=rtol + (0.1 * rtol + 1e-16) / tilt)


@accuracies
@pytest.mark.parametrize("tilt", [1e-3, 1e-6, 1e-10, 1e-12])
def test_a_vertical_start_with_a_push(rtol, tilt):
    """The heading of a vertical rod has no meaning, and turns by half a turn in no time beside it."""
    look = honest(rtol, 3, beta0=0.5 * pi - tilt, xdot0=14.0, e=0.0)
    assert look["dip"] > 1.5


@accuracies
def test_a_spinning_top_on_a_smooth_plate_passes_near_the_vertical(rtol):
    """Its axial spin, vertical moment and energy last; the heading turns by most of half a turn within the pass."""
    row = row_of(mu=0.0, mu_s=0.0, Gamma=0.0, f=2.0)
    dm = dimer_of(row)
    state = standing(dm, 1.2, wb=45.0, wp=0.02, spin=1.0)
    run = launched(row, state, 1, rtol)
    up = upright_moment(dm, State(*run.segments.T[:N_STATE]))
    np.testing.assert_allclose(up, up[0], rtol=0, atol=1e2 * rtol * dm.J_t * 45.0)
    assert run.look()["dip"] > 1.55


@accuracies
def test_a_planar_rod_tips_over_the_vertical(rtol):
    """Standing on p1 it passes pi/2: the chart ends there, and p2 comes down on the other side."""
    honest(rtol, 6, **data("scenes")["motions"]["tips over"])


@accuracies
def test_a_tumbling_dimer_is_a_free_top(rtol):
    """Thrown at a large Gamma the rod turns over and over: every flight against the turned axis, as a vector."""
    row = row_of(Gamma=20.0, f=8.0, A_r=2.5, e=0.8, mu=0.4, mu_s=0.5, beta0=0.4)
    dm = dimer_of(row)
    run = launched(row, lifted(dm, 0.4, 0.3, wb=60.0, wp=3.0, spin=5.0, cb=0.5), 40, rtol)
    starts, before, _ = flights(row, run)
    over = 0
    for start, end in zip(starts, before, strict=True):
        span = (end[PHASE] - start[PHASE]) / dm.omega
        u_0, v_0, L_0 = vectors(dm, start)
        u_1, v_1, L_1 = vectors(dm, end)
        np.testing.assert_allclose(u_1, Rotation.from_rotvec(L_0 * span).apply(u_0), atol=1e-12)
        np.testing.assert_allclose(v_1, v_0, atol=1e-12)
        np.testing.assert_allclose(L_1, L_0, atol=1e-12 * max(1.0, np.abs(L_0).max()))
        over += u_0[:2] @ u_1[:2] < 0
    assert over >= 3
    assert np.abs(before[:, DIP]).max() < 0.5 * pi


def vectors(dm, state):
    """Axis, horizontal velocity of the centre, and angular momentum over J_t, in the lab's frame."""
    s = State(*state)
    s_t, c_t, s_b, c_b = sin(s.theta), cos(s.theta), sin(s.dip), cos(s.dip)
    a, b, n = np.array([-s_t, c_t, 0.0]), np.array([c_t, s_t, 0.0]), np.array([0.0, 0.0, 1.0])
    axial = dm.J_a / dm.J_t * s.spin
    L = (c_b * axial - s_b * s.wp) * a + s.wb * b + (c_b * s.wp + s_b * axial) * n
    return c_b * a + s_b * n, s.ca * a + s.cb * b, L


@accuracies
@pytest.mark.parametrize("beta0", [0.0, 0.2, 1.0])
def test_balls_that_touch(rtol, beta0):
    """At A_r = 2 the rod has no length, W_12 its largest negative value, and friction the longest lever."""
    honest(rtol, 10, A_r=2.0, beta0=beta0, Gamma=1.2)
    honest(rtol, 10, A_r=2.0, beta0=beta0, D_r=0.0, rho_r=0.0)


@accuracies
def test_a_light_dimer_moves_as_a_heavy_one(rtol):
    """All forces grow with the mass: 9 milligrams or 9 grams make the same run, or an event is judged in newtons."""
    ends = []
    for factor in (1.0, 1e-3):
        row = row_of(e=0.0, Gamma=0.0, f=8.0, A_r=2.0, mu=0.5, mu_s=0.75, rho_b=7850.0 * factor, rho_r=1180.0 * factor)
        dm = dimer_of(row)
        state = lifted(dm, -0.9, dm.l * sin(0.9), c_n=-0.3, wb=-5.0, wp=-5.0, spin=-50.0, ca=-0.5, cb=-0.5)
        ends.append(launched(row, state, 2, rtol).state)
    assert ends[1][THETA] == pytest.approx(ends[0][THETA], abs=1e-6)


# --- a long run ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("DIMERSWEEP_SLOW"), reason="a minute each: set DIMERSWEEP_SLOW=1")
@accuracies
def test_a_hundred_thousand_periods_of_drift(rtol):
    """Time is counted in whole periods, so its digits last: the phase of the impact moves with the creep of the spin only.

    The speed falls to its limit as an exponential, which three early orbits tell (what changes in one orbit is no more than the
    tolerance, at 1e-6).
    """
    early, later, third, late = (
        simulate(periods=n, rtol=rtol, record=False) for n in (10_000, 20_000, 30_000, 100_000)
    )
    assert {early.mode, late.mode} == {"drift"}
    assert late.orbit.impact_phase == pytest.approx(early.orbit.impact_phase, abs=1e-3)
    fall = early.orbit.speed - later.orbit.speed
    share = (later.orbit.speed - third.orbit.speed) / fall  # of what is left after 10,000 periods
    assert late.orbit.speed == pytest.approx(early.orbit.speed - fall * (1 - share**9) / (1 - share), rel=1e-2)


@pytest.mark.jit
@pytest.mark.parametrize("case", data("exact")["scenes"], ids=lambda case: case["broke"])
def test_the_error_of_a_run_goes_with_its_tolerance(case):
    """After four periods, at tolerances beside that of the scene, too: what a shortcut leaves out comes and goes with them."""
    run = simulate(**case["scene"] | {"rtol": 1e-12})
    t = min(4.0 / case["scene"]["f"], run.duration)
    exact = run.states([t])
    for share in (0.5, 0.7, 0.9, 1.0, 1.3):
        rtol = share * case["scene"]["rtol"]
        states = simulate(**case["scene"] | {"rtol": rtol}).states([t])
        for name in ("kinetic_energy", "theta", "y1_rate"):
            expected = exact[name].item()
            assert abs(states[name].item() - expected) < case["most"] * rtol * max(abs(expected), 1e-3), (name, share)
