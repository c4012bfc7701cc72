"""Multipliers and Lyapunov exponents against closed forms: the ball on a plate, and the decay of an orbit."""

from functools import cache
from itertools import combinations
from math import acos, cos, hypot, log, pi, sin, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from dimersweep import Parameters, names, orbits, simulate
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import D1, D2, N1, N2, N_STATE
from dimersweep.runs.growth import lyapunov, multipliers, of_orbit, orthogonal, qr_growth, spectrum
from dimersweep.runs.period_map import NAMES, Section
from dimersweep.runs.tangent import Tangents

G = 9.81


def uncoupled_aspect_ratio():
    """At which an impulse at one end leaves the other one at rest, J_t = m h^2: the ends are two balls on their own."""
    r, rho_b, rho_r, D_r = 5e-3, 7850.0, 1180.0, 4e-3

    def excess(A_r):
        lever = 2 * r * (A_r - 1)
        m_b, m_r = rho_b * 4 / 3 * pi * r**3, rho_r * pi / 4 * D_r**2 * (lever - 2 * r)
        J_t = 2 * (0.4 * m_b * r**2 + m_b * lever**2 / 4) + m_r * ((lever - 2 * r) ** 2 / 12 + D_r**2 / 16)
        return J_t / (2 * m_b + m_r) - (lever / 2) ** 2

    return brentq(excess, 3, 7)


def smooth(e, Gamma, f, phi0=0.0):
    """A dimer without friction whose ends are uncoupled."""
    return Parameters(e=e, Gamma=Gamma, f=f, A_r=uncoupled_aspect_ratio(), mu=0.0, mu_s=0.0, phi0=phi0)


def ball_multipliers(e, Gamma, f):
    """Phase of the impact of a ball that bounces once a period, and the two multipliers of that motion.

    From the landing (time t, velocity w before) to u = (1 + e) V(t) - e w after it, and the next one a flight of one period
    later; the determinant is e^2.
    """
    T = 1 / f
    phase = acos(pi * (1 - e) / (1 + e) / Gamma)
    V, acceleration, w = G * T / 2 * (1 - e) / (1 + e), -Gamma * G * sin(phase), -G * T / 2
    later = np.array([1.0, -T / (w - V)])  # of the next landing, per change of this one's time and of u
    w_after = np.array([G, 1.0]) - G * later
    return phase, np.linalg.eigvals(np.array([later, (1 + e) * acceleration * later - e * w_after]))


@pytest.mark.parametrize(("e", "Gamma"), [(0.6, 1.2), (0.6, 1.31), (0.6, 1.33), (0.8, 0.8)])
def test_a_ball_that_bounces_once_a_period_has_its_multipliers(e, Gamma):
    """Two equal balls: each pair twice; and the spins and velocities that frictionless impacts keep."""
    f = 15.0
    phase, expected = ball_multipliers(e, Gamma, f)
    parameters = smooth(e, Gamma, f, phase - pi)
    height, omega = 1 / (8 * f**2) * G, 2 * pi * f  # at the top of the flight, over the landing
    amplitude = Gamma * G / omega**2
    state = np.zeros(N_STATE)
    state[D1] = state[D2] = height + amplitude * (sin(phase) - sin(phase - pi))
    state[D2] += 1e-7 * height  # one after the other: two balls that land at once need the impact at both ends
    state[N1] = state[N2] = -amplitude * omega * cos(phase - pi)
    found = of_orbit(Section(parameters.row(), 1e-11), state, np.zeros(2), 1)
    assert found.closure < 1e-5
    wanted = np.sort_complex(np.concatenate([expected, expected, np.ones(4)]))
    assert np.prod(expected) == pytest.approx(e**2)
    assert np.abs(np.sort_complex(np.round(found.values, 4)) - np.round(wanted, 4)).max() < 3e-4


def test_the_period_doubles_where_a_multiplier_passes_minus_one():
    """At the closed form's Gamma for the ball (the map's own multipliers on both sides of it are tried above)."""
    e = 0.6
    flip = (pi**2 * ((1 - e) / (1 + e)) ** 2 + 4 * ((1 + e**2) / (1 + e) ** 2) ** 2) ** 0.5
    assert 1.31 < flip < 1.33
    below, above = (min(ball_multipliers(e, flip + step, 15.0)[1].real) for step in (-1e-6, 1e-6))
    assert above < -1 < below


def test_each_impact_of_a_ball_contracts_by_the_square_of_its_restitution():
    """In a motion of some periods that a run settles to; an end that comes to rest in it has no multipliers but zero."""
    run = simulate(**smooth(0.6, 1.31, 15.0, 0.07).given() | {"beta0": 0.0, "xdot0": 0.0}, periods=300)
    assert run.mode_period > 0
    found, events = multipliers(run), run.events
    last = events["time"].values > (run.n_periods - run.mode_period) / 15
    impacts = 0
    for end in (1, 2):
        if f"gap_{end}" in found.coordinates:
            impacts += np.unique(events["time"].values[last & (events[f"impulse_{end}"].values > 1e-9)]).size
    assert impacts > 0
    assert np.prod(np.abs(found.values)) == pytest.approx(0.6 ** (2 * impacts), rel=1e-2)
    assert np.abs(found.values).max() == pytest.approx(1)


def test_the_map_goes_on_as_a_run_does():
    short, long = (simulate(periods=periods).record("the test").segments[-1][:N_STATE] for periods in (10, 15))
    parameters = Parameters()
    section = Section(parameters.row(), 1e-8)
    image, modes = section.after(short.copy(), 5)
    assert image == pytest.approx(section.point(long), abs=1e-6)
    assert section.point(section.state(image, modes)) == pytest.approx(image, abs=1e-12)
    assert (modes == 0).sum() == 1  # one end is in flight


@pytest.fixture(scope="module")
def drift():
    return simulate(periods=300)


def test_a_drift_is_stable_and_its_bouncing_end_contracts_as_a_ball(drift):
    found = multipliers(drift)
    assert (np.abs(found.values) < 1).all()
    assert found.closure < 1e-4
    assert abs(found.values[1]) == pytest.approx(drift.parameters["e"], rel=5e-3)
    assert "along" not in found.coordinates  # the end that is down sticks


def test_an_orbit_drifts_as_its_largest_multiplier_says(drift):
    """The speed of the base case falls towards its limit by that factor each period."""
    later = simulate(periods=1300)
    rate = log(later.orbit.speed_drift / drift.orbit.speed_drift) / 1000
    mean = log(abs(multipliers(drift).values[0] * multipliers(later).values[0])) / 2
    assert rate == pytest.approx(mean, rel=5e-3)


def test_the_exponent_of_a_settled_motion_is_that_of_its_largest_multiplier(drift):
    found = lyapunov(drift, 100)
    assert found.per_period == pytest.approx(log(abs(multipliers(drift).values[0])), rel=0.02)
    assert found.exponent == pytest.approx(15 * found.per_period)


@cache
def ball_exponent(e, Gamma, impacts, skip=200):
    """Lyapunov exponent per period of a ball on a plate by the product of its tangent maps; units of 1/omega and g."""
    t, u, change, total, start = 1.0, 2.0 * Gamma, np.array([1.0, 0.3]), 0.0, 0.0
    for k in range(skip + impacts):

        def height(s, t=t, u=u):
            return Gamma * (sin(t) - sin(t + s)) + u * s - s * s / 2

        ahead = np.arange(1e-3, u + sqrt(u * u + 4 * Gamma) + 0.02, 0.01)  # the ball has landed by then
        heights = Gamma * (sin(t) - np.sin(t + ahead)) + u * ahead - ahead * ahead / 2
        s = float(ahead[np.argmax(heights <= 0)])
        s = brentq(height, max(s - 0.01, 1e-6), s)
        w = u - s
        later = ((w + s - u + u - s - Gamma * cos(t)) * change[0] - s * change[1]) / (w - Gamma * cos(t + s))
        w_after = change[1] - (later - change[0])
        change = np.array([later, -(1 + e) * Gamma * sin(t + s) * later - e * w_after])
        if k == skip:
            start = t + s
        total += log(np.linalg.norm(change)) if k > skip else 0.0
        change /= np.linalg.norm(change)
        t, u = t + s, (1 + e) * Gamma * cos(t + s) - e * w
    return 2 * pi * total / (t - start)


@pytest.mark.parametrize("e_2", [0.1, 0.3])
def test_a_bouncing_end_in_chaos_has_the_exponent_of_a_ball(e_2):
    """The ends are uncoupled, the hops small against the rod, and one end alone keeps a difference."""
    given = smooth(0.9, 3.0, 1000.0, 0.3).given() | {"e_1": 0.9, "e_2": e_2, "beta0": 1e-5, "xdot0": 0.0}
    del given["e"]
    found = lyapunov(simulate(**given, periods=200), 4000)
    error = found.error / 1000
    assert error < 0.035
    assert abs(found.per_period - ball_exponent(0.9, 3.0, 8000)) < 2 * error


def test_what_has_no_multipliers_is_told(drift):
    chaos = simulate(e=0.8, Gamma=3.0, f=25.0, beta0=0.3, periods=80)
    with pytest.raises(ParameterError, match=r"does not repeat \(mode aperiodic\); lyapunov tells its growth$"):
        multipliers(chaos)
    with pytest.raises(ParameterError, match="nothing was recorded"):
        lyapunov(simulate(periods=1, record=False))
    at_impact = simulate(periods=300, phi0=2 * pi * drift.orbit.impact_phase)
    with pytest.raises(ParameterError, match="lies at an event"):
        multipliers(at_impact)


@pytest.mark.parametrize(
    "scene",
    [
        {"Gamma": 0.5},
        {"f": 25, "beta0": 1.535},
        {"Gamma": 0.0, "xdot0": 0.0, "beta0": 0.1},
        {"Gamma": 1.2, "beta0": 0.8},
    ],
)
def test_of_what_rests_the_spin_alone_is_left_and_does_not_change(scene):
    run = simulate(**scene, periods=300)
    assert run.mode in ("rest", "jump")
    assert lyapunov(run, 100)[:3] == pytest.approx((0.0, 0.0, 0.0), abs=1e-8)
    if run.mode == "jump":
        assert multipliers(run).values == pytest.approx([1.0])


def test_an_exponent_of_chaos_does_not_depend_on_how_long_it_is_measured():
    """The chaos of some starts ends by itself (of which hangs on the last digits): both ends come to rest together, and a jump
    follows.
    """
    starts = (simulate(Gamma=3.0, beta0=beta0, periods=200) for beta0 in np.linspace(0.15, 0.5, 29))
    run = next(run for run in starts if run.mode == "aperiodic" and 130 < lyapunov(run, 5000).periods < 5000)
    assert run.go_on(5500).mode == "jump"
    found = [lyapunov(run, periods) for periods in (130, 300, 1000, 3000, 5000)]
    end = found[4].periods
    assert 130 < end < 5000  # of the chaos
    # of a chaos that ends, the share of 20 periods and a tenth goes before: not the same for 3,000 and 5,000
    counts = [each.periods for each in found]
    assert counts == pytest.approx([min(n, end) for n in (130, 300, 1000, 3000, 5000)], abs=20)
    for one, other in combinations(found, 2):
        assert abs(one.exponent - other.exponent) < 2 * hypot(one.error, other.error)
    assert found[-1].exponent == pytest.approx(12.3, abs=4 * found[-1].error)


def test_no_start_of_chaos_has_a_low_exponent():
    runs = [simulate(Gamma=3.0, beta0=beta0, periods=200) for beta0 in np.linspace(0.15, 0.5, 14)]
    found = [lyapunov(run, 2000) for run in runs if run.mode == "aperiodic"]
    assert len(found) >= 12
    assert any(each.periods < 2000 for each in found)  # of some the chaos ends
    assert all(abs(each.exponent - 12.3) < 4 * each.error for each in found)
    weights = [each.error**-2 for each in found]
    mean = np.average([each.exponent for each in found], weights=weights)
    assert mean == pytest.approx(12.3, abs=3 / sqrt(sum(weights)))


def test_chaos_that_ends_in_a_settled_motion_is_counted_up_to_there():
    for beta0 in (0.7, 0.6, 0.5, 0.4, 0.3):  # rounding decides how long the chaos of each lasts: some hundred periods
        run = simulate(Gamma=1.98, beta0=beta0, f=37, e=0.66, periods=100)
        later = run.go_on(1500)
        if run.mode == "aperiodic" and 400 < later.settled_after < 1300:
            break
    assert (run.mode, later.mode) == ("aperiodic", "flutter")
    found = lyapunov(run, 1300)
    assert 100 < found.periods < later.settled_after - 100
    assert 0.5 < found.per_period < 1.0
    with pytest.raises(
        ParameterError, match=r"^lyapunov: the chaos ends 1 periods after the run; end the run earlier$"
    ):
        lyapunov(run.go_on(int(later.settled_after) - 101), 1300)


def test_weak_chaos_is_told_by_a_run_that_is_long_enough():
    """Here twins separate too slowly for one stretch of 24 periods; a few of the starts come to another motion."""
    modes = [
        simulate(Gamma=1.32, beta0=beta0, periods=1000, record=False).mode for beta0 in np.linspace(0.15, 0.25, 12)
    ]
    assert "unresolved" not in modes
    assert modes.count("aperiodic") >= 6
    per_period = lyapunov(simulate(Gamma=1.32, beta0=0.2, periods=600), periods=600).per_period
    assert 0.1 < per_period < log(1e4) / 24


def exact(matrices):
    """Maps of `qr_growth` from matrices."""
    return [lambda directions, matrix=matrix: (matrix @ directions.T, np.zeros(len(directions))) for matrix in matrices]


def henon(n, a=1.4, b=0.3):
    """Derivatives of Henon's map along its attractor (doi 10.1007/BF01608556)."""
    x, y = 0.1, 0.1
    for k in range(n + 100):
        derivative = np.array([[-2 * a * x, 1.0], [b, 0.0]])
        x, y = 1 - a * x * x + y, b * x
        if k >= 100:
            yield derivative


def test_exponents_of_known_maps():
    """Henon's map contracts areas by 0.3 everywhere, and has the exponent 0.4192; a fixed matrix has its eigenvalues."""
    mean = qr_growth(exact(henon(40_000)), np.eye(2)).mean(axis=0)
    assert mean.sum() == pytest.approx(log(0.3), abs=1e-12)
    assert mean[0] == pytest.approx(0.4192, abs=0.003)
    matrix = np.array([[0.9, 0.4, 0.1], [0.0, -0.5, 0.2], [0.0, 0.0, 0.2]])
    assert qr_growth(exact([matrix] * 400), np.eye(3))[200:].mean(axis=0) == pytest.approx(
        np.log([0.9, 0.5, 0.2]), abs=1e-9
    )


def test_a_direction_that_is_lost_stays_so():
    """A map onto fewer coordinates, and back onto more: contact takes a direction and gives none."""
    onto, back = np.array([[2.0, 0.0, 0.0], [0.0, 0.5, 0.5]]), np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    growth = qr_growth(exact([onto, back, onto, back]), np.eye(3))
    assert np.isfinite(growth[:, :2]).all()
    assert np.isneginf(growth[:, 2]).all()
    # one that is lost takes no other with it, and one that shrinks by much is not lost
    growth = qr_growth(exact([np.diag([2.0, 0.0, 1e-9, 0.5]), *[np.diag([2.0, 3.0, 1.0, 0.5])] * 3]), np.eye(4))
    expected = np.log(
        [[2.0, 0.0, 1e-9, 0.5]] + [[2.0, 0.0, 1.0, 0.5]] * 3, where=np.arange(4) != 1, out=np.full((4, 4), -np.inf)
    )
    assert growth == pytest.approx(expected)


def test_a_direction_is_lost_where_the_others_leave_less_than_its_error():
    columns = np.array([[1.0, 0.5, 0.0], [0.0, 1e-5, 0.0], [0.0, 0.0, 1.0]])
    for error, second in ((1e-6, 1e-5), (1e-4, 0.0)):
        found, sizes = orthogonal(columns, np.array([0.0, error, 0.0]))
        assert sizes == pytest.approx([1.0, second, 1.0])
        assert found == pytest.approx(np.eye(3)[sizes > 0])
    assert (
        orthogonal(columns, np.array([1e-4, 0.0, 0.0]))[1][1] == 0.0
    )  # half of the error of the first is in the second


def test_the_exponents_of_a_settled_motion_are_those_of_its_multipliers(drift):
    found, expected = spectrum(drift, 200), multipliers(drift)
    assert found.periods == 200
    assert found.per_period == pytest.approx(np.log(np.abs(expected.values)), abs=5e-3)
    assert found.per_period[0] == pytest.approx(log(abs(expected.values[0])), rel=0.02)
    assert found.exponents == pytest.approx(15 * found.per_period)
    assert found.per_period.sum() == pytest.approx(log(abs(np.prod(expected.values))), abs=1e-4)


def test_the_largest_exponent_of_chaos_is_that_of_a_twin():
    run = simulate(Gamma=3.0, e=0.8, periods=200)
    every, largest = spectrum(run, 600), lyapunov(run, 600)
    assert every.periods == largest.periods
    # both have grown alike, but for how the directions that they began with lie to the one that grows
    assert abs(every.per_period[0] - largest.per_period) * largest.periods < log(10)
    assert np.isneginf(every.exponents[-1])  # both ends have been down
    assert (np.diff(every.exponents[np.isfinite(every.exponents)]) < 0).all()


def bouncing(seed):
    """Parameters of a random unlike dimer without friction on a plate that shakes it strongly."""
    rng = np.random.default_rng([20240307, seed])
    low, high = (
        [3.0, 10.0, 2.5, 3e-3, 3e-3, 0.6, 0.6, -0.5, 0.0, 0.0],
        [9.0, 40.0, 8.0, 7e-3, 7e-3, 0.98, 0.98, 1.4, 2.0, 6.2],
    )
    names = ("Gamma", "f", "A_r", "r_1", "r_2", "e_1", "e_2", "beta0", "xdot0", "phi0")
    scene = dict(zip(names, rng.uniform(low, high).tolist(), strict=True))
    return scene | {
        "mu": 0.0,
        "mu_s": 0.0,
        "gammadot0": float(rng.uniform(-50, 50)),
        "thetadot0": float(rng.uniform(-5, 5)),
    }


def test_without_friction_the_exponents_add_up_to_what_impacts_take():
    """A flight keeps the volume of phase space, and an impact of an end of restitution e leaves e^2 of it, in any period."""
    seed = scenes = steep = 0
    while scenes < 20:
        scene, seed = bouncing(seed), seed + 1
        run, f = simulate(**scene, periods=10), scene["f"]
        longer = run.go_on(20 + 1 + 10)
        events = names(longer.events)
        if set(events["kind"].values) - {"FM", "SI1_sp", "SI2_sp"}:
            continue  # an end has stayed down: that takes directions altogether
        scenes += 1
        events = events.sel(event=(events["cause"] == "impact") & (events["time"] * f > 31))
        struck = [(events[f"impulse_{end}"].values > 0).sum() for end in (1, 2)]
        found = spectrum(run, 10)
        assert found.periods == 10
        expected = 2 * (struck[0] * log(scene["e_1"]) + struck[1] * log(scene["e_2"])) * f / 10
        assert found.exponents.sum() == pytest.approx(expected, abs=1e-6 * f), scene
        steep += np.abs(longer.states(np.linspace(31, 41, 400) / f)["beta"].values).max() > pi / 2 - 0.02
    assert seed < 40 and steep >= 2


@pytest.mark.parametrize("lower", [0.1, 1e-3, 1e-6, 1e-9])
def test_places_are_regular_where_the_dimer_stands_upright(lower):
    """To a place and back, and a place a small way off is a state of a dimer as near."""
    run = simulate(beta0=pi / 2 - lower, gap0=1e-3, betadot0=1.0, thetadot0=2.0, gammadot0=30.0, r_2=6e-3, periods=1)
    record = run.record("the test")
    tangents, state, free = Tangents(Section(record.row, 1e-11)), record.segments[0, :N_STATE], np.zeros(2)
    place = tangents.place(state)
    assert tangents.place(tangents.state(place, free)) == pytest.approx(place, abs=1e-12)
    for way in np.eye(10)[:7]:
        assert tangents.place(tangents.state(place + 1e-4 * way, free)) - place == pytest.approx(1e-4 * way, abs=1e-12)
    basis = tangents.basis(place, free)
    assert basis @ basis.T == pytest.approx(np.eye(8), abs=1e-12)
    columns, errors = tangents.grown(place, free, place, basis[:0])  # all were lost
    assert columns.shape == (10, 0) and errors.size == 0


@pytest.mark.parametrize(
    ("scene", "finite"),
    # of the second one 4 to 6 are left, as the chaos goes
    [({"Gamma": 8.0, "e": 0.85, "mu_s": 0.2}, 6), ({"Gamma": 3.0, "e": 0.5, "mu": 0.1, "mu_s": 0.1}, 6)],
)
def test_a_period_that_contracts_by_much_loses_no_exponent(scene, finite):
    """Ends that stick take directions away, in these scenes within 100 periods; what is left does not depend on the length."""
    run = simulate(**scene, periods=100)
    short, long = spectrum(run, 100), spectrum(run, 300)
    for found in (short, long):
        assert (np.isfinite(found.exponents) == (np.arange(8) < finite)).all()
    off = np.abs(short.exponents[:finite] - long.exponents[:finite])
    assert (off < 4 * np.hypot(short.errors[:finite], long.errors[:finite])).all()


# --- derivatives of the return map: a change of the start goes over into that of the end ----------------------------------


@pytest.fixture(scope="module")
def run():
    return simulate(periods=200, rtol=1e-10)


def test_the_matrix_of_multipliers_maps_a_change_of_the_start(run):
    """By differences of the whole map along directions that mix the coordinates."""
    found = multipliers(run)
    free = [NAMES.index(name) for name in found.coordinates]
    record = run.record("the test")
    section = Section(record.row, 1e-11)
    last = record.segments[-1]
    state, modes = last[:16].copy(), last[16:18].copy()
    point = section.point(state)
    assert (np.diff(np.abs(found.values)) <= 0).all()  # the largest first
    np.testing.assert_allclose(np.prod(found.values), np.linalg.det(found.matrix), atol=1e-12)
    assert np.abs(found.matrix - found.matrix.T).max() > 0.1  # rows and columns are told apart
    for seed in range(3):
        way = np.zeros(len(NAMES))
        way[free] = np.random.default_rng(seed).normal(size=len(free))
        step = 2e-5
        ends = [section.after(section.state(point + by * way, modes), 1)[0] for by in (step, -step)]
        change = (ends[0] - ends[1])[free] / (2 * step)
        np.testing.assert_allclose(found.matrix @ way[free], change, atol=1e-3)


def test_the_derivatives_of_an_orbit_map_a_change_of_its_point():
    fixed = orbits.find(spin=100.0).fixed
    m, z = fixed.map, fixed.z
    assert np.abs(fixed.matrix - fixed.matrix.T).max() > 0.1
    for seed in range(3):
        way, step = np.random.default_rng(seed).normal(size=z.size), 2e-5
        ahead, back = m.passage(z + step * way), m.passage(z - step * way)
        np.testing.assert_allclose(fixed.matrix @ way, (ahead.point - back.point) / (2 * step), atol=1e-3)
        assert fixed.gradient @ way == pytest.approx((ahead.spin - back.spin) / m.unit / (2 * step), abs=1e-3)
